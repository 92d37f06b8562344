"""A run calls its instruments in the right order after a signal, after a failure and when it ends."""

from __future__ import annotations

import os
import signal
from collections import Counter
from collections.abc import Callable
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import Identity, InstrumentError, InstrumentTimeout, Off, SensorReading, SwitchOffFailed
from eimi_drivers.sensors.coil_thermometer import CoilThermometer
from eimi_drivers.supplies.supply_names import SUPPLIES
from eimi_lab.acquisition import coil_calibration, guardian, switching_off
from eimi_lab.acquisition import open_coil as open_coil_module
from eimi_lab.acquisition.added_driver import pack, unpack
from eimi_lab.acquisition.events import (
    Event,
    FramesLost,
    OffConfirmed,
    OffNotConfirmed,
    OutputSwitched,
    StateStored,
    StopRequested,
    Warned,
)
from eimi_lab.acquisition.events import SuspendRefused as Refused
from eimi_lab.acquisition.guardian import StoodStill, Ward
from eimi_lab.acquisition.open_coil import CoilBench, close_or_tell
from eimi_lab.acquisition.sensing import OpenSensor, Sensing
from eimi_lab.acquisition.switching_off import _InHaste, _SignalsHeeded, ramp_down_and_switch_off
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped
from tests.patience import PATIENCE_S

OFF = Off(0.001, 0.02)


class Recorder:
    # A replacement for a coil or for its guardian process, which records its calls.
    # errors: the error that a method raises, by its name.

    unreachable = ""
    out_of_control = False

    def __init__(self, did: list[Any], name: str) -> None:
        self._did, self._name = did, name
        self.errors: dict[str, Exception] = {}

    def __getattr__(self, call: str) -> Callable[..., Any]:
        def act(*arguments: Any, **named: Any) -> Any:
            given = [value for value in (*arguments, *named.values()) if isinstance(value, int | float)]
            self._did.append(" ".join([self._name, call, *(f"{value:g}" for value in given)]))
            if call in self.errors:
                raise self.errors[call]
            return {"switch_off": OFF, "silent_s": 0.75}.get(call)

        return act


def heeded(did: list[Any], coil: Any, guardian: Any) -> _SignalsHeeded:
    return _SignalsHeeded(coil, guardian, did.append)


class Heeding:
    # A run whose coil records its calls, and the object that handles the signals of the run.

    def __init__(self) -> None:
        self.did: list[Any] = []
        self.coil: Any = Recorder(self.did, "coil")
        self.guardian: Any = Recorder(self.did, "guardian")
        self.heeded = heeded(self.did, self.coil, self.guardian)

    def done(self) -> list[Any]:
        # Return the calls and the types of events that were recorded since the last call of this method.
        new = [type(one) if isinstance(one, Event) else one for one in self.did]
        self.did.clear()
        return new


@pytest.fixture
def run() -> Heeding:
    return Heeding()


ALIVE = ["guardian beat", "guardian refuse_a_gap"]


def test_every_step_reports_to_the_guardian_and_watches_the_coil(run: Heeding) -> None:
    run.heeded.stop_if_asked()
    assert run.done() == [*ALIVE, "guardian check", "coil watch"]
    _SignalsHeeded(run.coil, None, run.did.append).stop_if_asked()
    assert run.done() == ["coil watch"]


def test_the_first_signal_stops_the_run_and_is_reported_once(run: Heeding) -> None:
    run.heeded.note(signal.SIGTERM, None)
    run.heeded.note(signal.SIGINT, None)
    assert run.done() == ["coil count_the_end"] * 2
    for events in ([StopRequested(signal="SIGTERM")], []):
        with pytest.raises(Stopped) as stopped:
            run.heeded.stop_if_asked()
        assert stopped.value.number == signal.SIGTERM
        assert [one for one in run.did if isinstance(one, Event)] == events
        run.did.clear()


def test_a_suspension_is_refused_once_and_stops_nothing(run: Heeding) -> None:
    assert switching_off.SUSPEND is not None
    run.heeded.note(switching_off.SUSPEND, None)
    run.heeded.stop_if_asked()
    assert run.done() == ["guardian beat", Refused, "guardian refuse_a_gap", "guardian check", "coil watch"]
    run.heeded.stop_if_asked()
    assert Refused not in run.done()


