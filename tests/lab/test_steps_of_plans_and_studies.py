"""The plan of a run, the discovery of a law and the study with simulated specimens pass on the right values."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads
from eimi_fitting.discovery.bending_rows import NoEquilibrium
from eimi_fitting.discovery.terms_of_a_law import UnusableLibrary
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.planning.design_of_experiment import Candidates
from eimi_fitting.inference.planning.rival_laws import Rivals
from eimi_fitting.inference.searching.modulus_range import NothingActs
from eimi_fitting.laws import CannotFit
from eimi_fitting.laws.sum_of_terms import Term
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.fits import discovering, planning
from eimi_lab.fits.planning import Goal, Mounting, PlannedRun
from eimi_lab.fits.records import FitRecord, package_versions
from eimi_lab.process.errors import InputError
from eimi_lab.study import observed, optimisers, routes, whole_study
from eimi_lab.study.extent import Extent
from eimi_lab.study.hidden_materials import MATERIALS

YEOH = {
    name: Quantity(value, "Pa", (0.9 * value, 1.1 * value))
    for name, value in zip("abc", (25e3, 1e3, 50.0), strict=True)
}


def fit(model: str, **more: Any) -> Any:
    # Return a fit to bending with the given attributes only.
    record = FitRecord.__new__(FitRecord)
    names = LAWS[model].parameter_names
    quantities = dict(zip(names, YEOH.values(), strict=False))
    for name, value in {"model": model, "parameters": quantities, **more}.items():
        object.__setattr__(record, name, value)
    return record


def test_a_goal_is_the_modulus_a_parameter_or_a_rival_law() -> None:
    path, yeoh, neo = Path("fits.json"), fit("yeoh"), fit("neo-hookean")
    other: Any = SimpleNamespace(model="gent")  # not a fit to bending
    assert Goal.of(path, [yeoh, other], None, "modulus") == Goal(yeoh)
    assert Goal.of(path, [yeoh, neo], "neo-hookean", "modulus").fit is neo
    assert Goal.of(path, [yeoh, neo], "yeoh", "C20") == Goal(yeoh, "C20")
    rival = Goal.of(path, [yeoh, neo], "yeoh", "neo-hookean")
    assert (rival.fit, rival.rival, rival.parameter) == (yeoh, neo, planning.MODULUS)
    for fits, model, words, message in (
        ([other], None, "modulus", "fits.json: holds no fit to a bending beam; a plan needs the noise of such a fit"),
        ([yeoh, neo], None, "modulus", "holds several laws; give --model with one of yeoh, neo-hookean"),
        ([yeoh, neo], "ogden", "modulus", "--model ogden: should be one of yeoh, neo-hookean"),
        ([yeoh], None, "C40", r"--goal C40: should be modulus, one of yeoh's parameters \(C10, C20, C30\)$"),
        ([yeoh, neo], "yeoh", "yeoh", r"\(C10, C20, C30\), or another law of the file \(neo-hookean\)$"),
    ):
        with pytest.raises(InputError, match=message):
            Goal.of(path, fits, model, words)
    assert rival.in_words() == "comparison of yeoh with neo-hookean, expected difference of AIC"


def test_every_specimen_is_combined_with_every_angle_weight_and_sign() -> None:
    rig, one, two = load_rig("virtual"), load_specimen("type1"), load_specimen("type2")
    every = planning.mountings([one, two], rig, [0.0, 90.0], [0.0, 2.0], True)
    assert [(m.specimen, m.gravity_angle_deg, m.tip_weight_g, m.both_polarities) for m in every] == [
        (s, a, w, b) for s in (one, two) for a in (0.0, 90.0) for w in (0.0, 2.0) for b in (False, True)
    ]
    (plain,) = planning.mountings([one], rig, [], [], False)
    assert (plain.gravity_angle_deg, plain.tip_weight_g, plain.both_polarities) == (0.0, 0.0, False)
    flat: Any = SimpleNamespace(name="flat", calibration=rig.calibration.model_copy(update={"gravity": False}))
    (still,) = planning.mountings([one], flat, [], [0.0], False)
    assert still.gravity_angle_deg is None
    for angles, weights in (([0.0], []), ([], [1.0])):
        with pytest.raises(InputError, match="rig flat: calibration has gravity = false: leave out --tip-weight and -"):
            planning.mountings([one], flat, angles, weights, False)


MOUNTING = Mounting(load_specimen("type1"), 30.0, 5.0)
RUN = PlannedRun(MOUNTING, (0.1, 0.25), 1.5, 4.5, {"width": 0.5}, {"width": -0.5})


def test_a_plan_needs_enough_currents_and_a_beam_with_an_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    rig: Any = "rig"
    monkeypatch.setattr(planning, "_currents", lambda rig, protocol: np.arange(5.0))
    planned = {1: RUN, 2: None, 3: replace(RUN, expected=0.5)}
    monkeypatch.setattr(planning, "_planned", lambda goal, mounting, rig, currents, states: planned[mounting])
    monkeypatch.setattr(planning, "_with_ring_down", lambda goal, run, rig: replace(run, spaced=9.0))
    goal: Any = SimpleNamespace(rival=None)
    runs = planning.plan(goal, [1, 2, 3], rig, rig, 5)  # type: ignore[list-item]
    assert [(run.expected, run.spaced) for run in runs] == [(0.5, 9.0), (1.5, 4.5)]
    with pytest.raises(InputError, match="--states 6: should be at most 5, the number of currents to choose from"):
        planning.plan(goal, [1], rig, rig, 6)  # type: ignore[list-item]
    with pytest.raises(InputError, match="the beam has a stable equilibrium at too few of the currents"):
        planning.plan(goal, [2, 2], rig, rig, 5)  # type: ignore[list-item]


def test_a_ring_down_is_expected_for_the_modulus_only(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(planning, "expected_ring_down", lambda *given: seen.append(given) or "ring-down")
    monkeypatch.setattr(planning, "_stated", lambda mounting, rig: (mounting, rig))
    rig: Any = "rig"
    yeoh = fit("yeoh")
    for goal in (Goal(yeoh, "C20"), Goal(yeoh, rival=fit("neo-hookean"))):
        assert planning._with_ring_down(goal, RUN, rig) is RUN
    assert planning._with_ring_down(Goal(yeoh), RUN, rig).ring_down == "ring-down"  # type: ignore[comparison-overlap]
    ((known, specimen, angle, force_N, stated, percent, effects),) = seen
    assert known.law is LAWS["yeoh"]
    assert known.parameters.tolist() == [25e3, 1e3, 50.0]
    assert specimen == MOUNTING.specimen.mechanics()
    assert (angle, stated, percent, effects) == (30.0, (MOUNTING, "rig"), 1.5, {"width": -0.5})
    assert force_N == pytest.approx(5e-3 * 9.80665)


@dataclass
class Choices:
    # A stand-in for the candidates of a plan, which has chosen the states 2, 0 and 1 of five.

    kind: type

    def of(self, *given: Any) -> Any:
        self.given = given
        one = self.kind.__new__(self.kind)
        places = {"states": np.array([4, 1, 3, 0]), "apart": lambda choice: float(sum(choice))}
        effects = {"effects_percent": lambda choice: {"w": float(sum(choice))}}
        signed = {"signed_effects_percent": lambda choice: {"w": -float(sum(choice))}}
        half = {"half_width_percent": lambda choice: 10.0 + float(sum(choice))}
        for name, value in {**places, **effects, **signed, **half}.items():
            object.__setattr__(one, name, value)
        return one


@pytest.mark.parametrize("both", [False, True])
@pytest.mark.parametrize("is_rival", [False, True])
def test_the_states_of_a_run_are_chosen_among_the_currents(
    monkeypatch: pytest.MonkeyPatch, both: bool, is_rival: bool
) -> None:
    rig = load_rig("virtual")
    choices = Choices(Rivals if is_rival else Candidates)
    fields: list[Any] = []
    monkeypatch.setattr(planning, "rivals" if is_rival else "candidates", choices.of)
    monkeypatch.setattr(planning, "in_stated_field", lambda loads, *rest: fields.append((loads, *rest)) or loads)
    monkeypatch.setattr(planning, "exchange", lambda criterion, states: [2, 0, 1][:states])
    monkeypatch.setattr(planning, "equally_spaced", lambda count, states: np.arange(states) + 2)
    monkeypatch.setattr(planning, "_in_pairs", lambda criterion, currents: seen.append(currents) or criterion)
    monkeypatch.setattr(planning, "_noise", lambda fit: f"noise of {fit.model}")
    monkeypatch.setattr(planning, "_stated", lambda mounting, rig: ("stated",))
    monkeypatch.setattr(choices.kind, "__len__", lambda self: 4)
    seen: list[int] = []
    yeoh, neo = fit("yeoh"), fit("neo-hookean")
    goal = Goal(yeoh, rival=neo) if is_rival else Goal(yeoh, "C20")
    currents = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    run = planning._planned(goal, replace(MOUNTING, both_polarities=both), rig, currents, 6 if both else 3)
    assert run is not None
    allowed = currents[1:] if both else currents
    assert run.currents_A == tuple(allowed[[3, 4, 1]].tolist())
    assert seen == ([5] if both else [])
    loads, calibration, specimen = fields[0]
    signs = np.concatenate([allowed, -allowed]) if both else allowed
    expected = Loads.along(rig.calibration.mT_per_A * signs, 90.0, 30.0, MOUNTING.tip_force_N)
    assert loads.field_T == pytest.approx(expected.field_T)
    assert loads.gravity == pytest.approx(expected.gravity)
    assert loads.tip_force_N == pytest.approx(expected.tip_force_N)
    assert (calibration, specimen) == (rig.calibration, MOUNTING.specimen.mechanics())
    score, spaced = (3.0, 9.0) if is_rival else (13.0, 19.0)
    assert (run.expected, run.spaced) == (score, spaced)
    assert run.effects_percent == ({} if is_rival else {"w": 3.0})
    assert run.signed_percent == ({} if is_rival else {"w": -3.0})
    if is_rival:
        assert [known.law.name for known in choices.given[:2]] == ["yeoh", "neo-hookean"]
        assert choices.given[2:] == (specimen, loads, ("stated",), "noise of yeoh")
    else:
        assert choices.given[0].law.name == "yeoh"
        assert choices.given[1:] == (specimen, loads, ("stated",), "noise of yeoh", "C20")

    def refuse(*given: Any) -> Any:
        raise ValueError("too few states")

    monkeypatch.setattr(planning, "exchange", refuse)
    assert planning._planned(goal, MOUNTING, rig, currents, 3) is None


def test_the_planned_protocol_has_its_currents_its_name_and_its_weight() -> None:
    protocol = load_protocol("dragon_skin_10_quick")
    goal = Goal(fit("yeoh"))
    text = planning.protocol_text(goal, RUN, protocol)
    first, second = text.splitlines()[:2]
    assert first == (
        "# Planned for the goal: initial shear modulus of yeoh, expected half-width of the 95 % interval: ± 1.5 %; "
        "with equally spaced currents: ± 4.5 %"
    )
    assert second == (
        "# Mounting: type1, gravity at 30°, 5 g at the tip (direction of gravity in degrees: 0 hangs down, 90 is "
        "level, 180 is upright)"
    )
    assert f'name = "{protocol.name}-planned"' in text
    assert "values_A = [0.1, 0.25]" in text.replace("\n", "").replace("    ", "")
    assert f"tip_force_N = {MOUNTING.tip_force_N}" in text
    assert "both_polarities = true" not in text
    both = replace(RUN, mounting=replace(MOUNTING, both_polarities=True))
    assert "both_polarities = true" in planning.protocol_text(goal, both, protocol)


def test_the_table_and_the_content_of_a_plan() -> None:
    goal = Goal(fit("yeoh"))
    effects = {"coil": 0.456, "width": 0.31, "none": 0.0, "depth": 0.2}
    ring: Any = SimpleNamespace(in_words="with a ring-down")
    best = replace(RUN, effects_percent=effects, ring_down=ring)
    other = replace(RUN, mounting=replace(MOUNTING, tip_weight_g=0.0), expected=12.345)
    lines = planning.table(goal, [best, other])
    width = len(MOUNTING.in_words())
    assert lines == [
        "initial shear modulus of yeoh, expected half-width of the 95 % interval",
        f"{'mounting':{width}}     planned  equally spaced",
        f"{MOUNTING.in_words()}     ± 1.5 %         ± 4.5 %",
        f"{'type1, gravity at 30°':{width}}    ± 12.3 %         ± 4.5 %",
        f"best run: {MOUNTING.in_words()}, currents 0.1, 0.25 A",
        "largest sources of uncertainty, each with the standard deviation of the modulus that it causes: coil 0.46 %, "
        "width 0.31 %",
        "with a ring-down",
    ]
    assert len(planning.table(goal, [replace(RUN, effects_percent={})])) == 4
    (content,) = planning.content(goal, [RUN])["runs"]
    assert content == {
        "specimen": "type1",
        "gravity_angle_deg": 30.0,
        "tip_weight_g": 5.0,
        "both_polarities": False,
        "currents_A": (0.1, 0.25),
        "expected": 1.5,
        "equally_spaced": 4.5,
        "effects_percent": {"width": 0.5},
        "ring_down": None,
    }


# Discovery

DATA: Any = SimpleNamespace(path=Path("a.h5"), experiment="bent", sha256="12", taken_as_exact=("moment",))
CURVE: Any = SimpleNamespace(path="pull.csv", sha256="34", window_percent=50.0)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (CannotFit("too few rows"), "^pull.csv: too few rows$"),
        (NothingActs("nothing bends the beam"), r"^a\.h5: nothing bends the beam$"),
        (NoEquilibrium(), r"^a\.h5: the beam has no equilibrium with the law fitted to the tensile curves$"),
        (UnusableLibrary("two terms are equal"), "^--term: two terms are equal$"),
    ],
)
def test_a_discovery_that_cannot_be_made_is_refused(
    error: Exception, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def discover(*given: Any, **options: Any) -> Any:
        raise error

    monkeypatch.setattr(discovering, "check_evidence", lambda evidence: None)
    monkeypatch.setattr(discovering, "discover", discover)
    with pytest.raises(InputError, match=words):
        discovering.discovered([DATA], [CURVE])
    if isinstance(error, CannotFit):
        with pytest.raises(InputError, match=r"^a\.h5: too few rows$"):
            discovering.discovered([DATA], [])
    checked: list[Any] = []
    monkeypatch.setattr(discovering, "check_evidence", checked.extend)
    monkeypatch.setattr(discovering, "discover", lambda *given, **options: (given, options))
    found: Any = discovering.discovered([DATA], [CURVE], seed=3)
    assert found == ((["bent"], [CURVE]), {"seed": 3})
    assert checked == [DATA]


def test_the_library_of_a_discovery_has_the_named_terms() -> None:
    names = [term.name for term in discovering.LIBRARY[:2]]
    assert [term.name for term in discovering.library_of(names)] == names
    assert discovering.library_of([]) == discovering.LIBRARY
    with pytest.raises(InputError, match=r"^--term nothing: "):
        discovering.library_of(["nothing"])


def discovery(count: int) -> Any:
    one, two = discovering.LIBRARY[:2]

    def alternative(number: int) -> Any:
        return SimpleNamespace(
            terms=(one, two),
            coefficients=np.array([12345.6 + number, 234.5]),
            intervals=np.array([[11e3, 13e3], [-20.0, 480.0]]),
            initial_shear_modulus_Pa=24e3 + number,
            held_out_error=1.234,
            stable_to=None if number else 2.5,
        )

    return SimpleNamespace(
        statement="the law needs two terms",
        identified=True,
        alternatives=[alternative(i) for i in range(count)],
        in_all=[one],
        open_terms={two: 0.25},
        strain=0.3,
        library=(one, two),
        left_out=[two],
        compatible_sets=[(one, two), (two,)],
        sets=7,
        noise_mm=[0.002],
        noise_Pa=[150.0],
    )


def test_the_lines_and_the_content_of_a_discovery(monkeypatch: pytest.MonkeyPatch) -> None:
    found = discovery(14)
    one, two = (term.name for term in found.library)
    lines = discovering.lines(found, Path("discovery.json"))
    assert lines[0] == "the law needs two terms"
    assert len(lines) == 1 + 12 + 1 + 1
    assert "12.35 kPa, 95 % interval 11 to 13 kPa" in lines[1]
    assert (
        "0.2345 kPa, 95 % interval -0.02 to 0.48 kPa; the error on data that were left out of the fit is 1.23"
        in (lines[1])
    )
    assert lines[13] == "  and 2 further laws in discovery.json"
    assert lines[14].startswith(f"  the term {two} was left out")
    assert len(discovering.lines(discovery(12), Path("discovery.json"))) == 1 + 12 + 1
    monkeypatch.setattr(discovering, "package_versions", lambda: {"eimi-lab": "9"})
    content = json.loads(json.dumps(discovering.content(found, [DATA], [CURVE], wall_s=3.5)))
    alternatives = content.pop("alternatives")
    assert content == {
        "statement": "the law needs two terms",
        "identified": True,
        "terms_in_all": [one],
        "terms_that_could_be_there": {two: 0.25},
        "at_strain": 0.3,
        "library": [{"term": term.name, "energy": term.formula} for term in found.library],
        "terms_left_out": [two],
        "sets_in_play": [[one, two], [two]],
        "sets_fitted": 7,
        "datasets": [{"path": "a.h5", "sha256": "12", "noise_mm": 0.002, "taken_as_exact": ["moment"]}],
        "tensile": [{"path": "pull.csv", "sha256": "34", "window_percent": 50.0, "noise_Pa": 150.0}],
        "wall_s": 3.5,
        "versions": {"eimi-lab": "9"},
    }
    names = list(alternatives[0]["coefficients_Pa"])
    assert alternatives[0] == {
        "terms": [one, two],
        "coefficients_Pa": dict(zip(names, [12345.6, 234.5], strict=True)),
        "intervals_95_Pa": dict(zip(names, [[11e3, 13e3], [-20.0, 480.0]], strict=True)),
        "initial_shear_modulus_Pa": 24e3,
        "held_out_error_over_noise": 1.234,
        "stable_to": 2.5,
    }
    assert isinstance(found.library[0], Term)


# Studies


def test_a_study_computes_its_parts_in_order_and_passes_them_on(monkeypatch: pytest.MonkeyPatch) -> None:
    extent = Extent(("dragon_skin_10",), ("type1", "type2"), ("yeoh", "ogden"), 3, (50.0,), True, 2)
    inputs = whole_study.StudyInputs(extent, 4)
    asked: list[str] = []
    told: list[str] = []

    class Parts:
        def part(self, name: str, compute: Any) -> Any:
            asked.append(name)
            return compute()

    def law(name: str, experiment: Any, seed: int) -> dict[str, Any]:
        of = {"law": name, "values": [experiment, seed], "modulus_Pa": 1.0, "source": "bending", "window": ""}
        return dict(of)

    monkeypatch.setattr(whole_study, "field_mT", lambda material, extent: ("fields", material.name))
    monkeypatch.setattr(whole_study, "measured_edges_mm", lambda key, kind, extent: np.array([len(kind) + 0.123456789]))
    monkeypatch.setattr(
        whole_study,
        "experiment_of",
        lambda kind, edges, fields, section: (kind, round(float(edges[0]), 9), *fields, section),
    )
    monkeypatch.setattr(whole_study, "by_bending", law)
    monkeypatch.setattr(whole_study, "by_tension", lambda strain, stress, source, extent: [law(source, len(strain), 0)])
    monkeypatch.setattr(whole_study, "errors_of", lambda routes, experiment: [(r.law, experiment) for r in routes])
    monkeypatch.setattr(whole_study, "QUESTIONS", {"moment": lambda extent, seed: (extent, seed)})
    parts: Any = Parts()
    found = whole_study.compute_all(inputs, parts, told.append)
    name = MATERIALS["dragon_skin_10"].name
    assert told == [part.replace("_", " ") for part in asked]
    assert asked == [
        *("edges_dragon_skin_10_type1", "edges_dragon_skin_10_type2", "tension_dragon_skin_10"),
        *(
            f"{what}_dragon_skin_10_{section}_{of}"
            for section in ("plane-strain", "solid")
            for what, of in (("bending", "yeoh"), ("bending", "ogden"), ("errors", "type1"), ("errors", "type2"))
        ),
        "question_moment",
    ]
    assert len(asked) == whole_study.steps(extent)
    assert found.edges["dragon_skin_10", "type2"].tolist() == [5.123457]
    trained = ("type1", 5.123457, "fields", name, "solid")
    assert found.bending["dragon_skin_10", "solid"] == [law("yeoh", trained, 4), law("ogden", trained, 4)]
    other = ("type2", 5.123457, "fields", name, "plane-strain")
    assert found.errors["dragon_skin_10", "plane-strain", "type2"] == [(n, other) for n in ("yeoh", "ogden", "own")]
    assert found.answers == {"moment": (extent, 4)}
    assert found.fields == {"dragon_skin_10": ("fields", name)}
    assert [route.law for route in found.routes("dragon_skin_10", "solid")] == ["yeoh", "ogden", "own"]
    asked.clear()
    none = whole_study.compute_all(replace(inputs, extent=replace(extent, open_questions=False)), parts)
    assert none.answers == {}
    assert "question_moment" not in asked


def test_a_published_curve_is_fitted_after_the_simulated_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "dragon.csv").write_bytes(b"numbers")
    inputs = whole_study.StudyInputs(Extent(), 1, {"dragon_skin_10": tmp_path / "dragon.csv"})
    monkeypatch.setattr(whole_study, "by_tension", lambda *given: [given])
    test = SimpleNamespace(strain="strain", stress_Pa="stress")
    monkeypatch.setattr(whole_study, "read_tensile", lambda path: test)
    own, published = whole_study._tension("dragon_skin_10", inputs)
    strain, stress = MATERIALS["dragon_skin_10"].tensile_curve()
    assert (own[0].tolist(), own[1].tolist()) == (strain.tolist(), stress.tolist())
    assert own[2:] == ("own", inputs.extent)
    assert published == ("strain", "stress", "published", inputs.extent)
    assert len(whole_study._tension("ecoflex_00_50", inputs)) == 1
    head = inputs.head()
    assert head["published"] == {"dragon_skin_10": hashlib.sha256(b"numbers").hexdigest()}
    assert head["seed"] == 1
    assert head["extent"]["cases"] == 5
    assert head["versions"] == package_versions()


def test_a_law_fitted_to_bending_is_stored_with_its_search(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    found = SimpleNamespace(
        values=np.array([25e3, 1e3, 50.0]),
        initial_shear_modulus=Quantity(50e3, "Pa", (49e3, 52e3)),
        parameters=YEOH,
        evaluations=300,
        history=[1, 2, 3],
        discarded=SimpleNamespace(unconverged=4, unstable=5),
        mean_error_mm=0.002,
        mean_deviation_mm=0.001,
        max_stretch=1.25,
        identifiability=SimpleNamespace(not_fixed=("C30",)),
        wall_s=6.5,
    )
    monkeypatch.setattr(routes, "identify", lambda *given, **options: calls.append((given, options)) or found)
    experiment: Any = "experiment"
    stored = routes.by_bending("yeoh", experiment, 7)
    assert calls == [(("yeoh", ["experiment"]), {"seed": 7, "possible_causes": ()})]
    assert stored == {
        "law": "yeoh",
        "values": [25e3, 1e3, 50.0],
        "modulus_Pa": 50e3,
        "source": "bending",
        "window": "",
        "modulus_interval_Pa": [49e3, 52e3],
        "intervals": {name: list(quantity.interval_95) for name, quantity in YEOH.items()},
        "evaluations": 300,
        "generations": 3,
        "unconverged": 4,
        "unstable": 5,
        "mean_error_mm": 0.002,
        "mean_deviation_mm": 0.001,
        "max_stretch": 1.25,
        "not_fixed": ["C30"],
        "seconds": 6.5,
    }
    assert routes.Route.of(stored) == routes.Route("yeoh", (25e3, 1e3, 50.0), 50e3, "bending")


def test_the_edges_of_a_hidden_material_have_their_noise_and_their_twist(monkeypatch: pytest.MonkeyPatch) -> None:
    edges = np.arange(48.0).reshape(2, 2, 6, 2)
    monkeypatch.setattr(observed, "outlines_mm", lambda material, specimen, fields: edges + specimen.length_mm)
    monkeypatch.setattr(observed, "twisted", lambda edges, material, fields: -edges)
    monkeypatch.setattr(observed, "specimen_of", lambda kind: SimpleNamespace(length_mm=float(kind[-1])))
    for kind, sign in (("type1", 1.0), ("type4", -1.0)):
        noise = observed.noise_mm(edges.shape, f"dragon_skin_10 {kind}")
        expected = sign * (edges + float(kind[-1])) + noise
        assert observed.measured_edges_mm("dragon_skin_10", kind, Extent()) == pytest.approx(expected)


def test_a_twisted_beam_is_turned_by_one_degree_in_its_strongest_field(monkeypatch: pytest.MonkeyPatch) -> None:
    material = MATERIALS["dragon_skin_10"]
    edges, fields = np.ones((3, 2, 9, 2)), np.array([0.0, 4.0, 2.0])
    turned: list[Any] = []
    monkeypatch.setattr(observed, "tip_twist_per_tilt", lambda *given: np.array([0.1, -0.25, 0.2]))

    def without_twist(one: Any, other: Any, law: Any, parameters: Any, angle_deg: float) -> Any:
        turned.append((one, other, law, parameters.tolist(), angle_deg))
        return replace(one, observed=replace(one.observed, points_mm=one.observed.points_mm + 5.0))

    monkeypatch.setattr(observed, "without_twist", without_twist)
    assert observed.twisted(edges, material, fields)[:, :, :9] == pytest.approx(np.full((3, 2, 9, 2), 6.0))
    one, other, law, parameters, angle_deg = turned[0]
    assert one is other
    assert (law, parameters, angle_deg) == (material.law, [[52e3]], -4.0)
    assert one.observed.sigma_mm == pytest.approx(np.full((3, 2, 9), 4e-4))
    assert one.loads.field_T[:, 1] == pytest.approx(1e-3 * fields)
    assert (one.model.specimen.section, one.model.specimen.length_mm) == (
        "solid",
        load_specimen("type4").mechanics().length_mm,
    )
    monkeypatch.setattr(observed, "tip_twist_per_tilt", lambda *given: None)
    with pytest.raises(ArithmeticError, match="the beam of like Dragon Skin 10 has no equilibrium in one of the"):
        observed.twisted(edges, material, fields)


def test_the_outlines_of_a_hidden_material_leave_out_points_at_both_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    material, calls = MATERIALS["ecoflex_00_50"], []
    converged = np.ones((1, 2), bool)

    class Model:
        def __init__(self, specimen: Any, *mesh: int) -> None:
            calls.append((specimen, mesh))

        def solve(self, *given: Any, **options: Any) -> Any:
            calls.append((given, options))
            return SimpleNamespace(converged=converged)

    points = np.arange(2 * 2 * 11 * 2.0).reshape(2, 2, 11, 2)
    monkeypatch.setattr(observed, "SolidBeside", Model)
    monkeypatch.setattr(observed, "outline", lambda model, shapes: ("curves", None))
    monkeypatch.setattr(
        observed, "points_on", lambda curves, per_side: points if (curves, per_side) == ("curves", 2) else 0
    )
    specimen: Any = "specimen"
    found = observed.outlines_mm(material, specimen, np.array([0.0, 3.0]), 4e7)
    assert found.tolist() == points[:, :, 4:9].tolist()
    (made, (given, options)) = calls
    assert made == ("specimen", (26, 3, 1))
    assert given[0] is material.law
    assert given[1].tolist() == [[22e3]]
    assert given[2].field_T == pytest.approx(np.array([[0.0, 0.0], [0.0, 3e-3]]))
    assert options["tolerance_mm"] == 1e-3
    assert options["bulk_modulus_Pa"].tolist() == [4e7]
    observed.outlines_mm(material, specimen, np.array([0.0, 3.0]))
    assert calls[3][1]["bulk_modulus_Pa"] is None
    converged[0, 1] = False
    with pytest.raises(ArithmeticError, match="the beam of like Ecoflex 00-50 has no equilibrium in one of the"):
        observed.outlines_mm(material, specimen, np.array([0.0, 3.0]))


def test_each_optimiser_runs_on_each_law_with_its_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[Any] = []

    def run(optimiser: Any, problem: Any, seed: int) -> Any:
        runs.append((problem.law.name, optimiser, seed))
        moduli = np.array([90.0, 100.5, 100.0 + 0.8 * (seed == 6)])
        values = [0.003, 0.002, 0.001 + 0.001 * (seed == 6) + 0.01 * (optimiser != "a")]
        return SimpleNamespace(values=values, moduli_Pa=lambda: moduli)

    monkeypatch.setattr(optimisers, "_experiment", lambda: None)
    monkeypatch.setattr(optimisers, "_run", run)
    monkeypatch.setattr(optimisers, "OPTIMISERS", {"CMA-ES": "a", "Gauss-Newton": "b"})
    monkeypatch.setattr(
        optimisers, "Problem", lambda law, unknowns, experiments: SimpleNamespace(law=law, experiments=experiments)
    )
    rows = optimisers.evaluations_to_one_percent(Extent(cases=2), 5)
    assert runs == [
        (law, optimiser, seed) for law in ("neo-hookean", "yeoh") for optimiser, seed in (("a", 5), ("a", 6), ("b", 5))
    ]
    assert [(row["law"], row["optimiser"]) for row in rows] == [
        (law, name) for law in ("neo-hookean", "yeoh") for name in ("CMA-ES", "Gauss-Newton")
    ]
    assert rows[0]["to_one_percent"] == [2, 2]
    assert rows[0]["evaluations"] == [3, 3]
    assert rows[0]["least_error_um"] == pytest.approx([1.0, 2.0])
    assert rows[1]["least_error_um"] == pytest.approx([2.0])
