"""What a run does on a signal, on a lost guardian and at its end, each in the order of the calls."""

from __future__ import annotations

import os
import signal
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import Identity, InstrumentError, InstrumentTimeout, Off, SensorReading, SwitchOffFailed
from eimi_drivers.supplies.supply_names import SUPPLIES
from eimi_lab.acquisition import switching_off
from eimi_lab.acquisition.added_driver import pack, unpack
from eimi_lab.acquisition.events import Event, OffConfirmed, OffNotConfirmed, OutputSwitched, StopRequested
from eimi_lab.acquisition.events import SuspendRefused as Refused
from eimi_lab.acquisition.guardian import StoodStill
from eimi_lab.acquisition.sensing import OpenSensor, Sensing
from eimi_lab.acquisition.switching_off import _InHaste, _SignalsHeeded, ramp_down_and_switch_off
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.process.stopping import Stopped

OFF = Off(0.001, 0.02)


class Recorder:
    """Coil or guardian that writes its calls into one list; `errors` contains the error that a call raises."""

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
    """The heeded signals of a run with a recorded coil and guardian."""

    def __init__(self) -> None:
        self.did: list[Any] = []
        self.coil: Any = Recorder(self.did, "coil")
        self.guardian: Any = Recorder(self.did, "guardian")
        self.heeded = heeded(self.did, self.coil, self.guardian)

    def done(self) -> list[Any]:
        """Return the calls and the kinds of the events since the last call of this method."""
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
    run.heeded.leave_in_haste()  # the coil is off: nothing is interrupted any more
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
    """Return the calls and events of the end of a run in which the calls of the coil raise `errors`."""
    run.coil.errors.update(errors)
    ramp_down_and_switch_off(run.coil, run.guardian, on_event=run.did.append)
    return run.done()


SAID_OFF = ["guardian disarm", OutputSwitched, OffConfirmed]


def test_the_end_of_a_run_ramps_down_switches_off_and_disarms(run: Heeding) -> None:
    assert ended(run) == ["coil ramp_down", "guardian allow 30", "coil switch_off", *SAID_OFF]
    assert ended(run, ramp_down=_InHaste()) == ["coil ramp_down", "guardian allow 30", "coil switch_off", *SAID_OFF]


def test_a_failed_ramp_down_is_told_after_the_coil_is_off(run: Heeding) -> None:
    with pytest.raises(InstrumentError, match="the coil is off, but the ramp down before it failed: cut"):
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
    """Sensor whose readings are prepared; None stands for a sensor that does not answer."""

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
    """Return the sensors by name and quantity, their clock, and the list of beats and warnings."""
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
    assert reader.values() == {"b": 5.0}  # tried again, without another warning
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
    """An instrument whose calls are written into one list; a call that repeats the last entry is left out."""

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
    """The output is on only between arming and disarming, and every state is settled, checked, taken and stored."""
    did: list[str] = []
    guardian = Recorder([], "guardian")
    air = OpenSensor(
        SimpleNamespace(name="air", measures="other", at_magnet=1.0, uncertainty=None, uncertainty_share=None),  # type: ignore[arg-type]
        Traced(Sensor("V", 1.0), "air", did),
    )
    setup.bench = replace(
        setup.bench,
        supply=Traced(setup.bench.supply, "supply", did, ("measure", "check")),
        camera=Traced(setup.bench.camera, "camera", did, ("identify",)),
        guardian=Traced(guardian, "guardian", did, ("check", "refuse_a_gap", "silent_s")),
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
