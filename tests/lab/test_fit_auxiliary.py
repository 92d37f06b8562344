"""`eimi fit` uses tensile curves and freed inputs (uncertain values that it estimates), and refuses wrong data."""

from __future__ import annotations

import json
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.planning.choice_of_law import Candidate, choose
from eimi_fitting.laws import LAWS, SOLVERS
from eimi_fitting.laws.tensile import engineering_stress
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.fits.fit_summary import comparison_table, remarks
from eimi_lab.fits.fits_file import Fits, read_fits_file
from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.page import write_report

SPECIMEN = """
[specimen]
name = "strip"
material = "silicone"
length_mm = 30.0
width_mm = 3.0
depth_mm = 10.0
density_kg_m3 = 1070.0
section = "plane-strain"
"""


FORCES_N = (0.0, 0.001, 0.002)
REST_MM = np.column_stack([np.linspace(5, 29, 9), np.zeros(9)])


@cache
def bent_places() -> np.ndarray:
    # Return nine noisy points on a silicone beam under three tip forces, x and y in mm, shape (3, 9, 2).
    model = BeamModel(Specimen(30.0, 3.0, 10.0, 1070.0, "plane-strain")).refined()
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along([0.0] * 3, 90.0, 90.0, FORCES_N))
    return model.positions(shapes, REST_MM)[0] + np.random.default_rng(0).normal(0, 0.005, (3, 9, 2))


def write_points(folder: Path, change=lambda places: places) -> None:
    # Write states.csv, points.csv and strip.toml of a silicone strip under three tip forces.
    # change: function that alters the points, shape (3, 9, 2) in mm.
    places = change(bent_places().copy())
    rows = [
        f"{k},p{i},{REST_MM[i, 0]},{REST_MM[i, 1]},{x:.6f},{y:.6f},0.005"
        for k, state in enumerate(places)
        for i, (x, y) in enumerate(state)
    ]
    (folder / "points.csv").write_text("\n".join(["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm", *rows]) + "\n")
    states = [f"{k},0.0,{force}" for k, force in enumerate(FORCES_N)]
    (folder / "states.csv").write_text("\n".join(["state,field_mT,tip_force_N", *states]) + "\n")
    (folder / "strip.toml").write_text(SPECIMEN)


def import_points(folder: Path, run, name: str = "strip.h5", **options) -> None:
    # Import a silicone strip under three forces as the dataset `name`.
    write_points(folder, **options)
    tables = ("--states", folder / "states.csv", "--specimen", folder / "strip.toml", "--gravity-angle", "90")
    status, message = run("import", folder / "points.csv", *tables, "-o", folder / name)
    assert status == 0, message


def test_fits_json_contains_a_tensile_curve_and_a_freed_roll_angle(tmp_path: Path, run) -> None:
    import_points(tmp_path, run)
    strain = np.linspace(0.02, 0.8, 40)
    stress = engineering_stress(LAWS["mooney-rivlin"], np.array([[16e3, 7e3]]), strain)[0]
    noisy = stress + np.random.default_rng(1).normal(0, 150, 40)
    rows = [f"{e},{s}" for e, s in zip(strain, noisy, strict=True)]
    (tmp_path / "curve.csv").write_text("\n".join(["strain,stress_Pa", *rows]) + "\n")
    beside = ("--tensile", tmp_path / "curve.csv", "--tensile-weight", "0.5", "--free", "roll=0.1")
    models = ("--model", "neo-hookean", "--model", "mooney-rivlin")
    status, message = run("fit", tmp_path / "strip.h5", *models, *beside, "-o", tmp_path / "fits.json")
    assert status == 0, message
    content = json.loads((tmp_path / "fits.json").read_text())
    plain, law = content["fits"]
    for fit in (plain, law):
        (curve,) = fit["tensile"]
        assert (curve["weight"], curve["window_percent"], curve["rows"]) == (0.5, 50.0, np.sum(strain <= 0.5))
        assert len(curve["sha256"]) == 64
        (roll,) = fit["freed"]
        assert (roll["name"], roll["deviation"]["unit"], roll["prior_standard_deviation"]) == ("roll", "deg", 0.1)
        low, high = roll["deviation"]["interval_95"]
        assert low < 0 < high
        assert high - low < 4 * 0.1
        names = fit["identifiability"]["names"]
        assert np.array(fit["identifiability"]["correlation"]).shape == (len(names), len(names))
        assert np.diag(fit["identifiability"]["correlation"]) == pytest.approx(1.0)
    low, high = law["parameters"]["C01"]["interval_95"]
    assert low < 7e3 < high
    assert law["identifiability"]["not_fixed"] == []
    # The curve shows that the law is not Neo-Hookean.
    chosen = {choice["model"]: choice for choice in content["comparison"]}
    assert chosen["mooney-rivlin"]["aicc"] == 0.0
    assert chosen["neo-hookean"]["aicc"] > 10
    assert chosen["mooney-rivlin"]["weight"] > 0.99


