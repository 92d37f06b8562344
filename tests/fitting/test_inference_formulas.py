"""Formulas of the statistical inference agree with calculations by hand or with an exhaustive search."""

from __future__ import annotations

import pickle
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.inference.doubts import cause_doubts, checks
from eimi_fitting.inference.doubts.causes import Cause
from eimi_fitting.inference.doubts.checks import NotDetermined, NotExplained
from eimi_fitting.inference.evidence._coarse import _thinned
from eimi_fitting.inference.evidence._quadratic import step_to_minimum
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit
from eimi_fitting.inference.evidence.objective import Evaluation
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.polarity import has_both_polarities
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.interval import draws, estimate, noise
from eimi_fitting.inference.interval.considered import steps_of
from eimi_fitting.inference.interval.covariance import Linearisation, LinearStates
from eimi_fitting.inference.interval.cross_validation import held_out_error_mm
from eimi_fitting.inference.interval.draws import draw_parameters, interval_95, normal_draws, rounded, thinned
from eimi_fitting.inference.interval.estimate import _ends
from eimi_fitting.inference.interval.identifiability import Direction, directions, held_by_bounds, is_open, statement
from eimi_fitting.inference.interval.profile_likelihood import Ends, _End, moved_to
from eimi_fitting.inference.searching import modulus_range
from eimi_fitting.inference.searching.measured_rest_shape import MeasuredRestShape
from eimi_fitting.inference.searching.modulus_range import NothingConverged, Scan, narrowed
from eimi_fitting.inference.searching.polish import difference_batch

HESSIAN = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -1.0], [0.5, -1.0, 2.0]])


def quadratic(step: Any, gradient: Any, hessian: Any) -> Any:
    return step @ gradient + 0.5 * np.einsum("...i,ij,...j", step, hessian, step)


@pytest.mark.parametrize("seed", range(6))
def test_the_step_to_the_minimum_stays_in_the_cube_and_no_point_of_the_cube_is_lower(seed: int) -> None:
    rng = np.random.default_rng(seed)
    unit, gradient = rng.uniform(size=3), rng.normal(0.0, 3.0, 3)
    step = step_to_minimum(unit, gradient, HESSIAN)
    assert ((unit + step >= -1e-12) & (unit + step <= 1 + 1e-12)).all()
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 21)] * 3), axis=-1).reshape(-1, 3) - unit
    assert quadratic(step, gradient, HESSIAN) <= quadratic(grid, gradient, HESSIAN).min() + 1e-12


def test_a_minimum_inside_the_cube_is_reached() -> None:
    minimum, unit = np.array([0.2, 0.9, 0.4]), np.array([0.5, 0.5, 0.5])
    np.testing.assert_allclose(unit + step_to_minimum(unit, HESSIAN @ (unit - minimum), HESSIAN), minimum)
    corner = np.array([0.0, 1.0, 0.0])  # on the bounds, but inside the cube
    np.testing.assert_allclose(unit + step_to_minimum(unit, HESSIAN @ (unit - corner), HESSIAN), corner, atol=1e-12)


@pytest.mark.parametrize("to", [-0.5, 0.0, 0.3, 0.9, 1.5])
def test_the_point_of_a_profile_has_the_least_value_for_its_coordinate(to: float) -> None:
    point, score = np.array([0.4, 0.5, 0.6]), np.array([0.3, -0.2, 0.1])
    found = moved_to(point, score, HESSIAN, 1, to)
    assert found[1] == np.clip(to, 0.0, 1.0)
    others = np.stack(np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 41)), axis=-1).reshape(-1, 2)
    grid = np.column_stack([others[:, 0], np.full(len(others), found[1]), others[:, 1]])
    lowest = quadratic(grid - point, score, HESSIAN).min()
    assert quadratic(found - point, score, HESSIAN) <= lowest + 1e-12
    assert moved_to(np.array([0.4]), np.array([0.3]), np.array([[2.0]]), 0, 0.7) == pytest.approx([0.7])


def test_central_differences_stay_within_the_bounds() -> None:
    batch, distance = difference_batch(np.array([0.5, 0.995, 0.0]))
    np.testing.assert_allclose(batch[0], [0.5, 0.995, 0.0])
    np.testing.assert_allclose(batch[1:4] - batch[0], np.diag([2e-4, 0.005, 0.01]), atol=1e-12)
    np.testing.assert_allclose(batch[4:] - batch[0], -np.diag([2e-4, 0.01, 0.0]), atol=1e-12)
    np.testing.assert_allclose(distance, [4e-4, 0.015, 0.01])


@pytest.mark.parametrize(
    ("field_mT", "both"),
    [
        ([0.0, 5.0, 10.0], False),
        ([0.0, -5.0, -10.0], False),
        ([10.0, -10.0], True),
        ([10.0, -2.1], True),
        ([10.0, -1.9], False),
        ([-10.0, 2.1], True),
        ([1.9, -10.0], False),
    ],
)
def test_both_polarities_need_a_fifth_of_the_strongest_field(field_mT: list[float], both: bool) -> None:
    assert has_both_polarities(Loads.along(np.array(field_mT), gravity_angle_deg=None)) is both
    assert has_both_polarities(Loads.along(np.array(field_mT), field_angle_deg=70.0, gravity_angle_deg=None)) is both


def edge(points: int, with_noise: bool = True) -> EdgeObservation:
    places = np.zeros((2, 2, points, 2))
    places[..., 0] = np.arange(points)
    sigma = np.tile(np.arange(points, dtype=float) + 1.0, (2, 2, 1))
    return EdgeObservation(places, sigma, noise_mm=0.5 * sigma if with_noise else None)


@pytest.mark.parametrize(
    ("points", "kept"), [(10, 10), (25, 25), (49, 49), (50, 25), (74, 37), (75, 25), (99, 33), (100, 25)]
)
def test_a_search_uses_at_least_25_points_of_each_edge(points: int, kept: int) -> None:
    thin = _thinned(edge(points))
    stride = points // kept
    assert isinstance(thin, EdgeObservation)
    assert thin.points_mm.shape == (2, 2, kept, 2)
    np.testing.assert_array_equal(thin.points_mm[1, 1, :, 0], np.arange(kept) * stride)
    np.testing.assert_array_equal(thin.sigma_mm[1, 0], np.arange(kept) * stride + 1.0)
    assert thin.noise_mm is not None
    np.testing.assert_array_equal(thin.noise_mm, 0.5 * thin.sigma_mm)
    assert _thinned(edge(points, with_noise=False)).noise_mm is None  # type: ignore[union-attr]
    other: Any = SimpleNamespace()
    assert _thinned(other) is other


