"""Tracked points stay on the surface of a beam of varying width, also if a fit changes the size of the beam."""

from pathlib import Path

import numpy as np
import pytest

import eimi_lab as eimi
from eimi_fitting import Beam, Loads
from eimi_lab.config.specimen import load_specimen
from eimi_lab.process.errors import InputError

SPECIMEN = """
[specimen]
name = "head"
material = "Ecoflex 00-50"
length_mm = 50.0
width_mm = [[0.0, 4.0], [40.0, 4.0], [40.0, 8.0], [50.0, 8.0]]
depth_mm = 4.0
density_kg_m3 = 1070.0

[uncertainty]
length_mm = 0.2
width_mm = 0.1
depth_mm = 0.1
"""
CORNERS_MM = np.array([[50.0, -4.0, 2.0], [50.0, 4.0, 2.0], [40.0, -2.0, 0.0]])
SIGMA_MM = 0.01


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    # A folder with specimen.toml, and with states.csv of one state without a field.
    (tmp_path / "specimen.toml").write_text(SPECIMEN)
    (tmp_path / "states.csv").write_text("state,field_mT\n0,0\n")
    return tmp_path


def dataset_of(folder: Path, rest_mm: np.ndarray, moved_mm: np.ndarray) -> Path:
    # Import n points with the positions ``rest_mm``, (n, 3), and ``moved_mm``, (n, 2 or more); return the file.
    rows = ["state,point,x0_mm,y0_mm,z_mm,x_mm,y_mm,sigma_mm"]
    for name, rest, moved in zip("abc", rest_mm, moved_mm, strict=False):
        rows.append(",".join(map(str, (0, name, *rest, *moved[:2], SIGMA_MM))))
    (folder / "points.csv").write_text("\n".join(rows) + "\n")
    inputs = (folder / name for name in ("points.csv", "states.csv", "specimen.toml", "run.h5"))
    with eimi.import_points(*inputs, gravity_angle=-90) as dataset:
        return dataset.path


def test_corners_of_a_head_give_the_modulus_although_all_sizes_are_uncertain(folder: Path) -> None:
    specimen = load_specimen(folder / "specimen.toml").mechanics()
    loads = Loads.along((0.0,), gravity_angle_deg=-90.0)
    moved = Beam(specimen).solve("neo-hookean", [30e3], loads).positions(CORNERS_MM)[0]
    fit = eimi.fit(dataset_of(folder, CORNERS_MM, moved), "neo-hookean")
    assert fit.initial_shear_modulus.value == pytest.approx(30e3, rel=0.005)
    sources = {entry.source for entry in fit.budget}
    assert {"length", "width"} <= sources


@pytest.mark.parametrize(("x0", "y0", "width"), [(20.0, 3.0, "4"), (45.0, 4.1, "8"), (40.0, 3.0, "4")])
def test_a_point_beside_the_beam_is_refused_with_the_width_at_its_place(folder, x0, y0, width) -> None:
    with pytest.raises(
        InputError, match=rf"row 2: y0_mm = '{y0}' should be .* half of width_mm at this x0_mm = {width} "
    ):
        dataset_of(folder, np.array([[x0, y0, 0.0]]), np.array([[x0, y0]]))
