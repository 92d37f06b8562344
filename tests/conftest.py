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


# A file goes to a worker as a whole. The longest begin first, so that no worker is left alone with one at the end.
_LONGEST = (
    *("test_chain.py", "test_fit_grid.py", "test_docs.py", "test_bench_view.py", "test_joint_evidence.py"),
    *("test_validate.py", "test_recovery.py", "test_examples.py", "test_off_campaign.py", "test_named_causes.py"),
    *("test_without_hardware.py", "test_stiffness_range.py", "test_guardian.py", "test_killed_runs.py"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first; the rest as it was."""
    place = {name: k for k, name in enumerate(_LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


@pytest.fixture(scope="session")
def measured() -> Path:
    """The folder with measured data: `real_beam` with a beam's tracked points, `tensile` with tensile tests."""
    if not MEASURED.is_dir():
        pytest.skip("needs ../shared/data beside the checkout: measured data that are not ours to ship")
    return MEASURED
