"""A separate process for work that is long or may crash, such as reading HDF5 files and finding edges."""

from __future__ import annotations

import asyncio
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from eimi_lab.process.detached import give_way
from eimi_lab.process.errors import InputError
from eimi_lab.process.workers import leave_with_parent, start_resource_tracker

T = TypeVar("T")

LONGEST_S = 120.0
GIVES_WAY = 5  # number that is added to the nice value, so that the server answers STOP first


class Worker:
    """A separate process that carries out one task after another, and is started again after a crash."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._turn = asyncio.Lock()

    async def do(self, function: Callable[..., T], *arguments: Any) -> T:
        """Call a function of a module in the worker process, and return its result.

        Raises
        ------
        InputError
            If the process crashed, or if the call took too long.
        """
        # A task is handed over after the previous task has ended, so that the wait does not count toward LONGEST_S.
        async with self._turn:
            if self._pool is None:
                start_resource_tracker()
                self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin)
            pool = self._pool
            try:
                return await asyncio.wait_for(asyncio.wrap_future(pool.submit(function, *arguments)), LONGEST_S)
            except BrokenProcessPool as error:
                self._drop(pool)
                raise InputError(
                    "the process that read this file crashed; the file may be damaged, and `eimi recover` may help"
                ) from error
            except TimeoutError as error:
                self._drop(pool)
                raise InputError(f"the request took more than {LONGEST_S:g} s and was cancelled") from error

    def close(self) -> None:
        """End the worker process, even during a task."""
        if self._pool is not None:
            self._drop(self._pool)

    def _drop(self, pool: ProcessPoolExecutor) -> None:
        processes = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()
        if self._pool is pool:
            self._pool = None


def _begin() -> None:
    leave_with_parent()
    give_way(GIVES_WAY)
