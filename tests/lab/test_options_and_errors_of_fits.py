"""Options of a fit are checked, and errors of predictions are computed and tabled, with small stand-ins."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.beam.strip import ImpossibleShape
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.fits import (
    evidence,
    fit_summary,
    fits_file,
    options,
    predicted_error,
    simulated_fit,
    tensile_files,
    time_fits,
)
from eimi_lab.fits.options import FitOptions
from eimi_lab.fits.records import CurveRecord, FitRecord
from eimi_lab.fits.states_used import StatesUsed
from eimi_lab.fits.tensile_files import FileCurve
from eimi_lab.fits.validation import FitReference, Validation
from eimi_lab.fits.validation_tables import by_dataset, by_state, matrix
from eimi_lab.process.errors import InputError

RELEASE = Path(__file__).parents[1] / "compatibility" / "release"


def data(
    name: str = "a.h5", sha256: str = "12", section: str = "solid", field_T: float = 1e-3, *stated: StatedSource
) -> Any:
    specimen = SimpleNamespace(section=section)
    loads = SimpleNamespace(field_T=np.full((2, 2), field_T))
    experiment = SimpleNamespace(model=SimpleNamespace(specimen=specimen), loads=loads, stated=stated)
    return SimpleNamespace(path=Path(name), sha256=sha256, experiment=experiment)


def test_two_datasets_with_the_same_content_are_refused() -> None:
    FitOptions().check([data(), data("b.h5", "34"), data()])
    with pytest.raises(InputError, match=r"^b\.h5: has the same content as a\.h5; the same data would count twice$"):
        FitOptions().check([data(), data("b.h5")])


def test_the_bulk_modulus_is_fitted_in_plane_strain_only() -> None:
    FitOptions(free=["bulk"]).check([data(section="plane-strain")])
    with pytest.raises(InputError, match=r"^--free bulk: a\.h5 is modelled as solid, and the fit of this section"):
        FitOptions(free=["bulk"]).check([data()])
    FitOptions(free=["width=0.02"]).check([data()])


def test_an_input_of_the_field_needs_a_field_and_a_standard_deviation() -> None:
    FitOptions(free=["coil=0.01"]).check([data()])
    with pytest.raises(InputError, match=r"^--free coil: a\.h5 has no state with a field, and therefore contains no"):
        FitOptions(free=["coil=0.01"]).check([data(field_T=0.0)])
    FitOptions(free=["width=0.02"]).check([data(field_T=0.0)])
    FitOptions(free=["width"]).check([data("a.h5", "1", "solid", 1e-3, StatedSource("width", 0.01, "beam"))])
    for stated, words in (
        ((), "gives no uncertainty of this input"),
        ((StatedSource("depth", 0.1, "beam"),), "gives no uncertainty of this input"),
        ((StatedSource("width", 0.0, "beam"),), "gives the uncertainty 0 for this input"),
    ):
        with pytest.raises(InputError, match=rf"^--free width: a\.h5 {words}; give a standard deviation, such as --f"):
            FitOptions(free=["width"]).check([data("a.h5", "1", "solid", 1e-3, *stated)])


def test_the_inputs_to_fit_have_a_name_and_a_number() -> None:
    given = FitOptions(free=["bulk", "width=0.02", "clamp", "coil=0.01"]).for_identify()
    assert [(one.kind, one.spread) for one in given["free"]] == [("width", 0.02), ("clamp", None), ("coil", 0.01)]
    assert given["free_bulk"] is True
    assert FitOptions(free=["width=0.02"]).for_identify()["free_bulk"] is False
    assert FitOptions(restarts=3, bipop=True).for_identify() == {
        "free": (),
        "free_bulk": False,
        "tensile": (),
        "priors": (),
        "restarts": 3,
        "bipop": True,
    }
    for free, words in (
        (["width=0.1", "width"], "--free width: width is given twice"),
        (["moment"], "--free moment: should be an input with its standard deviation, such as "),
        (
            ["size=1"],
            r"--free size=1: should be an input with its standard deviation, such as moment=0\.02 \(relative\)",
        ),
        (["width=a"], r"--free width=a: should be width=NUMBER above 0, at most 10 \(mm\)"),
        (["width=0"], "--free width=0: should be width=NUMBER above 0"),
        (["tilt=99"], r"--free tilt=99: should be tilt=NUMBER above 0, at most \d+ \(degrees\)"),
    ):
        with pytest.raises(InputError, match=words):
            FitOptions(free=free).for_identify()


def test_priors_have_a_mean_and_a_deviation() -> None:
    (prior,) = FitOptions(prior=[" C10 =20000,500"]).for_identify()["priors"]
    assert (prior.parameter, prior.mean, prior.standard_deviation) == ("C10", 20000.0, 500.0)
    for words in ("C10=1", "C10=1,2,3", "C10", "C10=a,b"):
        with pytest.raises(InputError, match=f"--prior {words}: should be PARAMETER=MEAN,DEVIATION in the parameter's"):
            FitOptions(prior=[words]).for_identify()
    with pytest.raises(InputError, match="--prior C10=1,-2: "):
        FitOptions(prior=["C10=1,-2"]).for_identify()
    FitOptions(prior=["C10=20000,500"]).check_laws(["yeoh"])
    with pytest.raises(InputError, match=r"^--prior: .*C10"):
        FitOptions(prior=["C10=20000,500"]).check_laws(["yeoh", "ogden"])


def test_a_law_of_time_is_none_or_prony() -> None:
    assert [FitOptions(time=name).has_law_of_time for name in ("none", "prony")] == [False, True]
    with pytest.raises(InputError, match="--time maxwell: should be one of none, prony"):
        assert FitOptions(time="maxwell").has_law_of_time


def test_tensile_curves_have_a_window_a_weight_and_different_contents(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Any] = []

    def read_curve(path: Path, percent: float | None, weight: float) -> Any:
        read.append((path, percent, weight))
        return SimpleNamespace(path=str(path), sha256=path.suffix)

    monkeypatch.setattr(tensile_files, "read_curve", read_curve)
    paths = [Path("a.csv"), Path("b.txt")]
    assert len(FitOptions(tensile=paths).for_identify()["tensile"]) == 2
    assert read == [(path, 50.0, 1.0) for path in paths]
    FitOptions(tensile=paths[:1], tensile_window="full", tensile_weight=0.25).for_identify()
    assert read[-1] == (paths[0], None, 0.25)
    assert FitOptions(tensile=paths).head()["tensile"] == [".csv", ".txt"]
    with pytest.raises(InputError, match=r"^c\.csv: has the same content as a\.csv; the same data would count twice"):
        FitOptions(tensile=[*paths, Path("c.csv")]).for_identify()
    with pytest.raises(InputError, match=r"--tensile-window 20: needs a tensile curve; give --tensile, too"):
        FitOptions(tensile_window="20").for_identify()
    with pytest.raises(InputError, match=r"--tensile-weight 2.0: needs a tensile curve"):
        FitOptions(tensile_weight=2.0).for_identify()
    for weight in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InputError, match=f"--tensile-weight {weight:g}: should be a number above 0"):
            FitOptions(tensile=paths, tensile_weight=weight).for_identify()
    assert options._WINDOW == "50"


# The interval of the error of a prediction


def test_the_interval_of_a_predicted_error_contains_the_mean_error(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    class Observed:
        def of_residuals(self, residuals: np.ndarray) -> Any:
            asked.append(residuals)
            return SimpleNamespace(error_mm=np.abs(residuals).mean(axis=(2, 3)))

    @dataclass(frozen=True)
    class Experiment:
        model: Any
        observed: Any

    coarse_mm = np.zeros((4, 1, 2, 2))
    coarse_mm[0], coarse_mm[1], coarse_mm[2], coarse_mm[3] = 0.5, 0.7, 0.4, 9.0
    comparison = SimpleNamespace(
        misfits=[SimpleNamespace(residuals=coarse_mm)],
        unconverged=np.array([False, False, False, True]),
        shapes=[SimpleNamespace(every="shapes")],
    )
    calls: list[Any] = []
    experiment = Experiment(SimpleNamespace(specimen="beam"), Observed())
    assumed = SimpleNamespace(
        applied=lambda one: experiment, compared=lambda *given, **more: calls.append((given, more)) or comparison
    )
    counts: list[int] = []
    monkeypatch.setattr(predicted_error, "assumptions_of", lambda fit, one, count: counts.append(count) or assumed)
    monkeypatch.setattr(predicted_error, "coarse_model", lambda specimen: f"coarse {specimen}")
    errors = np.array([[1.0, 2.0, 50.0], [3.0, 4.0, 60.0]])
    monkeypatch.setattr(predicted_error, "predicted_errors_mm", lambda fit, one, misfit, near: errors)
    drawn: list[int] = []
    fit: Any = SimpleNamespace(
        model="yeoh", values=lambda: [1.0, 2.0], drawn=lambda most: drawn.append(most) or np.full((3, 2), 7.0)
    )
    one: Any = SimpleNamespace(experiment="experiment")
    residuals = np.array([[[0.2, np.nan], [-0.2, 0.2]]])
    low, high = predicted_error.error_interval_mm(fit, one, residuals) or (0.0, 0.0)
    mean = 0.15  # the mean of the sizes of the residuals of the fit
    assert low == pytest.approx(min(np.quantile([1.0, 2.0, 3.0, 4.0], 0.025), mean))
    assert high is None  # a draw has no equilibrium
    assert asked[0][0] == pytest.approx(np.array([[[0.2, 0.0], [-0.2, 0.2]]]))
    assert asked[0][1:3] == pytest.approx(np.nan_to_num(residuals) + np.array([0.2, -0.1])[:, None, None, None])
    assert (drawn, counts) == ([16], [4])
    (model, candidates, coarse), more = calls[0]
    assert (model, candidates.tolist()) == ("yeoh", [[1.0, 2.0], *[[7.0, 7.0]] * 3])
    assert (coarse.model, more) == ("coarse beam", {"keep": True})
    comparison.unconverged = np.zeros(4, bool)
    low, high = predicted_error.error_interval_mm(fit, one, residuals) or (0.0, 0.0)
    assert (low, high) == (pytest.approx(mean), pytest.approx(np.quantile(errors, 0.975)))
    errors[:] = 0.01
    assert predicted_error.error_interval_mm(fit, one, residuals) == pytest.approx((0.01, mean))
    comparison.unconverged = np.array([True, False, False, False])
    assert predicted_error.error_interval_mm(fit, one, residuals) is None


# Tables of validations


def validation(index: int, dataset: str, error_mm: float | None, **more: Any) -> Validation:
    states = [
        {
            "dataset": 0,
            "state": k,
            "current_A": None,
            "field_mT": 1.5 * k,
            "error_mm": 1e-3 * (index + k),
            "deviation_mm": 1e-4 * k,
        }
        for k in (2, 4)
    ]
    given: dict[str, Any] = {
        "dataset": dataset,
        "sha256": "12",
        "section": "solid",
        "model": "yeoh",
        "fit": FitReference(path="f.json", index=index, kind="bending", window_percent=None),
        "initial_shear_modulus": Quantity(50e3 + index, "Pa", (49e3, 51.239e3)),
        "seen": False,
        "states": StatesUsed(3, (), (), ()),
        "status": "ok",
        "mean_error_mm": error_mm,
        "mean_error_interval_mm": (0.9 * (error_mm or 0), None),
        "mean_deviation_mm": 0.0021,
        "max_stretch": 1.23456,
        "stable": True,
        "within_fitted_stretch": True,
        "by_state": tuple(states),
        **more,
    }
    return Validation.model_validate(given)


def test_the_fits_of_a_dataset_are_sorted_by_their_errors() -> None:
    lost = validation(
        0, "a.h5", None, status="no equilibrium", max_stretch=None, mean_error_interval_mm=None, by_state=()
    )
    far = validation(1, "a.h5", 0.0456, seen=True, stable=False, within_fitted_stretch=False)
    lines = by_dataset([lost, far, validation(2, "a.h5", 0.01234), validation(3, "b.h5", 0.5)])
    assert [line.split()[0] for line in lines] == [
        *("a.h5", "fit", "f.json:2", "f.json:1", "f.json:0", "b.h5", "fit", "f.json:3"),
    ]
    assert lines[0] == "a.h5 (solid, 3 of 3 states used)"
    assert lines[2].split(None, 3)[3] == "50.00 [49.00, 51.24]         12.3 [11.1, >]  2.10    1.235  unseen"
    assert lines[3].endswith("1.235  seen, not stable over these stretches, stretches beyond the data of the fit")
    assert lines[4].split(None, 3)[3].split("  ")[-1] == "no equilibrium"
    (*_, ringing) = by_dataset([validation(0, "a.h5", 0.0456, mean_error_interval_mm=None, within_fitted_stretch=None)])
    assert ringing.endswith("  45.6  2.10    1.235  unseen")


def test_at_most_six_fits_stand_side_by_side_with_their_states_and_their_means() -> None:
    six = [validation(i, "a.h5", 0.01) for i in range(6)]
    lines = by_state(six)
    assert len(lines) == 1 + 1 + 2 + 1
    assert lines[0] == "a.h5: error ± deviation by state, µm"
    assert lines[1].split() == ["state", "field,", "mT", *(w for i in range(6) for w in (f"f.json:{i}", "yeoh"))]
    assert lines[2].split() == ["2", "3.000", *(w for i in range(6) for w in (f"{i + 2}.00", "±", "0.20"))]
    assert lines[4].split() == ["mean", *["10.0", "±", "2.10"] * 6]
    both = by_state([*six, validation(6, "a.h5", 0.01), validation(7, "b.h5", 0.02)])
    assert [line for line in both if line.endswith("µm")] == [lines[0], lines[0], lines[0].replace("a.h5", "b.h5")]
    assert len(both) == 3 * 5
    assert by_state([validation(1, "a.h5", None, by_state=())]) == []


def test_the_matrix_of_fits_and_datasets_marks_the_seen_ones() -> None:
    lines = matrix([validation(0, "a.h5", 0.01, seen=True), validation(0, "b.h5", 0.02)])
    assert lines == [
        "mean error, µm [95 % interval]; * fitted to this dataset",
        "  fit                law              a.h5             b.h5",
        "  f.json:0  bending  yeoh  10.0 [9.00, >]*  20.0 [18.0, >]",
    ]


# A law fitted to ring-downs alone


def test_the_parameter_of_a_ring_down_has_the_scale_of_its_law(monkeypatch: pytest.MonkeyPatch) -> None:
    dynamic = Quantity(60e3, "Pa", (58e3, 63e3))
    time = SimpleNamespace(dynamic_shear_modulus=dynamic)
    asked: list[Any] = []
    monkeypatch.setattr(time_fits, "_identified", lambda *given: asked.append(given) or time)
    monkeypatch.setattr(time_fits, "RingDownRecord", lambda **given: SimpleNamespace(**given))
    monkeypatch.setattr(time_fits, "MotionReference", lambda **given: SimpleNamespace(**given))
    monkeypatch.setattr(time_fits, "stable_up_to", lambda law, values: 2.5 + values[0] / 60e3)
    specimen = SimpleNamespace(section="solid")

    def one(name: str, *exact: str) -> Any:
        path, stated = Path(name), (StatedSource("width", 0.01, name),)
        return SimpleNamespace(
            path=path, sha256=name[0], specimen=specimen, motions=("m", "n"), stated=stated, taken_as_exact=exact
        )

    motions = [one("a.h5", "moment", "depth"), one("b.h5", "depth", "coil")]
    fit: Any = time_fits.fit_motions("neo-hookean", motions, 4)
    assert asked[0][0] == "neo-hookean"
    assert asked[0][1].tolist() == [1.0]
    assert asked[0][2:] == (motions, None, 4)
    assert fit.parameters == {"mu": dynamic}
    assert (fit.initial_shear_modulus, fit.max_stretch, fit.doubts, fit.time, fit.seed) == (dynamic, 1.0, (), time, 4)
    assert (fit.stability.criterion, fit.stability.stable_up_to_stretch) == ("Drucker", 3.5)
    assert fit.taken_as_exact == ("moment", "depth", "coil")
    assert [(d.path, d.sha256, d.section, d.motions) for d in fit.datasets] == [
        ("a.h5", "a", "solid", 2),
        ("b.h5", "b", "solid", 2),
    ]
    with pytest.raises(InputError, match=r"^a\.h5, b\.h5: --model yeoh: a ring-down determines only one parameter; us"):
        time_fits.fit_motions("yeoh", motions, 4)


def test_an_uncertainty_that_no_beam_can_have_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise ImpossibleShape("the centre line has a radius of 3.5 mm")

    monkeypatch.setattr(time_fits, "identify_time", refuse)
    motions: Any = [SimpleNamespace(path=Path("a.h5"), specimen=None, motions=(), stated=())]
    with pytest.raises(InputError, match=r"^a\.h5: --time prony: an uncertainty .* radius of 3\.5 mm.*rest_shape_mm"):
        time_fits._identified("yeoh", np.ones(3), motions, None, 1)


def test_a_law_of_time_follows_from_the_datasets_of_its_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time_fits, "_identified", lambda *given: given)
    monkeypatch.setattr(time_fits, "static_states", lambda evidence, record: evidence)
    monkeypatch.setattr(time_fits, "replace", lambda record, time: time)
    evidence: Any = [SimpleNamespace(path=Path(name), sha256=name) for name in "ab"]
    motions: Any = [SimpleNamespace(path=Path(name), has_states=name != "c") for name in "abc"]
    record: Any = SimpleNamespace(datasets=evidence[1:], seed=9, model="yeoh", values=lambda: [1.0, 2.0, 3.0])
    found: Any = time_fits.with_law_of_time(record, evidence, motions)
    assert (found[0], found[1].tolist(), *found[2:]) == ("yeoh", [1.0, 2.0, 3.0], motions[1:], evidence[1:], 9)


# Curves, remarks and faults of files


def test_a_tensile_curve_is_recorded_with_its_file_or_the_hash_of_its_numbers() -> None:
    strain, stress_Pa = np.array([0.1, 0.3, 0.2]), np.array([5e3, 9e3, 7e3])
    given: dict[str, Any] = {"correlation_rows": 2.5, "noise_Pa": 120.0}
    plain: Any = SimpleNamespace(strain=strain, stress_Pa=stress_Pa, weight=0.5)
    loose: Any = SimpleNamespace(curve=plain, **given)
    numbers = np.stack([strain, stress_Pa]).astype("<f8").tobytes()
    record = CurveRecord.of(loose, 150.0)
    assert record == CurveRecord(
        path=None,
        sha256=hashlib.sha256(numbers).hexdigest(),
        window_percent=None,
        weight=0.5,
        rows=3,
        correlation_rows=2.5,
        largest_strain=0.3,
        rmse_alone_Pa=120.0,
        rmse_Pa=150.0,
    )
    assert record.name == f"tensile curve {record.sha256[:8]} (from no file)"
    of_file: Any = SimpleNamespace(curve=FileCurve(strain, stress_Pa, 2.0, "pull.csv", "12ab", 50.0), **given)
    stored = CurveRecord.of(of_file, 150.0)
    assert (stored.path, stored.sha256, stored.window_percent, stored.weight) == ("pull.csv", "12ab", 50.0, 2.0)
    assert stored.name == "pull.csv"


def test_the_largest_stretch_of_a_fit_includes_its_tensile_curves() -> None:
    fit = next(fit for fit in fits_file.read_fits_file(RELEASE / "fits.json").fits if isinstance(fit, FitRecord))
    given: dict[str, Any] = {"correlation_rows": 2.5, "noise_Pa": 120.0}
    pressed: Any = SimpleNamespace(strain=np.array([-0.02, -0.5]), stress_Pa=np.array([-1e3, -9e4]), weight=1.0)
    curve = CurveRecord.of(SimpleNamespace(curve=pressed, **given), 150.0)  # type: ignore[arg-type]
    assert (curve.largest_strain, curve.max_stretch) == (-0.5, pytest.approx(2**0.5))
    assert curve.model_copy(update={"largest_strain": 0.8}).max_stretch == 1.8
    joint = replace(fit, max_stretch=1.1, tensile=(curve,))
    assert (replace(joint, tensile=()).stretch_reached, joint.stretch_reached) == (1.1, curve.max_stretch)
    assert joint.stretch_in_words().startswith("Largest stretch in the data 1.414; ")
    assert simulated_fit._is_within(1.41, joint)
    assert not simulated_fit._is_within(1.42, joint)


def test_the_remarks_on_datasets_come_one_dataset_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    for name in ("section", "rest_shape", "compressibility", "measured_field", "temperature", "heating"):
        say = None if name == "compressibility" else name
        monkeypatch.setattr(fit_summary, f"{name}_remark", lambda one, say=say: say and f"{say} of {one}")
    monkeypatch.setattr(fit_summary.DatasetReference, "of", lambda one: f"reference of {one}")
    monkeypatch.setattr(fit_summary, "measured_differences", lambda references: said.extend(references) or ["differ"])
    names = ("section", "rest_shape", "measured_field", "temperature", "heating")
    assert fit_summary.evidence_remarks(["a", "b"]) == [  # type: ignore[list-item]
        *(f"{name} of a" for name in names),
        *(f"{name} of b" for name in names),
        "differ",
    ]
    assert said == ["reference of a", "reference of b"]


@pytest.mark.parametrize(
    ("loc", "words"),
    [
        (("fits", 0, "bending", "model"), "fits.0.model: wrong"),
        (("fits", 1, "tensile", "parameters", "C10"), "fits.1.parameters.C10: wrong"),
        (("fits",), "fits: wrong"),
        (("comparison", 0, "bending"), "comparison.0.bending: wrong"),
        (("runs", "function-wrap(x)", "at"), "runs.at: wrong"),
        ((), "wrong"),
    ],
)
def test_the_first_fault_of_a_file_names_its_key_without_the_kind_of_fit(loc: tuple[Any, ...], words: str) -> None:
    error: Any = SimpleNamespace(errors=lambda: [{"loc": loc, "msg": "wrong"}, {"loc": ("other",), "msg": "no"}])
    assert fits_file.first_fault(error) == words


def test_the_data_of_a_fit_are_read_without_flagged_states_unless_asked(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    opened: list[Path] = []
    segmented: list[Any] = []
    edges: list[Any] = [None]

    class Opened:
        kind = "frames"

        def __enter__(self) -> Any:
            return self

        def __exit__(self, *given: object) -> None:
            pass

        def edges(self) -> Any:
            return edges[0]

    def segment(path: Path, report: Any) -> None:
        segmented.append((path, report))
        edges[0] = ()

    monkeypatch.setattr(evidence, "open_dataset", lambda path: opened.append(path) or Opened())
    monkeypatch.setattr(evidence, "_evidence", lambda data, *given: given)
    monkeypatch.setattr("eimi_lab.dataset.segmentation.segment", segment)
    path = tmp_path / "a.h5"
    report: Any = "report"
    assert evidence.load_evidence(str(path), report=report) == (path, None, False)  # type: ignore[comparison-overlap]
    assert segmented == [(path, "report")]
    assert opened == [path, path]
    assert evidence.load_evidence(path, section="solid", flagged=True) == (path, "solid", True)  # type: ignore[comparison-overlap]
    assert len(segmented) == 1
    Opened.kind, edges[0] = "points", None
    evidence.load_evidence(path)
    assert len(segmented) == 1
    with pytest.raises(InputError, match="is not UTF-8 and cannot be written to a result file; rename the dataset"):
        evidence.load_evidence("a\udcff.h5")
