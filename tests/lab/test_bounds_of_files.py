"""Each bound of a value in a file holds: the last permitted value is read, and the next value gives an error."""

from __future__ import annotations

import math
from datetime import UTC, date, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from eimi_drivers.interfaces import Limits
from eimi_lab.config import toml
from eimi_lab.config.calibration import (
    Calibration,
    Picture,
    changed_calibration,
    load_calibration,
    missing_places,
)
from eimi_lab.config.coil_shape import CoilShapeTable, with_rows_of_map
from eimi_lab.config.interlock import READINGS, Interlock, check_readings
from eimi_lab.config.json_text import parse_json
from eimi_lab.config.materials import TrueBench, TrueMaterial
from eimi_lab.config.people import Person
from eimi_lab.config.protocol import (
    Conditioning,
    Currents,
    Protocol,
    Ramp,
    RingDown,
    Settle,
    SupplyLimits,
    Transients,
    load_protocol,
)
from eimi_lab.config.rig import Camera, CoilRating, Playback, Supply, Virtual, load_rig
from eimi_lab.config.rig_uncertainty import stated_by_rig
from eimi_lab.config.sensor import RigSensor, check_sensors
from eimi_lab.config.simulated_optics import Optics
from eimi_lab.config.size_along import SizeAlong, size_along, written
from eimi_lab.config.specimen import Beam, Magnet, SpecimenFile, TipLoad
from eimi_lab.config.toml import differences, locate, read_text, table_text
from eimi_lab.config.uncertainty import check_sizes, keys_of, missing_keys, stated_sources
from eimi_lab.dataset.moving.motion_csv import POINT_COLUMNS, TIME_COLUMNS
from eimi_lab.dataset.state_loads import FRAME_COLUMNS, LOAD_COLUMNS, STATE_COLUMNS, UNTIL_COLUMNS
from eimi_lab.dataset.tracked.points_csv import COLUMNS, OPTIONAL_COLUMNS
from eimi_lab.process.errors import InputError

