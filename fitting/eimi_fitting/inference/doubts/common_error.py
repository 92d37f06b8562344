"""Estimate an error that all states of a dataset share: a displaced clamp, a rolled camera or a wrong scale.

About the optimum the residuals r are linear in the steps u of the unknowns and in the sizes c of the common error. The
least-squares problem

    minimise |r + J u + C c|^2 + s^2 u' P u

is solved for u and c together. J and C are the slopes of the residuals, P the precisions of the priors, and s^2 the
variance of the residuals. c has no prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.model import Shapes
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_fitting.inference.evidence.unknowns import Setup, Unknowns

CommonKind = Literal["clamp", "roll", "scale"]
Array = NDArray[np.float64]

_STEP = 1e-3  # mm of a shift; radians of a roll; relative change of the scale
# A common error moves a measured place x, to first order, by (A x + b) times its size. Each row holds A and b.
_NONE, _QUARTER_TURN = np.zeros((2, 2)), np.array([[0.0, -1.0], [1.0, 0.0]])
_KINDS: dict[CommonKind, tuple[tuple[Array, Array], ...]] = {
    "clamp": ((_NONE, np.array([1.0, 0.0])), (_NONE, np.array([0.0, 1.0]))),
    "roll": ((_QUARTER_TURN, np.zeros(2)),),
    "scale": ((np.eye(2), np.zeros(2)),),
}


@dataclass(frozen=True)
class CommonError:
    """The common error of a dataset that explains most of its residuals.

    Attributes
    ----------
    kind : {"clamp", "roll", "scale", ""}
        The kind of error; empty if none reduces the residuals.
    sizes : ndarray
        Shift of the clamp in x and y (mm), roll (rad) or relative change of the scale.
    error_mm : ndarray, shape (K,)
        Root mean square residual of each state once the common error is removed.
    """

    kind: CommonKind | Literal[""]
    sizes: Array
    error_mm: Array


def common_errors(
    optimum_shapes: Sequence[Shapes],
    misfits: Sequence[Misfit],
    distance: Array,
    experiments: Sequence[Experiment],
    unknowns: Unknowns,
) -> tuple[CommonError, ...]:
    """Return the common error of each experiment, among the kinds that the fit has not freed.

    Parameters
    ----------
    optimum_shapes : sequence of Shapes
        For each experiment, shapes whose first candidate is the optimum.
    misfits : sequence of Misfit
        The residuals at the optimum and at its neighbours, from `polish.difference_batch`.
    distance : ndarray, shape (n,)
        The distances between the neighbours, from `polish.difference_batch`.
    experiments : sequence of Experiment
        The experiments.
    unknowns : Unknowns
        The unknowns of the fit.
    """
    freed = {nuisance.source for nuisance in unknowns.freed}
    kinds = [kind for kind in _KINDS if kind not in freed]
    largest = []
    for experiment, shapes, misfit in zip(experiments, optimum_shapes, misfits, strict=True):
        candidates = [_fit_common_error(kind, experiment, shapes, misfit, distance, unknowns.prior) for kind in kinds]
        nothing = CommonError("", np.zeros(0), misfit.error_mm[0])
        largest.append(min((nothing, *candidates), key=lambda candidate: float(candidate.error_mm.mean())))
    return tuple(largest)


def _fit_common_error(
    kind: CommonKind, experiment: Experiment, shapes: Shapes, misfit: Misfit, distance: Array, prior: Array
) -> CommonError:
    """Solve the least-squares problem of the module for one kind of error."""
    n = len(distance)
    residuals = misfit.residuals[0]
    by_unknown = (misfit.residuals[1 : n + 1] - misfit.residuals[n + 1 :]) / distance[:, None, None, None]
    slopes = np.concatenate([by_unknown, _slopes(kind, experiment, shapes)]).reshape(-1, residuals.size)
    variance = max(float((residuals**2).sum() / max(misfit.weights.sum(), 1.0)), np.finfo(float).tiny)
    held = np.zeros(len(slopes))
    held[:n] = prior * variance
    step = np.linalg.lstsq(slopes @ slopes.T + np.diag(held), -slopes @ residuals.ravel(), rcond=None)[0]
    remaining = (residuals.ravel() + step @ slopes).reshape(residuals.shape)
    count = np.maximum(misfit.weights.sum(axis=(1, 2)), 1.0)
    return CommonError(kind, step[n:], np.sqrt((remaining**2).sum(axis=(1, 2)) / count))


def _slopes(kind: CommonKind, experiment: Experiment, shapes: Shapes) -> Array:
    """Return (parts, K, G, m) the slopes of the residuals in each component of a common error."""
    parts = _KINDS[kind]
    steps = [(sign * turn, sign * shift) for turn, shift in parts for sign in (_STEP, -_STEP)]
    setup = Setup(
        np.ones(len(steps)),
        np.stack([np.eye(2) + turn for turn, _ in steps]),
        np.stack([shift for _, shift in steps]),
    )
    same = shapes.take(np.zeros(len(steps), np.intp))  # the same candidate for every step
    residuals = experiment.observed.misfit(experiment.model, same, setup).residuals
    return np.asarray(residuals[0::2] - residuals[1::2]) / (2 * _STEP)
