"""A dataset that no material can explain gives an error of one line: the likely cause and the key to change."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import PointObservation
from eimi_fitting.laws import LAWS
from eimi_lab.dataset.state import State
from eimi_lab.fits.before_search import check_states
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.process.errors import InputError

BEAM = """
[specimen]
name = "beam"
material = "silicone"
length_mm = 30.0
width_mm = 3.0
depth_mm = 5.0
density_kg_m3 = 1070.0
section = "plane-strain"
"""
MAGNET = """
[magnet]
length_mm = 4.0
width_mm = 3.0
depth_mm = 2.0
remanence_T = 1.2
density_kg_m3 = 7500.0
"""
FIELD_MT = (0.0, 3.0, 6.0)
REST = np.column_stack([np.linspace(5, 24, 6), np.zeros(6)])


@cache
def places(gravity_deg: float | None = 30.0) -> np.ndarray:
    # Return six points on a simulated beam in three fields, (3, 6, 2) in mm.
    # gravity_deg: direction of gravity in the beam frame; None without gravity.
    magnet = Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", magnet)).refined()
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along(FIELD_MT, 90.0, gravity_deg))
    return model.positions(shapes, REST)[0]


def bent() -> Experiment:
    # Return an experiment (beam model, loads and measured points) of a simulated beam in three fields.
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)))
    observed = PointObservation(np.tile(REST, (3, 1, 1)), places(), np.full((3, 6), 0.005))
    return Experiment(model, Loads.along(FIELD_MT, 90.0, 30.0), observed)


def fit(
    folder: Path, run, *, points=None, fields=FIELD_MT, gravity="30", magnet=MAGNET, name="beam"
) -> tuple[int, str]:
    # Import points, (3, 6, 2) in mm, and fit a law; return the exit status and the last printed line.
    # fields: the field in each state (mT). gravity: its direction in degrees. magnet: the table [magnet] of the
    # specimen file.
    rows = [
        f"{k},p{i},{REST[i, 0]},{REST[i, 1]},{x:.6f},{y:.6f},0.005"
        for k, state in enumerate(places() if points is None else points)
        for i, (x, y) in enumerate(state)
    ]
    (folder / "points.csv").write_text("\n".join(["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm", *rows]) + "\n")
    states = [f"{k},{field}" for k, field in enumerate(fields)]
    (folder / "states.csv").write_text("\n".join(["state,field_mT", *states]) + "\n")
    (folder / "beam.toml").write_text(BEAM + magnet)
    tables = ("--states", folder / "states.csv", "--specimen", folder / "beam.toml", "--gravity-angle", gravity)
    status, message = run("import", folder / "points.csv", *tables, "-o", folder / f"{name}.h5", "--force")
    assert status == 0, message
    status, message = run("fit", folder / f"{name}.h5", "--model", "neo-hookean", "-o", folder / "fits.json", "--force")
    return status, message.splitlines()[-1]


def test_correct_loads_are_accepted(tmp_path: Path, run) -> None:
    assert fit(tmp_path, run)[0] == 0
    (fit_record,) = read_fits_file(tmp_path / "fits.json").fits
    assert fit_record.initial_shear_modulus.value == pytest.approx(46e3, rel=0.01)


@pytest.mark.parametrize(
    ("stated", "cause", "remedy"),
    [
        ({"fields": (0.0, -3.0, -6.0)}, "a field in the opposite direction", "change the sign of field_mT"),
        ({"gravity": "-150"}, "gravity in the opposite direction", "turn --gravity-angle by 180 degrees"),
        ({"fields": (0.0, 3e3, 6e3)}, "a field a thousand times too large", "give field_mT in states.csv in mT and"),
        (
            {"fields": (0.0, 3e-3, 6e-3)},
            "a field a thousand times too small",
            "give field_mT in states.csv in mT (not T)",
        ),
        ({"points": places(None)}, "gravity", "give --no-gravity"),
    ],
)
def test_a_mistake_in_the_loads_is_named(tmp_path: Path, run, stated, cause: str, remedy: str) -> None:
    status, line = fit(tmp_path, run, **stated)
    assert status == 2
    assert (
        "beam.h5: no material explains the measured shape of the beam: with the values in the files the smallest "
        "error is"
    ) in line
    assert f"mm without {cause}; " in line
    assert remedy in line
    assert not (tmp_path / "fits.json").exists()


def test_a_mistake_with_a_small_effect_is_a_doubt(tmp_path: Path, run) -> None:
    # The beam hangs, and its file says that gravity points upward; this changes the bending by only a tenth.
    status, line = fit(tmp_path, run, points=places(0.0), gravity="180")
    if status == 0:
        (record,) = read_fits_file(tmp_path / "fits.json").fits
        line = " ".join(record.doubts_in_words())
    assert "gravity in the opposite direction" in line


def test_a_field_on_a_specimen_without_a_magnet_is_named(tmp_path: Path, run) -> None:
    status, line = fit(tmp_path, run, magnet="")
    assert status == 2
    assert "beam.h5: the tip moves by" in line
    assert "no [magnet] and no magnetisation_kA_per_m" in line


@pytest.mark.parametrize(
    ("key", "stated", "expected"),
    [
        ("width_mm = 2.0", "width_mm = 1.0", "the beam in the picture is 2 times as wide as the specimen file says: 2"),
        ("width_mm = 2.0", "width_mm = 6.0", "the beam in the picture is 0.33 times as wide as the specimen file says"),
        (
            "width_mm = 2.0\ndepth_mm = 2.0",
            "width_mm = 0.8\ndepth_mm = 2.0",
            "the width in the picture equals depth_mm, but depth_mm should be the size along the line of sight",
        ),
    ],
)
def test_a_wrong_width_of_the_beam_is_named(pictures: Path, run, key: str, stated: str, expected: str) -> None:
    text = (pictures / "specimen.toml").read_text()
    assert key in text
    (pictures / "specimen.toml").write_text(text.replace(key, stated))
    tables = ("--states", pictures / "states.csv", "--specimen", pictures / "specimen.toml")
    given = (pictures / "frames", *tables, "--calibration", pictures / "calibration.toml", "-o", pictures / "d.h5")
    assert run("import", *given)[0] == 0
    status, message = run("fit", pictures / "d.h5", "--model", "neo-hookean", "-o", pictures / "fits.json")
    assert status == 2
    assert expected in message.splitlines()[-1]


def test_currents_in_milliamperes_instead_of_amperes_are_named() -> None:
    states = [State(k, 500.0 * k, None, 2350.0 * k, 0.0, ()) for k in range(4)]
    with pytest.raises(InputError, match=r"d\.h5: current_A of up to 1500 A .* current_A should be in ampere"):
        check_states(Path("d.h5"), bent(), states)


def test_one_state_is_enough_if_it_determines_the_modulus(tmp_path: Path, run) -> None:
    assert fit(tmp_path, run, points=places()[2:], fields=FIELD_MT[2:])[0] == 0
    (record,) = read_fits_file(tmp_path / "fits.json").fits
    assert record.initial_shear_modulus.value == pytest.approx(46e3, rel=0.03)
    assert record.held_out_error_mm is None
    # Gravity along a beam of this stiffness stretches it by less than the uncertainty of the points.
    rng = np.random.default_rng(0)
    hanging = REST[None] + rng.normal(0, 0.005, (1, *REST.shape))
    status, line = fit(tmp_path, run, points=hanging, fields=(0.0,), gravity="0", name="hanging")
    assert status == 2
    assert "hanging.h5: a single state does not determine the initial shear modulus" in line
