"""Two runs never share a supply, and the computer does not go to sleep during a run."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from eimi_drivers.interfaces import InstrumentError
from eimi_lab.acquisition import supply_lock
from eimi_lab.acquisition.supply_lock import only_run_on
from eimi_lab.process.awake import kept_awake
from eimi_lab.process.errors import InputError
from tests.patience import PATIENCE_S

ADDRESS = "TCPIP::192.0.2.7::5025::SOCKET"
HOLD = """
import sys
from eimi_lab.acquisition.supply_lock import only_run_on
with only_run_on(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_run_on_a_supply_is_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, f"{ADDRESS}#2"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as first:
        assert first.stdin is not None
        assert first.stdout is not None
        assert first.stdout.readline() == "held\n"
        with pytest.raises(InstrumentError, match="another run uses this supply") as caught, only_run_on(ADDRESS):
            pass
        assert "\n" not in str(caught.value)
        with only_run_on("TCPIP::192.0.2.8::5025::SOCKET"):  # a run on another supply is allowed
            pass
        first.kill()
        first.wait(PATIENCE_S)
    with only_run_on(ADDRESS):  # the run has died, and its lock has ended
        pass


def test_one_of_two_runs_that_begin_at_the_same_time_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", HOLD, ADDRESS],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    began = [run.stdout.readline() for run in runs if run.stdout is not None]
    assert sorted(began) == ["", "held\n"]
    answers = [run.communicate()[1] for run in runs]
    assert [run.returncode for run in runs] == [0 if line else 1 for line in began]
    assert "another run uses this supply" in answers[began.index("")]


def test_a_folder_for_locks_that_does_not_exist_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "absent"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with only_run_on(ADDRESS):
        (lock,) = tmp_path.iterdir()
        assert lock.name.startswith(".eimi-supply-")


def test_a_lock_that_cannot_be_made_is_not_called_another_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "absent"))
    with pytest.raises(InputError, match=r"there is no folder .*absent"), only_run_on(ADDRESS):
        pass


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="systemd-inhibit is of Linux")
def test_sleep_is_inhibited_as_long_as_the_context_lasts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noted = tmp_path / "noted"
    program = tmp_path / "systemd-inhibit"
    program.write_text(f'#!/bin/sh\necho "$@" > {noted}\nexec cat\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    with kept_awake("a run"):
        deadline_s = time.monotonic() + PATIENCE_S
        while not noted.exists() or not noted.read_text():
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
    assert noted.read_text().split() == ["--what=sleep:idle", "--who=eimi", "--why=a", "run", "cat"]


def test_a_system_without_a_way_to_inhibit_sleep_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with kept_awake("a run"):
        pass


def test_the_names_of_one_serial_port_share_one_lock(monkeypatch: pytest.MonkeyPatch) -> None:
    locks: list[object] = []
    monkeypatch.setattr(supply_lock, "WriterLock", lambda path: SimpleNamespace(release=lambda: locks.append(path)))
    for address in ("/dev/ttyEIMI", "ASRL/dev/ttyEIMI::INSTR", "/dev/../dev/ttyEIMI#2", "/dev/ttyeimi", "COM3", "com3"):
        with only_run_on(address):
            pass
    assert locks[0] == locks[1] == locks[2] != locks[3]
    assert locks[4] == locks[5] not in locks[:4]