def test_only_a_second_signal_ends_the_ramp_down_and_an_exchange(run: Heeding) -> None:
    run.heeded.note(signal.SIGINT, None)
    run.heeded.go_on_down()
    run.heeded.leave_in_haste()
    run.heeded.note(signal.SIGTERM, None)
    with pytest.raises(_InHaste):
        run.heeded.go_on_down()
    with pytest.raises(Stopped) as stopped:
        run.heeded.leave_in_haste()
    assert stopped.value.number == signal.SIGINT


def test_a_lost_guardian_begins_the_time_of_the_ramp_down_with_its_last_report(run: Heeding) -> None:
    run.guardian.errors["check"] = InstrumentError("gone")
    with pytest.raises(InstrumentError, match="gone"):
        run.heeded.stop_if_asked()
    assert run.done() == [*ALIVE, "guardian check", "guardian silent_s", "coil count_the_end 0.75"]


@pytest.mark.parametrize("step", ["stop_if_asked", "leave_in_haste"])
def test_after_a_standstill_there_is_no_ramp(run: Heeding, step: str) -> None:
    run.guardian.errors["refuse_a_gap"] = StoodStill("slept")
    with pytest.raises(StoodStill):
        getattr(run.heeded, step)()
    assert run.coil.out_of_control is True


def test_while_a_state_is_stored_a_second_signal_switches_off_once(run: Heeding) -> None:
    run.heeded.note(signal.SIGINT, None)
    run.done()
    run.heeded.switch_off_in_haste()
    assert run.done() == ["coil watch"]
    run.heeded.note(signal.SIGINT, None)
    run.done()
    run.heeded.switch_off_in_haste()
    assert run.done() == ["guardian allow 30", "coil switch_off", OutputSwitched, OffConfirmed]
    run.heeded.switch_off_in_haste()
    run.heeded.leave_in_haste()  # the coil is off, so that signals interrupt nothing any more
    assert run.done() == []


def test_a_wrong_current_while_a_state_is_stored_switches_off_and_ends_the_run_afterwards(run: Heeding) -> None:
    run.coil.errors["watch"] = InstrumentError("wrong")
    run.coil.errors["switch_off"] = SwitchOffFailed("no answer")
    run.heeded.switch_off_in_haste()
    assert run.done() == ["coil watch", "guardian allow 30", "coil switch_off"]
    del run.coil.errors["watch"]
    with pytest.raises(InstrumentError, match="wrong"):
        run.heeded.stop_if_asked()


def ended(run: Heeding, **errors: Exception) -> list[Any]:
    # End a run, and return what it did. `errors`: exceptions that methods of the coil raise, by method.
    run.coil.errors.update(errors)
    ramp_down_and_switch_off(run.coil, run.guardian, on_event=run.did.append)
    return run.done()


SAID_OFF = ["guardian disarm", OutputSwitched, OffConfirmed]


def test_the_end_of_a_run_ramps_down_switches_off_and_disarms(run: Heeding) -> None:
    assert ended(run) == ["coil ramp_down", "guardian allow 30", "coil switch_off", *SAID_OFF]
    assert ended(run, ramp_down=_InHaste()) == ["coil ramp_down", "guardian allow 30", "coil switch_off", *SAID_OFF]


