"""The values in the table [uncertainty] of a file widen the interval of a fit, and wrong keys are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.laws import LAWS
from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.rig import load_rig
from eimi_lab.config.rig_uncertainty import stated_by_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.process.errors import InputError
from eimi_lab.virtual.simulation import simulate

PROTOCOLS = Path(__file__).parents[2] / "protocols"


def text_of(name: str, table: str = "") -> str:
    # Return the text of a file that the program contains, with `table` in place of its table [uncertainty].
    before, _, _ = (PROTOCOLS / name).read_text(encoding="utf-8").partition("[uncertainty]")
    return before + (f"[uncertainty]\n{table}\n" if table else "")


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ("widht_mm = 0.02", "[uncertainty] widht_mm is not a known key; did you mean width_mm?"),
        ("width_mm = -0.02", "width_mm = -0.02 should be a standard uncertainty: 0 (exact) or a number above 0"),
        ("width_mm = 2.0", "beam.toml: [uncertainty] width_mm = 2 should be at most 0.1 times specimen.width_mm = 3"),
        (
            "magnet_depth_mm = 1",
            "beam.toml: [uncertainty] magnet_depth_mm = 1 should be at most 0.1 times magnet.depth_mm =",
        ),
        ("taper_mm = 20", "[uncertainty] taper_mm = 20 should be at most 0.5 times specimen.width_mm = 3"),
        ("rest_shape_mm = 60", "rest_shape_mm = 60 should be at most 0.5 times specimen.length_mm ="),
        ("magnet_tip_offset_mm = 60", "magnet_tip_offset_mm = 60 should be at most 0.5 times specimen.length_mm ="),
        ("magnet_depth = 1", "beam.toml: [uncertainty] magnet_depth is not a known key; did you mean magnet_depth_mm?"),
        ("width_mm = nan", "width_mm = nan should be a finite number"),
        ("width_mm = '0.02'", "uncertainty.width_mm = '0.02' should be a valid number"),
        ("pixels_per_mm = 0.1", "pixels_per_mm is not a known key"),
    ],
)
def test_a_wrong_uncertainty_is_refused_in_one_line(table, expected):
    with pytest.raises(InputError) as raised:
        parse(SpecimenFile, text_of("specimens/type1.toml", table), "beam.toml")
    assert str(raised.value).startswith("beam.toml: ")
    assert expected in str(raised.value)
    assert "\n" not in str(raised.value)


def test_an_uncertainty_of_a_missing_input_is_refused():
    telecentric = text_of("rigs/virtual_calibration.toml", "stand_off_mm = 1.0")
    with pytest.raises(InputError, match=r"\[uncertainty\] stand_off_mm = 1: the file has no stand_off_mm; leave this"):
        parse(Calibration, telecentric, "calibration.toml")
    beam, _, _ = text_of("specimens/type1.toml").partition("[magnet]")
    with pytest.raises(
        InputError, match=r"\[uncertainty\] remanence_T = 0.01: the file has no magnet.remanence_T; leave this"
    ):
        parse(SpecimenFile, beam + "[uncertainty]\nremanence_T = 0.01\n", "beam.toml")


def test_relative_uncertainties_and_pixels_are_converted_for_the_inference():
    calibration = parse(
        Calibration,
        text_of(
            "rigs/virtual_calibration.toml",
            "pixels_per_mm = 0.1\ncoil_constant_mT_per_A = 0.047\nclamp_midpoint_px = 0.5",
        ),
        "calibration.toml",
    )
    sizes = {stated.source: stated.standard_uncertainty for stated in calibration.stated_sources()}
    assert sizes == pytest.approx({"scale": 0.1 / 25, "coil": 0.01, "clamp": 0.5 / 25})
    rig = (PROTOCOLS / "rigs" / "bench_example.toml").read_text(encoding="utf-8")
    (current,) = stated_by_rig(rig, "rig.toml", 4.7)
    assert (current.source, current.standard_uncertainty) == ("offset", pytest.approx(0.003 * 4.7))


def test_datasets_share_an_error_if_names_and_numbers_in_their_files_are_equal():
    def of(text: str) -> dict[str, str]:
        return {s.source: s.of for s in parse(SpecimenFile, text, "beam.toml").stated_sources()}

    text = text_of("specimens/type1.toml", "width_mm = 0.02\nremanence_T = 0.01")
    first, second = of(text), of(text.replace('"type1"', '"type2"'))
    assert first["width"] != second["width"]
    with_caliper = text.replace('name = "type1"', 'name = "type1"\nmeasured_with = "caliper 3"')
    first, second = of(with_caliper), of(with_caliper.replace('"type1"', '"type2"'))
    assert first["width"] == second["width"]
    assert first["remanence"] != second["remanence"]


def test_calibrations_of_one_coil_share_only_the_error_of_the_coil():
    def of(**changes: float) -> dict[str, str]:
        text = text_of(
            "rigs/virtual_calibration.toml",
            "pixels_per_mm = 0.1\ncoil_constant_mT_per_A = 0.047\nclamp_midpoint_px = 0.5\naxis_angle_deg = 0.1",
        )
        calibration = parse(Calibration, text, "calibration.toml").model_copy(update=changes)
        return {stated.source: stated.of for stated in calibration.stated_sources()}

    first = of()
    assert of() == first
    moved = of(pixels_per_mm=24.0)
    assert moved["coil"] == first["coil"]
    for source in ("scale", "clamp", "axis"):
        assert moved[source] != first[source]
        assert first[source] == first["scale"] != first["coil"]
    assert of(coil_constant_mT_per_A=4.5)["coil"] != first["coil"]


def test_the_virtual_rig_has_no_uncertainties_and_the_example_bench_has_all():
    assert all(
        s.standard_uncertainty == 0
        for s in load_calibration(PROTOCOLS / "rigs/virtual_calibration.toml").stated_sources()
    )
    for name in ("type1", "type2", "type3", "type4"):
        specimen = load_specimen(name)
        assert all(s.standard_uncertainty == 0 for s in specimen.stated_sources())
        assert len(specimen.stated_sources()) == len(specimen.uncertain_keys())
    bench = load_specimen("bench_example")
    assert {s.standard_uncertainty > 0 for s in bench.stated_sources()} == {True}
    assert len(bench.stated_sources()) == len(bench.uncertain_keys())
    calibration = load_rig("bench_example").calibration
    assert set(calibration.uncertainty or {}) == set(calibration.uncertain_keys())


def test_a_simulation_of_a_fit_has_the_intervals_of_its_draws():
    beam = load_specimen("type1")
    law, truth, field_mT = LAWS["neo-hookean"], np.array([46e3]), np.array([2.0, 4.0])
    drawn = np.linspace(40e3, 52e3, 21)[:, None]
    simulation = simulate(beam, law, truth, field_mT, 0.0, drawn=drawn)
    assert simulation.tips is not None
    assert simulation.tips.shape == (2, 3, 2)
    stiff, soft = (simulate(beam, law, drawn[i], field_mT, 0.0) for i in (-1, 0))
    ends = [s.model.tip_angle_deg(s.shapes)[0] for s in (stiff, soft)]
    assert (ends[0] < simulation.tips[:, 2, 0]).all()
    assert (simulation.tips[:, 2, 1] < ends[1]).all()
    assert pytest.approx(np.array(ends), rel=0.02) == simulation.tips[:, 2].T
