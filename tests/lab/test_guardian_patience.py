"""The guardian (the process that switches the coil off) takes over, and stops its attempts, at the right time."""

from __future__ import annotations

import itertools
import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from typing import cast

import pytest

from eimi_drivers.interfaces import Identity, InstrumentTimeout, Off, PowerSupply, Reading, SwitchOffFailed
from eimi_drivers.supplies.off import off_limit_A
from eimi_lab.acquisition import guardian_process
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.events import (
    Event,
    GuardianTookOver,
    OffConfirmed,
    OffNotConfirmed,
    OnEvent,
    RunKilled,
    Takeover,
    Warned,
)
from eimi_lab.acquisition.guardian import (
    ALLOW,
    ARM,
    BEAT,
    DISARM,
    READY,
    RECOGNISED,
    STILL_FOR_S,
    SUPPLY,
    TAKE_OVER,
    TAKING_OVER,
    Guardian,
    Ward,
)
from eimi_lab.acquisition.guardian_process import (
    ASKED,
    DIED,
    ENDED_WITH_OTHERS,
    REPORT_EVERY_S,
    STANDS_STILL,
    TRY_AGAIN_LATER_S,
    TRY_FOR_S,
    _try_once,
    _wait_until_needed,
    stand_guard,
    switch_off_for_the_run,
)
from eimi_lab.acquisition.switching_off import ramp_down_and_switch_off
from eimi_lab.process.detached import Starter

WARD = Ward("korad", "/dev/nowhere", 1.0, 10.0)


class Passing:
    # A clock that replaces the module `time`; it advances only while the guardian process waits.

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Passing:
    passing = Passing()
    monkeypatch.setattr(guardian_process, "time", passing)
    return passing


class Run:
    # A run that sends messages to its guardian process at given times.

    def __init__(self, clock: Passing, monkeypatch: pytest.MonkeyPatch) -> None:
        self._clock, self._began_s = clock, clock.now_s
        reading, self._writing = os.pipe()
        self._heard, saying = os.pipe()
        self._descriptors = [reading, self._heard, saying]
        self._due: list[tuple[float, bytes]] = []
        monkeypatch.setattr(guardian_process, "FROM_RUN", reading)
        monkeypatch.setattr(guardian_process, "TO_RUN", saying)
        monkeypatch.setattr(guardian_process, "readable", self._readable)

    def _readable(self, descriptor: int, within_s: float) -> bool:
        if self._due and self._due[0][0] <= self._clock.now_s - self._began_s + within_s:
            at_s, message = self._due.pop(0)
            self._clock.now_s = max(self._clock.now_s, self._began_s + at_s)
            if message:
                os.write(self._writing, message)
            else:
                os.close(self._writing)
            return True
        self._clock.sleep(within_s)
        if self._clock.now_s - self._began_s > 1000.0:
            pytest.fail("the guardian waits without end")
        return False

    def decided(self, *messages: tuple[float, bytes]) -> tuple[Takeover | None, Ward, float]:
        # Return why the guardian process takes over (None after a normal end), for which supply, and when (s).
        # messages: pairs of time (s) and message.
        self._due = list(messages)
        takeover, ward = _wait_until_needed(WARD)
        return takeover, ward, self._clock.now_s - self._began_s

    def close(self) -> None:
        for descriptor in self._descriptors:
            os.close(descriptor)


