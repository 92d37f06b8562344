"""A run calls its instruments and its dataset in the right order, with the right values."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.interfaces import (
    Frame,
    InstrumentError,
    Off,
    Reading,
    SensorReading,
    SwitchOffFailed,
)
from eimi_lab.acquisition import conditioning, doubt, output_off, pausing, run, settling, stepping, switching_off
from eimi_lab.acquisition import ring_downs as ring_downs_module
from eimi_lab.acquisition.events import (
    FOUND_OFF,
    ConditioningDone,
    FramesLost,
    OffConfirmed,
    OffNotConfirmed,
    OutputSwitched,
    Paused,
    PauseRequested,
    Resumed,
    Settled,
    StateStored,
    Warned,
    off_confirmed,
)
from eimi_lab.acquisition.pausing import Pauses, no_input
from eimi_lab.acquisition.polarity import Polarity, cannot_reverse, swaps_leads
from eimi_lab.acquisition.settling import Settling
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.config.protocol import Conditioning, Ramp, RingDown
from eimi_lab.dataset.recordings import CONDITIONING, Moment
from eimi_lab.dataset.steps import SetPoint
from eimi_lab.process.stopping import Stopped
from eimi_lab.vision.check import Flag, Severity
from eimi_lab.vision.flags import judge
from tests.patience import PATIENCE_S
from tests.shared.noted import Noted, noted
from tests.shared.processes import wait_until


def stop() -> None:
    """Do nothing: no signal asks the run to stop."""


FRAME = Frame(np.zeros((2, 3), np.uint8), 7, 1.0)


# Load cycles before a run


@pytest.mark.parametrize("cycles", [1, 2, 3])
def test_the_beam_is_seen_at_rest_before_and_in_the_first_and_the_last_load_cycle(
    monkeypatch: pytest.MonkeyPatch, cycles: int
) -> None:
    calls: list[Any] = []
    moments = iter(range(100, 200))
    monkeypatch.setattr(conditioning, "_at_rest", noted(calls, "rest", lambda *_: next(moments)))
    monkeypatch.setattr(conditioning, "_changes", noted(calls, "changes", lambda *_: iter(["change", "other"])))
    coil = Noted(calls, "coil", supply=Noted(calls, "supply"))
    made: Any = SimpleNamespace(coil=coil, store=noted(calls, "store"), on_event=noted(calls, "event"))
    conditioning.condition(made, Conditioning(cycles=cycles, current_A=-0.5), stop)

    def half(current_A: float, seen: bool) -> list[Any]:
        ramp = [("coil.ramp_to", current_A, stop), ("coil.wait_until_reached", stop)]
        return [*ramp, *[("rest", made, stop)] * seen, ("supply.check",)]

    halves = [
        half(current_A, number == cycles or (number == 1 and current_A != 0.0))
        for number in range(1, cycles + 1)
        for current_A in (-0.5, 0.0)
    ]
    numbers = [1, 1, 1] if cycles == 1 else [1, 1, cycles, cycles]
    seen = list(range(100, 100 + len(numbers)))
    assert calls == [
        ("rest", made, stop),
        *(call for one in halves for call in one),
        ("store", CONDITIONING, numbers, seen),
        ("changes", made, list(zip(numbers, seen, strict=True)), stop),
        ("event", ConditioningDone(cycles=cycles, changes=("change", "other"))),  # type: ignore[arg-type]
    ]


def test_a_frame_at_rest_is_taken_after_the_wait_and_has_the_time_since_the_current(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(conditioning, "wait_until_settled", noted(calls, "settled"))
    camera, clock = Noted(calls, "camera", grab=lambda wait_s: FRAME), Noted(calls, "clock", now=lambda: 12.0)
    coil = SimpleNamespace(changed_s=2.5, asked_A=0.3)
    protocol = SimpleNamespace(settle="rule")
    made: Any = SimpleNamespace(camera=camera, clock=clock, coil=coil, protocol=protocol, noise="noise")
    assert conditioning._at_rest(made, stop) == Moment(FRAME, 12.0, 9.5, 0.3)
    settled, *others = calls
    assert settled == ("settled", camera, clock, "rule", "noise", stop)
    assert others == [("camera.flush",), ("camera.grab", 5.0), ("clock.now",)]


# Pauses and the polarity


def test_p_asks_once_for_a_pause() -> None:
    calls: list[Any] = []
    lines = iter([None, "q", "p", "p", None])
    pauses = Pauses(lambda: next(lines), noted(calls, "event"))
    assert pauses.asked is False
    move_on = pauses.heeded_by(noted(calls, "stop"))
    for _ in range(5):
        move_on()
    assert calls == [("stop",)] * 2 + [("event", PauseRequested())] + [("stop",)] * 3
    assert pauses.asked is True
    assert no_input() is None


@pytest.mark.parametrize("guarded", [False, True])
@pytest.mark.parametrize("swapped", [None, False, True])
def test_a_pause_switches_off_waits_for_a_line_and_goes_back_to_its_state(
    monkeypatch: pytest.MonkeyPatch, guarded: bool, swapped: bool | None
) -> None:
    calls: list[Any] = []
    swaps = swapped is not None
    lines = iter(["typed before", "p", None, None, None, ""])
    monkeypatch.setattr(pausing, "ramp_down_and_switch_off", noted(calls, "off"))
    event, moved_on = noted(calls, "event"), noted(calls, "stop")
    pauses = Pauses(noted(calls, "typed", lambda: next(lines)), event)
    pauses.asked = True
    supply = Noted(calls, "supply", limits=SimpleNamespace(voltage_V=20.0))
    coil = SimpleNamespace(leads_swapped=bool(swapped), supply=supply)
    guardian = Noted(calls, "guardian") if guarded else None
    protocol = SimpleNamespace(currents_A=(0.1, 0.2, 0.3))
    writer = Noted(calls, "writer", path=Path("run.h5"))
    made: Any = SimpleNamespace(
        coil=coil, guardian=guardian, protocol=protocol, writer=writer, clock=Noted(calls, "clock"),
        go_back_to=noted(calls, "back"),
    )  # fmt: skip
    pauses.wait(made, 2, moved_on, **({"swap_leads": True} if swaps else {}))
    assert calls == [
        ("off", coil, guardian, moved_on, event),
        *[("typed",)] * 3,
        ("event", Paused(state=2, states=3, dataset="run.h5", swap_leads=swaps)),
        *[("typed",), ("stop",), ("clock.sleep", 0.1)] * 2,
        ("typed",),
        ("event", Resumed(state=2)),
        *[("guardian.arm",)] * guarded,
        ("supply.set_current", 0.0),
        ("supply.set_voltage", 20.0),
        ("supply.set_output", True),
        ("event", OutputSwitched(on=True)),
        ("writer.begin_session",),
        ("back", 2, moved_on),
    ]
    assert pauses.asked is False
    assert coil.leads_swapped is (False if swapped is None else not swapped)


@pytest.mark.parametrize(
    ("simulated", "driver", "cannot"),
    [(True, "virtual", True), (True, "kepco-bop", True), (False, "korad", True), (False, "kepco-bop", False)],
)
@pytest.mark.parametrize("both", [False, True])
def test_the_leads_are_swapped_for_both_polarities_of_a_supply_of_one(
    simulated: bool, driver: str, cannot: bool, both: bool
) -> None:
    rig: Any = SimpleNamespace(simulated=simulated, supply=SimpleNamespace(driver=driver))
    protocol: Any = SimpleNamespace(current=SimpleNamespace(both_polarities=both))
    assert cannot_reverse(rig) is cannot
    assert swaps_leads(protocol, rig) is (both and cannot)


@pytest.mark.parametrize("relay", [False, True])
@pytest.mark.parametrize("by_pause", [False, True])
@pytest.mark.parametrize("leads_swapped", [False, True])
@pytest.mark.parametrize("current_A", [0.0, 0.2, -0.2])
def test_the_leads_are_swapped_before_a_current_of_the_other_sign(
    relay: bool, by_pause: bool, leads_swapped: bool, current_A: float
) -> None:
    calls: list[Any] = []
    pauses: Any = Noted(calls, "pauses") if by_pause else None
    coil = Noted(calls, "coil")
    coil.leads_swapped = leads_swapped
    made: Any = SimpleNamespace(
        coil=coil, protocol=SimpleNamespace(currents_A=(0.9, current_A)), go_back_to=noted(calls, "back")
    )
    swapped = Polarity(pauses, noted(calls, "relay") if relay else None).prepare(made, 1, stop)
    needed = by_pause and current_A != 0.0 and (current_A < 0.0) != leads_swapped
    assert swapped is needed
    by_person = [("pauses.wait", made, 1, stop, ("swap_leads", True))]
    by_relay = [("coil.ramp_to", 0.0, stop), ("coil.wait_until_reached", stop), ("relay",), ("back", 1, stop)]
    assert calls == (by_relay if relay else by_person) * needed
    assert coil.leads_swapped is (not leads_swapped if needed and relay else leads_swapped)


@pytest.mark.parametrize(("relay", "leads_swapped"), [(False, False), (False, True), (True, False), (True, True)])
def test_leads_that_a_person_has_to_swap_back_are_told(relay: bool, leads_swapped: bool) -> None:
    calls: list[Any] = []
    made: Any = SimpleNamespace(coil=SimpleNamespace(leads_swapped=leads_swapped), on_event=noted(calls, "event"))
    Polarity(None, stop if relay else None).remind(made)
    message = "the leads of the coil are still swapped; swap them back before the next run"
    assert calls == [("event", Warned(message=message))] * (leads_swapped and not relay)


# States


def stepping_of(calls: list[Any], **more: Any) -> Any:
    # Return a run of three states whose parts note their calls; it began at 100 s.
    coil = Noted(
        calls, "coil", changed_s=130.0, leads_swapped=False, measured_A="measured",
        new_set_points=lambda: [SetPoint(101.0, 0.1, 0.01), SetPoint(103.5, 0.2, 0.02)],
    )  # fmt: skip
    protocol = SimpleNamespace(
        currents_A=(0.1, -0.2, 0.3), frames_per_state=3, tip_force_N=0.25, creep=False, ring_down_from_A=0.4,
        settle=SimpleNamespace(dwell_s=0.0, timeout_s=20.0), transients=SimpleNamespace(frames_per_state=4),
    )  # fmt: skip
    parts: dict[str, Any] = {
        "protocol": protocol,
        "specimen": "specimen",
        "calibration": SimpleNamespace(mT_per_A=5.0),
        "coil": coil,
        "camera": Noted(calls, "camera", newly_lost=Counter),
        "clock": Noted(calls, "clock", now=lambda: 150.0),
        "sensing": Noted(calls, "sensing", read="read"),
        "guardian": None,
        "noise": "noise",
        "writer": Noted(calls, "writer", ring_downs=0),
        "began_s": 100.0,
        "on_event": noted(calls, "event"),
    }
    return Stepping(**parts | more)


@pytest.mark.parametrize(
    ("state", "swapped", "passed"),
    [(0, False, []), (2, False, [0.1, -0.2]), (3, False, [0.1, -0.2, 0.3]), (3, True, [-0.2]), (1, True, [])],
)
def test_a_run_goes_back_through_the_earlier_currents_of_its_polarity(
    state: int, swapped: bool, passed: list[float]
) -> None:
    calls: list[Any] = []
    made = stepping_of(calls)
    made.coil.leads_swapped = swapped
    made.go_back_to(state, stop)
    assert calls == [("coil.ramp_to", current_A, stop) for current_A in passed]


def test_lost_frames_are_told_with_their_reasons() -> None:
    calls: list[Any] = []
    made = stepping_of(calls, camera=Noted(calls, "camera", newly_lost=lambda: Counter(late=2, torn=3)))
    assert made.report_lost_frames(1) == 5
    assert calls == [
        ("camera.newly_lost",),
        ("event", FramesLost(state=1, frames=5, reasons={"late": 2, "torn": 3})),
    ]
    calls.clear()
    assert stepping_of(calls).report_lost_frames(None) == 0
    assert calls == [("camera.newly_lost",)]


@pytest.mark.parametrize("fails", [False, True])
def test_frames_that_were_lost_before_a_state_or_before_its_failure_are_told(
    monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    calls: list[Any] = []
    made = stepping_of(calls)

    def take(*_: Any) -> None:
        if fails:
            raise InstrumentError("unplugged")

    monkeypatch.setattr(Stepping, "report_lost_frames", lambda self, state: calls.append(("lost", state)))
    monkeypatch.setattr(Stepping, "_take", lambda self, *given: (calls.append(("take", *given)), take())[1])
    if fails:
        with pytest.raises(InstrumentError, match="unplugged"):
            made.take(1, stop)
    else:
        made.take(1, stop)
    assert calls == [("lost", None), ("take", 1, stop), *[("lost", 1)] * fails]


FLAG, DROPPED = Flag("BLURRED", "finding", 1.0, 0.5, Severity.NOTE), judge({"missing_frames": 2})[0]


@pytest.mark.parametrize("creep", [False, True])
@pytest.mark.parametrize(("dwell_s", "lasts_s", "not_before_s"), [(0.0, 20.0, 0.0), (60.0, 60.0, 190.0)])
def test_a_state_is_taken_at_rest_and_stored_with_times_of_the_run(
    monkeypatch: pytest.MonkeyPatch, creep: bool, dwell_s: float, lasts_s: float, not_before_s: float
) -> None:
    calls: list[Any] = []
    kept = SimpleNamespace(see="see", moments=[Moment(FRAME, 120.0, 2.0, 0.3)])
    settled = Settling(1.1, 1.2, 4.5, () if creep else (FLAG,))
    taken = SimpleNamespace(
        frames=(FRAME, FRAME), measured_A=(0.11, 0.12), time_s=(140.0, 141.5), flags=(DROPPED,),
        sensed=({"hall": SensorReading(1.0, "mT", 140.25)}, {}),
    )  # fmt: skip
    monkeypatch.setattr(stepping, "Transient", noted(calls, "transient", lambda *_: kept))
    monkeypatch.setattr(stepping, "wait_until_settled", noted(calls, "settle", lambda *_: settled))
    monkeypatch.setattr(stepping, "capture", noted(calls, "capture", lambda *_: taken))
    made = stepping_of(calls, camera=Noted(calls, "camera", newly_lost=lambda: Counter(late=2)))
    made.protocol.creep, made.protocol.settle.dwell_s = creep, dwell_s
    made._take(1, stop)
    flags = (*settled.flags, DROPPED)
    rule = made.protocol.settle
    see = "see" if creep else settling.ignore_frame
    assert calls == [
        ("camera.at", 1, -0.2),
        ("coil.ramp_to", -0.2, stop),
        ("coil.wait_until_reached", stop),
        ("transient", 4, lasts_s, made.coil),
        ("settle", made.camera, made.clock, rule, "noise", stop, "see", not_before_s),
        ("event", Settled(state=1, waited_s=4.5, at_rest=creep)),
        ("coil.check",),
        ("capture", made.camera, made.clock, 3, "measured", "read", "noise", stop, see),
        ("camera.newly_lost",),
        ("event", FramesLost(state=1, frames=2, reasons={"late": 2})),
        ("coil.new_set_points",),
        (
            "writer.append_state",
            (FRAME, FRAME),
            ("current_A", -0.2),
            ("field_mT", -1.0),
            ("measured_A", (0.11, 0.12)),
            ("time_s", [40.0, 41.5]),
            ("tip_force_N", 0.25),
            ("flags", flags),
            ("transient", [Moment(FRAME, 20.0, 2.0, 0.3)]),
            ("sensed", [{"hall": SensorReading(1.0, "mT", 40.25)}, {}]),
            ("set_points", [SetPoint(1.0, 0.1, 0.01), SetPoint(3.5, 0.2, 0.02)]),
        ),
        (
            "event",
            StateStored(state=1, current_A=-0.2, waited_s=4.5, flags=tuple(flag.name for flag in flags)),
        ),
    ]


def test_additional_frames_are_stored_with_times_of_the_run() -> None:
    calls: list[Any] = []
    made = stepping_of(calls)
    made.store("name", [3], [])
    assert calls == []
    made.store("name", [3], [Moment(FRAME, 120.0, 2.0, 0.3)])
    assert calls == [("writer.append_recording", "name", [3], [Moment(FRAME, 20.0, 2.0, 0.3)])]


# Ring-downs


def test_each_missing_ring_down_begins_at_rest_at_its_current(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []

    @contextmanager
    def recording(*given: Any) -> Iterator[Any]:
        calls.append(("begin", *given))
        yield Noted(calls, "recorded")
        calls.append(("stored",))

    monkeypatch.setattr(ring_downs_module, "_recording", recording)
    monkeypatch.setattr(ring_downs_module, "wait_until_settled", noted(calls, "settle"))
    made = stepping_of(calls, writer=Noted(calls, "writer", ring_downs=1))
    rule = RingDown(seconds=1.0, repeats=3)
    with ExitStack() as unfinished:
        ring_downs_module.record_ring_downs(made, rule, unfinished, stop)
    assert calls == [
        call
        for number in (1, 2)
        for call in (
            ("coil.ramp_to", 0.4, stop),
            ("coil.wait_until_reached", stop),
            ("settle", made.camera, made.clock, made.protocol.settle, "noise", stop),
            ("begin", made, rule, number, 0.4),
            ("recorded.record", stop),
            ("stored",),
        )
    ]


@pytest.mark.parametrize("fails", [False, True])
def test_the_frames_of_a_ring_down_are_stored_after_an_error_too(monkeypatch: pytest.MonkeyPatch, fails: bool) -> None:
    calls: list[Any] = []

    @contextmanager
    def stream() -> Iterator[str]:
        calls.append("open")
        yield "stream"
        calls.append("closed")

    monkeypatch.setattr(ring_downs_module, "_store", noted(calls, "store"))
    made = stepping_of(calls, writer=SimpleNamespace(ring_down=stream))
    rule = RingDown(seconds=1.0)
    with (
        pytest.raises(KeyboardInterrupt) if fails else ExitStack(),
        ring_downs_module._recording(made, rule, 2, 0.4) as recorded,
    ):
        calls.append("record")
        if fails:
            raise KeyboardInterrupt
    assert (recorded.frames, recorded.step, recorded.began_s) == ([], None, 150.0)
    assert calls == ["open", ("clock.now",), "record", "closed", ("store", made, rule, 2, 0.4, recorded)]


class Swinging:
    # A camera, a clock and a coil: a frame takes 0.5 s, and the first begins at 10 s; `act` is called before each.

    simulated = True

    def __init__(self, act: Callable[[int], None] = lambda number: None) -> None:
        self.calls: list[Any] = []
        self.now_s, self.number, self.changed_s, self.act = 10.0, 0, 10.0, act

    def now(self) -> float:
        return self.now_s

    def flush(self) -> None:
        self.calls.append("flush")

    def grab(self, timeout_s: float) -> Frame:
        assert timeout_s == 5.0
        self.act(self.number)
        self.number += 1
        self.now_s += 0.5
        return Frame(np.full((1, 1), self.number, np.uint8), self.number, self.now_s)

    def step_to(self, current_A: float) -> SetPoint:
        self.calls.append(("step", current_A))
        return SetPoint(self.changed_s, current_A, 0.01)

    def watch(self, *, early_s: float) -> None:
        self.calls.append(("watch", early_s))

    def recorder(self) -> Any:
        put = noted(self.calls, "put", lambda image, stop_if_asked: None)
        made: Any = SimpleNamespace(camera=self, clock=self, coil=self)
        return ring_downs_module._Recorded(made, RingDown(seconds=1.0), SimpleNamespace(put=put))  # type: ignore[arg-type]


def test_a_simulated_ring_down_is_recorded_for_its_time_after_the_step() -> None:
    bench = Swinging()
    recorded = bench.recorder()
    recorded.record(noted(bench.calls, "stop"))
    assert recorded.step == SetPoint(10.0, 0.0, 0.01)
    assert [at_s for _, at_s in recorded.frames] == [10.5, 11.0]
    assert [(frame.number, frame.timestamp_s, frame.image.size) for frame, _ in recorded.frames] == [
        (1, 10.5, 0),
        (2, 11.0, 0),
    ]
    flush, step, *taken = bench.calls
    assert (flush, step) == ("flush", ("step", 0.0))
    assert [call[0] for call in taken] == ["stop", "put"] * 2
    assert [int(call[1][0, 0]) for call in taken if call[0] == "put"] == [1, 2]


def test_a_second_thread_sets_the_current_to_zero_and_watches_the_supply(monkeypatch: pytest.MonkeyPatch) -> None:
    # The step comes at 11 s, when two frames are taken; the frames end 1 s after it.
    monkeypatch.setattr(ring_downs_module, "_LOOK_EVERY_S", 0.001)
    bench: Any = None

    def wait_for_the_other_thread(number: int) -> None:
        if number == 2:
            wait_until(lambda: recorded.step is not None, PATIENCE_S)
        if number == 3:
            wait_until(lambda: ("watch", 0.5) in bench.calls, PATIENCE_S)

    bench = Swinging(wait_for_the_other_thread)
    bench.simulated = False
    recorded = bench.recorder()

    def step_to(current_A: float) -> SetPoint:
        wait_until(lambda: bench.number == 2, PATIENCE_S)
        bench.changed_s = bench.now_s
        return SetPoint(bench.changed_s, current_A, 0.02)

    bench.step_to = step_to
    recorded.record(lambda: None)
    assert recorded.step == SetPoint(11.0, 0.0, 0.02)
    assert [at_s for _, at_s in recorded.frames] == [10.5, 11.0, 11.5, 12.0]


@pytest.mark.parametrize("in_the_run", [False, True])
def test_an_error_in_a_ring_down_ends_both_threads(monkeypatch: pytest.MonkeyPatch, in_the_run: bool) -> None:
    monkeypatch.setattr(ring_downs_module, "_LOOK_EVERY_S", 0.001)
    bench = Swinging()
    bench.simulated = False

    def fail(*_: Any) -> Any:
        raise InstrumentError("unplugged")

    if in_the_run:
        bench.act = fail
        bench.changed_s = 1e9
    else:
        bench.step_to = fail  # type: ignore[method-assign]
    with pytest.raises(InstrumentError, match="unplugged"):
        bench.recorder().record(lambda: None)


# The output after and before a run


def test_the_event_of_a_coil_that_is_off_says_what_was_measured() -> None:
    killed = ("guardian", "run_died", True, "COM3", "; one step failed")
    said = {"by": "guardian", "takeover": "run_died", "run_killed": True, "address": "COM3"}
    assert off_confirmed(Off(0.01, 0.05), *killed) == OffConfirmed(  # type: ignore[arg-type]
        determined_by="measured",
        current_A=0.01,
        limit_A=0.05,
        remark="; one step failed",
        **said,  # type: ignore[arg-type]
    )
    assert off_confirmed(Off(0.01, 0.05, found_off=True), *killed).remark == FOUND_OFF + "; one step failed"  # type: ignore[arg-type]
    assert off_confirmed(None, *killed) == OffConfirmed(  # type: ignore[arg-type]
        determined_by="commanded",
        remark="; one step failed",
        **said,  # type: ignore[arg-type]
    )
    assert off_confirmed(None, "run") == OffConfirmed(by="run", determined_by="commanded")


@pytest.mark.parametrize("doubted", [False, True])
def test_a_doubt_is_sent_by_a_timer_that_ends_with_the_switching_off(
    monkeypatch: pytest.MonkeyPatch, doubted: bool
) -> None:
    calls: list[Any] = []
    timer = Noted(calls, "timer")

    def fail() -> None:
        calls.append("body")
        raise KeyError

    monkeypatch.setattr(doubt.threading, "Timer", noted(calls, "make", timer))
    event: Any = OffNotConfirmed(by="run", reason="x") if doubted else None
    with pytest.raises(KeyError), doubt.doubted_after(0.5, event, stop):  # type: ignore[arg-type]
        fail()
    before = [("make", 0.5, stop, (event,)), ("timer.start",)]
    assert calls == [*before * doubted, "body", *[("timer.cancel",), ("timer.join",)] * doubted]
    assert vars(timer).get("daemon") is (True if doubted else None)


@pytest.mark.parametrize(("guarded", "ramp_failed"), [(False, ""), (True, ""), (True, "no answer")])
def test_the_guardian_is_disarmed_after_the_coil_is_off(
    monkeypatch: pytest.MonkeyPatch, guarded: bool, ramp_failed: str
) -> None:
    calls: list[Any] = []
    off = Off(0.01, 0.05)
    guardian: Any = Noted(calls, "guardian") if guarded else None
    coil: Any = Noted(calls, "coil", switch_off=lambda: off, unreachable="")
    monkeypatch.setattr(switching_off, "doubted_after", lambda *given: calls.append(("doubt", *given)) or nullcontext())
    event = noted(calls, "event")
    switching_off._off(coil, guardian, event, ramp_failed)
    told = OffNotConfirmed(by="run", reason=ramp_failed, trying_process=os.getpid()) if ramp_failed else None
    assert calls == [
        *[("guardian.allow", 30.0)] * guarded,
        ("doubt", 0.5, told, event),
        ("coil.switch_off",),
        *[("guardian.disarm",)] * guarded,
        ("event", OutputSwitched(on=False)),
        ("event", off_confirmed(off, "run")),
    ]


@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("guarded", [False, True])
def test_a_coil_that_may_be_on_is_left_to_its_guardian(
    monkeypatch: pytest.MonkeyPatch, measured: bool, guarded: bool
) -> None:
    calls: list[Any] = []
    error = SwitchOffFailed("still on", 0.4, 0.05) if measured else InstrumentError("no answer")

    def fail() -> None:
        raise error

    guardian: Any = Noted(calls, "guardian") if guarded else None
    coil: Any = Noted(calls, "coil", switch_off=fail, unreachable="")
    monkeypatch.setattr(switching_off, "doubted_after", lambda *given: nullcontext())
    with pytest.raises(InstrumentError) as caught:
        switching_off._off(coil, guardian, noted(calls, "event"))
    assert caught.value is error
    facts = {"current_A": 0.4, "limit_A": 0.05} if measured else {}
    assert calls == [
        *[("guardian.allow", 30.0)] * guarded,
        ("coil.switch_off",),
        ("event", OffNotConfirmed(by="run", reason=str(error), **facts)),
        *[("guardian.arm",)] * guarded,
        *[("guardian.recognise",)] * (guarded and measured),
    ]


@pytest.mark.parametrize("simulated", [False, True])
@pytest.mark.parametrize("take_over", [False, True])
@pytest.mark.parametrize(
    ("on", "current_A", "asked_A"), [(False, 0.0, 0.0), (True, 0.4, 0.4), (True, 3.0, 2.0), (True, -3.0, -2.0)]
)
def test_a_run_begins_with_the_output_off(
    monkeypatch: pytest.MonkeyPatch, simulated: bool, take_over: bool, on: bool, current_A: float, asked_A: float
) -> None:
    calls: list[Any] = []
    events: list[Any] = []

    @contextmanager
    def switching_off(*given: Any) -> Iterator[None]:
        calls.append(("off", *given))
        yield

    monkeypatch.setattr(output_off, "off_limit_A", lambda supply: 0.05)
    monkeypatch.setattr(output_off, "Coil", noted(calls, "coil", lambda *_, **__: "coil"))
    monkeypatch.setattr(output_off, "switching_off", switching_off)
    identity = SimpleNamespace(address="COM3")
    supply = Noted(
        calls, "supply", output_on=lambda: on, measure=lambda: Reading(current_A, 1.5), identify=lambda: identity,
        limits=SimpleNamespace(current_A=2.0),
    )  # fmt: skip
    bench: Any = SimpleNamespace(supply=supply, clock="clock", guardian="guardian", interruption="interruption")
    ramp = Ramp(rate_A_per_s=1.0, step_A=0.1, tolerance_A=0.02)
    if on and not take_over:
        words = rf"^COM3: the output is on \({current_A:.3f} A, 1\.50 V\); .*--take-over switches it off first$"
        with pytest.raises(InstrumentError, match=words) as it:
            output_off.begin_with_output_off(bench, ramp, take_over, simulated, events.append)
        (event,) = events
        assert event == OffNotConfirmed(by="run", reason=str(it.value), time_s=event.time_s)
    else:
        output_off.begin_with_output_off(bench, ramp, take_over, simulated, stop)  # type: ignore[arg-type]
    switched = [
        ("coil", supply, "clock", ramp, ("asked_A", asked_A)),
        ("off", "coil", "guardian", "interruption", stop),
    ]
    assert [call for call in calls if call[0] in ("coil", "off")] == switched * (on and take_over)
    assert (("supply.measure",) in calls) == (on or not simulated)


@pytest.mark.parametrize(
    ("current_A", "measures", "refused"),
    [(0.05, True, False), (0.06, True, True), (-0.06, True, True), (0.06, False, False), (0.06, None, True)],
)
def test_a_current_with_the_output_off_is_refused(
    monkeypatch: pytest.MonkeyPatch, current_A: float, measures: bool | None, refused: bool
) -> None:
    monkeypatch.setattr(output_off, "off_limit_A", lambda supply: 0.05)
    supply = SimpleNamespace(
        output_on=lambda: False,
        measure=lambda: Reading(current_A, 0.0),
        identify=lambda: SimpleNamespace(address="COM3"),
        **({} if measures is None else {"measures_current": measures}),
    )
    bench: Any = SimpleNamespace(supply=supply)
    events: list[Any] = []
    if not refused:
        output_off.begin_with_output_off(bench, None, False, False, stop)  # type: ignore[arg-type]
        return
    with pytest.raises(SwitchOffFailed, match=rf"^COM3: {current_A:.3f} A measured although the output is off; ") as it:
        output_off.begin_with_output_off(bench, None, False, False, events.append)  # type: ignore[arg-type]
    assert (it.value.current_A, it.value.limit_A) == (current_A, 0.05)
    (event,) = events
    assert (type(event), event.reason, event.current_A, event.limit_A) == (
        *(OffNotConfirmed, str(it.value), current_A, 0.05),
    )
    assert str(it.value).endswith("the output counts as off at 0.05 A or less")


# The whole run


@pytest.mark.parametrize("pause_before", [None, 1, 2, 3])
@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(("first", "optional"), [(0, True), (1, True), (0, False)])
def test_a_run_goes_through_its_steps_and_ends_with_the_output_off(
    monkeypatch: pytest.MonkeyPatch, pause_before: int | None, swapped: bool, first: int, optional: bool
) -> None:
    calls: list[Any] = []

    @contextmanager
    def switching_off(*given: Any) -> Iterator[Any]:
        calls.append(("on", *given))
        yield stop_if_asked
        calls.append(("off",))

    stop_if_asked = noted(calls, "stop")
    monkeypatch.setattr(run, "switching_off", switching_off)
    monkeypatch.setattr(run, "condition", noted(calls, "condition"))
    monkeypatch.setattr(run, "record_ring_downs", noted(calls, "ring-downs"))
    pauses: Any = Noted(calls, "pauses", asked=False, heeded_by=lambda stop: "heeding")
    polarity: Any = Noted(calls, "polarity", prepare=lambda *_: swapped)
    supply = Noted(calls, "supply")
    protocol = SimpleNamespace(
        currents_A=(0.1, 0.2, 0.3),
        conditioning="cycles" if optional else None,
        ring_down="rule" if optional else None,
    )

    def take(state: int, _: Any) -> None:
        pauses._answers["asked"] = state + 1 == pause_before

    made: Any = SimpleNamespace(
        coil=SimpleNamespace(supply=supply), protocol=protocol, guardian="guardian", on_event=noted(calls, "event"),
        sensing=Noted(calls, "sensing"), go_back_to=noted(calls, "back"), take=noted(calls, "take", take),
        report_lost_frames=noted(calls, "lost"), writer=Noted(calls, "writer"), new_set_points=lambda: "points",
    )  # fmt: skip
    run._step_through(made, first, "interruption", pauses, polarity, None)  # type: ignore[arg-type]
    states: list[Any] = []
    for state in range(first, 3):
        states += [("pauses.wait", made, state, stop_if_asked)] * (state == pause_before and state > first)
        states += [
            ("polarity.prepare", made, state, stop_if_asked),
            *[("pauses.heeded_by", stop_if_asked), ("take", state, "heeding")] * (optional or state < 2),
            *[("take", state, stop_if_asked)] * (state == 2 and not optional),
        ]
    states += [("pauses.wait", made, 3, stop_if_asked)] * (pause_before == 3 and optional)
    unfinished = next((call[3] for call in calls if call[0] == "ring-downs"), None)
    assert calls == [
        ("on", made.coil, "guardian", "interruption", made.on_event),
        ("stop",),
        ("supply.set_output", True),
        ("event", OutputSwitched(on=True)),
        ("sensing.measure_at_rest", made.coil, stop_if_asked),
        *[("condition", made, "cycles", stop_if_asked)] * (optional and not first),
        ("polarity.prepare", made, first, stop_if_asked),
        *[("back", first, stop_if_asked)] * (not swapped),
        *states,
        *[("ring-downs", made, "rule", unfinished, stop_if_asked)] * optional,
        ("off",),
        ("lost", None),
        ("polarity.remind", made),
        ("writer.append_set_points", "points"),
    ]
    assert isinstance(unfinished, ExitStack) or not optional


def test_a_stopped_run_says_what_it_leaves_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []

    @contextmanager
    def switching_off(*given: Any) -> Iterator[Any]:
        yield stop
        raise Stopped(15)

    monkeypatch.setattr(run, "switching_off", switching_off)
    monkeypatch.setattr(
        run, "left_behind", lambda off, event: f"{off} {event.status}, {event.stored} of {event.states}"
    )
    made: Any = SimpleNamespace(
        coil=SimpleNamespace(supply=Noted(calls, "supply")), on_event=stop, guardian=None, take=stop,
        protocol=SimpleNamespace(currents_A=(), conditioning=None, ring_down=None), sensing=Noted(calls, "sensing"),
        report_lost_frames=noted(calls, "lost"), go_back_to=noted(calls, "back"), writer=Noted(calls, "writer"),
        new_set_points=lambda: "points",
    )  # fmt: skip
    made.on_event = lambda event: None
    ending = run._Ending(Path("run.h5"), SimpleNamespace(currents_A=(0.1,) * 4), 3, None, "off")  # type: ignore[arg-type]
    polarity: Any = Noted(calls, "polarity")
    with pytest.raises(Stopped) as caught:
        run._step_through(made, 0, "interruption", Noted(calls, "pauses"), polarity, ending)  # type: ignore[arg-type]
    assert (caught.value.number, str(caught.value)) == (15, str(Stopped(15, "off stopped, 3 of 4")))
    assert calls[-3:] == [("lost", None), ("polarity.remind", made), ("writer.append_set_points", "points")]
