"""Sensor drivers read emulated gaussmeters and microcontroller boards, in the same process and over real lines."""

from __future__ import annotations

import queue
import threading
import time

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.coil_line import serve_coil
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.sensor_session import SENSOR_FAULTS, EmulatedSensorSession
from eimi_drivers.emulators.sensors import (
    SENSOR_DIALECTS,
    EmulatedQuantity,
    SensorFault,
    TextLineDialect,
    emulate_sensor,
)
from eimi_drivers.emulators.serial_port import serve_port
from eimi_drivers.emulators.serve import serve_pty, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import AnotherSensor, InstrumentError, ReplyNotUnderstood, UnusableDriver
from eimi_drivers.sensors import SENSORS, open_sensor
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_drivers.testing import check_sensor
from tests.patience import PATIENCE_S


@pytest.mark.parametrize("driver", sorted(SENSOR_DIALECTS))
def test_a_sensor_driver_passes_the_checks(driver):
    check_sensor(SENSORS[driver], lambda quantity: emulate_sensor(driver, quantity))


def test_a_board_with_a_thermometer_passes_the_checks():
    check_sensor(SENSORS["text-line"], TextLineDialect, unit="degC")


@pytest.mark.parametrize("serve", [serve_pty, serve_tcp])
@pytest.mark.parametrize("driver", sorted(SENSOR_DIALECTS))
def test_a_sensor_reads_over_a_real_line(driver, serve):
    emulated = emulate_sensor(driver, EmulatedQuantity(SimulatedClock(), lambda: -1.25))
    with serve(emulated) as address:
        sensor = open_sensor(driver, address)
        try:
            assert sensor.identify().driver == driver
            assert sensor.read().value == pytest.approx(-1.25, abs=1e-3)
        finally:
            sensor.close()


def test_a_driver_that_raises_for_a_negative_value_fails_the_checks():
    class OneSided(SENSORS["text-line"]):
        def read(self):
            reading = super().read()
            return type(reading)(abs(reading.value), reading.unit, reading.time_s)

    with pytest.raises(
        AssertionError, match=r"reads_values_of_either_sign: read\(\) should return the true value -3.2915, not 3.2915"
    ):
        check_sensor(OneSided, TextLineDialect)


@pytest.mark.parametrize(
    "answer",
    ["", "1.2", "nan mT", "1.2 mT -1", "1.2 mT 0.1 0.2", "one mT", "1.2 2 0.1", "inf mT 0.1"],
)
def test_a_board_that_does_not_answer_as_documented_is_refused(answer):
    class Other(TextLineDialect):
        def answer(self, query):
            return answer or " "

    clock = SimulatedClock()
    sensor = SENSORS["text-line"](InProcessTransport(Other(EmulatedQuantity(clock, lambda: 0.0)), clock), clock)
    with pytest.raises(ReplyNotUnderstood, match=r"the answer to READ. must be"):
        sensor.read()


def test_a_sensor_that_is_replaced_while_its_line_is_cut_gives_no_more_values():
    clock = SimulatedClock()
    line = FaultyInstrument(emulate_sensor("lakeshore-425", EmulatedQuantity(clock, lambda: 1.0)), clock)
    link = InProcessTransport(line, clock)
    link.reopen = lambda: True
    sensor = SENSORS["lakeshore-425"](link, clock)
    sensor.identify()
    line.swap(emulate_sensor("lakeshore-475", EmulatedQuantity(clock, lambda: 9.0)))
    with pytest.raises(InstrumentError, match="interrupted"):
        sensor.read()
    for _ in range(2):
        with pytest.raises(AnotherSensor, match=r"MODEL475.*but earlier as .*MODEL425"):
            sensor.read()


def is_read_again(sensor):
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            return sensor.read().value
        except InstrumentError:
            time.sleep(0.05)
    return None


def test_an_unplugged_sensor_reads_again_when_it_is_back_at_its_port():
    clock = SimulatedClock()
    emulated = FaultyInstrument(emulate_sensor("text-line", EmulatedQuantity(clock, lambda: 2.5)), clock)
    with serve_port(emulated, "ttySENSOR") as address:
        sensor = open_sensor("text-line", address)
        try:
            sensor.identify()
            emulated.inject(Fault.DROP)
            with pytest.raises(InstrumentError):
                sensor.read()
            assert is_read_again(sensor) == 2.5
        finally:
            sensor.close()


def test_faults_of_a_sensor_change_its_readings():
    values = [1.0]
    quantity = EmulatedQuantity(SimulatedClock(), lambda: values[-1])
    assert quantity.read() == 1.0
    values.append(2.0)
    quantity.fault = SensorFault.STUCK
    assert quantity.read() == 1.0
    quantity.fault = SensorFault.JUMP
    assert quantity.read() == 200.0


def test_an_unknown_sensor_driver_is_refused_with_the_names():
    with pytest.raises(UnusableDriver, match=r"no sensor driver 'lakeshore'; .*did you mean 'lakeshore-4"):
        open_sensor("lakeshore", "/dev/null")


@pytest.mark.parametrize(("fault", "readings"), [(None, 2), (SENSOR_FAULTS["disconnect"], 0)])
def test_a_served_gaussmeter_follows_an_emulated_coil_until_its_fault(fault, readings):
    coil = CoilSupply(SimulatedClock())
    coil.set_voltage(12.0)
    coil.set_current(0.5)
    coil.switch(True)
    coil.clock.sleep(1.0)
    lines: queue.Queue[str] = queue.Queue()
    with serve_coil(coil) as place:
        session = EmulatedSensorSession("lakeshore-425", 0, place, 4.0, 0.1, fault, 0.0, lines.put)
        threading.Thread(target=session.serve, daemon=True).start()
        address = lines.get(timeout=PATIENCE_S).split('"')[-2]
        if fault is not None:
            assert "the fault disconnect begins" in lines.get(timeout=PATIENCE_S)
        sensor = open_sensor("lakeshore-425", address)
        values = []
        for _ in range(2):
            try:
                values.append(sensor.read().value)
            except InstrumentError:
                continue
        sensor.close()
    assert values == pytest.approx([2.1] * readings, abs=0.05)
