"""Show the progress of long work on standard error: a bar on a terminal, otherwise one line for each step."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

_unseen = ContextVar("unseen", default=False)


def silent(words: str) -> None:
    """Do nothing with a text about the progress of long work."""


@contextmanager
def unseen() -> Iterator[None]:
    """Suppress the progress bars and progress lines of all work within the context."""
    before = _unseen.set(True)
    try:
        yield
    finally:
        _unseen.reset(before)


@dataclass(frozen=True)
class Report:
    """A function that reports the end of a step of long work.

    Parameters
    ----------
    after_step
        Called after each step with a short text about the step.
    underway
        Called during a step with a short text, which is shown only on a terminal.
    """

    after_step: Callable[[str], None]
    underway: Callable[[str], None] = silent

    def __call__(self, words: str) -> None:
        """Report the end of a step with a short text."""
        self.after_step(words)


@contextmanager
def progress(title: str, total: int) -> Iterator[Report]:
    """Show the progress of long work, with an estimate of the remaining time.

    Parameters
    ----------
    title
        Name of the work.
    total
        Number of steps.

    Yields
    ------
    Report
        The report, to call after each step and within steps.
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
        done, remaining = len(ends), total - len(ends)
        step_s = (ends[-1] - ends[0]) / (done - 1) if done > 1 else 0.0
        estimate = f", about {step_s * remaining:.0f} s left" if done > 1 and remaining else ""
        sys.stderr.write(f"{title} {done}/{total}: {words}{estimate}\n")  # `print` writes the line break separately
        sys.stderr.flush()

    yield Report(line)
