"""Ctrl-C ends the program with a report, also if it is pressed twice or arrives in a destructor."""

# In a destructor, Python ignores the exception that a Ctrl-C raises.

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

def interrupted_before(act):
    again = [ctrl_c]
    def acting(said):
        while again:
            again.pop()()
        return act(said)
    return acting

cli.app = app
cli.{place} = interrupted_before(cli.{place})
cli.main()
"""


@pytest.mark.parametrize("place", ["tell", "_report_stop"])
def test_a_second_ctrl_c_does_not_suppress_the_report_of_the_first(place: str) -> None:
    command = [sys.executable, "-c", STOPPED.format(place=place)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (130, "eimi: stopped by SIGINT: the coil is off\n")


DROPPED = """
import os, signal, sys, threading
from eimi_lab import cli

class Departing:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        len("Python handles the signal here")

def app(*arguments, **options):
    Departing()
    threading.Event().wait(30)

cli.app = app
cli.main()
"""


def test_a_ctrl_c_that_arrives_in_a_destructor_still_ends_the_program() -> None:
    done = subprocess.run(
        [sys.executable, "-c", DROPPED], capture_output=True, text=True, check=False, timeout=PATIENCE_S
    )
    assert (done.returncode, done.stderr) == (130, "eimi: stopped by SIGINT\n")
