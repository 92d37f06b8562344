"""Record what the functions of a package return during a computation, as one line of text for each function."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

import numpy as np

_WEIGHTS = np.cos(np.arange(1 << 20))


class TracedResults:
    # A context in which the results of all functions in a folder of modules are summed up.
    # Functions named `left_out` are ignored, for example those that keep their results for the next call.

    def __init__(self, folder: Path, left_out: Iterable[str] = ()) -> None:
        self.folder = f"{folder}{os.sep}"
        self.left_out = frozenset(left_out)
        self._sums: dict[str, list[float]] = {}

    def __enter__(self) -> TracedResults:
        self._before = sys.getprofile()
        sys.setprofile(self._record)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        sys.setprofile(self._before)

    def _record(self, frame: FrameType, event: str, result: Any) -> None:
        code = frame.f_code
        # Frames of comprehensions and lambdas ("<lambda>") are not the same in all versions of Python.
        if event != "return" or code.co_name[0] == "<" or not code.co_filename.startswith(self.folder):
            return
        if code.co_name in self.left_out:
            return
        sys.setprofile(None)
        module = code.co_filename.removeprefix(self.folder).removesuffix(".py").replace(os.sep, ".")
        sums = self._sums.setdefault(f"{module}.{code.co_qualname}", [0.0, 0.0, 0.0, 0.0, 0.0])
        sums[0] += 1
        for values in _numbers(result):
            known = values[np.isfinite(values)]
            sums[1] += len(values)
            sums[2] += float(np.abs(known).sum())
            sums[3] += float(known.sum())
            sums[4] += float(_WEIGHTS[: len(known)] @ known)
        sys.setprofile(self._record)

    def lines(self) -> Iterator[str]:
        # Yield, for each function, how often it was called, and three sums over the numbers in all its results.
        # The sums are the mean size of the numbers, their mean, and their mean with weights that depend on the order;
        # the last two are divided by the first.
        for name, (calls, count, size, total, ordered) in sorted(self._sums.items()):
            if count:
                scale = max(size, 1e-12)
                yield (
                    f"{name}: {calls:.0f} calls, {count:.0f} numbers, size {size / count:.6g}, "
                    f"mean {total / scale:.6f}, in order {ordered / scale:.6f}"
                )


def _numbers(value: Any) -> Iterator[Any]:
    if isinstance(value, np.ndarray):
        if value.dtype.kind in "biuf":
            yield value.ravel().astype(np.float64)
    elif isinstance(value, bool | int | float | np.number | np.bool_):
        yield np.array([float(value)])
    elif is_dataclass(value) and not isinstance(value, type):
        for part in fields(value):
            yield from _numbers(getattr(value, part.name, None))
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from _numbers(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _numbers(part)