A_SETTLE = {"noise_ratio": 2.0, "pairs": 3, "drift_window_s": 1.0, "timeout_s": 20.0}
A_RAMP = {"rate_A_per_s": 0.5, "step_A": 0.01, "tolerance_A": 0.02}
A_CALIBRATION: dict[str, Any] = {
    "pixels_per_mm": 8.0,
    "clamp_midpoint_px": (64.0, 8.0),
    "axis_angle_deg": 90.0,
    "gravity_angle_deg": 90.0,
}
A_COIL = {**A_CALIBRATION, "coil_constant_mT_per_A": 4.0, "field_angle_deg": 0.0}
A_BEAM: dict[str, Any] = {
    "name": "n",
    "material": "m",
    "length_mm": 30.0,
    "width_mm": 3.0,
    "depth_mm": 5.0,
    "density_kg_m3": 1070.0,
}
A_MAGNET: dict[str, Any] = {
    "length_mm": 4.0,
    "width_mm": 3.0,
    "depth_mm": 2.0,
    "remanence_T": 1.2,
    "density_kg_m3": 7500.0,
}
A_SENSOR = {"name": "probe", "driver": "lakeshore-425", "address": "COM3"}
A_VIRTUAL_CAMERA = {"driver": "virtual", "source": "virtual"}
A_CAMERA = {"driver": "aravis", "source": "x"}
A_PROTOCOL: dict[str, Any] = {
    "name": "n",
    "material": "m",
    "frames_per_state": 2,
    "current": Currents(start_A=0.0, stop_A=0.4, step_A=0.2),
    "ramp": Ramp(**A_RAMP),
    "limits": SupplyLimits(current_A=0.5, voltage_V=12.0),
    "settle": Settle(**A_SETTLE),
}
A_MATRIX = ((1.0, 0.5, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
A_MATERIAL = {"model": "neo-hookean", "parameters": {"mu_Pa": 1e4}}

BOUNDS: list[tuple[type, dict[str, Any], str, Any, Any]] = [
    (Currents, {"start_A": 0.0, "stop_A": 1.0}, "step_A", 1.0, 0.0),
    (Currents, {}, "values_A", (0.0, 1.0), (0.0,)),
    (Currents, {}, "values_A", tuple(float(k) for k in range(1000)), tuple(float(k) for k in range(1001))),
    (Ramp, A_RAMP, "rate_A_per_s", 1e-9, 0.0),
    (Ramp, A_RAMP, "step_A", 1e-4, 0.99e-4),
    (Ramp, A_RAMP, "tolerance_A", 1e-9, 0.0),
    (Ramp, A_RAMP, "down_within_s", 1e-9, 0.0),
    (Ramp, A_RAMP, "down_within_s", 60.0, 60.1),
    (SupplyLimits, {"voltage_V": 1.0}, "current_A", 1e-9, 0.0),
    (SupplyLimits, {"current_A": 1.0}, "voltage_V", 1e-9, 0.0),
    (Settle, A_SETTLE, "noise_ratio", 1.01, 1.0),
    (Settle, A_SETTLE, "pairs", 1, 0),
    (Settle, A_SETTLE, "drift_window_s", 1e-9, 0.0),
    (Settle, A_SETTLE, "dwell_s", 0.0, -0.1),
    (Settle, A_SETTLE, "dwell_s", 3600.0, 3600.1),
    (Settle, A_SETTLE, "timeout_s", 1.01, 1.0),
    (Transients, {}, "frames_per_state", 0, -1),
    (Transients, {}, "frames_per_state", 10_000, 10_001),
    (Conditioning, {"current_A": 1.0}, "cycles", 1, 0),
    (Conditioning, {"current_A": 1.0}, "cycles", 1000, 1001),
    (Conditioning, {"cycles": 1}, "current_A", -0.1, 0.0),
    (RingDown, {}, "seconds", 1e-9, 0.0),
    (RingDown, {}, "seconds", 600.0, 600.1),
    (RingDown, {"seconds": 1.0}, "from_A", -0.1, 0.0),
    (RingDown, {"seconds": 1.0}, "rate_Hz", 1e-9, 0.0),
    (RingDown, {"seconds": 1.0}, "repeats", 1, 0),
    (RingDown, {"seconds": 1.0}, "repeats", 100, 101),
    (Protocol, A_PROTOCOL, "frames_per_state", 1, 0),
    (Protocol, A_PROTOCOL, "frames_per_state", 10_000, 10_001),
    (Protocol, A_PROTOCOL, "tip_force_N", 0.0, -0.1),
    (Protocol, A_PROTOCOL, "name", "x", ""),
    (Protocol, A_PROTOCOL, "material", "x", ""),
    (Picture, {}, "region_px", (0, 0, 1, 1), (-1, 0, 1, 1)),
    (Picture, {}, "region_px", (0, 0, 1, 1), (0, -1, 1, 1)),
    (Picture, {}, "region_px", (0, 0, 1, 1), (0, 0, 0, 1)),
    (Picture, {}, "region_px", (0, 0, 1, 1), (0, 0, 1, 0)),
    (Picture, {}, "beam_colour", (0.0, 0.0, 255.0), (0.0, 0.0, 255.1)),
    (Picture, {}, "beam_colour", (0.0, 0.0, 0.0), (0.0, -0.1, 0.0)),
    (Picture, {}, "along_px", ((0.0, 0.0),) * 2, ((0.0, 0.0),)),
    (Picture, {}, "along_px", ((0.0, 0.0),) * 6, ((0.0, 0.0),) * 7),
    (Picture, {"channel": "red"}, "beam_colour", None, (0.0, 0.0, 0.0)),
    (Calibration, A_CALIBRATION, "pixels_per_mm", 1e-9, 0.0),
    (Calibration, A_COIL, "coil_constant_mT_per_A", 1e-9, 0.0),
    (Calibration, A_CALIBRATION, "axis_angle_deg", 360.0, 360.1),
    (Calibration, A_CALIBRATION, "axis_angle_deg", -360.0, -360.1),
    (Calibration, A_CALIBRATION, "gravity_angle_deg", 360.0, 361.0),
    (Calibration, A_COIL, "field_angle_deg", 60.0, 60.1),
    (Calibration, A_COIL, "field_angle_deg", 120.0, 119.9),
    (Calibration, A_COIL, "field_angle_deg", -60.0, -60.1),
    (Calibration, A_COIL, "field_angle_deg", 0.0, None),
    (Calibration, A_CALIBRATION, "stand_off_mm", 1e-9, 0.0),
    (Calibration, A_CALIBRATION | {"telecentric": True}, "stand_off_mm", None, 300.0),
    (Calibration, A_CALIBRATION | {"stand_off_mm": 300.0}, "camera_tilt_deg", (30.0, -30.0), (30.1, 0.0)),
    (Calibration, A_CALIBRATION | {"stand_off_mm": 300.0}, "camera_tilt_deg", (0.0, 0.0), (0.0, -30.1)),
    (Calibration, A_CALIBRATION, "camera_tilt_deg", None, (1.0, 0.0)),
    (Calibration, A_CALIBRATION, "uncertainty", {"pixels_per_mm": 4.0}, {"pixels_per_mm": 4.01}),
    (Calibration, A_CALIBRATION, "uncertainty", {"axis_angle_deg": 90.0}, {"axis_angle_deg": -0.1}),
    (Calibration, A_CALIBRATION, "uncertainty", {}, {"stand_off_mm": 1.0}),
    (Calibration, A_CALIBRATION, "uncertainty", {}, {"camera_tilt_deg": 1.0}),
    *(
        (Calibration, A_CALIBRATION | {"distortion": (0.0,) * 4}, "camera_matrix", A_MATRIX, bad)
        for bad in (
            None,
            ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
            ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
            ((1.0, 0.0, 0.0), (0.5, 1.0, 0.0), (0.0, 0.0, 1.0)),
            ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (7.0, 8.0, 1.0)),
        )
    ),
    *(
        (Calibration, A_CALIBRATION | {"camera_matrix": A_MATRIX}, "distortion", (0.0,) * good, (0.0,) * bad)
        for good, bad in ((4, 3), (5, 6), (8, 7), (12, 9), (14, 13), (14, 15))
    ),
    (CoilShapeTable, {"gap_mm": 0.0}, "radius_mm", 1e-9, 0.0),
    (CoilShapeTable, {"radius_mm": 1.0}, "gap_mm", 0.0, -0.1),
    (CoilShapeTable, {"radius_mm": 1.0}, "gap_mm", 0.0, None),
    (CoilShapeTable, {"gradient_per_m": (1.0, 0.0)}, "centre_mm", None, (0.0, 0.0)),
    (CoilShapeTable, {}, "against_current", ((0.0, 1.0),), None),
    (CoilShapeTable, {}, "gradient_per_m", (0.0, 0.0), None),
    (Interlock, {"maximum": 1.0}, "reading", "x", ""),
    (Interlock, {"reading": "x", "minimum": 1.0}, "maximum", 1.01, 1.0),
    (Interlock, {"reading": "x"}, "minimum", 1.0, None),
    (Interlock, {"reading": "x", "maximum": 1.0}, "longest_silence_s", 2.0, 1.99),
    (RigSensor, A_SENSOR, "name", "a" + "b" * 39, "a" + "b" * 40),
    (RigSensor, A_SENSOR, "name", "a_1", "1a"),
    (RigSensor, A_SENSOR, "name", "coil", "coil_power_W"),
    (RigSensor, A_SENSOR, "address", "x", ""),
    (RigSensor, A_SENSOR, "address", "socket://lab:7", "spy://file"),
    (RigSensor, A_SENSOR, "driver", "lakeshore-475", "lakeshore-999"),
    (RigSensor, A_SENSOR, "uncertainty", 0.0, -0.1),
    (RigSensor, A_SENSOR, "uncertainty_share", 0.5, 0.51),
    (RigSensor, A_SENSOR, "uncertainty_share", 0.0, -0.1),
    (RigSensor, A_SENSOR | {"measures": "field"}, "at_magnet", -0.5, 0.0),
    (RigSensor, A_SENSOR, "at_magnet", 1.0, 0.5),
    (RigSensor, A_SENSOR, "at_rest_degC", None, 20.0),
    (RigSensor, A_SENSOR, "at_rest_A", None, 0.1),
    (Supply, {"driver": "scpi", "limits": SupplyLimits(current_A=1.0, voltage_V=1.0)}, "address", "COM3", ""),
    (
        Supply,
        {"driver": "scpi", "limits": SupplyLimits(current_A=1.0, voltage_V=1.0)},
        "address",
        "socket://lab:7",
        "spy://file",
    ),
    (Supply, {"address": "COM3", "limits": SupplyLimits(current_A=1.0, voltage_V=1.0)}, "driver", "scpi", "spci"),
    (
        Supply,
        {"driver": "scpi", "address": "COM3", "limits": SupplyLimits(current_A=1.0, voltage_V=1.0)},
        "off_below_A",
        1e-9,
        0.0,
    ),
    (CoilRating, {"thermal_time_constant_s": 1.0}, "continuous_current_A", 1e-9, 0.0),
    (CoilRating, {"continuous_current_A": 1.0}, "thermal_time_constant_s", 1e-9, 0.0),
    (Camera, {"source": 0}, "driver", "basler", "bassler"),
    (Camera, A_CAMERA, "exposure_s", 1e-9, 0.0),
    (Camera, A_CAMERA, "gamma", 1e-9, 0.0),
    (Camera, A_CAMERA, "bit_depth", 8, 7),
    (Camera, A_CAMERA, "bit_depth", 16, 17),
    (Camera, A_CAMERA, "frame_rate_Hz", 1e-9, 0.0),
    (Camera, A_CAMERA, "region", (0, 0, 1, 1), (-1, 0, 1, 1)),
    (Camera, A_CAMERA, "region", (0, 0, 1, 1), (0, -1, 1, 1)),
    (Camera, A_CAMERA, "region", (0, 0, 1, 1), (0, 0, 0, 1)),
    (Camera, A_CAMERA, "region", (0, 0, 1, 1), (0, 0, 1, 0)),
    (Camera, A_CAMERA | {"trigger": "software"}, "frame_rate_Hz", None, 10.0),
    (Camera, A_CAMERA, "playback", Playback(), Playback(loop=True)),
    (Camera, A_VIRTUAL_CAMERA, "frame_rate_Hz", 10.0, 0.0),
    (Camera, A_VIRTUAL_CAMERA, "gain", None, 1.0),
    (Camera, {"driver": "opencv", "playback": Playback(picture_a_state=True)}, "source", "frames", "0"),
    (Beam, A_BEAM, "name", "x", ""),
    (Beam, A_BEAM, "material", "x", ""),
    (Beam, A_BEAM, "length_mm", 1.0, 0.99),
    (Beam, A_BEAM, "width_mm", 0.05, 0.049),
    (Beam, A_BEAM, "depth_mm", 0.05, 0.049),
    (Beam, A_BEAM, "density_kg_m3", 20.1, 20.0),
    (Beam, A_BEAM, "density_kg_m3", 0.09, 0.1),
    (Beam, A_BEAM, "density_kg_m3", 0.01, 0.0),
    (Beam, A_BEAM, "poisson_ratio", 0.5, 0.51),
    (Beam, A_BEAM, "poisson_ratio", 0.01, 0.0),
    (Beam, A_BEAM, "measured_with", "x", ""),
    (Magnet, A_MAGNET, "remanence_T", 2.0, 2.01),
    (Magnet, A_MAGNET, "remanence_T", 0.01, 0.0),
    (Magnet, A_MAGNET, "tip_offset_mm", 0.0, -0.1),
    (Magnet, A_MAGNET, "magnetisation_angle_deg", 180.0, 180.1),
    (Magnet, A_MAGNET, "magnetisation_angle_deg", -180.0, -180.1),
    (Magnet, A_MAGNET, "length_mm", 0.05, 0.049),
    (TrueMaterial, A_MATERIAL | {"prony_tau_s": (1.0,)}, "prony_h", (0.1,), (0.0,)),
    (TrueMaterial, A_MATERIAL | {"prony_h": (1.0,)}, "prony_tau_s", (0.1,), (0.0,)),
    (TrueMaterial, A_MATERIAL | {"prony_h": (1.0,)}, "prony_tau_s", (0.1,), (0.1, 0.2)),
    (TrueMaterial, {"parameters": {"mu_Pa": 1e4}}, "model", "neo-hookean", "neo"),
    (TrueMaterial, {"model": "neo-hookean"}, "parameters", {"mu_Pa": 1.0}, {"mu": 1.0}),
    (TrueBench, {}, "magnetisation_angle_deg", 180.0, 180.1),
    (TrueBench, {}, "magnetisation_angle_deg", -180.0, -180.1),
    (TrueBench, {}, "coil_constant_mT_per_A", 1e-9, 0.0),
    *((Optics, {}, name, 0.0, -0.01) for name in ("vignette", "gradient", "lumps", "silicone_transmission")),
    *((Optics, {}, name, 0.99, 1.0) for name in ("vignette", "lumps", "magnet_transmission", "clamp_transmission")),
    *((Optics, {}, name, 1e-9, 0.0) for name in ("full_well_e", "background", "gamma")),
    (Optics, {}, "blur_px", 0.0, -0.1),
    (Optics, {}, "bits", 8, 7),
    (Optics, {}, "bits", 16, 17),
    (Person, {"given_name": "A"}, "family_name", "B", ""),
    (Person, {"family_name": "A"}, "given_name", "B", ""),
]  # fmt: skip


@pytest.mark.parametrize(
    ("model", "others", "key", "good", "bad"),
    BOUNDS,
    ids=[f"{row[0].__name__}.{row[2]}={row[4]!r}"[:60] for row in BOUNDS],
)
def test_the_last_permitted_value_is_read_and_the_next_is_refused(
    model: Any, others: dict[str, Any], key: str, good: Any, bad: Any
) -> None:
    others = {name: value for name, value in others.items() if name != key}
    assert getattr(model(**others, **({} if good is None else {key: good})), key) == good
    with pytest.raises((ValidationError, ValueError)):
        model(**others, **({} if bad is None else {key: bad}))


DEFAULTS: list[tuple[Any, dict[str, Any]]] = [
    (
        Optics,
        {
            **{"blur_px": 1.0, "full_well_e": 10_000.0, "background": 0.85, "vignette": 0.15, "gradient": 0.10},
            **{"lumps": 0.0, "silicone_transmission": 0.06, "magnet_transmission": 0.01, "clamp_transmission": 0.0},
            **{"bits": 8, "gamma": 1.0},
        },
    ),
    (Interlock, {"minimum": None, "maximum": None, "longest_silence_s": 5.0}),
    (RigSensor, {"measures": "other", "at_magnet": 1.0, "uncertainty": None, "uncertainty_share": None}),
    (Settle, {"dwell_s": 0.0}),
    (Ramp, {"down_within_s": 2.0}),
    (RingDown, {"from_A": None, "rate_Hz": None, "repeats": 1}),
    (Currents, {"up_and_down": False, "both_polarities": False}),
    (Playback, {"picture_a_state": False, "loop": False}),
    (Protocol, {"tip_force_N": 0.0, "creep": False, "transients": Transients(frames_per_state=12)}),
    (Beam, {"poisson_ratio": 0.5, "section": "solid", "magnetisation_kA_per_m": (0.0, 0.0), "rest_shape": "measured"}),
    (Magnet, {"tip_offset_mm": 0.0, "magnetisation_angle_deg": 0.0}),
    (TipLoad, {"x_mm": None, "y_mm": 0.0}),
    (Calibration, {"gravity": True, "telecentric": False}),
    (TrueBench, {"magnetisation_angle_deg": 0.0, "cast_bend_mm": 0.0, "taper_mm": 0.0}),
]


@pytest.mark.parametrize(("model", "defaults"), DEFAULTS, ids=[row[0].__name__ for row in DEFAULTS])
def test_a_key_that_is_left_out_has_its_stated_default(model: Any, defaults: dict[str, Any]) -> None:
    # The reference of the file formats states these values, and existing files rely on them.
    if model is Optics:
        assert vars(Optics()) == defaults
    else:
        assert {name: model.model_fields[name].default for name in defaults} == defaults


def specimen(beam: dict[str, Any] | None = None, **tables: Any) -> SpecimenFile:
    return SpecimenFile(specimen=Beam(**A_BEAM | (beam or {})), **tables)


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        (
            {"beam": {"magnetisation_kA_per_m": (960.0, 1280.0)}},
            {"beam": {"magnetisation_kA_per_m": (960.0, 1281.0)}},
            "should be at most 1600",
        ),
        ({"magnet": {"length_mm": 29.9}}, {"magnet": {"length_mm": 30.0}}, r"length_mm = 30 should be less than"),
        ({"magnet": {"tip_offset_mm": 25.9}}, {"magnet": {"tip_offset_mm": 26.0}}, "tip_offset_mm = 26 and"),
        ({"magnet": {"width_mm": 3.0}}, {"magnet": {"width_mm": 3.01}}, r"magnet.width_mm = 3\.01 should be at most"),
        ({"magnet": {"depth_mm": 5.0}}, {"magnet": {"depth_mm": 5.01}}, r"magnet.depth_mm = 5\.01 should be at most"),
        ({"tip_load": {"x_mm": 30.0}}, {"tip_load": {"x_mm": 30.1}}, r"tip_load.x_mm = 30\.1 should be on the beam"),
        ({"tip_load": {"x_mm": 0.1}}, {"tip_load": {"x_mm": 0.0}}, "tip_load.x_mm = 0 should be"),
        ({"tip_load": {"y_mm": -1.5}}, {"tip_load": {"y_mm": -1.51}}, r"tip_load.y_mm = -1\.51 should be"),
        ({"uncertainty": {"width_mm": 0.3}}, {"uncertainty": {"width_mm": 0.31}}, r"should be at most 0\.1 times"),
        ({"uncertainty": {}}, {"uncertainty": {"magnet_width_mm": 0.1}}, "the file has no magnet.width_mm"),
        ({"uncertainty": {}}, {"uncertainty": {"magnetisation_angle_deg": 0.1}}, r"the file has no table \[magnet\]"),
        (
            {"beam": {"width_mm": [[0.0, 3.0], [30.02, 3.0]]}},
            {"beam": {"width_mm": [[0.0, 3.0], [30.04, 3.0]]}},
            r"the table ends at the arc length 30\.04",
        ),
    ],
)  # fmt: skip
def test_the_parts_of_a_specimen_fit_together(good: dict[str, Any], bad: dict[str, Any], words: str) -> None:
    def made(tables: dict[str, Any]) -> SpecimenFile:
        given = {key: value for key, value in tables.items() if key in ("beam", "uncertainty")}
        if "magnet" in tables:
            given["magnet"] = Magnet(**A_MAGNET | tables["magnet"])
        if "tip_load" in tables:
            given["tip_load"] = TipLoad(**tables["tip_load"])
        return specimen(**given)

    made(good)
    with pytest.raises(ValidationError, match=words):
        made(bad)


