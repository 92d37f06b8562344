"""How far long work has got: a bar with an estimate on a terminal, plain lines elsewhere. All of it on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

_unseen = ContextVar("unseen", default=False)


def silent(words: str) -> None:
    """In place of a report, for callers that do not want to hear of each step."""


@contextmanager
def unseen() -> Iterator[None]:
    """No progress is told while this lasts."""
    before = _unseen.set(True)
    try:
        yield
    finally:
        _unseen.reset(before)


@dataclass(frozen=True)
class Report:
    """Called after each step with a few words on it. underway: the same within a step, shown on a terminal alone."""

    after_step: Callable[[str], None]
    underway: Callable[[str], None] = silent

    def __call__(self, words: str) -> None:
        """A step is done."""
        self.after_step(words)


@contextmanager
def progress(title: str, total: int) -> Iterator[Report]:
    """Yields what to call after each of `total` steps, and within them.

    The first step is not in the estimate, nor is what comes before it: a coil is conditioned then, modules are loaded.
    """
    if _unseen.get():
        yield Report(silent)
        return
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, TextColumn("{task.fields[words]}"), console=Console(stderr=True)) as bar:
            task = bar.add_task(title, total=total, words="")
            yield Report(
                lambda words: bar.update(task, advance=1, words=words), lambda words: bar.update(task, words=words)
            )
        return
    ends: list[float] = []

    def line(words: str) -> None:
        ends.append(time.monotonic())
        done, left = len(ends), total - len(ends)
        estimate = f", about {(ends[-1] - ends[0]) / (done - 1) * left:.0f} s left" if done > 1 and left else ""
        print(f"{title} {done}/{total}: {words}{estimate}", file=sys.stderr, flush=True)

    yield Report(line)
