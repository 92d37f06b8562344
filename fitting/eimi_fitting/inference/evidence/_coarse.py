"""Reduce experiments to a coarse mesh of the beam and few points of each edge, for a fast first search."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from eimi_fitting.beam.model import BeamModel
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Observation

# The first search needs only a point near the optimum, because Gauss-Newton steps follow. The coarse mesh changes the
# simulated edges by a few thousandths of a millimetre, and the omitted points of the edges have a smaller effect.
POINTS_OF_EDGE = 25  # about two for each element


def on_coarse_mesh(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """Return the experiments with a coarse finite-element mesh of the beam."""
    return tuple(dataclasses.replace(e, model=BeamModel(e.model.specimen, plane=e.model.plane)) for e in experiments)


def coarsened(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """Return the experiments with a coarse mesh of the beam and fewer points of each edge."""
    return tuple(dataclasses.replace(e, observed=_thinned(e.observed)) for e in on_coarse_mesh(experiments))


def _thinned(observed: Observation) -> Observation:
    if not isinstance(observed, EdgeObservation):
        return observed
    stride = max(observed.points_mm.shape[2] // POINTS_OF_EDGE, 1)
    return dataclasses.replace(
        observed,
        points_mm=observed.points_mm[:, :, ::stride],
        sigma_mm=observed.sigma_mm[:, :, ::stride],
        noise_mm=None if observed.noise_mm is None else observed.noise_mm[:, :, ::stride],
    )
