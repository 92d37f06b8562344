"""Settings of all tests, and the fixture with measured data."""

from __future__ import annotations

import gc
import logging
import os
import signal
from collections.abc import Generator, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# These lines must precede the import of numpy. More threads do not speed up small matrices, and tests run in parallel.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# Under nohup or in the background a process starts with these signals ignored, and its children would inherit this.
for _name, _handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    if hasattr(signal, _name) and signal.getsignal(getattr(signal, _name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, _name), _handler)

# Processes that a test starts inherit this variable, and the variable of pytest with the name of the test.
os.environ["EIMI_TESTS_OF"] = str(os.getpid())

# Every run draws the same examples without a deadline, so that a result does not depend on chance or on the load of the
# machine. `--hypothesis-profile=search` draws new examples.
settings.register_profile(
    "steady", deadline=None, derandomize=True, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("search", settings.get_profile("steady"), derandomize=False)
settings.load_profile("steady")

# Measured data that may not be distributed are beside the checkout.
MEASURED = Path(__file__).parents[2] / "shared" / "data"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    # Use one more worker than there are processors, because many tests wait.
    return (os.cpu_count() or 1) + 1


# A worker runs whole files. The slowest files start first, so that no worker is still busy with a slow file at the end.
_LONGEST = (
    "test_aravis_faults.py",  # this file waits for timeouts, and other files need its emulated camera
    *("test_docs.py", "test_bench_view.py", "test_fit_grid.py", "test_chain.py", "test_off_campaign.py"),
    *("test_causes.py", "test_programs.py", "test_report.py", "test_guided_way.py", "test_guardian.py"),
    *("test_fit_auxiliary.py", "test_live_camera.py", "test_supply_conformance.py", "test_importing_hostile.py"),
    *("test_events.py", "test_vision_following.py", "test_without_hardware.py", "test_examples.py", "test_recovery.py"),
    *("test_lossy_camera.py", "test_bench.py", "test_law_of_time.py", "test_types.py", "test_killed_runs.py"),
)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # Run the slowest test files first if there are several workers.
    if not hasattr(config, "workerinput"):
        return
    place = {name: k for k, name in enumerate(_LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    # Exclude the collected tests from garbage collection, which saves time.
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def started_in(test: str) -> list[int]:
    # Return the numbers of the processes (except multiprocessing) that a test has started; empty without /proc.
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
    # After a failed test, kill the processes that the test left behind.
    report = yield
    if report.failed:
        for process in started_in(item.nodeid):
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
    return report


@pytest.fixture(autouse=True)
def log_as_before() -> Iterator[None]:
    # After each test, restore the settings of the project's loggers.
    loggers = [
        logger
        for name, logger in logging.Logger.manager.loggerDict.items()
        if name.startswith("eimi_") and isinstance(logger, logging.Logger)
    ]
    before = [(logger.level, logger.propagate, logger.disabled, list(logger.handlers)) for logger in loggers]
    disabled = logging.Logger.manager.disable
    yield
    logging.disable(disabled)
    for logger, (level, propagates, is_disabled, handlers) in zip(loggers, before, strict=True):
        logger.setLevel(level)
        logger.propagate, logger.disabled, logger.handlers[:] = propagates, is_disabled, handlers


@pytest.fixture(scope="session")
def measured() -> Path:
    # The folder of measured data: `real_beam` (tracked points) and `tensile`; tests are skipped without it.
    if not MEASURED.is_dir():
        pytest.skip("needs ../shared/data beside the checkout: measured data that are not ours to ship")
    return MEASURED
