"""Every exception in a driver of another package reaches the user as an InstrumentError with one line of text."""

from __future__ import annotations

from importlib.metadata import EntryPoint, EntryPoints
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_drivers import discovery, installed
from eimi_drivers.clock import WallClock
from eimi_drivers.interfaces import (
    Identity,
    InstrumentError,
    InstrumentTimeout,
    Limits,
    Reading,
    ReplyNotUnderstood,
    SensorReading,
    SwitchOffFailed,
    UnusableDriver,
)
from eimi_drivers.sensors.sensor_names import open_with as open_sensor_with
from eimi_drivers.supplies import SUPPLIES, open_supply, transport
from eimi_drivers.supplies.transport import SerialTransport

LIMITS = Limits(1.0, 12.0)
CALLS: dict[str, tuple[object, ...]] = {
    "identify": (),
    "set_voltage": (1.0,),
    "set_current": (0.5,),
    "set_output": (True,),
    "output_on": (),
    "measure": (),
    "check": (),
    "safe_off": (),
    "close": (),
}


class VendorError(Exception):
    pass


class Vendor:
    # A supply driver of another package; methods whose names are in `fails` raise `error`.

    fails = ""
    error: BaseException = VendorError("code 7\nsee the manual")
    measured: object = Reading(0.0, 0.0)

    def __init__(self, address: str, limits: Limits, clock: object) -> None:
        self.limits = limits
        self._do("__init__")

    def _do(self, member: str) -> Any:
        if member == self.fails:
            raise self.error

    @property
    def reads_zero_within_A(self) -> float:
        self._do("reads_zero_within_A")
        return 0.05

    def identify(self) -> Identity:
        self._do("identify")
        return Identity("vendor", "supply", "here")

    def set_voltage(self, voltage_V: float) -> None:
        self._do("set_voltage")

    def set_current(self, current_A: float) -> None:
        self._do("set_current")

    def set_output(self, on: bool) -> None:
        self._do("set_output")

    def output_on(self) -> bool:
        self._do("output_on")
        return False

    def measure(self) -> Any:
        self._do("measure")
        return self.measured

    def check(self) -> None:
        self._do("check")

    def safe_off(self) -> None:
        self._do("safe_off")

    def close(self) -> None:
        self._do("close")


@pytest.fixture
def vendor(monkeypatch: pytest.MonkeyPatch) -> Any:
    # Register the driver `Vendor` for one test; return a function that sets its attributes.
    SUPPLIES["vendor"] = Vendor
    yield lambda **values: [monkeypatch.setattr(Vendor, name, value) for name, value in values.items()]
    del SUPPLIES["vendor"]


@pytest.mark.parametrize("error", [VendorError("code 7\nsee the manual"), KeyError("register"), MemoryError()])
@pytest.mark.parametrize("member", CALLS)
def test_an_error_of_a_member_is_an_instrument_error_in_one_line(vendor: Any, member: str, error: Exception) -> None:
    supply = open_supply("vendor", "here", LIMITS)
    vendor(fails=member, error=error)
    wanted = SwitchOffFailed if member == "safe_off" else InstrumentError
    with pytest.raises(
        wanted, match=f"vendor supply here: its driver raised {type(error).__name__}.* in {member}"
    ) as it:
        getattr(supply, member)(*CALLS[member])
    assert "\n" not in str(it.value)


def test_an_error_when_the_supply_is_opened_is_an_instrument_error(vendor: Any) -> None:
    vendor(fails="__init__")
    with pytest.raises(
        InstrumentError, match="vendor supply here: its driver raised VendorError: code 7 see the manual"
    ):
        open_supply("vendor", "here", LIMITS)


def test_additional_members_of_a_driver_can_be_used_and_their_errors_are_instrument_errors(vendor: Any) -> None:
    supply: Any = open_supply("vendor", "here", LIMITS)
    assert (supply.reads_zero_within_A, supply.limits) == (0.05, LIMITS)
    assert not hasattr(supply, "measures_current")
    vendor(fails="reads_zero_within_A")
    with pytest.raises(InstrumentError, match="in reads_zero_within_A"):
        _ = supply.reads_zero_within_A


@pytest.mark.parametrize("measured", [None, 0.5, (0.5, 2.0)])
def test_a_measurement_that_is_no_reading_is_refused(vendor: Any, measured: object) -> None:
    vendor(measured=measured)
    with pytest.raises(ReplyNotUnderstood, match="from measure; it should return a Reading"):
        open_supply("vendor", "here", LIMITS).measure()


