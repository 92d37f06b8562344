# The settings of the serial lines of all drivers, as the manuals give them, and switching of emulated instruments.

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from eimi_drivers.cameras import CAMERAS
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import emulate, sensor_session
from eimi_drivers.emulators.sensor_session import EmulatedSensorSession
from eimi_drivers.emulators.sensors import EmulatedQuantity, SensorFault
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import UnknownDriver
from eimi_drivers.sensors import SENSORS
from eimi_drivers.supplies import SUPPLIES, transport, visa

EIGHT = (8, "N", 1)


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    # Settings of the opened lines; no line exists.
    settings: list[Any] = []

    def open_line(port: str, **values: Any) -> SimpleNamespace:
        settings.append((port, values))
        return SimpleNamespace(close=lambda: None)

    monkeypatch.setattr(transport.serial, "serial_for_url", open_line)
    monkeypatch.setattr(visa, "visa_library", lambda: "@py")
    return settings


def line_of(values: dict[str, Any]) -> tuple[int, int, str, int]:
    return values["baudrate"], values["bytesize"], values["parity"], values["stopbits"]


@pytest.mark.parametrize(
    ("driver", "line"),
    [
        ("lakeshore-425", (57600, 7, "O", 1)),
        ("lakeshore-475", (9600, 7, "O", 1)),
        ("fwbell-5080", (2400, *EIGHT)),
        ("text-line", (115200, *EIGHT)),
    ],
)
def test_the_line_of_a_sensor(opened: list[Any], driver: str, line: tuple[int, int, str, int]) -> None:
    SENSORS[driver].connect("/dev/ttyUSB7")  # type: ignore[attr-defined]
    [(port, values)] = opened
    assert (port, line_of(values)) == ("/dev/ttyUSB7", line)


@pytest.mark.parametrize(
    ("driver", "line"),
    [
        ("korad", (9600, *EIGHT)),
        ("scpi", (9600, *EIGHT)),
        ("genesys", (9600, *EIGHT)),
        ("bk-xln", (57600, *EIGHT)),
        ("owon-spe", (115200, *EIGHT)),
        ("keysight-e3631a", (9600, 8, "N", 2)),
        ("keysight-e3632a", (9600, 8, "N", 2)),
        ("keysight-e364x", (9600, 8, "N", 2)),
    ],
)
def test_the_line_of_a_supply(opened: list[Any], driver: str, line: tuple[int, int, str, int]) -> None:
    SUPPLIES[driver].connect("/dev/ttyUSB7")  # type: ignore[attr-defined]
    [(port, values)] = opened
    assert (port, line_of(values)) == ("/dev/ttyUSB7", line)


def test_a_line_is_opened_alone_and_never_waits_to_read(opened: list[Any]) -> None:
    SENSORS["text-line"].connect("/dev/ttyUSB7")  # type: ignore[attr-defined]
    [(_, values)] = opened
    assert (values["timeout"], values["write_timeout"], values["exclusive"]) == (0, 2.0, True)


def test_a_stuck_sensor_that_was_never_read_answers_zero() -> None:
    quantity = EmulatedQuantity(SimulatedClock(), lambda: 7.0)
    quantity.fault = SensorFault.STUCK
    assert quantity.read() == 0.0
    quantity.fault = None
    assert quantity.read() == 7.0


@pytest.mark.parametrize(
    ("tcp", "fault", "served"),
    [
        (None, None, ("pseudo-terminal",)),
        (None, SensorFault.STUCK, ("port", "ttySENSOR")),
        (0, None, ("TCP", 0)),
        (5025, SensorFault.STUCK, ("TCP", 5025)),
    ],
)
def test_a_sensor_is_served_where_it_is_wanted(
    monkeypatch: pytest.MonkeyPatch, tcp: int | None, fault: SensorFault | None, served: tuple[Any, ...]
) -> None:
    monkeypatch.setattr(sensor_session, "serve_tcp", lambda line, port: ("TCP", port))
    monkeypatch.setattr(sensor_session, "serve_pty", lambda line: ("pseudo-terminal",))
    monkeypatch.setattr(sensor_session, "serve_port", lambda line, name: ("port", name))
    session = EmulatedSensorSession("text-line", tcp, None, 1.0, 0.0, fault, 0.0, print)
    assert session._serve() == served


