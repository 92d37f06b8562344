"""Describe residuals by coefficients in orthonormal polynomials along each edge, with the variance of each coefficient.

Possible errors of the bench change the residuals smoothly along an edge (`inference.doubts.causes`). A few coefficients
describe such changes completely. The rest of the residuals, which is not smooth, gives the size and the correlation of
the noise.

A smooth part of the residuals may be unexplained: neither noise nor the effect of a listed error. It is similar on
both edges and in states with similar loads, so that its coefficients are correlated. The coefficients are therefore
replaced by linear combinations that are not correlated, such as the sum and the difference of the two edges.
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
    """The linear map from residuals to N coefficients of polynomials, with the variances of the coefficients.

    A part of the residuals is neither noise nor the effect of a listed cause (a possible error of the bench). It is
    called the unexplained part.

    Parameters
    ----------
    bases : tuple of ndarray, shape (K, G, m, D)
        For each experiment, the values of D orthonormal polynomials at m points in G groups (edges) and K states; zero
        for a point that is not used.
    over_states, over_groups : tuple of ndarray, shape (K, K) and (G, G)
        For each experiment, two orthogonal matrices that combine the coefficients of different states (``over_states``)
        and of different groups (``over_groups``). The unexplained part is similar in states with similar loads and on
        both edges, so that its coefficients are correlated. The combinations are not correlated.
    noise, error : ndarray, shape (N,)
        Variance of each coefficient in mm^2: due to noise (``noise``), and due to an unexplained part of the size 1 mm
        (``error``).
    """

    bases: tuple[Array, ...]
    over_states: tuple[Array, ...]
    over_groups: tuple[Array, ...]
    noise: Array
    error: Array

    def of(self, residuals: Sequence[Array | None]) -> Array:
        """Return the N polynomial coefficients in mm that describe the residuals along each edge, shape (..., N).

        Residuals have the shape (..., K, G, m) for G groups (edges, or x and y) of m points in K states. None stands
        for residuals of zero.
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
        """Return the variances of N polynomial coefficients due to C smooth errors of the simulation, in mm^2, (N,).

        The coefficients describe the residuals by polynomials along each edge. Row c of ``moves`` (C, N) has the
        changes of the coefficients by error c in mm. Only the size of the error, the root mean square in each
        experiment, is used: how it varies along an edge is assumed unknown, but smooth. ``error`` has the variances by
        a smooth error of 1 mm. It is multiplied by the square of the size, and the variances of all errors are added.
        """
        parts, first = [], 0
        for basis in self.bases:
            here = slice(first, first := first + basis.shape[0] * basis.shape[1] * basis.shape[3])
            parts.append(self.error[here] * ((moves[:, here] ** 2).sum() / max(float((basis**2).sum()), 1e-9)))
        return np.concatenate(parts)


def projection(experiments: Sequence[Experiment], residuals: Sequence[Array], used: Sequence[Array]) -> Projection:
    """Return the linear map that describes residuals by a few polynomials along each edge.

    The result also contains two variances of each coefficient of these polynomials, with which the fit of a possible
    error of the bench to the residuals is judged. The first is the variance by noise. The second is the variance by an
    unexplained error of 1 mm, which is neither noise nor a listed error of the bench.

    Parameters
    ----------
    experiments : sequence of Experiment
        The experiments.
    residuals, used : sequence of ndarray, shape (K, G, m)
        For each experiment, residuals at the optimum in mm, and weights that are positive for the points that are
        compared; points near the ends of an edge are not compared. There are G groups (edges, or x and y) of m points
        in K states.

    Returns
    -------
    Projection
        The map and the variances.
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
    """Return polynomials that describe residuals along each edge: their values at the points, (K, G, m, D).

    There are K states, G edges and m points on each edge. The D polynomials of an edge are orthonormal: their products
    have the sum 0 or 1 over the used points. ``is_used`` (K, G, m) is True for these points.
    """
    degrees = min(_DEGREES, is_used.shape[-1])
    place = np.cumsum(is_used, axis=-1) / np.maximum(is_used.sum(axis=-1, keepdims=True), 1)
    powers = np.polynomial.legendre.legvander(2 * place - 1, degrees - 1) * is_used[..., None]
    basis, triangle = np.linalg.qr(powers)
    independent = np.abs(np.diagonal(triangle, axis1=-2, axis2=-1)) > 1e-9
    return np.asarray(basis * independent[..., None, :])


def _noise(experiment: Experiment, remainder: Array, is_used: NDArray[np.bool_], counts: NDArray[np.intp]) -> Array:
    """Return the variance of the polynomial coefficients due to noise, in mm^2, (G, D).

    D polynomials describe the residuals along each of G edges. ``remainder`` is the part of the residuals that the
    polynomials do not describe. It gives the level and the correlation of the noise. The stated uncertainty of the
    points is used instead for tracked points, and if the remainder has fewer than ten degrees of freedom. All tracked
    points of a state are assumed to have the same error, which increases the variance of the constant polynomial.
    ``counts`` has the number of used points of each edge in each state.
    """
    degrees = min(_DEGREES, is_used.shape[-1])
    free = int(np.maximum(counts - degrees, 0).sum())
    sigma = experiment.observed.sigma_mm
    stated = np.sqrt(np.mean(sigma[np.isfinite(sigma)] ** 2)) if np.isfinite(sigma).any() else 1.0
    variance = np.full((is_used.shape[1], degrees), stated**2)
    if not isinstance(experiment.observed, EdgeObservation):
        variance[:, 0] *= max(float(counts.mean()), 1.0)
    elif free >= _FEWEST:
        variance[:] = (remainder**2).sum() / free * correlation_length(remainder, is_used.astype(float))
    return np.maximum(variance, 1e-18)


def _over_loads(experiment: Experiment) -> Array:
    """Return how the unexplained residuals of K states are correlated with each other: a correlation matrix (K, K).

    These residuals are neither noise nor the effect of a possible error of the bench. They are assumed to be similar in
    two states with similar loads.
    """
    loads = experiment.loads
    strongest = loads.field_T[np.argmax(np.linalg.norm(loads.field_T, axis=1))]
    signed = strengths(loads) * np.where(loads.field_T @ strongest < 0, -1.0, 1.0)
    apart = (signed[:, None] - signed) / _LOAD_RANGE
    return np.asarray((1 - _OF_ONE_STATE) * np.exp(-0.5 * apart**2) + _OF_ONE_STATE * np.eye(len(signed)))
