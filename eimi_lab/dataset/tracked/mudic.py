"""Read the results of the image correlation program µDIC: the nodes of its mesh in every picture, in pixels.

A pickle can run any code, so only arrays are created from the file. Source: muDIC/IO/readWriteUtils.py, and class
DICOutput in muDIC/solver/correlate.py, of github.com/PolymerGuy/muDIC.
"""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np

from eimi_lab.dataset.tracked.numbers_table import refused
from eimi_lab.dataset.tracked.tracks import Tracks

_ARRAYS = {
    (module, name)
    for module in (
        "numpy",
        "numpy.core.multiarray",
        "numpy._core.multiarray",
        "numpy._core.numeric",
        "numpy.core.numeric",
    )
    for name in ("ndarray", "dtype", "_reconstruct", "scalar", "_frombuffer")
}


def read_mudic(path: Path) -> Tracks:
    """Return the positions of the mesh nodes in a µDIC file in each frame, px. Frame 0 is the reference picture.

    Raises InputError if µDIC did not write the file.
    """
    try:
        with path.open("rb") as file:
            # `muDIC.IO.save` writes a pickle; xnodesT and ynodesT have the shape (nodes, frames)
            saved = _Harmless(file).load()
        x, y = (np.asarray(saved.__dict__[name], dtype=np.float64) for name in ("xnodesT", "ynodesT"))
    except Exception as error:  # a pickle that is damaged or holds something else may raise any error
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise refused(path, "µDIC", f"it should contain results that muDIC.IO.save wrote ({reason})") from error
    if x.ndim != 2 or x.shape != y.shape or not x.size:
        raise refused(path, "µDIC", f"xnodesT and ynodesT should be (nodes, frames), not {x.shape} and {y.shape}")
    places = np.stack([x.T, y.T], axis=-1)
    names = tuple(f"node {k}" for k in range(len(x)))
    return Tracks(names=names, frames=np.arange(len(places)), places=places, rest=places[0], unit="px", image_axes=True)


class _Inert:
    """An object that accepts all calls and does nothing, in place of an object in a pickle."""

    def __new__(cls, *arguments: Any, **named: Any) -> _Inert:
        return object.__new__(cls)

    def __init__(self, *arguments: Any, **named: Any) -> None:
        pass

    def __call__(self, *arguments: Any, **named: Any) -> _Inert:
        return self

    def __setstate__(self, state: Any) -> None:
        if isinstance(state, dict):
            self.__dict__.update({key: value for key, value in state.items() if isinstance(value, np.ndarray)})

    def __setitem__(self, key: Any, value: Any) -> None:
        pass

    # The unpickler calls these methods if the object is a list in the file.
    def append(self, value: Any) -> None:
        pass

    def extend(self, values: Any) -> None:
        pass


def _create_array(make: Any, arguments: Any, state: Any, attributes: Any = None) -> Any:
    """Return an array that the library dill stored in a pickle.

    ``make`` creates an empty array from ``arguments``, and ``state`` contains the shape and the values.
    """
    array = make(*arguments)
    array.__setstate__(state)
    return array


class _Harmless(pickle.Unpickler):
    """An unpickler that creates only arrays; every other object of the file becomes an object that does nothing."""

    def find_class(self, module: str, name: str) -> Any:
        if module.startswith("dill.") and name == "_create_array":
            return _create_array
        if (module, name) in _ARRAYS:
            return super().find_class(module, name)
        return _Inert
