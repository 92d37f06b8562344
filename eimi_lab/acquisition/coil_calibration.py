"""Measure the magnetic field of a coil as a function of its current, with a gaussmeter."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import date

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.interfaces import InstrumentError, SensorReading
from eimi_drivers.supplies.supply_names import is_bipolar
from eimi_drivers.supplies.values import set_point_text
from eimi_lab.acquisition.coil import Coil, never
from eimi_lab.acquisition.events import OnEvent, Warned
from eimi_lab.acquisition.interlocks import Interlocks, readings_of
from eimi_lab.acquisition.open_coil import CoilBench, open_coil, open_virtual_sensors
from eimi_lab.acquisition.output_off import AT_THE_SUPPLY, begin_with_output_off
from eimi_lab.acquisition.sensing import Sensing
from eimi_lab.acquisition.switching_off import switching_off
from eimi_lab.config.calibration import Calibration, changed_calibration
from eimi_lab.config.protocol import Ramp
from eimi_lab.config.rig import Rig
from eimi_lab.dataset.measured_field import FieldLine, field_line
from eimi_lab.process.errors import InputError

RAMP = Ramp(rate_A_per_s=0.5, step_A=0.05, tolerance_A=0.02, down_within_s=2.0)
SETTLED_AFTER_S = 0.5
"""Time (s) from the moment at which the current reaches its set-point to the first reading of the field."""
BETWEEN_READINGS_S = 0.1
READINGS = 5
"""Number of readings of the field at each current."""


@dataclass(frozen=True)
class CoilCalibration:
    """The measured magnetic field of a coil as a function of its current.

    Parameters
    ----------
    current_A : ndarray, shape (n,)
        The n currents in the order of the measurement, A.
    field_mT : ndarray, shape (n,)
        Mean reading of the probe at each current, mT.
    line : FieldLine
        Straight line through the readings: slope (mT/A) and offset (mT) at the position of the magnet.
    hysteresis_mT : float
        Largest difference between two mean readings at equal currents, mT.
    """

    current_A: NDArray[np.float64]
    field_mT: NDArray[np.float64]
    line: FieldLine
    hysteresis_mT: float


def calibration_currents(rig: Rig, largest_A: float | None, steps: int) -> list[float]:
    """Return the currents (A) of a calibration: in equal steps from zero to the largest current and back.

    The currents are rounded toward zero to the step of the supply. If the supply can reverse its current, the currents
    with the opposite sign follow.

    Parameters
    ----------
    rig : Rig
        Contents of the rig file, with the limits of the current.
    largest_A : float or None
        Largest current, A; None for the limit in the rig file.
    steps : int
        Number of currents from zero to the largest current, both included.

    Raises
    ------
    InputError
        If the largest current is beyond the limit.
    """
    limit = rig.supply.limits.current_A
    bound = min(limit, rig.coil.continuous_current_A) if rig.coil else limit
    largest = bound if largest_A is None else largest_A
    if not 0 < largest <= bound:
        raise InputError(
            f"--largest = {largest:g} should be above 0 and at most {bound:g} A: rig {rig.name} allows "
            f"supply.limits.current_A = {limit:g}"
            + (f" and coil.continuous_current_A = {rig.coil.continuous_current_A:g}" if rig.coil else "")
        )
    step = rig.current_step_A or "0.000001"
    up = list(dict.fromkeys(float(set_point_text(current, step)) for current in np.linspace(0.0, largest, steps)))
    if len(up) < 2:
        raise InputError(f"--largest = {largest:g} should be at least {step} A, the step in which the supply sets it")
    currents = [*up, *up[-2::-1]]
    bipolar = not rig.simulated and is_bipolar(rig.supply.driver)
    return [*currents, *(-current for current in currents[1:])] if bipolar else currents


def calibrate_coil(rig: Rig, currents_A: list[float], on_event: OnEvent) -> CoilCalibration:
    """Measure the magnetic field of the coil at given currents. At the end, also after an error, the coil is off.

    Parameters
    ----------
    rig : Rig
        Contents of a rig file with a gaussmeter: a sensor with `measures = "field"`.
    currents_A : list of float
        The currents, A, in the order of the measurement.
    on_event : OnEvent
        Receives warnings and the events (records of what happened).

    Returns
    -------
    CoilCalibration
        The field at each current, and the straight line through the readings.

    Raises
    ------
    InputError
        If the rig has no gaussmeter.
    InstrumentError
        If an instrument fails, or the gaussmeter gives no value.
    """
    probe = next((sensor for sensor in rig.sensors if sensor.measures == "field"), None)
    if probe is None:
        raise InputError(f'rig {rig.name}: has no sensor with measures = "field"; add a gaussmeter in [[sensors]]')
    with _opened(rig, on_event) as bench:

        def warn(message: str) -> None:
            on_event(Warned(message=message))

        sensing = Sensing(bench.sensors, bench.clock, warn, bench.guardian.beat if bench.guardian else never)
        _, logged = sensing.begin()
        identity = bench.supply.identify()
        if bench.guardian:
            bench.guardian.expect(identity)
        begin_with_output_off(bench, RAMP, False, rig.simulated, on_event, AT_THE_SUPPLY)
        interlocks = Interlocks(rig.interlocks, on_event)
        if interlocks:
            interlocks.refuse_to_begin({**readings_of(bench.supply.measure()), **sensing.values()})
        bench.supply.check()
        bench.supply.set_current(0.0)
        bench.supply.set_voltage(bench.supply.limits.voltage_V)
        coil = Coil(
            bench.supply, bench.clock, RAMP, simulated=rig.simulated, interlocks=interlocks, sense=sensing.values
        )
        readings: list[list[SensorReading]] = []
        with switching_off(coil, bench.guardian, bench.interruption, on_event) as stop_if_asked:
            stop_if_asked()
            bench.supply.set_output(True)
            sensing.measure_at_rest(coil, stop_if_asked)
            for current_A in currents_A:
                coil.ramp_to(current_A, stop_if_asked)
                coil.wait_until_reached(stop_if_asked)
                bench.clock.sleep(SETTLED_AFTER_S)
                readings.append(_read(sensing, probe.name, bench, stop_if_asked))
    sensor = next(each for each in logged if each.name == probe.name)
    return _evaluated(np.array(currents_A), readings, lambda *columns: field_line(sensor, *columns))


def _evaluated(
    current_A: NDArray[np.float64],
    readings: list[list[SensorReading]],
    line_of: Callable[..., FieldLine | None],
) -> CoilCalibration:
    values = np.array([[reading.value for reading in at_one] for at_one in readings])
    sigmas = [[reading.standard_uncertainty for reading in at_one] for at_one in readings]
    line = line_of(np.repeat(current_A, READINGS), values.ravel(), np.array(sigmas, dtype=float).ravel())
    assert line is not None  # None only for fewer than two different currents
    means = values.mean(axis=1)
    at_same_current = [means[current_A == current] for current in np.unique(current_A)]
    return CoilCalibration(current_A, means, line, float(max(np.ptp(means_mT) for means_mT in at_same_current)))


def _read(sensing: Sensing, name: str, bench: CoilBench, stop_if_asked: Callable[[], None]) -> list[SensorReading]:
    readings = []
    for _ in range(READINGS):
        stop_if_asked()
        bench.clock.sleep(BETWEEN_READINGS_S)
        reading = sensing.read().get(name)
        if reading is None:
            raise InstrumentError(f"the sensor {name} gives no value; the warning above this message gives the reason")
        readings.append(reading)
    return readings


@contextmanager
def _opened(rig: Rig, on_event: OnEvent) -> Iterator[CoilBench]:
    if not rig.simulated:
        with open_coil(rig, on_event=on_event) as bench:
            yield bench
        return
    from eimi_lab.virtual.virtual_rig import open_virtual_coil

    supply, field_mT, clock = open_virtual_coil(rig)
    with closing(supply):
        yield CoilBench(supply, clock, sensors=open_virtual_sensors(rig, supply, field_mT, clock))


def with_measured_coil(calibration: Calibration, measured: CoilCalibration, today: date) -> Calibration:
    """Return a copy of a calibration with the measured coil constant, background field and table of the field.

    Parameters
    ----------
    calibration : Calibration
        The calibration of the bench.
    measured : CoilCalibration
        The measured field of the coil.
    today : date
        The day of the measurement.

    Raises
    ------
    InputError
        If the measured field does not increase with the current.
    """
    line = measured.line
    if line.mT_per_A <= 0:
        raise InputError(
            f"{line.probe}: measured {line.mT_per_A:.4g} mT/A, but a positive current should give a positive field: "
            "turn the probe round, or set at_magnet = -1 in the table of this sensor in rig.toml, which reverses the "
            "sign, or swap the leads of the coil"
        )
    angle = np.radians(calibration.positive_field_deg)
    axis = np.array([np.cos(angle), np.sin(angle)])
    background = np.array(calibration.background_field_mT or (0.0, 0.0))
    background += (line.offset_mT - background @ axis) * axis
    uncertainty = calibration.uncertainty or {}
    rows = zip(measured.current_A, measured.field_mT, strict=True)
    shape = calibration.field.model_dump(exclude_none=True) if calibration.field else {}
    changes = {
        "coil_constant_mT_per_A": round(line.mT_per_A, 6),
        "background_field_mT": tuple(float(part) for part in background.round(6)),
        "calibrated_on": today,
        "uncertainty": {
            **uncertainty,
            "coil_constant_mT_per_A": float(f"{line.mT_per_A_sigma:.3g}"),
            "background_field_mT": float(f"{max(line.offset_mT_sigma, uncertainty.get('background_field_mT', 0)):.3g}"),
        },
        "field": {**shape, "against_current": tuple((float(a), round(float(b), 6)) for a, b in rows)},
    }
    return changed_calibration(calibration, changes)
