"""Tasks shared out to processes: those that follow from others, workers that die, processes that begin early."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from eimi_lab.process.workers import completed, processes, started


def doubled(number: int, marker: Path | None = None) -> int:
    """The worker that is the first to have 2 dies of it, where there is a marker to tell."""
    if marker and number == 2 and not marker.exists():
        marker.touch()
        os._exit(1)
    return 2 * number


def one_less(number: int, result: int) -> list[int]:
    assert result == 2 * number
    return [number - 1] if number else []


@pytest.mark.parametrize("executor", [None, partial(processes, 2)], ids=["here", "two processes"])
def test_a_result_asks_for_further_tasks(executor: Any) -> None:
    found = [
        (task, result())
        for task, result in completed(doubled, lambda n: {"number": n}, [3, 10], executor, further=one_less)
    ]
    assert sorted(found) == sorted((n, 2 * n) for first in (3, 10) for n in range(first + 1))


def test_what_follows_from_a_result_is_done_though_a_worker_dies(tmp_path: Path) -> None:
    marker = tmp_path / "died"
    found = completed(doubled, lambda n: {"number": n, "marker": marker}, [4], partial(processes, 1), further=one_less)
    assert [task for task, _ in found] == [4, 3, 2, 1, 0]
    assert marker.exists()


def test_workers_have_what_follows_before_a_result_is_given() -> None:
    """Else they would wait while somebody draws what was found."""
    given: list[int] = []

    class Noting(ThreadPoolExecutor):
        def submit(self, function: Callable[..., Any], /, *_: Any, **named: Any) -> Future[Any]:
            given.append(named["number"])
            return super().submit(function, **named)

    found = completed(doubled, lambda n: {"number": n}, [2], partial(Noting, 1), further=one_less)
    next(found)
    assert given == [2, 1]


Children = Callable[[], set[Any]]


@pytest.fixture
def children() -> Children:
    """Processes that were started since the test was: others may be there of tests before."""
    before = set(multiprocessing.active_children())
    return lambda: set(multiprocessing.active_children()) - before


def test_processes_begin_before_they_are_asked_for(children: Children) -> None:
    with started(partial(processes, 1), 1, "json") as executor:
        assert executor is not None
        (worker,) = children()
        with executor() as pool:
            assert pool.submit(os.getpid).result() == worker.pid
        with executor() as pool:  # as after the loss of one
            assert pool.submit(os.getpid).result() != worker.pid
    assert not children()
    with started(None, 1, "json") as executor:
        assert executor is None


def test_a_process_that_dies_before_it_is_asked_for_is_replaced(children: Children) -> None:
    with started(partial(processes, 1), 1, "json") as executor:
        (worker,) = children()
        worker.kill()
        worker.join()
        found = completed(doubled, lambda n: {"number": n}, [1, 3], executor)
        assert sorted(result() for _, result in found) == [2, 6]


def test_processes_that_have_begun_do_not_outlive_an_error(children: Children) -> None:
    def stopped() -> None:
        with started(partial(processes, 2), 2, "json"):
            assert len(children()) == 2
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert not children()