def curve_of_46_kPa(unit: str) -> str:
    # Return a tensile curve of a material of 46 kPa as CSV text, with `unit` in the header.
    rows = [f"{e},{46 * (1 + e - (1 + e) ** -2) + 0.3 * (-1) ** k}" for k, e in enumerate(np.linspace(0.01, 0.5, 40))]
    return "\n".join([f"strain,stress_{unit}", *rows]) + "\n"


def test_a_curve_that_contradicts_the_edges_raises_a_doubt(tmp_path: Path, run) -> None:
    import_points(tmp_path, run)
    for unit, doubted in (("kPa", False), ("MPa", True)):
        (tmp_path / "curve.csv").write_text(curve_of_46_kPa(unit))
        tensile = ("--tensile", tmp_path / "curve.csv", "-o", tmp_path / f"{unit}.json")
        status, message = run("fit", tmp_path / "strip.h5", "--model", "neo-hookean", *tensile)
        assert status == 0, message
        (fit,) = read_fits_file(tmp_path / f"{unit}.json").fits
        messages = [line for line in remarks(fit) if "contradict each other" in line]
        assert [str(tmp_path / "curve.csv") in line for line in messages] == [True] * doubted
        (written,) = json.loads((tmp_path / f"{unit}.json").read_text())["fits"]
        assert [doubt["curve"] for doubt in written["doubts"] if "contradict" in doubt["words"]] == [0] * doubted
    validated = ("--fit", tmp_path / "kPa.json", "-o", tmp_path / "validation.json")
    assert run("validate", tmp_path / "strip.h5", *validated)[0] == 0
    (validation,) = json.loads((tmp_path / "validation.json").read_text())["validations"]
    assert validation["fit"]["kind"] == "bending and tensile"


def test_a_curve_from_a_notebook_is_recorded_and_used_in_the_fit(tmp_path: Path, run) -> None:
    import_points(tmp_path, run)
    evidence = load_evidence(tmp_path / "strip.h5")
    strain = np.linspace(0.02, 0.5, 30)
    stress = engineering_stress(LAWS["mooney-rivlin"], np.array([[16e3, 7e3]]), strain)[0]
    curve = TensileCurve(strain, stress + np.random.default_rng(1).normal(0, 150, 30))
    evidences = [evidence.experiment]
    fits = [
        FitRecord.of(identify(model, evidences, tensile=[curve]), [evidence])
        for model in ("neo-hookean", "mooney-rivlin")
    ]
    content = Fits.of(fits)
    content.write(tmp_path / "fits.json")
    for fit in read_fits_file(tmp_path / "fits.json").fits:
        (own,) = fit.tensile
        assert (own.path, own.rows, own.largest_strain, own.weight) == (None, 30, 0.5, 1.0)
        assert any("(from no file): RMSE" in line for line in remarks(fit))
    # The edges alone cannot discriminate between the two laws.
    plain, law = content.comparison
    assert (law.model, law.aicc) == ("mooney-rivlin", 0.0)
    assert plain.aicc > 10
    shorter = TensileCurve(strain[:-1], curve.stress_Pa[:-1])
    other = FitRecord.of(identify("neo-hookean", evidences, tensile=[shorter]), [evidence])
    assert Fits.of([other, fits[1]]).comparison == ()  # fitted with another curve: the fits have no common data
    write_report(tmp_path / "report.html", [tmp_path / "strip.h5"], [tmp_path / "fits.json"])
    assert "(from no file)" in (tmp_path / "report.html").read_text()


