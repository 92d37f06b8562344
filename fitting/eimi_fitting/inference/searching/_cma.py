"""Import the package cma without the packages that it uses for plots and surrogate models.

On import, cma loads matplotlib.pyplot and scipy.stats if they are installed. A search uses neither package. The two
packages take 1.5 s of the 1.8 s of the import (medians of three fresh processes, with numpy and scipy.optimize loaded
before). A whole fit takes about the same time as the import. Both packages are therefore hidden from the thread that
imports cma. Other threads can import both packages meanwhile.
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
    """Hide matplotlib and scipy.stats from the import of cma, which is then faster because it loads neither package.

    Only the thread that created this object cannot import the two packages.
    """

    def __init__(self) -> None:
        self._thread = threading.get_ident()

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        """Raise ModuleNotFoundError for matplotlib and scipy.stats, so that cma is imported without them.

        For every other package, return None, and Python imports it as usual.
        """
        if name in _UNUSED and threading.get_ident() == self._thread:
            raise ModuleNotFoundError(f"{name} is hidden while cma is imported", name=name)


_absent = _Absent()
sys.meta_path.insert(0, _absent)
try:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from cma import CMAEvolutionStrategy
finally:
    sys.meta_path.remove(_absent)

__all__ = ["CMAEvolutionStrategy"]
