"""Runs that are killed at random times leave the coil off, and their states are stored.

`python -m benchmarks.kill_campaign --runs 500` is the long campaign.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

SEED = 18  # the first run of this seed is killed by SIGKILL with the output on
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("runs", "seed"), [(1, SEED), pytest.param(40, 5, marks=pytest.mark.slow)])
def test_killed_runs_leave_the_coil_off_and_their_states_stored(runs: int, seed: int) -> None:
    # The benchmark reports how soon the coil is off; a test does not, because a busy computer is not a defect.
    command = [
        sys.executable,
        "-m",
        "benchmarks.kill_campaign",
        "--runs",
        str(runs),
        "--seed",
        str(seed),
        "--off-within",
        "30",
        "--resumed",
        "1",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"runs with a fault: 0 of {runs}" in done.stdout