def test_switching_a_keithley_on_restarts_its_timer() -> None:
    # The timer runs for 60 s from the moment at which the output is switched on.
    coil = CoilSupply(SimulatedClock())
    line = emulate("keithley-2200", coil)
    line.receive(b"OUTP:TIM 1\n")
    for seconds, on in ((50.0, True), (59.9, True), (0.2, False)):
        coil.clock.sleep(seconds)
        if seconds == 50.0:
            line.receive(b"OUTP 1\n")
        assert line.receive(b"OUTP?\n").strip() == (b"1" if on else b"0")


@pytest.mark.parametrize(("messages", "on"), [([], True), ([b"OUTP 0\n"], False), ([b"OUTP 0\n", b"OUTP 1\n"], True)])
def test_a_keysight_is_on_again_after_its_watchdog_unless_it_was_switched_off(messages: list[bytes], on: bool) -> None:
    coil = CoilSupply(SimulatedClock())
    line = emulate("keysight-n6900", coil)
    line.receive(b"OUTP 1\n")
    line.receive(b"OUTP:PROT:WDOG 1\n")
    coil.clock.sleep(60.5)
    line.receive(b"*CLS\n")
    assert not coil.output_on()
    for message in messages:
        line.receive(message)
        assert not coil.output_on()
    line.receive(b"OUTP:PROT:CLE\n")
    assert coil.output_on() == on
    line.receive(b"OUTP 0\n")
    line.receive(b"OUTP:PROT:CLE\n")
    assert not coil.output_on()


@pytest.mark.parametrize(("set_V", "status"), [("9.99", 0x4080), ("10.00", 0x4080), ("10.01", 0x8080)])
def test_an_xln_names_the_over_voltage_protection_only_above_its_level(set_V: str, status: int) -> None:
    coil = CoilSupply(SimulatedClock())
    line = emulate("bk-xln", coil)
    for message in ("OVSET 10", "OVP 1", f"VSET {set_V}", "VSET high"):
        assert line.receive(f"{message}\r\n".encode()) == b""
    assert line.receive(b"STATUS?\r\n") == b"000080\r\n"
    coil.trip()
    assert line.receive(b"STATUS?\r\n") == f"{status:06X}\r\n".encode()


@pytest.mark.parametrize(("seconds", "drifted_A"), [(0.5, 1.3), (1.0, 1.8), (2.0, 2.4)])
def test_a_current_drifts_by_1_A_per_s(seconds: float, drifted_A: float) -> None:
    coil = CoilSupply(SimulatedClock())
    coil.set_voltage(12.0)
    coil.set_current(0.8)
    coil.switch(True)
    coil.clock.sleep(10.0)
    coil.drift(2.4)
    coil.clock.sleep(seconds)
    assert coil.coil_current_A() == pytest.approx(drifted_A, abs=1e-6)


@pytest.mark.parametrize(("drivers", "kind"), [(SUPPLIES, "supply"), (CAMERAS, "camera"), (SENSORS, "sensor")])
def test_an_unknown_driver_is_told_its_kind(drivers: Any, kind: str) -> None:
    with pytest.raises(UnknownDriver, match=f"^there is no {kind} driver 'nonesuch'; the names are: "):
        drivers["nonesuch"]


@pytest.mark.parametrize(
    ("driver", "local"),
    [("keysight-e3631a", True), ("keysight-e364x", True), ("keysight-e3632a", True), ("scpi", False)],
)
def test_on_a_serial_line_some_supplies_obey_only_after_they_were_set_to_remote(driver: str, local: bool) -> None:
    coil = CoilSupply(SimulatedClock())
    line: Any = emulate(driver, coil)
    line.connect_serially()
    line.receive(b"INST:NSEL 1\nVOLT 2\n")
    assert coil.state.set_voltage_V == (0.0 if local else 2.0)
    line.receive(b"SYST:REM\nINST:NSEL 1\nVOLT 3\n")
    assert coil.state.set_voltage_V == 3.0
