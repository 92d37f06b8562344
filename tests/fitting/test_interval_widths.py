"""The widths of intervals, and the contributions to a width, agree with repeated measurements and sums by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.doubts.checks import doubts
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation, edge_curves, points_on
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource, loads_under, specimen_under
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve, TensileEvidence
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, SharedUnknowns, Unknowns, nuisances
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.interval.budget import Moves, budget
from eimi_fitting.inference.interval.considered import ConsideredInput, Steps, sources_of
from eimi_fitting.inference.interval.corrected_optimum import refine
from eimi_fitting.inference.interval.covariance import Linearisation, LinearStates, point_correlation
from eimi_fitting.inference.interval.draws import draw_noise, interval_95, quantity
from eimi_fitting.inference.interval.estimate import _widened
from eimi_fitting.inference.interval.profile_likelihood import Ends
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space
from eimi_fitting.laws.tensile import engineering_stress

Array = NDArray[np.float64]

STATES, POINTS, DRAWS = 24, 120, 1500
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
MODEL = BeamModel(BEAM)
NOWHERE = EdgeObservation(np.zeros((1, 2, 1, 2)), np.ones((1, 2, 1)))


def alike(rng: np.random.Generator, draws: int, along: int, states: int) -> Array:
    # Return correlated noise of unit variance, shape (draws, K, 2, m): K load steps, two edges, m points.
    # along, states : numbers of neighbouring points and load steps whose white noise is averaged
    white = rng.normal(size=(draws, STATES + states - 1, 2, POINTS + along - 1))
    over_edge = np.lib.stride_tricks.sliding_window_view(white, along, axis=3).mean(axis=-1)
    both = np.lib.stride_tricks.sliding_window_view(over_edge, states, axis=1).mean(axis=-1)
    return np.asarray(both * np.sqrt(along * states))


def linear_states(residuals: Array, level: Array) -> LinearStates:
    # Return K load steps whose m points on each edge move linearly with one unknown.
    # residuals : of left and right edge, shape (K, 2, m)
    # level : standard deviation of the noise in each load step, shape (K,)
    slopes = np.linspace(0.8, 1.2, STATES)[:, None, None] * np.ones((1, STATES, 2, POINTS))
    counts = np.full(STATES, 2.0 * POINTS)
    weights = 300.0 / (STATES * level.mean() * counts * level)
    return LinearStates(residuals, slopes, np.ones_like(residuals), weights, counts, level)


def linearisation(states: LinearStates, prior: float) -> Linearisation:
    # Return the residuals of a fit as linear functions of its only unknown.
    # prior : inverse variance of the prior
    return Linearisation(
        unit=np.full(1, 0.5),
        objective_mm=1.0,
        states=(states,),
        points=STATES * 2 * POINTS,
        independent_points=300.0,
        likelihood_points=300.0,
        noise_points=300.0,
        noise_mm=1.0,
        residual_mm=1.0,
        curves=np.zeros(0),
        curve_slopes=np.zeros((1, 0)),
        priors=np.zeros(0),
        law_priors=np.zeros(0),
        law_prior_slopes=np.zeros((1, 0)),
        information=states.information,
        score_variance=states.score_variance(NOWHERE),
        prior=np.array([[prior]]),
    )


@pytest.mark.parametrize(("along", "states"), [(1, 1), (6, 1), (1, 3), (6, 3)])
@pytest.mark.parametrize("share", [0.0, 1.0], ids=["flat", "prior"])
def test_the_variance_is_that_of_repeated_measurements(along: int, states: int, share: float) -> None:
    rng = np.random.default_rng(along + 10 * states)
    level = np.linspace(0.5, 2.0, STATES)  # some states are noisier
    noise = level[:, None, None] * alike(rng, DRAWS, along, states)
    information = float(linear_states(noise[0], level).information[0, 0])
    prior = share * information
    predicted = np.mean([linearisation(linear_states(r, level), prior).covariance()[0, 0] for r in noise[:40]])
    scores = np.array([linear_states(r, level).score(r)[0] for r in noise])
    truth = rng.normal(0, 1 / np.sqrt(prior), DRAWS) if prior else np.zeros(DRAWS)
    estimates = (information * truth - scores) / (information + prior)
    # tau, the number of correlated points, is a sum over noisy lags, and therefore slightly too large.
    assert predicted == pytest.approx(np.var(estimates - truth), rel=0.25)


def test_the_covariance_grows_with_the_square_of_the_widening() -> None:
    about = linearisation(linear_states(np.ones((STATES, 2, POINTS)), np.ones(STATES)), 1e-9)
    assert about.covariance(2.0) == pytest.approx(4 * about.covariance(), rel=1e-3)


def test_correlated_points_count_as_one_along_an_edge_and_between_states() -> None:
    rng = np.random.default_rng(3)
    for along, states in ((1, 1), (6, 1), (1, 3), (6, 3)):
        noise = alike(rng, 1, along, states)[0]
        # If states are correlated, the mean over the states keeps the correlation along an edge.
        counted = point_correlation(noise, np.ones_like(noise), NOWHERE)
        assert counted == pytest.approx(along * states, rel=0.3)


def test_tracked_points_of_a_state_share_their_stated_error() -> None:
    rng = np.random.default_rng(5)
    sigma = np.array([0.02, 0.01, 0.03])
    slopes = rng.uniform(0.5, 1.5, (1, 3, 2, 8))
    observed = PointObservation(np.zeros((3, 8, 2)), np.zeros((3, 8, 2)), np.tile(sigma[:, None], (1, 8)))
    states = LinearStates(
        np.full((3, 2, 8), 1e-6),
        slopes,
        np.ones((3, 2, 8)),
        np.array([1.0, 2.0, 0.5]),
        np.full(3, 8.0),
        np.full(3, 1e-6),
    )
    shifts = rng.normal(size=(20_000, 3, 2)) * sigma[:, None]
    scores = np.einsum("k,dkg,kg->d", states.weights, shifts, slopes.sum(axis=-1)[0])
    assert states.score_variance(observed)[0, 0] == pytest.approx(np.var(scores), rel=0.05)
    # Residuals far above the stated uncertainty count as well.
    worse = replace(states, error_mm=np.full(3, 0.5))
    assert worse.score_variance(observed)[0, 0] > 50 * states.score_variance(observed)[0, 0]


def test_an_interval_of_two_states_has_the_factor_of_student_s_t() -> None:
    # Four edges determine the noise with three degrees of freedom.
    model, loads = BeamModel(BEAM, 26, 2), Loads.along((3.0, 7.0))
    truth = np.array([[46e3], [46e3 * 1.01]])
    shapes = model.solve(LAWS["neo-hookean"], truth, loads)
    sides = points_on(edge_curves(model, shapes)[0], 3)[:, :, 1:-1]
    noisy = sides + np.random.default_rng(2).normal(0, 0.03, sides.shape)
    sigma = np.full(sides.shape[2], 0.03)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])
    fit = identify("neo-hookean", [Experiment(BeamModel(BEAM), loads, observed)])
    residuals = observed.misfit(model, shapes).residuals
    slope_mm = (residuals[1] - residuals[0]) / np.log(1.01)  # derivative by the logarithm of the modulus
    identifiability = fit.identifiability
    assert identifiability.noise_mm is not None
    assert identifiability.noise_points is not None
    deviation = identifiability.noise_mm / np.sqrt(identifiability.noise_points * np.mean(slope_mm**2))
    low, high = fit.initial_shear_modulus.interval_95
    assert 0.5 * np.log(high / low) == pytest.approx(stats.t.ppf(0.975, 3) * deviation, rel=0.2)


@pytest.mark.parametrize(
    ("states", "points", "freedom"), [(1, 40.0, 1), (2, 40.0, 3), (6, 5.5, 4.5), (6, 1.2, 1), (3, 40.0, 5)]
)
def test_the_degrees_of_freedom_are_those_of_the_points_or_of_the_edges(
    states: int, points: float, freedom: float
) -> None:
    # min(E - 1, N - 1) for one unknown, E edges of all states and N independent points.
    linear: Any = SimpleNamespace(residuals=np.zeros((states, 2, 9)))
    about: Any = SimpleNamespace(states=(linear,), noise_points=points, unit=np.zeros(1))
    observed = EdgeObservation(np.zeros((states, 2, 9, 2)), np.ones((states, 2, 9)))
    problem: Any = SimpleNamespace(experiments=[SimpleNamespace(observed=observed)])
    expected = stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)
    assert _widened(problem, about) == pytest.approx(expected, rel=1e-6)
    tracked: Any = SimpleNamespace(observed=PointObservation(np.zeros((1, 2, 2)), np.zeros((1, 2, 2)), np.ones((1, 2))))
    problem.experiments.append(tracked)
    assert _widened(problem, about) == 1.0


def shared(source: str, size: float) -> SharedUnknowns:
    return SharedUnknowns(source, (0,), size)


def test_the_budget_has_the_largest_source_first_and_halves_it() -> None:
    # `budget` also predicts the interval with half the uncertainty of the first input; the effects are 1 % and 3 %.
    sources = [ConsideredInput(name, shared(name, 0.1), 0, (None,)) for name in ("depth", "width")]
    rng = np.random.default_rng(1)
    moved = np.array([[0.01], [0.03]])
    steps = Steps(moved, np.zeros(1))
    moves = Moves(np.full(1, 0.5), 1e-5 * rng.normal(size=(4000, 1)), rng.normal(size=(4000, 2)), steps)
    entries, measure_next = budget(sources, moves, lambda unit: 46e3 * np.exp(unit[:, 0] - 0.5))
    assert [entry.source for entry in entries] == ["width", "depth"]
    assert [entry.effect_percent for entry in entries] == pytest.approx([3.0, 1.0], rel=1e-2)
    assert (measure_next.source, measure_next.words) == ("width", SOURCES["width"].words)
    low, high = measure_next.initial_shear_modulus_interval_95_Pa
    assert 0.5 * np.log(high / low) == pytest.approx(1.96 * np.hypot(0.015, 0.01), rel=0.1)


def test_draws_contain_the_sources_and_the_remaining_errors_of_the_corrections() -> None:
    moves = Moves(
        np.full(1, 0.5),
        np.array([[0.01], [0.0], [-0.02]]),
        np.array([[1.0, 0.0], [-1.0, 2.0], [0.0, 0.0]]),
        Steps(np.array([[0.02], [0.05]]), np.zeros(1)),
    )
    assert moves.units()[:, 0] == pytest.approx([0.53, 0.58, 0.48])
    assert moves.units(of_sources=0.0)[:, 0] == pytest.approx([0.51, 0.5, 0.48])
    assert moves.units(of_noise=0.5, of_sources=np.array([1.0, 0.5]))[:, 0] == pytest.approx([0.525, 0.53, 0.49])
    rng = np.random.default_rng(0)
    unit, covariance = np.full(2, 0.5), np.diag([0.01**2, 0.02**2])
    ends = Ends(unit - 0.1, unit + 0.1, ())
    drawn = draw_noise(rng, unit, covariance, ends, np.array([[0.03, 0.01]]), np.array([0.02]))
    expected = covariance + np.outer([0.03, 0.01], [0.03, 0.01]) + np.diag([0.02**2, 0.0])
    assert np.cov(drawn.T) == pytest.approx(expected, rel=0.1, abs=1e-5)
    # The two halves of a profiled interval have different widths.
    skewed = Ends(np.array([0.4, 0.4]), np.array([0.54, 0.6]), (0,))
    halves = draw_noise(rng, unit, covariance, skewed, np.zeros((0, 2)), np.zeros(0))[:, 0]
    assert interval_95(unit[0] + halves) == pytest.approx((0.4, 0.54), abs=2e-3)


def test_the_ends_of_a_quantity_are_in_order_and_in_the_right_fields() -> None:
    every, alone = np.linspace(0, 100, 1001), np.linspace(40, 60, 1001)
    value = quantity(50.0, "Pa", every, alone)
    assert value.interval_95 == pytest.approx((2.5, 97.5))
    assert value.interval_95_fit == pytest.approx((40.5, 59.5))


def problem(*freed: NuisancePrior, stated: tuple[str, ...] = ()) -> Problem:
    sources = tuple(StatedSource(source, SOURCES[source].usual, "here") for source in stated)
    model, loads = BeamModel(BEAM), Loads.along((3.0,))
    experiment = Experiment(model, loads, NOWHERE, stated=sources)
    unknowns = Unknowns(search_space(LAWS["neo-hookean"]), nuisances(freed, 1, [sources]))
    return Problem(LAWS["neo-hookean"], unknowns, (experiment,))


def test_a_freed_source_and_its_equivalents_are_not_counted_again() -> None:
    both = ("remanence", "width")
    assert [group.source for group in sources_of(problem(stated=both))] == list(both)[::-1]
    assert [group.source for group in sources_of(problem(NuisancePrior("moment", 0.02), stated=both))] == ["width"]
    assert [group.source for group in sources_of(problem(NuisancePrior("width"), stated=both))] == ["remanence"]


def test_only_its_prior_limits_an_estimated_input() -> None:
    unknowns = problem(NuisancePrior("moment", 0.02)).unknowns
    one_off = np.array([[0.3, 0.5]])
    one_off[0, 1] += 1 / np.sqrt(unknowns.prior[1])
    assert unknowns.standardised(one_off) == pytest.approx(np.ones((1, 1)))
    assert unknowns.freed[0].value(one_off[:, 1]) == pytest.approx([0.02])


def test_a_curve_counts_with_its_independent_rows_and_its_weight() -> None:
    curve = TensileCurve(np.array([0.1, 0.2]), np.array([10e3, 20e3]), weight=0.5)
    evidence = TensileEvidence(curve, noise_Pa=200.0, correlation_rows=4.0)
    law, mu = LAWS["neo-hookean"], np.array([[46e3]])
    z = evidence.standardised(law, mu)[0]
    residuals = engineering_stress(law, mu, curve.strain)[0] - curve.stress_Pa
    assert (z**2).sum() == pytest.approx(0.5 * (residuals**2).sum() / (4.0 * 200.0**2))


def test_the_draws_of_the_sources_depend_on_the_seed() -> None:
    model, loads = BeamModel(BEAM, 8, 1), Loads.along((3.0, 7.0))
    sides = points_on(edge_curves(model, model.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads))[0], 1)[:, :, 1:-1]
    sigma = np.full(sides.shape[2], 0.01)
    noisy = sides + np.random.default_rng(2).normal(0, 0.01, sides.shape)
    observed = EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in noisy])
    stated = (StatedSource("remanence", 0.02, "here"), StatedSource("density", 5.0, "here"))
    experiment = Experiment(model, loads, observed, stated=stated)
    one, other = (identify("neo-hookean", [experiment], seed=seed) for seed in (1, 2))
    assert (one.draws.seed, other.draws.seed) == (1, 2)
    space = search_space(LAWS["neo-hookean"])
    problem, start = Problem(LAWS["neo-hookean"], Unknowns(space), (experiment,)), np.full(1, 0.5)
    first, again, second = (refine(problem, start, seed).estimate.draws.values for seed in (1, 1, 2))
    assert first == again != second  # the optimum is the same, and only the draws differ
    assert one.initial_shear_modulus.value == pytest.approx(other.initial_shear_modulus.value, rel=1e-3)
    searched = [[generation.mean_mm for generation in fit.history] for fit in (one, other)]
    assert searched[0][0] != searched[1][0]


@pytest.mark.parametrize(("times", "doubted"), [(8.0, False), (15.0, True)])
def test_residuals_ten_times_the_stated_noise_are_a_doubt(times: float, doubted: bool) -> None:
    sigma = np.full(12, 0.002)
    points = np.zeros((12, 2))
    observed = EdgeObservation.from_edges([(points, sigma, points, sigma)] * 5)
    misfit = observed.of_residuals(np.full((1, 5, 2, 12), times * 0.002))
    experiment = Experiment(MODEL, Loads.along(np.arange(5.0)), observed)
    final: Any = SimpleNamespace(misfits=(misfit,))
    assert bool(doubts(final, [experiment])) == doubted
    # Flags that increase the uncertainty of the points do not hide the doubt.
    widened = replace(observed, sigma_mm=np.hypot(observed.sigma_mm, 0.3), noise_mm=observed.sigma_mm)
    assert bool(doubts(final, [replace(experiment, observed=widened)])) == doubted
    # One state with a far larger error is named by its number.
    one = np.full((1, 5, 2, 12), 0.002)
    one[:, 3] *= 6 * times
    final = SimpleNamespace(misfits=(observed.of_residuals(one),))
    assert [doubt.state for doubt in doubts(final, [experiment])] == [3]


def turned(angle_deg: float) -> Array:
    return np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])


def test_an_error_of_the_axis_turns_field_gravity_and_weight() -> None:
    loads = Loads.along([5.0], 90.0, 10.0, [0.02])
    for source, field_deg, gravity_deg in (("field", 93.0, 10.0), ("gravity", 90.0, 13.0), ("axis", 87.0, 7.0)):
        there = loads_under(loads, {source: np.array([3.0])})
        assert there.field_T[0] == pytest.approx(5e-3 * turned(field_deg))
        assert there.gravity[0] == pytest.approx(9.80665 * turned(gravity_deg))
        assert there.tip_force_N[0] == pytest.approx(0.02 * turned(gravity_deg))


def test_an_error_of_zero_current_adds_a_constant_to_every_field() -> None:
    loads = Loads.along([-2.0, 0.0, 5.0], 60.0)
    there = loads_under(loads, {"offset": np.array([0.5])})
    assert there.field_T == pytest.approx(Loads.along([-1.5, 0.5, 5.5], 60.0).field_T)


def test_a_dimension_deviates_by_its_stated_uncertainty() -> None:
    for source, attribute in (
        ("width", "width_mm"),
        ("depth", "depth_mm"),
        ("length", "length_mm"),
        ("density", "density_kg_m3"),
    ):
        assert getattr(specimen_under(BEAM, {source: np.array([0.3])}), attribute) == getattr(BEAM, attribute) + 0.3
    for source, attribute in (
        ("remanence", "remanence_T"),
        ("magnet-width", "width_mm"),
        ("magnet-offset", "tip_offset_mm"),
    ):
        magnet = specimen_under(BEAM, {source: np.array([0.3])}).magnet
        assert getattr(magnet, attribute) == getattr(BEAM.magnet, attribute) + 0.3


def test_a_tip_force_stays_at_the_tip_of_a_beam_whose_dimensions_deviate() -> None:
    beam = replace(BEAM, magnet=None, tip_load_mm=(30.0, -1.5))
    smaller = specimen_under(beam, {"length": np.array([-0.3]), "width": np.array([-0.1])})
    assert smaller.tip_load_mm == pytest.approx((29.7, -1.45))
    loads = Loads.along(np.zeros(1), 90.0, 90.0, [0.005])
    shapes = BeamModel(smaller).solve(LAWS["neo-hookean"], np.array([[46e3]]), loads)
    assert shapes.converged.all()
