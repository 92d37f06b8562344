"""The command line in this process: a start of the program for each command would take most of the time."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

import pytest

from eimi_lab import cli


class Ended(NamedTuple):
    """A command's exit status, and what it printed on stdout and on stderr."""

    status: int
    said: str
    told: str


@pytest.fixture(scope="session")
def eimi() -> Callable[..., Ended]:
    """Runs a command in a folder."""

    def eimi(*arguments: str | Path, folder: Path) -> Ended:
        said, told = io.StringIO(), io.StringIO()
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(said), redirect_stderr(told):
            patch.chdir(folder)
            patch.setattr(sys, "argv", ["eimi", *map(str, arguments)])
            patch.setattr(cli, "unwind_on_termination", lambda: None)
            with pytest.raises(SystemExit) as exit_:
                cli.main()
        return Ended(int(exit_.value.code or 0), said.getvalue(), told.getvalue())

    return eimi


@pytest.fixture(scope="session")
def done(eimi: Callable[..., Ended]) -> Callable[..., list[str]]:
    """Runs a command that has to succeed; the lines that it prints."""

    def done(*arguments: str | Path, folder: Path) -> list[str]:
        ended = eimi(*arguments, folder=folder)
        assert ended.status == 0, ended.told
        return ended.said.splitlines()

    return done
