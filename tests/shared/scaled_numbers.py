"""Write a result as lines of text, with each array scaled to values near 1, for comparison with a reference file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from tests.shared.accepted_numbers import described

_ZERO = 1e-13
"""An array with smaller values is described as it is."""


def of(value: Any, name: str) -> Iterator[str]:
    # Yield the description of a value; each array in it is divided by a power of ten (values near 1).
    if isinstance(value, np.ndarray) and np.iscomplexobj(value):
        value = np.stack([value.real, value.imag])
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if is_dataclass(value) and not isinstance(value, type):
        value = {part.name: getattr(value, part.name) for part in fields(value)}
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from of(part, f"{name}.{key}")
    elif isinstance(value, list | tuple) and not all(isinstance(part, float | int) for part in value):
        for number, part in enumerate(value):
            yield from of(part, f"{name}.{number}")
    elif isinstance(value, np.ndarray | list | tuple | np.floating | float) and np.size(value):
        array = np.atleast_1d(np.asarray(value, float))
        largest = np.abs(array[np.isfinite(array)]).max(initial=0.0)
        power = int(np.floor(np.log10(largest))) if largest > _ZERO else 0
        yield from described(array / 10.0**power, f"{name} (1e{power})")
    else:
        yield from described(value, name)
