"""Measured fields and temperatures are imported, and a fit uses them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import linregress

from eimi_lab.dataset.logged_sensor import LoggedSensor
from eimi_lab.dataset.measured_field import field_line
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.measured_conditions import stated_by_measurement

HALL = LoggedSensor("hall", "LSCI,MODEL425,1,1.0", "field", "mT")


def test_the_line_of_field_over_current_agrees_with_a_linear_regression():
    rng = np.random.default_rng(3)
    current_A = np.repeat([0.0, 0.4, 0.8, 1.2], 3)
    field_mT = 4.6 * current_A + 0.04 + rng.normal(0.0, 0.02, len(current_A))
    line, reference = field_line(HALL, current_A, field_mT), linregress(current_A, field_mT)
    assert line is not None
    assert (line.mT_per_A, line.offset_mT) == pytest.approx((reference.slope, reference.intercept))
    assert line.mT_per_A_sigma == pytest.approx(reference.stderr)
    assert line.offset_mT_sigma == pytest.approx(reference.intercept_stderr)
    assert not line.shared_is_stated


def test_given_uncertainties_of_the_gaussmeter_increase_the_uncertainties_of_the_line():
    current_A = np.array([0.0, 0.5, 1.0])
    sensor = LoggedSensor("hall", "x", "field", "mT", at_magnet=-2.0, uncertainty=0.01, uncertainty_share=0.01)
    line = field_line(sensor, current_A, -2.35 * current_A)
    assert line is not None
    assert line.mT_per_A == pytest.approx(4.7)
    # The standard uncertainty of one reading is 0.02 mT; the sum of squares of the currents about their mean is 0.5 A².
    assert line.mT_per_A_sigma == pytest.approx(np.hypot(0.02 / np.sqrt(0.5), 0.047))
    assert line.offset_mT_sigma == pytest.approx(np.hypot(0.02 * np.sqrt(1 / 3 + 0.25 / 0.5), 0.02))


def test_uncertainties_that_the_gaussmeter_reports_count_only_for_complete_readings():
    # The uncertainty of one reading is the root mean square of the uncertainties of all complete readings. These have a
    # current, a field and an uncertainty.
    current_A = np.array([0.0, 0.5, np.nan, 1.0, 0.7])
    reported_mT = np.array([0.03, 0.04, 50.0, np.nan, 50.0])
    line = field_line(HALL, current_A, 4.7 * current_A + [0.0, 0.0, 0.0, 0.0, np.nan], reported_mT)
    rig = LoggedSensor("hall", "x", "field", "mT", uncertainty=float(np.sqrt(0.5 * (0.03**2 + 0.04**2))))
    expected = field_line(rig, current_A[[0, 1, 3]], 4.7 * current_A[[0, 1, 3]])
    assert line is not None
    assert expected is not None
    assert line.mT_per_A_sigma == pytest.approx(expected.mT_per_A_sigma)
    assert line.offset_mT_sigma == pytest.approx(expected.offset_mT_sigma)
    stated = field_line(rig, current_A, 4.7 * current_A, 100.0)
    assert stated is not None
    assert stated.offset_mT_sigma < 0.1  # the uncertainty in the rig file has precedence


@pytest.mark.parametrize(("current_A", "field_mT"), [([0.5, 0.5], [2.0, 2.1]), ([0.0, 1.0], [0.0, np.nan]), ([], [])])
def test_readings_at_one_current_give_no_line(current_A, field_mT):
    assert field_line(HALL, current_A, field_mT) is None


def test_measured_fields_and_temperatures_of_imported_points_reach_the_fit(
    files: Path, run: Callable[..., tuple[int, str]]
) -> None:
    (files / "points.csv").write_text(
        "state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm\n0,a,5,0,5,0.1,0.01\n0,b,9,0,9,0.2,0.01\n1,a,5,0,5,0.4,0.01\n"
        "1,b,9,0,9,0.8,0.01\n"
    )
    (files / "loads.csv").write_text("state,field_mT,field_sigma_mT,temperature_degC\n0,1.0,0.01,22.5\n1,4.0,0.02,\n")
    status, message = run(
        *("import", files / "points.csv", "--states", files / "loads.csv", "--specimen", files / "specimen.toml"),
        *("--gravity-angle", 0, "-o", files / "points.h5"),
    )
    assert status == 0, message
    with open_dataset(files / "points.h5") as dataset:
        assert [state.field_sigma_mT for state in dataset.states] == [0.01, 0.02]
        assert [state.temperature_degC for state in dataset.states] == [22.5, None]
        stated = stated_by_measurement(dataset, dataset.states)
    assert {source.source: source.standard_uncertainty for source in stated} == {"coil": 0.005, "offset": 0.01}


def test_the_temperature_of_a_state_is_the_mean_over_its_pictures(
    pictures: Path, run: Callable[..., tuple[int, str]]
) -> None:
    rows = ["1.png,0.1,22.0", "2.png,0.1,", "10.png,0.1,24.0", "20.png,0.2,"]
    lines = ["frame,current_A,temperature_degC", *(f"frame_{row}" for row in rows)]
    (pictures / "states.csv").write_text("\n".join(lines))
    status, message = run(
        *("import", pictures / "frames", "--states", pictures / "states.csv", "-o", pictures / "out.h5"),
        *("--specimen", pictures / "specimen.toml", "--calibration", pictures / "calibration.toml"),
    )
    assert status == 0, message
    with open_dataset(pictures / "out.h5") as dataset:
        assert [state.temperature_degC for state in dataset.states] == [23.0, None]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("state,field_mT,field_sigma_mT\n0,1.0,-0.1", "field_sigma_mT"),
        ("state,current_A,field_sigma_mT\n0,0.0,0.1", "in a table that has the column field_mT"),
        ("state,field_mT,temperature_degC\n0,1.0,-300", "a temperature in degrees Celsius"),
        ("state,field_mT,temperature_degC\n0,1.0,warm", "temperature_degC"),
    ],
)
def test_a_wrong_measured_value_is_refused_in_one_line(
    files: Path, run: Callable[..., tuple[int, str]], row: str, words: str
) -> None:
    (files / "points.csv").write_text("state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm\n0,a,5,0,5,0.1,0.01\n")
    (files / "loads.csv").write_text(row + "\n")
    status, message = run(
        *("import", files / "points.csv", "--states", files / "loads.csv", "--specimen", files / "specimen.toml"),
        *("--gravity-angle", 0, "-o", files / "points.h5"),
    )
    assert status == 2
    assert words in message
    assert message.count("\n") == 1
