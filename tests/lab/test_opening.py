"""A run opens the instruments of a bench in a fixed order, and closes them in the reverse order."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.emulators import coil_line
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError
from eimi_lab.acquisition import cameras, open_bench, open_coil
from eimi_lab.acquisition.events import Event, Warned
from eimi_lab.acquisition.guardian import Ward
from eimi_lab.acquisition.interruption import Interruption
from eimi_lab.acquisition.playback import Cue, PlayedCamera
from eimi_lab.config.rig import NO_PLAYBACK, Playback, Rig
from eimi_lab.virtual import virtual_rig


class Instrument:
    settings = CameraSettings(gain=3.0)

    def __init__(self, name: str, done: list[str], broken: bool = False) -> None:
        self.name, self.done, self.broken = name, done, broken

    def close(self) -> None:
        self.done.append(f"close {self.name}")
        if self.broken:
            raise InstrumentError(f"{self.name} does not answer")


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    # A rig with replaced instruments.
    # done, given: calls and their arguments. missing, broken: names of instruments that fail to open, or to close.
    made = SimpleNamespace(done=[], given={}, missing="", broken="")

    def context(name: str) -> Any:
        @contextmanager
        def entered(*arguments: Any) -> Iterator[str]:
            made.given[name] = arguments
            made.done.append(f"begin {name}")
            yield name
            made.done.append(f"end {name}")

        return entered

    def open_supply(*arguments: Any) -> Instrument:
        made.given["supply"] = arguments
        made.done.append("open supply")
        if made.missing == "supply":
            raise InstrumentDisconnected("COM3: cannot be opened")
        return Instrument("supply", made.done)

    def open_sensor(driver: str, address: str, clock: object) -> Instrument:
        made.done.append(f"open {driver} at {address}")
        return Instrument(driver, made.done, broken=made.broken == driver)

    for name in ("only_run_on", "kept_awake", "guarding"):
        monkeypatch.setattr(open_coil, name, context(name))
    monkeypatch.setattr("eimi_drivers.supplies.supply_names.open_supply", open_supply)
    monkeypatch.setattr("eimi_drivers.sensors.sensor_names.open_sensor", open_sensor)
    monkeypatch.setattr("eimi_lab.acquisition.added_driver.pack", lambda driver: f"code of {driver}")
    monkeypatch.setattr(open_coil, "coil_thermometer", lambda rule, supply, clock: Instrument("thermometer", made.done))
    monkeypatch.setattr(open_coil, "attached", lambda: "this computer has no ports")
    monkeypatch.setattr(open_bench, "attached", lambda: "this computer has no cameras")
    made.rules = (
        SimpleNamespace(is_coil=False, driver="gauss", address="COM7"),
        SimpleNamespace(is_coil=True, driver="none", address=""),
    )
    within = SimpleNamespace(current_A=1.5, voltage_V=12.0, off_below_A=0.04)
    supply = SimpleNamespace(driver="korad", address="COM3", opened_with=within)
    made.rig = SimpleNamespace(supply=supply, sensors=made.rules)
    return made


def test_lock_guardian_supply_and_sensors_are_opened_in_this_order(bench: SimpleNamespace) -> None:
    with open_coil.open_coil(bench.rig, transcript="log", guardian_events=9) as opened:  # type: ignore[arg-type]
        assert bench.done == [
            *("begin only_run_on", "begin kept_awake", "begin guarding", "open supply", "open gauss at COM7"),
        ]
        assert opened.guardian == "guarding"
        assert [each.rule for each in opened.sensors] == list(bench.rules)
        assert [each.sensor.name for each in opened.sensors] == ["gauss", "thermometer"]  # type: ignore[attr-defined]
        driver, address, limits, clock, transcript, between = bench.given["supply"]
        assert (driver, address, limits, transcript) == ("korad", "COM3", bench.rig.supply.opened_with, "log")
        assert clock is opened.clock
        assert between == opened.interruption.between_messages
        bench.done.clear()
    assert bench.done == [
        *("close thermometer", "close gauss", "close supply", "end guarding", "end kept_awake", "end only_run_on"),
    ]
    assert bench.given["only_run_on"] == ("COM3",)
    assert bench.given["guarding"] == (Ward("korad", "COM3", 1.5, 12.0, "code of korad", 0.04), 9)


def test_a_supply_that_is_not_there_is_reported_with_the_ports_of_the_computer(bench: SimpleNamespace) -> None:
    bench.missing = "supply"
    with (
        pytest.raises(InstrumentDisconnected, match=r"^COM3: cannot be opened; this computer has no ports$"),
        open_coil.open_coil(bench.rig),
    ):
        pytest.fail("the bench was opened")


def test_a_sensor_that_cannot_be_closed_is_a_warning(bench: SimpleNamespace) -> None:
    bench.broken = "gauss"
    events: list[Event] = []
    with open_coil.open_coil(bench.rig, on_event=events.append):
        pass
    assert events == [Warned(message="gauss does not answer")]
    assert bench.done[-4:] == ["close supply", "end guarding", "end kept_awake", "end only_run_on"]


class Copied(SimpleNamespace):
    # A replacement for a table of a rig file; `model_copy` returns a copy with other values.

    def model_copy(self, update: dict[str, Any]) -> Copied:
        return Copied(**(vars(self) | update))


def rig_with(camera: Any, virtual: object = None) -> Any:
    supply = Copied(limits=SimpleNamespace(stricter=lambda other: f"stricter than {other}"))
    return Copied(camera=camera, supply=supply, virtual=virtual, simulated=False)


@pytest.mark.parametrize("camera_is_missing", [False, True])
def test_the_camera_is_opened_after_the_coil_with_the_limits_of_the_protocol(
    monkeypatch: pytest.MonkeyPatch, camera_is_missing: bool
) -> None:
    done: list[str] = []
    given: dict[str, Any] = {}
    coil = SimpleNamespace(supply="supply", clock="clock", guardian="guardian", sensors=("sensor",))
    coil.interruption = Interruption()

    @contextmanager
    def opened_coil(rig: Any, transcript: Any, **options: Any) -> Iterator[Any]:
        given["coil"] = (rig.supply.limits, rig.camera, transcript, options)
        done.append("open coil")
        yield coil
        done.append("close coil")

    def timed(label: str, open_it: Any, clock: Any, while_waiting: Any) -> Instrument:
        given["camera"] = (label, open_it(), clock.__name__, while_waiting)
        if camera_is_missing:
            raise InstrumentDisconnected("camera 4: not found")
        return Instrument("camera", done)

    chosen = SimpleNamespace(source=4, at_rate=lambda rate_Hz: SimpleNamespace(source=4, rate_Hz=rate_Hz))
    monkeypatch.setattr(open_bench, "open_coil", opened_coil)
    monkeypatch.setattr("eimi_drivers.cameras.timed.TimedCamera", timed)
    monkeypatch.setattr(cameras, "open_rig_camera", lambda *arguments: arguments)
    events: list[Event] = []
    rig = rig_with(chosen)
    opening = open_bench.open_bench(
        rig,
        "specimen",
        "protocol",
        "log",
        on_event=events.append,
        guardian_events=9,
        rate_Hz=200.0,  # type: ignore[arg-type]
    )
    if camera_is_missing:
        with pytest.raises(InstrumentDisconnected, match=r"^camera 4: not found; serial ports of this"), opening:
            pytest.fail("the bench was opened")
        return
    with opening as found:
        label, (of_rig, specimen, clock, cue), watch, while_waiting = given["camera"]
        assert (label, of_rig.camera.rate_Hz, specimen, clock, watch) == (
            *("camera 4", 200.0, "specimen", "clock", "monotonic"),
        )
        assert while_waiting == coil.interruption.while_waiting
        assert given["coil"][0] == "stricter than protocol"
        assert given["coil"][1].rate_Hz == 200.0
        assert given["coil"][2:] == ("log", {"on_event": events.append, "guardian_events": 9})
        assert (found.supply, found.clock, found.guardian, found.sensors) == (
            "supply",
            "clock",
            "guardian",
            ("sensor",),
        )
        assert (found.truth, found.relay, found.cue) == (None, None, cue)
        assert found.camera_settings == CameraSettings(gain=3.0)
        assert found.interruption is coil.interruption
        found.camera.broken = True  # type: ignore[attr-defined]
    assert done == ["open coil", "close camera", "close coil"]
    assert events == [Warned(message="camera does not answer")]


def test_a_simulated_bench_has_the_limits_of_the_protocol_and_the_sensors_of_the_field(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[str] = []
    given: list[Any] = []
    supply, camera = Instrument("supply", done), Instrument("camera", done)
    camera.field_mT, camera.swap_leads = "field", "swap"  # type: ignore[attr-defined]

    def opened(rig: Any, specimen: str) -> Any:
        given.append((rig.supply.limits, rig.camera.rate_Hz, specimen))
        return supply, camera, "clock", {"truth": 1}

    def sensors(rig: Any, *parts: Any) -> tuple[str, ...]:
        given.append((rig.supply.limits("other"), *parts))
        return ("sensor",)

    monkeypatch.setattr(virtual_rig, "open_virtual_rig", opened)
    monkeypatch.setattr(open_bench, "open_virtual_sensors", sensors)
    chosen = SimpleNamespace(at_rate=lambda rate_Hz: SimpleNamespace(rate_Hz=rate_Hz))
    rig = rig_with(chosen)
    rig.simulated = True
    rig.supply.limits = Stricter()
    with open_bench.open_bench(rig, "specimen", "protocol", rate_Hz=30.0) as found:  # type: ignore[arg-type]
        assert (found.supply, found.camera, found.clock, found.truth) == (supply, camera, "clock", {"truth": 1})  # type: ignore[comparison-overlap]
        assert (found.camera_settings, found.relay, found.sensors) == (camera.settings, "swap", ("sensor",))  # type: ignore[comparison-overlap]
        assert found.guardian is None
        assert done == []
    assert sorted(done) == ["close camera", "close supply"]
    assert given == [("stricter than protocol", 30.0, "specimen"), ("limits of other", supply, "field", "clock")]


class Stricter:
    def stricter(self, other: str) -> str:
        return f"stricter than {other}"

    def __call__(self, name: str) -> str:
        return f"limits of {name}"


@pytest.mark.parametrize("is_coil", [False, True])
def test_a_simulated_sensor_measures_the_field_or_the_coil(monkeypatch: pytest.MonkeyPatch, is_coil: bool) -> None:
    monkeypatch.setattr(open_coil, "coil_thermometer", lambda *given: ("thermometer", *given))
    monkeypatch.setattr("eimi_lab.virtual.virtual_sensors.open_virtual_sensor", lambda *given: ("sensor", *given))
    rule: Any = SimpleNamespace(is_coil=is_coil)
    rig: Any = SimpleNamespace(sensors=(rule,))
    (found,) = open_coil.open_virtual_sensors(rig, "supply", "field", "clock")  # type: ignore[arg-type]
    assert found.rule is rule
    expected: Any = ("thermometer", rule, "supply", "clock") if is_coil else ("sensor", rule, "field", "clock")
    assert found.sensor == expected


def test_the_camera_of_a_rig_is_a_device_a_recording_or_a_virtual_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cameras, "open_camera", lambda *arguments: arguments)
    monkeypatch.setattr(virtual_rig, "virtual_camera", lambda *arguments: arguments)
    monkeypatch.setattr(coil_line, "RemoteCoil", lambda address: f"coil at {address}")
    cue = Cue()
    chosen = SimpleNamespace(driver="opencv", source=4, settings="settings", playback=NO_PLAYBACK)
    rig: Any = rig_with(chosen)
    assert cameras.open_rig_camera(rig, "specimen", "clock", cue) == ("opencv", 4, "settings")  # type: ignore[arg-type]
    virtual: Any = rig_with(chosen, virtual="beam")
    assert cameras.open_rig_camera(virtual, "specimen", "clock", cue) == (  # type: ignore[arg-type,comparison-overlap]
        *(virtual, "specimen", "coil at 4", "clock"),
    )
    opened: list[Any] = []
    monkeypatch.setattr(cameras, "open_camera", lambda *arguments: opened.append(arguments) or Instrument("film", []))
    chosen.playback = Playback(loop=True)
    played = cameras.open_rig_camera(rig, "specimen", "clock", cue)  # type: ignore[arg-type]
    assert isinstance(played, PlayedCamera)
    assert opened == [("opencv", 4, "settings")]


class Run:
    def __init__(self) -> None:
        self.calls: list[str] = []

    def stop_if_asked(self) -> None:
        self.calls.append("stop_if_asked")

    def leave_in_haste(self) -> None:
        self.calls.append("leave_in_haste")

    def switch_off_in_haste(self) -> None:
        self.calls.append("switch_off_in_haste")


def test_each_long_operation_calls_its_method_of_the_run_while_the_run_heeds_signals() -> None:
    interruption, run = Interruption(), Run()

    def operate() -> None:
        interruption.between_messages()
        interruption.while_waiting()
        interruption.while_storing()

    operate()
    with interruption.heeding(run):
        operate()
    assert run.calls == ["leave_in_haste", "stop_if_asked", "switch_off_in_haste"]
    operate()
    assert len(run.calls) == 3


def test_the_fixture_has_the_fields_of_a_rig() -> None:
    assert {"camera", "supply", "virtual", "sensors"} <= set(Rig.model_fields)
    assert hasattr(Rig, "simulated")
