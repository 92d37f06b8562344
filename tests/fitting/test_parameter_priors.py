"""A prior on a parameter of the law has the weight that Bayes' rule gives for normal errors."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting import BeamModel, Experiment, Loads, NuisancePrior, PointObservation, Prior, Specimen, identify
from eimi_fitting.inference.doubts.checks import NotExplained
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.inference.interval.estimate import Estimate
from eimi_fitting.laws import LAWS, search_space
from tests.shared.estimates import refined

STRIP = Specimen(length_mm=30.0, width_mm=3.0, depth_mm=10.0, density_kg_m3=1070.0, section="plane-stress")
NOISE_MM = 0.05


def tracked(model: str, parameters: list[float], forces_N: Sequence[float] = (0.0, 0.001, 0.002, 0.004)) -> Experiment:
    # Return a simulated experiment: nine noisy markers on a horizontal strip of a known law under tip forces (N).
    beam = BeamModel(STRIP)
    loads = Loads.along(np.zeros(len(forces_N)), gravity_angle_deg=90.0, tip_force_N=forces_N)
    rest = np.column_stack([np.linspace(5, 29, 9), np.zeros(9)])
    places = beam.positions(beam.solve(LAWS[model], np.array([parameters]), loads), rest)[0]
    moved = places + np.random.default_rng(1).normal(0, NOISE_MM, places.shape)
    return Experiment(
        beam, loads, PointObservation(np.tile(rest, (len(moved), 1, 1)), moved, np.full(moved.shape[:2], NOISE_MM))
    )


SEEN = tracked("neo-hookean", [46e3])


@pytest.fixture(scope="module")
def alone():
    # The fit of a law with one parameter, without a prior.
    return identify("neo-hookean", [SEEN])


def estimated(priors: Sequence[Prior] = (), free: Sequence[NuisancePrior] = ()) -> Estimate:
    # Return the result of a fit to the markers, which starts at 50 kPa.
    # free : uncertain inputs that the fit also determines
    return refined("neo-hookean", [SEEN], 50e3, free=free, priors=priors).estimate


def spread(fit: Estimate) -> float:
    # Return the standard deviation (Pa) of the only parameter, from the width of its interval.
    low, high = fit.parameters["mu"].interval_95
    return float((high - low) / (2 * 1.96))


def objective_mm(prior: Prior, moduli_Pa: np.ndarray, independent_points: float) -> np.ndarray:
    # Return the function that a fit with a prior minimises (mm), at several moduli (Pa).
    # independent_points : number of edge points that count as independent
    space = search_space(LAWS["neo-hookean"])
    unit = np.log(moduli_Pa / space.lower[0]) / np.log(space.upper[0] / space.lower[0])
    problem = Problem(LAWS["neo-hookean"], Unknowns(space), (SEEN,), priors=(prior,))
    return problem.evaluate(unit[:, None], independent_points).objective_mm


@pytest.mark.parametrize("share", [0.5, 1.0, 2.0], ids=["firm", "equal", "loose"])
def test_value_and_interval_are_those_of_two_normal_measurements(alone, share):
    # The value is the mean weighted by the inverse variances, and the inverse variances add.
    measured, noise = alone.values[0], spread(alone)
    mean, deviation = measured - 2 * noise, share * noise
    fit = estimated([Prior("mu", mean, deviation)])
    weight, prior_weight = noise**-2, deviation**-2
    expected = (weight * measured + prior_weight * mean) / (weight + prior_weight)
    assert fit.parameters["mu"].value == pytest.approx(expected, abs=0.1 * noise)
    assert spread(fit) == pytest.approx((weight + prior_weight) ** -0.5, rel=0.1)


def test_the_objective_has_the_factor_of_a_normal_prior():
    prior, moduli = Prior("mu", 45e3, 300.0), np.array([44.4e3, 45e3, 45.9e3])
    with_prior = objective_mm(prior, moduli, independent_points=12.0)
    without = objective_mm(replace(prior, standard_deviation=1e12), moduli, independent_points=12.0)
    z = (moduli - 45e3) / 300.0
    assert with_prior / without == pytest.approx(np.exp(z**2 / (2 * 12.0)), rel=1e-9)


def test_a_very_wide_prior_changes_nothing(alone):
    prior = Prior("mu", 10e3, 1e9)
    fit = identify("neo-hookean", [SEEN], priors=[prior])
    assert fit.priors == (prior,)
    assert fit.values == pytest.approx(alone.values, rel=1e-4)
    assert fit.parameters["mu"].interval_95 == pytest.approx(alone.parameters["mu"].interval_95, rel=1e-3)


def test_a_prior_determines_parameters_that_the_data_do_not_distinguish():
    truth = [16e3, 7e3]
    experiment = tracked("mooney-rivlin", truth)
    without = refined("mooney-rivlin", [experiment], 50e3).estimate
    with_prior = identify("mooney-rivlin", [experiment], priors=[Prior("C10", 16e3, 200.0)])
    assert without.identifiability.not_fixed == ("C01/(C10+C01)",)
    assert with_prior.identifiability.not_fixed == ()
    assert with_prior.identifiability.statement.startswith("These data and the given priors determine")
    low, high = with_prior.parameters["C10"].interval_95
    assert low < 16e3 < high
    assert high - low == pytest.approx(2 * 1.96 * 200.0, rel=0.1)
    assert with_prior.values == pytest.approx(truth, rel=0.1)


def test_a_prior_on_the_initial_shear_modulus_is_a_prior_on_the_sum_of_parameters(alone):
    mean = alone.values[0] - 500.0
    of_modulus = estimated([Prior("initial_shear_modulus", mean, 100.0)])
    of_parameter = estimated([Prior("mu", mean, 100.0)])
    assert of_modulus.parameters["mu"].value == pytest.approx(of_parameter.parameters["mu"].value, rel=1e-9)


def test_a_prior_on_the_modulus_determines_an_estimated_width(alone):
    freed = [NuisancePrior("width", 0.1)]
    open_fit = estimated(free=freed)
    constrained = estimated([Prior("mu", 46e3, 50.0)], freed)
    assert spread(constrained) < 0.5 * spread(open_fit)


def test_a_prior_that_the_data_contradict_is_doubted():
    experiment = tracked("neo-hookean", [46e3], np.linspace(0.0, 0.004, 12).tolist())
    without_prior = refined("neo-hookean", [experiment], 50e3).estimate
    modulus_Pa = without_prior.parameters["mu"].value
    far, near = (Prior("mu", modulus_Pa - away * spread(without_prior), spread(without_prior)) for away in (8, 1))
    (distance,) = (fit := identify("neo-hookean", [experiment], priors=[far])).prior_distances
    assert 3 < distance < 8
    assert any(
        re.search(r"differs from the prior on mu, .* by \d+\.\d standard deviations", d.words) for d in fit.doubts
    )
    fit = identify("neo-hookean", [experiment], priors=[near])
    assert fit.prior_distances == pytest.approx([2**-0.5], rel=0.2)
    assert not any("prior" in d.words for d in fit.doubts)


def test_a_prior_in_a_wrong_unit_is_named_in_the_refusal_of_the_fit():
    wrong = r"with the prior mu = 46 ± 0\.5 Pa; check value and unit of the prior, the edges of this state"
    with pytest.raises(NotExplained, match=wrong):
        identify("neo-hookean", [SEEN], priors=[Prior("mu", 46.0, 0.5)], most_generations=2, possible_causes=())


def test_wrong_priors_are_refused():
    with pytest.raises(ValueError, match=r"mooney-rivlin has no parameter 'c10'; did you mean 'C10'\?"):
        identify("mooney-rivlin", [SEEN], priors=[Prior("c10", 1e4, 1e3)])
    with pytest.raises(ValueError, match="neo-hookean has no parameter 'alpha'; there are mu, initial_shear_modulus"):
        identify("neo-hookean", [SEEN], priors=[Prior("alpha", 1e4, 1e3)])
    with pytest.raises(ValueError, match="two priors on mu"):
        identify("neo-hookean", [SEEN], priors=[Prior("mu", 1e4, 1e3), Prior("mu", 2e4, 1e3)])
    with pytest.raises(ValueError, match="a mean of inf should be a finite number"):
        Prior("mu", np.inf, 1.0)
    with pytest.raises(ValueError, match="a standard deviation of -1 should be a number above 0"):
        Prior("mu", 1e4, -1.0)