@pytest.mark.parametrize(("rows", "least"), [
    ([[0.0, 4.0], [30.0, 3.0]], 3.0),
    ([[0.0, 3.0], [30.0, 4.0]], 3.866),
    ([[0.0, 4.0], [28.0, 3.0], [28.0, 5.0], [30.0, 5.0]], 3.0),
    ([[0.0, 4.0], [26.0, 2.0], [26.0, 3.5], [30.0, 3.5]], 3.5),
])  # fmt: skip
def test_a_magnet_fits_into_the_narrowest_part_at_its_place(rows: list[list[float]], least: float) -> None:
    # The magnet is 4 mm long at the tip, from 26 to 30 mm.
    specimen({"width_mm": rows}, magnet=Magnet(**A_MAGNET | {"width_mm": least - 0.001}))
    with pytest.raises(ValidationError, match=r"should be at most specimen\.width_mm"):
        specimen({"width_mm": rows}, magnet=Magnet(**A_MAGNET | {"width_mm": least + 0.001}))


@pytest.mark.parametrize(("offset_mm", "least"), [(0.0, 2.0), (6.0, 2.0), (7.0, 3.0), (12.0, 4.0)])
def test_a_magnet_before_the_tip_is_in_its_part_of_the_beam(offset_mm: float, least: float) -> None:
    # The magnet, 4 mm long, is from 26 to 30 mm, 20 to 24 mm, 19 to 23 mm, or 14 to 18 mm.
    rows = [[0.0, 4.0], [18.0, 4.0], [18.0, 3.0], [23.0, 3.0], [23.0, 2.0], [30.0, 2.0]]
    magnet = A_MAGNET | {"tip_offset_mm": offset_mm}
    specimen({"width_mm": rows}, magnet=Magnet(**magnet | {"width_mm": least - 0.001}))
    with pytest.raises(ValidationError, match=r"should be at most specimen\.width_mm"):
        specimen({"width_mm": rows}, magnet=Magnet(**magnet | {"width_mm": least + 0.001}))


