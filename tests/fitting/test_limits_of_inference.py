"""Optimisation, intervals and planning keep their numerical limits, such as a largest number of steps."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit, PointObservation
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.evidence.unknowns import SharedUnknowns
from eimi_fitting.inference.interval import estimate, profile_likelihood
from eimi_fitting.inference.interval.budget import Moves, budget
from eimi_fitting.inference.interval.considered import ConsideredInput, Steps
from eimi_fitting.inference.interval.draws import normal_draws
from eimi_fitting.inference.interval.identifiability import directions
from eimi_fitting.inference.interval.profile_likelihood import Ends, interval_ends
from eimi_fitting.inference.planning.choice_of_law import Candidate
from eimi_fitting.inference.planning.exchange import _exchanged, exchange
from eimi_fitting.inference.searching import search
from eimi_fitting.inference.searching.polish import polish
from eimi_fitting.inference.searching.search import Run


@pytest.mark.parametrize(
    ("unit", "is_at_bound"),
    [(0.0009, True), (0.0011, False), (0.9989, False), (0.9991, True), (0.0, True), (0.5, False)],
)
def test_a_value_within_a_thousandth_of_a_bound_is_at_the_bound(
    monkeypatch: pytest.MonkeyPatch, unit: float, is_at_bound: bool
) -> None:
    monkeypatch.setattr(estimate, "statement", lambda *arguments: "words")
    space = SimpleNamespace(names=("mu",), law=SimpleNamespace(parameter_names=("mu",)))
    unknowns = SimpleNamespace(
        names=("mu",), searched=1, space=space, parameters=lambda units: 2e4 * units[:, :1], ratios=()
    )
    about = SimpleNamespace(
        unit=np.array([unit]),
        information=np.eye(1),
        law_prior_information=np.zeros((1, 1)),
        prior=np.eye(1),
        residual_mm=0.1,
        points=20,
        independent_points=8.0,
        noise_mm=0.05,
        noise_points=6.0,
    )
    given: Any = (SimpleNamespace(unknowns=unknowns, priors=()), about, SimpleNamespace(squares=0.0))
    ends = Ends(np.zeros(1), np.ones(1), ())
    modulus = Quantity(2e4, "Pa", (1.9e4, 2.1e4))
    found = estimate._identifiability(*given, np.eye(1), np.zeros(1), ends, modulus)
    assert found.at_bound == (("mu",) if is_at_bound else ())
    assert (found.correlation_points, found.points, found.independent_points) == (2.5, 20, 8.0)
    assert (found.residual_mm, found.noise_mm, found.noise_points) == (0.1, 0.05, 6.0)


@pytest.mark.parametrize(("off", "is_near"), [(0.09, True), (0.11, False)])
@pytest.mark.parametrize("side", [1, -1])
def test_an_end_that_has_not_converged_is_the_farther_one(
    monkeypatch: pytest.MonkeyPatch, off: float, is_near: bool, side: int
) -> None:
    # No round improves the end, which lies at half of the quadratic half-width.
    def unchanged(self: Any, unit: Any, hessian: Any) -> None:
        self.point = unit + 0.5 * self.side * np.array([0.1])

    monkeypatch.setattr(profile_likelihood._End, "advance", unchanged)
    calls: list[int] = []

    def deviance(units: np.ndarray) -> Any:
        calls.append(len(units))
        value = 10.0 if len(calls) == 1 else 4.0 * (1 + off)
        return np.full(len(units), value), np.zeros((len(units), 1))

    ends = interval_ends(deviance, np.array([0.5]), np.zeros(1), np.array([[400.0]]), np.array([0.1]), (0,))
    assert calls == [2] * 9  # the first guess, then eight rounds
    assert ends.profiled == (0,)
    end = ends.high[0] if side > 0 else ends.low[0]
    assert end == pytest.approx(0.5 + side * (0.05 if is_near else 0.1))


@pytest.mark.parametrize(("evaluations", "further"), [(120, False), (121, False), (119, True)])
def test_small_populations_follow_until_they_have_cost_as_much_as_the_large_ones(
    evaluations: int, further: bool
) -> None:
    done: list[Run] = []
    runs = search._runs(np.random.default_rng(1), 10, 2, True, done)
    assert next(runs) == (0.25, 10, search.sys.maxsize)
    done.append(Run(1, 0.25, evaluations, 1.0, ""))  # the first run counts as a small one
    assert next(runs)[:2] == (0.25, 20)
    done.append(Run(20, 0.25, 6, 1.0, ""))  # 120 evaluations
    step, population, most = next(runs)
    if further:
        assert step < 0.25
        assert population in range(10, 21)
        assert most == max(60 // population, 1)
    else:
        assert (step, population) == (0.25, 40)


def test_a_budget_has_one_entry_for_each_input_and_halves_the_largest() -> None:
    rng = np.random.default_rng(2)
    clamp, width = SharedUnknowns("clamp", (0,), 0.05), SharedUnknowns("width", (0, 1), 0.02)
    sources = [
        ConsideredInput("clamp x", clamp, 0, (None,)),
        ConsideredInput("width", width, 0, (None,)),
        ConsideredInput("clamp y", clamp, 1, (None,)),
    ]
    sizes = np.array([[0.03, 0.0], [0.045, 0.1], [-0.04, 0.0]])
    steps = Steps(sizes, np.array([0.01, 0.0]))
    noise = 0.01 * normal_draws(rng, 2)
    moves = Moves(np.array([0.5, 0.5]), noise, normal_draws(rng, 3), steps, 0.002)
    entries, measure_next = budget(sources, moves, lambda units: 1e4 * (1 + units[:, 0]))
    assert [entry.source for entry in entries] == ["clamp", "width"]
    assert [entry.effect_percent for entry in entries] == pytest.approx([100 * 0.05 / 1.5, 100 * 0.045 / 1.5])
    assert [(entry.unit, entry.standard_uncertainty, entry.datasets) for entry in entries] == [
        ("mm", 0.05, (0,)),
        ("mm", 0.02, (0, 1)),
    ]
    assert (measure_next.source, measure_next.words) == ("clamp", "place of the clamp")
    low, high = measure_next.initial_shear_modulus_interval_95_Pa
    assert high - low == pytest.approx(2 * 1.96e4 * np.hypot(0.01, np.hypot(0.025, 0.045)), rel=0.03)
    assert 0.5 * (low + high) == pytest.approx(1e4 * (1.5 + 0.012), rel=2e-3)
    loud = Moves(moves.unit, 8 * noise, moves.deviations, steps)
    _, edges = budget(sources, loud, lambda units: 1e4 * (1 + units[:, 0]))
    assert (edges.source, edges.words) == (None, "edges")
    low, high = edges.initial_shear_modulus_interval_95_Pa
    assert high - low == pytest.approx(2 * 1.96e4 * np.hypot(0.04, np.hypot(0.05, 0.045)), rel=0.04)
    assert (
        budget(
            (),
            Moves(moves.unit, noise, np.zeros((4000, 0)), Steps(np.zeros((0, 2)), np.zeros(2))),
            lambda units: units[:, 0],
        )[0]
        == ()
    )


def test_a_fit_without_stated_inputs_has_no_squares_of_them() -> None:
    assert Candidate("yeoh", 3, ((20.0, 0.01),)).stated_squares == 0.0
    assert Candidate("yeoh", 3, ((20.0, 0.01),)).held_out_error_mm is None


class Table:
    # The variance of each choice of at most three of eight states: random numbers.

    def __init__(self, seed: int) -> None:
        self.values = np.random.default_rng(seed).uniform(1.0, 2.0, (8, 8, 8))

    def __len__(self) -> int:
        return 8

    def variance(self, choices: np.ndarray) -> np.ndarray:
        padded = np.pad(np.sort(choices, axis=1), ((0, 0), (0, 3 - choices.shape[1])))
        return self.values[tuple(padded.T)]


@pytest.mark.parametrize("seed", range(12))
def test_no_exchange_of_one_state_lowers_the_criterion_further(seed: int) -> None:
    table = Table(seed)
    chosen = exchange(table, 3)
    assert len(set(chosen.tolist())) == 3
    others = [
        np.append(np.delete(chosen, place), state) for place in range(3) for state in range(8) if state not in chosen
    ]
    assert table.variance(chosen[None])[0] <= table.variance(np.array(others)).min()


class Wavy:
    # Residuals of one state that bend more and more, so that steps of Gauss-Newton may be too long.

    def __init__(self, units: np.ndarray, frequency: float) -> None:
        waves = np.sin(frequency * (units - 0.37)) + 0.6 * (units - 0.37) + 0.2 * units[:, ::-1] ** 2
        self.residuals = np.concatenate([waves, 0.05 + 0 * waves], axis=1)[:, None, None, :]
        self.objective_mm = np.sqrt((self.residuals**2).mean(axis=(1, 2, 3)))
        weights = np.ones(self.residuals.shape[1:])
        self.misfits = (Misfit(self.residuals, weights, self.objective_mm[:, None], np.zeros((len(units), 1))),)


@pytest.mark.parametrize("frequency", [4.0, 7.0, 9.0, 12.0, 17.0])
@pytest.mark.parametrize("start", [(0.1, 0.9), (0.6, 0.2), (0.95, 0.7), (0.5, 0.05)])
def test_a_polish_accepts_only_steps_that_lower_the_objective(frequency: float, start: tuple[float, float]) -> None:
    asked: list[float] = []

    def evaluate(units: np.ndarray, near: Any) -> Wavy:
        found = Wavy(units, frequency)
        asked.append(float(found.objective_mm[0]))
        return found

    found = polish(evaluate, np.array(start), enough=1e-9)
    assert found.evaluation.objective_mm[0] == found.polish.mean_error_after_mm <= min(asked)
    assert found.polish.mean_error_before_mm == asked[0]
    assert found.polish.steps <= 12


def test_a_step_that_is_too_long_is_tried_at_three_tenths_and_a_tenth_of_its_length() -> None:
    asked: list[np.ndarray] = []

    def evaluate(units: np.ndarray, near: Any) -> Any:
        asked.append(units)
        found = Wavy(units, 1.0)
        found.objective_mm = np.full(len(units), 1.0 if len(asked) == 1 else 2.0)
        return found

    found = polish(evaluate, np.array([0.6, 0.2]))
    assert (found.unit.tolist(), found.polish.steps) == ([0.6, 0.2], 0)
    first, there, shorter = asked
    step = there[0] - first[0]
    assert np.abs(step).min() > 1e-3
    np.testing.assert_allclose(shorter, first[0] + np.outer([0.3, 0.1], step))


@pytest.mark.parametrize(("share", "steps"), [(0.1, 12), (1.5e-4, 12), (0.9e-4, 1)])
def test_a_polish_ends_after_twelve_steps_or_one_that_gains_less_than_a_ten_thousandth(
    share: float, steps: int
) -> None:
    calls: list[int] = []

    def evaluate(units: np.ndarray, near: Any) -> Any:
        calls.append(len(units))
        found = Wavy(units, 1.0)
        found.objective_mm = np.full(len(units), (1 + share) ** -len(calls))
        return found

    found = polish(evaluate, np.array([0.6, 0.2]))
    assert found.polish.steps == steps
    assert calls == [5] * (steps + 1)


def test_a_direction_names_a_part_with_more_than_a_tenth_of_its_square() -> None:
    for share, words in ((0.095, "a"), (0.105, "a with b"), (0.2, "a with b")):
        vector = np.sqrt([1 - share, share])
        best, *_ = directions(("a", "b"), 100 * np.outer(vector, vector), np.eye(2))
        assert best.words == words


def test_one_measured_point_has_its_own_distance_as_the_error() -> None:
    edge = EdgeObservation(np.zeros((2, 2, 3, 2)), np.full((2, 2, 3), np.inf))
    edge.sigma_mm[0, 1, 2] = 0.01
    residuals = np.zeros((1, 2, 2, 3))
    residuals[0, 0, 1, 2] = -0.3
    found = edge.of_residuals(residuals)
    assert (found.error_mm.tolist(), found.deviation_mm.tolist()) == ([[0.3, 0.0]], [[0.0, 0.0]])
    assert found.weights.sum() == 1.0
    point = PointObservation(np.zeros((2, 3, 2)), np.zeros((2, 3, 2)), np.full((2, 3), np.inf))
    point.sigma_mm[0, 1] = 0.01
    residuals = np.zeros((1, 2, 2, 3))
    residuals[0, 0, :, 1] = 0.3, -0.4
    found = point.of_residuals(residuals)
    assert found.error_mm[0].tolist() == pytest.approx([0.5, 0.0])
    assert found.deviation_mm[0].tolist() == [0.0, 0.0]
    assert found.weights.sum() == 1.0


class Falling:
    # A criterion that every exchange lowers, by a share of its value.

    def __init__(self, share: float) -> None:
        self.share, self.calls = share, 0

    def __len__(self) -> int:
        return 4

    def variance(self, choices: np.ndarray) -> np.ndarray:
        self.calls += 1
        return np.full(len(choices), (1 - self.share) ** self.calls)


@pytest.mark.parametrize(("share", "sweeps"), [(0.1, 20), (0.6e-6, 20), (0.45e-6, 1)])
def test_states_are_exchanged_in_at_most_twenty_sweeps_while_each_gains_a_millionth(share: float, sweeps: int) -> None:
    falling = Falling(share)
    _exchanged(falling, np.array([0, 2]))
    assert falling.calls == 1 + 2 * sweeps
