"""A magnet that is magnetised at an angle to the beam has the right torque, and a fit finds this angle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, edge_curves, points_on
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.polarity import freed_by_polarities
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, Unknowns
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.interval.corrected_optimum import refine
from eimi_fitting.inference.interval.estimate import Estimate
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space

TRUTH_PA = 46e3
NOISE_MM = 1e-3
TILT_DEG = 3.0
MAGNET = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", MAGNET)
TILTED = replace(BEAM, magnet=replace(MAGNET, magnetisation_angle_deg=TILT_DEG))
ONE_WAY = Loads.along((0.0, 3.0, 7.0))
BOTH_WAYS = Loads.along((0.0, 3.0, 7.0, -3.0, -7.0))


def experiment(loads: Loads, stated_deg: float | None = None) -> Experiment:
    # Return a simulated experiment with a magnet that is magnetised at an angle to the beam.
    # stated_deg : standard uncertainty of the angle in the file; None if the file gives none
    model = BeamModel(TILTED, 26, 2)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[TRUTH_PA]]), loads)
    sides = points_on(edge_curves(model, shapes)[0], 2)[:, :, 1:-1]
    noisy = sides + np.random.default_rng(1).normal(0, NOISE_MM, sides.shape)
    sigma = np.full(sides.shape[2], NOISE_MM)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])
    stated = () if stated_deg is None else (StatedSource("magnetisation-angle", stated_deg, "specimen 1"),)
    return Experiment(BeamModel(BEAM), loads, observed, stated=stated)


def fitted(loads: Loads, stated_deg: float | None = None) -> Estimate:
    # Return the result of a fit to the edges of `experiment`; the fit starts at a modulus 10 % too large.
    law = LAWS["neo-hookean"]
    space = search_space(law)
    unit = np.full((1, 1), np.log(1.1 * TRUTH_PA / space.lower[0]) / np.log(space.upper[0] / space.lower[0]))
    return refine(Problem(law, Unknowns(space), (experiment(loads, stated_deg),)), unit[0], 1).estimate


@pytest.fixture(scope="module")
def not_stated() -> Estimate:
    return fitted(ONE_WAY)


@pytest.mark.parametrize("model", [BeamModel(TILTED), SolidModel(TILTED, 8, 1)])
def test_a_rotated_moment_bends_the_beam_as_a_field_with_the_opposite_rotation(model):
    straight = model.of(BEAM) if isinstance(model, BeamModel) else SolidModel(BEAM, 8, 1)
    turned = model.solve(LAWS["neo-hookean"], np.array([[TRUTH_PA]]), Loads.along((0.0, 4.0)))
    back = Loads.along((0.0, 4.0), 90.0 - TILT_DEG)
    field_turned = straight.solve(LAWS["neo-hookean"], np.array([[TRUTH_PA]]), back)
    assert turned.rigid == pytest.approx(field_turned.rigid, abs=1e-7)
    assert abs(turned.rigid[0, -1, 2]) > 0.4


def test_a_fit_without_the_direction_prints_the_effect_of_three_degrees(not_stated):
    (entry,) = not_stated.if_uncertain
    assert (entry.source, entry.standard_uncertainty, entry.unit) == ("magnetisation-angle", 3.0, "deg")
    moved_percent = 100 * (not_stated.initial_shear_modulus.value / TRUTH_PA - 1)
    assert moved_percent == pytest.approx(10.0, abs=2.0)
    assert entry.effect_percent == pytest.approx(moved_percent, rel=0.2)
    assert not_stated.budget == ()


def test_an_uncertain_direction_widens_the_interval_by_its_effect_and_the_interval_contains_the_truth(not_stated):
    fit = fitted(ONE_WAY, TILT_DEG)
    (entry,) = fit.budget
    assert fit.if_uncertain == ()
    assert entry.effect_percent == pytest.approx(not_stated.if_uncertain[0].effect_percent, rel=1e-3)
    low, high = fit.initial_shear_modulus.interval_95
    assert high - low == pytest.approx(2 * 1.96 * fit.initial_shear_modulus.value * entry.effect_percent / 100, rel=0.1)
    assert low < TRUTH_PA < high


def test_an_uncertain_direction_is_estimated_if_both_polarities_were_measured():
    fit = identify("neo-hookean", [experiment(BOTH_WAYS, TILT_DEG)])
    (freed,) = fit.freed
    assert (freed.name, freed.prior_standard_deviation) == ("direction of magnetisation", TILT_DEG)
    assert freed.deviation.value == pytest.approx(TILT_DEG, abs=0.1)
    assert fit.initial_shear_modulus.value == pytest.approx(TRUTH_PA, rel=0.01)
    low, high = fit.initial_shear_modulus.interval_95
    assert low < TRUTH_PA < high
    assert high - low < 0.02 * TRUTH_PA


@pytest.mark.parametrize(
    ("loads", "stated_deg", "free"),
    [(ONE_WAY, 3.0, ()), (BOTH_WAYS, None, ()), (BOTH_WAYS, 0.0, ()), (BOTH_WAYS, 3.0, ("magnetisation-angle",))],
)
def test_a_direction_is_not_estimated_at_one_polarity_or_without_an_uncertainty_or_twice(loads, stated_deg, free):
    assert freed_by_polarities([experiment(loads, stated_deg)], [NuisancePrior(kind, 1.0) for kind in free]) == ()
