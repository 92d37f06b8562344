"""Draw the parameters of a fitted law and the errors of uncertain inputs at random."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.quantity import NORMAL_95, Quantity
from eimi_fitting.inference.interval.profile_likelihood import Ends

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_DRAWN, _KEPT = 4000, 400
_DIGITS = 7


@dataclass(frozen=True)
class Draws:
    """Random draws of the parameters of a fitted law and of the errors of uncertain inputs, such as the width."""

    seed: int
    # Names of the parameters, then of the inputs.
    names: tuple[str, ...]
    # For each draw, the parameters, then the errors of the inputs.
    values: tuple[tuple[float, ...], ...]

    def column(self, name: str) -> Array:
        """Return all draws of one parameter or input."""
        return np.array(self.values)[:, self.names.index(name)]


def normal_draws(rng: np.random.Generator, n: int) -> Array:
    """Return 4000 draws of n independent variables with a standard normal distribution."""
    # Latin hypercube: each of D equally probable ranges of a number contains one draw (McKay, Beckman and Conover 1979,
    # Technometrics 21:239).
    ranks = rng.permuted(np.tile(np.arange(_DRAWN), (n, 1)), axis=1).T
    return np.asarray(scipy.special.ndtri((ranks + 0.5) / _DRAWN))


def draw_noise(
    rng: np.random.Generator, unit: Array, covariance: Array, ends: Ends, model_errors: Array, modulus_errors: Array
) -> Array:
    """Draw errors of the fitted values at random, due to noise, priors and errors of the beam models."""
    # There are n unknowns, scaled to 0..1 between their bounds, C errors of the beam models, and D draws. unit (n,):
    # fitted values. covariance (n, n): due to noise and priors. model_errors (C, n): change of the unknowns by one
    # standard deviation of each error. modulus_errors (C,): standard deviation of a further change of the modulus (the
    # first unknown), which accounts for other unknowns that compensate for a part of the error. The result has the
    # shape (D, n).
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = normal_draws(rng, len(unit)) @ root.T
    half_width = NORMAL_95 * np.sqrt(np.diag(covariance))
    for i in ends.profiled:  # two half-normal distributions, each scaled to its end
        below, above = (unit[i] - ends.low[i]) / half_width[i], (ends.high[i] - unit[i]) / half_width[i]
        drawn[:, i] *= np.where(drawn[:, i] < 0, below, above)
    for direction, deviation in zip(model_errors, modulus_errors, strict=True):
        common, first = normal_draws(rng, 2).T
        drawn += np.outer(common, direction)
        drawn[:, 0] += first * deviation
    return drawn


def thinned(modulus: Array) -> Rows:
    """Sort 4000 draws by their modulus, and return the indices of every tenth of them."""
    stride = _DRAWN // _KEPT
    # Only these 400 draws are stored. The quantiles of the modulus hardly change by the selection.
    return np.asarray(np.argsort(modulus)[stride // 2 :: stride])


def draw_parameters(
    names: Sequence[str],
    values: Array,
    intervals: Array,
    correlation: Array,
    modulus: Callable[[Array], Array],
    seed: int = 1,
) -> Draws:
    """Draw the parameters of a law at random, from their 95 % intervals and the correlation of their errors."""
    # There are n parameters. values (n,): fitted values. intervals (n, 2): lower and upper ends. correlation (n, n).
    # modulus: converts sets of parameters (D, n) to initial shear moduli (D,).
    eigenvalues, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
    z = normal_draws(np.random.default_rng(seed), len(values)) @ root.T / NORMAL_95
    # An asymmetric interval gives two half-normal distributions.
    drawn = values + np.where(z < 0, z * (values - intervals[:, 0]), z * (intervals[:, 1] - values))
    kept = rounded(drawn[thinned(modulus(drawn))])
    return Draws(seed, tuple(names), tuple(map(tuple, kept.tolist())))


def rounded(values: Array) -> Array:
    """Round the numbers to seven significant digits."""
    with np.errstate(divide="ignore"):
        size = np.where(values == 0, 1.0, 10.0 ** (_DIGITS - 1 - np.floor(np.log10(np.abs(values)))))
    return np.asarray(np.round(values * size) / size)


def interval_95(values: Array) -> tuple[float, float]:
    """Return the 2.5 % quantile and the 97.5 % quantile of random draws."""
    low, high = np.quantile(values, [0.025, 0.975]).tolist()
    return low, high


def quantity(value: float, unit: str, drawn: Array, fit_alone: Array) -> Quantity:
    """Return a value with two 95 % intervals, from draws with and without (``fit_alone``) errors of inputs."""
    # `fit_alone` are draws without errors of the inputs, for a second interval.
    return Quantity(float(value), unit, interval_95(drawn), interval_95(fit_alone))
