"""Which combinations of the unknowns the data fix, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NOT_FIXED = 0.5  # share of the prior range above which the data say little
_NAMED = 0.1  # share of a direction's square that a coordinate must have to be named


@dataclass(frozen=True)
class Direction:
    """An eigen-direction of the Fisher information, in units of what was known before.

    words: the coordinates that make it up; remaining: how much of the earlier standard deviation the data leave.
    """

    words: str
    remaining: float


def directions(names: Sequence[str], information: Array, prior: Array) -> tuple[Direction, ...]:
    """Eigen-directions of the information (n, n) of the data relative to the prior's, best known first."""
    scale = 1 / np.sqrt(np.diag(prior))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        found.append(Direction(_words(names, vector), float(1 / np.sqrt(1 + max(value, 0.0)))))
    return tuple(found)


def _words(names: Sequence[str], vector: Array) -> str:
    order = [int(i) for i in np.argsort(-np.abs(vector)) if vector[i] ** 2 >= _NAMED]
    lead = np.sign(vector[order[0]])
    words = names[order[0]]
    for i in order[1:]:
        words += f" {'with' if np.sign(vector[i]) == lead else 'against'} {names[i]}"
    return words


def statement(
    names: Sequence[str],
    law_coordinates: int,
    remaining: Array,
    correlation: Array,
    eigen: Sequence[Direction],
) -> str:
    """One to three sentences; remaining (n,): each coordinate's standard deviation over its earlier one."""
    own = names[:law_coordinates]
    data = "These data" if len(own) == len(names) else "These data and what is known beside them"
    loose = [name for name, share in zip(own, remaining, strict=False) if share > NOT_FIXED]
    fixed = [name for name in own if name not in loose]
    if not loose:
        words = f"{data} fix every parameter of this law."
    elif names[0] in loose:
        words = f"{data} fix no parameter of this law, not even its initial shear modulus."
    else:
        only = "only " if len(fixed) == 1 else ""
        words = (
            f"{data} fix {only}{' and '.join(fixed)}; they do not fix {', '.join(loose)}, "
            "whose intervals are set by the bounds of the search."
        )
    partners = [
        (names[j], correlation[0, j]) for j in range(law_coordinates, len(names)) if abs(correlation[0, j]) > 0.9
    ]
    for name, rho in partners:
        combination = "ratio" if rho > 0 and name.startswith(("moment", "coil")) else "combination"
        words += (
            f" {names[0]} and {name} are correlated by {rho:+.3f}: the data fix their {combination}, "
            f"and what is known of {name} the rest."
        )
    if len(fixed) > 1 and eigen and eigen[0].words not in names:
        words += f" Best known is the combination {eigen[0].words}."
    return words
