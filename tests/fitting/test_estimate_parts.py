"""Parts of the result of a fit (error bounds, widened intervals, derivatives) agree with calculations by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit
from eimi_fitting.inference.evidence.objective import Evaluation
from eimi_fitting.inference.interval import considered, covariance, estimate
from eimi_fitting.inference.interval.estimate import CorrectionEffect

UNKNOWNS: Any = SimpleNamespace(space=SimpleNamespace(lower=np.array([1e3, 1.0]), upper=np.array([1e5, 9.0])))
LOG_RANGE = np.log(100.0)


def effect(moved: list[float], share: float, change: float, least_percent: float = 0.0, name: str = "finer") -> Any:
    # Return the effect of a better beam model, such as a finer mesh, on the result of a fit.
    # moved : changes of the unknowns by the better model, the modulus first
    # share : share of ``moved`` that remains uncertain
    # change : how much the better model changes the derivative of the log-likelihood by the modulus
    # least_percent : lower bound of the remaining error of the modulus (%)
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
    # With the other unknowns fixed, the modulus moves by 5 / 50 = 0.1; half of this remains uncertain.
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


def test_a_bulk_modulus_and_freed_inputs_have_their_own_columns() -> None:
    freed = SimpleNamespace(name="width", value=lambda units: 10.0 * units)
    unknowns: Any = SimpleNamespace(
        space=SimpleNamespace(law=SimpleNamespace(parameter_names=("mu", "alpha"))),
        searched=3,
        freed=(freed,),
        parameters=lambda units: units[:, :2],
        bulk_modulus_Pa=lambda units: 1e6 * units[:, 2],
    )
    units = np.array([[0.1, 0.2, 0.3, 0.4], [0.5, 0.6, 0.7, 0.8]])
    columns = estimate._columns(unknowns, units)
    assert list(columns) == ["mu", "alpha", "bulk_modulus", "width"]
    np.testing.assert_allclose(np.stack(list(columns.values()), axis=1), units * [1, 1, 1e6, 10.0])
    unknowns.bulk_modulus_Pa = lambda units: None
    assert list(estimate._columns(unknowns, units)) == ["mu", "alpha", "width"]


def test_the_noise_of_a_tensile_curve_is_at_least_that_of_a_fit_to_the_curve_alone() -> None:
    rng = np.random.default_rng(2)
    z, slopes = rng.normal(size=7), rng.normal(size=(2, 7))
    curves = [
        SimpleNamespace(curve=SimpleNamespace(strain=np.zeros(3), weight=50.0), correlation_rows=1.5),
        SimpleNamespace(curve=SimpleNamespace(strain=np.zeros(4), weight=1e-3), correlation_rows=2.0),
    ]
    found = covariance._curves_score_variance(SimpleNamespace(curves=curves), z, slopes)  # type: ignore[arg-type]
    first, second = slopes[:, :3], slopes[:, 3:]
    expected = 50.0 * first @ first.T + (z[3:] ** 2).sum() * 2.0 / 4 * second @ second.T
    np.testing.assert_allclose(found, expected)


def test_the_evidence_is_linearised_by_central_differences_and_weighted_by_its_errors() -> None:
    # All residuals are linear in two unknowns, so that central differences give the exact derivatives.
    rng = np.random.default_rng(3)
    distance = np.array([0.1, 0.4])
    steps = np.array([[0, 0], [0.05, 0], [0, 0.2], [-0.05, 0], [0, -0.2]])
    at, slopes = rng.normal(size=(2, 2, 3)), rng.normal(size=(2, 2, 2, 3))
    residuals = at + np.einsum("pi,ikgn->pkgn", steps, slopes)
    weights = np.full((2, 2, 3), 0.5)
    weights[1, :, 2] = 0.0
    error_mm = np.sqrt((residuals**2 * (weights > 0)).sum(axis=(2, 3)) / weights.sum(axis=(1, 2)))
    curve_slopes, prior_slopes = rng.normal(size=(2, 4)), rng.normal(size=(2, 1))
    curves, law_priors = 0.3 + steps @ curve_slopes, -0.2 + steps @ prior_slopes
    priors = np.tile([0.7], (5, 1))
    misfit = Misfit(residuals, weights, error_mm, np.zeros((5, 2)))
    seen: Any = SimpleNamespace(misfits=(misfit,), error_mm=error_mm, objective_mm=error_mm.mean(axis=1))
    problem: Any = SimpleNamespace(
        experiments=[SimpleNamespace(observed=SimpleNamespace(sigma_mm=np.full((2, 3), 0.3)))],
        curves=[],
        unknowns=SimpleNamespace(prior=np.array([12.0, 1.0])),
    )
    optimum: Any = SimpleNamespace(
        evaluation=Evaluation(seen, curves, priors, law_priors, 99.0), distance=distance, unit=np.array([0.5, 0.4])
    )
    about = covariance.linearise(problem, optimum, likelihood_points=8.0)
    (states,) = about.states
    counts = np.array([3.0, 2.0])
    np.testing.assert_allclose(states.slopes, slopes)
    np.testing.assert_allclose(states.residuals, residuals[0])
    np.testing.assert_allclose(states.counts, counts)
    np.testing.assert_allclose(states.weights, 8.0 / (2 * error_mm[0].mean()) / (counts * error_mm[0]))
    assert states.used is weights
    np.testing.assert_allclose(about.curve_slopes, curve_slopes)
    np.testing.assert_allclose(about.law_prior_slopes, prior_slopes)
    by_state = np.einsum("k,ikgn,jkgn->ij", states.weights, slopes, slopes)
    np.testing.assert_allclose(about.information, by_state + curve_slopes @ curve_slopes.T)
    np.testing.assert_allclose(about.prior, np.diag([12.0, 1.0]))
    assert (about.points, about.likelihood_points) == (5, 8.0)
    # Each state of tracked points has two independent numbers, x and y.
    assert about.independent_points == about.noise_points == pytest.approx(4.0)
    assert about.noise_mm == pytest.approx(error_mm[0].mean())
    assert about.residual_mm == pytest.approx(np.sqrt((residuals[0] ** 2).sum() / 5))
    evaluation = Evaluation(seen, curves, priors, np.zeros((5, 0)), 8.0)
    assert about.objective_mm == pytest.approx(float(evaluation.objective_mm[0]))
    np.testing.assert_allclose(about.curves, curves[0])
    np.testing.assert_allclose((about.priors[0], about.law_priors[0]), (0.7, law_priors[0, 0]))
    # A common shift of all points of a state has the variance of the stated uncertainty or of the residuals.
    is_used = weights > 0
    stated = 0.09 * is_used.sum(axis=(1, 2)) / is_used.sum(axis=(1, 2))
    variance = states.weights**2 * np.maximum(stated, error_mm[0] ** 2 / 2)
    shifts = slopes.sum(axis=3)
    np.testing.assert_allclose(about.score_variance, np.einsum("k,ikg,jkg->ij", variance, shifts, shifts))
    assert covariance.linearise(problem, optimum).likelihood_points == pytest.approx(4.0)


class Bending:
    # A replacement for a beam model. Each residual is 1 plus three times the change of an input.
    # limit : change above which the beam has no equilibrium
    # solved : changes for which an equilibrium was computed

    def __init__(self, limit: float, status: Status = Status.CONVERGED) -> None:
        self.limit, self.status = limit, status
        self.solved: list[float] = []
        self.under: list[dict[str, Any]] = []

    def bent(self, candidate: Any, experiment: Any, setup: list[Any], near: Any = None) -> Any:
        deviation = sum(size for _, _, size in setup)
        self.solved.append(deviation)
        status = self.status if abs(deviation) <= self.limit else Status.DIVERGED
        return SimpleNamespace(status=np.array([0, status]), every="near", deviation=deviation)

    def experiment(self) -> Any:
        def misfit(model: str, shapes: Any, setup: list[Any]) -> Any:
            seen = shapes.deviation + sum(size for key, _, size in setup if key == "camera")
            return SimpleNamespace(residuals=np.array([[[3.0 * seen + 1.0]]]))

        def under(change: dict[str, Any]) -> Any:
            self.under.append(change)
            return changed

        changed = SimpleNamespace(model="coarse", observed=SimpleNamespace(misfit=misfit), under=under)
        return changed


@pytest.mark.parametrize(
    ("limit", "key", "change", "solved"),
    [
        (9.0, "load", 6.0, [0.0, 1.0]),  # half a standard uncertainty of 2
        (0.2, "load", 6.0, [0.0, 1.0, -1.0, 0.1]),
        (0.05, "load", None, [0.0, 1.0, -1.0, 0.1]),
        (9.0, "camera", 6.0, [0.0]),  # the shapes stay the same
        (-1.0, "load", None, [0.0]),
    ],
)
@pytest.mark.parametrize("status", [Status.CONVERGED, Status.UNSTABLE])
def test_the_change_by_an_input_is_a_finite_difference_with_the_first_step_that_has_an_equilibrium(
    monkeypatch: pytest.MonkeyPatch, limit: float, key: str, change: float | None, solved: list[float], status: Status
) -> None:
    beam = Bending(limit, status)
    sources = {
        "load": SimpleNamespace(parts=("x", "y"), changes_experiment=True, changes_shapes=True),
        "camera": SimpleNamespace(parts=("x", "y"), changes_experiment=False, changes_shapes=False),
    }
    monkeypatch.setattr(considered, "SOURCES", sources)
    monkeypatch.setattr(considered, "Setup", SimpleNamespace(of=lambda numbers, candidates: list(numbers)))
    monkeypatch.setattr(considered, "_bent", beam.bent)
    monkeypatch.setattr(considered, "coarse_model", lambda specimen: "coarse")
    monkeypatch.setattr(considered, "replace", lambda experiment, **changes: beam.experiment())
    candidate: Any = SimpleNamespace(freed=[])
    experiment: Any = SimpleNamespace(model=SimpleNamespace(specimen="specimen"))
    (found,) = considered.changes_by(candidate, experiment, [(key, 1, 2.0)])
    assert found is None if change is None else found == pytest.approx(np.array([[change]]))
    assert beam.solved == pytest.approx(solved)
    assert [list(under["load"]) for under in beam.under] == [[0.0, size] for size in beam.solved[1:]]
