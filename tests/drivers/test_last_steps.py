# Steps of drivers, emulators and checks that no other test reaches, each in a process without a real line.

from __future__ import annotations

import math
import threading
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import EntryPoints
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_drivers import discovery, installed
from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.cameras.timed import TimedCamera
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import gige_features, sensor_session, serve
from eimi_drivers.emulators.aim_tti import MX100TP, QL355TP, AimTtiDialect
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.sensor_session import EmulatedSensorSession
from eimi_drivers.emulators.sensors import SensorFault, TextLineDialect
from eimi_drivers.emulators.serve import emulate
from eimi_drivers.emulators.spoiling import begin_fault, end_faults
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    Limits,
    Off,
    Reading,
    SetPointNotTaken,
    SwitchOffFailed,
)
from eimi_drivers.sensors import SENSORS
from eimi_drivers.supplies import SUPPLIES, visa
from eimi_drivers.supplies.aim_tti import ERRORS, ERRORS_OF_QL, SERIES, Series
from eimi_drivers.supplies.foreign import ForeignSupply
from eimi_drivers.supplies.transport import InProcessTransport, SerialTransport
from eimi_drivers.testing import CAMERA_CHECKS, check_camera, check_sensor, check_supply, supply_bench
from eimi_drivers.testing.claims import within
from eimi_drivers.testing.sensor_checks import SENSOR_CHECKS
from tests.drivers.test_words_of_checks import Good
from tests.patience import PATIENCE_S


def test_an_error_of_another_kind_on_opening_a_camera_is_raised_unchanged() -> None:
    error = KeyError("model")

    def open_it() -> Any:
        raise error

    with pytest.raises(KeyError) as caught:
        TimedCamera("here", open_it)
    assert caught.value is error


@pytest.mark.parametrize("fault", [SensorFault.JUMP, Fault.SILENCE])
def test_the_fault_of_a_sensor_begins_in_the_sensor_or_in_its_line(fault: Any) -> None:
    said: list[str] = []
    session = EmulatedSensorSession("text-line", 0, None, 1.0, 3.0, fault, 0.0, said.append)
    before = session._line.receive(b"READ?\n")
    assert before.split()[0].startswith(b"3.")
    session._begin(fault)
    after = session._line.receive(b"READ?\n")
    if fault is SensorFault.JUMP:
        assert float(after.split()[0]) == pytest.approx(300.0, abs=3.0)
    else:
        assert after == b""
    assert said == [f"# the fault {fault.word} begins: {fault.effect}"]


def test_the_fault_of_a_served_sensor_begins_after_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    clock = SimulatedClock()
    monkeypatch.setattr(sensor_session, "WallClock", lambda: clock)

    @contextmanager
    def served(line: Any, port: int) -> Any:
        yield f"TCP {port}"

    monkeypatch.setattr(sensor_session, "serve_tcp", served)
    session = EmulatedSensorSession("text-line", 7, None, 1.0, 0.0, SensorFault.STUCK, 1.0, said.append)
    began: list[float] = []
    sleep = clock.sleep

    def sleep_until_3_s(seconds: float) -> None:
        assert seconds == sensor_session.LOOK_EVERY_S
        if len(said) == 2 and not began:
            began.append(clock.now())
        if clock.now() >= 3.0:
            raise KeyboardInterrupt
        sleep(seconds)

    monkeypatch.setattr(clock, "sleep", sleep_until_3_s)
    with pytest.raises(KeyboardInterrupt):
        session.serve()
    assert said[0] == 'driver = "text-line"\naddress = "TCP 7"'
    assert len(said) == 2
    assert 1.0 <= began[0] < 1.0 + 2 * sensor_session.LOOK_EVERY_S


def test_windows_has_no_pseudo_terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serve.sys, "platform", "win32")
    with pytest.raises(InstrumentError, match="Windows has no pseudo-terminals; serve on a TCP port"):
        serve.open_terminal()


def test_an_error_of_switching_off_is_raised_unchanged_by_another_package() -> None:
    error = SwitchOffFailed("here: 0.4 A measured", current_A=0.4)

    def fail() -> None:
        raise error

    supply: Any = SimpleNamespace(safe_off=fail, limits=Limits(1.0, 2.0))
    with pytest.raises(SwitchOffFailed) as caught:
        ForeignSupply(supply, "vendor", "here").safe_off()
    assert caught.value is error


