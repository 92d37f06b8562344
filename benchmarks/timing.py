"""Seconds of something that is run: once, or the fastest of several."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def timed(run: Callable[[], T], clock: Callable[[], float] = time.perf_counter) -> tuple[float, T]:
    """Seconds of one run, and what it gave."""
    began = clock()
    result = run()
    return clock() - began, result


def fastest(run: Callable[[], T], repeats: int) -> tuple[float, T]:
    """Processor seconds of the fastest of several runs, which is what a machine with nothing else to do takes.

    Also gives what the last run gave.
    """
    runs = [timed(run, time.process_time) for _ in range(repeats)]
    return min(seconds for seconds, _ in runs), runs[-1][1]
