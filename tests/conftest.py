"""Fixtures that every room of the tests shares."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

# Before numpy is loaded: more threads do not help matrices this small, and tests run beside one another.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# A job in the background, or under nohup, begins with these ignored, and so would every program that a test starts.
for _number, _handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _handler)

# Measurements that are not ours to ship lie beside the checkout.
MEASURED = Path(__file__).parents[2] / "shared" / "data"


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are processors: many tests wait for instruments, which are as slow as real ones."""
    return (os.cpu_count() or 1) + 1


@pytest.fixture(scope="session")
def measured() -> Path:
    """The folder with measured data: `real_beam` with a beam's tracked points, `tensile` with tensile tests."""
    if not MEASURED.is_dir():
        pytest.skip("needs ../shared/data beside the checkout: measured data that are not ours to ship")
    return MEASURED
