"""After a fault while the coil carries its full current, the run ends with the coil off.

`python -m benchmarks.off_campaign --trials 5` tests more faults.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[2]
QUICK = ("SIGSTOP pty korad", "guardian stopped", "shorted regulator, SIGTERM pty", "swap port genesys")
LONG = (
    *("run and guardian stopped for 12 s, pty", "contact that opens an interlock, tcp", "second acquire, TCP"),
    *("swap, SIGKILL port genesys", "disconnect tcp scpi", "disconnect, SIGKILL tcp scpi", "reenumerate hislip scpi"),
    *("sleep hislip", "brownout tcp", "offset, SIGKILL tcp", "locked, SIGTERM pty", "locked, SIGKILL tcp"),
    "computer dead",
    *("shorted regulator, SIGKILL tcp", "shorted regulator, SIGTERM tcp", "drift pty", "fallen tcp"),
    "grab never returns",
    *("second acquire", "line cut, stopped, HiSLIP", "line cut, killed, HiSLIP", "clock steps back, silent for 3 s"),
    *(
        "stderr unread, killed",
        "Ctrl-Z",
        "grab keeps Python's lock",
        "flush never returns",
        "close never returns",
        "stderr unread",
        "guardian killed",
    ),
)


@pytest.mark.parametrize("fault", [*QUICK, *(pytest.param(fault, marks=pytest.mark.slow) for fault in LONG)])
def test_a_run_at_full_current_ends_with_the_coil_off(fault: str) -> None:
    # The benchmark reports how soon the coil is off; a test does not, because a busy computer is not a defect.
    command = [sys.executable, "-m", "benchmarks.off_campaign", "--trials", "1", "--patience", "10", "--fault", fault]
    # The benchmark waits as long as PATIENCE_S for one condition, and then says which condition was not fulfilled.
    limit_s = PATIENCE_S + 200.0
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=limit_s, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "trials with a fault: 0 of 1" in done.stdout