@pytest.mark.parametrize("error", [InstrumentTimeout("here: no answer"), KeyboardInterrupt()])
def test_errors_of_the_interface_and_interrupts_pass_unchanged(vendor: Any, error: BaseException) -> None:
    supply = open_supply("vendor", "here", LIMITS)
    vendor(fails="measure", error=error)
    with pytest.raises(type(error)) as caught:
        supply.measure()
    assert caught.value is error


class VendorSensor:
    # A sensor driver of another package whose `read` returns or raises the next answer.

    name, timeout_s = "vendor", 1.0

    def __init__(self, address: str, clock: object) -> None:
        self.answers: list[Any] = [SensorReading(21.5, "degC", 0.0), ValueError("could not convert ''"), 21.5]

    def identify(self) -> Identity:
        return Identity("vendor", "thermometer", "here")

    def read(self) -> Any:
        if isinstance(answer := self.answers.pop(0), Exception):
            raise answer
        return answer

    def close(self) -> None:
        raise KeyError("port")


def test_an_error_of_a_sensor_is_an_instrument_error_in_one_line() -> None:
    sensor = open_sensor_with(VendorSensor, "vendor", "here", WallClock())
    assert (sensor.name, sensor.timeout_s, sensor.identify().text) == ("vendor", 1.0, "thermometer")
    assert sensor.read().value == 21.5
    with pytest.raises(
        InstrumentError, match=r"^vendor sensor here: its driver raised ValueError: could not convert '' in read$"
    ):
        sensor.read()
    with pytest.raises(ReplyNotUnderstood, match=r"returned 21\.5 from read; it should return a SensorReading$"):
        sensor.read()
    with pytest.raises(InstrumentError, match=r"KeyError.* in close$"):
        sensor.close()


def test_an_interruption_between_two_messages_passes_unchanged() -> None:
    class Hurry(Exception):
        pass

    def hurry() -> None:
        raise Hurry

    class Talking(Vendor):
        def __init__(self, link: Any, limits: Limits, clock: object) -> None:
            super().__init__("", limits, clock)
            self._link = link

        @classmethod
        def connect(cls, address: str) -> Any:
            return SimpleNamespace(address=address, write=lambda message: None, close=lambda: None)

        def set_current(self, current_A: float) -> None:
            self._link.write(b"CURR 0")

    SUPPLIES["vendor"] = Talking
    try:
        supply = open_supply("vendor", "here", LIMITS, between_messages=hurry)
        with pytest.raises(Hurry):
            supply.set_current(0.5)
    finally:
        del SUPPLIES["vendor"]


def test_a_package_that_fails_when_it_is_imported_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    class Failing(EntryPoint):
        def load(self) -> Any:
            raise RuntimeError("no licence")

    announced = EntryPoints([Failing("vendor", "vendor_lab:Supply", "eimi_drivers.supplies")])
    monkeypatch.setattr(installed, "entry_points", lambda group: announced)
    with pytest.raises(UnusableDriver, match=r"announced as vendor_lab:Supply but .* RuntimeError: no licence"):
        SUPPLIES["vendor"]


def test_a_search_whose_library_fails_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: object) -> Any:
        raise VendorError("no driver")

    for search in ("list_serial_ports", "list_cameras", "list_basler_cameras"):
        monkeypatch.setattr(discovery, search, fail)
    for search in (
        "list_network",
        "list_genicam_cameras",
        "list_gentl_cameras",
    ):  # these searches may find real instruments
        monkeypatch.setattr(discovery, search, tuple)
    monkeypatch.setattr(discovery.pyvisa, "ResourceManager", fail)
    discovered = discovery.discover()
    assert discovered.found == ()
    for kind in ("serial ports", "VISA", "cameras", "Basler cameras"):
        assert f"{kind}: the search failed: VendorError: no driver" in discovered.notes


def test_any_exception_while_pyserial_opens_a_port_is_an_instrument_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: object, **options: object) -> Any:
        raise VendorError("chip not found")

    monkeypatch.setattr(transport.serial, "serial_for_url", fail)
    with pytest.raises(InstrumentError, match="/dev/ttyUSB7: VendorError: chip not found"):
        SerialTransport("/dev/ttyUSB7")
