"""Find the combinations of the unknowns of a fit that the data determine, and describe them in words."""

# The combinations are the eigenvectors of P^(-1/2) A P^(-1/2), with the information A of the data
# (`inference.interval.covariance`) and the diagonal inverse variance P of the priors. The fit reduces the standard
# deviation of a combination to its prior value times 1 / sqrt(1 + v), where v is its eigenvalue.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.quantity import Quantity

Array = NDArray[np.float64]

NOT_FIXED = 0.5  # an unknown is not fixed if more than this share of its prior standard deviation remains
_ROUGH = 0.25  # it is fixed only roughly if more than this share remains
_OF_RANGE = 2 * 1.96 / 12**0.5  # width of the 95 % interval over the range, for the prior standard deviation
_OPEN_FACTOR = 4.0  # a modulus is open if the upper end of its interval exceeds this many times the lower end
_NAMED = 0.1  # a direction is named after the coordinates with at least this share of its squared length
_CORRELATED = 0.9  # two unknowns are described as one combination above this correlation


@dataclass(frozen=True)
class Direction:
    """A combination of unknowns whose error is independent of the errors of the other combinations."""

    # Description such as "a with b against c": a and b increase together while c decreases.
    words: str
    # Standard deviation after the fit, divided by the standard deviation of the prior.
    remaining: float


@dataclass(frozen=True)
class Identifiability:
    """Which unknowns of a fit the data determine, and which they do not determine."""

    # A summary in a few sentences.
    statement: str
    # Names of the law's unknowns that the data do not determine.
    not_fixed: tuple[str, ...]
    # Names of the parameters whose interval is mainly determined by the bounds of the search.
    held_by_bounds: tuple[str, ...]
    # Names of the law's unknowns with a fitted value on a bound of the search.
    at_bound: tuple[str, ...]
    # Root mean square of all residuals.
    residual_mm: float
    # How many neighbouring points count as one independent point, on average.
    correlation_points: float
    # Number of measured points, and number of independent points, from the correlation of all residuals.
    points: int
    independent_points: float
    # Names of all unknowns, and the correlation matrix of their errors.
    names: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    # The best determined combination comes first.
    directions: tuple[Direction, ...]
    # Names of the unknowns whose interval is computed from the profile likelihood.
    profiled: tuple[str, ...]
    # Mean over the load cases of the root mean square noise.
    noise_mm: float | None = None
    # Number of independent points, from the correlation of the noise.
    noise_points: float | None = None
    # Sum of the squares of the estimated errors of the uncertain inputs, each divided by its standard uncertainty.
    stated_squares: float = 0.0
    # Mean standard deviation of the error of the beam model.
    model_mm: float = 0.0


def is_open(modulus: Quantity) -> bool:
    """Return whether the interval of the modulus is very wide: upper end > 4 times lower end, or an end <= 0."""
    low, high = modulus.interval_95
    return not 0 < high <= _OPEN_FACTOR * low


def held_by_bounds(slopes: Array, covariance: Array, open_coordinates: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which parameters of a law are limited mainly by the bounds of the search."""
    # There are m parameters and n unknowns. slopes (m, n): derivatives of the parameters in the unknowns. covariance
    # (n, n). open_coordinates (n,): true for unknowns that the data do not determine.
    variance = np.einsum("mi,ij,mj->m", slopes, covariance, slopes)
    # the variance from unknowns that the data do not determine
    from_bounds = slopes[:, open_coordinates] ** 2 @ np.diag(covariance)[open_coordinates]
    return np.asarray(from_bounds > 0.5 * variance)


def directions(names: Sequence[str], information: Array, prior: Array) -> tuple[Direction, ...]:
    """Return the combinations of unknowns with independent errors, the best determined first."""
    # eigenvectors of P^(-1/2) A P^(-1/2), with the information A and the prior P
    scale = 1 / np.sqrt(np.diag(prior))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    return tuple(
        Direction(_words(names, vector), float(1 / np.sqrt(1 + max(value, 0.0))))
        for value, vector in zip(values[::-1], vectors.T[::-1], strict=True)
    )


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
    """Say in a few sentences which unknowns of a fit the data determine."""
    # names: all n unknowns; the first `law_coordinates` belong to the law. not_fixed: names of the law's unknowns that
    # the data do not determine. ratios: names of fitted inputs that multiply the magnetic load. remaining: for each
    # unknown, its standard deviation after the fit, divided by that of its prior. priors: whether there are priors on
    # the law's parameters.
    law_names = names[:law_coordinates]
    data = "These data" if len(law_names) == len(names) and not priors else "These data and the given priors"
    fixed = [name for name in law_names if name not in not_fixed]
    rough = {
        name: share for name, share in zip(law_names[1:], remaining[1:], strict=False) if _ROUGH < share <= NOT_FIXED
    }
    if names[0] in not_fixed:
        low, high = modulus.interval_95
        words = (
            f"{data} determine no parameter of this law, not even its initial shear modulus, which may lie anywhere "
            f"from {low:.4g} to {high:.4g} Pa."
        )
    elif not not_fixed and not rough:
        words = (
            f"{data} determine every parameter of this law; the 95 % interval of the initial shear modulus is "
            f"{_percent(modulus)}."
        )
    else:
        firm = [name for name in fixed if name not in rough]
        words = f"{data} determine {'only ' if len(firm) == 1 else ''}{' and '.join(firm)}"
        words += f"; the 95 % interval of the initial shear modulus is {_percent(modulus)}"
        for name, share in rough.items():
            words += f", and {name} is known only to within {100 * _OF_RANGE * share:.0f} % of the range of the search"
        if not_fixed:
            words += (
                f"; they do not determine {', '.join(not_fixed)}, whose intervals are set by the bounds of the search"
            )
        words += "."
    for name, rho in zip(names[law_coordinates:], correlation[0, law_coordinates:], strict=True):
        if abs(rho) > _CORRELATED:
            combination = "ratio" if rho > 0 and name in ratios else "combination"
            words += (
                f" {names[0]} and {name} are correlated by {rho:+.3f}: the data determine their {combination} only, "
                f"and the prior on {name} determines the rest."
            )
    if len(fixed) > 1 and eigen and eigen[0].words not in names:
        words += f" The best determined combination is {eigen[0].words}."
    return words


def _percent(modulus: Quantity) -> str:
    # The interval relative to the value, as "±0.4 %" or "-20 % to +35 %".
    below, above = (100 * (end / modulus.value - 1) for end in modulus.interval_95)
    half = 0.5 * (above - below)
    return f"±{half:.2g} %" if abs(above + below) < 0.2 * half else f"{below:+.2g} % to {above:+.2g} %"
