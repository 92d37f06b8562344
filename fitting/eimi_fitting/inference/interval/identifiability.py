"""Which combinations of the unknowns the data fix, in numbers and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.quantity import Quantity

Array = NDArray[np.float64]

NOT_FIXED = 0.5  # share of the prior range above which the data say little
_ROUGH = 0.25  # and above which they say no more than where in the range it may lie
_OF_RANGE = 2 * 1.96 / 12**0.5  # width of a 95 % interval over the range, where the prior's spread remains
_UNKNOWN_FACTOR = 4.0  # between the ends of a modulus's interval: beyond it not even its size is known
_NAMED = 0.1  # share of a direction's square that a coordinate must have to be named
_TOGETHER = 0.9  # correlation above which two unknowns are told as one combination


@dataclass(frozen=True)
class Direction:
    """An eigen-direction of the Fisher information, in units of what was known before.

    words: the coordinates that make it up; remaining: how much of the earlier standard deviation the data leave.
    """

    words: str
    remaining: float


@dataclass(frozen=True)
class Identifiability:
    """What the data fix.

    statement: in words; not_fixed: coordinates of the law that the data leave open; held_by_bounds: parameters whose
    value and interval are set by the bounds of the search; at_bound: coordinates that ended on a bound; residual_mm:
    residual standard deviation; points: how many there are, which count as independent_points, in the mean
    correlation_points as one; names and correlation: all unknowns and how their errors hang together, a row each;
    directions: best known first; profiled: coordinates whose interval is that of the profile likelihood; noise_mm,
    noise_points: standard deviation, and independent points, of what stated sources do not explain of the residuals,
    None in files of earlier releases; stated_squares: of what sources and priors are off by where they explain most, in
    standard uncertainties, the sum of squares; model_mm: where sources are stated, standard deviation of what
    the model's corrections leave, less than which they are not asked to explain.
    """

    statement: str
    not_fixed: tuple[str, ...]
    held_by_bounds: tuple[str, ...]
    at_bound: tuple[str, ...]
    residual_mm: float
    correlation_points: float
    points: int
    independent_points: float
    names: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    directions: tuple[Direction, ...]
    profiled: tuple[str, ...]
    noise_mm: float | None = None
    noise_points: float | None = None
    stated_squares: float = 0.0
    model_mm: float = 0.0


def is_open(modulus: Quantity) -> bool:
    """Whether an interval leaves the size of a modulus open."""
    low, high = modulus.interval_95
    return not 0 < high <= _UNKNOWN_FACTOR * low


def held_by_bounds(slopes: Array, covariance: Array, open_coordinates: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(m,): parameters whose variance is for the most part that of coordinates which only the bounds limit.

    slopes: (m, n) of the parameters in the coordinates, whose covariance is (n, n); open_coordinates: (n,).
    """
    own = np.einsum("mi,ij,mj->m", slopes, covariance, slopes)
    from_bounds = slopes[:, open_coordinates] ** 2 @ np.diag(covariance)[open_coordinates]
    return np.asarray(from_bounds > 0.5 * own)


def directions(names: Sequence[str], information: Array, prior: Array) -> tuple[Direction, ...]:
    """Eigen-directions of the information (n, n) of the data relative to the prior's (n, n), best known first."""
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
    not_fixed: Sequence[str],
    correlation: Array,
    eigen: Sequence[Direction],
    ratios: Sequence[str],
    remaining: Sequence[float],
    modulus: Quantity,
    priors: bool = False,
) -> str:
    """A few sentences. ratios: nuisances that multiply what the modulus divides; remaining: of each prior spread.

    priors: whether there are any on the law's parameters.
    """
    own = names[:law_coordinates]
    data = "These data" if len(own) == len(names) and not priors else "These data and what is known beside them"
    fixed = [name for name in own if name not in not_fixed]
    rough = {name: share for name, share in zip(own[1:], remaining[1:], strict=False) if _ROUGH < share <= NOT_FIXED}
    if names[0] in not_fixed:
        low, high = modulus.interval_95
        words = (
            f"{data} fix no parameter of this law: not even the size of its initial shear modulus, "
            f"which may lie anywhere from {low:.4g} to {high:.4g} Pa."
        )
    elif not not_fixed and not rough:
        words = f"{data} fix every parameter of this law, the initial shear modulus to {_percent(modulus)}."
    else:
        firm = [name for name in fixed if name not in rough]
        words = f"{data} fix {'only ' if len(firm) == 1 else ''}{' and '.join(firm)}"
        words += f"; the initial shear modulus is known to {_percent(modulus)}"
        for name, share in rough.items():
            words += f", {name} only to within {100 * _OF_RANGE * share:.0f} % of its range"
        if not_fixed:
            words += f"; they do not fix {', '.join(not_fixed)}, whose intervals are set by the bounds of the search"
        words += "."
    for name, rho in zip(names[law_coordinates:], correlation[0, law_coordinates:], strict=True):
        if abs(rho) > _TOGETHER:
            combination = "ratio" if rho > 0 and name in ratios else "combination"
            words += (
                f" {names[0]} and {name} are correlated by {rho:+.3f}: the data fix their {combination}, "
                f"and what is known of {name} the rest."
            )
    if len(fixed) > 1 and eigen and eigen[0].words not in names:
        words += f" Best known is the combination {eigen[0].words}."
    return words


def _percent(modulus: Quantity) -> str:
    """How far the ends of the interval are from the value: `±0.4 %`, or `-20 % to +35 %` where they differ."""
    below, above = (100 * (end / modulus.value - 1) for end in modulus.interval_95)
    half = 0.5 * (above - below)
    return f"±{half:.2g} %" if abs(above + below) < 0.2 * half else f"{below:+.2g} % to {above:+.2g} %"