def test_a_specimen_reaches_the_mechanics_in_si_units() -> None:
    tables = {"magnet": Magnet(**A_MAGNET, magnetisation_angle_deg=2.0), "tip_load": TipLoad(y_mm=0.5)}
    made = specimen({"magnetisation_kA_per_m": (40.0, -1.0), "section": "plane-strain"}, **tables).mechanics()
    assert (made.length_mm, made.width_mm, made.depth_mm, made.density_kg_m3) == (30.0, 3.0, 5.0, 1070.0)
    assert (made.section, made.tip_load_mm, made.magnetisation_A_per_m) == ("plane-strain", (30.0, 0.5), (4e4, -1e3))
    assert made.magnet is not None
    assert (made.magnet.remanence_T, made.magnet.magnetisation_angle_deg) == (1.2, 2.0)
    assert made.rest_shape is None
    assert specimen().mechanics().tip_load_mm is None
    assert specimen(tip_load=TipLoad(x_mm=7.0)).mechanics().tip_load_mm == (7.0, 0.0)
    tapered = specimen({"width_mm": [[0.0, 4.0], [30.0, 2.0]], "rest_shape": "straight"})
    assert float(tapered.specimen.width_mm) == 3.0
    shape = tapered.mechanics().rest_shape
    assert shape is not None
    assert shape.widths == ((0.0, 1.0), (1.0, -1.0))
    assert specimen({"rest_shape": "straight"}).mechanics().rest_shape is None


def test_the_uncertainties_of_a_specimen_belong_to_specimen_or_instrument() -> None:
    stated = {"width_mm": 0.01, "density_kg_m3": 5.0, "remanence_T": 0.02}
    made = specimen({"measured_with": "caliper 3"}, magnet=Magnet(**A_MAGNET), uncertainty=stated)
    by_name = {source.source: (source.standard_uncertainty, source.of) for source in made.stated_sources()}
    names = keys_of("specimen")
    assert set(by_name) == {names[key] for key in stated}
    assert by_name[names["width_mm"]] == (0.01, "instrument caliper 3")
    assert by_name[names["density_kg_m3"]] == (5.0, "specimen n")
    assert by_name[names["remanence_T"]] == (0.02, "specimen n")
    assert "magnetisation_angle_deg" in made.uncertain_keys()
    assert "magnetisation_angle_deg" not in specimen().uncertain_keys()
    assert set(specimen().uncertain_keys()) == {"length_mm", "width_mm", "depth_mm", "density_kg_m3"}


