"""An instrument that cannot be opened gives a clear error; emulated sensors answer as their manuals describe."""

from __future__ import annotations

import math
from typing import Any

import pytest

from eimi_drivers.cameras.camera_names import open_with as open_camera_with
from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.sensors import EmulatedQuantity, emulate_sensor
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, Limits, SetPointNotTaken, UnusableDriver
from eimi_drivers.sensors import SENSORS
from eimi_drivers.sensors import base as sensor_base
from eimi_drivers.sensors.sensor_names import open_with as open_sensor_with
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.supply_names import open_with as open_supply_with

Scpi: Any = SUPPLIES["scpi"]


class Line:
    # A connection that counts how often it was closed.

    address = "here"

    def __init__(self) -> None:
        self.closed = 0

    def close(self) -> None:
        self.closed += 1


def failing(error: Exception, line: Line | None = None) -> Any:
    # Return a driver that raises `error` when it is opened; `line` is its connection.
    def driver(*arguments: object) -> Any:
        raise error

    if line is not None:
        driver.connect = lambda address: line  # type: ignore[attr-defined]
    return driver


OPENINGS = {
    "camera": lambda driver: open_camera_with(driver, "mine", "here"),
    "sensor": lambda driver: open_sensor_with(driver, "mine", "here", SimulatedClock()),
    "supply": lambda driver: open_supply_with(driver, "mine", "here", Limits(1.0, 10.0), SimulatedClock()),
}


@pytest.mark.parametrize("kind", OPENINGS)
def test_an_instrument_error_passes_unchanged_and_the_driver_is_named_for_any_other_error(kind: str) -> None:
    error = InstrumentDisconnected("here: gone")
    with pytest.raises(InstrumentDisconnected) as caught:
        OPENINGS[kind](failing(error))
    assert caught.value is error
    with pytest.raises(InstrumentError, match=f"mine {kind} here: its driver raised OSError: no licence") as wrapped:
        OPENINGS[kind](failing(OSError("no\nlicence")))
    assert isinstance(wrapped.value.__cause__, OSError)


@pytest.mark.parametrize("kind", ["sensor", "supply"])
@pytest.mark.parametrize("error", [InstrumentError("here: gone"), OSError("no licence")])
def test_a_line_is_released_if_its_driver_fails(kind: str, error: Exception) -> None:
    line = Line()
    with pytest.raises(InstrumentError):
        OPENINGS[kind](failing(error, line))
    assert line.closed == 1


def test_a_sensor_without_members_is_refused_and_its_line_released() -> None:
    line = Line()

    def driver(link: Any, clock: Any) -> Any:
        return object()

    driver.connect = lambda address: line  # type: ignore[attr-defined]
    with pytest.raises(UnusableDriver, match="the sensor driver 'mine'"):
        open_sensor_with(driver, "mine", "here", SimulatedClock())
    assert line.closed == 1


def test_an_open_supply_keeps_its_line() -> None:
    line = Line()

    class Mine(Scpi):
        @classmethod
        def connect(cls, address: str) -> Any:
            return line

    supply = open_supply_with(Mine, "mine", "here", Limits(1.0, 10.0), SimulatedClock())
    assert line.closed == 0
    supply.close()
    assert line.closed == 1


def test_a_camera_that_reads_back_another_setting_is_closed() -> None:
    closed: list[bool] = []

    class Mine:
        settings = CameraSettings(gain=2.0)

        def __init__(self, source: Any, settings: Any) -> None: ...
        def identify(self) -> Any: ...
        def flush(self) -> None: ...
        def grab(self, timeout_s: float) -> Any: ...
        def close(self) -> None:
            closed.append(True)

    open_camera_with(Mine, "mine", 0, CameraSettings(gain=2.0))
    assert closed == []
    with pytest.raises(SetPointNotTaken, match=r"mine camera 0: gain was set to 3\.0 but reads back 2\.0"):
        open_camera_with(Mine, "mine", 0, CameraSettings(gain=3.0))
    assert closed == [True]


