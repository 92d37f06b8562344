"""A run and a coil calibration call their instruments and checks in the right order, with the right arguments."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.interfaces import Frame, InstrumentError, Reading
from eimi_lab.acquisition import coil_calibration, run
from eimi_lab.acquisition.events import Fault, OffConfirmed, RunBegun, StateStoredBefore, Warned
from eimi_lab.acquisition.resuming import UnfinishedRun
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped
from tests.shared.noted import Noted, noted

PATH = Path("run.h5")
NUMBERS = iter(range(1000))


class Opened:
    # Stand-ins for all parts that `acquire` opens; `calls` lists how they were called.

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        *,
        guarded: bool = True,
        truth: Any = None,
        bounds: tuple[str, ...] = ("T",),
    ) -> None:
        calls = self.calls = []  # type: list[Any]
        supply_limits = SimpleNamespace(voltage_V=20.0)
        self.supply = Noted(
            calls,
            "supply",
            identify=lambda: "supply A",
            limits=supply_limits,
            current_step_A="0.1",
            measure=lambda: Reading(0.5, 4.0),
        )
        images = iter(range(100))
        frames = lambda wait_s: Frame(np.full((1, 1), next(images)), 0, 0.0)  # noqa: E731
        self.camera = Noted(calls, "camera", identify=lambda: "camera B", grab=frames)
        self.guardian = Noted(calls, "guardian") if guarded else None
        self.interruption = Noted(calls, "interruption")
        self.bench: Any = SimpleNamespace(
            supply=self.supply, camera="a camera", cue="cue", clock=SimpleNamespace(now=lambda: 150.0),
            sensors=("hall",), steps_known=True,
            guardian=self.guardian, interruption=self.interruption, truth=truth, camera_settings="settings", relay=None,
        )  # fmt: skip
        self.protocol: Any = SimpleNamespace(name="p", currents_A=(0.1, 0.2, 0.3), ramp="ramp", ring_down=None)
        self.specimen: Any = SimpleNamespace(specimen=SimpleNamespace(name="s"))
        limits = [SimpleNamespace(reading=name) for name in bounds]
        driver = SimpleNamespace(driver="korad")
        self.rig: Any = SimpleNamespace(
            name="r", calibration="calibration", simulated=False, interlocks=limits, coil=None, supply=driver
        )
        self.sensing = Noted(calls, "sensing", begin=lambda: (("hall C",), ("log",)), values=lambda: {"hall": 7.0})
        self.begun = UnfinishedRun(0, 0.0)
        self.swaps = False
        self.writer = SimpleNamespace(path=Path("moved.h5"), stored=3, ring_downs=None)
        self.stepped: Any = None
        monkeypatch.setattr(run, "check_request", noted(calls, "check"))
        monkeypatch.setattr(run, "swaps_leads", lambda *given: self.swaps)
        monkeypatch.setattr(run, "refuse_taken", noted(calls, "taken"))
        monkeypatch.setattr(run, "WatchedCamera", noted(calls, "watch", lambda *_: self.camera))
        monkeypatch.setattr(run, "Sensing", noted(calls, "sense", lambda *_: self.sensing))
        monkeypatch.setattr(run, "Header", noted(calls, "header", lambda *_, **__: "a header"))
        monkeypatch.setattr(run, "without_contact", lambda supply: "goes on")
        monkeypatch.setattr(run, "begin_with_output_off", noted(calls, "off first"))
        self.interlocks: Any = Locks(calls, bounds)
        monkeypatch.setattr(run, "Interlocks", noted(calls, "interlocks", lambda *_: self.interlocks))
        monkeypatch.setattr(run, "mean_grey", lambda image: float(image[0, 0]))
        monkeypatch.setattr(run, "measure_noise", noted(calls, "noise", "a noise"))
        monkeypatch.setattr(run, "take_up", noted(calls, "take up", lambda *_: self.begun))
        writer = noted(calls, "write", lambda *_: self.opened())
        writer.resume = noted(calls, "write on", lambda *_: self.opened())
        monkeypatch.setattr(run, "DatasetWriter", writer)
        monkeypatch.setattr(run, "Coil", noted(calls, "coil", lambda *_, **__: "a coil"))
        monkeypatch.setattr(run, "Stepping", noted(calls, "stepping", lambda **parts: parts))
        monkeypatch.setattr(run, "Pauses", noted(calls, "pauses", lambda *_: "the pauses"))
        monkeypatch.setattr(run, "Polarity", noted(calls, "polarity", lambda *_: "a polarity"))
        monkeypatch.setattr(run, "_step_through", self.step)

    @contextmanager
    def opened(self) -> Iterator[Any]:
        self.calls.append("open")
        yield self.writer
        self.calls.append("closed")

    def step(self, *given: Any) -> None:
        self.calls.append("step")
        self.stepped = given

    def acquire(self, **options: Any) -> Path:
        listener = noted(self.calls, "event")
        return run.acquire(self.protocol, self.specimen, self.rig, self.bench, PATH, listener, **options)

    def all(self, name: str) -> list[Any]:
        return [call[1:] for call in self.calls if call[0] == name]


class Locks:
    def __init__(self, calls: list[Any], bounds: tuple[str, ...]) -> None:
        self.refuse_to_begin, self.bounds = noted(calls, "refuse"), bounds

    def __bool__(self) -> bool:
        return bool(self.bounds)


def names(calls: list[Any]) -> list[str]:
    return [call if isinstance(call, str) else call[0] for call in calls]


def begun(**changes: Any) -> RunBegun:
    facts: dict[str, Any] = {
        "dataset": "run.h5", "protocol": "p", "specimen": "s", "rig": "r", "states": 3, "currents_A": (0.1, 0.2, 0.3),
        "resumes": False, "guardian": True, "without_contact": "goes on", "hottest_share": None, "interlocks": ("T",),
    }  # fmt: skip
    return RunBegun(**facts | changes)


def test_a_run_opens_its_parts_in_order_and_hands_them_on(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Opened(monkeypatch)
    assert bench.acquire(note="remark", show="show", typed="typed", take_over=True, force=True) == Path("moved.h5")
    assert names(bench.calls) == [
        "check", "taken", "event", "watch", "sense", "sensing.begin", "supply.identify", "camera.identify",
        "guardian.expect", "header", "off first", "interlocks", "supply.measure", "sensing.values", "refuse",
        "supply.check", "supply.set_current", "supply.set_voltage", "camera.flush", *["camera.grab"] * 8, "noise",
        "write", "open", "coil", "stepping", "pauses", "polarity", "step", "closed", "event",
    ]  # fmt: skip
    assert bench.all("check") == [(bench.protocol, bench.specimen, bench.rig)]
    assert bench.all("taken") == [(PATH, True)]
    (first,), (last,) = bench.all("event")
    assert first == begun()
    assert (last.status, last.reason, last.stored, last.states, last.dataset) == ("completed", "", 3, 3, "moved.h5")
    assert bench.all("watch") == [("a camera", "show", "cue")]
    ((sensors, clock, warn, beat),) = bench.all("sense")
    assert (sensors, clock) == (("hall",), bench.bench.clock)
    assert bench.all("guardian.expect") == [("supply A",)]
    assert bench.all("header") == [
        (
            bench.specimen, "calibration", bench.protocol, bench.rig, ("supply A", "camera B", "hall C"), None,
            "remark",
            ("camera_settings", "settings"), ("without_contact", "goes on"), ("sensors", ("log",)),
        )
    ]  # fmt: skip
    ((off_bench, ramp, take_over, simulated, send),) = bench.all("off first")
    assert (off_bench, ramp, take_over, simulated) == (bench.bench, "ramp", True, False)
    assert bench.all("interlocks") == [(bench.rig.interlocks, send)]
    readings = {"coil_current_A": 0.5, "coil_voltage_V": 4.0, "coil_power_W": 2.0, "hall": 7.0}
    assert bench.all("refuse") == [(readings,)]
    assert (bench.all("supply.set_current"), bench.all("supply.set_voltage")) == ([(0.0,)], [(20.0,)])
    assert bench.all("camera.grab") == [(5.0,)] * 8
    assert bench.all("noise") == [([float(number) for number in range(8)],)]
    ((path, header, frame, force, *others),) = bench.all("write")
    assert (path, header, frame.image[0, 0], force, others) == (PATH, "a header", 0, True, [beat, warn])
    ((*positional, (word, sense)),) = bench.all("coil")
    locks = ("interlocks", bench.interlocks)
    assert positional == [bench.supply, bench.bench.clock, "ramp", ("simulated", False), locks]
    assert (word, sense()) == ("sense", {"hall": 7.0})
    parts = bench.stepped[0]
    assert parts == {
        "protocol": bench.protocol, "specimen": bench.specimen, "calibration": "calibration", "coil": "a coil",
        "camera": bench.camera, "clock": bench.bench.clock, "sensing": bench.sensing, "guardian": bench.guardian,
        "noise": "a noise", "writer": bench.writer, "began_s": 150.0, "on_event": send,
    }  # fmt: skip
    assert bench.all("pauses") == [("typed", send)]
    assert bench.all("polarity") == [(None, None)]
    first_state, interruption, pauses, polarity, ending = bench.stepped[1:]
    assert (first_state, interruption, pauses, polarity) == (0, bench.interruption, "the pauses", "a polarity")
    assert (ending.writer, ending.protocol, ending.path) == (bench.writer, bench.protocol, PATH)
    bench.calls.clear()
    beat()
    warn("too warm")
    send(off := OffConfirmed(by="run", determined_by="commanded"))
    assert bench.calls == [
        ("guardian.beat",), ("interruption.while_storing",), ("event", Warned(message="too warm")), ("event", off)
    ]  # fmt: skip
    assert ending.off is off


def test_a_run_without_guardian_interlocks_or_person(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Opened(monkeypatch, guarded=False, truth="truth", bounds=())
    bench.rig.simulated = True
    assert bench.acquire() == Path("moved.h5")
    (first,), _ = bench.all("event")
    assert first == begun(guardian=False, without_contact="", interlocks=())
    assert not {"guardian.expect", "supply.measure", "refuse"} & set(names(bench.calls))
    assert bench.all("header")[0][5:8] == ("truth", "", ("camera_settings", "settings"))
    assert ("without_contact", "") in bench.all("header")[0]
    assert bench.all("off first")[0][2:4] == (False, True)
    assert bench.all("taken") == [(PATH, False)]
    ((_, _, _, beat),) = bench.all("sense")
    bench.calls.clear()
    beat()
    assert bench.calls == [("interruption.while_storing",)]


@pytest.mark.parametrize("stored", [2, 3])
def test_a_resumed_run_tells_its_stored_states_and_goes_on_after_them(
    monkeypatch: pytest.MonkeyPatch, stored: int
) -> None:
    bench = Opened(monkeypatch)
    bench.begun = UnfinishedRun(stored, 40.0)
    whole = stored == 3
    assert bench.acquire(resume=True) == (PATH if whole else Path("moved.h5"))
    assert bench.all("taken") == []
    ((path, header, image),) = bench.all("take up")
    assert (path, header, image.tolist()) == (PATH, "a header", [[0]])
    first, *before, (last,) = bench.all("event")
    assert first == (begun(resumes=True),)
    currents = bench.protocol.currents_A[:stored]
    assert before == [(StateStoredBefore(state=k, current_A=current),) for k, current in enumerate(currents)]
    assert (last.status, last.stored, last.dataset) == ("completed", 3, "run.h5" if whole else "moved.h5")
    assert ("write" in names(bench.calls), "write on" in names(bench.calls)) == (False, not whole)
    if not whole:
        ((path, beat, warn),) = bench.all("write on")
        assert (path, [warn, beat]) == (PATH, list(bench.all("sense")[0][2:]))
        assert bench.stepped[0]["began_s"] == 110.0
        assert bench.stepped[1] == 2
    else:
        assert bench.stepped is None


@pytest.mark.parametrize(
    ("error", "status", "reason", "faults"),
    [
        (Stopped(15), "stopped", "SIGTERM", []),
        (
            InstrumentError("unplugged"),
            "failed",
            "InstrumentError",
            [Fault(kind="InstrumentError", message="unplugged")],
        ),
        (KeyboardInterrupt(), "failed", "KeyboardInterrupt", [Fault(kind="KeyboardInterrupt", message="")]),
    ],
)
def test_a_run_that_ends_early_says_how(
    monkeypatch: pytest.MonkeyPatch, error: BaseException, status: str, reason: str, faults: list[Fault]
) -> None:
    bench = Opened(monkeypatch)

    def fail(*_: Any) -> None:
        raise error

    monkeypatch.setattr(run, "begin_with_output_off", fail)
    with pytest.raises(type(error)) as caught:
        bench.acquire()
    assert caught.value is error
    (_,), *told, (last,) = bench.all("event")
    assert told == [(fault,) for fault in faults]
    assert (last.status, last.reason, last.stored, last.dataset) == (status, reason, None, "run.h5")


def test_a_person_is_needed_to_swap_the_leads(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Opened(monkeypatch)
    bench.swaps = True
    words = (
        r"^protocol p: current\.both_polarities = true: supply\.driver = 'korad' of rig r cannot reverse its current"
    )
    with pytest.raises(InputError, match=words):
        bench.acquire()
    assert names(bench.calls) == ["check"]
    bench.acquire(typed=lambda: "")
    assert bench.all("polarity") == [("the pauses", None)]
    bench.bench.relay = "relay"
    bench.acquire()
    assert bench.all("polarity")[1] == ("the pauses", "relay")


# The calibration of the coil


@pytest.mark.parametrize("guarded", [False, True])
@pytest.mark.parametrize("bounds", [(), ("T",)])
def test_the_field_is_read_at_each_current_after_the_coil_has_reached_it(
    monkeypatch: pytest.MonkeyPatch, guarded: bool, bounds: tuple[str, ...]
) -> None:
    calls: list[Any] = []
    limits = SimpleNamespace(voltage_V=20.0)
    supply = Noted(calls, "supply", identify=lambda: "supply A", limits=limits, measure=lambda: Reading(0.5, 4.0))
    clock, guardian = Noted(calls, "clock"), Noted(calls, "guardian") if guarded else None
    bench = SimpleNamespace(
        supply=supply, clock=clock, guardian=guardian, interruption="interruption", sensors=("hall",)
    )

    @contextmanager
    def opened(*given: Any) -> Iterator[Any]:
        calls.append(("open", *given))
        yield bench
        calls.append(("closed",))

    @contextmanager
    def switching_off(*given: Any) -> Iterator[Any]:
        calls.append(("on", *given))
        yield stop
        calls.append(("off",))

    stop = noted(calls, "stop")
    logged = (SimpleNamespace(name="other"), SimpleNamespace(name="hall"))
    sensing = Noted(calls, "sensing", begin=lambda: ((), logged), values=lambda: {"hall": 7.0})
    coil = Noted(calls, "coil")
    numbers = iter(range(10))
    monkeypatch.setattr(coil_calibration, "_opened", opened)
    monkeypatch.setattr(coil_calibration, "switching_off", switching_off)
    monkeypatch.setattr(coil_calibration, "Sensing", noted(calls, "sense", lambda *_: sensing))
    monkeypatch.setattr(coil_calibration, "begin_with_output_off", noted(calls, "off first"))
    locks = Locks(calls, bounds)
    monkeypatch.setattr(coil_calibration, "Interlocks", noted(calls, "interlocks", lambda *_: locks))
    monkeypatch.setattr(coil_calibration, "Coil", noted(calls, "make coil", lambda *_, **__: coil))
    monkeypatch.setattr(coil_calibration, "_read", noted(calls, "read", lambda *_: [next(numbers)]))
    monkeypatch.setattr(coil_calibration, "_evaluated", lambda *given: given)
    monkeypatch.setattr(coil_calibration, "field_line", lambda *given: given)
    sensors = [SimpleNamespace(name="other", measures="temperature"), SimpleNamespace(name="hall", measures="field")]
    rig: Any = SimpleNamespace(name="r", sensors=sensors, interlocks="rules", simulated=False)
    event = noted(calls, "event")
    currents, readings, line_of = coil_calibration.calibrate_coil(rig, [0.0, 0.3], event)  # type: ignore[misc]
    assert (currents.tolist(), readings) == ([0.0, 0.3], [[0], [1]])
    assert line_of("I", "B") == (logged[1], "I", "B")
    warn, beat = next(call[3:] for call in calls if call[0] == "sense")
    sense = next(call[-1][1] for call in calls if call[0] == "make coil")
    ramp = coil_calibration.RAMP
    at = coil_calibration.SETTLED_AFTER_S
    values = {"coil_current_A": 0.5, "coil_voltage_V": 4.0, "coil_power_W": 2.0, "hall": 7.0}
    assert calls == [
        ("open", rig, event),
        ("sense", ("hall",), clock, warn, beat),
        ("sensing.begin",),
        ("supply.identify",),
        *[("guardian.expect", "supply A")] * guarded,
        ("off first", bench, ramp, False, False, event, "; switch it off at the supply"),
        ("interlocks", "rules", event),
        *[("supply.measure",), ("sensing.values",), ("refuse", values)] * bool(bounds),
        ("supply.check",),
        ("supply.set_current", 0.0),
        ("supply.set_voltage", 20.0),
        ("make coil", supply, clock, ramp, ("simulated", False), ("interlocks", locks), ("sense", sense)),
        ("on", coil, guardian, "interruption", event),
        ("stop",),
        ("supply.set_output", True),
        ("sensing.measure_at_rest", coil, stop),
        *(
            call
            for current_A in (0.0, 0.3)
            for call in (
                ("coil.ramp_to", current_A, stop),
                ("coil.wait_until_reached", stop),
                ("clock.sleep", at),
                ("read", sensing, "hall", bench, stop),
            )
        ),
        ("off",),
        ("closed",),
    ]
    calls.clear()
    warn("no value")
    assert sense() == {"hall": 7.0}
    beat()
    assert calls == [("event", Warned(message="no value")), ("sensing.values",), *[("guardian.beat",)] * guarded]
    with pytest.raises(InputError, match=r'^rig r: has no sensor with measures = "field"; add a gaussmeter in'):
        coil_calibration.calibrate_coil(SimpleNamespace(name="r", sensors=sensors[:1]), [0.0], event)  # type: ignore[arg-type]


def test_the_gaussmeter_is_read_several_times_with_a_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    read = iter([{"hall": number, "other": 0} for number in range(20)])
    sensing: Any = Noted(calls, "sensing", read=lambda: next(read))
    bench: Any = SimpleNamespace(clock=Noted(calls, "clock"))
    found = coil_calibration._read(sensing, "hall", bench, noted(calls, "stop"))
    count = coil_calibration.READINGS
    assert found == list(range(count))
    assert calls == [("stop",), ("clock.sleep", coil_calibration.BETWEEN_READINGS_S), ("sensing.read",)] * count
    silent: Any = SimpleNamespace(read=lambda: {"other": 0})
    with pytest.raises(InstrumentError, match=r"^the sensor hall gives no value; the warning above this message gives"):
        coil_calibration._read(silent, "hall", bench, lambda: None)
