"""A Ctrl-C that comes at a bad moment: while the program tells of the first, or where Python drops what is raised."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.patience import PATIENCE_S

STOPPED = """
import os, signal
from eimi_lab import cli
from eimi_lab.process.stopping import Stopped

def ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)

def app(*arguments, **options):
    try:
        ctrl_c()
    except Stopped as stopped:
        raise Stopped(stopped.number, "the coil is off") from stopped

def with_another_before(act):
    again = [ctrl_c]
    def acting(said):
        while again:
            again.pop()()
        return act(said)
    return acting

cli.app = app
cli.{place} = with_another_before(cli.{place})
cli.main()
"""


@pytest.mark.parametrize("place", ["tell", "_report_stop"])
def test_what_the_first_left_behind_is_told_all_the_same(place: str) -> None:
    command = [sys.executable, "-c", STOPPED.format(place=place)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (130, "eimi: stopped by SIGINT: the coil is off\n")


DROPPED = """
import os, signal, sys, threading
from eimi_lab import cli

class Departing:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        len("here Python hears of it")

def app(*arguments, **options):
    Departing()
    threading.Event().wait(30)

cli.app = app
cli.main()
"""


def test_one_that_python_drops_comes_again() -> None:
    done = subprocess.run(
        [sys.executable, "-c", DROPPED], capture_output=True, text=True, check=False, timeout=PATIENCE_S
    )
    assert (done.returncode, done.stderr) == (130, "eimi: stopped by SIGINT\n")