@pytest.mark.parametrize(
    ("error", "kind"),
    [(InstrumentError("named already"), InstrumentError), (ZeroDivisionError("x"), InstrumentDisconnected)],
)
def test_an_error_of_a_serial_port_is_named_once(error: Exception, kind: type[Exception]) -> None:
    line: Any = object.__new__(SerialTransport)
    line.address = "port"
    with pytest.raises(kind) as caught, line._errors_named():
        raise error
    assert (caught.value is error) is (kind is InstrumentError)
    assert str(caught.value) == ("named already" if kind is InstrumentError else "port: ZeroDivisionError: x")


@pytest.mark.parametrize(
    ("address", "library", "loaded"),
    [
        ("TCPIP::h::1::SOCKET", "@py", True),
        ("/dev/ttyUSB0", "@py", False),
        ("/dev/ttyUSB0", "nivisa", True),
    ],
)
def test_the_library_is_loaded_if_the_address_needs_it(
    monkeypatch: pytest.MonkeyPatch, address: str, library: str, loaded: bool
) -> None:
    import pyvisa

    managers: list[str] = []

    def manager(name: str) -> None:
        managers.append(name)
        raise OSError("no such library")

    monkeypatch.setattr(pyvisa, "ResourceManager", manager)
    monkeypatch.setattr(visa, "visa_library", lambda: library)
    visa.load_visa(address)
    assert managers == [library] * loaded


def test_a_resource_that_refuses_the_first_transfer_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[bool] = []
    resource = SimpleNamespace(close=lambda: closed.append(True))
    import pyvisa

    monkeypatch.setattr(
        pyvisa, "ResourceManager", lambda library: SimpleNamespace(open_resource=lambda *a, **k: resource)
    )
    monkeypatch.setattr(visa, "visa_library", lambda: "nivisa")
    error = InstrumentDisconnected("refused")

    def refuse(self: Any) -> None:
        raise error

    monkeypatch.setattr(visa.VisaTransport, "_discard_unread", refuse)
    with pytest.raises(InstrumentDisconnected) as caught:
        visa.VisaTransport("TCPIP::h::1::SOCKET")
    assert caught.value is error
    assert closed == [True]


class ByAddress(SENSORS["text-line"]):  # type: ignore[misc]
    # A sensor driver that opens its line by the address, as a driver of another package does.

    connect = None

    def __init__(self, address: str, clock: Any) -> None:
        super().__init__(InProcessTransport(LINES[address], clock, address), clock)


LINES: dict[str, Any] = {}


def opened_by_address(address: str, clock: Any) -> Any:
    return ByAddress(address, clock)


def test_a_sensor_driver_that_opens_an_address_is_checked_at_a_served_emulator() -> None:
    @contextmanager
    def kept(line: Any) -> Any:
        LINES["somewhere"] = line
        yield "somewhere"

    checks = [
        check for check in SENSOR_CHECKS if check.__name__ in ("states_its_identity", "reads_values_of_either_sign")
    ]
    check_sensor(opened_by_address, TextLineDialect, serve=kept, checks=checks)
    assert type(LINES["somewhere"].instrument) is TextLineDialect


def test_a_failed_check_names_the_sensor_driver() -> None:
    def fails(bench: Any) -> None:
        raise AssertionError("of no use")

    with pytest.raises(AssertionError, match=r"^the sensor driver TextLine: fails: of no use$"):
        check_sensor(SENSORS["text-line"], TextLineDialect, checks=[fails])


def test_a_call_with_a_time_limit_runs_in_a_thread_with_its_description() -> None:
    thread = within(PATIENCE_S, "measure()", threading.current_thread)
    assert (thread.name, thread.daemon) == ("measure()", True)


def test_settings_that_change_after_a_camera_was_opened_fail_their_check() -> None:
    class Forgets(Good):
        read = 0

        @property
        def settings(self) -> CameraSettings:
            type(self).read += 1
            return self._settings if type(self).read <= 1 else CameraSettings(region=(0, 0, 3, 1))

        @settings.setter
        def settings(self, settings: CameraSettings) -> None:
            self._settings = settings

    checks = [check for check in CAMERA_CHECKS if check.__name__ == "reads_its_settings_back"]
    with pytest.raises(AssertionError, match=f"{SetPointNotTaken.__name__}: the camera: region was set to"):
        check_camera(Forgets, 0, settings=CameraSettings(region=(0, 0, 3, 2)), checks=checks)


