"""Plans of measurements, searches for an optimum and unknowns of a fit agree with calculations by hand."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.stats

from eimi_fitting import LAWS, Loads, Magnet, Specimen
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.quantity import NORMAL_95
from eimi_fitting.inference.evidence.unknowns import Nuisance, Unknowns
from eimi_fitting.inference.planning import modulus_so_far, section_bias
from eimi_fitting.inference.planning.compressibility import bulk_ratio, compressibility_bias
from eimi_fitting.inference.planning.design_of_experiment import (
    Candidates,
    EdgeNoise,
    KnownLaw,
    _goal,
    weight_of_point,
)
from eimi_fitting.inference.planning.exchange import _exchanged, _filled, equally_spaced, exchange
from eimi_fitting.inference.planning.modulus_so_far import ModulusSoFar
from eimi_fitting.inference.planning.rival_laws import Rivals
from eimi_fitting.inference.searching import measured_rest_shape, modulus_range, named_causes, polish, search
from eimi_fitting.inference.searching.modulus_range import Scan
from eimi_fitting.laws.search_space import search_space

LOADS = Loads.along([1.0, 2.0, 3.0])


def plan(sources: int = 1, **more: Any) -> Candidates:
    rng = np.random.default_rng(4)
    normal = np.array([2.0, 5.0, 3.0])[:, None, None]
    given = {
        "loads": LOADS, "states": np.arange(3), "normal": normal, "source_score": rng.normal(size=(3, 1, sources)),
        "sources": tuple(f"input {k}" for k in range(sources)), "prior": np.array([[0.4]]), "goal": np.array([0.3]),
        "points": 6.0, "irreducible": 0.02,
    }  # fmt: skip
    return Candidates(**(given | more))


def test_the_variance_of_a_plan_has_noise_prior_inputs_and_the_error_that_remains() -> None:
    one, choice = plan(sources=2), np.array([0, 2])
    information, score = 5.0, one.source_score[choice].sum(axis=0)[0]
    gain = 0.3 / (information + 0.4)
    t = scipy.stats.t.ppf(0.975, min(6.0 * 2 - 1, 2 * 2 - 1)) / NORMAL_95
    expected = t**2 * gain**2 * information + gain**2 * 0.4 + ((gain * score) ** 2).sum() + 0.02**2
    assert one.variance(choice[None])[0] == pytest.approx(expected)
    assert one.half_width_percent(choice) == pytest.approx(100 * NORMAL_95 * np.sqrt(expected))
    signed = one.signed_effects_percent(choice)
    assert [signed["input 0"], signed["input 1"]] == pytest.approx(100 * gain * score)
    largest = [f"input {k}" for k in np.argsort(-np.abs(score))]
    assert list(one.effects_percent(choice)) == largest
    assert min(one.effects_percent(choice).values()) > 0


@pytest.mark.parametrize(("points", "states", "freedom"), [(6.0, 2, 3.0), (0.9, 4, 2.6), (6.0, 4, 7.0), (0.1, 2, 1.0)])
def test_few_points_widen_an_interval_as_students_t(points: float, states: int, freedom: float) -> None:
    expected = scipy.stats.t.ppf(0.975, freedom) / NORMAL_95
    assert plan(points=points)._widened(states) == pytest.approx(expected, rel=1e-6)


def test_no_choice_is_better_than_the_lower_bound_of_a_plan() -> None:
    one = plan(sources=2)
    for count in (2, 3):
        bound = one.least_percent(count)
        for choice in combinations(range(3), count):
            assert bound <= one.half_width_percent(np.array(choice)) + 1e-9
    alone = plan(sources=1, source_score=np.array([[[1.0]], [[-2.5]], [[3.0]]]))
    most = 2 * 5.0
    noise = (0.3 / (most + 0.4)) ** 2 * (alone._widened(2) ** 2 * most + 0.4)
    # States whose errors by the input have opposite signs could cancel it.
    assert alone.least_percent(2) == pytest.approx(100 * NORMAL_95 * np.sqrt(noise + 0.02**2), rel=1e-3)
    same = plan(sources=1, source_score=np.array([[[1.0]], [[2.5]], [[3.0]]]))
    least = 0.3 * min(1.0 / 2.0, 2.5 / 5.0, 3.0 / 3.0) * most / (most + 0.4)
    assert same.least_percent(2) == pytest.approx(100 * NORMAL_95 * np.sqrt(noise + least**2 + 0.02**2), rel=1e-3)
    with pytest.raises(ValueError, match="for a law with one unknown only, not with 2"):
        plan(goal=np.ones(2)).least_percent(2)


def test_the_noise_of_a_plan_follows_an_earlier_fit() -> None:
    earlier: Any = SimpleNamespace(
        noise_points=20.0, independent_points=30.0, noise_mm=0.004, residual_mm=0.01, points=500
    )
    noise = EdgeNoise.of(earlier, 6, 0.3)
    assert (noise.residual_mm, noise.points, noise.alike, noise.left_percent) == (0.004, 83, 25.0, 0.3)
    earlier.noise_points = earlier.noise_mm = None
    assert EdgeNoise.of(earlier, 5) == EdgeNoise(0.01, 100, 500 / 30, 0.0)
    assert weight_of_point(EdgeNoise(0.01, 100, 5.0), 25) == pytest.approx(100 / 50 / (5.0 * 1e-4))


def test_a_known_law_lies_in_the_middle_of_three_decades() -> None:
    known = KnownLaw(LAWS["yeoh"], np.array([20e3, 1e4, -2e3]))
    unknowns, unit = known.unknowns()
    assert unknowns.space.lower[0] == pytest.approx(40e3 / 10**1.5)
    assert unknowns.space.upper[0] == pytest.approx(40e3 * 10**1.5)
    assert unit[0] == pytest.approx(0.5)
    assert unknowns.space.parameters(unit[None])[0] == pytest.approx(known.parameters, rel=1e-6)
    goal = _goal(known, unknowns, unit, "initial shear modulus")
    assert goal == pytest.approx([np.log(1e3), 0.0, 0.0], abs=1e-4)
    of_c20 = _goal(known, unknowns, unit, "C20")
    assert of_c20 == pytest.approx([np.log(1e3), 20e3 * 3.0 / 1e4, 0.0], abs=1e-3)


class Sum:
    # A criterion for a choice of states: the sum of a given value for each chosen state.

    def __init__(self, numbers: list[float]) -> None:
        self.numbers = np.array(numbers)

    def __len__(self) -> int:
        return len(self.numbers)

    def variance(self, choices: np.ndarray) -> np.ndarray:
        return np.asarray(self.numbers[choices].sum(axis=1))


def test_states_are_filled_in_and_exchanged_one_by_one() -> None:
    assert [equally_spaced(*given).tolist() for given in ((11, 3), (4, 4), (5, 1), (3, 7))] == [
        [0, 5, 10], [0, 1, 2, 3], [0], [0, 1, 2]
    ]  # fmt: skip
    criterion = Sum([5.0, 1.0, 4.0, 2.0, 3.0])
    assert _filled(criterion, 3).tolist() == [1, 3, 4]
    assert sorted(_exchanged(criterion, np.array([0, 2, 4])).tolist()) == [1, 3, 4]
    assert exchange(criterion, 2).tolist() == [1, 3]
    assert exchange(criterion, 5).tolist() == [0, 1, 2, 3, 4]
    nearly = Sum([1.0, 1.0 - 0.9e-6])  # a gain below a millionth does not count
    assert _exchanged(nearly, np.array([0])).tolist() == [0]
    assert _exchanged(Sum([1.0, 1.0 - 1.2e-6]), np.array([0])).tolist() == [1]


def test_two_laws_are_as_far_apart_as_a_fit_of_the_other_one_leaves() -> None:
    square, score, normal = np.array([9.0, 4.0]), np.array([[2.0], [1.0]]), np.array([[[3.0]], [[1.0]]])
    rivals = Rivals(LOADS, np.arange(2), square, score, normal, np.array([[0.5]]))
    assert rivals.apart(np.array([0, 1])) == pytest.approx(13.0 - 3.0**2 / 4.5)
    assert rivals.apart(np.array([0])) == pytest.approx(9.0 - 2.0**2 / 3.5)
    assert len(rivals) == 2
    nothing = replace(rivals, square=np.zeros(2), score=np.zeros((2, 1)))
    assert nothing.apart(np.array([0])) == pytest.approx(1e-12)


def test_a_compressible_material_is_softer_than_the_fitted_one() -> None:
    assert bulk_ratio(0.49) == pytest.approx(2 * 1.49 / (3 * 0.02))
    assert compressibility_bias(Specimen(30.0, 3.0, 5.0, 1e3, "plane-stress"), 0.4) == pytest.approx(2.8 / 3 - 1)


@pytest.mark.parametrize(
    ("magnetisation", "angle_deg"),
    [((0.0, 0.0), None), ((5e3, 0.0), None), ((0.0, -5e3), None), ((0.0, 0.0), 90.0), ((5e3, 0.0), -80.0)],
)
def test_the_loads_of_a_bias_turn_the_tip_by_sixty_degrees_if_the_stiffness_stayed(
    magnetisation: tuple[float, float], angle_deg: float | None
) -> None:
    magnet = None if angle_deg is None else Magnet(4.0, 3.0, 2.0, 1.2, 7500.0, magnetisation_angle_deg=angle_deg)
    specimen = Specimen(40.0, 3.0, 5.0, 1e3, "plane-stress", magnet, magnetisation_A_per_m=magnetisation)
    planar = BeamModel(specimen, 8, 1)
    loads = section_bias.bending_loads(planar)
    assert len(loads) == 2
    assert not loads.gravity.any()
    law, modulus = LAWS["neo-hookean"], np.array([[50e3]])
    small = replace(loads, field_T=1e-3 * loads.field_T, tip_force_N=1e-3 * loads.tip_force_N)
    turn = planar.tip_angle_deg(planar.solve(law, modulus, small, tolerance_mm=1e-9))[0]
    assert np.abs(turn) == pytest.approx([0.03, 0.06], rel=1e-3)
    is_magnetic = any(magnetisation) or magnet is not None
    assert loads.field_T.any() == is_magnetic
    assert loads.tip_force_N.any() == (not is_magnetic)
    # The field is across the moment: it is not much stronger than that for a moment along the beam.
    assert np.linalg.norm(loads.field_T, axis=1).max() < 0.1


def so_far(
    value: float, low: float, high: float, noise: float = 2.0, narrowest: float = 10.0, **more: Any
) -> ModulusSoFar:
    return ModulusSoFar(value, (low, high), 0.01, 3, "width", (1e3, 1e6), np.array([0.5]), narrowest, noise, **more)


@pytest.mark.parametrize(
    ("now", "is_kept"),
    [
        (so_far(101.0, 95.0, 105.4), False),  # as narrow as the narrowest interval and 5 %
        (so_far(101.0, 95.0, 105.6), True),
        (so_far(106.0, 90.0, 120.0), False),  # outside the earlier interval
        (so_far(101.0, 90.0, 120.0, noise=3.7), True),  # more noise would widen the earlier interval by 5 %
        (so_far(101.0, 90.0, 120.0, noise=3.9), False),
        (so_far(101.0, 90.0, 120.0, noise=1.0), True),
    ],
)
def test_an_earlier_estimate_is_kept_while_it_is_narrower_and_valid(
    monkeypatch: pytest.MonkeyPatch, now: ModulusSoFar, is_kept: bool
) -> None:
    before = so_far(100.0, 95.0, 105.0)
    monkeypatch.setattr(modulus_so_far, "_estimated", lambda experiment, earlier: now)
    found = modulus_so_far.modulus_so_far(None, before)  # type: ignore[arg-type]
    assert (found.value_Pa == before.value_Pa) is is_kept
    assert found.unit is now.unit
    assert found.narrowest_Pa == (10.0 if found.width_Pa <= 10.5 or is_kept else now.narrowest_Pa)
    assert modulus_so_far.modulus_so_far(None) is now  # type: ignore[arg-type]


def test_a_scan_reaches_from_three_lengths_to_a_ten_millionth(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modulus_range, "_compliance", lambda problem: 6e3)
    asked: list[np.ndarray] = []

    def evaluated(problem: Any, moduli: np.ndarray, points: float) -> Any:
        asked.append(moduli)
        return SimpleNamespace(objective_mm=moduli)

    monkeypatch.setattr(modulus_range, "evaluated", evaluated)
    found = modulus_range.scanned(None, 7.0)  # type: ignore[arg-type]
    assert (found.moduli_Pa[0], found.moduli_Pa[-1]) == (pytest.approx(2e3), pytest.approx(6e10))
    assert len(found.moduli_Pa) == 1 + round(2 * np.log10(3e7))
    assert np.array_equal(found.objective_mm, asked[0])


def test_candidates_of_a_scan_have_their_moduli_and_the_middle_of_the_other_coordinates() -> None:
    given = Problem(LAWS["yeoh"], Unknowns(search_space(LAWS["yeoh"])), ())
    unknowns, unit = modulus_range._candidates(given, np.array([1e3, 5e4, 1e7]))
    parameters = unknowns.parameters(unit)
    assert 2 * parameters[:, 0] == pytest.approx([1e3, 5e4, 1e7])
    assert unit[:, 1:] == pytest.approx(0.5 * np.ones((3, 2)))
    assert (unknowns.space.lower[0], unknowns.space.upper[0]) == (1e3, 2e7)


def scans(*mm: float) -> Scan:
    return Scan(np.array([1e3, 1e9]), np.array([mm[0], mm[1]]))


@pytest.mark.parametrize(
    ("stated_mm", "without_mm", "outcome"),
    [(0.039, 0.001, "accepted"), (0.041, 0.0163, "named"), (0.041, 0.0165, "accepted"), (0.199, 0.001, "named"),
     (0.201, 0.001, "refused")],
)  # fmt: skip
def test_mistakes_in_loads_are_named_by_the_ratio_of_the_errors(
    monkeypatch: pytest.MonkeyPatch, stated_mm: float, without_mm: float, outcome: str
) -> None:
    monkeypatch.setattr(named_causes, "replace", lambda one, **new: SimpleNamespace(**(vars(one) | new)))
    monkeypatch.setattr(named_causes, "scanned", lambda problem, points: scans(stated_mm, 1.0))
    monkeypatch.setattr(named_causes, "narrowed", lambda problem, scan, points: scan)
    monkeypatch.setattr(
        named_causes,
        "_error_without",
        lambda problem, cause, points: without_mm if cause.slip == "force_reversed" else 0.9,
    )
    problem: Any = SimpleNamespace(experiments=("one",), unknowns=Unknowns(search_space(LAWS["yeoh"])), curves=())
    if outcome == "refused":
        with pytest.raises(
            named_causes.NamedCause, match=r"without tip forces in the opposite direction only 0\.001 mm"
        ):
            named_causes.doubtful_loads(problem, scans(stated_mm, 1.0), 7.0)
        return
    found = named_causes.doubtful_loads(problem, scans(stated_mm, 1.0), 7.0)
    assert [(one.slip, one.experiment, one.error_mm) for one in found] == [
        ("force_reversed", 0, stated_mm)
    ] * (outcome == "named")  # fmt: skip


def test_each_mistake_in_the_loads_is_undone() -> None:
    loads = Loads.along([1.0, 2.0], tip_force_N=[0.1, 0.2], tip_force_angle_deg=[0.0, 90.0], gravity_angle_deg=0.0)
    undone = {cause.slip: cause.loads(loads) for cause in named_causes.CAUSES}
    assert undone["field_reversed"].field_T.tolist() == (-loads.field_T).tolist()
    assert undone["field_too_large"].field_T == pytest.approx(1e-3 * loads.field_T)
    assert undone["field_too_small"].field_T == pytest.approx(1e3 * loads.field_T)
    assert undone["force_reversed"].tip_force_N.tolist() == (-loads.tip_force_N).tolist()
    assert undone["force_too_large"].tip_force_N == pytest.approx(1e-3 * loads.tip_force_N)
    assert not undone["gravity_absent"].gravity.any()
    turned = undone["gravity_reversed"]
    assert turned.gravity.tolist() == (-loads.gravity).tolist()
    # The force along gravity is a weight and turns with it; the force across gravity is none.
    assert turned.tip_force_N[0] == pytest.approx(-loads.tip_force_N[0])
    assert turned.tip_force_N[1] == pytest.approx(loads.tip_force_N[1])


def test_states_with_a_fiftieth_of_the_largest_load_count_as_unloaded() -> None:
    def unloaded(field_mT: list[float], force_N: list[float], pressure_Pa: float = 0.0) -> list[int]:
        loads = Loads.along(field_mT, tip_force_N=force_N, pressure_Pa=pressure_Pa)
        return measured_rest_shape.unloaded_states(SimpleNamespace(loads=loads)).tolist()  # type: ignore[arg-type]

    assert unloaded([0.0, 0.199, 0.201, -10.0], [0.0] * 4) == [0, 1]
    assert unloaded([0.0] * 4, [0.0, 0.019, 0.021, 1.0]) == [0, 1]
    assert unloaded([0.0, 0.1, 10.0, 0.0], [0.0, 0.0, 0.0, 1.0]) == [0, 1]
    assert unloaded([0.0, 10.0], [0.0, 0.0], 5.0) == []


def test_a_deviation_of_the_shape_is_significant_beyond_three_standard_deviations_and_a_few_micrometres() -> None:
    sigma = np.full(5, 1e-3)
    amplitudes = np.array([5.1e-3, -5.1e-3, 4.9e-3, 3.1e-3, -2.9e-3])
    assert measured_rest_shape._significant(amplitudes, sigma).tolist() == [0, 1, 3]
    assert measured_rest_shape._significant(np.full(5, 0.031), np.full(5, 0.01)).tolist() == [0, 1, 2, 3, 4]
    assert measured_rest_shape._significant(np.full(5, 0.029), np.full(5, 0.01)).tolist() == []


def test_the_best_modulus_nearby_is_that_of_a_parabola_of_the_mean_squares(monkeypatch: pytest.MonkeyPatch) -> None:
    def nearby(best_log: float, curvature: float = 1.0) -> float:
        monkeypatch.setattr(
            measured_rest_shape,
            "_errors_mm",
            lambda bent, moduli: np.sqrt(2.0 + curvature * (np.log(moduli / 50e3) - best_log) ** 2),
        )
        return float(np.log(measured_rest_shape._nearby_modulus(None, 50e3) / 50e3))  # type: ignore[arg-type]

    assert nearby(0.1) == pytest.approx(0.1)
    assert nearby(0.5) == pytest.approx(0.3)  # not farther than the parabola holds
    assert nearby(-0.5) == pytest.approx(-0.3)
    assert nearby(0.1, -1.0) == 0.0
    monkeypatch.setattr(measured_rest_shape, "_errors_mm", lambda bent, moduli: np.array([1.0, DISCARDED_MM]))
    assert measured_rest_shape._nearby_modulus(None, 50e3) == 50e3  # type: ignore[arg-type]


def test_a_step_of_the_polish_has_gradient_and_hessian_of_the_weighted_residuals() -> None:
    rng = np.random.default_rng(5)
    slopes, middle, distance = rng.normal(size=(2, 3, 2, 4)), rng.normal(size=(3, 2, 4)), np.array([0.02, 0.1])
    half = 0.5 * distance[:, None, None, None] * slopes
    error = np.sqrt((middle**2).mean(axis=(1, 2)))
    misfit = Misfit(
        np.concatenate([middle[None], middle + half, middle - half]), np.ones((3, 2, 4)), np.tile(error, (5, 1)),
        np.zeros((5, 3)),
    )  # fmt: skip
    gradient, hessian = polish._normal_equations([misfit, misfit], distance)
    weight = 1 / (8 * error)

    def errors(step: np.ndarray) -> float:
        residuals = middle + np.tensordot(step, slopes, axes=1)
        return float(2 * np.sqrt((residuals**2).mean(axis=(1, 2))).sum())

    h = 1e-5
    expected = [(errors(h * e) - errors(-h * e)) / (2 * h) for e in np.eye(2)]
    assert gradient == pytest.approx(expected, rel=1e-6)
    assert hessian == pytest.approx(2 * np.einsum("ikgn,jkgn,k->ij", slopes, slopes, weight))


class Bowl:
    # A replacement for a fit: the objective is a distance from (0.6, 0.6), and the residuals are the coordinates.

    def __init__(self, power: float = 1.0) -> None:
        self.power, self.asked = power, 0

    def __call__(self, units: np.ndarray, near: Any) -> Any:
        self.asked += 1
        residuals = (units - 0.6)[:, None, None, :]
        error = np.sqrt((residuals**2).mean(axis=(2, 3))) + 1e-9
        return SimpleNamespace(
            objective_mm=error[:, 0] ** self.power, misfits=[Misfit(residuals, np.ones((1, 1, 2)), error, error)]
        )


def test_a_polish_ends_when_a_step_lowers_the_objective_by_less_than_asked() -> None:
    bowl = Bowl()
    found = polish.polish(bowl, np.array([0.4, 0.9]))
    assert found.unit == pytest.approx([0.6, 0.6], abs=1e-3)
    assert found.polish.mean_error_before_mm == pytest.approx(np.sqrt((0.2**2 + 0.3**2) / 2), rel=1e-6)
    assert 1 < found.polish.steps <= 12
    once = polish.polish(Bowl(), np.array([0.4, 0.9]), enough=1e9)
    assert once.polish.steps == 1
    assert once.polish.mean_error_after_mm < once.polish.mean_error_before_mm
    stuck = polish.polish(Bowl(-1.0), np.array([0.4, 0.9]))  # every step raises this objective
    assert stuck.polish.steps == 0
    assert stuck.unit.tolist() == [0.4, 0.9]


def test_a_search_ends_when_a_valid_generation_is_flat() -> None:
    assert search._reason_of_population(np.array([1.0, 1.49]), 0.5) == ["population"]
    assert search._reason_of_population(np.array([1.0, 1.51]), 0.5) == []
    assert search._reason_of_population(np.array([1.0, DISCARDED_MM]), 1e9) == []


def test_an_unknown_input_spans_six_standard_deviations_on_either_side() -> None:
    width = Nuisance("width", "width", 0, (0,), 0.02)
    of_second = Nuisance("scale", "scale", 0, (1,), 0.01)
    unknowns = Unknowns(search_space(LAWS["neo-hookean"]), (width, of_second))
    unit = np.array([[0.5, 0.5, 0.5], [0.5, 0.75, 0.5], [0.5, 0.5, 1.0]])
    assert width.value(np.array([0.5, 0.75, 1.0])) == pytest.approx([0.0, 0.06, 0.12])
    assert unknowns.standardised(unit) == pytest.approx(np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 6.0]]))
    first, second = unknowns.setups(unit, 2)  # type: ignore[misc]
    points = np.array([[[[10.0, 1.0]]]])
    assert first.corrected(points)[:, 0, 0, 0] == pytest.approx(np.tile(points[0, 0, 0], (3, 1)))
    moved = second.corrected(points)[:, 0, 0, 0]
    assert moved[:2] == pytest.approx(np.tile(points[0, 0, 0], (2, 1)))
    assert np.linalg.norm(moved[2]) / np.linalg.norm(points) == pytest.approx(1 / 1.06, rel=3e-3)
    assert Unknowns(search_space(LAWS["neo-hookean"])).setups(unit[:, :1], 2) is None
    assert unknowns.whole(unit[:, :1]) == pytest.approx(np.column_stack([unit[:, 0], 0.5 * np.ones((3, 2))]))
    assert unknowns.modulus_percent(0.01) == pytest.approx(100 * (1e3**0.01 - 1))


@pytest.mark.parametrize("unknowns", [1, 3])
def test_a_run_of_the_search_has_an_idle_second_coordinate_and_stops_at_small_changes(
    monkeypatch: pytest.MonkeyPatch, unknowns: int
) -> None:
    monkeypatch.setattr(search, "CMAEvolutionStrategy", lambda start, step, options: (start, step, options))
    rng, start = np.random.default_rng(1), np.full(unknowns, 0.3)
    begin, step, options = search._strategy(rng, start, 0.25, 12, 99)  # type: ignore[misc]
    assert (begin, step) == ([0.3, 0.5] if unknowns == 1 else [0.3] * 3, 0.25)
    assert [options[key] for key in ("tolx", "tolfun", "tolfunhist", "tolflatfitness")] == [1e-4, 2e-5, 2e-5, 10]
    assert (options["bounds"], options["popsize"], options["maxiter"]) == ([0, 1], 12, 99)
    assert options["CMA_stds"] == [search._MODULUS, *([0.1] if unknowns == 1 else [1.0, 1.0])]
    expected = np.random.default_rng(1).standard_normal((2, 3))
    np.testing.assert_array_equal(options["randn"](2, 3), expected)
