"""The data, options and errors of a fit agree with hand calculations, also just below and above each threshold."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.evidence.measurements import PointObservation
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource
from eimi_lab.fits import checkpoint, evidence, predicted_error, simulated_fit
from eimi_lab.fits.options import FitOptions
from eimi_lab.fits.states_used import FEW_POINTS, FlaggedState, WidenedState
from eimi_lab.process.errors import InputError
from eimi_lab.vision.check import Flag, Severity

UNUSABLE = Flag("DARK", 1.0, 2.0, "give more light")
WIDENING = Flag("SOFT", 1.0, 2.0, "focus the lens", Severity.NOTE, 0.3, "px")


def pair(left: int = 10, right: int = 10, *flags: Flag) -> Any:
    def edge(count: int, sigma: float) -> Any:
        places = np.column_stack([np.arange(count), np.full(count, sigma)])
        return SimpleNamespace(points_mm=places.astype(float), sigma_mm=np.full(count, sigma))

    return SimpleNamespace(left=edge(left, 0.03), right=edge(right, 0.04), flags=flags)


def state(index: int, *flags: Flag) -> Any:
    return SimpleNamespace(index=index, flags=flags)


def dataset(*states: Any, edges: Any = None, pixels_per_mm: float | None = 10.0) -> Any:
    return SimpleNamespace(
        kind="frames",
        path=Path("run.h5"),
        states=states,
        edges=lambda: edges,
        calibration=None if pixels_per_mm is None else SimpleNamespace(pixels_per_mm=pixels_per_mm),
        specimen=SimpleNamespace(specimen=SimpleNamespace(width_mm=3.0, depth_mm=5.0)),
    )


def test_the_first_flag_of_the_edges_is_told_with_its_remedy() -> None:
    assert evidence._first_flag((pair(), pair())) == "the frames show no beam"
    assert evidence._first_flag((pair(), pair(9, 9, UNUSABLE, WIDENING))) == "the first flag is DARK: give more light"


def test_a_state_needs_ten_points_on_each_edge_and_no_serious_flag() -> None:
    edges = [pair(), pair(9, 10), pair(10, 9), pair(10, 10, UNUSABLE), pair(), pair(10, 10, WIDENING)]
    data = dataset(*(state(i) for i in range(4)), state(4, UNUSABLE), state(5), edges=edges)
    assert evidence._used(data, edges, flagged=False) == [0, 5]
    assert evidence._used(data, edges, flagged=True) == [0, 3, 4, 5]
    assert evidence._used(data, edges[:1], flagged=True) == [0]


def test_a_flag_widens_the_uncertainty_of_the_points_but_not_their_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evidence, "_view", lambda data: "view")
    edges = [pair(), pair(10, 10, WIDENING)]
    data = dataset(state(0), state(1, WIDENING), edges=edges)  # the same flag twice counts once
    assert evidence._widening_mm(data, edges, 0) == 0.0
    assert evidence._widening_mm(data, edges, 1) == pytest.approx(0.03)
    assert evidence._widening_mm(data, (), 1) == 0.0
    assert evidence._widening_mm(dataset(state(0), state(1, WIDENING), pixels_per_mm=None), edges, 1) == 0.0
    observed = evidence._edge_observation(data, edges, [1])
    assert observed.sigma_mm[0, :, 0] == pytest.approx([np.hypot(0.03, 0.03), 0.05])
    assert observed.noise_mm is not None
    assert observed.noise_mm[0, :, 0] == pytest.approx([0.03, 0.04])
    assert observed.points_mm[0, 0, 3].tolist() == [3.0, 0.03]
    assert (observed.view, observed.points_mm.shape) == ("view", (1, 2, 10, 2))


def test_states_that_are_left_out_flagged_or_widened_are_listed() -> None:
    edges = [pair(), pair(9), pair(10, 10, UNUSABLE), pair(10, 10, WIDENING)]
    data = dataset(state(0), state(1), state(2, WIDENING, UNUSABLE), state(7), edges=edges)
    found = evidence._states_used(data, [0, 3])
    assert found.total == 4
    assert found.left_out == (FlaggedState(1, (FEW_POINTS,)), FlaggedState(2, ("SOFT", "DARK")))
    assert found.flagged == (FlaggedState(7, ("SOFT",)),)
    assert found.widened == (WidenedState(7, pytest.approx(0.03)),)  # type: ignore[arg-type]
    data.kind = "points"
    assert evidence._states_used(data, [0, 3]).flagged == ()


def test_tracked_points_are_padded_and_keep_their_depth() -> None:
    def points(count: int, depth: float | None) -> Any:
        rest = np.arange(2.0 * count).reshape(count, 2)
        z = None if depth is None else np.full(count, depth)
        return SimpleNamespace(names=["p"] * count, rest_mm=rest, points_mm=rest + 1, sigma_mm=0.1, depth_mm=z)

    data: Any = SimpleNamespace(kind="points", points=lambda: [points(1, 2.0), points(2, None)])
    used, observed = evidence._observed(data, flagged=False)
    assert used == [0, 1]
    assert isinstance(observed, PointObservation)
    assert observed.rest_mm.tolist() == [[[0, 1], [0, 0]], [[0, 1], [2, 3]]]
    assert observed.moved_mm.tolist() == [[[1, 2], [0, 0]], [[1, 2], [3, 4]]]
    assert observed.sigma_mm.tolist() == [[0.1, np.inf], [0.1, 0.1]]
    assert observed.depth_mm is not None
    assert observed.depth_mm.tolist() == [[2.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(("good", "checked"), [(2, False), (1, True), (0, True)])
def test_the_width_is_checked_if_fewer_than_half_of_the_states_can_be_used(
    monkeypatch: pytest.MonkeyPatch, good: int, checked: bool
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(evidence, "check_width", asked.append)
    monkeypatch.setattr(evidence, "_edge_observation", lambda *given: given[2])
    edges = tuple(pair(10 if i < good else 5) for i in range(4))
    data = dataset(*(state(i) for i in range(4)), edges=edges)
    if not good:
        with pytest.raises(InputError, match=r"run.h5: no state has edges that can be used; the frames show no beam"):
            evidence._observed(data, flagged=False)
    else:
        assert evidence._observed(data, flagged=False) == (list(range(good)), list(range(good)))
    assert asked == [data] * checked


@pytest.mark.parametrize("good", [1, 2])
def test_an_unfinished_run_needs_two_usable_states(monkeypatch: pytest.MonkeyPatch, good: int) -> None:
    for name in ("BeamModel", "loads_of_states", "_edge_observation"):
        monkeypatch.setattr(evidence, name, lambda *given, **options: given)
    monkeypatch.setattr(evidence, "sources_of", lambda data: ())
    monkeypatch.setattr(evidence, "_measured_rest_shape", lambda data, experiment: None)
    edges = [pair(10 if i < good else 5) for i in range(3)]
    data = dataset(*(state(i) for i in range(3)), edges=edges)
    data.specimen.mechanics = lambda: SimpleNamespace(planar_section="plane-stress")
    found = evidence.experiment_so_far(data, edges)
    assert (found is None) is (good < 2)
    if found is not None:
        assert found.loads == (data, list(data.states[:2]))  # type: ignore[comparison-overlap]


# Options


def fitted(field_T: float = 1e-3, section: str = "plane-strain", *stated: StatedSource, sha: str = "a") -> Any:
    experiment = SimpleNamespace(
        model=SimpleNamespace(specimen=SimpleNamespace(section=section)),
        loads=SimpleNamespace(field_T=np.array([[0.0, field_T]])),
        stated=stated,
    )
    return SimpleNamespace(path=Path(f"{sha}.h5"), sha256=sha, experiment=experiment)


def test_a_freed_input_needs_a_standard_deviation() -> None:
    free = FitOptions(free=["width"])
    free.check([fitted(1e-3, "solid", StatedSource("width", 0.02, "a specimen"))])
    FitOptions(free=["width=0.02"]).check([fitted()])
    usual = f"such as --free width={SOURCES['width'].usual:g}$"
    with pytest.raises(InputError, match=r"--free width: a.h5 gives no uncertainty of this input; give .*" + usual):
        free.check([fitted(1e-3, "solid", StatedSource("depth", 0.02, "a specimen"))])
    with pytest.raises(InputError, match=r"--free width: a.h5 gives the uncertainty 0 for this input"):
        free.check([fitted(1e-3, "solid", StatedSource("width", 0.0, "a specimen"))])


def test_a_freed_input_of_the_field_needs_a_field() -> None:
    free = FitOptions(free=["coil=0.01", "bulk"])
    free.check([fitted()])
    with pytest.raises(InputError, match=r"--free coil: a.h5 has no state with a field"):
        free.check([fitted(0.0)])
    with pytest.raises(InputError, match=r"--free bulk: a.h5 is modelled as solid"):
        free.check([fitted(1e-3, "solid")])


def test_equal_files_are_refused() -> None:
    FitOptions().check([fitted(), fitted(sha="b")])
    with pytest.raises(InputError, match=r"b.h5: has the same content as a.h5"):
        FitOptions().check([fitted(), SimpleNamespace(**{**vars(fitted()), "path": Path("b.h5")})])


def test_an_input_is_freed_once_and_within_its_largest_deviation() -> None:
    options = FitOptions(free=["bulk", "width=0.02", "coil=0.01"]).for_identify()
    assert [(prior.kind, prior.spread) for prior in options["free"]] == [("width", 0.02), ("coil", 0.01)]
    assert options["free_bulk"] is True
    assert FitOptions(free=["width=0.02"]).for_identify()["free_bulk"] is False
    with pytest.raises(InputError, match=r"--free width=0.03: width is given twice"):
        FitOptions(free=["width=0.02", "width=0.03"]).for_identify()
    with pytest.raises(InputError, match=r"--free width=-1: should be width=NUMBER above 0, at most"):
        FitOptions(free=["width=-1"]).for_identify()


@pytest.mark.parametrize("weight", [0.0, -1.0, float("inf"), float("nan")])
def test_the_weight_of_curves_is_above_zero(weight: float) -> None:
    with pytest.raises(InputError, match=r"--tensile-weight \S+: should be a number above 0"):
        FitOptions(tensile=[Path("a.csv")], tensile_weight=weight).for_identify()


def test_the_window_and_weight_of_curves_reach_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "eimi_lab.fits.tensile_files.read_curve",
        lambda path, percent, weight: SimpleNamespace(path=path, sha256=path.name, percent=percent, weight=weight),
    )
    (curve,) = FitOptions(tensile=[Path("a")], tensile_weight=0.5).for_identify()["tensile"]
    assert (curve.percent, curve.weight) == (50.0, 0.5)
    first, second = FitOptions(tensile=[Path("a"), Path("b")], tensile_window="30").for_identify()["tensile"]
    assert (first.percent, first.weight, second.percent) == (30.0, 1.0, 30.0)
    assert FitOptions(tensile=[Path("a"), Path("b")]).head()["tensile"] == ["a", "b"]
    with pytest.raises(InputError, match=r"c/a: has the same content as a; the same data would count twice"):
        FitOptions(tensile=[Path("a"), Path("b"), Path("c/a")]).for_identify()


# Checkpoints


def head(**changes: Any) -> checkpoint.Head:
    values: dict[str, Any] = {
        "fits": ("yeoh",),
        "datasets": ("1", "2"),
        "options": asdict(FitOptions()),
        "versions": {"eimi": "1"},
    }
    return checkpoint.Head(**{**values, **changes})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fits": ("ogden",)}, "fits should be the same: yeoh in the checkpoint, ogden here"),
        (
            {"datasets": ("1", "2", "3", "4", "5", "6")},
            r"datasets \(sha256\) should be the same: 1, 2 in the checkpoint, 1, 2, 3, 4 and 2 more here",
        ),
        ({"datasets": ("1", "2", "3", "4")}, "1, 2 in the checkpoint, 1, 2, 3, 4 here"),
        (
            {"options": {**asdict(FitOptions()), "restarts": 3}},
            "restarts should be the same: 0 in the checkpoint, 3 here",
        ),
        (
            {"versions": {"eimi": "1", "numpy": "2"}},
            "version of numpy should be the same: None in the checkpoint, 2 here",
        ),
    ],
)
def test_a_checkpoint_of_another_fit_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        checkpoint._check_same(Path("log"), head(), head(**changes))


def test_an_older_checkpoint_has_the_defaults_of_newer_options() -> None:
    checkpoint._check_same(Path("log"), head(options={}), head())


# Errors of fits on datasets


def misfit(*errors_mm: float) -> Any:
    return SimpleNamespace(error_mm=np.array([errors_mm]), deviation_mm=np.array([errors_mm]) / 2)


@pytest.mark.parametrize(("more", "within"), [(0.0009, True), (0.0011, False)])
def test_a_validation_tells_whether_the_stretch_was_reached_in_the_fit(
    monkeypatch: pytest.MonkeyPatch, more: float, within: bool
) -> None:
    monkeypatch.setattr(simulated_fit, "Validation", lambda **given: SimpleNamespace(**given))
    monkeypatch.setattr(simulated_fit, "FitReference", SimpleNamespace(of=lambda *given: given))
    monkeypatch.setattr(simulated_fit, "StateError", SimpleNamespace(of=lambda *given: given))
    fit = SimpleNamespace(model="yeoh", initial_shear_modulus="modulus", stretch_reached=1.2)
    law: Any = SimpleNamespace(fit=fit, path=Path("fits.json"), index=3)
    data: Any = SimpleNamespace(**vars(fitted()), used="states")
    plain: Any = SimpleNamespace(max_stretch=np.array([1.2 + more]), unstable=np.array([False]))
    found = simulated_fit._validation(data, law, True, plain, misfit(1.0, 3.0))
    assert (found.status, found.seen, found.stable, found.within_fitted_stretch) == ("ok", True, True, within)
    assert (found.mean_error_mm, found.mean_deviation_mm, found.max_stretch) == (2.0, 1.0, 1.2 + more)
    assert found.mean_error_interval_mm is None
    assert found.by_state[0] is data
    assert [part.tolist() for part in found.by_state[1:]] == [[1.0, 3.0], [0.5, 1.5]]
    assert (found.dataset, found.sha256, found.section, found.model) == ("a.h5", "a", "plane-strain", "yeoh")
    assert (found.fit, found.states) == ((fit, Path("fits.json"), 3), "states")
    without = simulated_fit._validation(data, law, False, plain, None)
    assert (without.status, without.seen, without.by_state) == ("no equilibrium", False, ())
    assert (without.mean_error_mm, without.max_stretch, without.within_fitted_stretch) == (None, None, None)
    monkeypatch.setattr(simulated_fit, "RingDownRecord", SimpleNamespace)
    assert simulated_fit._validation(data, law, False, plain, misfit(1.0, 3.0)).within_fitted_stretch is None


def test_the_error_of_a_prediction_includes_independent_and_shared_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = [
        (StatedSource("width", 0.02, "a"), 0),
        (StatedSource("coil", 0.01, "b"), 0),
        (StatedSource("depth", 0.1, "c"), 0),
    ]
    changes = [np.full((1, 2, 1), 3.0), np.full((1, 2, 1), 5.0), None]
    monkeypatch.setattr(predicted_error, "_uncertain_numbers", lambda *_: numbers)
    monkeypatch.setattr(predicted_error, "_candidate", lambda *_: "candidate")
    assumed = SimpleNamespace(applied=lambda experiment: "assumed")
    monkeypatch.setattr(predicted_error, "assumptions_of", lambda *_: assumed)

    def changes_by(candidate: Any, experiment: Any, sizes: Any, near: Any) -> Any:
        assert (candidate, experiment, near) == ("candidate", "assumed", "near")
        assert sizes == [("width", 0, 0.02), ("coil", 0, 0.01), ("depth", 0, 0.1)]
        return changes

    monkeypatch.setattr(predicted_error, "changes_by", changes_by)
    shared = np.array([0.1, -0.2, 0.3])
    monkeypatch.setattr(
        predicted_error,
        "_shared_deviations",
        lambda fit, of, part, draws: shared[:draws] if of.source == "coil" else None,
    )
    residuals = np.zeros((4, 1, 2, 1))
    residuals[1:] = 1.0
    of: Any = SimpleNamespace(residuals=residuals, weights=np.ones((1, 2, 1)), error_mm=np.ones((4, 1)))
    data: Any = SimpleNamespace(experiment="experiment", sha256="a")
    fit: Any = SimpleNamespace(draws=None)
    found = predicted_error.predicted_errors_mm(fit, data, of, "near")  # type: ignore[arg-type]
    assert found.shape == (25, 3)
    # each error is |1 + 3 n + 5 s| with a number n that is drawn anew each time
    signed = np.stack([(found - 1 - 5 * shared) / 3, (-found - 1 - 5 * shared) / 3])
    drawn = signed[np.abs(signed).argmin(axis=0), np.arange(25)[:, None], np.arange(3)]
    assert np.unique(drawn.round(9)).size == 75
    assert 0.5 < drawn.std() < 1.5
    changes[:] = [None, None, None]
    of.error_mm = np.array([[9.0, 9.0], [1.0, 3.0], [2.0, 2.0], [4.0, 5.0]])
    assert predicted_error.predicted_errors_mm(fit, data, of, "near").tolist() == [[2.0, 2.0, 4.5]]  # type: ignore[arg-type]
