"""How far long work has got: a bar with an estimate on a terminal, plain lines elsewhere. All of it on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress(title: str, total: int) -> Iterator[Callable[[str], None]]:
    """Yields a function to call after each of `total` steps with a few words on it."""
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, TextColumn("{task.fields[words]}"), console=Console(stderr=True)) as bar:
            task = bar.add_task(title, total=total, words="")
            yield lambda words: bar.update(task, advance=1, words=words)
        return
    began = time.monotonic()
    done = 0

    def line(words: str) -> None:
        nonlocal done
        done += 1
        left = (time.monotonic() - began) / done * (total - done)
        estimate = f", about {left:.0f} s left" if done < total else ""
        print(f"{title} {done}/{total}: {words}{estimate}", file=sys.stderr, flush=True)

    yield line
