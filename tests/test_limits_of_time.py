"""Every test has a time limit, which also ends the processes that the test started."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.shared.processes import alive, wait_until

PROJECT = Path(__file__).parents[1]
HANGING = """
import signal, subprocess, sys, time

PROGRAM = "import os, time; print('begun', os.getpid(), flush=True); time.sleep(3600)"
PARENT = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {PROGRAM!r}], start_new_session=True)"

def test_that_hangs():
    for code in (PROGRAM, PARENT):
        process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        print(process.stdout.readline())
    signal.raise_signal(signal.SIGALRM)  # the limit is reached
    time.sleep(3600)
"""


def test_every_test_has_a_time_limit() -> None:
    # 0 would mean that there is no limit.
    options = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["pytest"]["ini_options"]
    assert 0 < options["timeout"] <= 900


def test_the_time_limit_applies_to_this_test(request: pytest.FixtureRequest) -> None:
    assert request.config.pluginmanager.hasplugin("timeout")
    assert float(request.config.getini("timeout")) > 0


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="has no /proc to look programs up in")
def test_a_hanging_test_is_ended_with_its_processes(tmp_path: Path) -> None:
    # One process is a child of the test; the other one is an orphan in a separate session.
    (tmp_path / "test_hanging.py").write_text(HANGING)
    options = ("-q", "-n0", "-p", "no:cacheprovider", "-p", "conftest", "-c", PROJECT / "pyproject.toml")
    command = [sys.executable, "-m", "pytest", *options, tmp_path]
    path = os.pathsep.join([str(PROJECT / "tests"), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        command, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 1, done.stdout
    assert "Timeout" in done.stdout
    programs = {int(number) for number in re.findall(r"^begun (\d+)$", done.stdout, re.M)}
    assert len(programs) == 2
    for program in programs:
        wait_until(lambda program=program: not alive(program), f"{program} is still there")