@pytest.fixture
def run(clock: Passing, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    made = Run(clock, monkeypatch)
    yield made
    made.close()


def line(message: bytes) -> bytes:
    return message + b"\n"


@pytest.mark.parametrize(
    ("messages", "takeover"),
    [
        ([(1.0, b"")], None),
        ([(1.0, line(ARM)), (2.0, b"")], DIED),
        ([(1.0, line(ARM)), (2.0, line(DISARM)), (60.0, b"")], None),
        ([(1.0, line(ARM)), (2.0, line(DISARM)), (60.0, line(ARM)), (61.0, b"")], DIED),
        ([(1.0, line(ARM)), (2.0, line(TAKE_OVER))], ASKED),
        ([(1.0, line(ARM)[:1]), (1.5, line(ARM)[1:]), (2.0, b"")], DIED),
    ],
    ids=["never on", "dead while on", "dead after off", "dead after a pause", "asked", "message in two parts"],
)
def test_the_guardian_takes_over_for_a_run_that_ends_while_its_coil_may_be_on(
    run: Run, messages: list[tuple[float, bytes]], takeover: Takeover | None
) -> None:
    assert run.decided(*messages)[0] == takeover


def test_a_run_that_stands_still_is_noticed_within_the_stated_time(run: Run) -> None:
    beats = [(float(second), line(BEAT)) for second in range(2, 40, 4)]
    takeover, _, at_s = run.decided((1.0, line(ARM)), *beats)
    assert takeover == STANDS_STILL
    assert beats[-1][0] + STILL_FOR_S < at_s < beats[-1][0] + STILL_FOR_S + 1.0


def test_a_longer_time_is_allowed_once_and_not_for_ever(run: Run) -> None:
    messages = [(1.0, line(ARM)), (2.0, line(ALLOW + b"60.0")), (50.0, line(BEAT))]
    takeover, _, at_s = run.decided(*messages)
    assert takeover == STANDS_STILL
    assert 50.0 + STILL_FOR_S < at_s < 50.0 + STILL_FOR_S + 1.0


def test_an_allowed_time_ends(run: Run) -> None:
    takeover, _, at_s = run.decided((1.0, line(ARM)), (2.0, line(ALLOW + b"60.0")))
    assert takeover == STANDS_STILL
    assert 62.0 < at_s < 63.0


def test_the_guardian_switches_off_the_supply_that_the_run_named(run: Run) -> None:
    message = line(SUPPLY + json.dumps(["KORAD KA3005P", "7"]).encode())
    _, ward, _ = run.decided((1.0, message + line(ARM)), (2.0, line(RECOGNISED)), (3.0, b""))
    assert ward.identity == ("KORAD KA3005P", "7")
    assert ward.recognised
    assert (ward.driver, ward.address) == (WARD.driver, WARD.address)


class Attempts:
    # A replacement for the function that switches the coil off: it raises `errors` first, then may succeed.

    def __init__(self, clock: Passing, *errors: Exception, succeed: bool) -> None:
        self._clock, self._errors, self._succeed = clock, errors, succeed
        self.at_s: list[float] = []

    def __call__(self, ward: Ward, was_on: set[bool]) -> tuple[Off | None, str]:
        self.at_s.append(self._clock.now_s)
        if not isinstance(ward, Ward) or was_on != ({True} if ward.recognised else set()):
            pytest.fail(f"an attempt was made with {ward}, {was_on}")
        if len(self.at_s) > 2 * TRY_FOR_S:
            pytest.fail("the guardian tries without end")
        if len(self.at_s) <= len(self._errors):
            raise self._errors[len(self.at_s) - 1]
        if not self._succeed:
            raise self._errors[-1]
        return Off(0.0, 0.02), ""


class Process:
    def __init__(self) -> None:
        self.killed = 0

    def runs(self) -> bool:
        return not self.killed

    def kill(self) -> None:
        self.killed += 1


def switched_off(
    monkeypatch: pytest.MonkeyPatch, attempts: Attempts, takeover: Takeover
) -> tuple[list[tuple[float, Event]], Process]:
    # Let the guardian process switch the coil off; return its events with times (s), and the process of the run.
    monkeypatch.setattr(guardian_process, "_try_once", attempts)
    events: list[tuple[float, Event]] = []
    process = Process()
    clock = cast("Passing", guardian_process.time)
    switch_off_for_the_run(WARD, takeover, cast(Starter, process), lambda event: events.append((clock.now_s, event)))
    return events, process


SILENT = InstrumentTimeout("/dev/nowhere: no complete answer within 1 s")


@pytest.mark.parametrize("error", [SILENT, ZeroDivisionError("in a library")], ids=["no answer", "error of a program"])
def test_the_guardian_tries_for_an_hour_and_reports_every_minute(
    monkeypatch: pytest.MonkeyPatch, clock: Passing, error: Exception
) -> None:
    attempts = Attempts(clock, error, succeed=False)
    events, _ = switched_off(monkeypatch, attempts, DIED)
    assert TRY_FOR_S < clock.now_s - attempts.at_s[0] < TRY_FOR_S + REPORT_EVERY_S
    waits_s = [later - earlier for earlier, later in zip(attempts.at_s, attempts.at_s[1:], strict=False)]
    assert waits_s[0] < TRY_AGAIN_LATER_S
    assert max(waits_s) == TRY_AGAIN_LATER_S
    reports = [event for _, event in events]
    assert all(isinstance(event, OffNotConfirmed) and str(error) in event.reason for event in reports)
    trying = [event.trying_process for event in reports if isinstance(event, OffNotConfirmed)]
    assert trying == [os.getpid()] * (len(trying) - 1) + [None]
    between_s = [later - earlier for (earlier, _), (later, _) in itertools.pairwise(events[:-1])]
    assert len(events) >= TRY_FOR_S / REPORT_EVERY_S
    assert all(REPORT_EVERY_S < gap_s <= REPORT_EVERY_S + TRY_AGAIN_LATER_S for gap_s in between_s)


def test_the_guardian_ends_with_the_attempt_that_finds_the_coil_off(
    monkeypatch: pytest.MonkeyPatch, clock: Passing
) -> None:
    attempts = Attempts(clock, SILENT, SILENT, SILENT, succeed=True)
    events, process = switched_off(monkeypatch, attempts, DIED)
    ((_, event),) = events
    assert isinstance(event, OffConfirmed)
    assert (event.by, event.takeover, event.run_killed, event.address) == ("guardian", DIED, False, WARD.address)
    assert len(attempts.at_s) == 4
    assert process.killed == 0


@pytest.mark.parametrize(
    ("error", "takeover", "killed"),
    [
        (SILENT, STANDS_STILL, 1),
        (SILENT, DIED, 0),
        (SILENT, ASKED, 0),
        (SwitchOffFailed("0.8 A measured", 0.8, 0.02), STANDS_STILL, 0),
    ],
)
def test_only_a_run_that_stands_still_and_holds_the_line_is_killed(
    monkeypatch: pytest.MonkeyPatch, clock: Passing, error: Exception, takeover: Takeover, killed: int
) -> None:
    attempts = Attempts(clock, error, error, succeed=True)
    events, process = switched_off(monkeypatch, attempts, takeover)
    assert process.killed == killed
    assert [event for _, event in events if isinstance(event, RunKilled)] == [
        RunKilled(address=WARD.address, reason=f"{type(error).__name__}: {error}") for _ in range(killed)
    ]
    confirmed = events[-1][1]
    assert isinstance(confirmed, OffConfirmed)
    assert confirmed.run_killed is bool(killed)


def test_a_measured_current_is_in_the_report(monkeypatch: pytest.MonkeyPatch, clock: Passing) -> None:
    attempts = Attempts(clock, SwitchOffFailed("0.8 A measured", 0.8, 0.02), succeed=False)
    events, _ = switched_off(monkeypatch, attempts, DIED)
    for _, event in events:
        assert isinstance(event, OffNotConfirmed)
        assert (event.current_A, event.limit_A, event.reason) == (0.8, 0.02, "0.8 A measured")
        assert (event.by, event.takeover, event.run_killed) == ("guardian", DIED, False)


class Supply:
    # A supply whose output is on although no current flows; if `stays_on`, the output cannot be switched off.

    def __init__(self, stays_on: bool) -> None:
        self.limits = WARD.limits
        self._on = [stays_on, True]
        self.closed = False

    def identify(self) -> Identity:
        return Identity("korad", "KORAD KA3005P", WARD.address, "7")

    def output_on(self) -> bool:
        return self._on.pop()

    def measure(self) -> Reading:
        return Reading(0.0, 0.0)

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize("stays_on", [True, False])
def test_a_failed_stage_is_forgiven_only_if_the_output_is_off_in_the_end(
    monkeypatch: pytest.MonkeyPatch, stays_on: bool
) -> None:
    def fail(supply: object, clock: object) -> Off:
        raise SwitchOffFailed("zero: failed; off: done; verify: failed")

    supply = Supply(stays_on)
    monkeypatch.setattr(guardian_process, "open_supply", lambda *_: supply)
    monkeypatch.setattr(guardian_process, "switch_off", fail)
    ward = replace(WARD, identity=("KORAD KA3005P", "7"))
    was_on: set[bool] = set()
    if stays_on:
        with pytest.raises(SwitchOffFailed, match="zero: failed"):
            _try_once(ward, was_on)
    else:
        off, remark = _try_once(ward, was_on)
        assert off == Off(0.0, off_limit_A(cast(PowerSupply, supply)))
        assert remark == "; one step of switching the supply off failed (zero: failed; off: done; verify: failed)"
    assert was_on == {True}
    assert supply.closed


class Recorder:
    def __init__(self) -> None:
        self.calls: list[str] = []

    def allow(self, seconds: float) -> None:
        self.calls.append("allow")

    def arm(self) -> None:
        self.calls.append("arm")

    def recognise(self) -> None:
        self.calls.append("recognise")

    def disarm(self) -> None:
        self.calls.append("disarm")


class CannotStop:
    # A coil whose supply fails to switch off.

    unreachable = ""

    def __init__(self, error: Exception) -> None:
        self._error = error

    def ramp_down(self, go_on_down: object) -> None:
        pass

    def switch_off(self) -> None:
        raise self._error


@pytest.mark.parametrize(
    ("error", "current_A", "limit_A", "expected"),
    [
        (SwitchOffFailed("0.8 A measured", 0.8, 0.02), 0.8, 0.02, ["allow", "arm", "recognise"]),
        (SwitchOffFailed("no answer"), None, None, ["allow", "arm"]),
        (ZeroDivisionError("in a driver"), None, None, ["allow", "arm"]),
    ],
)
def test_a_current_that_the_run_cannot_stop_is_reported_and_left_to_the_guardian(
    error: Exception, current_A: float | None, limit_A: float | None, expected: list[str]
) -> None:
    guardian, events = Recorder(), list[Event]()
    with pytest.raises(type(error)):
        ramp_down_and_switch_off(cast(Coil, CannotStop(error)), cast(Guardian, guardian), on_event=events.append)
    assert guardian.calls == expected
    assert events == [OffNotConfirmed(by="run", reason=str(error), current_A=current_A, limit_A=limit_A)]


class Surroundings:
    # Replacements for what the guardian (the process that watches a run) calls; `done` lists its calls in order.

    def __init__(self, monkeypatch: pytest.MonkeyPatch, takeover: Takeover | None, ends_with_others: bool) -> None:
        self.done: list[object] = []
        self.ignored: set[str] = set()
        self.doubt: OffNotConfirmed | None = None
        self.run = object()
        self.sent = replace(WARD, identity=("KORAD KA3005P", "7"))

        def record(name: str, answer: object = None) -> None:
            def act(*arguments: object) -> object:
                self.done.append(name)
                return answer

            monkeypatch.setattr(guardian_process, name, act)

        for name in ("be_shut_down_last", "never_wait_to_write", "share_ports"):
            record(name)
        record("when_closed")
        record("ended_with_others", ends_with_others)
        record("move_to_own_scope", True)
        record("Starter", self.run)
        record("_wait_until_needed", (takeover, self.sent))
        monkeypatch.setattr(guardian_process, "_say", self.done.append)
        monkeypatch.setattr(guardian_process, "doubted_after", self._doubted_after)
        monkeypatch.setattr(guardian_process, "switch_off_for_the_run", self._switch_off)
        monkeypatch.setattr(guardian_process.signal, "signal", self._handle)

    def _handle(self, number: int, handler: object) -> None:
        assert handler == signal.SIG_IGN
        self.ignored.add(signal.Signals(number).name)

    @contextmanager
    def _doubted_after(self, seconds: float, doubt: OffNotConfirmed | None, on_event: object) -> Iterator[None]:
        assert (seconds, on_event) == (2.0, self.done.append)
        self.doubt = doubt
        yield

    def _switch_off(self, *arguments: object) -> None:
        self.done.append(("switches off", *arguments))


@pytest.mark.parametrize("takeover", [None, DIED, STANDS_STILL, ASKED])
@pytest.mark.parametrize("ends_with_others", [False, True])
def test_the_guardian_prepares_waits_and_takes_over(
    monkeypatch: pytest.MonkeyPatch, takeover: Takeover | None, ends_with_others: bool
) -> None:
    around = Surroundings(monkeypatch, takeover, ends_with_others)
    stand_guard(WARD, around.done.append)
    assert around.ignored >= {"SIGINT", "SIGHUP", "SIGTERM", "SIGPIPE"}
    prepared: list[object] = ["when_closed", "be_shut_down_last", "ended_with_others"]
    prepared += [Warned(message=ENDED_WITH_OTHERS)] * ends_with_others
    prepared += ["Starter", "never_wait_to_write", "move_to_own_scope", READY, "_wait_until_needed"]
    if takeover is None:
        assert around.done == prepared
        return
    assert around.done == [
        *prepared,
        *(["share_ports", TAKING_OVER] if takeover == STANDS_STILL else []),
        GuardianTookOver(takeover=takeover, address=WARD.address),
        ("switches off", around.sent, takeover, around.run, around.done.append),
    ]
    assert around.doubt == (
        None
        if takeover == ASKED
        else OffNotConfirmed(
            by="guardian",
            reason="the supply did not confirm within 2 s that its output is off",
            takeover=takeover,
            trying_process=os.getpid(),
        )
    )


@pytest.mark.parametrize(
    ("serial_number", "answers", "on", "words"),
    [
        ("7", False, True, r"was switched off, 0\.00 A measured, but it did not answer with its identity, .*no answer"),
        ("", True, False, r"was already off, 0\.00 A measured, but the supply has no serial number"),
        ("7", True, False, None),
        ("", True, True, None),
    ],
)
def test_a_supply_that_may_be_another_one_is_not_reported_as_off(
    monkeypatch: pytest.MonkeyPatch, serial_number: str, answers: bool, on: bool, words: str | None
) -> None:
    class Found(Supply):
        def identify(self) -> Identity:
            if not answers:
                raise InstrumentTimeout("no answer")
            return replace(super().identify(), serial_number=serial_number)

        def output_on(self) -> bool:
            return on

    monkeypatch.setattr(guardian_process, "open_supply", lambda *_: Found(False))
    monkeypatch.setattr(guardian_process, "switch_off", lambda supply, clock: Off(0.0, 0.02))
    ward = replace(WARD, identity=("KORAD KA3005P", serial_number))
    if words is None:
        assert _try_once(ward, set()) == (Off(0.0, 0.02, found_off=not on), "")
    else:
        with pytest.raises(SwitchOffFailed, match=words):
            _try_once(ward, set())


def test_the_program_of_the_guardian_reads_its_supply_and_prints_its_events(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    unpacked: list[tuple[str, object]] = []

    def stand(ward: Ward, on_event: OnEvent) -> None:
        assert ward == WARD
        on_event(GuardianTookOver(takeover=DIED, address=ward.address))
        on_event(Warned(message="a remark"))

    monkeypatch.setattr(guardian_process, "stand_guard", stand)
    monkeypatch.setattr(guardian_process, "unpack", lambda name, packed: unpacked.append((name, packed)))
    levels: list[str] = []
    monkeypatch.setattr(guardian_process, "log_to_stderr", levels.append)
    monkeypatch.setenv(guardian_process.VARIABLE, "debug")
    guardian_process.main(json.dumps(asdict(WARD)))
    monkeypatch.delenv(guardian_process.VARIABLE)
    assert capfd.readouterr().err == "eimi guardian: warning: a remark\n"
    assert unpacked == [(WARD.driver, WARD.packed)]
    guardian_process.main(json.dumps(asdict(WARD)))
    assert levels == ["debug", ""]