def comparison(mean_mm: list[float], states: int = 4) -> Any:
    mean = np.array(mean_mm)
    return SimpleNamespace(
        objective_mm=mean,
        error_mm=np.tile(mean[:, None], (1, states)),
        unconverged=mean >= DISCARDED_MM,
        unstable=np.zeros(len(mean), bool),
        misfits=("edges",),
    )


def evaluation(mean_mm: list[float], z: list[list[float]], states: int = 4) -> Evaluation:
    # Return what the search computes for several candidates (sets of parameters).
    # mean_mm : mean error of the edges of each candidate
    # z : standardised residuals of each candidate: of a tensile curve, an uncertain input and a prior on the law
    # states : number of load steps
    columns = [np.array(z)[:, k : k + 1] for k in range(3)]
    return Evaluation(comparison(mean_mm, states), columns[0], columns[1], columns[2], 50.0)


def test_the_objective_is_the_mean_error_times_the_factor_of_the_other_evidence() -> None:
    found = evaluation([0.02, 0.03, 0.02], [[0.0, 0.0, 0.0], [1.0, -2.0, 3.0], [0.0, 0.0, 10.0]])
    np.testing.assert_allclose(found.objective_mm, [0.02, 0.03 * np.exp(14 / 100), 0.02 * np.e])
    np.testing.assert_allclose(found.without_law_priors.objective_mm, [0.02, 0.03 * np.exp(5 / 100), 0.02])
    assert found.standardised.shape == (3, 3)
    assert not found.beyond.any()


def test_evidence_far_away_raises_the_objective_without_an_overflow() -> None:
    at_5, beyond_5 = np.sqrt(2 * 50 * 5.0), np.sqrt(2 * 50 * 7.0)
    found = evaluation([1e-4] * 3, [[at_5, 0.0, 0.0], [beyond_5, 0.0, 0.0], [1e9, 0.0, 0.0]])
    np.testing.assert_allclose(found.objective_mm, [1e-4 * np.exp(5), 3e-4 * np.exp(5), 0.99 * DISCARDED_MM])
    assert found.beyond.tolist() == [False, False, True]
    invalid = evaluation([DISCARDED_MM], [[0.0, 0.0, 0.0]])
    assert invalid.objective_mm.tolist() == [DISCARDED_MM]
    assert not invalid.beyond.any()


