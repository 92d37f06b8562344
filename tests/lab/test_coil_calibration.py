"""`eimi calibrate-coil` measures the field at several currents of the coil and writes a calibration of the coil."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from eimi_lab.acquisition.coil_calibration import calibration_currents
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.process.errors import InputError
from eimi_lab.vision.field_at_beam import stated_coil
from tests.end_to_end.test_measured_field import OFFSET_MT, SENSORS, TRUE_MT_PER_A, write_bench

Run = Callable[..., tuple[int, str]]


def test_a_coil_is_calibrated_and_its_calibration_is_read_again(tmp_path: Path, run: Run) -> None:
    write_bench(tmp_path, SENSORS)
    status, said = run("calibrate-coil", "--rig", tmp_path / "rig.toml", "-o", tmp_path / "new.toml", "--largest", 1.0)
    assert status == 0, said
    before, after = load_calibration(tmp_path / "virtual_calibration.toml"), load_calibration(tmp_path / "new.toml")
    uncertainty = after.uncertainty or {}
    sigma = uncertainty["coil_constant_mT_per_A"]
    assert 0.002 * TRUE_MT_PER_A < sigma < 0.004 * TRUE_MT_PER_A
    assert after.coil_constant_mT_per_A == pytest.approx(TRUE_MT_PER_A, abs=3 * sigma)
    assert after.background_field_mT == pytest.approx((OFFSET_MT, 0.0), abs=3 * uncertainty["background_field_mT"])
    assert after.pixels_per_mm == before.pixels_per_mm
    assert after.field is not None
    assert [row[0] for row in after.field.against_current or ()] == [0, 0.2, 0.4, 0.6, 0.8, 1.0, 0.8, 0.6, 0.4, 0.2, 0]
    assert not after.field.is_uneven


def test_an_existing_calibration_is_kept(tmp_path: Path, run: Run) -> None:
    write_bench(tmp_path, SENSORS)
    file = tmp_path / "virtual_calibration.toml"
    before = file.read_text()
    status, said = run("calibrate-coil", "--rig", tmp_path / "rig.toml", "-o", file)
    assert status == 2
    assert "--force" in said
    assert file.read_text() == before


@pytest.mark.parametrize(
    ("sensors", "options", "words"),
    [
        ("", (), 'has no sensor with measures = "field"'),
        (SENSORS, ("--largest", 3.0), "--largest = 3 should be above 0 and at most 2 A"),
    ],
)
def test_a_coil_that_cannot_be_calibrated_is_refused(
    tmp_path: Path, run: Run, sensors: str, options: tuple[object, ...], words: str
) -> None:
    write_bench(tmp_path, sensors)
    status, said = run("calibrate-coil", "--rig", tmp_path / "rig.toml", "-o", tmp_path / "new.toml", *options)
    assert status == 2
    assert words in said
    assert not (tmp_path / "new.toml").exists()


def test_a_current_beyond_the_rating_of_the_coil_is_refused() -> None:
    rig = load_rig("bench_example")
    assert calibration_currents(rig, 1.0, 3) == [0.0, 0.5, 1.0, 0.5, 0.0]
    with pytest.raises(InputError, match=r"coil\.continuous_current_A = 1\.6"):
        calibration_currents(rig, 1.7, 3)


def test_the_field_of_a_calibrated_coil_is_uniform(files: Path) -> None:
    text = (files / "calibration.toml").read_text()
    (files / "calibration.toml").write_text(text + "\n[field]\nagainst_current = [[0.0, 0.0], [1.0, 4.7]]\n")
    calibration = load_calibration(files / "calibration.toml")
    assert stated_coil(calibration, load_specimen("type1").mechanics()) is None