def test_a_law_with_too_few_data_has_no_weight_in_the_table() -> None:
    laws = choose([Candidate("ogden", 6, ((8.0, 0.02),), 0.02), Candidate("neo-hookean", 1, ((8.0, 0.02),))])
    _, few, alone, points, sentence = comparison_table(laws)
    assert few.split()[2:] == ["too", "few", few.split()[4], "-", "20.00", "µm"]
    assert alone.split()[4:] == ["-", "-"]
    assert "count the data as 8.0 independent points" in points
    assert sentence.startswith("These points are too few for an AICc of ogden.")
    assert sentence.endswith("there are no weights.")


def test_an_undetermined_parameter_is_marked_wherever_it_is_shown(tmp_path: Path, run) -> None:
    # These places are stderr, the notebook's table, pandas and the report.
    import_points(tmp_path, run, change=lambda places: 1.005 * places)
    fits = tmp_path / "fits.json"
    assert run("fit", tmp_path / "strip.h5", "--model", "mooney-rivlin", "-o", fits)[0] == 0
    (fit,) = read_fits_file(fits).fits
    assert fit.identifiability.held_by_bounds == fit.held_by_bounds() == ("C10", "C01")
    low, high = fit.parameters["C10"].interval_95
    for solver in SOLVERS:
        card = tmp_path / f"{solver}.txt"
        given = ("--model", "mooney-rivlin", "--to", solver, "--bulk-ratio", "2000")
        status, message = run("export", fits, *given, "-o", card)
        assert status == 0
        for text in (card.read_text(), message):
            assert "not measured" in text
            assert "C10, C01" in text
            assert "times the given uncertainty of the measured places" in text
            assert f"Largest stretch in the data {fit.max_stretch:.3f}" in text
            assert fit.modulus_in_words() in text
        assert f"C10 95 % interval {low:.6g} to {high:.6g} Pa, not measured" in card.read_text()
    assert fit._repr_html_().count("<td>not measured</td>") == 2
    assert "Doubt: " in fit._repr_html_()
    pytest.importorskip("pandas")
    assert fit.to_pandas().held_by_bounds.tolist() == [True, True, False]
    write_report(tmp_path / "report.html", [tmp_path / "strip.h5"], [fits])
    assert (tmp_path / "report.html").read_text().count('<span class="held">not measured</span>') == 2


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            ("--free", "moment"),
            "--free moment: should be an input with its standard deviation, such as moment=0.02",
        ),
        (
            ("--free", "section=0.1"),
            "--free section=0.1: should be an input with its standard deviation, such as moment=0.02",
        ),
        (("--free", "roll=-1"), "--free roll=-1: should be roll=NUMBER above 0, at most 45 (degrees)"),
        (("--free", "moment=2"), "--free moment=2: should be moment=NUMBER above 0, at most 0.5 (relative)"),
        (("--free", "roll=0.1", "--free", "roll=0.2"), "--free roll=0.2: roll is given twice"),
        (("--free", "moment=0.02"), "--free moment: strip.h5 has no state with a field"),
        (("--free", "tilt=1"), "--free tilt: strip.h5 has no edges with a known distance of the lens (stand_off_mm)"),
        (("--free", "bulk", "--section", "plane-stress"), "--free bulk: strip.h5 is modelled as plane-stress"),
        (("--tensile", "none.csv"), "none.csv"),
        (("--tensile", "short.csv"), "short.csv: 2 rows up to the largest strain to fit; a fit needs at least 5"),
        (
            ("--tensile", "short.csv", "--tensile-window", "wide"),
            "--tensile-window wide: should be a strain in percent",
        ),
        (("--tensile", "short.csv", "--tensile-weight", "0"), "--tensile-weight 0: should be a number above 0"),
        (("--tensile-window", "20"), "--tensile-window 20: needs a tensile curve; give --tensile, too"),
        (("--tensile", "long.csv", "--tensile", "again.csv"), "again.csv: has the same content as long.csv"),
        (("again.h5",), "again.h5: has the same content as strip.h5"),
        (("./strip.h5", "--each"), "strip.h5: is given twice"),
        (
            ("--checkpoint", "fits.json"),
            "fits.json: cannot be written, because the same command already reads or writes this file",
        ),
        (
            ("--checkpoint", "strip.h5", "--force"),
            "strip.h5: cannot be written, because the same command already reads or writes this file",
        ),
        (
            ("--tensile", "wrong_unit.csv", "--tensile-weight", "1e6"),
            "no material explains the measured shape of the beam and the tensile curves",
        ),
    ],
)
def test_wrong_nuisances_and_curves_are_refused_in_one_line(
    tmp_path: Path, run, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], expected: str
) -> None:
    import_points(tmp_path, run)
    (tmp_path / "short.csv").write_text("strain,stress_kPa\n0.1,5\n0.2,9\n0.9,30\n")
    for name, unit in (("long.csv", "kPa"), ("again.csv", "kPa"), ("wrong_unit.csv", "MPa")):
        (tmp_path / name).write_text(curve_of_46_kPa(unit))
    shutil.copy(tmp_path / "strip.h5", tmp_path / "again.h5")
    monkeypatch.chdir(tmp_path)
    status, message = run("fit", "strip.h5", "--model", "neo-hookean", *arguments, "-o", "fits.json")
    assert status == 2
    assert expected in message.splitlines()[-1]
    assert not (tmp_path / "fits.json").exists()
    assert (tmp_path / "strip.h5").read_bytes() == (tmp_path / "again.h5").read_bytes()


