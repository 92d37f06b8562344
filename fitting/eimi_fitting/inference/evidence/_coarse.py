"""Experiments on a mesh that a population can afford, and as the search sees them: with few points of each edge.

The search only leads the polish near: what the coarse mesh is off by (a few thousandths of a millimetre) is more than
what the points left out would add.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from eimi_fitting.beam.model import BeamModel
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Observation

POINTS_OF_EDGE = 25  # about two an element


def on_coarse_mesh(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """The same on the mesh of `BeamModel`'s defaults."""
    return tuple(dataclasses.replace(e, model=BeamModel(e.model.specimen, plane=e.model.plane)) for e in experiments)


def coarsened(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """The same states on that mesh, with every so-many-th point of each edge."""
    return tuple(dataclasses.replace(e, observed=_thinned(e.observed)) for e in on_coarse_mesh(experiments))


def _thinned(observed: Observation) -> Observation:
    if not isinstance(observed, EdgeObservation):
        return observed
    stride = max(observed.points_mm.shape[2] // POINTS_OF_EDGE, 1)
    return dataclasses.replace(
        observed, points_mm=observed.points_mm[:, :, ::stride], sigma_mm=observed.sigma_mm[:, :, ::stride]
    )
