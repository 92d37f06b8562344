"""Fixtures that every room of the tests shares."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Before numpy is loaded: more threads do not help matrices this small, and tests run beside one another.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# A job in the background, or under nohup, begins with these ignored, and so would every program that a test starts.
for _number, _handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _handler)

# What a test starts inherits it, and whatever that starts, beside the name of the test that pytest itself puts there.
os.environ["EIMI_TESTS_OF"] = str(os.getpid())

# Every run draws the same examples, and none has a deadline, nor a limit on how long drawing takes: what a test says of
# the code must not depend on chance or on the machine's load. `--hypothesis-profile=search` draws new examples.
settings.register_profile(
    "steady", deadline=None, derandomize=True, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("search", settings.get_profile("steady"), derandomize=False)
settings.load_profile("steady")

# Measurements that are not ours to ship lie beside the checkout.
MEASURED = Path(__file__).parents[2] / "shared" / "data"


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are processors: many tests wait for instruments, which are as slow as real ones."""
    return (os.cpu_count() or 1) + 1


# A file goes to a worker as a whole. The longest begin first, so that no worker is left alone with one at the end.
_LONGEST = (
    *("test_docs.py", "test_chain.py", "test_fit_grid.py", "test_bench_view.py", "test_joint_evidence.py"),
    *("test_validate.py", "test_recovery.py", "test_examples.py", "test_off_campaign.py", "test_considered.py"),
    *("test_without_hardware.py", "test_named_causes.py", "test_guardian.py", "test_killed_runs.py", "test_study.py"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first; the rest as it was."""
    place = {name: k for k, name in enumerate(_LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


def started_in(test: str) -> list[int]:
    """Programs that were begun in a test's own call, by the test or by one another, where there is a /proc.

    Processes of multiprocessing are left out: they end with theirs, and may be another test's as well.
    """
    marks = (f"PYTEST_CURRENT_TEST={test} (call)\0".encode(), f"EIMI_TESTS_OF={os.getpid()}\0".encode())
    processes = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            environment, command = (process / "environ").read_bytes(), (process / "cmdline").read_bytes()
            if all(mark in environment for mark in marks) and b"multiprocessing" not in command:
                processes.append(int(process.name))
    return processes


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A test that fails, or meets its limit of time, leaves no program behind: a guardian would try for an hour."""
    report = yield
    if report.failed:
        for process in started_in(item.nodeid):
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
    return report


@pytest.fixture(scope="session")
def measured() -> Path:
    """The folder with measured data: `real_beam` with a beam's tracked points, `tensile` with tensile tests."""
    if not MEASURED.is_dir():
        pytest.skip("needs ../shared/data beside the checkout: measured data that are not ours to ship")
    return MEASURED
