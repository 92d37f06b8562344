"""Fits handle rare cases, such as a beam that has no equilibrium on a finer mesh."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.discovery import terms_of_a_law
from eimi_fitting.discovery.tensile_rows import tensile_rows
from eimi_fitting.discovery.terms_of_a_law import discover
from eimi_fitting.inference.doubts.checks import slip_doubts
from eimi_fitting.inference.evidence._coarse import coarsened
from eimi_fitting.inference.evidence.corrections import polished
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM, Experiment
from eimi_fitting.inference.evidence.measurements import PointObservation
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.parameter_priors import INITIAL_SHEAR_MODULUS, Prior
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve, TensileEvidence
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, Unknowns, nuisances
from eimi_fitting.inference.identification import whole_fit
from eimi_fitting.inference.identification.whole_fit import _problem, _search, identify
from eimi_fitting.inference.interval import corrected_optimum, covariance, estimate, noise
from eimi_fitting.inference.interval.noise import linearise_noise
from eimi_fitting.inference.interval.profile_likelihood import Ends
from eimi_fitting.inference.planning import modulus_so_far
from eimi_fitting.inference.planning.design_of_experiment import EdgeNoise, KnownLaw, candidates, states_reached
from eimi_fitting.inference.planning.exchange import exchange
from eimi_fitting.inference.searching import measured_rest_shape
from eimi_fitting.inference.searching._cma import _Absent
from eimi_fitting.inference.searching.modulus_range import NothingActs, NothingConverged, narrowed, scanned
from eimi_fitting.inference.searching.named_causes import NamedCause, doubtful_loads
from eimi_fitting.inference.searching.polish import ENOUGH, polish
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space
from eimi_fitting.laws.sum_of_terms import Term
from eimi_fitting.laws.tensile import CannotFit
from tests.shared.quick_beam import quick_shapes
from tests.shared.quick_fits import BEAM, LOADS, edges, experiment, points

NEO = "neo-hookean"
WIDER = replace(BEAM, width_mm=3.05)
STRIP = Specimen(25.0, 2.5, 8.0, 1070.0, "plane-stress")
UNDER_FORCE = Loads.along([0.0] * 3, gravity_angle_deg=80.0, tip_force_N=[4e-4, -9e-4, 2.1e-3])


def problem(*experiments: Experiment, law: str = NEO) -> Problem:
    space = search_space(LAWS[law])
    return Problem(
        LAWS[law], Unknowns(replace(space, lower=(5e3, *space.lower[1:]), upper=(5e5, *space.upper[1:]))), experiments
    )


def fails_if(monkeypatch: pytest.MonkeyPatch, where: Callable[[BeamModel, Any], bool]) -> None:
    # Let a beam have no equilibrium if `where` is true for its model and its options.
    def solve(self: BeamModel, *given: Any, **options: Any) -> Any:
        shapes = quick_shapes(self, *given, **options)
        if where(self, options):
            shapes.status[...] = Status.DIVERGED
        return shapes

    monkeypatch.setattr(BeamModel, "solve", solve)


@pytest.mark.parametrize(("most_along", "effects"), [(13, 0), (26, 0), (60, 1)])
def test_a_fit_is_corrected_by_the_meshes_that_have_an_equilibrium(
    monkeypatch: pytest.MonkeyPatch, most_along: int, effects: int
) -> None:
    given = problem(experiment(edges(law=NEO)))
    given = replace(given, experiments=tuple(replace(one, model=one.model.halved()) for one in given.experiments))
    fails_if(monkeypatch, lambda model, options: model.along > most_along)
    end = corrected_optimum.refine(given, np.array([0.5]), 1)
    assert len(end.effects) == effects
    assert (end.estimate.mesh.change_percent is None) is (effects == 0)
    assert (end.problem.experiments[0].change is not None) is (most_along > 13)


def test_inputs_without_an_equilibrium_leave_the_first_linear_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    given = problem(experiment(edges(WIDER, law=NEO), width=0.02))
    optimum = polish(given.nearby(1.0), np.array([0.5]))
    whole = linearise_noise(given, optimum)
    evaluated = Problem.evaluate

    def without_inputs(self: Problem, unit: Any, *more: Any, **options: Any) -> Any:
        found = evaluated(self, unit, *more, **options)
        if self.unknowns.freed:
            found.comparison.unconverged[-1] = True
        return found

    monkeypatch.setattr(Problem, "evaluate", without_inputs)
    found = linearise_noise(given, optimum)
    # The optimum itself, without an error of the width, remains.
    assert found.explained.squares == 0.0
    assert whole.explained.squares == pytest.approx(6.25, abs=0.5)
    np.testing.assert_allclose(found.explained.states[0].residuals, found.about.states[0].residuals)


def test_inputs_without_an_equilibrium_are_named() -> None:
    given = problem(experiment(edges(law=NEO), width=0.02, coil=0.01))
    found = linearise_noise(given, polish(given.nearby(1.0), np.array([0.5])))
    assert found.not_considered(given) == ()
    left = replace(found, sources=tuple(one for one in found.sources if one.shared.source == "coil"))
    (words,) = left.not_considered(given)
    assert words == (
        "the intervals do not contain the uncertainty of the width: no equilibrium was found for a deviation from the "
        "given value"
    )


SLIPS: dict[str, Callable[[Loads], Loads]] = {
    "field_reversed": lambda loads: replace(loads, field_T=-loads.field_T),
    "gravity_reversed": lambda loads: replace(loads, gravity=-loads.gravity),
    "force_reversed": lambda loads: replace(loads, tip_force_N=-loads.tip_force_N),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_mistake_in_the_loads_is_named(slip: str) -> None:
    has_force = slip.startswith("force")
    loads = (
        Loads.along([0.0] * 3, 90.0, 0.0, [1e-3, 2e-3, -3e-3], 0.0, 90.0)
        if has_force
        else Loads.along([0.0, 1.5, 3.0], gravity_angle_deg=40.0)
    )
    beam = STRIP if has_force else BEAM
    one = replace(experiment(edges(beam, loads, NEO), beam, loads), loads=SLIPS[slip](loads))
    alone = problem(one)
    scan = narrowed(alone, scanned(alone, 60.0), 60.0)
    try:
        (found,) = doubtful_loads(alone, scan, 60.0)
    except NamedCause as raised:
        found = raised
    assert (found.slip, found.experiment) == (slip, 0)
    assert found.error_without_mm < 0.4 * found.error_mm
    again = pickle.loads(pickle.dumps(found))
    assert (again.slip, again.error_mm, again.error_without_mm, str(again)) == (
        found.slip,
        found.error_mm,
        found.error_without_mm,
        str(found),
    )
    (doubt,) = slip_doubts([found])
    assert (doubt.dataset, doubt.kind) == (0, "loads")
    assert doubt.words == (
        f"check the loads in the files for {found.words}: without this mistake the mean error would be about "
        f"{found.error_without_mm:.2g} mm instead of {found.error_mm:.2g} mm"
    )


def test_right_loads_of_one_dataset_are_not_doubted() -> None:
    loads = Loads.along([0.0, 1.5, 3.0], gravity_angle_deg=40.0)
    right = experiment(edges(BEAM, loads, NEO), BEAM, loads)
    wrong = replace(right, loads=replace(loads, field_T=-loads.field_T))
    both = problem(right, wrong)
    with pytest.raises(NamedCause) as raised:
        doubtful_loads(both, narrowed(both, scanned(both, 60.0), 60.0), 60.0)
    assert raised.value.experiment == 1


def test_a_beam_without_loads_or_without_an_equilibrium_cannot_be_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    none = Loads.along([0.0, 0.0], gravity_angle_deg=None)
    with pytest.raises(
        NothingActs, match="no load acts on the specimen in any state: no gravity, no tip force, and no"
    ):
        scanned(problem(experiment(points(STRIP, none, NEO), STRIP, none)), 20.0)
    given = problem(experiment(edges(law=NEO)))
    fails_if(monkeypatch, lambda model, options: True)
    with pytest.raises(NothingConverged, match=r"even with a shear modulus of 1e\+18 Pa no beam can be simulated"):
        scanned(given, 20.0)
    with pytest.raises(NothingConverged, match=r"none of the \d+ candidates for the parameters of neo-hookean could"):
        _search(given, 20.0, most_generations=2)


def test_a_bulk_modulus_is_fitted_in_plane_strain_only() -> None:
    one = experiment(edges(law=NEO))
    words = "the fit can determine the bulk modulus only if the section is plane-strain; the section is plane-stress"
    with pytest.raises(ValueError, match=words):
        identify(NEO, [one], free_bulk=True)
    strain = replace(BEAM, section="plane-strain")
    with pytest.raises(ValueError, match="neo-hookean has no parameter 'C10'"):
        _problem(NEO, [one], (), False, (), (Prior("C10", 1e4, 1e3),))
    found = _problem(NEO, [experiment(edges(strain, law=NEO), strain)], (), True, (), ())
    assert found.unknowns.names[-1] == "log10 K/mu"


def test_opposite_fields_free_the_even_inputs_with_an_uncertainty() -> None:
    one = experiment(edges(law=NEO), background_field=0.02, width=0.02)
    found = _problem(NEO, [one], (NuisancePrior("width"),), False, (), ())
    assert found.unknowns.names == ("mu", "width", "background field x", "background field y")
    assert [nuisance.spread for nuisance in found.unknowns.freed] == [0.02, 0.02, 0.02]


def test_a_freed_input_needs_an_uncertainty() -> None:
    with pytest.raises(
        ValueError, match="depth: dataset 0 gives no standard uncertainty; give a standard deviation above 0"
    ):
        nuisances((NuisancePrior("depth"),), 1)
    stated = [experiment(edges(law=NEO), depth=0.0).stated]
    with pytest.raises(
        ValueError, match="depth: dataset 0 gives an uncertainty of 0; give a standard deviation above 0"
    ):
        nuisances((NuisancePrior("depth"),), 1, stated)
    with pytest.raises(ValueError, match="breadth is no uncertain quantity: choose one of moment, coil, scale"):
        NuisancePrior("breadth")


@pytest.mark.parametrize("kind", SOURCES)
def test_a_standard_deviation_is_above_zero_and_at_most_the_largest_of_its_input(kind: str) -> None:
    largest = SOURCES[kind].largest
    NuisancePrior(kind, largest)
    for spread in (0.0, -1e-9, 1.001 * largest):
        words = f"{kind}: a standard deviation of {spread:g} should be above 0 and at most {largest:g}"
        with pytest.raises(ValueError, match=words):
            NuisancePrior(kind, spread)


def test_a_prior_has_the_unit_of_its_parameter() -> None:
    ogden = LAWS["ogden"]
    names = (INITIAL_SHEAR_MODULUS, *ogden.parameter_names)
    units = [Prior(name, 2.0, 1.0).unit(ogden) for name in names]
    assert units == ["Pa", *ogden.units]
    assert "1" in units


def test_a_tensile_curve_without_stress_cannot_be_used() -> None:
    with pytest.raises(CannotFit, match="every stress is zero, but a fit needs stresses that are not zero"):
        TensileEvidence.of(TensileCurve(np.linspace(0.1, 1, 9), np.zeros(9)), NEO)


def test_plans_refuse_what_cannot_be_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    known, noise = KnownLaw(LAWS[NEO], np.array([46e3])), EdgeNoise(0.003, 90, 4.5)
    with pytest.raises(KeyError, match="C10"):
        candidates(known, BEAM, LOADS, (), noise, "C10")
    with pytest.raises(ValueError, match="cannot choose 4 states: only 3 states could be measured"):
        exchange([0, 1, 2], 4)  # type: ignore[arg-type]
    fails_if(monkeypatch, lambda model, options: model.along == 26)
    assert candidates(known, BEAM, LOADS, (), noise).sources == ()  # the finer mesh has no equilibrium
    fails_if(monkeypatch, lambda model, options: True)
    words = "none of the 4 states has a stable equilibrium: check loads, specimen and law"
    with pytest.raises(ValueError, match=words):
        states_reached(known, BeamModel(BEAM), LOADS)


def test_a_search_for_terms_needs_data_and_a_term_with_a_modulus() -> None:
    with pytest.raises(ValueError, match="give at least one bent beam or one tensile curve"):
        discover([], [])
    term = Term.of("i1")
    with pytest.raises(ValueError, match="the library contains a term twice: give each term once"):
        discover([], [], library=(term, Term.of("i2"), term))
    with pytest.raises(
        ValueError, match="no term that adds to the initial shear modulus and has a finite stress at all"
    ):
        discover([], [], library=(Term.of("i1^2"), Term.of("i1^3")))


def test_slow_packages_are_blocked_in_one_thread_only(monkeypatch: pytest.MonkeyPatch) -> None:
    absent = _Absent()
    for name in ("matplotlib", "scipy.stats"):
        with pytest.raises(ModuleNotFoundError, match=f"the import of {name} is blocked on purpose") as raised:
            absent.find_spec(name, None, None)
        assert raised.value.name == name
    assert absent.find_spec("scipy.optimize", None, None) is None
    monkeypatch.setattr("threading.get_ident", lambda: -1)
    assert absent.find_spec("matplotlib", None, None) is None
    assert not any(isinstance(finder, _Absent) for finder in sys.meta_path)


def test_tracked_points_of_a_solid_keep_their_relative_place_in_another_specimen() -> None:
    specimen = with_modes(replace(STRIP, section="solid"), (0.5, 0.0, 0.0))
    flat = points(specimen, UNDER_FORCE, NEO)
    depth = np.tile([0.0, 1.0, -2.0, 3.0, -1.0, 4.0], (3, 1))
    one = experiment(replace(flat, depth_mm=depth), specimen, UNDER_FORCE)
    deviations = {"length": np.array([0.5]), "width": np.array([0.25]), "depth": np.array([0.8])}
    moved = one.under(deviations).observed
    assert isinstance(moved, PointObservation)
    np.testing.assert_allclose(moved.depth_mm, 1.1 * depth)
    straight = one.model.grid.straightened(flat.rest_mm[1])
    new = one.under(deviations).model.grid.straightened(moved.rest_mm[1])
    np.testing.assert_allclose(new, straight * [25.5 / 25.0, 2.75 / 2.5], atol=1e-6)
    np.testing.assert_allclose(moved.moved_mm - moved.rest_mm, flat.moved_mm - flat.rest_mm, atol=1e-12)
    assert one.under({}) is one
    assert one.under({"roll": np.array([1.0])}).model is one.model


def test_an_unstable_start_moves_toward_the_middle_of_the_bounds() -> None:
    asked: list[np.ndarray] = []

    def evaluated(unit: np.ndarray, points_: float) -> Any:
        asked.append(unit[0])
        valid = unit[0, 1] < 0.72
        return SimpleNamespace(objective_mm=np.array([0.1 if valid else DISCARDED_MM]))

    given: Any = SimpleNamespace(evaluate=evaluated)
    found = corrected_optimum._valid(given, np.array([0.9, 0.9, 0.1]))
    np.testing.assert_allclose(found, [0.9, 0.7, 0.3])
    np.testing.assert_allclose(asked, [[0.9, 0.8, 0.2], [0.9, 0.7, 0.3]])
    given.evaluate = lambda unit, points_: SimpleNamespace(objective_mm=np.array([DISCARDED_MM]))
    np.testing.assert_allclose(corrected_optimum._valid(given, np.array([0.9, 0.9, 0.1])), [0.9, 0.9, 0.1])


def test_a_solid_with_an_unstable_start_is_fitted_from_the_middle_of_the_bounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    solid = replace(BEAM, section="solid", depth_mm=4.0)
    one = polished(experiment(edges(solid, law="mooney-rivlin"), solid))

    def solve(self: BeamModel, law: Any, parameters: Any, *given: Any, **options: Any) -> Any:
        shapes = quick_shapes(self, law, parameters, *given, **options)
        shapes.status[parameters[:, 1] > parameters[:, 0]] = Status.UNSTABLE
        return shapes

    monkeypatch.setattr(BeamModel, "solve", solve)
    given = problem(one, law="mooney-rivlin")
    end = corrected_optimum.refine(given, np.array([0.5, 0.95]), 1)
    assert end.optimum.evaluation.objective_mm[0] < 0.02
    assert end.polish.mean_error_before_mm < DISCARDED_MM
    assert end.estimate.section_change.change_percent is not None


@pytest.mark.parametrize(
    ("values", "passes"), [([5.0, 4.0, 3.0, 2.0, 1.0], 3), ([5.0, 4.0, 3.97], 2), ([5.0, 4.96], 1)]
)
def test_inputs_are_evaluated_again_until_the_fit_stays_and_at_most_three_times(
    monkeypatch: pytest.MonkeyPatch, values: list[float], passes: int
) -> None:
    given = problem(experiment(edges(WIDER, law=NEO), width=0.02))
    optimum = polish(given.nearby(1.0), np.array([0.5]))
    calls: list[int] = []
    evaluated, left = Problem.evaluate, iter(values)

    def counted(self: Problem, unit: Any, *more: Any, **options: Any) -> Any:
        calls.append(len(unit))
        return evaluated(self, unit, *more, **options)

    monkeypatch.setattr(Problem, "evaluate", counted)
    monkeypatch.setattr(noise, "_value", lambda *arguments: next(left))
    found = linearise_noise(given, optimum)
    assert calls == [3] * passes
    # The last pass has the smallest value.
    assert found.explained.squares > 5.0


def test_weights_are_renewed_at_most_twelve_times(monkeypatch: pytest.MonkeyPatch) -> None:
    given = problem(experiment(edges(WIDER, law=NEO), width=0.02))
    optimum = polish(given.nearby(1.0), np.array([0.5]))
    about = linearise_noise(given, optimum).about
    calls: list[float] = []

    def never_the_same(states: Any) -> float:
        calls.append(1.1 ** len(calls))
        return calls[-1]

    monkeypatch.setattr(noise, "_mean_mm", never_the_same)
    unit = about.unit
    noise._least(given, about.states, unit, unit, np.eye(1), [np.zeros(4)])
    assert len(calls) == 12
    calls.clear()
    monkeypatch.setattr(noise, "_mean_mm", lambda states: calls.append(1.0) or 1.0 + 0.02 / 2 ** len(calls))
    noise._least(given, about.states, unit, unit, np.eye(1), [np.zeros(4)])
    assert len(calls) == 2  # the second changes by less than a hundredth


@pytest.mark.parametrize(("factor", "is_carried"), [(1.019, True), (1.021, False), (0.981, True), (0.979, False)])
def test_a_depth_effect_is_carried_on_while_the_modulus_changes_by_at_most_two_per_cent(
    monkeypatch: pytest.MonkeyPatch, factor: float, is_carried: bool
) -> None:
    solid = replace(BEAM, section="solid", depth_mm=4.0)
    given = problem(polished(experiment(edges(solid, law=NEO), solid)))
    modulus_Pa = float(given.unknowns.parameters(np.array([[0.5]]))[0, 0])
    asked: list[Any] = []
    monkeypatch.setattr(modulus_so_far, "correction", lambda *given, options: asked.append(options))
    before = modulus_so_far._Depth("effect", modulus_Pa / factor)  # type: ignore[arg-type]
    assert modulus_so_far._with_depth(given, np.array([0.5]), before) is None
    (options,) = asked
    assert options.method == "interpolate"
    assert options.earlier == ("effect" if is_carried else None)


class Stopped(Exception):
    """Ends a fit at the step that a test watches."""


def test_a_search_has_twenty_points_a_state_and_ends_early_for_a_beam_that_hardly_moves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []

    def stopped(coarse: Problem, points_: float, **options: Any) -> Any:
        asked.append((points_, options["enough_mm"], options["most_generations"], options["restarts"], options["seed"]))
        raise Stopped

    monkeypatch.setattr(whole_fit, "_search", stopped)
    little = Loads.along((0.1, 0.2, -0.1), gravity_angle_deg=5.0)
    for one in (experiment(edges(law=NEO)), experiment(edges(BEAM, little, NEO), BEAM, little)):
        with pytest.raises(Stopped):
            identify(NEO, [one])
    (points_, enough, *options), (few, less, *_) = asked
    assert (points_, few, enough, options) == (80.0, 60.0, 0.5, [400, 0, 1])
    unmoved = problem(experiment(edges(BEAM, little, NEO), BEAM, little))
    unmoved_mm = scanned(replace(unmoved, experiments=coarsened(unmoved.experiments)), 60.0).unmoved_mm
    assert less == pytest.approx(0.14 * unmoved_mm)


def test_the_first_polish_is_loose_and_the_later_ones_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def watched(evaluate: Any, unit: Any, start: Any = None, enough: float = ENOUGH) -> Any:
        asked.append(enough)
        return polish(evaluate, unit, start, enough)

    monkeypatch.setattr(corrected_optimum, "polish", watched)
    corrected_optimum.refine(problem(experiment(edges(law=NEO))), np.array([0.5]), 1)
    assert asked == [1e-2, 1e-4, 1e-4]
    asked.clear()
    solid = replace(BEAM, section="solid", depth_mm=4.0)
    corrected_optimum.refine(problem(polished(experiment(edges(solid, law=NEO), solid))), np.array([0.5]), 1)
    assert asked[0] == 1e-2
    assert set(asked[1:]) == {1e-4}


def test_terms_are_sought_in_sets_of_three_with_lots_that_differ_by_two_per_cent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []

    def stopped(*given: Any) -> Any:
        asked.append(given[-2:])
        raise Stopped

    curve = TensileCurve(np.linspace(0.02, 1.0, 30), 40e3 * np.linspace(0.02, 1.0, 30))
    monkeypatch.setattr(terms_of_a_law, "_supports", stopped)
    with pytest.raises(Stopped):
        discover([], [curve])
    assert asked[-1][1] == 3
    monkeypatch.setattr(terms_of_a_law, "_linearised", stopped)
    for curves, lot in (([curve], 0.02), ([], 0.0)):
        with pytest.raises(Stopped):
            discover([experiment(edges(law=NEO))], curves, modulus_Pa=46e3)
        assert asked[-1][0] == lot


def test_a_depth_effect_is_kept_in_seven_states(monkeypatch: pytest.MonkeyPatch) -> None:
    solid = replace(BEAM, section="solid", depth_mm=4.0)
    given = problem(polished(experiment(edges(solid, law=NEO), solid)))
    kept: list[int] = []

    def thinned(most: int) -> Any:
        kept.append(most)
        raise Stopped

    change = SimpleNamespace(effects=[SimpleNamespace(thinned=thinned)])
    monkeypatch.setattr(modulus_so_far, "correction", lambda *given, options: change)
    with pytest.raises(Stopped):
        modulus_so_far._with_depth(given, np.array([0.5]), None)
    assert kept == [7]


def test_a_solid_without_a_depth_effect_has_the_planar_modulus_without_its_bias(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    solid = replace(BEAM, section="solid", depth_mm=4.0)
    one = experiment(edges(solid, law=NEO), solid)
    monkeypatch.setattr(modulus_so_far, "_with_depth", lambda problem, unit, before: None)
    found = []
    for bias in (0.0, 0.25):
        monkeypatch.setattr(modulus_so_far, "expected_bias", lambda specimen, bias=bias: bias)
        found.append(modulus_so_far.modulus_so_far(one))
    plain, corrected = found
    assert corrected.value_Pa == pytest.approx(plain.value_Pa / 1.25)
    assert corrected.interval_95_Pa == pytest.approx(tuple(end / 1.25 for end in plain.interval_95_Pa))
    assert corrected.noise_Pa == pytest.approx(plain.noise_Pa / 1.25)
    assert corrected.narrowest_Pa == corrected.width_Pa == pytest.approx(plain.width_Pa / 1.25)
    assert (plain.depth, corrected.depth, plain.limited_by) == (None, None, "the noise of the edges")


@pytest.mark.parametrize(("high", "remaining"), [(1.0, 1.0), (0.99, 0.12**0.5 / 10)])
def test_a_bulk_modulus_without_an_upper_end_is_not_determined(
    monkeypatch: pytest.MonkeyPatch, high: float, remaining: float
) -> None:
    strain = Specimen(28.0, 2.0, 6.0, 1070.0, "plane-strain", BEAM.magnet)
    plain = problem(experiment(edges(strain, law=NEO), strain))
    given = replace(plain, unknowns=Unknowns(plain.unknowns.space.with_bulk()))
    optimum = polish(given.nearby(1.0), np.array([0.5, 0.6]))
    asked: list[Any] = []

    def stopped(*parts: Any) -> Any:
        asked.append(parts)
        raise Stopped

    monkeypatch.setattr(covariance.Linearisation, "covariance", lambda self, widened=1.0: 1e-4 * np.eye(2))
    monkeypatch.setattr(estimate, "_ends", lambda *given: Ends(np.array([0.4, 0.5]), np.array([0.6, high]), (1,)))
    monkeypatch.setattr(estimate, "_identifiability", stopped)
    with pytest.raises(Stopped):
        estimate.estimate(given, optimum, (), linearise_noise(given, optimum), (), 1)
    assert asked[0][4] == pytest.approx([0.12**0.5 / 10, remaining])


def test_a_scan_of_moduli_has_twenty_points_a_state(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def stopped(problem: Problem, points_: float) -> Any:
        asked.append(points_)
        raise Stopped

    monkeypatch.setattr(modulus_so_far, "scanned", stopped)
    monkeypatch.setattr(measured_rest_shape, "scanned", stopped)
    one = experiment(edges(law=NEO))
    with pytest.raises(Stopped):
        modulus_so_far.modulus_so_far(one)
    with pytest.raises(Stopped):
        measured_rest_shape._scanned_modulus(one)
    assert asked == [80.0, 80.0]


def test_a_rest_shape_and_its_modulus_are_fitted_in_turn_three_times(monkeypatch: pytest.MonkeyPatch) -> None:
    loads = Loads.along((0.0, 0.01, *np.linspace(1.0, 3.0, 7)), gravity_angle_deg=1.5)
    bent = with_modes(BEAM, (0.4, 0.2, 0.0))
    one = experiment(edges(bent, loads, NEO), BEAM, loads)
    scanned_in: list[Any] = []
    nearby: list[float] = []
    monkeypatch.setattr(
        measured_rest_shape, "_scanned_modulus", lambda bent: scanned_in.append(bent.loads.field_T) or 40e3
    )
    monkeypatch.setattr(measured_rest_shape, "_nearby_modulus", lambda bent, near: nearby.append(near) or near + 2e3)
    found = measured_rest_shape.measured_rest_shape(one)
    assert found is not None
    # Four of the seven bent states, equally spaced.
    np.testing.assert_allclose(scanned_in[0], loads.field_T[[2, 4, 6, 8]])
    assert nearby == [40e3, 42e3, 44e3]


def test_edges_are_linearised_at_most_nine_times(monkeypatch: pytest.MonkeyPatch) -> None:
    one = TensileCurve(np.linspace(0.02, 1.0, 30), 40e3 * np.linspace(0.02, 1.0, 30))
    terms = (Term.of("i1"), Term.of("i2"))
    pulled, _ = tensile_rows(one, terms)
    calls: list[int] = []

    def bent(*given: Any) -> Any:
        calls.append(1)
        rows = replace(pulled, nuisances=np.zeros((len(pulled.observed), 1)))
        return rows, [0.01 * 1.1 ** len(calls)]  # the noise never stays the same

    monkeypatch.setattr(terms_of_a_law, "bending_rows", bent)
    terms_of_a_law._linearised([], terms, np.array([40e3, 1e3]), 0.0, [pulled])
    assert len(calls) == 9
    calls.clear()
    monkeypatch.setattr(terms_of_a_law, "bending_rows", lambda *given: (bent(*given)[0], [0.01]))
    terms_of_a_law._linearised([], terms, np.array([40e3, 1e3]), 0.0, [pulled])
    assert len(calls) == 2


@pytest.mark.parametrize(
    ("units", "objectives", "kept", "passes"),
    [
        ((0.6, 0.4), (1.0, 1.02), 1, 2),  # the second pass is worse, and moved farther than the whole change
        ((0.6, 0.4), (1.0, 1.0), 2, 3),
        ((0.6, 0.59, 0.585), (1.0, 1.0, 1.0), 3, 3),
        ((0.6, 0.60005), (1.0, 1.0), 2, 2),  # a change of 0.02 per cent
        ((0.6, None), (1.0, 1.0), 1, 2),  # no equilibrium in the second pass
        ((None,), (), 0, 1),
    ],
)
def test_the_solid_corrects_a_fit_up_to_three_times(
    monkeypatch: pytest.MonkeyPatch,
    units: tuple[float | None, ...],
    objectives: tuple[float, ...],
    kept: int,
    passes: int,
) -> None:
    solid = replace(BEAM, section="solid", depth_mm=4.0)
    given = problem(polished(experiment(edges(solid, law=NEO), solid)))
    given = replace(
        given, unknowns=replace(given.unknowns, space=replace(given.unknowns.space, lower=(1e4,), upper=(1e6,)))
    )
    asked: list[Any] = []

    def change(problem_: Problem, refinement: Any, experiments: Any, unit: Any, start: Any = None) -> Any:
        number = len(asked)
        asked.append((float(unit[0]), start and start.number))
        if number >= len(units) or units[number] is None:
            return None
        return SimpleNamespace(number=number + 1, added=lambda experiments: (f"corrected {number + 1}",))

    def with_change(changed: Any, now: Any, optimum: Any) -> Any:
        number = len(asked)
        reached = SimpleNamespace(
            unit=np.array([units[number - 1]]),
            evaluation=SimpleNamespace(objective_mm=np.array([objectives[number - 1]])),
        )
        return changed, reached

    monkeypatch.setattr(corrected_optimum, "_change", change)
    monkeypatch.setattr(corrected_optimum, "_with_change", with_change)
    start: Any = SimpleNamespace(unit=np.array([0.5]), evaluation=SimpleNamespace(objective_mm=np.array([2.0])))
    corrected, optimum, effects = corrected_optimum._with_depth(given, start)
    assert len(asked) == passes
    if not kept:
        assert (corrected, optimum, effects) == (given, start, [])
        return
    assert corrected.experiments == (f"corrected {kept}",)
    assert optimum.unit[0] == units[kept - 1]
    (effect,) = effects
    assert effect.moved == pytest.approx([units[kept - 1] - 0.5])
    assert (effect.correction.number, effect.least_percent) == (kept, 0.15)
    moved = [100 * (100**step - 1) for step in np.diff([0.5, *[unit for unit in units if unit is not None]])]
    expected = min(max(0.05, abs(moved[-1]) / abs(100 * (100 ** (units[kept - 1] - 0.5) - 1))), 1.0)
    assert effect.share == pytest.approx(expected)


def test_the_options_of_a_search_reach_it(monkeypatch: pytest.MonkeyPatch) -> None:
    given = {
        "seed": 5,
        "population": 9,
        "most_generations": 33,
        "restarts": 2,
        "bipop": True,
        "replay": ("stored",),
        "progress": print,
    }
    asked: list[dict[str, Any]] = []

    def stopped(coarse: Problem, points_: float, **options: Any) -> Any:
        asked.append(options)
        raise Stopped

    monkeypatch.setattr(whole_fit, "_search", stopped)
    with pytest.raises(Stopped):
        identify(NEO, [experiment(edges(law=NEO))], **given)  # type: ignore[arg-type]
    assert asked[0].pop("enough_mm") == 0.5
    assert asked[0] == given
