"""An accurate beam model corrects the residuals of a fast one; invented numbers replace the simulations."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import Loads, Magnet, Specimen
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.inference.evidence import corrections
from eimi_fitting.inference.evidence.corrections import (
    FINER_MESH,
    SOLID,
    by_better_model,
    correction,
    polished,
    refinements,
    solid_beside,
    with_residuals_of,
)
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM, Comparison, Experiment
from eimi_fitting.inference.evidence.measurements import (
    EdgeObservation,
    Misfit,
    PointObservation,
    joined_misfits,
    signed_distance,
)
from eimi_fitting.inference.interval import corrected_optimum
from eimi_fitting.inference.searching import measured_rest_shape
from eimi_fitting.inference.searching.measured_rest_shape import MeasuredRestShape

MAGNET = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", MAGNET)


# Distances


def line(*points: tuple[float, float]) -> np.ndarray:
    # Return begin, middle and end of straight segments between the points, shape (segments, 3, 2).
    ends = np.array(points)
    return np.stack([ends[:-1], 0.5 * (ends[:-1] + ends[1:]), ends[1:]], axis=1)


def test_distances_are_positive_to_the_left_and_grow_beyond_the_continuation() -> None:
    curve = line((0.0, 0.0), (4.0, 0.0), (10.0, 0.0))  # continued by 0.5 mm at both ends
    points = np.array([[1.0, 2.0], [4.0, -3.0], [9.9, 0.5], [10.4, 0.1], [13.5, 4.0], [-3.5, -4.0], [-0.4, -0.1]])
    assert signed_distance(curve, points) == pytest.approx([2.0, -3.0, 0.5, 0.1, 5.0, -5.0, -0.1])


def test_many_pairs_are_compared_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    curves = np.stack([line((0.0, y), (4.0, y + 1), (8.0, y)) for y in (0.0, 1.0, 2.0)])
    points = rng.uniform(0, 8, (3, 5, 2))
    together = signed_distance(curves, points)
    monkeypatch.setattr("eimi_fitting.inference.evidence.measurements._PAIRS_AT_ONCE", 2 * 4 * 2 * 5)
    np.testing.assert_array_equal(signed_distance(curves, points), together)
    for i in range(3):
        np.testing.assert_allclose(signed_distance(curves[i], points[i]), together[i], atol=1e-12)
        np.testing.assert_allclose(signed_distance(curves[i], points)[i], together[i], atol=1e-12)


def test_edges_of_unequal_lengths_are_padded_with_unused_points() -> None:
    left, right = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[5.0, 6.0]])
    observed = EdgeObservation.from_edges([(left, np.array([0.1, 0.2]), right, np.array([0.3]))])
    assert observed.points_mm.tolist() == [[[[1, 2], [3, 4]], [[5, 6], [0, 0]]]]
    assert observed.sigma_mm.tolist() == [[[0.1, 0.2], [0.3, np.inf]]]


def test_states_of_an_observation_keep_their_noise_and_depth() -> None:
    edges = EdgeObservation(np.arange(12.0).reshape(3, 2, 1, 2), np.arange(6.0).reshape(3, 2, 1), None, np.arange(3.0))
    some = edges.of_states(np.array([2, 0]))
    assert some.noise_mm is not None
    assert some.noise_mm.tolist() == [2.0, 0.0]
    assert some.points_mm[:, 0, 0].tolist() == [[8.0, 9.0], [0.0, 1.0]]
    assert some.sigma_mm[:, 1, 0].tolist() == [5.0, 1.0]
    rest = np.arange(6.0).reshape(3, 1, 2)
    points = PointObservation(rest, rest + 10, np.ones((3, 1)) * [[1], [2], [3]], np.array([[4.0], [5.0], [6.0]]))
    one = points.of_states(np.array([1]))
    assert (one.rest_mm.tolist(), one.moved_mm.tolist()) == ([[[2, 3]]], [[[12, 13]]])
    assert one.depth_mm is not None
    assert (one.sigma_mm.tolist(), one.depth_mm.tolist()) == ([[2.0]], [[5.0]])


def misfit_of(residuals: Any, error_mm: float = 1.0) -> Misfit:
    residuals = np.asarray(residuals, float)
    sizes = np.full(residuals.shape[:2], error_mm)
    return Misfit(residuals, np.ones(residuals.shape[1:]), sizes, 0.5 * sizes)


def test_joined_misfits_keep_the_order_of_the_parameter_sets() -> None:
    first, second = misfit_of(np.zeros((1, 2, 2, 3)), 1.0), misfit_of(np.ones((2, 2, 2, 3)), 2.0)
    joined = joined_misfits([first, second])
    assert joined.residuals[:, 0, 0, 0].tolist() == [0.0, 1.0, 1.0]
    assert joined.error_mm.tolist() == [[1, 1], [2, 2], [2, 2]]
    assert joined.deviation_mm.tolist() == [[0.5, 0.5], [1, 1], [1, 1]]
    assert joined.take(np.array([2, 0])).error_mm.tolist() == [[2, 2], [1, 1]]
    assert joined.take(np.array([1])).deviation_mm.tolist() == [[1, 1]]


def comparison(*residuals: float, unconverged: bool = False, unstable: bool = False, shapes: Any = ()) -> Comparison:
    # Return a comparison with one parameter set and one residual (mm) for each experiment.
    misfits = tuple(misfit_of(np.full((1, 1, 2, 2), one), abs(one)) for one in residuals)
    return Comparison(np.array([unconverged]), np.array([unstable]), np.ones(1), shapes, misfits)


def test_the_objective_is_the_mean_error_of_all_states_unless_the_candidate_is_not_valid() -> None:
    assert comparison(1.0, 3.0).objective_mm.tolist() == [2.0]
    assert comparison(1.0, 3.0).deviation_mm.tolist() == [[0.5, 1.5]]
    assert DISCARDED_MM == 1e6
    assert comparison(1.0, unconverged=True).objective_mm.tolist() == [1e6]
    assert comparison(1.0, unstable=True).objective_mm.tolist() == [1e6]


# Corrections


@dataclass(frozen=True)
class Beam:
    # Replaces an experiment; only its section and the corrections of its residuals matter.

    section: str = "plane-stress"
    change: Any = None
    solid: Any = None
    solid_options: Any = None
    name: str = "plain"
    observed: Any = None

    @property
    def model(self) -> Any:
        return SimpleNamespace(specimen=SimpleNamespace(section=self.section), halved=lambda: "halved")

    @property
    def solved(self) -> str:
        return f"model of {self.name}"


def better(beam: Beam) -> Beam:
    return replace(beam, name="better")


def test_experiments_need_a_solid_a_finer_mesh_or_both() -> None:
    planar, strain, solid = (Beam(section) for section in ("plane-stress", "plane-strain", "solid"))
    assert refinements([planar, strain]) == (FINER_MESH,)  # type: ignore[list-item]
    assert refinements([solid]) == (SOLID,)  # type: ignore[list-item]
    assert refinements([planar, solid]) == (SOLID, FINER_MESH)  # type: ignore[list-item]


def test_the_error_after_a_finer_mesh_is_that_of_richardson() -> None:
    # The error falls as h^1.19: e(h) - e(h/2) = e(h/2) (2^1.19 - 1).
    assert FINER_MESH.remaining_share == pytest.approx(0.5**1.19 / (1 - 0.5**1.19))
    assert SOLID.remaining_share == 0.05


def test_a_finer_mesh_halves_planar_elements_only() -> None:
    model = BeamModel(SPECIMEN, 6, 2)
    planar = Experiment(model, None, None)  # type: ignore[arg-type]
    finer = FINER_MESH.better(planar).model
    assert (finer.along, finer.across) == (12, 4)
    solid = replace(planar, model=BeamModel(replace(SPECIMEN, section="solid"), 6, 2, "plane-stress"))
    assert FINER_MESH.better(solid) is solid
    assert SOLID.better(planar) is planar
    assert polished(planar) is planar


@pytest.mark.parametrize(("width_mm", "across"), [(1.0, 2), (3.6, 2), (4.2, 3), (5.0, 3), (5.7, 4), (9.0, 4)])
def test_the_solid_has_twenty_elements_along_and_about_square_ones_across(
    monkeypatch: pytest.MonkeyPatch, width_mm: float, across: int
) -> None:
    monkeypatch.setattr(corrections, "SolidBeside", lambda *given: given)
    specimen = replace(SPECIMEN, width_mm=width_mm, section="solid", magnet=None)
    assert solid_beside(specimen)[1:] == (20, across)  # type: ignore[index]


def test_a_correction_is_the_accurate_minus_the_fast_residual() -> None:
    refinement = replace(FINER_MESH, better=better)  # type: ignore[arg-type]
    here = comparison(1.0, 2.0)
    seen: list[Any] = []

    def compare(experiments: Any) -> Comparison:
        seen.extend(experiments)
        return comparison(1.5, 1.0, unstable=True, shapes=("a", "b"))

    found = correction(refinement, [Beam(), Beam()], here, compare)  # type: ignore[list-item]
    assert found is not None
    assert [change.ravel().tolist() for change in found.changes] == [[0.5] * 4, [-1.0] * 4]
    assert (found.models, found.effects) == (("model of better",) * 2, (None, None))
    assert [beam.name for beam in seen] == ["better", "better"]
    assert found.without_shapes().better.shapes == ()
    first, second = found.added([Beam(), Beam(change=np.full((1, 2, 2), 10.0))])  # type: ignore[list-item]
    assert first.change is found.changes[0]
    assert second.change is not None
    assert second.change.ravel().tolist() == [9.0] * 4


@pytest.mark.parametrize(("here", "there"), [(True, False), (False, True)])
def test_there_is_no_correction_without_an_equilibrium(here: bool, there: bool) -> None:
    refinement = replace(FINER_MESH, better=better)  # type: ignore[arg-type]
    plain, finer = comparison(1.0, unconverged=here), comparison(2.0, unconverged=there)
    assert correction(refinement, [Beam()], plain, lambda _: finer) is None  # type: ignore[list-item]


def test_residuals_of_the_accurate_model_replace_those_of_the_fast_one() -> None:
    plain, corrected = Beam(), Beam(change=np.full((1, 2, 2), 10.0))
    found = with_residuals_of(comparison(5.0, 7.0), [plain, corrected], comparison(1.0, 2.0))  # type: ignore[list-item]
    assert [e.change.ravel().tolist() for e in found if e.change is not None] == [[4.0] * 4, [15.0] * 4]


def test_recorrected_residuals_change_by_the_difference_of_the_corrections() -> None:
    observed = EdgeObservation(np.zeros((1, 2, 2, 2)), np.ones((1, 2, 2)))
    plain = Experiment(None, None, observed)  # type: ignore[arg-type]
    by_three, by_one = (replace(plain, change=np.full((1, 2, 2), size)) for size in (3.0, 1.0))
    misfit = observed.of_residuals(np.full((1, 1, 2, 2), 5.0))
    assert by_three.recorrected(misfit, by_one).residuals.ravel().tolist() == [7.0] * 4
    assert by_three.recorrected(misfit, plain).error_mm.tolist() == [[8.0]]
    assert plain.recorrected(misfit, by_one).residuals.ravel().tolist() == [4.0] * 4
    assert plain.recorrected(misfit, plain).residuals.ravel().tolist() == [5.0] * 4


@pytest.mark.parametrize("section", ["plane-stress", "solid"])
@pytest.mark.parametrize("found", [True, False])
def test_a_picture_of_one_experiment_is_by_the_accurate_model_if_it_has_an_equilibrium(
    monkeypatch: pytest.MonkeyPatch, section: str, found: bool
) -> None:
    observed = EdgeObservation(np.zeros((1, 2, 2, 2)), np.ones((1, 2, 2)), view="view")  # type: ignore[arg-type]
    monkeypatch.setattr(corrections, "outline", lambda *given: [given])
    monkeypatch.setattr(
        corrections,
        "correction",
        lambda *_: (
            SimpleNamespace(
                changes=(np.full((1, 2, 2), 2.0),), models=("fine",), better=SimpleNamespace(shapes=("fine shapes",))
            )
            if found
            else None
        ),
    )
    beam, here = Beam(section, observed=observed), comparison(1.0, shapes=("shapes",))
    result = by_better_model(beam, here, lambda _: here)  # type: ignore[arg-type]
    if not found and section == "solid":
        assert result is None
        return
    assert result is not None
    misfit, drawn, by = result
    assert misfit.residuals.ravel().tolist() == [3.0 if found else 1.0] * 4
    assert (by is not None) is found
    if found:
        assert tuple(drawn) == ("fine", "fine shapes", "view")
    else:
        assert tuple(drawn)[1:] == ("shapes", "view")


def test_an_experiment_without_an_equilibrium_has_no_picture() -> None:
    assert by_better_model(Beam(), comparison(1.0, unconverged=True), lambda _: comparison(1.0)) is None  # type: ignore[arg-type]


# The corrected optimum


def optimum(unit: float, objective_mm: float = 1.0) -> Any:
    evaluation = SimpleNamespace(objective_mm=np.array([objective_mm]))
    return SimpleNamespace(unit=np.array([unit]), evaluation=evaluation, distance=np.ones(1))


@dataclass(frozen=True)
class Fit:
    # Replaces a fit. If the only unknown of the fit changes by 1, the modulus changes by 100 per cent.

    name: str
    experiments: tuple[str, ...] = ("beam",)
    unknowns: Any = field(default_factory=lambda: SimpleNamespace(modulus_percent=lambda moved: 100 * float(moved)))


@pytest.mark.parametrize(
    ("units", "objectives", "passes", "end", "share"),
    [
        ([0.51], [1.0], 3, 0.51, 0.05),  # the later passes do not move the optimum
        ([0.5004], [9.0], 1, 0.5004, 1.0),  # the first pass moves the modulus by 0.04 per cent and may raise the error
        ([0.5006, 0.5006], [1.0], 2, 0.5006, 0.05),
        ([0.6, 0.62, 0.65], [1.0], 3, 0.65, 0.2),  # the last of three passes moved 3 of 15 per cent
        ([0.6, 0.7], [1.0, 1.02], 2, 0.6, 1.0),  # the second pass raises the error by two per cent: rejected
        ([0.6, 0.6001], [1.0, 1.005], 2, 0.6001, 0.05),
    ],
)
def test_the_solid_is_computed_again_until_the_modulus_stands(
    monkeypatch: pytest.MonkeyPatch, units: list[float], objectives: list[float], passes: int, end: float, share: float
) -> None:
    starts: list[Any] = []

    def change(problem: Any, refinement: Any, experiments: Any, unit: Any, start: Any = None) -> Any:
        starts.append(start)
        assert (refinement, experiments, problem.name) == (SOLID, ("beam",), "stated")
        assert unit.tolist() == ([0.5] if start is None else [units[min(len(starts) - 2, len(units) - 1)]])
        return SimpleNamespace(added=lambda experiments: (f"{experiments[0]} corrected {len(starts)}",))

    def with_change(changed: Any, now: Any, found: Any) -> Any:
        i = len(starts) - 1
        assert now.experiments == (("beam",) if i == 0 else (f"beam corrected {i}",))
        assert found.unit[0] == (0.5 if i == 0 else units[min(i - 1, len(units) - 1)])
        return changed, optimum(units[min(i, len(units) - 1)], objectives[min(i, len(objectives) - 1)])

    monkeypatch.setattr(corrected_optimum, "_change", change)
    monkeypatch.setattr(corrected_optimum, "_with_change", with_change)
    corrected, found, (effect,) = corrected_optimum._with_depth(Fit("stated"), optimum(0.5))  # type: ignore[arg-type]
    if units == [0.51]:
        passes = 2
    assert len(starts) == passes
    assert starts[0] is None
    assert found.unit[0] == end
    assert effect.moved == pytest.approx([end - 0.5])
    assert (effect.share, effect.least_percent) == (pytest.approx(share), 0.15)
    assert corrected.experiments != ("beam",)


def test_without_an_equilibrium_of_the_solid_the_fit_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corrected_optimum, "_change", lambda *_: None)
    fit, start = Fit("stated"), optimum(0.5)
    assert corrected_optimum._with_depth(fit, start) == (fit, start, [])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("valid_from", "end"), [(0.0, 0.25), (0.2, 0.25), (0.3, 0.5), (0.6, 0.75), (0.8, 1.0), (1.1, 0.0)]
)
def test_an_unstable_candidate_moves_toward_the_middle_until_it_is_valid(valid_from: float, end: float) -> None:
    start = np.array([0.9, 1.0, 0.2])

    def evaluate(units: np.ndarray, points: float) -> Any:
        assert (units[:, 0].tolist(), points) == ([0.9], 1.0)
        moved = (1.0 - units[:, 1]) / 0.5
        return SimpleNamespace(objective_mm=np.where(moved >= valid_from, 1.0, DISCARDED_MM))

    found = corrected_optimum._valid(SimpleNamespace(evaluate=evaluate), start)  # type: ignore[arg-type]
    assert found == pytest.approx([0.9, 1.0 - 0.5 * end, 0.2 + 0.3 * end])


@pytest.mark.parametrize(("second_count", "runs"), [(100 * np.exp(0.29), 1), (100 * np.exp(0.31), 2), (70.0, 2)])
def test_a_fit_with_priors_is_repeated_if_the_number_of_points_was_wrong(
    monkeypatch: pytest.MonkeyPatch, second_count: float, runs: int
) -> None:
    counts: list[float] = []

    def polish(evaluate: Any, unit: np.ndarray, *_: Any) -> Any:
        counts.append(evaluate)
        before = corrected_optimum.Polish(10.0 / len(counts), 1.0, 3)
        return corrected_optimum.Optimum(unit + 0.1, "evaluation", np.ones(1), before)

    monkeypatch.setattr(corrected_optimum, "polish", polish)
    monkeypatch.setattr(corrected_optimum, "independent_points", lambda *_: 100.0)
    about = SimpleNamespace(about=SimpleNamespace(likelihood_points=second_count))
    monkeypatch.setattr(corrected_optimum, "linearise_noise", lambda *_: about)
    fit: Any = SimpleNamespace(
        has_more_than_edges=True,
        nearby=lambda count: count,
        unknowns=SimpleNamespace(whole=lambda unit: unit[None] + 1),
        evaluate=lambda *_: SimpleNamespace(comparison=SimpleNamespace(misfits=())),
    )
    found = corrected_optimum._polished(fit, np.zeros(1))
    assert counts == pytest.approx([100.0, second_count][:runs])
    assert found.unit[0] == pytest.approx(1 + 0.1 * runs)
    assert (found.polish.mean_error_before_mm, found.polish.steps) == (10.0, 3 * runs)


def test_a_fit_of_edges_alone_is_polished_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corrected_optimum, "polish", lambda *given: given)
    fit: Any = SimpleNamespace(has_more_than_edges=False, nearby=lambda count: count)
    assert corrected_optimum._polished(fit, "unit", "start", 0.3) == (1.0, "unit", "start", 0.3)  # type: ignore[arg-type]


# The measured shape without load


def noted(notes: list[Any], note: Any, result: Any) -> Any:
    # Return `result`, and add `note` to the list of calls, `notes`.
    notes.append(note)
    return result


def linear_rest(monkeypatch: pytest.MonkeyPatch, slopes: np.ndarray, offsets: np.ndarray) -> list[int]:
    # Replace the residuals of the unloaded beam by linear functions of its shape and of the places of pictures. The
    # returned list receives the number of pictures at each call.
    calls: list[int] = []

    def residuals(amplitudes: np.ndarray, modulus_Pa: float, pictures: Any) -> list[np.ndarray]:
        assert modulus_Pa == 30e3
        calls.append(len(pictures))
        return [offsets + slopes @ np.concatenate([amplitudes, picture]) for picture in pictures]

    monkeypatch.setattr(measured_rest_shape, "_shaped", lambda rest, amplitudes: amplitudes)
    monkeypatch.setattr(measured_rest_shape, "_picture", lambda picture: picture)
    monkeypatch.setattr(measured_rest_shape, "_residuals", residuals)
    return calls


def test_deviations_of_the_shape_are_fitted_together_with_turn_and_shift_of_the_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    modes = len(measured_rest_shape._STEPS_MM)
    rng = np.random.default_rng(3)
    slopes = rng.normal(size=(60, modes + 2))
    truth = np.concatenate([0.3 * rng.normal(size=modes), [0.2, -0.05]])
    noise = 0.01 * np.array([1.0, -1.0] * 30)
    calls = linear_rest(monkeypatch, slopes, -slopes @ truth + noise)
    fitted = measured_rest_shape._amplitudes(None, 30e3, np.zeros(modes), np.arange(modes))  # type: ignore[arg-type]
    assert fitted is not None
    amplitudes, sigma = fitted
    assert calls == [3, *[1] * modes] * 2
    expected = truth - np.linalg.lstsq(slopes, noise, rcond=None)[0]
    assert amplitudes == pytest.approx(expected[:-2], abs=1e-5)
    remaining = noise - slopes @ np.linalg.lstsq(slopes, noise, rcond=None)[0]
    tau = measured_rest_shape.correlation_length(remaining[None], np.ones((1, 60)))
    spread = np.sqrt(np.mean(remaining**2) * tau)
    covariance = np.linalg.inv(slopes.T @ slopes)
    assert sigma == pytest.approx(np.hypot(spread * np.sqrt(np.diag(covariance)[:-2]), 1e-3), rel=1e-3)


def test_unused_deviations_keep_their_start_and_have_no_uncertainty(monkeypatch: pytest.MonkeyPatch) -> None:
    modes = len(measured_rest_shape._STEPS_MM)
    slopes = np.random.default_rng(3).normal(size=(60, modes + 2))
    start = np.full(modes, 0.1)
    linear_rest(monkeypatch, slopes, -slopes[:, :modes] @ start)
    amplitudes, sigma = measured_rest_shape._amplitudes(None, 30e3, start, np.array([1]))  # type: ignore[arg-type, misc]
    assert np.delete(amplitudes, 1).tolist() == [0.1] * (modes - 1)
    assert np.delete(sigma, 1).tolist() == [0.0] * (modes - 1)
    assert sigma[1] >= 1e-3
    assert start.tolist() == [0.1] * modes


def test_a_deviation_that_the_edges_do_not_show_is_held_by_its_prior(monkeypatch: pytest.MonkeyPatch) -> None:
    modes = len(measured_rest_shape._STEPS_MM)
    slopes = np.zeros((60, modes + 2))
    slopes[:, 0] = np.where(np.arange(60) % 2, 1e-3, -1e-3)  # the information 60 (1e-3)^2 beside (1e-3 / 5)^2
    linear_rest(monkeypatch, slopes, -slopes[:, 0] * 2.0)
    amplitudes, sigma = measured_rest_shape._amplitudes(None, 30e3, np.zeros(modes), np.arange(modes))  # type: ignore[arg-type, misc]
    information, prior = 60 * 1e-6, (1e-3 / 5.0) ** 2
    share = information / (information + prior)
    assert amplitudes[0] == pytest.approx(2.0 * share * (1 + (1 - share)), rel=1e-6)  # two steps, each toward the data
    assert not amplitudes[1:].any()
    assert sigma[0] >= 1e-3


@pytest.mark.parametrize(("spread_mm", "kept"), [(0.199, True), (0.201, False)])
def test_a_state_that_remains_far_from_every_shape_measures_no_shape(
    monkeypatch: pytest.MonkeyPatch, spread_mm: float, kept: bool
) -> None:
    modes = len(measured_rest_shape._STEPS_MM)
    linear_rest(monkeypatch, np.zeros((60, modes + 2)), np.full(60, spread_mm))
    fitted = measured_rest_shape._amplitudes(None, 30e3, np.zeros(modes), np.arange(modes))  # type: ignore[arg-type]
    assert (fitted is not None) is kept


def test_a_beam_without_equilibrium_measures_no_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    modes = len(measured_rest_shape._STEPS_MM)
    for last in range(1, 3):
        calls = iter([[np.zeros(4)] * 3] * (last - 1) + [None])
        linear_rest(monkeypatch, np.zeros((4, modes + 2)), np.zeros(4))
        monkeypatch.setattr(measured_rest_shape, "_residuals", lambda *_, calls=calls: next(calls))
        assert measured_rest_shape._amplitudes(None, 30e3, np.zeros(modes), np.arange(modes)) is None  # type: ignore[arg-type]


def test_the_picture_turns_by_its_roll_and_moves_across_the_clamp() -> None:
    setup = measured_rest_shape._picture(np.array([0.0, 0.3]))
    points = np.array([[[[4.0, 1.0]]]])
    moved = setup.corrected(points)[0, 0, 0, 0] - points[0, 0, 0]
    assert abs(moved[1]) == pytest.approx(0.3)
    assert moved[0] == pytest.approx(0.0)
    turned = measured_rest_shape._picture(np.array([90.0, 0.0])).corrected(points)[0, 0, 0, 0]
    assert np.abs(turned) == pytest.approx([1.0, 4.0])


def test_a_measured_shape_states_its_uncertainties() -> None:
    model = BeamModel(SPECIMEN, 6, 2)
    experiment = Experiment(model, None, None)  # type: ignore[arg-type]
    other = replace(SPECIMEN, width_mm=3.1)
    shape = MeasuredRestShape(other, (0.2, 0.0), (0.1, -0.3), 0.05, 0.02)
    applied = shape.applied(experiment, "a state at rest")
    assert applied.model.specimen == other
    stated = {one.source: one for one in applied.stated}
    assert applied.measured["rest-shape"] == (0.2, 0.0)
    assert applied.measured["taper"] == pytest.approx((2.0 * 0.1, 1.5 * -0.3))
    assert {name: (one.standard_uncertainty, one.of) for name, one in stated.items()} == {
        "rest-shape": (0.05, "a state at rest"),
        "taper": (0.04, "a state at rest"),
    }
    none = replace(shape, bend_sigma_mm=0.0).applied(applied)
    assert [one.source for one in none.stated] == ["taper"]


@pytest.mark.parametrize(("used", "ends"), [([0], False), ([0, 3], False), ([], True)])
def test_shape_and_modulus_of_a_beam_are_measured_in_turn(
    monkeypatch: pytest.MonkeyPatch, used: list[int], ends: bool
) -> None:
    modes, bends = measured_rest_shape._MODES, measured_rest_shape.BENDS
    fits: list[tuple[float, list[float], list[int]]] = []
    moduli: list[float] = []

    def amplitudes(rest: Any, modulus_Pa: float, start: Any, which: Any) -> Any:
        fits.append((modulus_Pa, start.tolist(), which.tolist()))
        return np.full(modes, 0.1 * len(fits)), np.full(modes, 0.01)

    def nearby(bent: Any, modulus_Pa: float) -> float:
        moduli.append(modulus_Pa)
        return modulus_Pa + 1.0

    def significant(found: Any, sigma: Any) -> Any:
        return np.arange(modes) if len(fits) == 1 else np.array(used, int)

    monkeypatch.setattr(measured_rest_shape, "_amplitudes", amplitudes)
    monkeypatch.setattr(measured_rest_shape, "_scanned_modulus", lambda bent: 100.0)
    monkeypatch.setattr(measured_rest_shape, "_nearby_modulus", nearby)
    monkeypatch.setattr(measured_rest_shape, "_significant", significant)
    monkeypatch.setattr(measured_rest_shape, "on_coarse_mesh", lambda experiments: experiments)
    coarse: list[int] = []
    monkeypatch.setattr(
        measured_rest_shape, "coarsened", lambda experiments: [noted(coarse, len(e.loads), e) for e in experiments]
    )
    states = 9  # the first is without field
    loads = Loads.along(np.arange(states))
    observed = EdgeObservation(np.zeros((states, 2, 2, 2)), np.ones((states, 2, 2)))
    found = measured_rest_shape.measured_rest_shape(Experiment(BeamModel(SPECIMEN, 6, 2), loads, observed))
    every = list(range(modes))
    assert coarse == [4]
    assert moduli == [100.0, 101.0, 102.0]
    assert [(modulus, which) for modulus, _, which in fits[:4]] == [
        (1e6, every), (100.0, every), (101.0, every), (102.0, every)
    ]  # fmt: skip
    assert [start[0] for _, start, _ in fits[:4]] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    if ends:
        assert (found, len(fits)) == (None, 4)
        return
    assert found is not None
    assert fits[4] == (103.0, [pytest.approx(0.4) if i in used else 0.0 for i in every], used)
    assert found.bends_mm == pytest.approx([0.5] * bends)
    assert found.widths_mm == pytest.approx([0.5] * (modes - bends))
    of_one = np.hypot(0.01, 0.015 * 0.5)
    assert found.bend_sigma_mm == pytest.approx(of_one)
    assert found.width_sigma_mm == pytest.approx(of_one if 3 in used and bends <= 3 else 0.0)


def test_the_scan_of_a_bent_beam_counts_twenty_points_a_state(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(measured_rest_shape, "scanned", lambda problem, points: noted(asked, points, "scan"))
    monkeypatch.setattr(
        measured_rest_shape,
        "narrowed",
        lambda problem, scan, points: noted(asked, (scan, points), SimpleNamespace(best_Pa=5.0)),
    )
    monkeypatch.setattr(measured_rest_shape, "_nearby_modulus", lambda bent, near_Pa: 2 * near_Pa)
    loads = Loads.along([0.0, 1.0, 2.0])
    experiment = Experiment(BeamModel(SPECIMEN, 6, 2), loads, None)  # type: ignore[arg-type]
    assert measured_rest_shape._scanned_modulus(experiment) == 10.0
    assert asked == [60.0, ("scan", 60.0)]


def test_a_turn_and_a_shift_of_the_picture_have_their_own_priors(monkeypatch: pytest.MonkeyPatch) -> None:
    modes, points = len(measured_rest_shape._STEPS_MM), 60
    turned, shifted = np.linspace(-1, 1, points), np.cos(np.arange(points))
    slopes = np.zeros((points, modes + 2))
    # A bend looks like a turn of the picture, and a change of the width like a shift: the priors decide.
    slopes[:, 1] = slopes[:, modes] = turned
    slopes[:, modes - 1] = slopes[:, modes + 1] = shifted
    offsets = -2.0 * turned + 0.3 * shifted
    linear_rest(monkeypatch, slopes, offsets)
    amplitudes, _ = measured_rest_shape._amplitudes(None, 30e3, np.zeros(modes), np.arange(modes))  # type: ignore[arg-type, misc]
    # The bend has the prior 5 mm beside 1 degree, the width 0.5 mm beside 0.2 mm.
    assert amplitudes[1] == pytest.approx(2.0 * 25 / 26, rel=1e-4)
    assert amplitudes[modes - 1] == pytest.approx(-0.3 * 0.25 / 0.29, rel=1e-4)
