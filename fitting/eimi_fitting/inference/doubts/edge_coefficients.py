"""Describe residuals by coefficients in orthonormal polynomials along each edge, with the variance of each coefficient.

Errors of a test bench, such as a wrong scale, change the residuals smoothly along an edge. A few coefficients describe
such changes completely. The rest of the residuals, which is not smooth, gives the size and the correlation of the
noise.
"""

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
    """The linear map from residuals to N coefficients of polynomials along each edge, with their variances.

    In the shapes, K is the number of states (loads), G = 2 the number of edges (or the coordinates x and y of tracked
    points), m the number of points on an edge, and D the number of polynomials.

    Parameters
    ----------
    bases : tuple of ndarray, shape (K, G, m, D)
        For each experiment, the values of the orthonormal polynomials at the points; zero for a point that is not used.
    over_states, over_groups : tuple of ndarray, shape (K, K) and (G, G)
        For each experiment, two orthogonal matrices. They combine the coefficients of different states
        (``over_states``) and of different edges (``over_groups``) linearly, so that the combinations are not
        correlated.
    noise, error : ndarray, shape (N,)
        Variance of each coefficient in mm^2: due to noise (``noise``), and due to an unknown smooth error of the size 1
        mm (``error``).
    """

    bases: tuple[Array, ...]
    over_states: tuple[Array, ...]
    over_groups: tuple[Array, ...]
    noise: Array
    error: Array

    def of(self, residuals: Sequence[Array | None]) -> Array:
        """Return the N polynomial coefficients in mm that describe the residuals along each edge, shape (..., N).

        There is one array of residuals in mm for each experiment; None stands for zero.
        """
        lead = next(r.shape[:-3] for r in residuals if r is not None)
        parts = []
        for basis, turn, mix, residual in zip(self.bases, self.over_states, self.over_groups, residuals, strict=True):
            if residual is None:
                parts.append(np.zeros((*lead, basis.shape[0] * basis.shape[1] * basis.shape[3])))
                continue
            along = np.einsum("...kgm,kgmd->...kgd", residual, basis)
            parts.append(np.einsum("kl,gh,...kgd->...lhd", turn, mix, along).reshape(*lead, -1))
        return np.concatenate(parts, axis=-1)

    def smooth(self, moves: Array) -> Array:
        """Return the variances of N polynomial coefficients in mm^2 due to smooth errors of the simulation, (N,).

        Each row of ``moves`` has the changes of the coefficients in mm by one of the errors. Only the root mean square
        of the changes is used.
        """
        parts, first = [], 0
        for basis in self.bases:
            here = slice(first, first := first + basis.shape[0] * basis.shape[1] * basis.shape[3])
            # Only the root mean square of a change is used: how it varies along an edge is unknown, but smooth.
            parts.append(self.error[here] * ((moves[:, here] ** 2).sum() / max(float((basis**2).sum()), 1e-9)))
        return np.concatenate(parts)


def projection(experiments: Sequence[Experiment], residuals: Sequence[Array], used: Sequence[Array]) -> Projection:
    """Return the linear map that describes residuals by a few polynomials along each edge.

    Parameters
    ----------
    experiments : sequence of Experiment
        The experiments.
    residuals, used : sequence of ndarray, shape (K, G, m)
        For each experiment, residuals in mm, and weights that are positive for the points to use: K loads, G = 2 edges
        (or the coordinates x and y of tracked points), m points.

    Returns
    -------
    Projection
        The map, with the variances of the polynomial coefficients.
    """
    bases, turns, mixes, noises, errors = [], [], [], [], []
    for experiment, residual, weights in zip(experiments, residuals, used, strict=True):
        is_used = weights > 0
        basis = _polynomials(is_used)
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
    """Return the values of D orthonormal polynomials along each edge at its m measured points, shape (K, G, m, D).

    There are G edges in K states.
    """
    degrees = min(_DEGREES, is_used.shape[-1])
    place = np.cumsum(is_used, axis=-1) / np.maximum(is_used.sum(axis=-1, keepdims=True), 1)
    powers = np.polynomial.legendre.legvander(2 * place - 1, degrees - 1) * is_used[..., None]
    basis, triangle = np.linalg.qr(powers)
    independent = np.abs(np.diagonal(triangle, axis1=-2, axis2=-1)) > 1e-9
    return np.asarray(basis * independent[..., None, :])


def _noise(experiment: Experiment, remainder: Array, is_used: NDArray[np.bool_], counts: NDArray[np.intp]) -> Array:
    """Return the variance due to noise of the polynomial coefficients that describe the residuals, in mm^2, (G, D).

    There are D polynomials along each of G edges.
    """
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
    """Return the assumed correlation of the unexplained error between K states, (K, K); it is high for similar loads.

    The unexplained error is the part of the residuals that no listed error of the test bench explains.
    """
    loads = experiment.loads
    strongest = loads.field_T[np.argmax(np.linalg.norm(loads.field_T, axis=1))]
    signed = strengths(loads) * np.where(loads.field_T @ strongest < 0, -1.0, 1.0)
    apart = (signed[:, None] - signed) / _LOAD_RANGE
    return np.asarray((1 - _OF_ONE_STATE) * np.exp(-0.5 * apart**2) + _OF_ONE_STATE * np.eye(len(signed)))
