"""Sensor readings are in the results file and in the report, and are compared between the datasets of one fit."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.supply import CoilSupply
from eimi_lab.dataset.logged_sensor import LoggedSensor, SensorLog
from eimi_lab.dataset.measured_field import FieldLine
from eimi_lab.dataset.measured_heating import measured_heating
from eimi_lab.fits.measured_record import MeasuredField, MeasuredTemperature
from eimi_lab.fits.measured_remarks import measured_lines
from eimi_lab.fits.records import DatasetReference
from eimi_lab.fits.states_used import StatesUsed
from eimi_lab.reporting.panels.what_was_measured import _measured

USED = StatesUsed(3, (), ())


def field(mT_per_A: float, sigma: float = 0.01) -> MeasuredField:
    return MeasuredField(
        source="hall (LSCI,MODEL425)",
        mT_per_A=mT_per_A,
        mT_per_A_sigma=sigma,
        offset_mT=0.05,
        offset_mT_sigma=0.004,
        scatter_mT=0.003,
        currents=5,
        scale_is_stated=True,
        stated_mT_per_A=4.7,
    )


def temperature(mean_degC: float) -> MeasuredTemperature:
    return MeasuredTemperature(mean_degC=mean_degC, lowest_degC=mean_degC, highest_degC=mean_degC, states=3)


def reference(path: str, **measured: object) -> DatasetReference:
    return DatasetReference(path=path, sha256="0", section="solid", states=USED, **measured)  # type: ignore[arg-type]


def test_the_results_of_a_dataset_without_sensors_have_no_keys_of_sensors() -> None:
    assert set(reference("a.h5").model_dump()) == {"path", "sha256", "section", "states", "stated"}


def test_a_measured_field_and_temperature_are_written_and_read_again() -> None:
    written = reference("a.h5", measured_field=field(4.4), temperature=temperature(23.0))
    assert DatasetReference.model_validate_json(written.model_dump_json()) == written


def test_datasets_that_are_fitted_together_are_compared() -> None:
    first = reference("a.h5", measured_field=field(4.4), temperature=temperature(23.0))
    alike = reference("b.h5", measured_field=field(4.41), temperature=temperature(24.5))
    other = reference("c.h5", measured_field=field(4.6), temperature=temperature(26.0))
    lines = measured_lines([first, alike])
    assert lines[0] == (
        "a.h5: the fit uses the field that hall (LSCI,MODEL425) measured at 5 currents, 4.4 ± 0.01 mT/A, and 0.05 "
        "± 0.004 mT without a current, in place of coil_constant_mT_per_A = 4.7 (-6.4 %)"
    )
    assert len(lines) == 4
    differences = measured_lines([first, other])[4:]
    assert "at 23.0 °C and c.h5 at 26.0 °C: they differ by more than 2 K" in differences[0]
    assert "4.4 mT/A and c.h5 has 4.6 mT/A: they differ by +4.5 %, more than 3 standard uncertainties" in differences[1]


def warmed(time_constant_s: float, rise_K_per_W: float = 8.0) -> tuple[SensorLog, list[float]]:
    # Return the log of a thermometer at an emulated coil, and the current (A) of each state.
    clock = SimulatedClock()
    coil = CoilSupply(
        clock, resistance_ohm=4.0, thermal_resistance_K_per_W=rise_K_per_W, thermal_time_constant_s=time_constant_s
    )
    coil.set_voltage(30.0)
    coil.switch(True)
    currents = [0.0, 0.5, 1.0, 1.5, 0.75]
    rows = []
    for state, current_A in enumerate(currents):
        coil.set_current(current_A)
        for _ in range(20):
            clock.sleep(6.0)
            rows.append((state, clock.now(), 22.0 + coil.heating_K()))
    state_of, time_s, degC = (np.array(column) for column in zip(*rows, strict=True))
    sensor = LoggedSensor("coil", "x", "coil_temperature", "degC")
    return SensorLog(sensor, state_of, time_s, degC, np.full(len(degC), np.nan)), currents


def test_the_model_of_the_heat_agrees_with_the_coil_that_it_describes() -> None:
    log, currents = warmed(300.0)
    heating = measured_heating(log, currents, continuous_current_A=2.0, time_constant_s=300.0)
    assert heating is not None
    assert not heating.contradicts
    assert heating.rms_K < 0.1
    assert heating.continuous_rise_K == pytest.approx(8.0 * 4.0 * 2.0**2, rel=0.02)
    assert "agrees within" in heating.in_words


@pytest.mark.parametrize(("true_s", "word"), [(100.0, "faster"), (900.0, "slower")])
def test_a_wrong_time_constant_is_named(true_s: float, word: str) -> None:
    log, currents = warmed(true_s)
    heating = measured_heating(log, currents, continuous_current_A=2.0, time_constant_s=300.0)
    assert heating is not None
    assert heating.contradicts
    assert heating.best_time_constant_s == pytest.approx(true_s, rel=0.1)
    assert f"the coil warms {word} than the rig file says" in heating.in_words


def test_a_temperature_that_hardly_changes_gives_no_verdict_on_the_model_of_the_heat() -> None:
    log, currents = warmed(300.0, rise_K_per_W=0.05)
    assert measured_heating(log, currents, 2.0, 300.0) is None


def test_the_report_contains_the_readings_of_the_sensors() -> None:
    log, currents = warmed(300.0)
    line = FieldLine("hall (x)", 4.4, 0.01, 0.05, 0.004, 0.003, 5, True)
    evidence = SimpleNamespace(
        path=Path("run.h5"),
        field_line=line,
        typed_mT_per_A=4.7,
        states=[SimpleNamespace(temperature_degC=degC) for degC in (22.8, None, 23.4)],
        heating=measured_heating(log, currents, 2.0, 300.0),
    )
    facts = dict(_measured(SimpleNamespace(evidence=evidence)))  # type: ignore[arg-type]
    assert facts["measured field"].startswith("hall (x) measured at 5 currents, 4.4 ± 0.01 mT/A")
    assert facts["temperature of the specimen"] == "23.1 °C, from 22.8 to 23.4"
    assert facts["temperature of the coil"].startswith("22.0 to ")
