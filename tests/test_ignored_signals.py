"""Tests react to Ctrl-C and hang-up, even if pytest was started with both ignored."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

PROJECT = Path(__file__).parents[1]
SIGNALS = [signal.SIGINT, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]


def ignore() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@pytest.mark.skipif(sys.platform == "win32", reason="has no such signals to pass on")
def test_tests_started_with_ignored_signals_restore_them() -> None:
    # One test sends itself Ctrl-C, and another test checks the signals of a program that it starts.
    chosen = ("tests/lab/test_contact.py::test_a_second_ctrl_c_leaves_out_the_ramp", f"{__file__}::{_HEEDED}")
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n0", "-p", "no:cacheprovider", *chosen]
    done = subprocess.run(command, cwd=PROJECT, preexec_fn=ignore, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout


def test_a_program_that_a_test_starts_is_ended_by_signals() -> None:
    code = "import signal, sys; sys.exit(any(signal.getsignal(n) is signal.SIG_IGN for n in map(int, sys.argv[1:])))"
    numbers = [str(int(number)) for number in SIGNALS]
    assert subprocess.run([sys.executable, "-c", code, *numbers], timeout=PATIENCE_S).returncode == 0
    assert not any(signal.getsignal(number) is signal.SIG_IGN for number in SIGNALS)


_HEEDED = test_a_program_that_a_test_starts_is_ended_by_signals.__name__
