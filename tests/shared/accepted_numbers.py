"""Describe the numbers of a result as lines of text, and compare them with an accepted text in a file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

MOST = 8
"""Largest number of values of an array that are described."""

_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")


def described(value: Any, name: str) -> Iterator[str]:
    """Yield a line for each number, text and array (shape, mean, deviation, some values) in a value."""
    if is_dataclass(value) and not isinstance(value, type):
        for part in fields(value):
            yield from described(getattr(value, part.name), f"{name}.{part.name}")
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from described(part, f"{name}.{key}")
    elif isinstance(value, list | tuple):
        yield f"{name}: {len(value)} parts"
        for number, part in enumerate(value):
            yield from described(part, f"{name}.{number}")
    elif isinstance(value, np.ndarray):
        yield f"{name}: {_array(value)}"
    elif isinstance(value, bool | np.bool_) or value is None or isinstance(value, str):
        yield f"{name}: {value}"
    elif isinstance(value, int | float | np.number):
        yield f"{name}: {float(value):.6g}"
    else:
        yield f"{name}: {type(value).__name__}"


def _array(values: np.ndarray) -> str:
    shape = " x ".join(map(str, values.shape))
    every = values.astype(float).ravel()
    known = every[np.isfinite(every)]
    if not len(known):
        return f"({shape}) no known value"
    unknown = f", {len(every) - len(known)} unknown" if len(known) < len(every) else ""
    chosen = known[np.unique(np.linspace(0, len(known) - 1, min(MOST, len(known))).astype(int))]
    weight = np.cos(np.arange(len(known)))  # so that the order of the values counts
    return (
        f"({shape}){unknown} mean {known.mean():.6g} deviation {known.std():.6g} in order {(weight * known).mean():.6g}"
        f": {' '.join(f'{value:.6g}' for value in chosen)}"
    )


def differences(lines: Iterable[str], accepted: Iterable[str], relative: float, absolute: float) -> list[str]:
    """Return the lines that differ from the accepted lines in words, or in numbers by more than the tolerances."""
    here, there = list(lines), list(accepted)
    if len(here) != len(there):
        return [f"{len(here)} lines instead of {len(there)}", *sorted(set(here).symmetric_difference(there))]
    return [
        f"{one}\n    instead of\n{other}"
        for one, other in zip(here, there, strict=True)
        if not _near(one, other, relative, absolute)
    ]


def _near(one: str, other: str, relative: float, absolute: float) -> bool:
    if one == other:
        return True
    if _NUMBER.sub("#", one) != _NUMBER.sub("#", other):
        return False
    return np.allclose(*([float(text) for text in _NUMBER.findall(line)] for line in (one, other)), relative, absolute)


def check(lines: Iterable[str], accepted: Path, folder: Path, relative: float = 1e-4, absolute: float = 2e-5) -> None:
    """Fail if the lines differ from the file `accepted`, and write them to `folder` as a new proposal."""
    described_now = list(lines)
    new = folder / accepted.name
    new.write_text("\n".join(described_now) + "\n", encoding="utf-8")
    known = accepted.read_text(encoding="utf-8").splitlines() if accepted.exists() else []
    wrong = differences(described_now, known, relative, absolute)
    assert not wrong, f"the new description is in {new}:\n" + "\n".join(wrong[:40])
