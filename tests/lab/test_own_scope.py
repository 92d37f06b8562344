"""The guardian process asks systemd for a separate group of processes (scope), so that it outlives the run."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from eimi_lab.process import scope
from tests.patience import PATIENCE_S


@pytest.fixture
def busctl_arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # The file to which a replacement for the program busctl writes its arguments.
    busctl = tmp_path / "busctl"
    busctl.write_text(f'#!/bin/sh\nprintf "%s\\n" "$@" > {tmp_path}/asked\nexit $(cat {tmp_path}/status)\n')
    busctl.chmod(0o755)
    (tmp_path / "status").write_text("0")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    (tmp_path / "group").write_text("0::/user.slice/user-1000.slice/user@1000.service/app.slice/terminal.scope\n")
    monkeypatch.setattr(scope, "_OWN_GROUP", tmp_path / "group")
    monkeypatch.setattr(scope, "WITHIN_S", PATIENCE_S)
    return tmp_path / "asked"


def test_systemd_is_asked_for_a_scope_with_this_process(busctl_arguments: Path) -> None:
    assert scope.move_to_own_scope("eimi-guardian", "switches off")
    words = busctl_arguments.read_text().splitlines()
    assert words[:2] == ["--user", "call"]
    start = words.index("StartTransientUnit")
    process = str(os.getpid())
    assert words[start + 2 : start + 4] == [f"eimi-guardian-{process}.scope", "fail"]
    assert words[start + 4 :] == ["2", "Description", "s", "switches off", "PIDs", "au", "1", process, "0"]


def test_a_systemd_that_refuses_is_no_fault(busctl_arguments: Path) -> None:
    busctl_arguments.with_name("status").write_text("1")
    assert not scope.move_to_own_scope("eimi-guardian", "switches off")


def test_a_process_that_outlives_the_session_stays_where_it_is(busctl_arguments: Path) -> None:
    busctl_arguments.with_name("group").write_text("0::/user.slice/user-1000.slice/session-3.scope\n")
    assert not scope.move_to_own_scope("eimi-guardian", "switches off")
    assert not busctl_arguments.exists()
