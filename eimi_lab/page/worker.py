"""One process beside the server for whatever takes long, or may never come back: HDF5, edges, fits.

A library that crashes on a damaged file takes that process along and not the page, nor a run.
"""

from __future__ import annotations

import asyncio
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from eimi_lab.process.errors import InputError
from eimi_lab.process.workers import leave_with_parent, start_resource_tracker

T = TypeVar("T")

LONGEST_S = 120.0


class Worker:
    """Does one thing after the other; begun when it is first needed, and anew after it broke."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    async def do(self, function: Callable[..., T], *arguments: Any) -> T:
        """What a function of a module gives. Raises what it raises, InputError where the process did not survive."""
        if self._pool is None:
            start_resource_tracker()
            self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), leave_with_parent)
        pool = self._pool
        try:
            return await asyncio.wait_for(asyncio.wrap_future(pool.submit(function, *arguments)), LONGEST_S)
        except BrokenProcessPool as error:
            self._drop(pool)
            raise InputError("the process that read this died of it: is the file damaged?") from error
        except TimeoutError as error:
            self._drop(pool)
            raise InputError(f"took more than {LONGEST_S:g} s, and was given up") from error

    def close(self) -> None:
        """End it, whatever it does."""
        if self._pool is not None:
            self._drop(self._pool)

    def _drop(self, pool: ProcessPoolExecutor) -> None:
        processes = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()
        if self._pool is pool:
            self._pool = None
