"""Import the package cma without matplotlib and scipy.stats, which a search does not use."""

from __future__ import annotations

import sys
import threading
import warnings
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from types import ModuleType

# These packages take 1.5 s of the 1.8 s of the import of cma (medians of three fresh processes, with numpy and
# scipy.optimize loaded). The import takes about as long as a whole fit.
_UNUSED = frozenset({"matplotlib", "scipy.stats"})


class _Absent(MetaPathFinder):
    # Blocks slow imports in the thread that creates this object.
    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        if name in _UNUSED and threading.get_ident() == self._thread:
            raise ModuleNotFoundError(
                f"the import of {name} is blocked on purpose while cma is imported, because nothing here needs it",
                name=name,
            )


_absent = _Absent()
sys.meta_path.insert(0, _absent)
try:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from cma import CMAEvolutionStrategy
finally:
    sys.meta_path.remove(_absent)

__all__ = ["CMAEvolutionStrategy"]
