"""Measure the duration of a function, once or as the shortest of several runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def timed(run: Callable[[], T], clock: Callable[[], float] = time.perf_counter) -> tuple[float, T]:
    """Run a function once; return the duration (s) and the result."""
    began = clock()
    result = run()
    return clock() - began, result


def fastest(run: Callable[[], T], repeats: int) -> tuple[float, T]:
    """Run a function several times; return the shortest processor time (s) and the last result."""
    runs = [timed(run, time.process_time) for _ in range(repeats)]
    return min(seconds for seconds, _ in runs), runs[-1][1]
