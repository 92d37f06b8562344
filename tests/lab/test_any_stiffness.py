"""The modulus of a steel rod is identified from a table of tip displacements under a force across gravity."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.units import in_words
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.showing.rounded import format_quantity

SPECIMEN = """
[specimen]
name = "rod"
material = "steel"
length_mm = 300.0
width_mm = 5.0
depth_mm = 5.0
density_kg_m3 = 7850.0
section = "plane-stress"
"""
YOUNG_PA, FORCES_N = 104e9, (1.0, 2.0, 4.0)


@pytest.fixture
def rod(tmp_path: Path) -> Path:
    # A folder with points.csv, states.csv and rod.toml of a steel rod with a dial gauge at its tip.
    sag_mm = [force * 300.0**3 / (3 * 1e-6 * YOUNG_PA * 5.0**4 / 12) for force in FORCES_N]
    rows = [f"{k},tip,300,0,300,{sag:.4f},0.005" for k, sag in enumerate(sag_mm)]
    (tmp_path / "points.csv").write_text("\n".join(["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm", *rows]) + "\n")
    states = [f"{k},0,{force},90" for k, force in enumerate(FORCES_N)]
    (tmp_path / "states.csv").write_text("\n".join(["state,field_mT,tip_force_N,tip_force_angle_deg", *states]) + "\n")
    (tmp_path / "rod.toml").write_text(SPECIMEN)
    return tmp_path


def import_rod(folder: Path, run, *how: str) -> tuple[int, str]:
    tables = ("--states", folder / "states.csv", "--specimen", folder / "rod.toml")
    return run("import", folder / "points.csv", *tables, *how, "-o", folder / "rod.h5")


def test_the_modulus_of_a_steel_rod_is_identified_without_its_weight(rod: Path, run) -> None:
    assert import_rod(rod, run, "--no-gravity")[0] == 0
    with open_dataset(rod / "rod.h5") as dataset:
        assert [state.tip_force_angle_deg for state in dataset.states] == [90.0] * 3
    loads = load_evidence(rod / "rod.h5").experiment.loads
    assert not loads.gravity.any()
    assert loads.tip_force_N.round(12).tolist() == [[0.0, force] for force in FORCES_N]
    status, message = run("fit", rod / "rod.h5", "--model", "neo-hookean", "-o", rod / "fits.json")
    assert status == 0, message
    (fit,) = json.loads((rod / "fits.json").read_text())["fits"]
    assert fit["initial_shear_modulus"]["value"] == pytest.approx(YOUNG_PA / 3, rel=5e-3)  # incompressible


def test_gravity_and_a_tip_force_may_have_different_directions(rod: Path, run) -> None:
    assert import_rod(rod, run, "--gravity-angle", "0")[0] == 0
    loads = load_evidence(rod / "rod.h5").experiment.loads
    assert loads.gravity[0].round(5).tolist() == [9.80665, 0.0]
    assert loads.tip_force_N[2].round(12).tolist() == [0.0, 4.0]


def test_a_tip_force_without_a_direction_is_refused_in_one_line(rod: Path, run) -> None:
    (rod / "states.csv").write_text("state,field_mT,tip_force_N\n0,0,1\n1,0,2\n2,0,4\n")
    status, message = import_rod(rod, run, "--no-gravity")
    assert (status, message.count("\n")) == (2, 1)
    assert "states.csv: tip_force_N = 1 has no direction" in message


@pytest.mark.parametrize(
    ("modulus_Pa", "printed", "shown"),
    [
        (46380.2, "46380 Pa [41742, 51018]", "46.4 kPa [41.7, 51.0]"),
        (100.31, "100.31 Pa [90.28, 110.34]", "0.100 kPa [0.090, 0.110]"),
        (34.67e9, "34.670 GPa [31.203, 38.137]", "34.7 GPa [31.2, 38.1]"),
    ],
)
def test_moduli_of_gel_and_of_steel_can_be_read(modulus_Pa: float, printed: str, shown: str) -> None:
    ends = (0.9 * modulus_Pa, 1.1 * modulus_Pa)
    assert in_words(modulus_Pa, ends) == printed
    assert format_quantity(Quantity(modulus_Pa, "Pa", ends)) == shown