# Sizes along the beam


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([[0.0, 3.0]], "at least two rows"),
        ([[0.1, 3.0], [1.0, 3.0]], "the arc length of the first row should be 0"),
        ([[0.0, 3.0], [2.0, 3.0], [1.0, 3.0]], "increasing arc lengths, but 1 follows 2"),
        ([[0.0, 3.0], [1.0, 3.0], [1.0, 4.0], [1.0, 5.0], [2.0, 3.0]], "at most two rows with the same arc length"),
        ([[0.0, 3.0], [1.0, 3.0], [1.0, 4.0]], "only one row with the last arc length"),
        ([[0.0, 3.0, 1.0], [1.0, 3.0]], r"a row of the table should be \[arc length, size\] in mm"),
        ([[0.0, 3.0], 1.0], "a row of the table"),
        ([[0.0, 3.0], ["x", 3.0]], "a row of the table|could not convert"),
        ([[0.0, 3.0], [None, 3.0]], "a row of the table"),
    ],
)
def test_a_wrong_table_of_sizes_is_refused(rows: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        size_along(rows, float)  # type: ignore[arg-type]


def test_a_table_of_sizes_is_its_mean_along_the_beam() -> None:
    size = size_along([[0, 2.0], [1, 2.0], [1, 4.0], [3, 4.0]], float)  # type: ignore[arg-type]
    assert isinstance(size, SizeAlong)
    assert float(size) == pytest.approx(10.0 / 3.0)
    assert written(size) == [[0.0, 2.0], [1.0, 2.0], [1.0, 4.0], [3.0, 4.0]]
    assert (written(2.5), size_along(2.5, float)) == (2.5, 2.5)  # type: ignore[arg-type]


# Currents


def test_the_currents_of_a_run() -> None:
    assert Currents(start_A=0.0, stop_A=0.3, step_A=0.1).set_points_A == (0.0, 0.1, 0.2, 0.3)
    assert Currents(start_A=0.3, stop_A=0.1, step_A=0.1, up_and_down=True).set_points_A == (0.3, 0.2, 0.1, 0.2, 0.3)
    both = Currents(values_A=(0.0, 0.2, 0.1), up_and_down=True, both_polarities=True)
    assert both.set_points_A == (0.0, 0.2, 0.1, 0.2, 0.0, -0.2, -0.1, -0.2)
    assert (both.key_of(-0.2), Currents(start_A=0.0, stop_A=0.4, step_A=0.2).key_of(0.4)) == ("values_A", "stop_A")
    assert Currents(start_A=0.0, stop_A=0.4, step_A=0.2).key_of(0.0) == "start_A"
    turned = Currents(start_A=0.4, stop_A=0.2, step_A=0.2, both_polarities=True)
    assert (turned.key_of(-0.4), turned.key_of(0.4)) == ("start_A", "start_A")
    assert Currents(start_A=0.0, stop_A=99.9, step_A=0.1).set_points_A[-1] == 99.9
    for given, words in (
        ({"start_A": 0.0, "stop_A": 100.0, "step_A": 0.1}, "gives more than 1000 states"),
        ({"start_A": 1.0, "stop_A": 1.0, "step_A": 0.1}, "is equal to start_A"),
        ({"start_A": 0.0, "stop_A": 1.0, "step_A": 0.3}, "does not divide the range"),
        ({"start_A": 0.0, "stop_A": 1.0}, "should have either"),
        ({}, "should have either"),
        ({"values_A": (0.0, 1.0), "step_A": 0.1}, "should have either"),
        ({"values_A": (0.0, -0.1), "both_polarities": True}, r"but one current is -0\.1 A"),
    ):
        with pytest.raises(ValidationError, match=words):
            Currents(**given)  # type: ignore[arg-type]


def test_the_extreme_currents_of_a_run_come_from_their_keys() -> None:
    made = Protocol(
        **A_PROTOCOL,
        conditioning=Conditioning(cycles=1, current_A=-0.5),
        ring_down=RingDown(seconds=1.0, from_A=0.3, rate_Hz=50.0, repeats=3),
    )
    assert made.extremes_A == (
        ("current.start_A", 0.0),
        ("current.stop_A", 0.4),
        ("conditioning.current_A", -0.5),
        ("ring_down.from_A", 0.3),
    )
    assert (made.recordings, made.rate_Hz, made.ring_down_from_A) == (6, 50.0, 0.3)
    plain = Protocol(**A_PROTOCOL)
    assert plain.extremes_A == (("current.start_A", 0.0), ("current.stop_A", 0.4))
    assert (plain.recordings, plain.rate_Hz, plain.ring_down_from_A) == (3, None, 0.4)
    assert Protocol(**A_PROTOCOL, ring_down=RingDown(seconds=1.0)).ring_down_from_A == 0.4
    with pytest.raises(
        ValidationError, match=r"conditioning.current_A goes to -0\.51 A, which exceeds limits.current_A = 0\.5"
    ):
        Protocol(**A_PROTOCOL, conditioning=Conditioning(cycles=1, current_A=-0.51))
    with pytest.raises(ValidationError, match="because creep = true"):
        Protocol(**A_PROTOCOL, creep=True, transients=Transients(frames_per_state=0))
    assert Protocol(**A_PROTOCOL, creep=True, transients=Transients(frames_per_state=1)).creep
    old = Protocol.model_validate({**A_PROTOCOL, "release": RingDown(seconds=7.0)})
    assert old.ring_down is not None
    assert old.ring_down.seconds == 7.0
    assert plain.transients.frames_per_state == 12
    assert plain.ramp.down_within_s == 2.0
    assert SupplyLimits(current_A=1.0, voltage_V=9.0).stricter(
        SupplyLimits(current_A=2.0, voltage_V=5.0)
    ) == SupplyLimits(current_A=1.0, voltage_V=5.0)


# Calibrations


def test_a_calibration_knows_its_field_its_age_and_its_keys() -> None:
    plain, coil = Calibration(**A_CALIBRATION), Calibration(**A_COIL, calibrated_on=date(2026, 1, 2))
    assert (plain.positive_field_deg, coil.positive_field_deg) == (0.0, 0.0)
    assert Calibration(**A_CALIBRATION | {"axis_angle_deg": 10.0}).positive_field_deg == -80.0
    assert (plain.mT_per_A, coil.mT_per_A) == (0.0, 4.0)
    assert plain.age_days(datetime(2026, 1, 3, tzinfo=UTC)) is None
    assert coil.age_days(datetime(2026, 1, 3, 12, tzinfo=UTC)) == 1.5
    assert coil.age_days(datetime(2025, 1, 3, tzinfo=UTC)) == 0.0
    assert "coil_constant_mT_per_A" in coil.uncertain_keys()
    assert "coil_constant_mT_per_A" not in plain.uncertain_keys()
    assert plain.digest == Calibration(**A_CALIBRATION).digest != coil.digest
    assert len(plain.digest) == 64


def test_the_uncertainties_of_a_calibration_are_in_the_units_of_a_fit() -> None:
    # At 8 px/mm, 0.4 px/mm are 5 %, and 2 px are 0.25 mm; 0.1 mT/A of 4 mT/A are 2.5 %.
    stated = {"pixels_per_mm": 0.4, "clamp_midpoint_px": 2.0, "coil_constant_mT_per_A": 0.1, "axis_angle_deg": 0.5}
    made = Calibration(**A_COIL, uncertainty=stated)
    names = keys_of("calibration")
    found = {source.source: (source.standard_uncertainty, source.of) for source in made.stated_sources()}
    sizes = {name: size for name, (size, _) in found.items()}
    assert sizes == {
        names["pixels_per_mm"]: pytest.approx(0.05),
        names["clamp_midpoint_px"]: pytest.approx(0.25),
        names["coil_constant_mT_per_A"]: pytest.approx(0.025),
        names["axis_angle_deg"]: 0.5,
    }
    assert found[names["coil_constant_mT_per_A"]][1] == "coil of 4 mT/A"
    this = found[names["axis_angle_deg"]][1]
    assert this.startswith("calibration ")
    assert len(this) == len("calibration ") + 16
    seen = Calibration(**A_COIL, uncertainty=stated, picture=Picture(polarity="dark"))
    assert {source.of for source in seen.stated_sources()} == {"coil of 4 mT/A", this}


CALIBRATION_TEXT = "# kept\npixels_per_mm = 8.0\ngravity_angle_deg = 90.0\n"


def test_new_values_replace_those_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    path.write_text(CALIBRATION_TEXT + "clamp_midpoint_px = [1.0, 2.0]\n")
    assert missing_places(path, {}) == ("axis_angle_deg",)
    assert missing_places(path, {"axis_angle_deg": 3.0}) == ()
    made = load_calibration(path, {"axis_angle_deg": 3.0, "picture": {"channel": "red", "polarity": "dark"}})
    assert (made.axis_angle_deg, made.pixels_per_mm, made.clamp_midpoint_px) == (3.0, 8.0, (1.0, 2.0))
    assert "axis_angle_deg = 3.0" in made.text
    again = changed_calibration(made, {"picture": {"beam_colour": (1.0, 2.0, 3.0)}})
    assert again.picture == Picture(polarity="dark", beam_colour=(1.0, 2.0, 3.0))
    assert changed_calibration(made, {"picture": {"polarity": "bright"}}).picture == Picture(
        channel="red", polarity="bright"
    )
    assert changed_calibration(made, {"pixels_per_mm": 9.0}).picture == made.picture
    path.write_text(CALIBRATION_TEXT + "coil_constant_mT_per_A = 4.0\nfield_angle_deg = 300.0\n")
    assert missing_places(path, {}) == ("clamp_midpoint_px", "axis_angle_deg")
    path.write_text(CALIBRATION_TEXT + "axis_angle_deg = 7.0\n")
    assert missing_places(path, {}) == ("clamp_midpoint_px",)
    path.write_text(CALIBRATION_TEXT + "axis_angle_deg = 7.0\nclamp_midpoint_px = [0.0, 0.0]\n")
    kept = load_calibration(path)
    assert kept.text.startswith("# kept")
    path.write_text("pixels_per_mm = -8.0\n")
    with pytest.raises(InputError, match="pixels_per_mm"):
        missing_places(path, {})


def map_rows(xs: int, ys: int) -> tuple[tuple[float, float, float, float], ...]:
    return tuple((10.0 * x, 5.0 * y, 1.0 * x, 2.0 * y) for x in range(xs) for y in range(ys))


def test_a_map_of_the_field_is_a_grid_with_at_least_four_lines(tmp_path: Path) -> None:
    made = CoilShapeTable(map=map_rows(4, 5))
    grid = made._grid()
    assert grid.covers(np.array([[30.0, 20.0]]))
    assert not grid.covers(np.array([[30.1, 20.0]]))
    assert made.is_uneven
    assert not CoilShapeTable(against_current=((0.0, 1.0),)).is_uneven
    for rows, words in (
        (map_rows(3, 5), "map has 15 rows with 3 different x and 5 different y"),
        (map_rows(5, 3), "at least 4 different x and 4 different y"),
        (map_rows(4, 4)[:-1], "map has 15 rows with 4 different x and 4 different y"),
    ):
        with pytest.raises(ValidationError, match=words):
            CoilShapeTable(map=rows)
    with pytest.raises(ValidationError, match="has both radius_mm and map"):
        CoilShapeTable(map=map_rows(4, 4), radius_mm=1.0, gap_mm=1.0)
    (tmp_path / "map.csv").write_text("x_mm, y_mm, bx_mT, by_mT\n0, 1, 2, 3.5\n")
    table: dict[str, Any] = {"field": {"map": "map.csv", "gradient_per_m": [1.0, 0.0]}}
    assert with_rows_of_map(table, tmp_path / "calibration.toml")
    assert table["field"] == {"map": [[0.0, 1.0, 2.0, 3.5]], "gradient_per_m": [1.0, 0.0]}
    for untouched in ({}, {"field": 3}, {"field": {"map": [[1.0]]}}):
        assert not with_rows_of_map(untouched, tmp_path / "calibration.toml")
    header = "x_mm,y_mm,bx_mT,by_mT\n"
    (tmp_path / "map.csv").write_text(f"\ufeff{header}0,1,2,3\n", encoding="utf-8")  # as some spreadsheets write it
    assert with_rows_of_map(table := {"field": {"map": "map.csv"}}, tmp_path / "calibration.toml")
    assert table["field"] == {"map": [[0.0, 1.0, 2.0, 3.0]]}
    for content, words in (
        (f"{header}0,1,2,3\n0,1,x,3\n", "row 3: bx_mT = 'x' should be a number"),
        (f"{header}0,-20,0,4,7\n", "row 2: has 5 cells, but the header has 4 columns"),  # 4,7 with a decimal comma
        ("x,y,bx_mT,by_mT\n", "row 1: 'x' is not a known column"),
    ):
        (tmp_path / "map.csv").write_text(content)
        with pytest.raises(InputError, match=rf"map\.csv: {words}"):
            with_rows_of_map({"field": {"map": "map.csv"}}, tmp_path / "c.toml")


def test_the_shape_of_the_field_reaches_the_simulation() -> None:
    beam = specimen(magnet=Magnet(**A_MAGNET)).mechanics()
    plain = CoilShapeTable(gradient_per_m=(1.0, -2.0)).shape(beam, 90.0)
    assert plain.axis == pytest.approx((0.0, 1.0))
    assert (plain.gradient_per_m, plain.table) == ((1.0, -2.0), None)
    loops = CoilShapeTable(radius_mm=60.0, gap_mm=60.0).shape(beam, 0.0)
    assert loops.table is not None
    assert loops.table.covers(np.array([[1.14 * 30.0, 0.0]]))
    with pytest.raises(ValueError, match="the field map does not cover the magnet at rest, x_mm = 28, y_mm = 0"):
        CoilShapeTable(map=tuple((x - 50.0, y, u, v) for x, y, u, v in map_rows(4, 4))).shape(beam, 90.0)
    with pytest.raises(ValueError, match="the field map has no field at the magnet at rest, x_mm = 28, y_mm = 0"):
        CoilShapeTable(map=tuple((x, y, 0.0, 0.0) for x, y, _, _ in map_rows(4, 4))).shape(beam, 90.0)
    assert CoilShapeTable(map=map_rows(4, 4)).shape(beam, 90.0) is not None


# Rigs


def test_no_sensor_can_have_the_name_of_a_reading_of_the_supply() -> None:
    # A sensor has a name of small letters; the readings of the supply end in a capital letter.
    assert all(name != name.lower() for name in READINGS)


def test_the_power_of_the_coil_is_current_times_voltage() -> None:
    measured = SimpleNamespace(voltage_V=3.0, current_A=0.5)
    assert {name: read(measured) for name, read in READINGS.items()} == {  # type: ignore[arg-type]
        "coil_current_A": 0.5,
        "coil_voltage_V": 3.0,
        "coil_power_W": 1.5,
    }
    both = Interlock(reading="probe", minimum=-1.0, maximum=2.5, longest_silence_s=3.0)
    assert both.in_words == "probe at least -1 and at most 2.5, read at least every 3 s"
    check_readings([both], ["x", "probe"])
    with pytest.raises(ValueError, match=r"interlocks\.1\.reading = 'probe' is not a reading; the readings are prob"):
        check_readings([Interlock(reading="prob", maximum=1.0), both], ["prob"])


COIL = {
    "name": "coil",
    "driver": "coil-resistance",
    "address": "supply",
    "measures": "coil_temperature",
    "at_rest_degC": 20.0,
    "at_rest_A": 0.1,
}


def test_the_coil_as_thermometer_needs_all_its_keys() -> None:
    assert RigSensor(**COIL).is_coil  # type: ignore[arg-type]
    for change in ({"at_rest_degC": None}, {"at_rest_A": None}, {"address": "COM3"}, {"measures": "other"}):
        with pytest.raises(ValidationError, match='driver = "coil-resistance" needs address = "supply"'):
            RigSensor(**COIL | change)  # type: ignore[arg-type]
    for good, bad, key in ((-49.9, -50.0, "at_rest_degC"), (99.9, 100.0, "at_rest_degC"), (1e-9, 0.0, "at_rest_A")):
        assert RigSensor(**COIL | {key: good})  # type: ignore[arg-type]
        with pytest.raises(ValidationError):
            RigSensor(**COIL | {key: bad})  # type: ignore[arg-type]


def test_the_sensors_of_a_rig_agree() -> None:
    real = RigSensor(**A_SENSOR)  # type: ignore[arg-type]
    second = RigSensor(**A_SENSOR | {"name": "second"})  # type: ignore[arg-type]
    field = [RigSensor(**A_SENSOR | {"name": name, "measures": "field"}) for name in ("a", "b")]  # type: ignore[arg-type]
    virtual = RigSensor(**A_SENSOR | {"address": "virtual", "measures": "field"})  # type: ignore[arg-type]
    other = RigSensor(**A_SENSOR | {"address": "virtual"})  # type: ignore[arg-type]
    coil = RigSensor(**COIL)  # type: ignore[arg-type]
    check_sensors([real, second, coil], False)
    check_sensors([virtual, coil], True)
    for sensors, simulated, words in (
        ([real, real], False, r"^sensors\.1\.name = 'probe': another sensor has this name"),
        (field, False, r'^sensors\.1\.measures = "field": the sensor a already measures'),
        ([virtual], False, r"^sensors\.0\.address = 'virtual' should be the address of an instrument"),
        ([real], True, r"^sensors\.0\.address = 'COM3' should be \"virtual\", because this rig is simulated"),
        ([other], True, r"^sensors\.0: a sensor of the virtual rig should have one of the drivers"),
    ):
        with pytest.raises(ValueError, match=words):
            check_sensors(sensors, simulated)


def test_a_rate_is_set_only_where_nothing_else_sets_the_pace() -> None:
    free = Camera(**A_CAMERA)  # type: ignore[arg-type]
    assert free.at_rate(50.0).frame_rate_Hz == 50.0
    assert free.at_rate(None) is free
    for other in (
        Camera(**A_CAMERA, frame_rate_Hz=10.0),  # type: ignore[arg-type]
        Camera(**A_CAMERA, trigger="Line1"),  # type: ignore[arg-type]
        Camera(driver="opencv", source="frames"),
    ):
        assert other.at_rate(50.0) is other
    assert Camera(driver="opencv", source=0).at_rate(50.0).frame_rate_Hz == 50.0
    full = {
        "exposure_s": 0.01,
        "gain": 2.0,
        "gamma": 1.1,
        "region": (0, 1, 2, 3),
        "bit_depth": 12,
        "pixel_format": "Mono12",
    }
    assert Camera(**A_CAMERA, **full, trigger="software").settings.chosen() == {**full, "trigger": "software"}  # type: ignore[arg-type]
    limits = SupplyLimits(current_A=1.0, voltage_V=9.0)
    assert Supply(driver="scpi", address="COM3", limits=limits, off_below_A=0.03).opened_with == Limits(1.0, 9.0, 0.03)


@pytest.mark.parametrize("key", ["frame_size_px", "mesh"])
def test_the_numbers_of_a_virtual_camera_are_positive(key: str) -> None:
    virtual = load_rig("virtual").virtual
    assert virtual is not None
    table = virtual.model_dump() | {"materials": virtual.materials}
    good = (1,) * len(table[key])
    assert getattr(Virtual(**table | {key: good}), key) == good
    for place in range(len(good)):
        bad = tuple(0 if at == place else 1 for at in range(len(good)))
        with pytest.raises(ValidationError, match=f"{key} = .* should be numbers above 0"):
            Virtual(**table | {key: bad})


# Uncertainties


def test_an_uncertainty_is_compared_with_its_quantity() -> None:
    check_sizes({"a": 0.1, "free": 99.0}, {"a": ("x.a", 1.0)})
    check_sizes({"a": 0.5}, {"a": ("x.a", 1.0)}, largest=0.5)
    with pytest.raises(ValueError, match=r"\[uncertainty\] a = 0\.11 should be at most 0\.1 times x\.a = 1$"):
        check_sizes({"a": 0.11}, {"a": ("x.a", 1.0)})
    with pytest.raises(ValueError, match=r"\[uncertainty\] a = 0\.1: the file has no x\.a"):
        check_sizes({"a": 0.1}, {"a": ("x.a", None)})
    assert missing_keys("the file", None, ["a"]) == ("the file",)
    assert missing_keys("the file", {"a": 0.0}, ["a", "b"]) == ("b",)
    assert stated_sources("rig", None, str, {}) == ()
    for file, key in (("specimen", "width_mn"), ("calibration", "pixel_per_mm")):
        model: Any = SpecimenFile if file == "specimen" else Calibration
        given = {"specimen": Beam(**A_BEAM)} if file == "specimen" else A_CALIBRATION
        with pytest.raises(ValidationError, match=f"{key} is not a known key; did you mean"):
            model(**given, uncertainty={key: 0.1})
        with pytest.raises(ValidationError, match="should be a standard uncertainty"):
            model(**given, uncertainty={key.replace("mn", "mm").replace("pixel_", "pixels_"): -0.1})


def test_the_uncertainty_of_the_current_is_one_of_the_field() -> None:
    (source,) = stated_by_rig('name = "bench"\n[uncertainty]\ncurrent_A = 0.01\n', "rig", 4.0)
    assert (source.source, source.standard_uncertainty, source.of) == (
        keys_of("rig")["current_A"],
        pytest.approx(0.04),
        "supply of bench",
    )
    assert stated_by_rig('name = "bench"\n', "rig", 4.0) == ()


# TOML and JSON


def test_tables_become_text_that_gives_the_same_tables() -> None:
    table = {
        "name": 'a "b" µ',
        "on": True,
        "day": date(2026, 1, 2),
        "list": [[1.0, 2], []],
        "inner": {"x": 1, "deep": {"y": 2}},
        "rows": [{"a": 1, "t": {"u": 3}}, {"a": 2}],
        "last": 5,
    }
    text = table_text(table)
    assert toml.tomllib.loads(text) == table
    assert text.index("last = 5") < text.index("[inner]") < text.index("[inner.deep]") < text.index("[[rows]]")


def test_changed_keys_are_named_with_both_values() -> None:
    before = 'a = 1\nb = 2\n[t]\nx = "y"\n'
    assert differences(before, "b = 3\nc = [1, 2]\na = 1\n[t]\nx = true\n") == (
        "b was 2, and is 3 now",
        "c was absent, and is [1, 2] now",
        't.x was "y", and is true now',
    )
    assert differences(before, before + "# comment\n") == ()


@pytest.mark.parametrize(("dots", "fits"), [(1000, True), (1001, False)])
def test_a_key_has_at_most_1001_parts(dots: int, fits: bool) -> None:
    assert toml._longest_key("a = 1.5") == 0
    assert toml._longest_key("[a.b.c]") == 2
    assert toml._longest_key("x = {a.b = 1, c.d.e = 2}") == 2
    for line in ("a" + ".a" * dots + " = 1", "[a" + ".a" * dots + "]"):
        assert toml._longest_key(line) == dots
        if fits:
            assert "a" in toml.parse_table(line, "x.toml")
        else:
            with pytest.raises(InputError, match="a key has more than 1000 parts"):
                toml.parse_table(line, "x.toml")


def denied(*_: Any, **__: Any) -> Any:
    raise PermissionError("denied")


def test_faults_of_text_files_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.toml"
    for content, words in (
        (b"x = 1,5\ny = 2\n", r"a\.toml: is not valid TOML: .*; line 1: x = 1,5 has a decimal comma; write 1\.5$"),
        (b"\n[t]\ny = -2,25 # c\n", r"; line 3: y = -2,25 has a decimal comma; write -2\.25$"),
        (b"x = [1,5\n", r"a\.toml: is not valid TOML: [^;]*$"),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=words):
            toml.parse_table(read_text(path), path)
    path.write_bytes(b"ab\xff")
    with pytest.raises(InputError, match=r"a\.toml: is not text in UTF-8 \(byte 2\); save it with the encoding UTF-8$"):
        read_text(path)
    path.write_bytes(b"\x89HDF\r\n\x1a\n")
    with pytest.raises(InputError, match=r"a\.toml: is a dataset \(HDF5\), but a text file is needed here"):
        read_text(path)
    assert toml.is_dataset(path)
    path.write_bytes(b"\x89HDF\r\n\x1a")
    assert not toml.is_dataset(path)
    assert toml.is_dataset(tmp_path) is False
    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", denied)
        assert toml.is_dataset(path) is False
    with pytest.raises(InputError, match="is a folder, a device or a pipe, not a file"):
        read_text(tmp_path)
    with pytest.raises(InputError, match=r"b\.toml: cannot be read \(No such file"):
        read_text(tmp_path / "b.toml")


def test_a_shipped_file_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert locate("type1", "specimens") == locate("type1.toml", "specimens")
    assert locate("virtual", "rigs").name == "virtual.toml"
    (tmp_path / "type1").write_text("own")
    assert locate("type1", "specimens") == Path("type1")
    (tmp_path / "folder").mkdir()
    for name, words in (
        ("folder", "^folder: is a folder, not a TOML file$"),
        ("x/type1", "no such file, and no shipped file of that name; the shipped files are .*type1"),
        ("type2.csv", "no such file"),
    ):
        with pytest.raises(InputError, match=words):
            locate(name, "specimens")


FAULTS = [
    ("name = 3", r"name = 3 should be a valid string"),
    ("nane = 'x'", r"nane is not a known key; did you mean name\?"),
    ("[current]\nstart = 0", r"current\.start is not a known key; did you mean start_A\?"),
    ("[zzz]\nqq = 0", r"zzz is not a known key; the known keys are name, material"),
    ("[current]\nvalues_A = 3", r"current\.values_A = 3 should be a list in square brackets"),
    ("creep = 'x'", r"creep = 'x' should be a valid boolean"),
    ("frames_per_state = true", r"frames_per_state = true should be a valid integer"),
    ("[material]\nx = 1", r"material = a table should be a valid string"),
    ("current = 'x'", r"current = 'x' should be"),
]


@pytest.mark.parametrize(("line", "words"), FAULTS)
def test_the_fault_of_a_protocol_is_one_line(line: str, words: str) -> None:
    protocol = read_text(locate("dragon_skin_10"))
    table = toml.tomllib.loads(protocol)
    for key, value in toml.tomllib.loads(line).items():
        table[key] = table[key] | value if isinstance(value, dict) and isinstance(table.get(key), dict) else value
    with pytest.raises(InputError, match=f"^p: {words}") as caught:
        toml.check(Protocol, table, "", "p")
    assert "\n" not in str(caught.value)


def test_missing_keys_and_files_of_another_kind_are_named() -> None:
    protocol = toml.tomllib.loads(read_text(locate("dragon_skin_10")))
    without = {key: value for key, value in protocol.items() if key not in ("name", "settle")}
    with pytest.raises(InputError, match=r"^p: name, the table \[settle\] are missing$"):
        toml.check(Protocol, without, "", "p")
    with pytest.raises(InputError, match=r"^p: name is missing$"):
        toml.check(Protocol, {key: value for key, value in protocol.items() if key != "name"}, "", "p")
    with pytest.raises(InputError, match=r"^s: is a specimen, but a protocol is needed here$"):
        toml.check(Protocol, {"specimen": {}}, "", "s")
    with pytest.raises(InputError, match=r"^s: is a protocol, but a specimen is needed here$"):
        toml.check(SpecimenFile, protocol, "", "s")
    with pytest.raises(
        InputError,
        match=r"^c: clamp_midpoint_px = \[1\.0, 2\.0, 3\.0, 4\.0\] should have at most 2 values, not 4; decimals",
    ):
        toml.check(Calibration, A_CALIBRATION | {"clamp_midpoint_px": [1.0, 2.0, 3.0, 4.0]}, "", "c")
    with pytest.raises(InputError, match=r"^c: clamp_midpoint_px should have more than 1 values$"):
        toml.check(Calibration, A_CALIBRATION | {"clamp_midpoint_px": [1.0]}, "", "c")
    with pytest.raises(InputError, match=r"^c: clamp_midpoint_px = a list should have at most 2 values, not 21$"):
        toml.check(Calibration, A_CALIBRATION | {"clamp_midpoint_px": [1.0] * 21}, "", "c")
    with pytest.raises(InputError, match=r"^c: picture\.polarity = 'grey' should be 'dark' or 'bright'$"):
        toml.check(Calibration, A_CALIBRATION | {"picture": {"polarity": "grey"}}, "", "c")
    with pytest.raises(InputError, match=r"^c: \[picture\] has both channel and beam_colour"):
        toml.check(
            Calibration, A_CALIBRATION | {"picture": {"channel": "red", "beam_colour": [0.0, 0.0, 0.0]}}, "", "c"
        )
    assert load_protocol("dragon_skin_10").text == read_text(locate("dragon_skin_10"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[NaN]", "NaN should be a finite number"),
        ("[-Infinity]", "-Infinity should be a finite number"),
        ("[1e999]", "1e999 should be a finite number"),
        ("1" + "0" * 300, r"^10000000000000000000\.\.\. of 301 digits should be a number of at most 300 digits"),
        ('{\n"a" 1}', "^line 2: is not JSON"),
        ("[" * 100_000, "nested too deeply"),
    ],
)
def test_unusable_json_is_refused(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse_json(text)


def test_usable_json_is_read() -> None:
    assert parse_json('{"a": [1, 2.5, "x"]}') == {"a": [1, 2.5, "x"]}
    assert parse_json("1" * 300) == int("1" * 300)


@pytest.mark.parametrize(
    ("text", "form"),
    [
        ("0000-0002-1825-0097", "0000-0002-1825-0097"),  # the example of orcid.org
        ("https://orcid.org/0000000218250097", "0000-0002-1825-0097"),
        ("0000-0002-1694-233X", "0000-0002-1694-233X"),
        ("0000-0002-1825-0098", None),
        ("0000-0002-1694-2330", None),
        ("0000-0002-1825-009", None),
        ("0000-0002-1825-00970", None),
        ("000X-0002-1825-0097", None),
        ("0000-0002-1825-009Y", None),
    ],
)
def test_the_check_digit_of_an_orcid(text: str, form: str | None) -> None:
    if form is None:
        with pytest.raises(ValidationError, match=r"orcid|ORCID"):
            Person(given_name="A", family_name="B", orcid=text)
    else:
        assert Person(given_name="A", family_name="B", orcid=text).orcid == form


@pytest.mark.parametrize(
    ("material", "g", "values"),
    [
        ({}, None, (1e4,)),
        ({"prony_h": (1.0, 2.0), "prony_tau_s": (0.1, 1.0)}, (0.25, 0.5), (1e4,)),
    ],
)
def test_a_true_material_gives_its_series(material: dict[str, Any], g: tuple[float, ...] | None, values: Any) -> None:
    # h are the ratios to the relaxed modulus; the shares of the instantaneous modulus are h / (1 + sum of h).
    made = TrueMaterial(**A_MATERIAL | material)  # type: ignore[arg-type]
    assert made.values == values
    if g is None:
        assert made.series is None
    else:
        assert made.series is not None
        assert made.series.g == pytest.approx(g)
        assert made.series.tau_s == pytest.approx((0.1, 1.0))


# Columns of tables


@pytest.mark.parametrize(
    "columns",
    [TIME_COLUMNS, POINT_COLUMNS, FRAME_COLUMNS, LOAD_COLUMNS, STATE_COLUMNS, UNTIL_COLUMNS, COLUMNS, OPTIONAL_COLUMNS],
)
def test_each_column_is_described_by_a_sentence_and_an_example(columns: dict[str, Any]) -> None:
    for name, column in columns.items():
        assert column.meaning.endswith("."), name
        assert " " in column.meaning
        assert " " not in column.example
        assert not column.example.endswith(".")
        if name.endswith(("_mm", "_s", "_A", "_N", "_deg", "_mT", "_degC")) or name in ("state",):
            assert math.isfinite(float(column.example))
    assert "state" not in POINT_COLUMNS


def test_a_rig_needs_its_files(tmp_path: Path) -> None:
    for name, words in (
        ("3", "calibration should be the name of a file"),
        ("'no.toml'", "calibration = 'no.toml': there is no such file"),
    ):
        (tmp_path / "rig.toml").write_text(f"calibration = {name}\n")
        with pytest.raises(InputError, match=rf"rig\.toml: {words} "):
            load_rig(tmp_path / "rig.toml")
