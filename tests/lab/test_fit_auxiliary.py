"""`eimi fit` with more than datasets, and with edges that are wrong, through real dataset files."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel
from eimi_fitting.materials import LAWS
from eimi_fitting.specimen import Specimen
from eimi_fitting.tensile import engineering_stress
from eimi_lab.identification.fit_summary import remarks
from eimi_lab.identification.fits import read_any_fits

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


def write_points(folder: Path, change=lambda places: places) -> None:
    """states.csv and points.csv of a strip of 46 kPa that hangs sideways under tip forces, the places changed."""
    model = BeamModel(Specimen(30.0, 3.0, 10.0, 1070.0, "plane-strain")).refined()
    forces = [0.0, 0.001, 0.002]
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along([0.0] * 3, 90.0, 90.0, forces))
    rest = np.column_stack([np.linspace(5, 29, 9), np.zeros(9)])
    places = change(model.positions(shapes, rest)[0] + np.random.default_rng(0).normal(0, 0.005, (3, 9, 2)))
    rows = [
        f"{k},p{i},{rest[i, 0]},{rest[i, 1]},{x:.6f},{y:.6f},0.005"
        for k, state in enumerate(places)
        for i, (x, y) in enumerate(state)
    ]
    (folder / "points.csv").write_text("\n".join(["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm", *rows]) + "\n")
    states = [f"{k},0.0,{force}" for k, force in enumerate(forces)]
    (folder / "states.csv").write_text("\n".join(["state,field_mT,tip_force_N", *states]) + "\n")
    (folder / "strip.toml").write_text(SPECIMEN)


def import_points(folder: Path, run, name: str = "strip.h5", **options) -> None:
    """The dataset of write_points."""
    write_points(folder, **options)
    tables = ("--states", folder / "states.csv", "--specimen", folder / "strip.toml", "--gravity-angle", "90")
    status, told = run("import", folder / "points.csv", *tables, "-o", folder / name)
    assert status == 0, told


def test_a_tensile_curve_and_a_free_roll_stand_in_fits_json(tmp_path: Path, run) -> None:
    import_points(tmp_path, run)
    strain = np.linspace(0.02, 0.8, 40)
    stress = engineering_stress(LAWS["mooney-rivlin"], np.array([[16e3, 7e3]]), strain)[0]
    noisy = stress + np.random.default_rng(1).normal(0, 150, 40)
    rows = [f"{e},{s}" for e, s in zip(strain, noisy, strict=True)]
    (tmp_path / "curve.csv").write_text("\n".join(["strain,stress_Pa", *rows]) + "\n")
    beside = ("--tensile", tmp_path / "curve.csv", "--tensile-weight", "0.5", "--free", "roll=0.1")
    models = ("--model", "neo-hookean", "--model", "mooney-rivlin")
    status, told = run("fit", tmp_path / "strip.h5", *models, *beside, "-o", tmp_path / "fits.json")
    assert status == 0, told
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
    # The curve knows that neo-hookean is not the law.
    chosen = {choice["model"]: choice for choice in content["comparison"]}
    assert chosen["mooney-rivlin"]["aicc"] == 0.0
    assert chosen["neo-hookean"]["aicc"] > 10
    assert chosen["mooney-rivlin"]["weight"] > 0.99


def curve_of_46_kPa(unit: str) -> str:
    """A tensile curve of the strip's material, its stress in kPa whatever the header says."""
    rows = [f"{e},{46 * (1 + e - (1 + e) ** -2) + 0.3 * (-1) ** k}" for k, e in enumerate(np.linspace(0.01, 0.5, 40))]
    return "\n".join([f"strain,stress_{unit}", *rows]) + "\n"


