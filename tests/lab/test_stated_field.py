"""The field of the coil is read from calibration.toml, and contradictory or impossible fields are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.beam.coil_field import CoilShape, FieldTable
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.materials import TrueMaterials
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.state import State
from eimi_lab.fits.before_search import check_states
from eimi_lab.process.errors import InputError
from eimi_lab.virtual.virtual_rig import open_virtual_rig
from eimi_lab.vision.field_at_beam import stated_background_T, stated_coil

CALIBRATION = """
pixels_per_mm = 25.0
coil_constant_mT_per_A = 4.7
clamp_midpoint_px = [640.0, 80.0]
axis_angle_deg = 90.0
gravity_angle_deg = 90.0
field_angle_deg = 0.0
telecentric = true
"""


@pytest.mark.parametrize("field_deg", [0.0, -60.0, 60.0, 240.0, 120.0])
def test_a_field_at_exactly_30_or_150_degrees_to_the_beam_is_accepted(field_deg):
    text = CALIBRATION.replace("field_angle_deg = 0.0", f"field_angle_deg = {field_deg}")
    assert parse(Calibration, text, "calibration.toml").field_angle_deg == field_deg


@pytest.mark.parametrize("field_deg", [60.01, -60.01, 119.99])
def test_a_field_at_a_smaller_angle_to_the_beam_is_refused(field_deg):
    text = CALIBRATION.replace("field_angle_deg = 0.0", f"field_angle_deg = {field_deg}")
    with pytest.raises(InputError, match="at least 30 degrees from axis_angle_deg = 90"):
        parse(Calibration, text, "calibration.toml")


def test_the_loops_of_a_coil_lie_across_the_beam_and_a_background_field_is_rotated_to_the_beam_frame():
    field = "background_field_mT = [0.01, 0.04]\n[field]\nradius_mm = 60.0\ngap_mm = 60.0\n"
    calibration = parse(Calibration, CALIBRATION + field, "calibration.toml")
    # The beam hangs: right in the picture is across the beam, down is along it.
    assert stated_background_T(calibration) == pytest.approx([4e-5, 1e-5])
    coil = stated_coil(calibration, load_specimen("type1").mechanics())
    assert coil is not None
    assert coil.axis == pytest.approx((0.0, 1.0))
    q, first, _ = coil.ratio(np.array([[28.0, 0.0], [13.0, 0.0]]), np.array([28.0, 0.0]))
    assert q[0] == pytest.approx(1.0)
    assert first[0] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert 0.98 < q[1].real < 0.9995


@pytest.mark.parametrize(
    ("field", "expected"),
    [
        ("radius_mm = 60.0", "radius_mm and gap_mm belong together"),
        ("centre_mm = [0.0, 0.0]", "centre_mm is the centre of the loops"),
        ("", "has no shape of the field; give radius_mm and gap_mm (two loops), or map, or"),
        ("map = [[0.0, 0.0, 0.0, 1.0]]", "map has 1 rows with 1 different x and 1 different y"),
        ("radius_mm = 60.0\ngap_mm = 60.0\nmap = [[0.0, 0.0, 0.0, 1.0]]", "has both radius_mm and map"),
    ],
)
def test_contradictory_keys_of_the_field_are_refused_in_one_line(field, expected):
    with pytest.raises(InputError) as raised:
        parse(Calibration, f"{CALIBRATION}[field]\n{field}\n", "calibration.toml")
    assert expected in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_loop_through_the_beam_is_refused():
    text = CALIBRATION + "[field]\nradius_mm = 20.0\ngap_mm = 0.0\n"
    with pytest.raises(InputError, match="a coil loop of radius 20 mm lies"):
        stated_coil(parse(Calibration, text, "calibration.toml"), load_specimen("type1").mechanics())


def test_a_measured_map_of_the_field_is_read_from_its_file_and_stored_in_the_text(tmp_path):
    places = [(x, y) for x in (-10.0, 0.0, 20.0, 40.0) for y in (-40.0, -10.0, 10.0, 40.0)]
    rows = "".join(f"{x},{y},{1e-3 * 2.0 * y},{1.0 + 1e-3 * 2.0 * (x - 28.0)}\n" for x, y in places)
    (tmp_path / "field.csv").write_text("x_mm,y_mm,bx_mT,by_mT\n" + rows, encoding="utf-8")
    (tmp_path / "calibration.toml").write_text(CALIBRATION + '[field]\nmap = "field.csv"\n', encoding="utf-8")
    calibration = load_calibration(tmp_path / "calibration.toml")
    stored = parse(Calibration, calibration.text, "dataset")
    coil = stated_coil(stored, load_specimen("type1").mechanics())
    assert coil is not None
    # The table is linear in the position: the relative field has a gradient of 2 per metre along the beam, and no curl.
    _, first, second = coil.ratio(np.array([[25.0, 10.0]]), np.array([28.0, 0.0]))
    assert first[0] == pytest.approx([2e-3, -2e-3j], abs=1e-9)
    assert second == pytest.approx(0.0, abs=1e-9)
    (tmp_path / "field.csv").write_text("x,y,bx,by\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"field\.csv: row 1: 'x' is not a known column; the known columns are x_mm"):
        load_calibration(tmp_path / "calibration.toml")


def test_a_map_that_ends_before_the_tip_is_refused():
    beam = replace(load_specimen("type1").mechanics(), section="plane-stress")
    places = np.linspace(0.0, 29.0, 5)
    table = FieldTable(places, places - 15.0, np.ones((5, 5, 2)))
    loads = replace(Loads.along([0.0, 5.0]), coil=CoilShape((0.0, 1.0), table=table))
    tip = np.array([[30.0, -1.5], [30.0, 1.5]])[:, None]
    observed = EdgeObservation(np.stack([tip, tip + np.array([-3.0, 9.0])]), np.full((2, 2, 1), 0.01))
    states = (State(0, 0.0, 0.0, 0.0, 0.0, ()), State(1, 1.0, 1.0, 5.0, 0.0, ()))
    with pytest.raises(
        InputError, match=r"the tip reaches x_mm = 30, y_mm = 0, but the field of calibration\.field is"
    ):
        check_states(Path("run.h5"), Experiment(BeamModel(beam), loads, observed), states)


def outline_mm(bench: str = "", calibration: str = CALIBRATION) -> np.ndarray:
    # Return the outline of the virtual beam at 1 A: n points, shape (n, 2), in mm.
    # bench: TOML text with the hidden errors of the virtual bench. calibration: text of calibration.toml.
    rig = load_rig("virtual")
    silicone = '[silicone."Dragon Skin 10"]\nmodel = "neo-hookean"\nparameters = { mu_Pa = 46390.0 }\n'
    assert rig.virtual is not None
    virtual = rig.virtual.model_copy(
        update={"materials": parse(TrueMaterials, silicone + bench, "materials.toml"), "mesh": (8, 1, 1)}
    )
    rig = rig.model_copy(update={"virtual": virtual, "calibration": parse(Calibration, calibration, "calibration")})
    _, camera, _, truth = open_virtual_rig(rig, load_specimen("type1"))
    assert ("bench" in truth) == bool(bench)
    return camera._beam.outlines_mm(4.7)[0]


def test_a_virtual_bench_obeys_its_files_and_its_hidden_differences():
    plain = outline_mm()
    coil = "[field]\nradius_mm = 50.0\ngap_mm = 20.0\n"
    stated = outline_mm(calibration=CALIBRATION + coil)
    hidden = outline_mm("[bench.field]\nradius_mm = 50.0\ngap_mm = 20.0\n")
    assert stated == pytest.approx(hidden, abs=1e-9)
    assert np.abs(stated - plain).max() > 0.01
    tilted = outline_mm("[bench]\nmagnetisation_angle_deg = 3.0\n")
    assert np.abs(tilted - plain).max() > 0.1
    earth = outline_mm("[bench]\nbackground_field_mT = [0.04, 0.0]\n")
    assert 0.01 < np.abs(earth - plain).max() < 0.3
