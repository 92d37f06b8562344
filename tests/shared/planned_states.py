"""Simulate experiments with equally spaced or planned states (coil currents), and compare how exact their fits are.

The half-width of the 95 % interval of the modulus measures how exact a fit is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.corrected_optimum import refine
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import edge_curves, points_on
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource, loads_under, specimen_under
from eimi_fitting.inference.evidence.unknowns import Setup
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
        """Return the loads of the beam at these magnetic fields (mT), one state for each field."""
        return Loads.along(field_mT, gravity_angle_deg=self.gravity_angle_deg, tip_force_N=self.tip_force_N)


@dataclass(frozen=True)
class Bench:
    """The errors of a simulated bench: the uncertainties that its files give, and the noise of its edge points.

    The noise is the sum of white noise and of noise that is correlated along the edge. noise_mm: standard deviation of
    each of the two.
    """

    stated: tuple[StatedSource, ...]
    noise_mm: float


def measured(setting: Setting, loads: Loads, bench: Bench, rng: np.random.Generator) -> Experiment:
    """Return a simulated experiment: the beam and its loads differ at random from the values in the files.

    The size of the differences follows from the standard uncertainties in `bench`. The experiment contains the edges,
    and the values in the files.
    """
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
    """Return the estimate of `eimi fit` for an experiment; the fit starts at the true modulus and needs no search."""
    unknowns, unit = KnownLaw(LAWS["neo-hookean"], np.array([TRUTH_PA])).unknowns()
    return refine(Problem(LAWS["neo-hookean"], unknowns, (experiment,)), unit, 1).estimate


def half_percent(estimate: Estimate) -> float:
    """Return the half-width of the 95 % interval of the modulus in per cent of the modulus."""
    modulus = estimate.initial_shear_modulus
    return 50 * (modulus.interval_95[1] - modulus.interval_95[0]) / modulus.value


def planned(setting: Setting, estimate: Estimate, bench: Bench, states: int) -> Candidates:
    """Return the states from which a plan chooses the states of the next run.

    Each state has its contribution to the accuracy of the modulus. The contributions are computed from the modulus and
    the noise of an earlier fit, `estimate`, to `states` states.
    """
    noise = EdgeNoise.of(estimate.identifiability, states)
    law = KnownLaw(LAWS["neo-hookean"], np.array([estimate.initial_shear_modulus.value]))
    return candidates(law, setting.specimen, setting.loads(), bench.stated, noise, along=ALONG)
