"""What an identified parameter is worth: intervals, and which combinations the data fix.

Linearised about the optimum: the residuals' Jacobian in the search coordinates, the noise level from the residuals
themselves. Residuals of one edge are correlated along the edge (one frame's blur, light and clamp are common to
neighbours), so the n points of an edge count as n / tau, with tau the integrated autocorrelation length summed up to
its first negative value (initial positive sequence; Geyer 1992, Statist. Sci. 7:473). Tracked points carry their own
stated uncertainty, which is taken as common to the points of one state.

A direction that the data do not fix is held by the bounds of the search, entered as a normal prior with the bounds'
variance; it is named as not fixed. What the mesh leaves in the residuals is carried through to every parameter.
Errors common to the whole experiment (scale, coil constant, moment) are not in these intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from eimi_fitting.materials import Law
from eimi_fitting.observation import EdgeObservation, Observation
from eimi_fitting.polish import difference_batch
from eimi_fitting.search_space import SearchSpace

Array = NDArray[np.float64]

_BOUNDS_VARIANCE = 1.0 / 12.0  # of a uniform distribution over the unit interval
_NOT_FIXED = 0.5  # posterior over prior standard deviation above which the data say little
_DRAWS = 4000


@dataclass(frozen=True)
class Uncertainty:
    """95 % intervals and what the data fix.

    intervals: (n, 2) of the law's parameters; initial_shear_modulus_Pa: (2,); noise_mm: residual standard deviation;
    correlation_points: mean tau; not_fixed: search coordinates that only the bounds hold; statement: one sentence.
    """

    intervals: Array
    initial_shear_modulus_Pa: Array
    noise_mm: float
    correlation_points: float
    not_fixed: tuple[str, ...]
    statement: str


Residuals = Callable[[Array], list[tuple[Array, Array]]]


def correlation_length(residuals: Array, weights: Array) -> float:
    """Integrated autocorrelation length tau >= 1 (in points) of groups (..., n) of residuals, zero where unused."""
    r = residuals.reshape(-1, residuals.shape[-1])
    w = weights.reshape(r.shape)
    variance = (r**2).sum() / max(w.sum(), 1.0)
    if variance == 0.0:
        return 1.0
    tau = 1.0
    for lag in range(1, r.shape[-1]):
        pairs = (w[:, lag:] * w[:, :-lag]).sum()
        if pairs == 0:
            break
        rho = (r[:, lag:] * r[:, :-lag]).sum() / pairs / variance
        if rho <= 0:
            break
        tau += 2 * rho
    return float(tau)


def estimate_uncertainty(
    space: SearchSpace,
    law: Law,
    unit: Array,
    residuals: Residuals,
    observed: Sequence[Observation],
    seed: int,
    mesh_error_mm: Sequence[Array] | None = None,
) -> Uncertainty:
    """Intervals about the optimum ``unit`` (n,) of the search coordinates; one extra batch of 2 n + 1 candidates.

    mesh_error_mm: what the mesh is thought to add to the residuals, (K, G, n) an experiment.
    """
    n = len(unit)
    batch, distance = difference_batch(unit)
    information = np.eye(n) / _BOUNDS_VARIANCE
    pull = np.zeros(n)
    noise2, count, effective, taus = 0.0, 0.0, 0.0, []
    for k, ((all_residuals, weights), seen) in enumerate(zip(residuals(batch), observed, strict=True)):
        r = all_residuals[0]
        slope = (all_residuals[1 : n + 1] - all_residuals[n + 1 :]) / distance[:, None, None, None]
        if isinstance(seen, EdgeObservation):
            tau = correlation_length(r, weights)
            variance = float((r**2).sum() / weights.sum())
            precision = 1 / (tau * max(variance, 1e-12))
            information += precision * np.einsum("ikgn,jkgn->ij", slope, slope)
            if mesh_error_mm is not None:
                pull += precision * np.einsum("ikgn,kgn->i", slope, mesh_error_mm[k])
            effective += weights.sum() / tau
            taus.append(tau)
        else:
            # The error is common to the points of a state: their mean counts once.
            share = weights / np.maximum(weights.sum(axis=-1, keepdims=True), 1.0)
            mean = np.einsum("ikgn,kgn->ikg", slope, share)
            sigma = np.where(np.isfinite(seen.sigma_mm), seen.sigma_mm, 0.0)
            common = np.sqrt((share * sigma[:, None] ** 2).sum(axis=-1))
            information += np.einsum("ikg,jkg,kg->ij", mean, mean, 1 / np.maximum(common, 1e-9) ** 2)
        noise2 += float((r**2).sum())
        count += float(weights.sum())
    covariance = np.linalg.inv(information)
    # A systematic error of the residuals moves the optimum along one direction, by no more than this.
    drift = covariance @ pull
    covariance += np.outer(drift, drift)
    # Higher coefficients can take that error upon themselves; the modulus is trusted no more than with them held.
    alone = pull[0] / information[0, 0]
    covariance[0, 0] += max(alone**2 - drift[0] ** 2, 0.0)
    spread = np.sqrt(np.diag(covariance))
    # Student's t where the noise level was estimated from the residuals themselves.
    widen = stats.t.ppf(0.975, max(effective - n, 1.0)) / stats.norm.ppf(0.975) if taus else 1.0
    rng = np.random.default_rng(seed)
    draws = unit + widen * rng.multivariate_normal(np.zeros(n), covariance, size=_DRAWS, method="eigh")
    parameters = space.parameters(np.clip(draws, 0.0, 1.0))
    intervals = np.quantile(parameters, [0.025, 0.975], axis=0).T
    modulus = np.quantile(law.initial_shear_modulus(parameters), [0.025, 0.975])
    not_fixed = tuple(
        name for name, s in zip(space.names, spread / np.sqrt(_BOUNDS_VARIANCE), strict=True) if s > _NOT_FIXED
    )
    return Uncertainty(
        intervals,
        modulus,
        float(np.sqrt(noise2 / max(count, 1.0))),
        float(np.mean(taus)) if taus else 1.0,
        not_fixed,
        _statement(space, not_fixed),
    )


def _statement(space: SearchSpace, not_fixed: tuple[str, ...]) -> str:
    if not not_fixed:
        return "These data fix every parameter of this law."
    if space.names[0] in not_fixed:
        return "These data fix no parameter of this law, not even its initial shear modulus."
    fixed = [name for name in space.names if name not in not_fixed]
    return (
        f"These data fix {' and '.join(fixed)}; they do not fix {', '.join(not_fixed)}, "
        "whose intervals are set by the bounds of the search."
    )
