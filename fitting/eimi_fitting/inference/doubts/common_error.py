"""What all states of a dataset are off alike: a clamp that is elsewhere, a rolled camera, a scale that is wrong.

What the fit left is explained, as far as it can be, by moves of the unknowns and of one of these together, in least
squares about the optimum. The unknowns are held by their priors; the clamp, the roll or the scale by nothing.
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

_STEP = 1e-3  # mm, or of a place's distance from the clamp
# What the camera does to a place, to first order: its change (2, 2) with the place and its shift (2,), per mm or per 1.
_NONE, _QUARTER_TURN = np.zeros((2, 2)), np.array([[0.0, -1.0], [1.0, 0.0]])
_KINDS: dict[CommonKind, tuple[tuple[Array, Array], ...]] = {
    "clamp": ((_NONE, np.array([1.0, 0.0])), (_NONE, np.array([0.0, 1.0]))),
    "roll": ((_QUARTER_TURN, np.zeros(2)),),
    "scale": ((np.eye(2), np.zeros(2)),),
}


@dataclass(frozen=True)
class CommonError:
    """What explains most: clamp (sizes: x and y, mm), roll (rad), scale (relative) or nothing; left: (K,) mm."""

    kind: CommonKind | Literal[""]
    sizes: Array
    error_mm: Array


def common_errors(
    every_shapes: Sequence[Shapes],
    misfits: Sequence[Misfit],
    distance: Array,
    experiments: Sequence[Experiment],
    unknowns: Unknowns,
) -> tuple[CommonError, ...]:
    """One an experiment, of a kind that is no unknown of the fit already.

    every_shapes: of the optimum, the first of their candidates; misfits, distance: of `polish.difference_batch` at the
    optimum.
    """
    freed = {nuisance.source for nuisance in unknowns.freed}
    kinds = [kind for kind in _KINDS if kind not in freed]
    found = []
    for experiment, shapes, misfit in zip(experiments, every_shapes, misfits, strict=True):
        every = [_explained(kind, experiment, shapes, misfit, distance, unknowns.prior) for kind in kinds]
        nothing = CommonError("", np.zeros(0), misfit.error_mm[0])
        found.append(min((nothing, *every), key=lambda own: float(own.error_mm.mean())))
    return tuple(found)


def _explained(
    kind: CommonKind, experiment: Experiment, shapes: Shapes, misfit: Misfit, distance: Array, prior: Array
) -> CommonError:
    n = len(distance)
    residuals = misfit.residuals[0]
    own = (misfit.residuals[1 : n + 1] - misfit.residuals[n + 1 :]) / distance[:, None, None, None]
    slopes = np.concatenate([own, _slopes(kind, experiment, shapes)]).reshape(-1, residuals.size)
    # In units of the error that was left: the priors' precisions hold the unknowns.
    variance = max(float((residuals**2).sum() / max(misfit.weights.sum(), 1.0)), np.finfo(float).tiny)
    held = np.zeros(len(slopes))
    held[:n] = prior * variance
    step = np.linalg.lstsq(slopes @ slopes.T + np.diag(held), -slopes @ residuals.ravel(), rcond=None)[0]
    left = (residuals.ravel() + step @ slopes).reshape(residuals.shape)
    count = np.maximum(misfit.weights.sum(axis=(1, 2)), 1.0)
    return CommonError(kind, step[n:], np.sqrt((left**2).sum(axis=(1, 2)) / count))


def _slopes(kind: CommonKind, experiment: Experiment, shapes: Shapes) -> Array:
    """(parts, K, G, m): of the residuals in each part of a kind."""
    parts = _KINDS[kind]
    steps = [(sign * turn, sign * shift) for turn, shift in parts for sign in (_STEP, -_STEP)]
    setup = Setup(
        np.ones(len(steps)),
        np.stack([np.eye(2) + turn for turn, _ in steps]),
        np.stack([shift for _, shift in steps]),
    )
    same = shapes.take(np.zeros(len(steps), np.intp))  # one candidate, seen in each way
    found = experiment.observed.misfit(experiment.model, same, setup).residuals
    return np.asarray(found[0::2] - found[1::2]) / (2 * _STEP)