def garbled_state(places):
    # Return points, shape (3, n, 2), in which the last state is a copy of the first state.
    return np.concatenate([places[:2], places[:1]])


@pytest.mark.parametrize(
    ("change", "state"),
    [
        (garbled_state, "state 2"),
        (
            lambda places: places * [1, -1],
            "no material explains the measured shape of the beam: with the values in the files",
        ),
        (lambda places: 1.5 * places, "state"),
        (lambda places: places + np.random.default_rng(0).normal(0, 4, places.shape), "state"),
    ],
    ids=["one state", "mirrored", "scale", "noise"],
)
def test_a_fit_to_wrong_data_is_refused(tmp_path: Path, run, change, state: str) -> None:
    import_points(tmp_path, run, change=change)
    status, message = run("fit", tmp_path / "strip.h5", "--model", "neo-hookean", "-o", tmp_path / "fits.json")
    assert status == 2
    line = message.splitlines()[-1]
    assert f"strip.h5: {state}" in line
    assert "no material explains the measured shape of the beam" in line
    assert not (tmp_path / "fits.json").exists()


def test_a_doubt_is_written_into_the_result(tmp_path: Path, run) -> None:
    import_points(tmp_path, run, change=lambda places: 1.005 * places)
    status, message = run("fit", tmp_path / "strip.h5", "--model", "neo-hookean", "-o", tmp_path / "fits.json")
    assert status == 0, message
    (fit,) = json.loads((tmp_path / "fits.json").read_text())["fits"]
    for doubt in fit["doubts"]:
        assert (doubt["dataset"], doubt["state"]) == (0, None)
    far, scale = (doubt["words"] for doubt in fit["doubts"])
    assert "times the given uncertainty of the measured places" in far
    assert "scale of the picture (+0.4" in scale
    assert json.loads((tmp_path / "fits.json").read_text())["comparison"] == []
