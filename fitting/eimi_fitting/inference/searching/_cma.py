"""The package cma, without what it imports to draw and to judge surrogates, and a search does not use.

It imports matplotlib.pyplot and scipy.stats where it finds them. Together they take 1.5 of 1.8 s (medians of three
fresh processes, numpy and scipy.optimize loaded before), as long as a whole fit. While cma is imported the two are not
found, by this thread alone: another thread that imports them at that moment gets them.
"""

from __future__ import annotations

import sys
import threading
import warnings
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from types import ModuleType

_UNUSED = frozenset({"matplotlib", "scipy.stats"})


class _Absent(MetaPathFinder):
    """Says of the unused packages that they are not there, to the thread that made it."""

    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        """Leaves every other module, and every other thread, to the finders that follow."""
        if name in _UNUSED and threading.get_ident() == self._thread:
            raise ModuleNotFoundError(f"{name} is not wanted here", name=name)


_absent = _Absent()
sys.meta_path.insert(0, _absent)
try:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from cma import CMAEvolutionStrategy
finally:
    sys.meta_path.remove(_absent)

__all__ = ["CMAEvolutionStrategy"]
