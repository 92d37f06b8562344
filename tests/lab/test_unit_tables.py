"""Every unit that a file may use agrees with its definition."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from eimi_drivers.interfaces import Reading
from eimi_lab.config.interlock import READINGS
from eimi_lab.config.sensor import UNITS
from eimi_lab.dataset.layout import FRAME_COLUMNS, STATE_COLUMNS
from eimi_lab.dataset.measured_columns import COLUMNS as MEASURED
from eimi_lab.dataset.moving.beam_modes import ROOTS
from eimi_lab.dataset.moving.stored_motions import _ARRAYS
from eimi_lab.dataset.recordings import COLUMNS as RECORDED
from eimi_lab.dataset.sensor_logs import MEASUREMENTS
from eimi_lab.dataset.tracked.axes import UNITS_MM, Placing, place
from eimi_lab.dataset.tracked.c3d import _UNITS
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.fits.tensile_files import STRAINS, STRESSES, read_tensile
from eimi_lab.vision.calibration.exif_lens import _MM_PER_UNIT, focal_length
from eimi_lab.vision.intensity import full_scale

LENGTHS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}  # the international inch of 1959


def test_lengths() -> None:
    assert UNITS_MM == LENGTHS_MM
    assert {**{unit: unit for unit in LENGTHS_MM}, "millimeters": "mm", "meters": "m"} == _UNITS


@pytest.mark.parametrize("unit", LENGTHS_MM)
def test_points_and_their_deviations_are_converted(unit: str) -> None:
    tracks = Tracks(
        places=np.array([[[1.0, 2.0], [1.0, 5.0]], [[0.0, 2.0], [1.5, 5.0]]]),
        frames=np.array([1, 2]),
        names=("a", "b"),
        unit=None,
        image_axes=False,
        sigma=None,
        rest=None,
    )
    placed = place(tracks, Placing(unit=unit, clamp=(1.0, 1.0), axis_deg=90.0, sigma=0.01, rest=1), "points.csv")
    mm = LENGTHS_MM[unit]
    assert placed.rest_mm == pytest.approx(mm * np.array([[1.0, 0.0], [4.0, 0.0]]))
    assert placed.places_mm[1] == pytest.approx(mm * np.array([[1.0, 1.0], [4.0, -0.5]]))
    assert placed.sigma_mm == pytest.approx(np.full((2, 2), 0.01 * mm))


@pytest.mark.parametrize(
    ("plane", "axes"),
    [("xy", (0, 1)), ("yx", (1, 0)), ("xz", (0, 2)), ("zx", (2, 0)), ("yz", (1, 2)), ("zy", (2, 1))],
)
def test_the_first_letter_of_a_plane_is_the_first_axis(plane: str, axes: tuple[int, int]) -> None:
    places = np.random.default_rng(1).normal(size=(2, 3, 3))
    tracks = Tracks(
        places=places,
        frames=np.array([0, 1]),
        names=("a", "b", "c"),
        unit="mm",
        image_axes=False,
        sigma=None,
        rest=None,
    )
    placing = Placing(clamp=(0.0, 0.0), axis_deg=0.0, sigma=0.1, rest=0, plane=plane)
    assert place(tracks, placing, "points.c3d").places_mm == pytest.approx(places[..., list(axes)])


@pytest.mark.parametrize(("unit", "per_mm"), [(2, 1 / 25.4), (3, 0.1), (4, 1.0), (5, 1000.0)])
def test_the_resolution_of_a_sensor_in_every_unit_of_exif(tmp_path: Path, unit: int, per_mm: float) -> None:
    # FocalPlaneResolutionUnit of Exif 2.3, 4.6.5: 2 is inch, 3 is cm, 4 is mm, 5 is micrometre (4 and 5: TIFF/EP).
    assert _MM_PER_UNIT.keys() == {2, 3, 4, 5}
    pixels_per_mm = 250.0
    exif = Image.Exif()
    table = {"FocalLength": 4.0, "FocalPlaneXResolution": pixels_per_mm / per_mm, "FocalPlaneResolutionUnit": unit}
    table |= {"ExifImageWidth": 400, "ExifImageHeight": 300}
    exif.get_ifd(IFD.Exif).update({Base[name]: value for name, value in table.items()})
    Image.new("RGB", (400, 300)).save(tmp_path / "a.jpg", exif=exif)
    lens = focal_length(tmp_path / "a.jpg", (400, 300))
    assert lens is not None
    assert lens.px == pytest.approx(4.0 * pixels_per_mm, rel=1e-3)


@pytest.mark.parametrize(("column", "pascal"), [("stress_Pa", 1.0), ("stress_kPa", 1e3), ("stress_MPa", 1e6)])
@pytest.mark.parametrize(("strain", "share"), [("strain", 1.0), ("strain_percent", 0.01)])
def test_tensile_curves_in_every_unit(tmp_path: Path, column: str, pascal: float, strain: str, share: float) -> None:
    assert STRESSES.keys() == {"stress_Pa", "stress_kPa", "stress_MPa"}
    assert STRAINS.keys() == {"strain", "strain_percent"}
    strains, stresses_Pa = np.linspace(0.0, 0.5, 8), np.linspace(0.0, 2e4, 8)
    rows = [f"{x / share:.9g},{y / pascal:.9g}" for x, y in zip(strains, stresses_Pa, strict=True)]
    path = tmp_path / "curve.csv"
    path.write_text("\n".join([f"{strain},{column}", *rows]) + "\n")
    curve = read_tensile(path)
    assert curve.strain == pytest.approx(strains)
    assert curve.stress_Pa == pytest.approx(stresses_Pa)


def test_readings_of_a_supply() -> None:
    reading = Reading(current_A=-0.5, voltage_V=4.0)
    assert {name: read(reading) for name, read in READINGS.items()} == {
        "coil_current_A": -0.5,
        "coil_voltage_V": 4.0,
        "coil_power_W": -2.0,
    }


def test_quantities_of_sensors() -> None:
    # Each measured quantity has the right unit, and the right name in the NeXus class NXsensor.
    assert UNITS == {"field": "mT", "specimen_temperature": "degC", "coil_temperature": "degC"}
    assert MEASUREMENTS == {
        "field": "magnetic_field",
        "specimen_temperature": "temperature",
        "coil_temperature": "temperature",
    }


def test_units_in_a_dataset() -> None:
    # The columns are given by their names in the file format.
    units = {"s": ("time", "timestamp", "elapsed"), "A": ("current", "set_current", "measured_current")}
    units |= {"mT": ("field",), "N": ("tip_force",)}
    expected = {column: unit for unit, columns in units.items() for column in columns}
    for columns in (STATE_COLUMNS, FRAME_COLUMNS, RECORDED):
        stated = {name: unit for name, (_, unit) in columns.items() if unit is not None}
        assert stated == {name: expected[name] for name in stated}
        for name in set(columns) - set(stated):
            assert name not in expected
    assert MEASURED == {"field_sigma": ("field_sigma_mT", "mT"), "temperature": ("temperature_degC", "degC")}
    assert _ARRAYS == {"points": "mm", "time": "s", "sigma": "mm", "rest": "mm"}


def test_the_roots_of_a_clamped_beam_solve_its_equation() -> None:
    # cos x cosh x = -1; Timoshenko, Vibration Problems in Engineering, section 54.
    assert np.cos(ROOTS) + 1 / np.cosh(ROOTS) == pytest.approx(0.0, abs=1e-9)
    assert [round(root / np.pi + 0.5) for root in ROOTS] == [1, 2, 3]


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_the_full_scale_of_every_bit_depth(bits: int) -> None:
    largest = 2**bits - 1
    image = np.full((4, 4), largest, np.uint8 if bits == 8 else np.uint16)
    assert full_scale(image) == largest
    if bits > 8:
        image[0, 0] = largest - 1
        assert full_scale(image) == largest
