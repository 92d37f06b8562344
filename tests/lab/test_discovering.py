"""`eimi discover` finds the terms of a law and writes the law; a wrong option gives an error of one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import eimi_lab as eimi
from eimi_fitting import LAWS, BeamModel, Loads, Specimen
from eimi_fitting.laws import engineering_stress
from eimi_lab.process.errors import InputError

SPECIMEN = """[specimen]
name = "strip"
material = "silicone"
length_mm = 30.0
width_mm = 3.0
depth_mm = 10.0
density_kg_m3 = 1070.0
section = "plane-stress"
"""


@pytest.fixture
def strip(tmp_path: Path, run) -> Path:
    # A folder with strip.h5 (points on a silicone strip of 46 kPa) and curve.csv, a tensile test of this material.
    model = BeamModel(Specimen(30.0, 3.0, 10.0, 1070.0, "plane-stress")).refined()
    forces = [0.001, 0.002]
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along([0.0] * 2, 90.0, 90.0, forces))
    rest = np.column_stack([np.linspace(5, 29, 9), np.zeros(9)])
    rng = np.random.default_rng(0)
    places = model.positions(shapes, rest)[0] + rng.normal(0, 0.005, (2, 9, 2))
    rows = [f"{k},p{i},{rest[i, 0]},{rest[i, 1]},{x},{y},0.005" for k in range(2) for i, (x, y) in enumerate(places[k])]
    (tmp_path / "points.csv").write_text("\n".join(["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm", *rows]) + "\n")
    (tmp_path / "states.csv").write_text("state,field_mT,tip_force_N\n0,0,0.001\n1,0,0.002\n")
    (tmp_path / "strip.toml").write_text(SPECIMEN)
    tables = ("--states", tmp_path / "states.csv", "--specimen", tmp_path / "strip.toml", "--gravity-angle", "90")
    assert run("import", tmp_path / "points.csv", *tables, "-o", tmp_path / "strip.h5") == (0, "")
    strain = np.linspace(0.03, 3.0, 100)
    stress = engineering_stress(LAWS["neo-hookean"], np.array([46e3]), strain)
    noisy = stress + rng.normal(0, 2e-3 * stress.max(), 100)
    curve = [f"{e},{s}" for e, s in zip(strain, noisy, strict=True)]
    (tmp_path / "curve.csv").write_text("\n".join(["strain,stress_Pa", *curve]) + "\n")
    return tmp_path


def test_a_dataset_with_one_point_is_refused_by_its_name(strip: Path, run) -> None:
    rows = (strip / "points.csv").read_text().splitlines()
    (strip / "one.csv").write_text("\n".join([rows[0], rows[9]]) + "\n")
    (strip / "state.csv").write_text("state,field_mT,tip_force_N\n0,0,0.001\n")
    tables = ("--states", strip / "state.csv", "--specimen", strip / "strip.toml", "--gravity-angle", "90")
    assert run("import", strip / "one.csv", *tables, "-o", strip / "one.h5") == (0, "")
    words = "the data have 2 measured values; laws of up to 3 terms need at least 4"
    assert run("discover", strip / "one.h5", "-o", strip / "d.json") == (2, f"eimi: {strip / 'one.h5'}: {words}\n")


def test_no_data_are_refused() -> None:
    with pytest.raises(InputError, match=r"^discover: datasets is an empty list; give at least one dataset or one ten"):
        eimi.discover([])


def test_a_curve_with_a_wrong_sign_is_refused_in_one_line(strip: Path, run) -> None:
    (strip / "wrong.csv").write_text((strip / "curve.csv").read_text().replace(",", ",-"))
    (strip / "wrong.csv").write_text((strip / "wrong.csv").read_text().replace("strain,-stress", "strain,stress"))
    arguments = ("discover", strip / "strip.h5", "--tensile", strip / "wrong.csv", "-o", strip / "out.json")
    words = "no term has stresses of this sign: check the signs of strain and stress"
    assert run(*arguments) == (2, f"eimi: {strip / 'wrong.csv'}: {words}\n")


def test_the_terms_of_a_law_are_found_only_with_a_tensile_curve(strip: Path, run) -> None:
    both, alone = strip / "both.json", strip / "alone.json"
    assert run("discover", strip / "strip.h5", "--tensile", strip / "curve.csv", "-o", both)[0] == 0
    result = json.loads(both.read_text())
    assert result["statement"] == "identified among the terms of this library: i1"
    (law,) = result["alternatives"]
    low, high = law["intervals_95_Pa"]["mu of i1"]
    assert low < 46e3 < high
    assert len(result["datasets"][0]["sha256"]) == 64
    assert result["tensile"][0]["noise_Pa"] > 0
    assert run("discover", strip / "strip.h5", "-o", alone)[0] == 0
    content = json.loads(alone.read_text())
    assert content["identified"] is False
    assert content["terms_that_could_be_there"] or len(content["alternatives"]) > 1


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--term", "gent"], "--term gent: should be one of i1, i2"),
        (["--term", "i1^2"], "--term: the library contains no term that adds to the initial shear modulus"),
        (["--term", "i1", "--term", "i1"], "--term: the library contains a term twice"),
        (["--section", "solid-ish"], "--section solid-ish: there is no such section; did you mean 'solid'?"),
        (["--tensile-window", "-1"], "--tensile-window -1: should be a strain in percent"),
    ],
)
def test_wrong_options_are_refused_in_one_line(strip: Path, run, arguments: list[str], expected: str) -> None:
    curve = ("--tensile", strip / "curve.csv")
    status, message = run("discover", strip / "strip.h5", *curve, *arguments, "-o", strip / "d.json")
    assert (status, message.count("\n")) == (2, 1), message
    assert expected in message
    assert not (strip / "d.json").exists()
