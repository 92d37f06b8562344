"""Experiments with few measured points, for quick tests of fits; a formula replaces the finite-element beam model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.laws import LAWS
from tests.shared.quick_beam import quick_shapes

MAGNET = Magnet(4.0, 2.0, 2.0, 1.2, 7500.0, magnetisation_angle_deg=4.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", MAGNET)
LOADS = Loads.along((0.7, -1.6, 2.9, 3.4), gravity_angle_deg=75.0)
PARAMETERS = {
    "neo-hookean": (46e3,),
    "mooney-rivlin": (16e3, 6e3),
    "yeoh": (22e3, 4e3, 2e3),
}
NOISE_MM = 2e-3


def simulated(
    specimen: Specimen, loads: Loads, law: str, view: View | None = None
) -> tuple[BeamModel, Any, np.ndarray]:
    # Return a fine model of the beam, its shapes and nine points of each edge in each state.
    model = BeamModel(specimen, 30, 2, specimen.planar_section)
    shapes = quick_shapes(model, LAWS[law], np.array([PARAMETERS[law]]), loads)
    return model, shapes, points_on(outline(model, shapes, view)[0], 2)[:, :, 4:-1:6]


def edges(
    specimen: Specimen = BEAM,
    loads: Loads = LOADS,
    law: str = "mooney-rivlin",
    seed: int = 1,
    view: View | None = None,
    scale: float = 1.0,
    noise_mm: float = NOISE_MM,
) -> EdgeObservation:
    # Return noisy edges; the second edge has one point less, and one state lacks two points.
    sides = scale * simulated(specimen, loads, law, view)[2]
    noisy = sides + np.random.default_rng(seed).normal(0, noise_mm, sides.shape)
    given = []
    for k, (left, right) in enumerate(noisy):
        right = right[:-3] if k == 1 else right[:-1]
        sigma = noise_mm * (1.5 + 0.1 * np.arange(len(left)))
        given.append((left, sigma, right, 1.2 * sigma[: len(right)]))
    observed = EdgeObservation.from_edges(given, view)
    return replace(observed, noise_mm=0.7 * observed.sigma_mm)


def points(specimen: Specimen, loads: Loads, law: str = "yeoh", seed: int = 2) -> PointObservation:
    # Return noisy tracked points; one of them is not used in the first state.
    model, shapes, _ = simulated(specimen, loads, law)
    length, width = specimen.flexible_length_mm, specimen.width_mm
    straight = np.column_stack([np.linspace(0.2, 0.95, 6) * length, width * np.array([0.3, -0.2, 0.1, -0.4, 0.2, 0.0])])
    rest = model.grid.strip.at_rest(straight)
    moved = model.positions(shapes, rest)[0]
    moved = moved + np.random.default_rng(seed).normal(0, NOISE_MM, moved.shape)
    sigma = np.tile(NOISE_MM * (1 + 0.1 * np.arange(len(rest))), (len(loads), 1))
    sigma[0, 2] = np.inf
    return PointObservation(np.tile(rest, (len(loads), 1, 1)), moved, sigma)


def experiment(
    observed: EdgeObservation | PointObservation,
    specimen: Specimen = BEAM,
    loads: Loads = LOADS,
    of: str = "1",
    **stated: float,
) -> Experiment:
    # Return an experiment; `stated` are standard uncertainties of inputs of the object `of`.
    sources = tuple(StatedSource(name.replace("_", "-"), size, of) for name, size in stated.items())
    return Experiment(BeamModel(specimen, plane=specimen.planar_section), loads, observed, stated=sources)
