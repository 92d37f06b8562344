"""The joint distribution of all that a fit is unsure of, as a cloud of draws; intervals are its quantiles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.interval.profile_likelihood import Ends

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_DRAWN, _KEPT = 4000, 400
_DIGITS = 7
_NORMAL = float(special.ndtri(0.975))


@dataclass(frozen=True)
class Draws:
    """seed: of the random numbers; names: of the law's parameters, then of what else is uncertain, as deviations.

    values: a row a draw, in the units of the parameters and of the sources.
    """

    seed: int
    names: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]

    def column(self, name: str) -> Array:
        """(D,). Raises ValueError for a name that is not there."""
        return np.array(self.values)[:, self.names.index(name)]


def normal_draws(rng: np.random.Generator, n: int) -> Array:
    """(D, n) standard normal numbers, each column stratified (Latin hypercube; McKay, Beckman, Conover 1979)."""
    ranks = rng.permuted(np.tile(np.arange(_DRAWN), (n, 1)), axis=1).T
    return np.asarray(special.ndtri((ranks + 0.5) / _DRAWN))


def draw_noise(
    rng: np.random.Generator, unit: Array, covariance: Array, ends: Ends, left: Array, alone: Array
) -> Array:
    """(D, n): how far noise, priors and what the corrections leave may move the optimum ``unit`` (n,).

    covariance: (n, n) of the noise, profiled coordinates as wide as their ends; left: (C, n) standard deviations of
    errors that move all unknowns along one direction each; alone: (C,) of errors in the first unknown alone.
    """
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = normal_draws(rng, len(unit)) @ root.T
    half_width = _NORMAL * np.sqrt(np.diag(covariance))
    for i in ends.profiled:  # a normal distribution of two halves, each as wide as its end asks
        below, above = (unit[i] - ends.low[i]) / half_width[i], (ends.high[i] - unit[i]) / half_width[i]
        drawn[:, i] *= np.where(drawn[:, i] < 0, below, above)
    for direction, own in zip(left, alone, strict=True):
        together, first = normal_draws(rng, 2).T
        drawn += np.outer(together, direction)
        drawn[:, 0] += first * own
    return drawn


def thinned(modulus: Array) -> Rows:
    """Which of the draws to keep: every so-many-th in the order of the modulus (D,), whose quantiles then stay."""
    every = _DRAWN // _KEPT
    return np.asarray(np.argsort(modulus)[every // 2 :: every])


def draw_parameters(
    names: Sequence[str],
    values: Array,
    intervals: Array,
    correlation: Array,
    modulus: Callable[[Array], Array],
    seed: int = 1,
) -> Draws:
    """Draws of parameters (n,) that are known by 95 % intervals (n, 2) and the correlation (n, n) of their errors.

    Normal with two halves where an interval is not symmetric; modulus: initial shear modulus of parameters (D, n).
    """
    eigenvalues, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
    z = normal_draws(np.random.default_rng(seed), len(values)) @ root.T / _NORMAL
    drawn = values + np.where(z < 0, z * (values - intervals[:, 0]), z * (intervals[:, 1] - values))
    kept = rounded(drawn[thinned(modulus(drawn))])
    return Draws(seed, tuple(names), tuple(map(tuple, kept.tolist())))


def rounded(values: Array) -> Array:
    """Numbers as a file holds them: to seven digits."""
    with np.errstate(divide="ignore"):
        size = np.where(values == 0, 1.0, 10.0 ** (_DIGITS - 1 - np.floor(np.log10(np.abs(values)))))
    return np.asarray(np.round(values * size) / size)


def interval_95(values: Array) -> tuple[float, float]:
    """The 2.5 % and 97.5 % quantiles of draws (D,)."""
    low, high = np.quantile(values, [0.025, 0.975]).tolist()
    return low, high


def quantity(value: float, unit: str, drawn: Array, fit_alone: Array) -> Quantity:
    """A value with the intervals of its draws (D,), those of all that is uncertain and those of the fit alone."""
    return Quantity(float(value), unit, interval_95(drawn), interval_95(fit_alone))
