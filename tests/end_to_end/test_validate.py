"""`eimi validate` computes the errors of fits on datasets."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from eimi_fitting.inference.evidence import corrections
from eimi_fitting.inference.evidence.corrections import correction
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.fits.prediction import validate

Eimi = Callable[..., tuple[int, str, str]]
Done = Callable[..., list[str]]


def test_errors_on_unseen_states_rank_bending_and_tensile_fits(done: Done, folder: Path) -> None:
    fits = ("--fit", "tensile.json", "--fit", "fits.json")
    lines = done("validate", "train.h5", "unseen.h5", *fits, "-o", "validation.json", folder=folder)
    validations = json.loads((folder / "validation.json").read_text())["validations"]
    assert [(v["dataset"], v["fit"]["path"], v["fit"]["index"], v["seen"]) for v in validations] == [
        ("train.h5", "tensile.json", 0, False),
        ("train.h5", "tensile.json", 1, False),
        ("train.h5", "fits.json", 0, True),
        ("unseen.h5", "tensile.json", 0, False),
        ("unseen.h5", "tensile.json", 1, False),
        ("unseen.h5", "fits.json", 0, False),
    ]
    for v in validations:
        assert [s["state"] for s in v["by_state"]] == [0, 1, 2]
        assert v["mean_error_mm"] == pytest.approx(np.mean([s["error_mm"] for s in v["by_state"]]))
        assert v["mean_deviation_mm"] == pytest.approx(np.mean([s["deviation_mm"] for s in v["by_state"]]))
        assert (v["status"], v["stable"], v["section"]) == ("ok", True, "plane-stress")
    # A fit of the true law to the same strip predicts the unseen states; a fit to a stiffer curve does not.
    assert validations[5]["mean_error_mm"] < 1e-3
    assert validations[3]["mean_error_mm"] > 0.1
    # The errors on the fitted states are those in the file of the fit.
    (fit,) = json.loads((folder / "fits.json").read_text())["fits"]
    # The tolerance is 0.02 µm: the correction by the finer mesh is the only difference.
    assert fit["mean_error_mm"] == pytest.approx(validations[2]["mean_error_mm"], rel=5e-3, abs=2e-5)
    # The last lines say what the planar section neglects. The table is ordered by dataset, then by error.
    assert [line.split()[0] for line in lines[-2:]] == ["train.h5:", "unseen.h5:"]
    lines = lines[:-2]
    assert [line.split()[0] for line in lines[:3]] == ["train.h5", "fit", "fits.json:0"]
    assert [line.split()[0] for line in lines[5:8]] == ["unseen.h5", "fit", "fits.json:0"]
    assert lines[2].endswith("  seen")
    assert "unseen" in lines[7]
    # The interval of the error is that of the draws: stiffer and softer strips have larger errors than the true one.
    for v in validations:
        low, high = v["mean_error_interval_mm"]
        assert low <= v["mean_error_mm"] <= high
    low, high = validations[5]["mean_error_interval_mm"]
    assert low < 0.01
    assert high > 2 * low
    # Fits against specimens: the fitted specimen is marked.
    matrix = [line.split() for line in lines[lines.index(next(x for x in lines if x.startswith("mean error"))) + 1 :]]
    assert matrix[0] == ["fit", "law", "train.h5", "unseen.h5"]
    assert [row[0] for row in matrix[1:]] == ["tensile.json:0", "tensile.json:1", "fits.json:0"]
    assert [row[1] for row in matrix[1:]] == ["tensile", "tensile", "bending"]
    assert ["*" in " ".join(row) for row in matrix[1:]] == [False, False, True]


def test_the_interval_of_the_error_is_that_of_the_draws(done: Done, folder: Path) -> None:
    content = json.loads((folder / "fits.json").read_text())
    (fit,) = content["fits"]
    assert fit["draws"]["names"][0] == "mu"
    assert np.quantile(fit["draws"]["values"], [0.025, 0.975]) == pytest.approx(fit["parameters"]["mu"]["interval_95"])
    # Both the value and the draws differ from the measurement, so that a distance left out or counted twice is noticed.
    fit["draws"]["values"] = [[60e3]] * 40
    fit["parameters"]["mu"]["value"] = fit["initial_shear_modulus"]["value"] = 52e3
    (folder / "wide.json").write_text(json.dumps(content))
    fit["parameters"]["mu"]["value"] = fit["initial_shear_modulus"]["value"] = 60e3
    fit["draws"] = None  # the format of an earlier release
    (folder / "at_end.json").write_text(json.dumps(content))
    fits = ("--fit", "wide.json", "--fit", "at_end.json")
    done("validate", "unseen.h5", *fits, "-o", "ends.json", folder=folder)
    wide, at_end = json.loads((folder / "ends.json").read_text())["validations"]
    # (Draws use the coarse mesh with the correction at the value, which differs slightly at the ends of the interval.)
    assert wide["mean_error_interval_mm"] == pytest.approx([wide["mean_error_mm"], at_end["mean_error_mm"]], rel=1e-2)
    assert at_end["mean_error_interval_mm"] is None


def test_the_option_by_state_prints_the_contents_of_the_file(done: Done, folder: Path) -> None:
    fits = ("--fit", "fits.json", "--fit", "tensile.json")
    lines = done("validate", "unseen.h5", *fits, "--by-state", "-o", "states.json", folder=folder)
    validations = json.loads((folder / "states.json").read_text())["validations"]
    first = lines.index("unseen.h5: error ± deviation by state, µm")
    for k, line in enumerate(lines[first + 2 : first + 5]):
        cells = line.split()
        assert cells[0] == str(k)
        states = [v["by_state"][k] for v in validations]
        printed = [float(f"{1e3 * s[key]:.2f}") for s in states for key in ("error_mm", "deviation_mm")]
        assert [float(c) for c in cells[2:] if c != "±"] == printed
    assert lines[first + 5].split()[0] == "mean"


def test_results_have_html_and_become_data_frames(folder: Path) -> None:
    pytest.importorskip("pandas")
    (fit,) = read_fits_file(folder / "fits.json").fits
    tensile = read_fits_file(folder / "tensile.json").fits[0]
    evidence = load_evidence(folder / "unseen.h5")
    validation = validate(evidence, fit, Path("fits <1>.json"), 0)
    for result in (fit, tensile, validation):
        shown = ElementTree.fromstring(f"<div>{result._repr_html_()}</div>")
        rows = [["".join(cell.itertext()) for cell in row] for row in shown.iter("tr")]
        assert len(rows) == 1 + len(result.to_pandas()), rows
    with open_dataset(folder / "unseen.h5") as dataset:
        for result in (dataset, evidence):
            assert len(list(ElementTree.fromstring(f"<div>{result._repr_html_()}</div>").iter("tr"))) == 4
        for result in (dataset, evidence, fit, tensile, validation):
            assert result.plot()._repr_png_().startswith(b"\x89PNG")
    frame = fit.to_pandas()
    assert frame.loc["mu", "value"] == fit.values()[0]
    assert tuple(frame.loc["initial_shear_modulus", ["low_95", "high_95"]]) == fit.initial_shear_modulus.interval_95
    assert validation.to_pandas()["error_mm"].mean() == pytest.approx(validation.mean_error_mm)
    assert list(validation.to_pandas().index) == [0, 1, 2]


def test_residuals_become_labelled_arrays(folder: Path) -> None:
    pytest.importorskip("xarray")
    dataset = open_dataset(folder / "unseen.h5")  # the cell of a notebook has no `with` statement
    labelled, points = dataset.to_xarray(), dataset.points()
    dataset.close()
    assert labelled.place.sel(state=2, point="p3", axis="y").item() == points[2].points_mm[3, 1]
    assert list(labelled.tip_force.values) == [0.0005, 0.0015, 0.003]
    assert labelled.place.attrs["units"] == "mm"


def test_a_missing_package_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("pandas", "xarray"):
        monkeypatch.setitem(sys.modules, package, None)
    (fit,) = read_fits_file(folder / "fits.json").fits
    with pytest.raises(
        ImportError, match="this function needs the package pandas, which is not installed: pip install pandas"
    ):
        fit.to_pandas()
    with open_dataset(folder / "unseen.h5") as dataset, pytest.raises(ImportError, match="pip install xarray"):
        dataset.to_xarray()


def test_a_law_without_an_equilibrium_does_not_stop_the_others(done: Done, folder: Path) -> None:
    content = json.loads((folder / "tensile.json").read_text())
    content["fits"][0]["parameters"]["mu"]["value"] = -60e3
    (folder / "negative.json").write_text(json.dumps(content))
    lines = done("validate", "unseen.h5", "--fit", "negative.json", "-o", "negative_v.json", folder=folder)
    first, second = json.loads((folder / "negative_v.json").read_text())["validations"]
    assert second["status"] == "ok"
    assert (first["status"], first["mean_error_mm"], first["by_state"]) == ("no equilibrium", None, [])
    assert [line.split()[0] for line in lines[-2:]] == ["negative.json:0", "unseen.h5:"]


def test_no_finer_model_is_solved_if_the_planar_one_has_no_equilibrium(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence, calls = load_evidence(folder / "unseen.h5"), list[float]()
    first, *_ = read_fits_file(folder / "tensile.json").fits

    def counted(*arguments: Any) -> Any:
        calls.append(1.0)
        return correction(*arguments)

    monkeypatch.setattr(corrections, "correction", counted)
    lost = replace(first, parameters={"mu": replace(first.parameters["mu"], value=-60e3)})
    assert validate(evidence, lost, Path("lost.json"), 0).status == "no equilibrium"
    assert not calls
    assert validate(evidence, first, Path("tensile.json"), 0).status == "ok"
    assert calls


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("train.h5", "--fit", "none.json", "-o", "v.json"), "none.json: cannot be read (No such file or directory)"),
        (("none.h5", "--fit", "fits.json", "-o", "v.json"), "none.h5: no such file"),
        (("train.h5", "--fit", "fits.json", "-o", "tensile.json"), "tensile.json: exists already"),
        (
            ("train.h5", "--fit", "fits.json", "-o", "fits.json", "--force"),
            "fits.json: cannot be written, because the same command already reads or writes this file",
        ),
        (("train.h5", "./train.h5", "--fit", "fits.json", "-o", "v.json"), "train.h5: is given twice"),
        (
            ("train.h5", "--fit", "earlier.json", "-o", "v.json"),
            "earlier.json: fits.0.mesh: Field required; expected a "
            "file that `eimi fit` or `eimi tensile` of this release wrote; if an older release wrote it, fit again",
        ),
        (("train.h5", "--fit", "empty.json", "-o", "v.json"), "empty.json: fits: Tuple should have at least 1 item"),
        (
            ("train.h5", "--fit", "fits.json", "--section", "plane-strain", "-o", "v.json"),
            "fits.json: fits.0 assumed plane-stress for train.h5, and not plane-strain; give --section plane-stress",
        ),
    ],
)
def test_wrong_input_to_validate_is_refused_in_one_line(
    eimi: Eimi, folder: Path, arguments: tuple[str, ...], expected: str
) -> None:
    content = json.loads((folder / "fits.json").read_text())
    del content["fits"][0]["mesh"]
    (folder / "earlier.json").write_text(json.dumps(content))
    (folder / "empty.json").write_text('{"fits": []}')
    status, _, message = eimi("validate", *arguments, folder=folder)
    assert (status, message.count("\n")) == (2, 1)
    assert expected in message
    assert not (folder / "v.json").exists()
