"""Parts of the estimate of a fit: bounds of the errors of the beam model, wider intervals for few edges, and slopes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.interval import estimate
from eimi_fitting.inference.interval.estimate import CorrectionEffect

UNKNOWNS: Any = SimpleNamespace(space=SimpleNamespace(lower=np.array([1e3, 1.0]), upper=np.array([1e5, 9.0])))
LOG_RANGE = np.log(100.0)


def effect(moved: list[float], share: float, change: float, least_percent: float = 0.0, name: str = "finer") -> Any:
    """Return the effect on a fit of a better beam model, such as a finer mesh.

    moved: change of the unknowns at the optimum. share: share of this change that remains uncertain. change: change of
    the score, the derivative of the log-likelihood with respect to the modulus. least_percent: smallest bound of the
    remaining error of the modulus (%). name: name of the better model.
    """
    return SimpleNamespace(
        moved=np.array(moved),
        remaining_share=share,
        least_percent=least_percent,
        correction=SimpleNamespace(changes=[np.array([change, 9.0])], refinement=SimpleNamespace(name=name)),
    )


def bounds(*effects: Any) -> tuple[np.ndarray, np.ndarray]:
    about: Any = SimpleNamespace(
        unit=np.array([0.5, 0.4]),
        states=(SimpleNamespace(score=lambda change: change),),
        hessian=np.array([[50.0, 7.0], [7.0, 30.0]]),
    )
    return estimate._model_error_bounds(UNKNOWNS, about, effects)


def test_the_share_of_a_correction_that_remains_uncertain_bounds_the_errors_of_all_unknowns() -> None:
    model_errors, _ = bounds(effect([0.02, -0.03], 0.5, 0.0), effect([-0.01, 0.04], 0.1, 0.0))
    np.testing.assert_allclose(model_errors, [[0.01, -0.015], [-0.001, 0.004]])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_error_of_the_modulus_is_at_least_that_with_the_other_unknowns_fixed(sign: float) -> None:
    """The bound of the error of the modulus is at least the bound with all other unknowns fixed.

    With the other unknowns fixed, a score (derivative of the log-likelihood) of 5 and a second derivative of 50 move
    the modulus by 5 / 50. Half of this change remains uncertain.
    """
    model_errors, modulus_errors = bounds(effect([0.02, 0.0], 0.5, sign * 5.0))
    assert np.hypot(model_errors[0, 0], modulus_errors[0]) == pytest.approx(0.05)
    assert modulus_errors[0] == pytest.approx(np.sqrt(0.05**2 - 0.01**2))
    # No further error if the unknowns together move the modulus farther.
    assert bounds(effect([0.2, 0.0], 0.5, sign * 5.0))[1][0] == 0.0


def test_the_error_of_the_modulus_is_at_least_the_percentage_of_the_correction() -> None:
    _, modulus_errors = bounds(effect([0.0, 0.0], 0.5, 0.1, least_percent=3.0))
    assert modulus_errors[0] * LOG_RANGE == pytest.approx(np.log(1.03))
    _, modulus_errors = bounds(effect([0.0, 0.0], 0.5, 5.0, least_percent=3.0))
    assert modulus_errors[0] == pytest.approx(0.05)


def test_the_effect_of_a_correction_is_stated_in_per_cent_of_the_modulus() -> None:
    effects = [effect([0.01, 0.5], 0.5, 0.0, name="finer"), effect([-0.02, 0.0], 0.5, 0.0, name="solid")]
    found = estimate._effects_percent(
        UNKNOWNS, effects, ("finer", "solid", "failed"), np.array([[0.003, 9.0], [0.0, 9.0]]), np.array([0.004, 0.002])
    )
    assert list(found) == ["finer", "solid", "failed"]
    assert found["failed"] == CorrectionEffect(None, None)
    assert found["finer"].change_percent == pytest.approx(100 * (100.0**0.01 - 1))
    assert found["finer"].left_percent == pytest.approx(100 * 0.005 * LOG_RANGE)
    assert found["solid"].change_percent == pytest.approx(100 * (100.0**-0.02 - 1))
    assert found["solid"].left_percent == pytest.approx(100 * 0.002 * LOG_RANGE)


@pytest.mark.parametrize(
    ("noise_points", "states", "freedom"),
    [
        (100.0, (1, 2), 5),  # two edges in each of three states, minus 1
        (6.0, (3,), 4),  # independent points minus two unknowns
        (100.0, (1,), 1),
        (1.0, (5,), 1),  # never less than 1
    ],
)
def test_intervals_are_wider_if_few_edges_give_the_noise(
    noise_points: float, states: tuple[int, ...], freedom: int
) -> None:
    about: Any = SimpleNamespace(
        unit=np.zeros(2),
        noise_points=noise_points,
        states=[SimpleNamespace(residuals=np.zeros((number, 2, 7))) for number in states],
    )
    edges = object.__new__(EdgeObservation)
    problem: Any = SimpleNamespace(experiments=[SimpleNamespace(observed=edges)] * 2)
    expected = stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)
    assert estimate._widened(problem, about) == pytest.approx(expected, rel=1e-6)
    problem.experiments[1] = SimpleNamespace(observed="tracked points, whose uncertainty is stated")
    assert estimate._widened(problem, about) == 1.0


@pytest.mark.parametrize("unit", [(0.5, 0.3), (0.0, 1.0), (1.0, 0.0), (0.99995, 0.00005)])
def test_the_slopes_of_the_parameters_stay_within_the_bounds_of_the_search(unit: tuple[float, float]) -> None:
    asked: list[np.ndarray] = []

    def parameters(units: np.ndarray) -> np.ndarray:
        asked.append(units)
        return np.stack([1e3 * np.exp(2 * units[:, 0]), 5.0 + 3.0 * units[:, 1], units[:, 0] * units[:, 1]], axis=1)

    first, second = unit
    slopes = estimate._slopes(SimpleNamespace(parameters=parameters), np.array(unit))  # type: ignore[arg-type]
    expected = [[2e3 * np.exp(2 * first), 0.0], [0.0, 3.0], [second, first]]
    np.testing.assert_allclose(slopes, expected, rtol=2e-4, atol=2e-4)
    assert all(((units >= 0) & (units <= 1)).all() for units in asked)
    if unit == (0.5, 0.3):  # the error of a central difference is the square of the small step
        np.testing.assert_allclose(slopes, expected, rtol=2e-8, atol=1e-9)