OVP, OCP = "over-voltage protection tripped", "over-current protection tripped"
TTI_ROWS: dict[str, tuple[dict[int, str], dict[int, str], str, str, bool]] = {
    # QL: manual of the XDL series II, pages 33 and 38. MX: MX180T/TP, pages 34 and 35. QPX: QPX600D/DP, page 30.
    "QL": ({4: OVP, 8: OCP, 16: "", 32: "", 128: ""}, dict(ERRORS_OF_QL), "0.001", "RANGE{channel}?", False),
    "MX": ({4: OVP, 8: OCP, 64: ""}, dict(ERRORS), "0.001", "VRANGE{channel}?", True),
    "QPX": ({8: OVP, 16: OCP, 32: "", 64: ""}, dict(ERRORS), "0.01", "", False),
    "CPX": ({4: OVP, 8: OCP, 64: ""}, dict(ERRORS), "0.01", "", False),
}


def test_the_properties_of_each_series_of_aim_tti_are_those_of_its_manual() -> None:
    assert list(SERIES) == list(TTI_ROWS)
    for name, (trips, errors, step, question, switched) in TTI_ROWS.items():
        series = SERIES[name]
        assert (set(series.trips), series.errors, series.current_step_A) == (set(trips), errors, step), name
        assert (series.range, series.switches_protections) == (question, switched), name
        assert {bit: words for bit, words in series.trips.items() if trips[bit]} == {
            bit: words for bit, words in trips.items() if words
        }
    assert Series({}) == Series({}, ERRORS, "0.01", "", False)


@pytest.mark.parametrize(
    ("model", "command", "words"),
    [
        (MX100TP, b"VRANGE1 1\n", "error 100: .*the answer to VRANGE1. is 1"),
        (QL355TP, b"RANGE1 0\n", "error 120: .*the answer to RANGE1. is R1 0"),
    ],
)
def test_a_set_point_outside_the_range_of_a_series_names_the_range(model: Any, command: bytes, words: str) -> None:
    clock = SimulatedClock()
    dialect = AimTtiDialect(CoilSupply(clock), 1, model)
    supply = SUPPLIES["aim-tti"](InProcessTransport(dialect, clock), Limits(4.0, 20.0), clock)
    supply.identify()
    dialect.receive(command)
    with pytest.raises(InstrumentError, match=words):
        supply.set_voltage(17.0)
    supply.set_voltage(14.0)


@pytest.mark.parametrize("fault", [Fault.SILENCE, Fault.GARBAGE, Fault.PARTIAL, Fault.SLEEP])
def test_a_fault_of_the_line_lasts_until_it_ends(fault: Fault) -> None:
    coil = CoilSupply(SimulatedClock())
    line = FaultyInstrument(emulate("scpi", coil), coil.clock)
    begin_fault(fault, "scpi", coil, line)
    assert line.receive(b"*OPC?;OUTP?\n") != b"1;0\n"
    end_faults(coil, line)
    assert line.receive(b"*OPC?;OUTP?\n") == b"1;0\n"


@pytest.mark.parametrize(
    ("description", "number", "words"),
    [
        ("USB Serial", "A7", "USB Serial, serial number A7"),
        ("USB Serial", None, "USB Serial"),
        ("USB Serial", "", "USB Serial"),
        (None, "A7", "serial port, serial number A7"),
        ("n/a", None, "serial port"),
    ],
)
def test_a_port_is_described_with_its_serial_number(description: str | None, number: str | None, words: str) -> None:
    assert discovery._described(description, number) == words


@pytest.mark.parametrize(
    ("address", "host"),
    [
        ("TCPIP::10.0.0.7::INSTR", "10.0.0.7"),
        ("tcpip0::here::5025::SOCKET", "here"),
        ("TCPIP::here", "TCPIP::here"),
        ("USB0::1::2::INSTR", "USB0::1::2::INSTR"),
    ],
)
def test_the_host_of_a_resource(address: str, host: str) -> None:
    assert discovery._host(address) == host


def test_the_values_of_an_emulated_coil_that_nobody_gives() -> None:
    coil = CoilSupply(SimulatedClock())
    coil.set_voltage(30.0)
    coil.set_current(5.0)
    assert not coil.set_voltage(30.01)
    assert not coil.set_current(5.01)
    coil.switch(True)
    coil.clock.sleep(0.05)
    assert coil.coil_current_A() == pytest.approx(5.0 * (1 - math.exp(-1.0)), rel=1e-9)
    coil.clock.sleep(1000.0)
    assert coil.read() == Reading(pytest.approx(5.0, rel=1e-12), pytest.approx(20.0, rel=1e-12))  # type: ignore[arg-type]
    assert coil.heating_K() == 0.0


def test_what_a_supply_was_before_it_was_switched_off_is_false_unless_it_is_known() -> None:
    assert Off(0.001, 0.02).found_off is False
    assert SwitchOffFailed("words").current_A is None