# The true field is 2.5 mT, which is 25 G, 25 Oe, and 2.5 mT / (4 pi 10^-7 Vs/Am) = 1989.44 A/m.
CONVERSATIONS: dict[str, list[tuple[str, str]]] = {
    "lakeshore-425": [
        ("*IDN?", "LSCI,MODEL425,4250022,1.0"),
        ("UNIT?", "2"),
        ("RDGFIELD?", "+2.50000E-03"),
        ("UNIT 1", ""),
        ("UNIT?", "1"),
        ("RDGFIELD?", "+2.50000E+01"),
        ("UNIT 3", ""),
        ("RDGFIELD?", "+2.50000E+01"),
        ("UNIT 4", ""),
        ("RDGFIELD?", f"{2.5e-3 / (4e-7 * math.pi):+.5E}"),
        ("UNIT 5", ""),
        ("UNIT?", "4"),
        ("RANGE?", "1"),
        ("RANGE 3", ""),
        ("RANGE?", "3"),
        ("RDGMODE?", "1,0,1"),
        ("RDGMODE 2,1,1", ""),
        ("RDGMODE?", "2,1,1"),
        ("NONSENSE?", ""),
    ],
    "lakeshore-475": [
        ("*IDN?", "LSCI,MODEL475,4750011,1.1"),
        ("UNIT?", "1"),
        ("RDGFIELD?", "+2.50000E+01"),
    ],
    "fwbell-5080": [
        ("*IDN?", "FW BELL,5080,0,1.0"),
        (":MEASure:FLUX?", "25G;"),
        (":MEAS:FLUX?", "25G;"),
        (":UNIT:FLUX?", "DC GAUSS;"),
        (":UNIT:FLUX:DC:TESLA", ""),
        (":UNIT:FLUX?", "DC TESLA;"),
        (":MEAS:FLUX?", "0.0025T;"),
        (":UNIT:FLUX:DC:AM", ""),
        (":UNIT:FLUX?", "DC TESLA;"),
        (":SENS:FLUX:RANG?", "1;"),
        (":SENS:FLUX:RANG 2", ""),
        (":SENS:FLUX:RANG?", "2;"),
    ],
    "text-line": [
        ("*IDN?", "eimi-lab,hall-board,1,1.0"),
        ("READ?", "2.50000 mT 0.00000"),
        ("READ", ""),
    ],
}


@pytest.mark.parametrize("driver", CONVERSATIONS)
@pytest.mark.parametrize("in_pieces", [False, True])
def test_an_emulated_sensor_answers_as_its_manual_describes(driver: str, in_pieces: bool) -> None:
    instrument = emulate_sensor(driver, EmulatedQuantity(SimulatedClock(), lambda: 2.5))
    for message, answer in CONVERSATIONS[driver]:
        data = message.encode() + b"\r\n"
        parts = [data[k : k + 1] for k in range(len(data))] if in_pieces else [data]
        received = b"".join(instrument.receive(part) for part in parts)
        assert received == (answer.encode() + b"\r\n" if answer else b""), message


def test_an_emulated_quantity_has_the_given_noise_and_seed() -> None:
    def values(seed: int, noise: float) -> list[float]:
        quantity = EmulatedQuantity(SimulatedClock(), lambda: 2.5, noise=noise, seed=seed)
        return [quantity.read() for _ in range(1000)]

    assert values(1, 0.1) == values(1, 0.1)
    assert values(1, 0.1) != values(2, 0.1)
    assert set(values(1, 0.0)) == {2.5}
    mean = sum(values(1, 0.1)) / 1000
    assert mean == pytest.approx(2.5, abs=0.02)
    assert math.sqrt(sum((value - mean) ** 2 for value in values(1, 0.1)) / 999) == pytest.approx(0.1, rel=0.1)


SERIAL_LINES = {  # speed (bit/s), data bits and parity, from the manuals
    "lakeshore-425": (57600, 7, "O"),
    "lakeshore-475": (9600, 7, "O"),
    "fwbell-5080": (2400, 8, "N"),
    "text-line": (115200, 8, "N"),
}


@pytest.mark.parametrize("driver", SENSORS)
def test_a_sensor_is_opened_on_its_serial_line_or_by_visa(monkeypatch: pytest.MonkeyPatch, driver: str) -> None:
    opened: list[tuple[Any, ...]] = []
    monkeypatch.setattr(sensor_base, "SerialTransport", lambda *arguments: opened.append(arguments))
    monkeypatch.setattr(sensor_base, "VisaTransport", lambda *arguments: opened.append(arguments))
    kind: Any = SENSORS[driver]
    kind.connect("/dev/ttyX")
    kind.connect("USB0::1::2::INSTR")
    assert opened == [("/dev/ttyX", *SERIAL_LINES[driver]), ("USB0::1::2::INSTR",)]
