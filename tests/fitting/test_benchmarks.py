"""The independent finite-element program FElupe computes the same bending of a beam as `eimi_fitting`."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_felupe_gives_the_same_rotation_of_the_tip_over_the_field():
    pytest.importorskip("felupe", reason="FElupe is not installed (pip install -e '.[bench]')")
    pytest.importorskip("tensortrax", reason="tensortrax is not installed (pip install -e '.[bench]')")
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.peer", "--short"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    worst = [float(x) for x in re.findall(r"FElupe .* at most ([0-9.]+) %", run.stdout)]
    assert len(worst) == 2  # the laws neo-Hookean and Ogden
    assert max(worst) < 0.1
