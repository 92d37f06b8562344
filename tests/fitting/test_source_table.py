"""Every uncertain input changes the simulated experiment as its name says."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.rest_modes import bend_offset
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.sources import SOURCES, loads_under, specimen_under, view_under

BEAM = Specimen(
    30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 2.5, 2.0, 1.2, 7500.0, 1.0, 5.0), tip_load_mm=(27.0, 0.6)
)
LOADS = Loads.along([-2.0, 4.0, 7.0], 80.0, 10.0, 0.003, tip_force_angle_deg=30.0)

# Unit, the file that gives the source, its key, the largest accepted value, the usual value, the names of its numbers.
TABLE = {
    "moment": ("1", None, "", 0.5, 0.02, 1),
    "coil": ("1", "calibration", "coil_constant_mT_per_A", 0.5, 0.01, 1),
    "scale": ("1", "calibration", "pixels_per_mm", 0.5, 0.003, 1),
    "roll": ("deg", None, "", 45.0, 0.1, 1),
    "axis": ("deg", "calibration", "axis_angle_deg", 45.0, 0.1, 1),
    "clamp": ("mm", "calibration", "clamp_midpoint_px", 10.0, 0.05, 2),
    "gravity": ("deg", "calibration", "gravity_angle_deg", 45.0, 0.2, 1),
    "field": ("deg", "calibration", "field_angle_deg", 45.0, 0.5, 1),
    "background-field": ("mT", "calibration", "background_field_mT", 2.0, 0.03, 2),
    "field-gradient": ("1/m", "calibration", "field_gradient_per_m", 20.0, 1.0, 2),
    "stand-off": ("mm", "calibration", "stand_off_mm", 100.0, 2.0, 1),
    "tilt": ("deg", "calibration", "camera_tilt_deg", 20.0, 1.0, 2),
    "offset": ("mT", "rig", "current_A", 10.0, 0.01, 1),
    "width": ("mm", "specimen", "width_mm", 10.0, 0.02, 1),
    "depth": ("mm", "specimen", "depth_mm", 10.0, 0.03, 1),
    "length": ("mm", "specimen", "length_mm", 10.0, 0.05, 1),
    "rest-shape": ("mm", "specimen", "rest_shape_mm", 10.0, 0.1, 3),
    "taper": ("mm", "specimen", "taper_mm", 10.0, 0.02, 1),
    "density": ("kg/m3", "specimen", "density_kg_m3", 1000.0, 5.0, 1),
    "remanence": ("T", "specimen", "remanence_T", 1.0, 0.02, 1),
    "magnetisation-angle": ("deg", "specimen", "magnetisation_angle_deg", 45.0, 3.0, 1),
    "magnet-length": ("mm", "specimen", "magnet_length_mm", 10.0, 0.02, 1),
    "magnet-width": ("mm", "specimen", "magnet_width_mm", 10.0, 0.02, 1),
    "magnet-depth": ("mm", "specimen", "magnet_depth_mm", 10.0, 0.02, 1),
    "magnet-offset": ("mm", "specimen", "magnet_tip_offset_mm", 10.0, 0.05, 1),
    "magnet-density": ("kg/m3", "specimen", "magnet_density_kg_m3", 5000.0, 50.0, 1),
}
BEAM_KEYS = {"width": "width_mm", "depth": "depth_mm", "length": "length_mm", "density": "density_kg_m3"}
MAGNET_KEYS = {
    **{"remanence": "remanence_T", "magnetisation-angle": "magnetisation_angle_deg", "magnet-length": "length_mm"},
    **{"magnet-width": "width_mm", "magnet-depth": "depth_mm", "magnet-offset": "tip_offset_mm"},
    **{"magnet-density": "density_kg_m3"},
}
MODES = {"rest-shape", "taper"}
OF_LOADS = {"axis", "gravity", "field", "background-field", "field-gradient", "offset"}
OF_PICTURE = {"scale", "roll", "axis", "clamp"}


def test_the_registered_sources_are_those_of_the_table() -> None:
    assert {
        name: (s.unit, s.stated_in, s.key, s.largest, s.usual, len(s.parts)) for name, s in SOURCES.items()
    } == TABLE
    assert len({part for source in SOURCES.values() for part in source.parts}) == sum(n for *_, n in TABLE.values())
    assert {name for name, source in SOURCES.items() if source.is_even} == {"background-field", "magnetisation-angle"}
    assert {name for name, source in SOURCES.items() if source.is_decisive} == {"magnetisation-angle"}
    assert {name for name, source in SOURCES.items() if source.common} == {"coil"}
    assert {name: source.covers for name, source in SOURCES.items() if source.covers} == {"moment": ("remanence",)}


def test_each_source_changes_only_what_it_concerns() -> None:
    assert {name for name, s in SOURCES.items() if s.field} == {"moment", "coil"}
    assert {name for name, s in SOURCES.items() if s.image} == OF_PICTURE
    assert {name for name, s in SOURCES.items() if s.loads} == OF_LOADS
    assert {name for name, s in SOURCES.items() if s.lens} == {"stand-off", "tilt"}
    assert {name for name, s in SOURCES.items() if s.specimen} == BEAM_KEYS.keys() | MAGNET_KEYS.keys() | MODES
    for name, source in SOURCES.items():
        assert source.changes_experiment is (name not in {"moment", "coil", "scale", "roll", "clamp"}), name


@pytest.mark.parametrize("source", BEAM_KEYS)
def test_a_dimension_of_the_specimen_increases_by_the_deviation(source: str) -> None:
    key = BEAM_KEYS[source]
    before, after = asdict(BEAM), asdict(specimen_under(BEAM, {source: np.array([0.3])}))
    # The point of a tip force keeps its position relative to length and width.
    assert after["tip_load_mm"] == pytest.approx(
        (27.0 * after["length_mm"] / 30.0, 0.6 * after["width_mm"] / 3.0), rel=1e-12
    )
    assert after.pop(key) == pytest.approx(before.pop(key) + 0.3)
    assert after | {"tip_load_mm": None} == before | {"tip_load_mm": None}


@pytest.mark.parametrize("source", MAGNET_KEYS)
def test_a_value_of_the_magnet_increases_by_the_deviation(source: str) -> None:
    key = MAGNET_KEYS[source]
    changed = specimen_under(BEAM, {source: np.array([0.3])})
    assert changed.magnet is not None
    assert BEAM.magnet is not None
    before, after = asdict(BEAM.magnet), asdict(changed.magnet)
    assert after.pop(key) == pytest.approx(before.pop(key) + 0.3)
    assert after == before
    assert replace(changed, magnet=BEAM.magnet) == BEAM
    without = replace(BEAM, magnet=None)
    assert specimen_under(without, {source: np.array([0.3])}) == without


def test_a_taper_is_the_change_of_the_width_along_the_flexible_part() -> None:
    shape = specimen_under(BEAM, {"taper": np.array([0.4])}).rest_shape
    assert shape is not None
    share, added = np.array(shape.widths).T
    assert (share[0], share[-1]) == pytest.approx((0.0, BEAM.flexible_length_mm / BEAM.length_mm))
    assert (added[0], added[-1]) == pytest.approx((-0.2, 0.2))
    assert added.mean() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(np.diff(added)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_a_bend_at_rest_has_its_largest_offset_in_mm(mode: int) -> None:
    deviation = np.zeros(3)
    deviation[mode] = 0.7
    shape = specimen_under(BEAM, {"rest-shape": deviation}).rest_shape
    assert shape is not None
    share, angle_rad = np.array(shape.turns).T
    length_mm = BEAM.flexible_length_mm
    at_mm = share * BEAM.length_mm
    assert at_mm[-1] == pytest.approx(length_mm)
    slope = np.polynomial.Polynomial.fit(at_mm, angle_rad, 4)
    offset_mm = slope.integ(lbnd=0.0)(np.linspace(0.0, length_mm, 401))
    assert np.abs(offset_mm).max() == pytest.approx(0.7, rel=1e-3)
    assert offset_mm[1:60].min() > 0 or mode == 1  # toward +y from the clamp; the second mode begins the other way
    assert bend_offset(deviation, np.linspace(0.0, 1.0, 401)) == pytest.approx(offset_mm, abs=1e-3)


def turn(vector: np.ndarray, angle_deg: float) -> np.ndarray:
    # Return K vectors (x, y), shape (K, 2), rotated by `angle_deg` from +x toward +y.
    as_complex = (vector[:, 0] + 1j * vector[:, 1]) * np.exp(1j * np.radians(angle_deg))
    return np.column_stack([as_complex.real, as_complex.imag])


@pytest.mark.parametrize(
    ("source", "field_deg", "gravity_deg"), [("field", 3.0, 0.0), ("gravity", 0.0, 3.0), ("axis", -3.0, -3.0)]
)
def test_directions_turn_from_x_toward_y(source: str, field_deg: float, gravity_deg: float) -> None:
    # An error of the axis of the beam rotates field and gravity in the opposite direction.
    turned = loads_under(LOADS, {source: np.array([3.0])})
    assert turned.field_T == pytest.approx(turn(LOADS.field_T, field_deg))
    assert turned.gravity == pytest.approx(turn(LOADS.gravity, gravity_deg))
    assert turned.tip_force_N == pytest.approx(turn(LOADS.tip_force_N, gravity_deg))


def test_an_offset_of_the_field_is_the_same_in_every_state_and_parallel_to_the_field() -> None:
    moved = loads_under(LOADS, {"offset": np.array([0.5])})  # mT
    along = LOADS.field_T[2] / np.linalg.norm(LOADS.field_T[2])
    assert moved.field_T - LOADS.field_T == pytest.approx(np.tile(0.5e-3 * along, (3, 1)))
    none = replace(LOADS, field_T=np.zeros((3, 2)))
    assert loads_under(none, {"offset": np.array([0.5])}) is none


def test_a_background_field_is_the_same_in_every_state() -> None:
    moved = loads_under(LOADS, {"background-field": np.array([0.2, -0.3])})
    (more,) = moved.others
    assert more.numbers == pytest.approx(np.tile([0.2e-3, -0.3e-3], (3, 1)))
    assert moved.field_T is LOADS.field_T


def test_a_gradient_adds_to_that_of_the_coil() -> None:
    once = loads_under(LOADS, {"field-gradient": np.array([2.0, -1.0])})
    assert once.coil is not None
    assert once.coil.gradient_per_m == pytest.approx((2.0, -1.0))
    twice = loads_under(once, {"field-gradient": np.array([0.5, 0.25])})
    assert twice.coil is not None
    assert twice.coil.gradient_per_m == pytest.approx((2.5, -0.75))
    none = replace(LOADS, field_T=np.zeros((3, 2)))
    assert loads_under(none, {"field-gradient": np.array([2.0, 1.0])}) is none


def test_a_stand_off_and_a_tilt_increase_by_the_deviation() -> None:
    view = View(np.array([10.0, 1.0]), 150.0, tilt_deg=(0.5, -1.0))
    farther = view_under(view, {"stand-off": np.array([4.0])})
    assert (farther.stand_off_mm, farther.tilt_deg) == (154.0, (0.5, -1.0))
    tilted = view_under(view, {"tilt": np.array([0.25, 2.0])})
    assert (tilted.stand_off_mm, tilted.tilt_deg) == (150.0, (0.75, 1.0))
    assert view_under(view, {"width": np.array([4.0])}) is view


@pytest.mark.parametrize("source", ["moment", "coil"])
def test_a_share_of_the_magnetic_load_multiplies_it(source: str) -> None:
    factor = SOURCES[source].field
    assert factor is not None
    assert factor(np.array([[0.02], [-0.1]])) == pytest.approx([1.02, 0.9])


POINTS = np.array([[10.0, 0.0], [20.0, 5.0]])


@pytest.mark.parametrize(
    ("source", "deviation", "imaged"),
    [
        ("scale", [0.1], 1.1 * POINTS),
        ("roll", [90.0], np.column_stack([-POINTS[:, 1], POINTS[:, 0]])),
        ("axis", [90.0], np.column_stack([-POINTS[:, 1], POINTS[:, 0]])),
        ("clamp", [0.5, -0.2], POINTS + np.array([0.5, -0.2])),
    ],
)
def test_the_picture_of_a_point_moves_as_the_source_says(
    source: str, deviation: list[float], imaged: np.ndarray
) -> None:
    image = SOURCES[source].image
    assert image is not None
    maps, shifts = image(np.array([deviation, np.zeros(len(deviation))]))
    assert POINTS @ maps[0].T + shifts[0] == pytest.approx(imaged)
    assert POINTS @ maps[1].T + shifts[1] == pytest.approx(POINTS)