def test_the_description_of_the_emulated_camera_has_every_row_and_a_global_shutter() -> None:
    assert gige_features.describe() == gige_features.describe(1, "Global")
    assert gige_features.describe(2, "Global") != gige_features.describe() != gige_features.describe(1, "Rolling")


def test_a_voltage_that_is_not_taken_is_named_as_it_was_sent() -> None:
    clock = SimulatedClock()
    coil = CoilSupply(clock, max_voltage_V=2.0)
    line = InProcessTransport(emulate("bk-xln", coil), clock, "here")
    supply = SUPPLIES["bk-xln"](line, Limits(1.0, 12.0), clock)
    with pytest.raises(SetPointNotTaken, match=r"^here: voltage was set to 3\.14 V but reads back 0 V$"):
        supply.set_voltage(3.14159)


@pytest.mark.parametrize(("share", "passes"), [(1.00012, True), (1.00014, False), (0.99988, True), (0.99986, False)])
def test_a_sensor_may_be_off_by_a_ten_thousandth_and_a_thousandth_of_its_unit(share: float, passes: bool) -> None:
    # The largest value of the check is 29.9, for which 4 digits after the decimal point are sent: 2.99e-3 + 1e-3.
    class Differs(SENSORS["text-line"]):  # type: ignore[misc]
        def read(self) -> Any:
            reading = super().read()
            return replace(reading, value=reading.value * share)

    checks = [check for check in SENSOR_CHECKS if check.__name__ == "reads_values_of_either_sign"]
    if passes:
        check_sensor(Differs, TextLineDialect, checks=checks)
        return
    with pytest.raises(AssertionError, match=r"read\(\) should return the true value 29\.9, not"):
        check_sensor(Differs, TextLineDialect, checks=checks)


def test_a_supply_is_given_5_s_for_an_answer() -> None:
    with supply_bench(SUPPLIES["scpi"], lambda coil: emulate("scpi", coil)) as bench:
        assert bench.answer_within_s == 5.0
    seen: list[float] = []
    for given in ({}, {"answer_within_s": 7.0}):
        check_supply(
            SUPPLIES["scpi"],
            lambda coil: emulate("scpi", coil),
            checks=[lambda bench: seen.append(bench.answer_within_s)],
            **given,
        )
    assert seen == [5.0, 7.0]


def test_a_camera_that_gives_no_frame_after_it_was_opened_again_fails_its_checks() -> None:
    opened: list[Any] = []

    class Once(Good):
        def __init__(self, source: Any, settings: CameraSettings) -> None:
            super().__init__(source, settings)
            opened.append(self)

        def grab(self, timeout_s: float) -> Any:
            if len(opened) > 1 and not self.closed:
                raise InstrumentError("no frame any more")
            return super().grab(timeout_s)

    for name in ("is_closed_when_it_is_closed", "refuses_a_setting_that_cannot_be"):
        opened.clear()
        checks = [check for check in CAMERA_CHECKS if check.__name__ == name]
        with pytest.raises(AssertionError, match="no frame any more"):
            check_camera(Once, 0, checks=checks)


def test_the_drivers_of_another_package_are_those_of_its_group(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def entries(group: str) -> EntryPoints:
        asked.append(group)
        return EntryPoints()

    monkeypatch.setattr(installed, "entry_points", entries)
    drivers: Any = installed.Drivers("supply", "the.group", {})
    with pytest.raises(InstrumentError):
        drivers["other"]
    assert set(asked) == {"the.group"}


def test_the_description_of_the_emulated_camera_is_as_accepted() -> None:
    accepted = (Path(__file__).parent / "accepted" / "genicam.xml").read_text(encoding="utf-8")
    assert gige_features.describe(2, "Rolling").split() == accepted.split()


def test_a_level_that_an_aim_tti_does_not_take_is_named_with_its_address_and_query() -> None:
    clock = SimulatedClock()
    dialect = AimTtiDialect(CoilSupply(clock))
    usual = dialect.receive
    answering: Any = SimpleNamespace(receive=lambda data: b"CP1 2.5\r\n" if data == b"OCP1?\n" else usual(data))
    supply = SUPPLIES["aim-tti"](InProcessTransport(answering, clock, "here"), Limits(1.0, 12.0), clock)
    supply.set_voltage(12.0)
    with pytest.raises(SetPointNotTaken, match=r"^here: .*1\.1.*but the answer to OCP1\? is 2\.5"):
        supply.set_output(True)
