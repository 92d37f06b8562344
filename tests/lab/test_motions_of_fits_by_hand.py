"""Recorded motions, planned ring-downs and discovered laws, against values computed by hand."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.discovery.terms_of_a_law import LIBRARY, Alternative, Discovery
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.laws.sum_of_terms import Term
from eimi_lab.fits import discovering, planned_ring_down, recorded_motions
from eimi_lab.fits.planned_ring_down import ExpectedRingDown
from eimi_lab.fits.recorded_motions import MotionEvidence
from eimi_lab.process.errors import InputError

I1, CUBE = Term.of("i1"), Term.of("i1^3")


# Recorded motions


def motion(kind: str = "ring_down", **changes: Any) -> Any:
    values: dict[str, Any] = {"from_A": 2.0, "to_A": 0.5, "hanging_N": 0.0, "tip_force_N": 0.0, "history": ()}
    return SimpleNamespace(kind=kind, **{**values, **changes})


@pytest.fixture(autouse=True)
def _loads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_motions, "_loads", lambda dataset, *given: given)


@pytest.mark.parametrize(
    ("recorded", "before"),
    [
        (motion(), ((-1000.0, (2.0, 0.0)),)),
        (motion(hanging_N=0.1), ((-1000.0, (2.0, 0.1)),)),
        (motion("creep", hanging_N=0.1), ((-1000.0, (2.0, 0.0)),)),  # the weight was hung on the beam
        (motion("creep"), ((-1000.0, (2.0, 0.0)),)),
        (motion("creep", hanging_N=0.1, tip_force_N=0.2), ((-1000.0, (2.0, pytest.approx(0.3))),)),
        (motion(tip_force_N=0.2), ((-1000.0, (2.0, 0.2)),)),
        (motion(history=((-3.0, 1.0), (-9.0, 4.0), (0.0, 7.0), (2.0, 8.0))), ((-9.0, (4.0, 0.0)), (-3.0, (1.0, 0.0)))),
        (motion(from_A=0.5), ()),
        (motion(from_A=0.5, history=((-1.0, 0.5), (5.0, 3.0))), ()),
        (motion(from_A=0.5, history=((-1.0, 0.6),)), ((-1.0, (0.6, 0.0)),)),
    ],
)
def test_a_motion_follows_from_the_loads_before_it(recorded: Any, before: Any) -> None:
    found = recorded_motions._recorded(None, recorded)  # type: ignore[arg-type]
    assert found.loads == (0.5, recorded.hanging_N)
    assert (found.before or ()) == before


def evidence_of(path: str, has_states: bool, specimen: str = "beam", has_recording: bool = True) -> MotionEvidence:
    given: Any = (Path(path), path, specimen, (), (), (), has_states, has_recording)
    return MotionEvidence(*given)


@pytest.mark.parametrize(
    ("has_states", "each", "groups"),
    [
        ((True, True), False, ["ab"]),
        ((True, True), True, ["a", "b"]),
        ((True, True, False), True, ["ac", "bc"]),  # a recording without states belongs to all states
        ((False, False), False, ["ab"]),
        ((False, False), True, ["a", "b"]),
    ],
)
def test_a_fit_of_each_dataset_uses_its_own_motions(
    has_states: tuple[bool, ...], each: bool, groups: list[str]
) -> None:
    motions = [evidence_of(path, states) for path, states in zip("abc", has_states, strict=False)]
    found = recorded_motions.fitted_together(motions, each)
    assert ["".join(str(one.path) for one in group) for group in found] == groups


def test_datasets_that_are_fitted_separately_need_a_ring_down_each_but_not_one_specimen() -> None:
    beams = [evidence_of("a", True), evidence_of("b", True, "other beam")]
    assert recorded_motions.with_ring_downs(beams, each=True) == beams
    with pytest.raises(InputError, match=r"^b: the specimen of this dataset differs from the specimen of a; "):
        recorded_motions.with_ring_downs(beams)
    silent = [evidence_of("a", True), evidence_of("b", True, has_recording=False)]
    assert recorded_motions.with_ring_downs(silent) == silent
    with pytest.raises(InputError, match=r"^b: --time prony: there is no ring-down; "):
        recorded_motions.with_ring_downs(silent, each=True)


@pytest.mark.parametrize(
    ("clock_s", "set_s", "measured_s"),
    [
        (
            [5.0, 40.0, 90.0, 200.0],
            [10.0, 40.0],
            [40.0, 200.0],
        ),  # the states 1 and 3: set 30 s before the first was measured
        ([], [0.0, 30.0], [30.0, 60.0]),
        ([0.0, 100.0, 0.0, 100.0], [0.0, 30.0], [30.0, 60.0]),  # a clock that stands still is not used
        ([0.0, 100.0, 0.0, np.nan], [0.0, 30.0], [30.0, 60.0]),
        ([0.0, 20.0, 0.0, 50.0], [-1.0, 20.0], [20.0, 50.0]),
        ([0.0, -50.0, 0.0, 50.0], [-51.0, -50.0], [-50.0, 50.0]),
    ],
)
def test_states_are_set_when_the_state_before_was_measured(
    monkeypatch: pytest.MonkeyPatch, clock_s: list[float], set_s: list[float], measured_s: list[float]
) -> None:
    opened = SimpleNamespace(times_of_states=lambda: np.array(clock_s))
    monkeypatch.setattr(recorded_motions, "open_dataset", lambda path: nullcontext(opened))
    states = (SimpleNamespace(index=1), SimpleNamespace(index=3))
    data: Any = SimpleNamespace(path=Path("a"), states=states, experiment=SimpleNamespace(loads="loads"))
    run = recorded_motions._static_run(data)
    assert run.loads == "loads"
    assert run.set_s.tolist() == set_s
    assert run.seen_s.tolist() == measured_s


def test_static_states_have_the_uncertainty_of_the_fit_and_the_inputs_of_the_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(recorded_motions, "_static_run", lambda one: one)
    budget = [SimpleNamespace(source=name, effect_percent=2.0) for name in ("width", "coil", "scale", "noise")]

    def record(interval: Any, interval_fit: Any = None) -> Any:
        modulus = SimpleNamespace(value=100.0, interval_95=interval, interval_95_fit=interval_fit)
        return SimpleNamespace(initial_shear_modulus=modulus, budget=budget)

    found = recorded_motions.static_states(["a", "b"], record((90.0, 110.0)))  # type: ignore[list-item]
    assert found.runs == ("a", "b")
    assert found.modulus_Pa == 100.0
    assert found.sigma == pytest.approx(20 / 3.92 / 100)
    assert found.of_picture == {"scale": 0.02}
    narrow = recorded_motions.static_states([], record((90.0, 110.0), (98.0, 102.0)))
    assert narrow.sigma == pytest.approx(4 / 3.92 / 100)
    exact = recorded_motions.static_states([], record((100.0, 100.001)))
    assert exact.sigma == 1e-4


# A planned ring-down


class Beam:
    # Replaces a vibrating beam: the frequency is the square root of the modulus and grows with the width.

    def __init__(self, *given: Any) -> None:
        self.given, self.width = given, 0.0

    def undamped_Hz(self, modulus: float) -> np.ndarray:
        return np.array([np.sqrt(modulus) * (1 + self.width)])

    def under(self, deviations: Any) -> Beam:
        changed = Beam(*self.given)
        changed.width = float(deviations["width"][0]) if "width" in deviations else 0.0
        return changed


def planned(monkeypatch: pytest.MonkeyPatch, effects: dict[str, float], *stated: StatedSource) -> ExpectedRingDown:
    monkeypatch.setattr(planned_ring_down, "RingingBeam", Beam)
    asked: list[Any] = []

    def small(*given: Any) -> Any:
        asked.append(given[2:5])
        return [SimpleNamespace(modulus_percent=0.3), SimpleNamespace(modulus_percent=0.4)]

    monkeypatch.setattr(planned_ring_down, "small_effects", small)
    law = SimpleNamespace(initial_shear_modulus=lambda parameters: 2 * parameters[0], units=("Pa", "1"))
    known: Any = SimpleNamespace(law=law, parameters=(50.0, 3.0))
    found = planned_ring_down.expected_ring_down(known, None, 0.0, 0.01, stated, 4.0, effects)  # type: ignore[arg-type]
    assert found is not None
    assert asked == [(pytest.approx(10.0), 0.1, pytest.approx(2.0))]
    return found


def test_a_planned_ring_down_joins_two_estimates_of_the_modulus(monkeypatch: pytest.MonkeyPatch) -> None:
    effects = {"width": 1.0, "moment": 0.8}
    stated = (StatedSource("width", 0.01, "a"), StatedSource("moment", 0.02, "a"), StatedSource("depth", 0.0, "a"))
    found = planned(monkeypatch, effects, *stated)
    # The frequency grows by ln(1.01) for the width; twice that is the change of the modulus. 5e-4 of the frequency is
    # 0.1 per cent of the modulus.
    dynamic = {"width": 200 * np.log(1.01), "moment": 0.0}
    noise = np.sqrt(0.1**2 + 0.3**2 + 0.4**2)
    assert found.frequency_Hz == pytest.approx(10.0)
    assert found.dynamic_percent == pytest.approx(1.959964 * np.hypot(dynamic["width"], noise), rel=1e-5)
    assert found.without_percent == 4.0
    static = (4.0 / 1.959964) ** 2
    covariance = np.array([[static, dynamic["width"]], [dynamic["width"], dynamic["width"] ** 2 + noise**2 + 1.0]])
    weights = np.linalg.solve(covariance, np.ones(2))
    weights /= weights.sum()
    assert found.with_percent == pytest.approx(1.959964 * np.sqrt(weights @ covariance @ weights), rel=1e-5)
    assert found.moment_share_percent == pytest.approx(1.959964 * 0.8, rel=1e-5)
    rest = static - 1.0 - 0.8**2
    difference = (1.0 - dynamic["width"]) ** 2 + rest + noise**2 + 1.0
    assert found.moment_percent == pytest.approx(1.959964 / np.sqrt(1 / 0.8**2 + 1 / difference), rel=1e-5)
    assert "would shrink from" in found.in_words


def test_a_ring_down_without_an_effect_of_the_magnet_shrinks_no_part_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found = planned(monkeypatch, {"width": 9.0}, StatedSource("width", 0.01, "a"))
    assert (found.moment_share_percent, found.moment_percent) == (0.0, None)
    assert "shrink" not in found.in_words


def test_the_relative_uncertainties_of_a_planned_ring_down() -> None:
    assert (planned_ring_down.FREQUENCY_SHARE, planned_ring_down.RELAXATION_SHARE) == (5e-4, 0.01)
    found = ExpectedRingDown(12.34, 1.0, 4.0, 2.0, 3.0, 1.5)
    assert found.in_words == (
        "with a ring-down in zero field, at about 12.3 Hz, and creep: ± 2 % instead of ± 4 %; the part of this "
        "interval that the moment and the field cause would shrink from ± 3 % to ± 1.5 % of the modulus; the ring-down "
        "alone determines the dynamic modulus to ± 1 %"
    )


# Discoveries


def alternative(*terms: Term) -> Alternative:
    k = len(terms)
    coefficients = 1e3 * np.arange(1.0, k + 1)
    intervals = np.column_stack([coefficients - 100, coefficients + 200])
    return Alternative(terms, coefficients, intervals, 1000.0, 1.234, 3.0)


def discovery(*alternatives: Alternative) -> Discovery:
    return Discovery(alternatives, {CUBE: 0.3}, 0.8, (I1, CUBE), (Term.of("gent=20"),), (0.01,), (5.0,), ((I1,),), 7)


@pytest.mark.parametrize(("count", "more"), [(11, None), (12, None), (13, 1), (15, 3)])
def test_at_most_twelve_alternatives_are_printed(count: int, more: int | None) -> None:
    printed = discovering.lines(discovery(*[alternative(I1, CUBE)] * count), Path("out.json"))
    shown = [line for line in printed if line.startswith("  mu of i1")]
    assert len(shown) == min(count, 12)
    assert shown[0] == (
        "  mu of i1 1 kPa, 95 % interval 0.9 to 1.2 kPa, C of i1^3 2 kPa, 95 % interval 1.9 to 2.2 kPa; the error on "
        "data that were left out of the fit is 1.23 times the noise"
    )
    further = [line for line in printed if line.startswith("  and ")]
    assert further == ([f"  and {more} further laws in out.json"] if more else [])
    assert printed[-1] == ("  the term gent=20 was left out, because a curve exceeds the limiting stretch of this term")


def test_the_content_of_a_discovery() -> None:
    evidence: Any = [SimpleNamespace(path=Path("a.h5"), sha256="a", taken_as_exact=("width",))]
    curves: Any = [SimpleNamespace(path="t.csv", sha256="t", window_percent=50.0)]
    found = discovering.content(discovery(alternative(I1, CUBE)), evidence, curves, lot=0.02)
    assert found["identified"] is False
    assert found["alternatives"] == [
        {
            "terms": ["i1", "i1^3"],
            "coefficients_Pa": {"mu of i1": 1000.0, "C of i1^3": 2000.0},
            "intervals_95_Pa": {"mu of i1": [900.0, 1200.0], "C of i1^3": [1900.0, 2200.0]},
            "initial_shear_modulus_Pa": 1000.0,
            "held_out_error_over_noise": 1.234,
            "stable_to": 3.0,
        }
    ]
    assert (found["terms_in_all"], found["terms_that_could_be_there"]) == (["i1", "i1^3"], {"i1^3": 0.3})
    assert (found["at_strain"], found["sets_fitted"], found["lot"]) == (0.8, 7, 0.02)
    assert found["library"][0] == {"term": "i1", "energy": "mu/2 (I1 - 3)"}
    assert (found["terms_left_out"], found["sets_in_play"]) == (["gent=20"], [["i1"]])
    assert found["datasets"] == [{"path": "a.h5", "sha256": "a", "noise_mm": 0.01, "taken_as_exact": ("width",)}]
    assert found["tensile"] == [{"path": "t.csv", "sha256": "t", "window_percent": 50.0, "noise_Pa": 5.0}]


def test_the_library_is_that_of_the_names_or_the_whole_one() -> None:
    assert discovering.library_of([]) == LIBRARY
    assert discovering.library_of(["i1", "i1^3"]) == (I1, CUBE)
    with pytest.raises(InputError, match="--term gent: should be one of"):
        discovering.library_of(["gent"])
