"""Every fit on every dataset, as a person runs it."""

from __future__ import annotations

import io
import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel
from eimi_fitting.materials import LAWS
from eimi_fitting.specimen import Specimen
from eimi_lab import cli

SPECIMEN = """
[specimen]
name = "plain strip"
material = "silicone"
length_mm = 30.0
width_mm = 3.0
depth_mm = 10.0
density_kg_m3 = 1070.0
section = "plane-stress"
"""


def eimi(*arguments: str | Path, folder: Path) -> tuple[int, str, str]:
    """Runs the command line in this process: exit status, stdout, stderr."""
    said, told = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said), redirect_stderr(told):
        patch.chdir(folder)
        patch.setattr(sys, "argv", ["eimi", *map(str, arguments)])
        patch.setattr(cli, "unwind_on_termination", lambda: None)
        with pytest.raises(SystemExit) as exit_:
            cli.main()
    return int(exit_.value.code or 0), said.getvalue(), told.getvalue()


def done(*arguments: str | Path, folder: Path) -> list[str]:
    """What a run that has to succeed prints, line by line."""
    status, said, told = eimi(*arguments, folder=folder)
    assert status == 0, told
    return said.splitlines()


def track_points(folder: Path, name: str, forces_N: list[float], modulus_Pa: float) -> None:
    """Points on the middle line of a strip of a known law under tip forces, imported as `name`.h5."""
    model = BeamModel(Specimen(30.0, 3.0, 10.0, 1070.0, "plane-stress")).refined()
    loads = Loads.along([0.0] * len(forces_N), 90.0, 90.0, forces_N)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[modulus_Pa]]), loads)
    rest = np.column_stack([np.linspace(5, 29, 9), np.zeros(9)])
    places = model.positions(shapes, rest)[0]
    rows = [
        f"{k},p{i},{rest[i, 0]},{rest[i, 1]},{x:.6f},{y:.6f},0.01"
        for k, state in enumerate(places)
        for i, (x, y) in enumerate(state)
    ]
    (folder / f"{name}.csv").write_text("\n".join(["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm", *rows]) + "\n")
    states = [f"{k},0.0,{force}" for k, force in enumerate(forces_N)]
    (folder / f"{name}_states.csv").write_text("\n".join(["state,field_mT,tip_force_N", *states]) + "\n")
    (folder / "specimen.toml").write_text(SPECIMEN)
    tables = ("--states", f"{name}_states.csv", "--specimen", "specimen.toml", "--gravity-angle", "90")
    done("import", f"{name}.csv", *tables, "-o", f"{name}.h5", folder=folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two datasets of one strip, a fit of the first, and tensile fits of a stiffer curve."""
    folder = tmp_path_factory.mktemp("validate")
    track_points(folder, "train", [0.0, 0.001, 0.002], 46e3)
    track_points(folder, "unseen", [0.0005, 0.0015, 0.003], 46e3)
    done("fit", "train.h5", "--model", "neo-hookean", "-o", "fits.json", folder=folder)
    strain = np.linspace(0.02, 1.0, 30)
    stress = 60 * (1 + strain - (1 + strain) ** -2)
    rows = [f"{e},{s}" for e, s in zip(strain, stress, strict=True)]
    (folder / "curve.csv").write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
    windows = ("--window", "20", "--window", "full")
    done("tensile", "curve.csv", "--model", "neo-hookean", *windows, "-o", "tensile.json", folder=folder)
    return folder


def test_unseen_states_and_the_comparison_with_tensile_fits(folder: Path) -> None:
    fits = ("--fit", "tensile.json", "--fit", "fits.json")
    lines = done("validate", "train.h5", "unseen.h5", *fits, "-o", "validation.json", folder=folder)
    found = json.loads((folder / "validation.json").read_text())["validations"]
    assert [(v["dataset"], v["fit"]["path"], v["fit"]["index"], v["seen"]) for v in found] == [
        ("train.h5", "tensile.json", 0, False),
        ("train.h5", "tensile.json", 1, False),
        ("train.h5", "fits.json", 0, True),
        ("unseen.h5", "tensile.json", 0, False),
        ("unseen.h5", "tensile.json", 1, False),
        ("unseen.h5", "fits.json", 0, False),
    ]
    for v in found:
        assert [s["state"] for s in v["by_state"]] == [0, 1, 2]
        assert v["mean_error_mm"] == pytest.approx(np.mean([s["error_mm"] for s in v["by_state"]]))
        assert v["mean_deviation_mm"] == pytest.approx(np.mean([s["deviation_mm"] for s in v["by_state"]]))
        assert (v["status"], v["stable"], v["section"]) == ("ok", True, "plane-stress")
    # A fit of the same law from the same strip predicts what it has not seen; one of a stiffer curve does not.
    assert found[5]["mean_error_mm"] < 1e-3
    assert found[3]["mean_error_mm"] > 0.1
    # What the fit itself wrote of the states it saw.
    (own,) = json.loads((folder / "fits.json").read_text())["fits"]
    assert own["mean_error_mm"] == pytest.approx(found[2]["mean_error_mm"], rel=1e-6)
    # The table: by dataset, the best fit first.
    assert [line.split()[0] for line in lines[:3]] == ["train.h5", "fit", "fits.json:0"]
    assert [line.split()[0] for line in lines[5:8]] == ["unseen.h5", "fit", "fits.json:0"]
    assert lines[2].endswith("  seen")
    assert "unseen" in lines[7]


def test_a_law_without_an_equilibrium_is_told_and_stops_nothing(folder: Path) -> None:
    content = json.loads((folder / "tensile.json").read_text())
    content["fits"][0]["parameters"]["mu"]["value"] = -60e3
    (folder / "negative.json").write_text(json.dumps(content))
    lines = done("validate", "unseen.h5", "--fit", "negative.json", "-o", "negative_v.json", folder=folder)
    first, second = json.loads((folder / "negative_v.json").read_text())["validations"]
    assert second["status"] == "ok"
    assert (first["status"], first["mean_error_mm"], first["by_state"]) == ("no equilibrium", None, [])
    assert lines[-1].split()[0] == "negative.json:0"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("train.h5", "--fit", "none.json", "-o", "v.json"), "none.json: cannot be read as fits.json"),
        (("none.h5", "--fit", "fits.json", "-o", "v.json"), "none.h5: no such file"),
        (("train.h5", "--fit", "fits.json", "-o", "fits.json"), "fits.json: exists already"),
        (
            ("train.h5", "--fit", "fits.json", "--section", "plane-strain", "-o", "v.json"),
            "fits.json: fits.0 took train.h5 as plane-stress, not plane-strain; give --section plane-stress",
        ),
    ],
)
def test_bad_input_to_validate_is_one_line(folder: Path, arguments: tuple[str, ...], told: str) -> None:
    status, _, said = eimi("validate", *arguments, folder=folder)
    assert status == 2
    assert told in said.splitlines()[-1]
    assert not (folder / "v.json").exists()
