"""After each signal (such as Ctrl-C), a run makes the right calls and reports the right events, in the right order."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from typing import Any

import pytest

from eimi_drivers.interfaces import InstrumentError, Off, SwitchOffFailed
from eimi_lab.acquisition import switching_off as module
from eimi_lab.acquisition.events import (
    Event,
    OffConfirmed,
    OffNotConfirmed,
    OutputSwitched,
    StopRequested,
    SuspendRefused,
)
from eimi_lab.acquisition.guardian import StoodStill
from eimi_lab.acquisition.switching_off import _InHaste, _SignalsHeeded, ramp_down_and_switch_off, switching_off
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped
from tests.patience import PATIENCE_S

OFF = Off(0.004, 0.02)


class Part:
    # A replacement for a coil or for its guardian process: it records its calls, and raises `errors`.

    def __init__(self, done: list[Any], **answers: Any) -> None:
        self.done, self.answers = done, answers
        self.errors: dict[str, BaseException] = {}
        self.during: dict[str, Callable[[], object]] = {}
        self.out_of_control, self.unreachable = False, ""

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            given = tuple(argument for argument in arguments if not callable(argument))
            self.done.append((name, *given, *options.items()))
            if name in self.during:
                self.during[name]()
            if name in self.errors:
                raise self.errors[name]
            return self.answers.get(name)

        return call


class Bench:
    def __init__(self) -> None:
        self.done: list[Any] = []
        self.events: list[Event] = []
        self.coil: Any = Part(self.done, switch_off=OFF)
        self.guardian: Any = Part(self.done, silent_s=1.7)

    def heeded(self) -> _SignalsHeeded:
        return _SignalsHeeded(self.coil, self.guardian, self.events.append)

    def names(self) -> list[str]:
        return [call[0] for call in self.done]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_step_of_the_run_reports_checks_and_watches_in_this_order(bench: Bench) -> None:
    heeded = bench.heeded()
    heeded.stop_if_asked()
    assert bench.names() == ["beat", "refuse_a_gap", "check", "watch"]
    heeded.leave_in_haste()
    heeded.go_on_down()
    assert bench.names()[4:] == ["refuse_a_gap", "beat"]
    assert bench.events == []


def test_the_first_signal_ends_the_run_and_is_reported_once(bench: Bench) -> None:
    heeded = bench.heeded()
    heeded.note(signal.SIGTERM, None)
    assert bench.done == [("count_the_end",)]
    for _ in range(2):
        with pytest.raises(Stopped) as stopped:
            heeded.stop_if_asked()
        assert stopped.value.number == signal.SIGTERM
    assert bench.events == [StopRequested(signal="SIGTERM")]
    assert "watch" not in bench.names()
    heeded.go_on_down()
    heeded.leave_in_haste()
    heeded.switch_off_in_haste()
    assert "switch_off" not in bench.names()


@pytest.mark.skipif(module.SUSPEND is None, reason="has no Ctrl-Z")
def test_a_suspension_is_refused_once_and_ends_nothing(bench: Bench) -> None:
    heeded = bench.heeded()
    heeded.note(int(signal.SIGTSTP), None)
    assert bench.done == []
    for _ in range(2):
        heeded.stop_if_asked()
    assert bench.events == [SuspendRefused()]


def test_a_second_signal_leaves_the_ramp_out_and_interrupts_the_main_thread_only(bench: Bench) -> None:
    heeded = bench.heeded()
    heeded.note(signal.SIGINT, None)
    heeded.note(signal.SIGTERM, None)
    with pytest.raises(_InHaste):
        heeded.go_on_down()
    with pytest.raises(Stopped) as stopped:
        heeded.leave_in_haste()
    assert stopped.value.number == signal.SIGINT
    raised: list[BaseException] = []

    def elsewhere() -> None:
        try:
            heeded.leave_in_haste()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert raised == []


@pytest.mark.parametrize("why", ["second signal", "wrong current"])
def test_the_coil_is_switched_off_once_while_a_state_is_stored(
    bench: Bench, caplog: pytest.LogCaptureFixture, why: str
) -> None:
    heeded = bench.heeded()
    if why == "second signal":
        heeded.note(signal.SIGINT, None)
        heeded.note(signal.SIGINT, None)
    else:
        bench.coil.errors["watch"] = InstrumentError("0.5 A instead of 0.3 A")
    bench.done.clear()
    with caplog.at_level("INFO"):
        heeded.switch_off_in_haste()
    assert [call for call in bench.done if call[0] != "watch"] == [("allow", 30.0), ("switch_off",)]
    assert bench.events == [
        OutputSwitched(on=False),
        OffConfirmed(by="run", determined_by="measured", current_A=0.004, limit_A=0.02),
    ]
    assert "while a state was stored, a second signal to stop came or the current was wrong: the coil is" in caplog.text
    heeded.switch_off_in_haste()
    assert bench.names().count("switch_off") == 1
    bench.guardian.errors["refuse_a_gap"] = StoodStill("the run stood still")
    heeded.leave_in_haste()  # nothing is interrupted any more
    bench.guardian.errors.clear()
    if why == "wrong current":
        with pytest.raises(InstrumentError, match=r"0\.5 A instead of 0\.3 A"):
            heeded.stop_if_asked()


def test_a_failed_switch_off_while_a_state_is_stored_is_tried_again_at_the_end(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    heeded = bench.heeded()
    heeded.note(signal.SIGINT, None)
    heeded.note(signal.SIGINT, None)
    bench.coil.errors["switch_off"] = SwitchOffFailed("no answer")
    with caplog.at_level("INFO"):
        heeded.switch_off_in_haste()
    assert caplog.messages[-1] == "switching off failed: no answer"
    assert bench.events == []


def test_a_guardian_that_is_gone_or_a_gap_ends_the_run(bench: Bench) -> None:
    heeded = bench.heeded()
    bench.guardian.errors["check"] = InstrumentError("the guardian process ended")
    with pytest.raises(InstrumentError, match="the guardian process ended"):
        heeded.stop_if_asked()
    assert bench.done[-2:] == [("silent_s",), ("count_the_end", ("ago_s", 1.7))]
    assert not bench.coil.out_of_control
    bench.guardian.errors["refuse_a_gap"] = StoodStill("the run stood still")
    for method in (heeded.stop_if_asked, heeded.leave_in_haste):
        bench.coil.out_of_control = False
        with pytest.raises(StoodStill):
            method()
        assert bench.coil.out_of_control  # no ramp


def test_a_run_without_a_guardian_heeds_signals_too(bench: Bench) -> None:
    heeded = _SignalsHeeded(bench.coil, None, bench.events.append)
    heeded.stop_if_asked()
    heeded.leave_in_haste()
    assert bench.names() == ["watch"]
    heeded.note(signal.SIGINT, None)
    heeded.note(signal.SIGINT, None)
    heeded.switch_off_in_haste()
    assert bench.names()[-1] == "switch_off"
    ramp_down_and_switch_off(bench.coil)
    assert bench.names()[-2:] == ["ramp_down", "switch_off"]


def test_at_the_end_the_coil_is_ramped_down_and_switched_off_and_the_guardian_is_disarmed(bench: Bench) -> None:
    with switching_off(bench.coil, bench.guardian, on_event=bench.events.append) as stop_if_asked:
        assert bench.done == [("arm",)]
        stop_if_asked()
        bench.done.clear()
    assert bench.done[:4] == [("ramp_down",), ("allow", 30.0), ("switch_off",), ("disarm",)]
    assert bench.names()[4:] == ["beat", "refuse_a_gap", "check", "watch"]
    assert bench.events == [
        OutputSwitched(on=False),
        OffConfirmed(by="run", determined_by="measured", current_A=0.004, limit_A=0.02),
    ]


@pytest.mark.parametrize(
    ("error", "raised", "message"),
    [
        (_InHaste(), None, ""),
        (InstrumentError("deaf"), InstrumentError, "the coil is off, but the ramp of its current to zero failed: deaf"),
        (ValueError("odd"), ValueError, "odd"),
        (KeyboardInterrupt("now"), KeyboardInterrupt, "now"),
    ],
)
def test_after_any_error_of_the_ramp_the_coil_is_switched_off(
    bench: Bench,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    raised: type | None,
    message: str,
) -> None:
    monkeypatch.setattr(module, "DOUBTED_AFTER_S", PATIENCE_S)
    bench.coil.errors["ramp_down"] = error
    with caplog.at_level("INFO"):
        if raised is None:
            ramp_down_and_switch_off(bench.coil, bench.guardian, on_event=bench.events.append)
            assert "a second signal to stop came: the coil is switched off at once" in caplog.text
        else:
            with pytest.raises(raised, match=f"^{message}$"):
                ramp_down_and_switch_off(bench.coil, bench.guardian, on_event=bench.events.append)
    assert bench.names() == ["ramp_down", "allow", "switch_off", "disarm"]
    assert len(bench.events) == 2


@pytest.mark.parametrize("current_A", [0.4, None])
def test_a_coil_that_cannot_be_switched_off_is_left_to_the_guardian(bench: Bench, current_A: float | None) -> None:
    bench.coil.errors["switch_off"] = SwitchOffFailed("0.4 A flows", current_A, 0.02)
    with pytest.raises(SwitchOffFailed, match=r"0\.4 A flows"):
        ramp_down_and_switch_off(bench.coil, bench.guardian, on_event=bench.events.append)
    assert bench.names()[3:] == (["arm", "recognise"] if current_A else ["arm"])
    assert "disarm" not in bench.names()
    assert bench.events == [OffNotConfirmed(by="run", reason="0.4 A flows", current_A=current_A, limit_A=0.02)]
    bench.guardian.errors["arm"] = InstrumentError("the guardian is gone")
    with pytest.raises(SwitchOffFailed, match=r"0\.4 A flows"):
        ramp_down_and_switch_off(bench.coil, bench.guardian, on_event=bench.events.append)


@pytest.mark.parametrize(("unreachable", "ramp"), [("no answer", None), ("", InstrumentError("deaf")), ("", None)])
def test_a_slow_switch_off_is_doubted_only_if_ramp_or_line_failed(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, unreachable: str, ramp: InstrumentError | None
) -> None:
    monkeypatch.setattr(module, "DOUBTED_AFTER_S", 0.01)
    bench.coil.unreachable = unreachable
    doubted = threading.Event()

    def note(event: Event) -> None:
        bench.events.append(event)
        doubted.set()

    bench.coil.during["switch_off"] = lambda: doubted.wait(PATIENCE_S if unreachable or ramp else 0.05)
    if ramp:
        bench.coil.errors["ramp_down"] = ramp
        with pytest.raises(InstrumentError):
            ramp_down_and_switch_off(bench.coil, None, on_event=note)
    else:
        ramp_down_and_switch_off(bench.coil, None, on_event=note)
    doubts = [event for event in bench.events if isinstance(event, OffNotConfirmed)]
    reason = unreachable or ("deaf" if ramp else "")
    assert doubts == ([OffNotConfirmed(by="run", reason=reason, trying_process=os.getpid())] if reason else [])


def test_handlers_are_restored_and_ignored_signals_stay_ignored(bench: Bench) -> None:
    before = {number: signal.getsignal(number) for number in module.SIGNALS}
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with switching_off(bench.coil, bench.guardian, on_event=bench.events.append):
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
            handler: Any = signal.getsignal(signal.SIGINT)
            assert handler.__name__ == "note"
            if module.SUSPEND is not None:
                assert signal.getsignal(module.SUSPEND).__name__ == "note"  # type: ignore[union-attr]
        assert signal.getsignal(signal.SIGINT) is before[signal.SIGINT]
    finally:
        signal.signal(signal.SIGTERM, before[signal.SIGTERM])
    installed: list[Any] = []

    def run() -> None:
        with switching_off(bench.coil):
            installed.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert installed == [before[signal.SIGINT]]


@pytest.mark.parametrize("by_page", [True, False])
def test_a_run_of_the_page_obeys_ctrl_c_although_the_page_ignores_it(
    monkeypatch: pytest.MonkeyPatch, run: Callable[..., tuple[int, str]], tmp_path: Any, by_page: bool
) -> None:
    handlers: list[Any] = []

    def run_protocol(*given: Any, **named: Any) -> None:
        handlers.append(signal.getsignal(signal.SIGINT))
        raise InputError("the test ends the command here")

    monkeypatch.setattr("eimi_lab.face.acquiring.run_protocol", run_protocol)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        watched = ["--watched-by", "3,4,5"] if by_page else []
        run(
            "acquire",
            "dragon_skin_10_quick",
            "--specimen",
            "type1",
            "--rig",
            "virtual",
            "-o",
            tmp_path / "run.h5",
            *watched,
        )
    finally:
        signal.signal(signal.SIGINT, before)
    assert handlers == [signal.default_int_handler if by_page else signal.SIG_IGN]
