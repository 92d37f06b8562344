"""Simulate experiments with equally spaced or planned coil currents, and compare how exact their fits are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import edge_curves, points_on
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource, loads_under, specimen_under
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.inference.interval.corrected_optimum import refine
from eimi_fitting.inference.interval.estimate import Estimate
from eimi_fitting.inference.planning.design_of_experiment import (
    Candidates,
    EdgeNoise,
    KnownLaw,
    candidates,
)
from eimi_fitting.laws import LAWS
from tests.shared.virtual_measurements import with_noise

Array = NDArray[np.float64]
TRUTH_PA = 46e3
FIELD_MT = np.linspace(0.0, 7.05, 31)
ALONG = 13  # elements along the beam in the fits: half as many as in `eimi fit`
POINTS = 3  # simulated points from one corner of an element to the next


@dataclass(frozen=True)
class Setting:
    """The mounting of a beam: the angle of gravity in the beam frame (degrees), and the force at its tip (N)."""

    name: str
    specimen: Specimen
    gravity_angle_deg: float = 0.0
    tip_force_N: float = 0.0

    def loads(self, field_mT: Array = FIELD_MT) -> Loads:
        """Return the loads of the beam at these magnetic fields (mT), one load step for each."""
        return Loads.along(field_mT, gravity_angle_deg=self.gravity_angle_deg, tip_force_N=self.tip_force_N)


@dataclass(frozen=True)
class Bench:
    """The stated uncertainties of a simulated bench, and the noise of its edge points.

    noise_mm : standard deviation of each part of the noise: white, and correlated along the edge
    """

    stated: tuple[StatedSource, ...]
    noise_mm: float


def measured(setting: Setting, loads: Loads, bench: Bench, rng: np.random.Generator) -> Experiment:
    """Return a simulated experiment whose beam and loads differ from their files by random errors."""
    deviations = {
        s.source: s.standard_uncertainty * rng.normal(size=len(SOURCES[s.source].parts)) for s in bench.stated
    }
    setup = Setup.of(((s, part, value) for s, values in deviations.items() for part, value in enumerate(values)), 1)
    model = BeamModel(specimen_under(setting.specimen, deviations)).refined()
    shapes = model.solve(
        LAWS["neo-hookean"],
        np.array([[TRUTH_PA]]),
        loads_under(loads, deviations),
        field_factor=setup.field_factor,
    )
    edges = setup.imaged(points_on(edge_curves(model, shapes)[0], POINTS)[:, :, 4:-4])
    observed = with_noise(edges, bench.noise_mm, rng)
    return Experiment(BeamModel(setting.specimen, ALONG), loads, observed, stated=bench.stated)


def fitted(experiment: Experiment) -> Estimate:
    """Return the result of a fit that starts at the true modulus."""
    unknowns, unit = KnownLaw(LAWS["neo-hookean"], np.array([TRUTH_PA])).unknowns()
    return refine(Problem(LAWS["neo-hookean"], unknowns, (experiment,)), unit, 1).estimate


def half_percent(estimate: Estimate) -> float:
    """Return the half-width of the 95 % interval of the modulus in per cent of the modulus."""
    modulus = estimate.initial_shear_modulus
    return 50 * (modulus.interval_95[1] - modulus.interval_95[0]) / modulus.value


def planned(setting: Setting, estimate: Estimate, bench: Bench, states: int) -> Candidates:
    """Return the load steps from which a plan of the next run chooses, with their contributions to the accuracy.

    estimate : result of an earlier fit to `states` load steps
    """
    noise = EdgeNoise.of(estimate.identifiability, states)
    law = KnownLaw(LAWS["neo-hookean"], np.array([estimate.initial_shear_modulus.value]))
    return candidates(law, setting.specimen, setting.loads(), bench.stated, noise, along=ALONG)
