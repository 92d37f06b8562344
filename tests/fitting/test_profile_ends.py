"""Ends of intervals agree with closed forms of the deviance.

The deviance is twice the decrease of the log-likelihood from its maximum; an interval ends where it is 4.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.interval import estimate
from eimi_fitting.inference.interval.profile_likelihood import Ends, interval_ends

Array = np.ndarray
OPTIMUM = np.array([0.5, 0.4])
HALF = np.array([0.05, 0.1])


def of_coordinates(*parts: Callable[[Array], Array]) -> Callable[[Array], tuple[Array, Array]]:
    # Return a function that computes a deviance at n points, shape (n, 2), and half of its gradients.
    # parts : two functions of the distance of a coordinate from the optimum; the deviance is their sum
    def deviance(units: Array) -> tuple[Array, Array]:
        away, h = units - OPTIMUM, 1e-7
        value = sum(part(away[:, i]) for i, part in enumerate(parts))
        slopes = [(part(away[:, i] + h) - part(away[:, i] - h)) / (4 * h) for i, part in enumerate(parts)]
        return np.asarray(value), np.stack(slopes, axis=1)

    return deviance


def quadratic(half: float) -> Callable[[Array], Array]:
    # Return a parabola of one coordinate that is 4 at the distance `half` from the optimum.
    return lambda away: 4.0 * (away / half) ** 2


def ends_of(deviance: Callable[[Array], tuple[Array, Array]], checked: tuple[int, ...] = (0, 1)) -> Ends:
    # Return the ends of the intervals of two coordinates: the points at which `deviance` is 4.
    # checked : indices of the coordinates whose ends are improved after the first guess
    return interval_ends(deviance, OPTIMUM, np.zeros(2), np.diag(4.0 / HALF**2), HALF, checked)


def test_the_ends_of_a_quadratic_deviance_are_those_of_the_covariance() -> None:
    ends = ends_of(of_coordinates(quadratic(HALF[0]), quadratic(HALF[1])))
    np.testing.assert_allclose((ends.low, ends.high), (OPTIMUM - HALF, OPTIMUM + HALF))
    assert ends.profiled == ()


@pytest.mark.parametrize(("ratio", "is_profiled"), [(1.19, False), (1.21, True), (0.81, False), (0.79, True)])
def test_an_end_is_corrected_if_its_deviance_differs_by_a_fifth(ratio: float, is_profiled: bool) -> None:
    deviance = of_coordinates(quadratic(HALF[0]), quadratic(HALF[1] / np.sqrt(ratio)))
    ends = ends_of(deviance)
    assert ends.profiled == ((1,) if is_profiled else ())
    expected = HALF[1] / np.sqrt(ratio) if is_profiled else HALF[1]
    assert ends.high[1] - OPTIMUM[1] == pytest.approx(expected, rel=0.015)
    assert OPTIMUM[1] - ends.low[1] == pytest.approx(expected, rel=0.015)
    assert ends.high[0] - OPTIMUM[0] == pytest.approx(HALF[0])


def test_only_the_checked_ends_are_compared_with_the_profile_likelihood() -> None:
    deviance = of_coordinates(quadratic(2 * HALF[0]), quadratic(2 * HALF[1]))
    ends = ends_of(deviance, checked=(1,))
    np.testing.assert_allclose(ends.high - OPTIMUM, [HALF[0], 2 * HALF[1]], rtol=0.015)
    assert ends.profiled == (1,)
    calls: list[Array] = []
    ends = ends_of(lambda units: calls.append(units) or deviance(units), checked=())  # type: ignore[func-returns-value]
    np.testing.assert_allclose((ends.low, ends.high), (OPTIMUM - HALF, OPTIMUM + HALF))
    assert (ends.profiled, calls) == ((), [])


def test_the_ends_of_a_skew_deviance_have_the_deviance_of_the_end() -> None:
    # The deviance rises exponentially on one side, so that the lower end is farther from the optimum.
    rate = 12.0

    def skew(away: Array) -> Array:
        return 4.0 * (np.expm1(rate * away) / (rate * HALF[0])) ** 2

    ends = ends_of(of_coordinates(skew, quadratic(HALF[1])))
    assert ends.profiled == (0,)
    for end, exact in (
        (ends.high[0], np.log1p(rate * HALF[0]) / rate),
        (ends.low[0], np.log1p(-rate * HALF[0]) / rate),
    ):
        assert end - OPTIMUM[0] == pytest.approx(exact, rel=0.02)
        assert skew(np.array([end - OPTIMUM[0]])) == pytest.approx(4.0, rel=0.03)


def test_an_end_that_is_not_reached_within_the_bounds_is_the_bound() -> None:
    ends = ends_of(of_coordinates(quadratic(HALF[0]), lambda away: np.where(away < 0, quadratic(HALF[1])(away), away)))
    assert ends.high[1] == 1.0
    assert ends.low[1] == pytest.approx(OPTIMUM[1] - HALF[1], rel=0.015)
    assert ends.profiled == (1,)


def test_an_end_is_in_front_of_the_candidates_that_are_not_valid() -> None:
    # The deviance is below 4 up to the distance 0.02 from the optimum, and infinite (not valid) beyond.

    smooth = of_coordinates(quadratic(HALF[0]), quadratic(HALF[1]))

    def deviance(units: Array) -> tuple[Array, Array]:
        value, score = smooth(units)
        return np.where(units[:, 0] > OPTIMUM[0] + 0.02, np.inf, value), score

    ends = ends_of(deviance)
    assert ends.profiled == (0,)
    assert ends.low[0] == pytest.approx(OPTIMUM[0] - HALF[0])
    # The search has not converged: the end is not nearer than the quadratic end.
    assert ends.high[0] == pytest.approx(OPTIMUM[0] + HALF[0])


def bulk_ends(
    monkeypatch: pytest.MonkeyPatch, values: list[float], high: float = 0.7, has_bulk: bool = True
) -> tuple[Ends, list[Array]]:
    # Return the intervals of two unknowns from `estimate._ends`, and the points at which the deviance was computed.
    # values : the deviances, in the order in which they are computed
    # high : upper end of the interval of the second unknown
    # has_bulk : whether the second unknown is the bulk modulus
    points, objective_mm = 50.0, 0.02
    asked: list[Array] = []

    def evaluate(units: Array, given_points: float, near: object) -> Any:
        asked.extend(units)
        ratio = np.sqrt(1 + values[len(asked) - 1] / points)
        return SimpleNamespace(
            without_law_priors=SimpleNamespace(objective_mm=np.array([objective_mm * ratio])),
            law_priors=np.zeros((1, 0)),
        )

    hessian = np.diag([100.0, 25.0])
    about: Any = SimpleNamespace(
        unit=OPTIMUM,
        score=np.zeros(2),
        hessian=hessian,
        prior=np.zeros((2, 2)),
        law_priors=np.zeros(0),
        law_prior_slopes=np.zeros((2, 0)),
        likelihood_points=points,
        objective_mm=objective_mm,
        score_of=lambda candidates: np.zeros((1, 2)),
    )
    problem: Any = SimpleNamespace(
        evaluate=evaluate, unknowns=SimpleNamespace(searched=2, space=SimpleNamespace(has_bulk=has_bulk))
    )
    optimum: Any = SimpleNamespace(evaluation=SimpleNamespace(comparison=SimpleNamespace(near=None)))
    found = Ends(np.array([0.4, 0.2]), np.array([0.6, high]), (0,))
    monkeypatch.setattr(estimate, "interval_ends", lambda *arguments: found)
    half_width = np.array([0.1, 0.2])  # the square of 0.2, divided by the inverse 1 / 25, is the target 1
    return estimate._ends(problem, about, optimum, half_width, (0, 1)), asked


@pytest.mark.parametrize(
    ("values", "is_open"),
    [([9.9, 9.9], True), ([10.1, 10.1], False), ([30.0, 9.9], True), ([9.9, 30.0], True), ([0.0, 0.0], True)],
)
def test_the_upper_end_of_a_bulk_modulus_is_open_if_an_incompressible_material_is_nearly_as_likely(
    monkeypatch: pytest.MonkeyPatch, values: list[float], is_open: bool
) -> None:
    ends, asked = bulk_ends(monkeypatch, values)
    assert ends.high.tolist() == [0.6, 1.0 if is_open else 0.7]
    assert ends.low.tolist() == [0.4, 0.2]
    assert ends.profiled == ((0, 1) if is_open else (0,))
    # The incompressible material is the bound of the bulk modulus; the other unknowns are adapted once.
    np.testing.assert_allclose(asked, [[0.5, 1.0], [0.5, 1.0]])


@pytest.mark.parametrize(("high", "has_bulk"), [(1.0, True), (0.7, False)])
def test_an_open_end_and_a_fit_without_a_bulk_modulus_need_no_further_candidates(
    monkeypatch: pytest.MonkeyPatch, high: float, has_bulk: bool
) -> None:
    ends, asked = bulk_ends(monkeypatch, [], high, has_bulk)
    assert (ends.high.tolist(), ends.profiled, asked) == ([0.6, high], (0,), [])
