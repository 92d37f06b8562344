"""All tasks are done by worker processes, also if a result adds further tasks or if a worker dies."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from eimi_lab.process.workers import _wait_for_end, completed, processes, started
from tests.shared.processes import alive, wait_until


def doubled(number: int, marker: Path | None = None) -> int:
    # Return twice the number. If `marker` is given, the first worker that gets the number 2 dies.
    if marker and number == 2 and not marker.exists():
        marker.touch()
        os._exit(1)
    return 2 * number


def one_less(number: int, result: int) -> list[int]:
    assert result == 2 * number
    return [number - 1] if number else []


@pytest.mark.parametrize("executor", [None, partial(processes, 2)], ids=["here", "two processes"])
def test_a_result_may_add_further_tasks(executor: Any) -> None:
    results = [
        (task, result())
        for task, result in completed(doubled, lambda n: {"number": n}, [3, 10], executor, further=one_less)
    ]
    assert sorted(results) == sorted((n, 2 * n) for first in (3, 10) for n in range(first + 1))


def test_further_tasks_are_done_although_a_worker_dies(tmp_path: Path) -> None:
    marker = tmp_path / "died"
    results = completed(
        doubled, lambda n: {"number": n, "marker": marker}, [4], partial(processes, 1), further=one_less
    )
    assert [task for task, _ in results] == [4, 3, 2, 1, 0]
    assert marker.exists()


def test_workers_get_further_tasks_before_the_result_is_yielded() -> None:
    # The workers work while the caller uses the result.
    submitted: list[int] = []

    class Noting(ThreadPoolExecutor):
        def submit(self, function: Callable[..., Any], /, *_: Any, **named: Any) -> Future[Any]:
            submitted.append(named["number"])
            return super().submit(function, **named)

    results = completed(doubled, lambda n: {"number": n}, [2], partial(Noting, 1), further=one_less)
    next(results)
    assert submitted == [2, 1]


Children = Callable[[], set[Any]]


@pytest.fixture
def children() -> Children:
    # Return a function that returns the running processes that the test has started.
    before = set(multiprocessing.active_children())
    return lambda: set(multiprocessing.active_children()) - before


def test_processes_start_before_the_first_task(children: Children) -> None:
    with started(partial(processes, 1), 1, "json") as executor:
        assert executor is not None
        (worker,) = children()
        with executor() as pool:
            assert pool.submit(os.getpid).result() == worker.pid
        with executor() as pool:  # the next pool has a new process, as after the loss of a worker
            assert pool.submit(os.getpid).result() != worker.pid
    assert not children()
    with started(None, 1, "json") as executor:
        assert executor is None


def test_a_process_that_dies_before_the_first_task_is_replaced(children: Children) -> None:
    with started(partial(processes, 1), 1, "json") as executor:
        (worker,) = children()
        worker.kill()
        worker.join()
        results = completed(doubled, lambda n: {"number": n}, [1, 3], executor)
        assert sorted(result() for _, result in results) == [2, 6]


def test_started_processes_end_after_an_error(children: Children) -> None:
    def stopped() -> None:
        with started(partial(processes, 2), 2, "json"):
            assert children()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert not children()


PARENT = """
import os, signal, sys, time
from eimi_lab.process.workers import processes

if __name__ == "__main__":
    with processes(1) as pool:
        worker = pool.submit(os.getpid).result()
        pool.submit(os.kill, worker, signal.SIGINT).result()  # a worker ignores Ctrl-C, to which its parent reacts
        print(worker, pool.submit(os.getpriority, os.PRIO_PROCESS, 0).result(), flush=True)
        pool.submit(time.sleep, 3600)
        sys.stdin.read()
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="has no /proc to look processes up in")
def test_a_worker_ignores_ctrl_c_gives_way_and_ends_with_its_killed_parent(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    command = [sys.executable, tmp_path / "parent.py"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        worker, priority = map(int, parent.stdout.readline().split())
        assert priority > os.getpriority(os.PRIO_PROCESS, parent.pid)
        parent.kill()
    try:
        wait_until(lambda: not alive(worker), "the worker goes on without its parent")
    finally:
        if alive(worker):
            os.kill(worker, signal.SIGKILL)


def test_a_killed_worker_does_not_keep_the_others_waiting() -> None:
    context = multiprocessing.get_context("spawn")
    waiting, killed = (context.Process(target=time.sleep, args=(1e4,), daemon=True) for _ in range(2))
    for worker in (waiting, killed):
        worker.start()
    killed.kill()
    _wait_for_end([waiting, killed])
    assert (waiting.exitcode, killed.exitcode) == (-signal.SIGTERM, -signal.SIGKILL)


def test_workers_that_end_are_not_terminated() -> None:
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=time.sleep, args=(seconds,), daemon=True) for seconds in (0.0, 0.5)]
    for worker in workers:
        worker.start()
    _wait_for_end(workers)
    assert [worker.exitcode for worker in workers] == [0, 0]


def test_a_pool_ends_if_a_worker_is_killed_after_the_last_task(children: Children) -> None:
    for _ in range(3):
        with processes(2) as pool:
            assert list(pool.map(doubled, [1, 3])) == [2, 6]
            children().pop().kill()
        assert not children()