def test_a_failed_ramp_down_is_reported_after_the_coil_is_off(run: Heeding, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(switching_off, "DOUBTED_AFTER_S", PATIENCE_S)
    with pytest.raises(InstrumentError, match="the coil is off, but the ramp of its current to zero failed: cut"):
        ended(run, ramp_down=InstrumentError("cut"))
    assert run.done() == ["coil ramp_down", "guardian allow 30", "coil switch_off", *SAID_OFF]
    with pytest.raises(ZeroDivisionError):
        ended(run, ramp_down=ZeroDivisionError())
    assert run.done()[-3:] == SAID_OFF


@pytest.mark.parametrize(("current_A", "recognised"), [(None, []), (0.8, ["guardian recognise"])])
def test_a_coil_that_is_not_confirmed_off_stays_with_the_guardian(
    run: Heeding, current_A: float | None, recognised: list[str]
) -> None:
    failed = SwitchOffFailed("no answer", current_A, 0.02)
    run.guardian.errors["arm"] = InstrumentError("gone")
    with pytest.raises(SwitchOffFailed):
        ended(run, switch_off=failed)
    (event,) = [one for one in run.did if isinstance(one, Event)]
    assert event == OffNotConfirmed(by="run", reason="no answer", current_A=current_A, limit_A=0.02)
    expected = ["coil ramp_down", "guardian allow 30", "coil switch_off", OffNotConfirmed, "guardian arm", *recognised]
    assert run.done() == expected


@pytest.mark.parametrize(
    ("ramp_down", "unreachable", "doubt"),
    [(None, "", None), (None, "silent", "silent"), (InstrumentError("cut"), "", "cut")],
)
def test_the_coil_is_doubted_if_the_line_or_the_ramp_failed(
    run: Heeding, monkeypatch: pytest.MonkeyPatch, ramp_down: Exception | None, unreachable: str, doubt: str | None
) -> None:
    doubted: list[bool] = []

    class Doubted:
        def __init__(self, seconds: float, event: OffNotConfirmed | None, on_event: Any) -> None:
            expected = doubt and OffNotConfirmed(by="run", reason=doubt, trying_process=os.getpid())
            assert (seconds, event) == (0.5, expected)
            doubted.append(True)

        def __enter__(self) -> None: ...

        def __exit__(self, *error: object) -> None: ...

    monkeypatch.setattr(switching_off, "doubted_after", Doubted)
    run.coil.unreachable = unreachable
    if ramp_down is None:
        ended(run)
    else:
        with pytest.raises(InstrumentError):
            ended(run, ramp_down=ramp_down)
    assert doubted == [True]


def test_a_driver_of_an_installed_package_is_not_sent() -> None:
    before = dict(Counter(SUPPLIES))
    assert pack("korad") == ""
    unpack("korad", "")
    assert dict(Counter(SUPPLIES)) == before


class Sensor:
    # A sensor with prepared readings; None means that the sensor does not answer.

    def __init__(self, unit: str, *values: float | None) -> None:
        self.unit, self.values = unit, list(values)

    def identify(self) -> Identity:
        return Identity("s", "a sensor", "COM9")

    def read(self) -> SensorReading:
        value = self.values.pop(0) if len(self.values) > 1 else self.values[0]
        if value is None:
            raise InstrumentTimeout("nothing came")
        return SensorReading(value, self.unit, 0.0)


def sensing(*sensors: tuple[str, str, Sensor]) -> tuple[Sensing, SimulatedClock, list[str]]:
    # Return a reader of `sensors`, its clock, and a list that receives its warnings and each sign of life ("beat").
    # sensors: the name, the measured quantity and the stand-in of each sensor.
    clock = SimulatedClock()
    told: list[str] = []
    opened = [
        OpenSensor(
            SimpleNamespace(name=name, measures=measures, at_magnet=0.9, uncertainty=0.1, uncertainty_share=0.02),  # type: ignore[arg-type]
            sensor,  # type: ignore[arg-type]
        )
        for name, measures, sensor in sensors
    ]
    return Sensing(opened, clock, told.append, lambda: told.append("beat")), clock, told


def test_a_silent_sensor_is_left_out_for_2_s_and_warned_about_once() -> None:
    reader, clock, told = sensing(
        ("a", "other", Sensor("V", 1.0, None, None, 2.0, None)), ("b", "other", Sensor("V", 5))
    )
    assert reader.values() == {"a": 1.0, "b": 5.0}
    assert told == ["beat", "beat"]
    assert reader.values() == {"b": 5.0}
    assert told[2:] == ["beat", "the sensor a gives no value: nothing came", "beat"]
    clock.sleep(1.9)
    assert reader.values() == {"b": 5.0}
    assert told[5:] == ["beat"]
    clock.sleep(0.2)
    assert reader.values() == {"b": 5.0}  # the sensor is read again, without another warning
    assert told[6:] == ["beat", "beat"]
    clock.sleep(2.0)
    assert reader.values() == {"a": 2.0, "b": 5.0}
    assert reader.values() == {"b": 5.0}
    assert told.count("the sensor a gives no value: nothing came") == 2


def test_sensors_are_described_before_a_run_and_have_the_unit_of_their_quantity() -> None:
    reader, _, _ = sensing(("hall", "field", Sensor("mT", 1.0)), ("x", "other", Sensor("bar", 1.0)))
    identities, logged = reader.begin()
    assert [identity.address for identity in identities] == ["COM9", "COM9"]
    assert [(one.name, one.model, one.measures, one.unit) for one in logged] == [
        ("hall", "a sensor", "field", "mT"),
        ("x", "a sensor", "other", "bar"),
    ]
    assert (logged[0].at_magnet, logged[0].uncertainty, logged[0].uncertainty_share) == (0.9, 0.1, 0.02)
    wrong, _, _ = sensing(("hall", "field", Sensor("G", 1.0)))
    with pytest.raises(InstrumentError, match="COM9: the sensor hall reads in G, but measures = 'field' needs mT"):
        wrong.begin()


class Traced:
    # An instrument that records its calls as texts in the list `did`, without repetitions.

    def __init__(self, real: Any, name: str, did: list[str], left_out: tuple[str, ...] = ()) -> None:
        self._real, self._name, self._did, self._left_out = real, name, did, left_out

    def __getattr__(self, call: str) -> Any:
        found = getattr(self._real, call)
        if not callable(found) or call in self._left_out:
            return found

        def act(*arguments: Any, **named: Any) -> Any:
            given = [f"{value:g}" for value in arguments if isinstance(value, int | float)]
            words = " ".join([self._name, call, *given])
            if self._did[-1:] != [words]:
                self._did.append(words)
            return found(*arguments, **named)

        return act


def test_the_calls_of_a_run_are_in_this_order(setup: Any) -> None:
    # The output is on only while the guardian process is ready to switch it off. In each state, the run waits for rest,
    # checks the current, takes frames and stores them.
    did: list[str] = []
    recorder = Recorder([], "guardian")
    air = OpenSensor(
        SimpleNamespace(name="air", measures="other", at_magnet=1.0, uncertainty=None, uncertainty_share=None),  # type: ignore[arg-type]
        Traced(Sensor("V", 1.0), "air", did),
    )
    setup.bench = replace(
        setup.bench,
        supply=Traced(setup.bench.supply, "supply", did, ("measure", "check")),
        camera=Traced(setup.bench.camera, "camera", did, ("identify",)),
        guardian=Traced(recorder, "guardian", did, ("check", "refuse_a_gap", "silent_s")),
        sensors=(air,),
    )
    setup.protocol = parse(Protocol, setup.protocol.text.replace("stop_A = 0.3", "stop_A = 0.1"), "p")
    setup.run(remark=lambda words: None, on_event=lambda event: did.append(f"event {event.event}"))
    beat = "guardian beat"
    calls = [call for call, after in pairwise([*did, ""]) if call != beat or after == "air read"]
    frame = ["camera grab 5", beat, "air read"]
    taken = ["camera flush", "camera grab 5", "event settled", "camera flush", *frame, *frame, "event state_stored"]
    assert [call for call, after in pairwise([*calls, ""]) if call != after] == [
        *("event run_begun", "air identify", "air read", "supply identify", "guardian expect", "supply output_on"),
        *("supply set_current 0", "supply set_voltage 10", "camera flush", "camera grab 5"),
        *("guardian arm", "supply set_output 1", "event output_switched"),
        *taken,
        "supply set_current 0.1",
        *taken,
        *("guardian allow 30", "supply safe_off", "guardian disarm"),
        *("event output_switched", "event off_confirmed", "event run_ended"),
    ]


def test_lost_frames_are_reported_with_the_state_in_which_they_were_lost(setup: Any) -> None:
    # The camera loses one frame before the first state, two frames in state 1, and one frame in state 2.
    lost = setup.camera.lost_frames = Counter({"late": 1})
    did: list[Any] = []

    def grabbed(number: int) -> None:
        set_A = setup.coil.state.set_current_A
        if set_A == 0.1:
            lost["no packet"] = 2
        if set_A == 0.2:
            lost["late"] = 2
            raise InstrumentTimeout("no frame came")

    setup.camera.event = grabbed
    with pytest.raises(InstrumentTimeout):
        setup.run(remark=lambda words: None, on_event=did.append)
    found = [(event.state, event.reasons) for event in did if isinstance(event, FramesLost)]
    assert found == [(None, {"late": 1}), (1, {"no packet": 2}), (2, {"late": 1})]
    assert [event.flags for event in did if isinstance(event, StateStored)] == [(), ("DROPPED",)]


def test_frames_that_are_lost_after_the_last_state_are_reported_too(setup: Any) -> None:
    setup.camera.lost_frames = Counter()
    did: list[Any] = []

    def heard(event: Event) -> None:
        did.append(event)
        if isinstance(event, StateStored) and event.state == 3:
            setup.camera.lost_frames["late"] = 1

    setup.run(remark=lambda words: None, on_event=heard)
    (told,) = [event for event in did if isinstance(event, FramesLost)]
    assert (told.state, told.frames) == (None, 1)


def test_a_camera_that_cannot_be_closed_is_a_warning() -> None:
    said: list[Event] = []
    recorded: Any = Recorder([], "camera")
    close_or_tell(recorded, said.append)
    assert said == []
    recorded.errors["close"] = InstrumentError("stuck")
    close_or_tell(recorded, said.append)
    assert said == [Warned(message="stuck")]


def coil_rig(*, is_coil: bool) -> Any:
    rule = SimpleNamespace(is_coil=is_coil, driver="text-line", address="COM9", at_rest_degC=21.5, at_rest_A=0.25)
    limits = SimpleNamespace(current_A=1.5, voltage_V=12.0, off_below_A=0.03)
    supply = SimpleNamespace(driver="korad", address="COM3", opened_with=limits)
    return SimpleNamespace(sensors=[rule], supply=supply)


@pytest.mark.parametrize("is_coil", [False, True])
def test_the_supply_is_opened_under_its_lock_and_its_guardian_and_closed_before_them(
    monkeypatch: pytest.MonkeyPatch, is_coil: bool
) -> None:
    did: list[Any] = []

    def held(name: str) -> Callable[..., Any]:
        @contextmanager
        def hold(*arguments: Any) -> Any:
            did.append((name, *arguments))
            yield name
            did.append(f"no {name}")

        return hold

    class Opened:
        def __init__(self, name: str) -> None:
            self.name = name

        def measure(self) -> None: ...

        def close(self) -> None:
            did.append(f"close {self.name}")

    def open_supply(*arguments: Any) -> Opened:
        did.append(("supply", *arguments[:2], arguments[4]))
        assert arguments[2].off_below_A == 0.03
        return Opened("supply")

    monkeypatch.setattr(open_coil_module, "only_run_on", held("lock"))
    monkeypatch.setattr(open_coil_module, "kept_awake", held("awake"))
    monkeypatch.setattr(open_coil_module, "guarding", held("guardian"))
    monkeypatch.setattr("eimi_drivers.supplies.supply_names.open_supply", open_supply)
    monkeypatch.setattr("eimi_drivers.sensors.sensor_names.open_sensor", lambda *given: Opened(f"sensor {given[0]}"))
    rig = coil_rig(is_coil=is_coil)
    transcript = Path("wire.txt")
    with open_coil_module.open_coil(rig, transcript, guardian_events=7) as bench:
        assert bench.guardian == "guardian"
        (sensor,) = bench.sensors
        assert sensor.rule is rig.sensors[0]
        if is_coil:
            assert isinstance(sensor.sensor, CoilThermometer)
            assert sensor.sensor.at_rest_A == 0.25
    assert did == [
        ("lock", "COM3"),
        ("awake", "a run is in progress and a current flows in a coil"),
        ("guardian", Ward("korad", "COM3", 1.5, 12.0, "", 0.03), 7),
        ("supply", "korad", "COM3", transcript),
        *([] if is_coil else ["close sensor text-line"]),
        *("close supply", "no guardian", "no awake", "no lock"),
    ]


def test_the_error_about_a_missing_instrument_lists_the_attached_instruments(monkeypatch: pytest.MonkeyPatch) -> None:
    ports, cameras = ["COM3", "COM4"], ["0"]
    monkeypatch.setattr(
        "eimi_drivers.discovery.list_serial_ports", lambda: [SimpleNamespace(address=port) for port in ports]
    )
    monkeypatch.setattr(
        "eimi_drivers.discovery.list_cameras", lambda: [SimpleNamespace(address=camera) for camera in cameras]
    )
    assert open_coil_module.attached().startswith("serial ports of this computer: COM3, COM4; cameras: 0; ")
    ports.clear()
    cameras.clear()
    assert open_coil_module.attached().startswith("serial ports of this computer: none; cameras: none; ")


def test_a_calibration_reads_the_field_at_rest_and_ends_with_the_coil_off(
    setup: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    did: list[str] = []
    clock, coil = setup.bench.clock, setup.coil
    coil.current_noise_A = 0.0
    read: list[tuple[float, float]] = []

    class Probe(Sensor):
        def read(self) -> SensorReading:
            read.append((clock.now(), coil.state.set_current_A))
            return SensorReading(4.0 * coil.state.set_current_A + 0.1, "mT", clock.now(), 0.01)

    rule = SimpleNamespace(
        name="hall", measures="field", at_magnet=0.5, uncertainty=None, uncertainty_share=None, is_coil=False
    )
    quiet = ("measure", "check", "identify")
    bench = CoilBench(
        supply=Traced(setup.bench.supply, "supply", did, quiet),
        clock=clock,
        guardian=Traced(Recorder([], "guardian"), "guardian", did, ("beat", "check", "refuse_a_gap")),  # type: ignore[arg-type]
        sensors=(OpenSensor(rule, Probe("mT", 0.0)),),  # type: ignore[arg-type]
    )
    monkeypatch.setattr(coil_calibration, "_opened", lambda rig, on_event: nullcontext(bench))
    rig = setup.rig.model_copy(update={"sensors": (rule,)})
    events: list[Event] = []
    found = coil_calibration.calibrate_coil(rig, [0.0, 0.2, 0.0], events.append)
    assert found.field_mT == pytest.approx([0.1, 0.9, 0.1])
    assert (found.line.mT_per_A, found.line.offset_mT) == (pytest.approx(2.0), pytest.approx(0.05))
    assert found.hysteresis_mT == pytest.approx(0.0, abs=1e-12)
    assert [event.event for event in events] == ["output_switched", "off_confirmed"]
    assert did == [
        *("guardian expect", "supply output_on", "supply set_current 0", "supply set_voltage 10"),
        *("guardian arm", "supply set_output 1"),
        *("supply set_current 0.05", "supply set_current 0.1", "supply set_current 0.15", "supply set_current 0.2"),
        *("supply set_current 0.15", "supply set_current 0.1", "supply set_current 0.05", "supply set_current 0"),
        *("guardian allow 30", "supply safe_off", "guardian disarm"),
    ]
    assert [set_A for _, set_A in read[1:]] == [0.0] * 5 + [0.2] * 5 + [0.0] * 5  # the first reading gives the unit
    times_s = [at_s for at_s, _ in read[1:]]
    for first in (0, 5, 10):
        gaps_s = [later - earlier for earlier, later in pairwise(times_s[first : first + 5])]
        assert gaps_s == pytest.approx([0.1] * 4)
    assert setup.is_off()


def test_a_calibration_needs_a_value_of_the_gaussmeter(setup: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rule = SimpleNamespace(
        name="hall", measures="field", at_magnet=1.0, uncertainty=None, uncertainty_share=None, is_coil=False
    )
    bench = CoilBench(setup.bench.supply, setup.bench.clock, sensors=(OpenSensor(rule, Sensor("mT", 1.0, None)),))  # type: ignore[arg-type]
    monkeypatch.setattr(coil_calibration, "_opened", lambda rig, on_event: nullcontext(bench))
    rig = setup.rig.model_copy(update={"sensors": (rule,)})
    events: list[Event] = []
    with pytest.raises(InstrumentError, match="the sensor hall gives no value; the warning above"):
        coil_calibration.calibrate_coil(rig, [0.0, 0.2], events.append)
    assert events[0] == Warned(message="the sensor hall gives no value: nothing came")
    assert setup.is_off()
    with pytest.raises(InputError, match='has no sensor with measures = "field"'):
        coil_calibration.calibrate_coil(setup.rig, [0.0, 0.2], events.append)


def test_a_guardian_hears_a_beat_at_most_every_0_1_s_while_it_is_armed(monkeypatch: pytest.MonkeyPatch) -> None:
    now = {"s": 100.0}
    sent: list[bytes] = []
    monkeypatch.setattr(guardian, "awake_s", lambda: now["s"])
    watched = object.__new__(guardian.Guardian)
    monkeypatch.setattr(watched, "_send", sent.append)
    watched._ward = Ward("korad", "COM3", 1.0, 10.0)
    watched._armed, watched._beaten_s, watched._gap_s = False, 0.0, 0.0
    watched.beat()
    watched.allow(30.0)
    watched.refuse_a_gap()
    assert sent == []
    watched._armed, watched._beaten_s = True, 100.0
    for after_s in (0.0, 0.09, 0.11, 0.15, 0.22):
        now["s"] = 100.0 + after_s
        watched.beat()
    assert sent == [b".", b"."]
    watched.allow(30.0)
    assert sent[2:] == [b"allow 30.0"]
    now["s"] += 39.0  # the gap counts from the end of the allowed time
    watched.beat()
    watched.refuse_a_gap()
    now["s"] += 10.1
    with pytest.raises(StoodStill, match="the run stood still for 10 s with the coil on"):
        watched.refuse_a_gap()
    watched.disarm()
    watched.refuse_a_gap()
    assert sent[3:] == [b".", b"off"]
