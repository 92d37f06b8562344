"""Describe residuals by coefficients in polynomials along each edge, with the variance of each coefficient."""

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
    """The linear map that replaces residuals by N polynomial coefficients with known variances.

    There are K load cases, G = 2 edges, m points on an edge, and D polynomials.

    Parameters
    ----------
    bases : tuple of ndarray, shape (K, G, m, D)
        Values of the polynomials at the points of each experiment.
    over_states, over_groups : tuple of ndarray, shape (K, K) and (G, G)
        Orthogonal matrices that make errors of different load cases, or edges, uncorrelated.
    noise, error : ndarray, shape (N,)
        Variance in mm^2 of each coefficient due to noise, and due to other errors with a standard deviation of 1 mm.
    """

    bases: tuple[Array, ...]
    over_states: tuple[Array, ...]
    over_groups: tuple[Array, ...]
    noise: Array
    error: Array

    def of(self, residuals: Sequence[Array | None]) -> Array:
        """Return the N polynomial coefficients (mm) that describe the residuals (mm) of all experiments, (..., N)."""
        lead = next(r.shape[:-3] for r in residuals if r is not None)
        parts = []
        for basis, turn, mix, residual in zip(self.bases, self.over_states, self.over_groups, residuals, strict=True):
            if residual is None:
                parts.append(np.zeros((*lead, basis.shape[0] * basis.shape[1] * basis.shape[3])))
                continue
            along = np.einsum("...kgm,kgmd->...kgd", residual, basis)
            parts.append(np.einsum("kl,gh,...kgd->...lhd", turn, mix, along).reshape(*lead, -1))
        return np.concatenate(parts, axis=-1)

    def smooth(self, changes: Array) -> Array:
        """Return the variances (mm^2) of the N coefficients if errors of a known size vary smoothly along the edges.

        changes: coefficients of c changes of the residuals, (c, N). Their root mean square is the size of the errors.
        """
        parts, first = [], 0
        for basis in self.bases:
            here = slice(first, first := first + basis.shape[0] * basis.shape[1] * basis.shape[3])
            # Only the root mean square of a change is used: how it varies along an edge is unknown, but smooth.
            parts.append(self.error[here] * ((changes[:, here] ** 2).sum() / max(float((basis**2).sum()), 1e-9)))
        return np.concatenate(parts)


def projection(experiments: Sequence[Experiment], residuals: Sequence[Array], used: Sequence[Array]) -> Projection:
    """Return the linear map that describes residuals by a few polynomials along each edge.

    Parameters
    ----------
    residuals, used : sequence of ndarray, shape (K, 2, m)
        Residuals in mm at m points of the two edges, and weights that are positive for the points to use.
    """
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
    """Return the values of D orthonormal polynomials at m points on G edges in K load cases, shape (K, G, m, D)."""
    degrees = min(_DEGREES, is_used.shape[-1])
    place = np.cumsum(is_used, axis=-1) / np.maximum(is_used.sum(axis=-1, keepdims=True), 1)
    powers = np.polynomial.legendre.legvander(2 * place - 1, degrees - 1) * is_used[..., None]
    basis, triangle = np.linalg.qr(powers)
    independent = np.abs(np.diagonal(triangle, axis1=-2, axis2=-1)) > 1e-9
    return np.asarray(basis * independent[..., None, :])


def _noise(experiment: Experiment, remainder: Array, is_used: NDArray[np.bool_], counts: NDArray[np.intp]) -> Array:
    """Return the variance in mm^2 due to noise of D polynomial coefficients of each of G edges, (G, D)."""
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
    """Return the assumed correlation of the unexplained error between K load cases, (K, K)."""
    loads = experiment.loads
    strongest = loads.field_T[np.argmax(np.linalg.norm(loads.field_T, axis=1))]
    # The error is similar under similar loads (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63:425).
    signed = strengths(loads) * np.where(loads.field_T @ strongest < 0, -1.0, 1.0)
    apart = (signed[:, None] - signed) / _LOAD_RANGE
    return np.asarray((1 - _OF_ONE_STATE) * np.exp(-0.5 * apart**2) + _OF_ONE_STATE * np.eye(len(signed)))