def test_other_evidence_is_one_more_state_of_least_squares() -> None:
    found = evaluation([0.02, 0.04, DISCARDED_MM], [[1.0, 2.0, 3.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]], states=8)
    first, additional = found.misfits
    assert first == "edges"
    np.testing.assert_allclose(additional.residuals[0, 0, 0], 0.03 * np.sqrt(8 / 50) * np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(additional.weights, np.full((1, 1, 3), 1 / 3))
    np.testing.assert_allclose(additional.error_mm, np.full((3, 1), 0.03))
    alone = Evaluation(comparison([0.02]), np.zeros((1, 0)), np.zeros((1, 0)), np.zeros((1, 0)), 50.0)
    assert alone.misfits == ("edges",)


@pytest.mark.parametrize(
    ("interval", "is_wide"),
    [
        ((1.0, 4.0), False),
        ((0.3, 0.9), False),
        ((1.0, 4.01), True),
        ((0.0, 1.0), True),
        ((-1.0, 1.0), True),
        ((-2.0, -1.0), True),
    ],
)
def test_a_modulus_is_open_above_four_times_its_lower_end(interval: tuple[float, float], is_wide: bool) -> None:
    assert is_open(Quantity(1.0, "Pa", interval)) is is_wide
    estimate: Any = SimpleNamespace(initial_shear_modulus=Quantity(1.0, "Pa", interval))
    one, two = [SimpleNamespace(loads=[1])], [SimpleNamespace(loads=[1, 2])]
    checks.check_determined(estimate, two)  # type: ignore[arg-type]
    checks.check_determined(estimate, one * 2)  # type: ignore[arg-type]
    if is_wide:
        with pytest.raises(NotDetermined, match="which may lie anywhere from"):
            checks.check_determined(estimate, one)  # type: ignore[arg-type]
    else:
        checks.check_determined(estimate, one)  # type: ignore[arg-type]


def test_a_parameter_is_held_by_bounds_above_half_of_its_variance() -> None:
    slopes = np.array([[1.0, 1.0], [1.0, 0.9], [0.0, 1.0], [1.0, 0.0]])
    is_open_coordinate = np.array([False, True])
    np.testing.assert_array_equal(held_by_bounds(slopes, np.eye(2), is_open_coordinate), [False, False, True, False])
    np.testing.assert_array_equal(held_by_bounds(slopes, np.diag([1.0, 1.1]), is_open_coordinate)[:2], [True, False])


def test_a_direction_names_its_parts_from_a_tenth_on_with_their_signs() -> None:
    vector = np.array([0.9, -0.3, 0.32])
    (best, *_) = directions(("a", "b", "c"), 100 * np.outer(vector, vector), np.eye(3))
    assert best.words == "a with c"  # 0.3² is less than 0.1
    (best, *_) = directions(("a", "b"), np.diag([1.0, 9.0]), np.diag([1.0, 3.0]))
    assert (best.words, best.remaining) == ("b", pytest.approx(0.5))  # 1 / sqrt(1 + 9 / 3)


def said(**changed: Any) -> str:
    given: dict[str, Any] = {
        "names": ("mu", "alpha", "scale"),
        "law_coordinates": 2,
        "not_fixed": (),
        "correlation": np.eye(3),
        "eigen": (),
        "ratios": ("scale",),
        "remaining": (0.01, 0.02, 0.5),
        "modulus": Quantity(50e3, "Pa", (49e3, 51e3)),
    }
    return statement(**(given | changed))


def correlated(rho: float) -> Any:
    matrix = np.eye(3)
    matrix[0, 2] = matrix[2, 0] = rho
    return matrix


def test_the_statement_about_the_unknowns() -> None:
    whole = "determine every parameter of this law; the 95 % interval of the initial shear modulus is ±2 %."
    assert said() == f"These data and the given priors {whole}"
    assert said(names=("mu", "alpha"), correlation=np.eye(2)) == f"These data {whole}"
    assert said(names=("mu", "alpha"), correlation=np.eye(2), priors=True) == f"These data and the given priors {whole}"
    best = (Direction("mu with alpha", 0.01),)
    assert said(eigen=best).endswith(" The best determined combination is mu with alpha.")
    assert "best determined" not in said(eigen=(Direction("mu", 0.01),))
    assert "best determined" not in said(eigen=best, not_fixed=("alpha",))
    rough = said(remaining=(0.01, 0.3, 0.5))
    assert (
        "determine only mu; the 95 % interval of the initial shear modulus is ±2 %, and alpha is known only to "
        "within 34 % of the range of the search."
    ) in rough
    assert said(remaining=(0.01, 0.25, 0.5)) == said()
    lopsided = said(modulus=Quantity(50e3, "Pa", (40e3, 65e3)))
    assert "is -20 % to +30 %." in lopsided
    nothing = said(not_fixed=("mu", "alpha"), modulus=Quantity(50e3, "Pa", (1e3, 123456.0)))
    assert nothing == (
        "These data and the given priors determine no parameter of this law, not even its initial shear modulus, which "
        "may lie anywhere from 1000 to 1.235e+05 Pa."
    )
    three = said(names=("mu", "a", "b", "scale"), law_coordinates=3, correlation=np.eye(4), not_fixed=("b",))
    assert three.startswith(
        "These data and the given priors determine mu and a; the 95 % interval of the initial shear modulus is ±2 %"
    )
    assert three.endswith("; they do not determine b, whose intervals are set by the bounds of the search.")


@pytest.mark.parametrize(
    ("rho", "words"), [(0.95, "ratio"), (-0.95, "combination"), (0.9, None), (-0.89, None), (0.901, "ratio")]
)
def test_a_correlated_nuisance_is_named(rho: float, words: str | None) -> None:
    text = said(correlation=correlated(rho))
    if words is None:
        assert "correlated" not in text
    else:
        assert (
            f" mu and scale are correlated by {rho:+.3f}: the data determine their {words} only, and the prior on scale"
            in text
        )
    assert ("combination" in said(correlation=correlated(rho), ratios=())) is (words is not None)


def test_draws_are_normal_and_independent_and_every_tenth_is_kept() -> None:
    drawn = normal_draws(np.random.default_rng(3), 2)
    assert drawn.shape == (4000, 2)
    np.testing.assert_allclose(drawn.mean(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(drawn.std(axis=0), 1.0, atol=2e-3)
    assert abs(np.mean(drawn[:, 0] * drawn[:, 1])) < 0.05
    kept = thinned(drawn[:, 0])
    assert len(set(kept.tolist())) == 400
    ranks = np.argsort(np.argsort(drawn[:, 0]))[kept]
    np.testing.assert_array_equal(ranks, np.arange(5, 4000, 10))
    assert interval_95(np.arange(1001.0)) == (25.0, 975.0)


def test_parameters_are_drawn_with_their_intervals_and_their_correlation() -> None:
    values, intervals = np.array([10.0, 5.0]), np.array([[8.0, 13.0], [4.0, 6.0]])
    correlation = np.array([[1.0, -0.8], [-0.8, 1.0]])
    found = draw_parameters(("a", "b"), values, intervals, correlation, lambda drawn: drawn[:, 0], seed=5)
    assert (found.seed, found.names, np.shape(found.values)) == (5, ("a", "b"), (400, 2))
    assert interval_95(found.column("a")) == pytest.approx((8.0, 13.0), abs=0.06)
    assert interval_95(found.column("b")) == pytest.approx((4.0, 6.0), abs=0.15)
    assert np.median(found.column("a")) == pytest.approx(10.0, abs=0.02)
    assert np.corrcoef(found.column("a"), found.column("b"))[0, 1] == pytest.approx(-0.8, abs=0.06)
    with pytest.raises(ValueError, match="tuple"):
        found.column("c")
    again = draw_parameters(("a", "b"), values, intervals, correlation, lambda drawn: drawn[:, 0])
    assert again.seed == 1


def test_numbers_are_stored_with_seven_digits() -> None:
    given = np.array([0.0, 1.23456789, -1234567.89, 9.87654321e-12])
    np.testing.assert_array_equal(rounded(given), [0.0, 1.234568, -1234568.0, 9.876543e-12])
    assert draws.quantity(2.0, "Pa", np.arange(1001.0), np.arange(1001.0) / 10) == Quantity(
        2.0, "Pa", (25.0, 975.0), (2.5, 97.5)
    )


def states_of(residuals: np.ndarray, slopes: np.ndarray) -> LinearStates:
    # Return K load steps of one edge with m points, all with the weight 1.
    # residuals : shape (K, m)
    # slopes : derivatives of the residuals with respect to n unknowns, shape (n, K, m)
    count = np.full(len(residuals), float(residuals.shape[1]))
    error = np.sqrt((residuals**2).mean(axis=1))
    return LinearStates(
        residuals[:, None], slopes[:, :, None], np.ones_like(residuals)[:, None], np.ones(len(residuals)), count, error
    )


@pytest.mark.parametrize(("states", "folds"), [(6, 5), (3, 5), (6, 2), (2, 5)])
def test_the_error_of_omitted_states_is_that_of_fits_without_them(states: int, folds: int) -> None:
    # The model is linear, so that one step from the fit to all states gives the exact fit without a group of states.
    rng = np.random.default_rng(states + folds)
    slopes, data = rng.normal(size=(2, states, 5)), rng.normal(size=(states, 5))
    rows = slopes.transpose(1, 2, 0)
    whole = np.linalg.lstsq(rows.reshape(-1, 2), data.ravel(), rcond=None)[0]
    linear = states_of(data - rows @ whole, -slopes)
    errors = []
    for fold in range(min(folds, states)):
        out = np.arange(states) % min(folds, states) == fold
        fitted = np.linalg.lstsq(rows[~out].reshape(-1, 2), data[~out].ravel(), rcond=None)[0]
        errors += [np.sqrt(((data[k] - rows[k] @ fitted) ** 2).mean()) for k in np.flatnonzero(out)]
    assert held_out_error_mm([linear], linear.information, folds) == pytest.approx(np.mean(errors))
    half = [states_of(data[k] - rows[k] @ whole, -slopes[:, k]) for k in (np.s_[:1], np.s_[1:])]
    assert held_out_error_mm(half, linear.information, folds) == pytest.approx(np.mean(errors))


def test_the_error_of_an_omitted_state_needs_two_states() -> None:
    assert held_out_error_mm([states_of(np.ones((1, 5)), np.ones((1, 1, 5)))], np.eye(1)) is None


MODULI = np.geomspace(1e2, 1e8, 13)


def scan(*valid_mm: float, first: int = 5) -> Scan:
    # Return a scan of 13 moduli, two for each factor of ten.
    # valid_mm : errors of the fit at the moduli from the index `first` on; other moduli have no equilibrium
    objective = np.full(len(MODULI), DISCARDED_MM)
    objective[first : first + len(valid_mm)] = valid_mm
    return Scan(MODULI, objective)


def test_the_bounds_of_the_search_lie_three_decades_about_the_best_modulus() -> None:
    found = scan(0.5, 0.1, 0.4, 0.6)
    assert (found.best_mm, found.best_Pa) == (0.1, pytest.approx(1e5))
    assert found.searched() == pytest.approx((1e5 / 10**1.5, 1e5 * 10**1.5), rel=0.02)
    assert Scan(MODULI, np.linspace(2.0, 1.0, 13)).unmoved_mm == 1.0


def test_the_bounds_of_the_search_contain_all_moduli_that_are_as_good() -> None:
    # Moduli within 2 % of the smallest error span a factor 10^2.5; half a decade is added at both ends.
    found = scan(0.1, 0.1019, 0.5, 0.1, 0.1, 0.1019, 0.1021, first=2)
    assert found.searched() == pytest.approx((10**2.5, 10**6.0), rel=0.02)


def test_without_a_valid_modulus_the_whole_range_is_searched() -> None:
    assert scan().searched() == (pytest.approx(1e2), pytest.approx(1e8))


def test_a_scan_is_narrowed_about_its_best_modulus_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[np.ndarray] = []

    def evaluated(problem: Any, moduli: np.ndarray, independent_points: float) -> Any:
        asked.append(moduli)
        return SimpleNamespace(objective_mm=np.abs(np.log10(moduli) - 5.1))

    monkeypatch.setattr(modulus_range, "evaluated", evaluated)
    found = narrowed(SimpleNamespace(), Scan(MODULI, np.abs(np.log10(MODULI) - 5.1)), 50.0)  # type: ignore[arg-type]
    assert [len(moduli) for moduli in asked] == [9, 9]
    np.testing.assert_allclose(np.log10(asked[0]), 5.0 + np.linspace(-0.5, 0.5, 9))
    np.testing.assert_allclose(np.log10(asked[1]), 5.125 + np.linspace(-0.125, 0.125, 9))
    assert len(found.moduli_Pa) == 13 + 18
    assert (np.diff(found.moduli_Pa) >= 0).all()
    assert np.log10(found.best_Pa) == pytest.approx(5.1, abs=0.016)


@pytest.mark.parametrize(
    ("per_Pa", "expected"),
    [
        (1e6, 1e6),  # the displacement over the length is 1e6 / modulus
        (1e2, 1e2),
        (1e13, 1e13),
    ],
)
def test_the_compliance_is_that_of_a_beam_that_bends_by_a_thousandth(
    monkeypatch: pytest.MonkeyPatch, per_Pa: float, expected: float
) -> None:
    tried: list[float] = []

    def bent(problem: Any, modulus: float) -> float:
        tried.append(modulus)
        return per_Pa / modulus

    monkeypatch.setattr(modulus_range, "_bent", bent)
    assert modulus_range._compliance(SimpleNamespace()) == pytest.approx(expected)  # type: ignore[arg-type]
    assert per_Pa / tried[-1] <= 1e-3
    assert all(per_Pa / modulus > 1e-3 for modulus in tried[:-1])
    monkeypatch.setattr(modulus_range, "_bent", lambda problem, modulus: float("inf"))
    with pytest.raises(NothingConverged, match=r"even with a shear modulus of 1e\+18 Pa no beam can be simulated"):
        modulus_range._compliance(SimpleNamespace())  # type: ignore[arg-type]


def misfit(error_mm: list[float]) -> Misfit:
    error = np.array([error_mm])
    return Misfit(np.zeros((1, len(error_mm), 2, 4)), np.ones((len(error_mm), 2, 4)), error, error)


def experiment(sigma_mm: float, states: int, noise_mm: float | None = None) -> Any:
    observed = EdgeObservation(
        np.zeros((states, 2, 4, 2)),
        np.full((states, 2, 4), sigma_mm),
        noise_mm=None if noise_mm is None else np.full((states, 2, 4), noise_mm),
    )
    model = SimpleNamespace(specimen=SimpleNamespace(width_mm=2.0))
    return Observed(observed, model)


class Observed:
    # A replacement for an experiment with the edges of a beam of 2 mm width.

    def __init__(self, observed: EdgeObservation, model: Any) -> None:
        self.observed, self.model = observed, model


@pytest.fixture
def deflected(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    # Replace the largest deflection of every experiment by the value `mm` of the returned dictionary, at first 10.
    largest = {"mm": 10.0}
    monkeypatch.setattr(checks, "deflection_mm", lambda experiment: largest["mm"])
    monkeypatch.setattr(
        checks,
        "replace",
        lambda one, **new: Observed(new["observed"], one.model) if isinstance(one, Observed) else replace(one, **new),
    )
    return largest


@pytest.mark.parametrize(
    ("error_mm", "deflection_mm", "sigma_mm", "worst"),
    [
        ([0.1, 0.49, 0.2], 10.0, 0.01, None),  # a twentieth of the deflection
        ([0.1, 0.51, 0.2], 10.0, 0.01, 1),
        ([0.1, 0.99, 0.2], 100.0, 0.01, None),  # half the width of the beam
        ([0.1, 0.2, 1.01], 100.0, 0.01, 2),
        ([0.59, 0.1, 0.1], 10.0, 0.2, None),  # three times the stated uncertainty
        ([0.61, 0.1, 0.1], 10.0, 0.2, 0),
        ([float("nan"), 0.1, 0.1], 10.0, 0.2, 0),
    ],
)
def test_a_state_is_explained_within_its_deflection_width_or_noise(
    deflected: dict[str, float], error_mm: list[float], deflection_mm: float, sigma_mm: float, worst: int | None
) -> None:
    deflected["mm"] = deflection_mm
    final: Any = SimpleNamespace(misfits=(misfit([0.01] * 3), misfit(error_mm)))
    experiments = [experiment(sigma_mm, 3)] * 2
    if worst is None:
        checks.check_explained(final, experiments)
        with pytest.raises(NotExplained) as caught:
            checks.check_explained(final, experiments, beyond=True)
        assert (caught.value.experiment, caught.value.state) == (0, 0)
        return
    with pytest.raises(NotExplained) as caught:
        checks.check_explained(final, experiments)
    assert (caught.value.experiment, caught.value.state) == (1, worst)
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.state) == (str(caught.value), worst)
    assert "tensile curves" not in str(again)
    with pytest.raises(NotExplained, match=r"and the tensile curves; .*, and material, unit and weight of the curves"):
        checks.check_explained(final, experiments, curves=True)
    with pytest.raises(NotExplained, match=r"of the beam with the priors C10 = 2 and C01 = 1; check value and unit"):
        checks.check_explained(final, experiments, priors=["C10 = 2", "C01 = 1"])


def test_an_error_that_a_displaced_clamp_explains_is_not_refused(deflected: dict[str, float]) -> None:
    final: Any = SimpleNamespace(misfits=(misfit([0.9, 0.1]),))
    checks.check_explained(final, [experiment(0.01, 2)], without_clamp=[np.array([0.4, 0.5])])
    with pytest.raises(NotExplained):
        checks.check_explained(final, [experiment(0.01, 2)], without_clamp=[np.array([0.6, 0.0])])


def test_residuals_above_the_noise_and_single_states_are_doubts(deflected: dict[str, float]) -> None:
    def kinds(error_mm: list[float], **stated: Any) -> list[tuple[str | None, int | None]]:
        final: Any = SimpleNamespace(misfits=(misfit(error_mm),))
        found = checks.doubts(final, [experiment(stated.pop("sigma", 0.01), len(error_mm), **stated)])
        assert all(doubt.dataset == 0 for doubt in found)
        return [(doubt.kind, doubt.state) for doubt in found]

    assert kinds([0.099] * 3) == []
    assert kinds([0.101] * 3) == [("beyond_noise", None)]
    assert kinds([0.02, 0.02, 0.101]) == [("state_stands_out", 2)]
    assert kinds([0.0205, 0.0205, 0.101]) == []  # not five times the median error
    assert kinds([0.01, 0.01, 0.099]) == []  # not ten times the noise
    assert kinds([0.101] * 3, sigma=1.0, noise_mm=0.01) == [("beyond_noise", None)]  # flags do not hide a wrong law
    final: Any = SimpleNamespace(misfits=(misfit([0.01]), misfit([0.01])))
    missing = checks.doubts(final, [experiment(0.01, 1)] * 2, ("no mesh",))
    assert [(doubt.words, doubt.dataset, doubt.kind) for doubt in missing] == [
        ("no mesh", 0, "correction_missing"),
        ("no mesh", 1, "correction_missing"),
    ]


def test_curves_and_priors_are_doubted_beyond_three_standard_deviations() -> None:
    curves: Any = [SimpleNamespace(noise_Pa=100.0)] * 3
    found = checks.curve_doubts(curves, [301.0, 299.0, 500.0])
    assert [(doubt.curve, doubt.kind) for doubt in found] == [(0, "curve_contradicts"), (2, "curve_contradicts")]
    priors = [Prior("mu", 1000.0, 10.0)] * 4
    doubted = checks.prior_doubts(priors, [3.1, 2.9, -3.1, -2.9])
    assert len(doubted) == 2
    assert all("differs from the prior on mu, 1000 ± 10, by 3.1 standard deviations" in d.words for d in doubted)


def cause(name: str, probability: float, like: tuple[str, ...] = ()) -> Cause:
    fields: dict[str, Any] = {
        "name": name,
        "probability": probability,
        "like": like,
        "value": 0.02,
        "unit": "1",
        "shift_percent": 1.0,
        "decide_by": "a ruler",
    }
    return Cause(**{key: value for key, value in fields.items() if key in Cause.__dataclass_fields__})


def test_rivals_have_a_tenth_of_the_probability_and_are_not_present_together() -> None:
    def names(*causes: Cause) -> list[str]:
        return [one.name for one in cause_doubts.rivals(causes)]

    assert names(cause("a", 0.8), cause("b", 0.081), cause("c", 0.079)) == ["b"]
    assert names(cause("a", 0.7), cause("b", 0.51)) == []  # together above 1.2: both are present
    assert names(cause("a", 0.7), cause("b", 0.49)) == ["b"]
    assert names(cause("a", 0.4), cause("b", 0.3), cause("c", 0.2), cause("d", 0.1)) == ["b", "c"]
    assert names(cause("a", 0.5, ("c",)), cause("b", 0.4), cause("c", 0.01)) == ["c"]


def evidence(unit: tuple[float, float] = (0.5, 0.4)) -> Linearisation:
    # Return the linearised residuals of a fit with two unknowns: a parameter of the law and an uncertain input.
    # unit : values of both unknowns, scaled to 0 to 1
    rng = np.random.default_rng(8)
    states = replace(states_of(rng.normal(size=(2, 5)), rng.normal(size=(2, 2, 5))), weights=np.array([2.0, 3.0]))
    curve_slopes = rng.normal(size=(2, 2))
    return Linearisation(
        unit=np.array(unit),
        objective_mm=1.0,
        states=(states,),
        points=10,
        independent_points=10.0,
        likelihood_points=10.0,
        noise_points=10.0,
        noise_mm=1.0,
        residual_mm=1.0,
        curves=rng.normal(size=2),
        curve_slopes=curve_slopes,
        priors=np.array([0.7]),
        law_priors=np.array([-1.3]),
        law_prior_slopes=np.array([[1.5], [0.4]]),
        information=states.information + curve_slopes @ curve_slopes.T,
        score_variance=np.array([[2.0, 0.3], [0.3, 1.0]]),
        prior=np.diag([0.5, 4.0]),
    )


def minus_log_likelihood(about: Linearisation, step: np.ndarray, law_prior: bool = True) -> float:
    # Return minus the log-likelihood of two unknowns, up to a constant, at a step (2,) from the optimum of `about`.
    # law_prior : whether the prior on the parameter of the law is included
    (states,) = about.states
    residuals = states.residuals + np.tensordot(step, states.slopes, axes=1)
    curves = about.curves + step @ about.curve_slopes
    nuisance = 0.7 + 2.0 * step[1]  # the root of its inverse variance is 2
    prior = about.law_priors + step @ about.law_prior_slopes if law_prior else np.zeros(1)
    squares = (states.weights * (residuals**2).sum(axis=(1, 2))).sum() + (curves**2).sum() + nuisance**2
    return 0.5 * float(squares + 0.5 * step[0] ** 2 + (prior**2).sum())


def test_score_and_hessian_are_the_derivatives_of_the_log_likelihood() -> None:
    about, h = evidence(), 1e-3
    eye = h * np.eye(2)
    slope = [(minus_log_likelihood(about, e) - minus_log_likelihood(about, -e)) / (2 * h) for e in eye]
    np.testing.assert_allclose(about.score, slope, rtol=1e-6)
    curvature = [
        [
            (
                minus_log_likelihood(about, a + b)
                - minus_log_likelihood(about, a - b)
                - minus_log_likelihood(about, b - a)
                + minus_log_likelihood(about, -a - b)
            )
            / (4 * h * h)
            for a in eye
        ]
        for b in eye
    ]
    np.testing.assert_allclose(about.hessian, curvature, rtol=1e-5)


def test_the_score_of_candidates_has_the_weights_of_their_errors() -> None:
    about = evidence()
    (states,) = about.states
    seen = Misfit(
        np.stack([states.residuals, 2 * states.residuals]),
        states.used,
        np.stack([states.error_mm, 2 * states.error_mm]),
        np.zeros((2, 2)),
    )
    curves, priors = np.tile(about.curves, (2, 1)), np.tile(about.priors, (2, 1))
    candidates: Any = SimpleNamespace(curves=curves, priors=priors, comparison=SimpleNamespace(misfits=(seen,)))
    expected = about.score - about.law_prior_slopes @ about.law_priors
    # Doubled residuals have half the weight, so that the score of the states is the same.
    np.testing.assert_allclose(about.score_of(candidates), [expected, expected])


@pytest.fixture
def deviance(monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Linearisation]:
    # A function for the deviance (twice the decrease of the log-likelihood), and the linearised residuals.
    rng, unit = np.random.default_rng(4), np.array([0.5, 0.4])
    start, slopes = rng.normal(size=(2, 2, 3)), rng.normal(size=(2, 2, 2, 3))

    def evaluated(units: np.ndarray, points: float, near: object = None) -> Evaluation:
        residuals = start + np.einsum("pi,ikgn->pkgn", units - unit, slopes)
        error = np.sqrt((residuals**2).mean(axis=(2, 3)))
        valid = units[:, 0] <= 0.9
        objective = np.where(valid, error.mean(axis=1), DISCARDED_MM)
        found: Any = SimpleNamespace(
            objective_mm=objective, error_mm=error, misfits=(SimpleNamespace(residuals=residuals, error_mm=error),)
        )
        none, law_priors = np.zeros((len(units), 0)), -1.3 + (units - unit) @ np.array([[1.5], [0.4]])
        return Evaluation(found, none, none, law_priors, points)

    points = 9.0
    error = evaluated(unit[None], points).comparison.error_mm[0]
    states = LinearStates(
        start, slopes, np.ones((2, 2, 3)), points / (2 * error.mean() * 6 * error), np.full(2, 6.0), error
    )
    about = replace(
        evidence(),
        states=(states,),
        objective_mm=float(error.mean()),
        likelihood_points=points,
        curves=np.zeros(0),
        curve_slopes=np.zeros((2, 0)),
        priors=np.zeros(0),
        prior=np.diag([0.5, 4.0]),
    )
    given: list[Any] = []
    monkeypatch.setattr(
        "eimi_fitting.inference.interval.estimate.interval_ends", lambda *arguments: given.extend(arguments)
    )
    problem: Any = SimpleNamespace(
        evaluate=evaluated, unknowns=SimpleNamespace(searched=2, space=SimpleNamespace(has_bulk=False))
    )
    optimum: Any = SimpleNamespace(evaluation=SimpleNamespace(comparison=SimpleNamespace(near=None)))
    _ends(problem, about, optimum, np.ones(2), (0, 1))
    return given[0], about


@pytest.mark.parametrize("at", [(0.5, 0.4), (0.8, 0.1), (0.1, 0.9)])
def test_the_score_of_a_profile_is_half_the_gradient_of_its_deviance(
    deviance: tuple[Any, Linearisation], at: tuple[float, float]
) -> None:
    of, h = deviance[0], 1e-5
    point = np.array(at)
    (_, score), ends = of(point[None]), np.concatenate([point + h * np.eye(2), point - h * np.eye(2)])
    values, _ = of(ends)
    np.testing.assert_allclose(score[0], (values[:2] - values[2:]) / (4 * h), rtol=1e-5)


def test_the_deviance_of_a_profile_is_zero_at_the_optimum_and_infinite_for_an_invalid_candidate(
    deviance: tuple[Any, Linearisation],
) -> None:
    of, about = deviance
    values, scores = of(np.array([about.unit, [0.95, 0.4]]))
    assert values[0] == pytest.approx(0.0, abs=1e-9)
    assert values[1] == np.inf
    assert np.isfinite(scores).all()


@pytest.mark.parametrize(
    ("remaining", "unit", "high_Pa", "not_fixed", "at_bound"),
    [
        ((0.9, 0.9), (0.5, 0.4), 2.1e4, ("mu",), ()),
        ((0.1, 0.9), (0.0005, 0.4), 2.1e4, (), ("mu",)),
        ((0.1, 0.1), (0.9995, 0.0), 2.1e4, (), ("mu",)),
        ((0.1, 0.1), (0.5, 0.4), 9e4, ("mu",), ()),  # the interval of the modulus is open
    ],
)
def test_only_unknowns_of_the_law_can_be_open_or_at_a_bound(
    monkeypatch: pytest.MonkeyPatch,
    remaining: tuple[float, float],
    unit: tuple[float, float],
    high_Pa: float,
    not_fixed: tuple[str, ...],
    at_bound: tuple[str, ...],
) -> None:
    # The second unknown is an uncertain input, which its prior limits.
    given: dict[str, Any] = {}
    monkeypatch.setattr(estimate, "statement", lambda *arguments: given.update(statement=arguments) or "words")
    monkeypatch.setattr(estimate, "held_by_bounds", lambda *arguments: given.update(held=arguments) or np.array([True]))
    space = SimpleNamespace(names=("mu",), law=SimpleNamespace(parameter_names=("mu",)))
    unknowns = SimpleNamespace(
        names=("mu", "width"), searched=1, space=space, parameters=lambda units: 2e4 * units[:, :1], ratios=()
    )
    about, covariance = evidence(unit), np.array([[0.04, 0.012], [0.012, 0.09]])
    found = estimate._identifiability(
        SimpleNamespace(unknowns=unknowns, priors=("a prior",)),  # type: ignore[arg-type]
        about,
        noise.Explained(about.states, about.hessian, 0.49),
        covariance,
        np.array(remaining),
        Ends(np.zeros(2), np.ones(2), (1,)),
        Quantity(2e4, "Pa", (1.9e4, high_Pa), (1.9e4, high_Pa)),
    )
    slopes, of_covariance, is_open_coordinate = given["held"]
    np.testing.assert_allclose(slopes, [[2e4, 0.0]], rtol=1e-9)
    assert of_covariance is covariance
    assert is_open_coordinate.tolist() == [bool(not_fixed), False]
    assert (found.not_fixed, found.at_bound, found.held_by_bounds) == (not_fixed, at_bound, ("mu",))
    assert (found.statement, found.profiled, found.stated_squares) == ("words", ("width",), 0.49)
    np.testing.assert_allclose(found.correlation, [[1.0, 0.2], [0.2, 1.0]])
    assert given["statement"][1:3] == (1, not_fixed)
    assert given["statement"][-1] is True


def test_the_distance_of_a_prior_is_that_from_the_optimum_without_it() -> None:
    # Distance: (prior - optimum without the prior) / sqrt(sum of both variances).
    about = evidence()
    shift = np.linalg.solve(about.hessian, about.score)
    at_optimum = replace(about, law_priors=about.law_priors - shift @ about.law_prior_slopes)
    others = about.hessian - about.law_prior_information
    score = about.score - about.law_prior_slopes @ about.law_priors
    without = about.law_priors - np.linalg.solve(others, score) @ about.law_prior_slopes
    variance = 1 + about.law_prior_slopes[:, 0] @ np.linalg.solve(others, about.law_prior_slopes[:, 0])
    assert at_optimum.prior_distances() == pytest.approx([float(without[0]) / np.sqrt(variance)])


def test_the_covariance_is_that_of_the_sandwich() -> None:
    about = evidence()
    inverse = np.linalg.inv(about.hessian)
    middle = about.score_variance + about.prior + about.law_prior_information
    np.testing.assert_allclose(about.covariance(), inverse @ middle @ inverse)
    more = about.covariance(2.0) - about.covariance()
    np.testing.assert_allclose(more, 3.0 * inverse @ about.score_variance @ inverse)


def test_a_source_moves_the_optimum_as_a_refit_with_its_residuals() -> None:
    about = evidence()
    (states,) = about.states
    change = np.random.default_rng(2).normal(size=states.residuals.shape)
    sources: Any = [SimpleNamespace(changes=(change,)), SimpleNamespace(changes=(None,))]
    found = steps_of(about, sources, np.eye(2))
    moved = replace(about, states=(replace(states, residuals=states.residuals + change),))
    expected = -np.linalg.solve(about.hessian, moved.score) + np.linalg.solve(about.hessian, about.score)
    np.testing.assert_allclose(found.sizes, [expected, np.zeros(2)], atol=1e-12)
    np.testing.assert_array_equal(found.without_bounds, np.zeros(2))  # no unknown lies on a bound


@pytest.mark.parametrize("spread", [10.0, 0.01])
def test_an_optimum_on_a_bound_is_centred_at_most_two_deviations_beyond(spread: float) -> None:
    sign = np.sign(evidence().score)
    unit = tuple(0.0 if s > 0 else 1.0 for s in sign)  # both bounds hold the optimum
    about = evidence(unit)  # type: ignore[arg-type]
    nothing: Any = [SimpleNamespace(changes=(None,))]
    covariance = spread**2 * np.eye(2)
    free = -np.linalg.solve(about.hessian, about.score)
    share = min(1.0, 2.0 * spread / np.abs(free).max())
    np.testing.assert_allclose(steps_of(about, nothing, covariance).without_bounds, share * free)
    assert not steps_of(about, [], covariance).without_bounds.any()
    inward = evidence(tuple(1.0 - u for u in unit))  # type: ignore[arg-type]
    assert not steps_of(inward, nothing, covariance).without_bounds.any()


def test_a_measured_rest_shape_is_described_and_replaces_the_stated_one() -> None:
    def shape(bends: tuple[float, ...], widths: tuple[float, ...]) -> MeasuredRestShape:
        return MeasuredRestShape(SimpleNamespace(), bends, widths, 0.01, 0.004)  # type: ignore[arg-type]

    assert shape((0.0, 0.0), (0.0, 0.0)).in_words == ""
    assert shape((0.0,), (-0.02, 0.05)).in_words == "its width varies by up to 0.1 mm"
    assert shape((0.9, 0.0), (0.0,)).in_words == "bent by up to 0.9 mm"
    assert shape((-0.9, 0.0), (0.02,)).in_words == "bent by up to 0.9 mm, its width varies by up to 0.04 mm"


def noisy(error_mm: list[float], seed: int = 4) -> LinearStates:
    # Return load steps whose residuals are white noise; each has two edges of 40 points.
    # error_mm : root mean square of the residuals of each load step
    rng = np.random.default_rng(seed)
    residuals = rng.normal(size=(len(error_mm), 2, 40))
    residuals *= (np.array(error_mm) / np.sqrt((residuals**2).mean(axis=(1, 2))))[:, None, None]
    states = LinearStates(
        residuals,
        rng.normal(size=(1, *residuals.shape)),
        np.ones_like(residuals),
        np.ones(len(error_mm)),
        np.full(len(error_mm), 80.0),
        np.array(error_mm),
    )
    return states


def problem_of(*states: LinearStates) -> Any:
    experiments = []
    for one in states:
        shape = one.residuals.shape
        experiments.append(SimpleNamespace(observed=EdgeObservation(np.zeros((*shape, 2)), np.ones(shape))))
    return SimpleNamespace(experiments=tuple(experiments))


def test_a_state_weighs_as_its_share_of_all_independent_points() -> None:
    # The weight is w_k = N / (K e N_k e_k), so that the sum of w_k N_k e_k² is N. For state k of K: N_k points with the
    # RMS error e_k, which contains the error of the beam model; N: all independent points; e: mean error.
    states = [noisy([0.01, 0.03]), noisy([0.02], seed=5)]
    problem = problem_of(*states)
    model_mm = [np.array([0.0, 0.04]), np.array([0.0])]
    points = noise._independent(problem, states)
    assert 80.0 < points <= 240.0
    weighted = noise._with_weights(problem, states, model_mm)
    errors = np.array([0.01, 0.05, 0.02])
    weights = np.concatenate([one.weights for one in weighted])
    np.testing.assert_allclose(weights, points / (errors.sum() * 80.0 * errors))
    assert noise._mean_mm(states) == pytest.approx(0.02)


def test_a_shift_in_common_is_explained_by_the_source_and_the_noise_remains() -> None:
    # The residuals are noise and the effect of 1.5 standard uncertainties of one input.
    clean = noisy([0.01, 0.01, 0.01])
    change = np.full_like(clean.residuals, 0.05)
    spoilt = noise._with_residuals(clean, clean.residuals + 1.5 * change)
    slopes = noise._with_sources(1e-9 * clean.slopes, [change])
    states = [replace(spoilt, slopes=slopes)]
    np.testing.assert_allclose(slopes[1], 12.0 * change)  # a unit coordinate spans six standard uncertainties a side
    prior = np.diag([12.0, 144.0])
    unit = np.array([0.5, 0.5])
    best, remaining = noise._least(problem_of(clean), states, unit, unit, prior, [np.zeros(3)])
    assert 12.0 * (0.5 - best[1]) == pytest.approx(1.5, abs=0.05)
    assert best[0] == pytest.approx(0.5, abs=1e-3)
    assert noise._mean_mm(remaining) == pytest.approx(0.01, rel=0.03)
    np.testing.assert_allclose(remaining[0].residuals, clean.residuals, atol=0.003)
    assert noise._with_sources(clean.slopes, [None])[1].any() is np.False_


def test_without_uncertain_inputs_the_noise_is_that_of_all_residuals(monkeypatch: pytest.MonkeyPatch) -> None:
    about, given = evidence(), SimpleNamespace(unit=np.array([0.5, 0.4]))
    monkeypatch.setattr(noise, "linearise", lambda problem, optimum: about)
    monkeypatch.setattr(noise, "considered", lambda problem, unit: ())
    found = noise.linearise_noise(SimpleNamespace(), given)  # type: ignore[arg-type]
    assert found.about is about
    assert found.explained.states is about.states
    assert found.explained.squares == pytest.approx(0.49)  # one nuisance, 0.7 standard deviations from its stated value


def test_the_value_of_a_fit_counts_errors_and_squared_deviations() -> None:
    states = [noisy([0.03, 0.01])]
    unknowns: Any = SimpleNamespace(standardised=lambda unit: np.tile([1.0, 2.0], (len(unit), 1)))
    found = noise._value(unknowns, np.zeros(2), states, [np.array([0.04, 0.0])], 50.0)
    assert found == pytest.approx(0.03 * np.exp(5.0 / 100.0))


def test_slopes_are_central_differences() -> None:
    rng = np.random.default_rng(0)
    slopes, distance = rng.normal(size=(2, 1, 2, 3)), np.array([0.1, 0.4])
    middle = rng.normal(size=(1, 2, 3))
    half = 0.5 * distance[:, None, None, None] * slopes
    batch = np.concatenate([middle[None], middle + half, middle - half])
    seen = Misfit(batch, np.ones((1, 2, 3)), np.zeros((5, 1)), np.zeros((5, 1)))
    np.testing.assert_allclose(noise._slopes(seen, distance), slopes)


def test_the_error_of_the_beam_model_is_what_the_corrections_leave() -> None:
    # Changes of 0.1 and 0.2 mm, of which at most a tenth and at most half remain (95 %); root sum of squares.
    shape = (2, 2, 5)
    effects = [
        noise.Effect(SimpleNamespace(changes=[np.full(shape, size)]), np.zeros(1), share)  # type: ignore[arg-type]
        for size, share in ((0.1, 0.1), (0.2, 0.5))
    ]
    seen = Misfit(np.zeros((1, *shape)), np.ones(shape), np.zeros((1, 2)), np.zeros((1, 2)))
    optimum: Any = SimpleNamespace(evaluation=SimpleNamespace(comparison=SimpleNamespace(misfits=(seen,))))
    (found,) = noise._model_mm(optimum, effects)
    np.testing.assert_allclose(found, np.full(2, np.hypot(0.01, 0.1) / 1.959964), rtol=1e-6)
    np.testing.assert_array_equal(noise._model_mm(optimum, ())[0], [0.0, 0.0])
    refinement = SimpleNamespace(remaining_share=0.3)
    own = noise.Effect(SimpleNamespace(changes=[], refinement=refinement), np.zeros(1))  # type: ignore[arg-type]
    assert (own.remaining_share, effects[1].remaining_share, own.least_percent) == (0.3, 0.5, 0.0)


def end(**changed: Any) -> _End:
    # Return one step in the search for the upper end of an interval, where the deviance is 4.
    # Two unknowns with the optimum at (0.5, 0.5); the search is at (0.6, 0.5). changed : attributes with other values
    given: dict[str, Any] = {"coordinate": 0, "side": 1, "target": 4.0, "point": np.array([0.6, 0.5])}
    return _End(**(given | changed))


@pytest.mark.parametrize(
    ("deviance", "at", "converged"),
    [
        (4.11, 0.6, True),  # within 3 per cent of the target
        (3.89, 0.6, True),
        (4.13, 0.6, False),
        (3.87, 0.6, False),
        (1.0, 1.0, True),  # the bound of the coordinate is the end
        (5.0, 1.0, False),
        (1.0, 0.0, True),
        (1.0, 0.99, False),
    ],
)
def test_an_end_has_converged_near_its_target_or_on_a_bound(deviance: float, at: float, converged: bool) -> None:
    candidate = end(deviance=deviance, point=np.array([at, 0.5]))
    assert candidate.off == pytest.approx(abs(deviance - 4.0) / 4.0)
    assert candidate.has_converged is converged


def test_an_interval_ends_where_the_quadratic_deviance_reaches_its_target() -> None:
    # The deviance d = 400 u² + 200 u v + 100 v² is least at v = -u, where d = 300 u²;
    # it is 4 at u = ± sqrt(4 / 300).
    hessian = np.array([[400.0, 100.0], [100.0, 100.0]])

    def at(first: float, second: float) -> _End:
        step = np.array([first, second])
        deviance = float(step @ hessian @ step)
        return end(point=0.5 + step, deviance=deviance, score=hessian @ step)

    optimum = np.full(2, 0.5)
    for start in (at(0.1, -0.1), at(0.1, 0.0), at(0.15, -0.1)):
        start.advance(optimum, hessian)
        reached = np.sqrt(4.0 / 300.0)
        np.testing.assert_allclose(start.point, [0.5 + reached, 0.5 - reached])
    lower = replace(at(-0.1, 0.1), side=-1)
    lower.advance(optimum, hessian)
    np.testing.assert_allclose(lower.point, [0.5 - np.sqrt(4.0 / 300.0), 0.5 + np.sqrt(4.0 / 300.0)])


@pytest.mark.parametrize(("deviance", "factor"), [(0.01, 2.0), (1.0, 2.0), (2.0, 2.0**0.5), (16.0, 0.5), (400.0, 0.4)])
def test_an_end_moves_by_a_factor_of_two_fifths_to_two(deviance: float, factor: float) -> None:
    optimum, hessian = np.full(2, 0.5), np.diag([1e3, 1e3])
    one = end(point=np.array([0.55, 0.5]), deviance=deviance, score=np.zeros(2))
    one.advance(optimum, hessian)
    assert one.point[0] == pytest.approx(0.5 + 0.05 * factor)


def test_an_end_is_enclosed_between_known_distances() -> None:
    optimum, hessian = np.full(2, 0.5), np.eye(2)
    outside = end()  # without an equilibrium: nearer by the shortest factor, on the same ray
    outside.advance(optimum, hessian)
    assert (outside.inside, outside.outside) == (0.0, pytest.approx(0.1))
    assert 0.5 < outside.point[0] < 0.6
    inside = end(deviance=1.0, score=np.array([0.1, 0.0]), outside=0.12)
    inside.advance(optimum, hessian)
    assert (inside.inside, inside.outside) == (pytest.approx(0.1), 0.12)
    assert inside.point[0] == pytest.approx(0.61)  # halfway between the two distances
