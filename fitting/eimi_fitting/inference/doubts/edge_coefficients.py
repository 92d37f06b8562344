"""Describe residuals by coefficients of polynomials along each edge, with the variance of each coefficient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.correlation import correlation_length
from eimi_fitting.inference.doubts.causes_in_loads import strengths
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation

Array = NDArray[np.float64]

_DEGREES = 8  # number of polynomials along an edge
_LOAD_RANGE = 0.5  # correlation length of d over the loads, as a share of the largest load
_SIDES = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2)  # a shift of the beam, and a change of its width
_APART = 0.2  # variance of an error of the width; the variances of shift and width add up to 2
_OF_ONE_STATE = 0.1  # share of the variance of d that is not common to neighbouring loads
_FEWEST = 10  # points of the remainder from which the noise is estimated


@dataclass(frozen=True)
class Projection:
    """A linear map from residuals to polynomial coefficients along each edge."""

    # There are K load cases, 2 edges, m points on an edge, D polynomials, and N coefficients in all.

    # (K, 2, m, D) for each experiment: values of the polynomials at the points.
    bases: tuple[Array, ...]
    # (K, K): orthogonal matrix that makes errors of different load cases uncorrelated.
    over_states: tuple[Array, ...]
    # (2, 2): the same for the edges.
    over_groups: tuple[Array, ...]
    # (N,): variance of each coefficient in mm^2, due to noise.
    noise: Array
    # (N,): the same, due to other errors with a standard deviation of 1 mm.
    error: Array

    def of(self, residuals: Sequence[Array | None]) -> Array:
        """Return the polynomial coefficients (mm) of the residuals (mm)."""
        lead = next(r.shape[:-3] for r in residuals if r is not None)
        parts = []
        for basis, turn, mix, residual in zip(self.bases, self.over_states, self.over_groups, residuals, strict=True):
            if residual is None:
                parts.append(np.zeros((*lead, basis.shape[0] * basis.shape[1] * basis.shape[3])))
                continue
            along = np.einsum("...kgm,kgmd->...kgd", residual, basis)
            parts.append(np.einsum("kl,gh,...kgd->...lhd", turn, mix, along).reshape(*lead, -1))
        return np.concatenate(parts, axis=-1)

    def smooth(self, errors: Array) -> Array:
        """Return the variance (mm^2) of each coefficient of a smooth random error with the mean square of `errors`."""
        # errors (c, N): the coefficients of c errors in mm.
        parts, first = [], 0
        for basis in self.bases:
            here = slice(first, first := first + basis.shape[0] * basis.shape[1] * basis.shape[3])
            # Only the root mean square of an error is used: how it varies along an edge is unknown, but smooth.
            parts.append(self.error[here] * ((errors[:, here] ** 2).sum() / max(float((basis**2).sum()), 1e-9)))
        return np.concatenate(parts)


def projection(experiments: Sequence[Experiment], residuals: Sequence[Array], used: Sequence[Array]) -> Projection:
    """Return the linear map from residuals to polynomial coefficients along each edge."""
    # (K, 2, m) for each experiment: residuals in mm, and weights that are positive for the points to use.
    bases, turns, mixes, noises, errors = [], [], [], [], []
    for experiment, residual, weights in zip(experiments, residuals, used, strict=True):
        is_used = weights > 0
        basis = _polynomials(is_used)
        # The causes change the residuals smoothly along an edge. The remainder is noise.
        remainder = residual - np.einsum("kgd,kgmd->kgm", np.einsum("kgm,kgmd->kgd", residual, basis), basis)
        counts = is_used.sum(axis=-1)
        noise = _noise(experiment, remainder * is_used, is_used, counts)
        values, turn = np.linalg.eigh(_over_loads(experiment))
        by_degree = 1.0 / np.maximum(np.arange(basis.shape[-1]), 1) ** 4
        is_edges = isinstance(experiment.observed, EdgeObservation)
        mix, of_groups = (_SIDES, np.array([2 - _APART, _APART])) if is_edges else (np.eye(2), np.ones(2))
        errors.append((counts.mean() * values[:, None, None] * of_groups[:, None] * by_degree).ravel())
        mixes.append(mix)
        noises.append(np.broadcast_to(noise, (len(values), *noise.shape)).ravel())
        bases.append(basis)
        turns.append(turn)
    return Projection(tuple(bases), tuple(turns), tuple(mixes), np.concatenate(noises), np.concatenate(errors))


def _polynomials(is_used: NDArray[np.bool_]) -> Array:
    # (K, 2, m, D): orthonormal along each edge.
    degrees = min(_DEGREES, is_used.shape[-1])
    place = np.cumsum(is_used, axis=-1) / np.maximum(is_used.sum(axis=-1, keepdims=True), 1)
    powers = np.polynomial.legendre.legvander(2 * place - 1, degrees - 1) * is_used[..., None]
    basis, triangle = np.linalg.qr(powers)
    independent = np.abs(np.diagonal(triangle, axis1=-2, axis2=-1)) > 1e-9
    return np.asarray(basis * independent[..., None, :])


def _noise(experiment: Experiment, remainder: Array, is_used: NDArray[np.bool_], counts: NDArray[np.intp]) -> Array:
    # (2, D): variance in mm^2 of the coefficients of each edge.
    degrees = min(_DEGREES, is_used.shape[-1])
    free = int(np.maximum(counts - degrees, 0).sum())
    sigma = experiment.observed.sigma_mm
    stated = np.sqrt(np.mean(sigma[np.isfinite(sigma)] ** 2)) if np.isfinite(sigma).any() else 1.0
    variance = np.full((is_used.shape[1], degrees), stated**2)
    if not isinstance(experiment.observed, EdgeObservation):
        # All tracked points of a state are assumed to have the same error.
        variance[:, 0] *= max(float(counts.mean()), 1.0)
    elif free >= _FEWEST:
        variance[:] = (remainder**2).sum() / free * correlation_length(remainder, is_used.astype(float))
    return np.maximum(variance, 1e-18)


def _over_loads(experiment: Experiment) -> Array:
    # (K, K): the assumed correlation of the unexplained error between load cases.
    loads = experiment.loads
    strongest = loads.field_T[np.argmax(np.linalg.norm(loads.field_T, axis=1))]
    # The error is similar under similar loads (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63:425).
    signed = strengths(loads) * np.where(loads.field_T @ strongest < 0, -1.0, 1.0)
    apart = (signed[:, None] - signed) / _LOAD_RANGE
    return np.asarray((1 - _OF_ONE_STATE) * np.exp(-0.5 * apart**2) + _OF_ONE_STATE * np.eye(len(signed)))