def test_a_curve_that_contradicts_the_edges_is_doubted(tmp_path: Path, run) -> None:
    import_points(tmp_path, run)
    for unit, doubted in (("kPa", False), ("MPa", True)):
        (tmp_path / "curve.csv").write_text(curve_of_46_kPa(unit))
        tensile = ("--tensile", tmp_path / "curve.csv", "-o", tmp_path / f"{unit}.json")
        status, told = run("fit", tmp_path / "strip.h5", "--model", "neo-hookean", *tensile)
        assert status == 0, told
        (fit,) = read_any_fits(tmp_path / f"{unit}.json")
        assert any("curve.csv and the edges contradict each other" in line for line in remarks(fit)) == doubted
    validated = ("--fit", tmp_path / "kPa.json", "-o", tmp_path / "validation.json")
    assert run("validate", tmp_path / "strip.h5", *validated)[0] == 0
    (validation,) = json.loads((tmp_path / "validation.json").read_text())["validations"]
    assert validation["fit"]["kind"] == "bending and tensile"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--free", "moment"), "--free moment: should be a standard deviation such as moment=0.02"),
        (("--free", "scale=0.1"), "--free scale=0.1: should be a standard deviation such as moment=0.02"),
        (("--free", "roll=-1"), "--free roll=-1: should be roll=NUMBER above 0, at most 45 (degrees)"),
        (("--free", "moment=2"), "--free moment=2: should be moment=NUMBER above 0, at most 0.5 (relative)"),
        (("--free", "roll=0.1", "--free", "roll=0.2"), "--free roll=0.2: roll is given twice"),
        (("--free", "moment=0.02"), "--free moment: strip.h5 has no state with a field"),
        (("--free", "bulk", "--section", "plane-stress"), "--free bulk: strip.h5 is taken as plane-stress"),
        (("--tensile", "none.csv"), "none.csv"),
        (("--tensile", "short.csv"), "short.csv: 2 rows in the window; a fit needs at least 5"),
        (
            ("--tensile", "short.csv", "--tensile-window", "wide"),
            "--tensile-window wide: should be a strain in percent",
        ),
        (("--tensile", "short.csv", "--tensile-weight", "0"), "--tensile-weight 0: should be a number above 0"),
        (("--tensile-window", "20"), "--tensile-window 20: of which curve? give --tensile too"),
        (("--tensile", "long.csv", "--tensile", "again.csv"), "again.csv: holds the same as long.csv"),
        (("again.h5",), "again.h5: holds the same as strip.h5"),
        (("./strip.h5", "--each"), "strip.h5: is given twice"),
        (("--checkpoint", "fits.json"), "fits.json: cannot be written, it is in use as another file"),
        (("--checkpoint", "strip.h5", "--force"), "strip.h5: cannot be written, it is in use as another file"),
        (
            ("--tensile", "wrong_unit.csv", "--tensile-weight", "1e6"),
            "no material explains this and the tensile curves",
        ),
    ],
)
def test_what_cannot_be_freed_or_followed_is_one_line(
    tmp_path: Path, run, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], told: str
) -> None:
    import_points(tmp_path, run)
    (tmp_path / "short.csv").write_text("strain,stress_kPa\n0.1,5\n0.2,9\n0.9,30\n")
    for name, unit in (("long.csv", "kPa"), ("again.csv", "kPa"), ("wrong_unit.csv", "MPa")):
        (tmp_path / name).write_text(curve_of_46_kPa(unit))
    shutil.copy(tmp_path / "strip.h5", tmp_path / "again.h5")
    monkeypatch.chdir(tmp_path)
    status, said = run("fit", "strip.h5", "--model", "neo-hookean", *arguments, "-o", "fits.json")
    assert status == 2
    assert told in said.splitlines()[-1]
    assert not (tmp_path / "fits.json").exists()
    assert (tmp_path / "strip.h5").read_bytes() == (tmp_path / "again.h5").read_bytes()


def garbled_state(places):
    """The last state's points where the first ones were."""
    return np.concatenate([places[:2], places[:1]])


@pytest.mark.parametrize(
    ("change", "state"),
    [
        (garbled_state, "state 2"),
        (lambda places: places * [1, -1], "state"),
        (lambda places: 1.5 * places, "state"),
        (lambda places: places + np.random.default_rng(0).normal(0, 4, places.shape), "state"),
    ],
    ids=["one state", "mirrored", "scale", "noise"],
)
def test_a_fit_on_garbage_says_so_instead_of_returning_a_number(tmp_path: Path, run, change, state: str) -> None:
    import_points(tmp_path, run, change=change)
    status, said = run("fit", tmp_path / "strip.h5", "--model", "neo-hookean", "-o", tmp_path / "fits.json")
    assert status == 2
    line = said.splitlines()[-1]
    assert f"strip.h5: {state}" in line
    assert "no material explains this" in line
    assert not (tmp_path / "fits.json").exists()


def test_a_doubt_stands_in_the_result(tmp_path: Path, run) -> None:
    import_points(tmp_path, run, change=lambda places: 1.005 * places)
    status, told = run("fit", tmp_path / "strip.h5", "--model", "neo-hookean", "-o", tmp_path / "fits.json")
    assert status == 0, told
    (fit,) = json.loads((tmp_path / "fits.json").read_text())["fits"]
    (doubt,) = fit["doubts"]
    assert (doubt["dataset"], doubt["state"]) == (0, None)
    assert "times the uncertainty that the measured places state" in doubt["words"]
    assert json.loads((tmp_path / "fits.json").read_text())["comparison"] == []
