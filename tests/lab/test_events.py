"""A run and its guardian (the process that switches the coil off) send their events in order, as lines of JSON."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.faults import Fault as LineFault
from eimi_drivers.emulators.serve import emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentDisconnected, Off, SwitchOffFailed
from eimi_lab.acquisition.event_lines import EventLines, from_line, to_line
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import (
    EVENTS,
    FOUND_OFF,
    ConditioningDone,
    EmulatedSupplyGone,
    Event,
    Fault,
    FramesLost,
    GuardianTookOver,
    InterlockOpened,
    OffConfirmed,
    OffNotConfirmed,
    OutputSwitched,
    PageGone,
    Paused,
    PauseRequested,
    Resumed,
    RingDownStored,
    RunBegun,
    RunEnded,
    RunKilled,
    Settled,
    ShapeChange,
    StateStored,
    StateStoredBefore,
    StopRequested,
    SuspendRefused,
    Warned,
    off_confirmed,
)
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.process.stopping import Stopped
from tests.lab.conftest import give_many_states
from tests.patience import PATIENCE_S

ONE_OF_EACH = (
    RunBegun(
        dataset="run.h5",
        protocol="p",
        specimen="s",
        rig="r",
        states=2,
        currents_A=(0.0, 0.1),
        resumes=False,
        guardian=True,
        without_contact="stays on",
        hottest_share=None,
    ),
    OutputSwitched(on=True),
    ConditioningDone(
        cycles=3,
        changes=(
            ShapeChange(current_A=0.3, since_cycle=1, tip_moved_px=2.0, tip_moved_mm=0.25),
            ShapeChange(current_A=0.0, since_cycle=0, difference_ratio=1.2),
        ),
    ),
    Settled(state=1, waited_s=2.5, at_rest=True),
    StateStored(state=1, current_A=0.1, waited_s=2.5, flags=("NOT_SETTLED", "DROPPED")),
    RingDownStored(
        ring_down=0,
        ring_downs=2,
        from_A=0.9,
        frames=1200,
        lost=1,
        rate_Hz=120.0,
        step_uncertainty_s=0.02,
        flags=("RING_DOWN_LOST",),
    ),
    StateStoredBefore(state=0, current_A=0.0),
    PauseRequested(),
    Paused(state=1, states=2, dataset="run.h5"),
    Resumed(state=1),
    StopRequested(signal="SIGINT"),
    SuspendRefused(),
    PageGone(),
    Warned(message="µ"),
    FramesLost(state=2, frames=3, reasons={"missing packets": 2, "no packet": 1}),
    InterlockOpened(
        reading="coil_voltage_V", value=12.5, minimum=None, maximum=12.0, silent_s=None, longest_silence_s=5.0
    ),
    Fault(kind="InstrumentTimeout", message="no answer"),
    OffConfirmed(by="run", determined_by="measured", current_A=0.001, limit_A=0.01),
    OffNotConfirmed(by="guardian", reason="silent", takeover="run_died", trying_process=7),
    GuardianTookOver(takeover="run_stood_still", address="COM3"),
    RunKilled(address="COM3", reason="busy"),
    EmulatedSupplyGone(takeover="run_could_not_switch_off", address="/dev/pts/9"),
    RunEnded(status="stopped", reason="SIGINT", stored=1, states=2, dataset="run.h5"),
)


def test_the_table_of_events_has_one_row_for_every_event() -> None:
    assert [type(event) for event in ONE_OF_EACH] == list(EVENTS.values())


@pytest.mark.parametrize("event", ONE_OF_EACH, ids=lambda event: event.event)
def test_an_event_is_read_back_from_its_line(event: Event) -> None:
    line = to_line(event)
    assert "\n" not in line
    written = json.loads(line)
    assert written.pop("event") == event.event
    assert set(written) == {field.name for field in dataclasses.fields(event)}
    again = from_line(line)
    assert again == event
    assert again is not None
    assert again.time_s == event.time_s


@pytest.mark.parametrize("event", ONE_OF_EACH, ids=lambda event: event.event)
def test_the_text_of_an_event_is_one_line(event: Event) -> None:
    words = in_words(event)
    assert words
    assert "\n" not in words
    assert not words.endswith(".")


def test_the_text_about_a_coil_that_is_off_says_how_this_was_determined() -> None:
    off = OffConfirmed(by="run", determined_by="measured", current_A=0.001, limit_A=0.01)
    assert in_words(off) == "the coil is off, the measured current is below 0.01 A"
    off = OffConfirmed(by="run", determined_by="commanded")
    assert in_words(off) == "the coil is off, as the supply reads back; this supply cannot measure a current"


def test_an_event_or_a_key_of_a_later_release_is_tolerated() -> None:
    assert from_line('{"event": "field_reversed", "time_s": 1.0}') is None
    later = json.loads(to_line(Resumed(state=3))) | {"why": "new"}
    assert from_line(json.dumps(later)) == Resumed(state=3)


@pytest.mark.parametrize("line", ["", "acquire 1/4: 0 A", "[]", "{}", '{"event": "resumed"}', '{"event": "resum'])
def test_a_line_that_is_no_event_is_refused(line: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011  of the JSON reader or of the fields
        from_line(line)


def test_a_number_that_is_not_finite_is_written_as_null() -> None:
    line = to_line(OffConfirmed(by="run", determined_by="measured", current_A=math.nan, limit_A=math.inf))
    assert (json.loads(line)["current_A"], json.loads(line)["limit_A"]) == (None, None)


def names(events: list[Event]) -> list[str]:
    return [event.event for event in events]


def test_a_run_sends_its_events_in_order(setup: Any) -> None:
    setup.protocol = parse(Protocol, f"conditioning = {{ cycles = 2, current_A = 0.3 }}\n{setup.protocol.text}", "p")
    events: list[Event] = []
    setup.run(remark=lambda words: None, on_event=events.append)
    states = ["settled", "state_stored"] * 4
    assert names(events) == [
        "run_begun",
        "output_switched",
        "conditioning_done",
        *states,
        "output_switched",
        "off_confirmed",
        "run_ended",
    ]
    begun, ended = events[0], events[-1]
    assert isinstance(begun, RunBegun)
    assert begun.currents_A == tuple(setup.protocol.currents_A)
    stored = [event for event in events if isinstance(event, StateStored)]
    assert [(event.state, event.current_A) for event in stored] == list(enumerate(setup.stored()))
    assert ended == RunEnded(status="completed", reason="", stored=4, states=4, dataset=str(setup.path))
    off = events[-2]
    assert isinstance(off, OffConfirmed)
    assert (off.by, off.determined_by, off.limit_A) == ("run", "measured", 0.02)
    assert off.current_A is not None
    assert abs(off.current_A) <= 0.02


def test_a_fault_and_a_stop_give_different_events_and_both_end_with_the_coil_off(setup: Any) -> None:
    events: list[Event] = []

    def fail(number: int) -> None:
        if setup.coil.state.set_current_A == 0.2:
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = fail
    with pytest.raises(InstrumentDisconnected):
        setup.run(remark=lambda words: None, on_event=events.append)
    assert names(events)[-4:] == ["output_switched", "off_confirmed", "fault", "run_ended"]
    assert events[-2] == Fault(kind="InstrumentDisconnected", message="memory: unplugged")
    path = str(setup.path)
    assert events[-1] == RunEnded(status="failed", reason="InstrumentDisconnected", stored=2, states=4, dataset=path)

    setup.camera.event = lambda number: signal.raise_signal(signal.SIGTERM) if setup.coil.state.output else None
    events.clear()
    with pytest.raises(Stopped):
        setup.run(resume=True, on_event=events.append)
    assert names(events) == [
        "run_begun",
        "state_stored_before",
        "state_stored_before",
        "output_switched",
        "stop_requested",
        "output_switched",
        "off_confirmed",
        "run_ended",
    ]
    assert events[-1] == RunEnded(status="stopped", reason="SIGTERM", stored=2, states=4, dataset=path)


def test_a_coil_that_could_not_be_switched_off_is_reported_as_not_confirmed(setup: Any) -> None:
    events: list[Event] = []

    def deaf(at: int) -> None:
        if setup.coil.state.set_current_A == 0.2:
            setup.line.inject(LineFault.SILENCE)
            raise InstrumentDisconnected("memory: unplugged")

    setup.camera.event = deaf
    with pytest.raises(SwitchOffFailed):
        setup.run(remark=lambda words: None, on_event=events.append)
    assert "off_confirmed" not in names(events)
    assert isinstance(events[-3], OffNotConfirmed)
    assert in_words(events[-3]).startswith("THE COIL MAY STILL BE ON, switch it off by hand: ")
    assert names(events)[-2:] == ["fault", "run_ended"]


def test_a_listener_that_fails_ends_the_run_with_the_coil_off(setup: Any) -> None:
    def fail(event: Event) -> None:
        if isinstance(event, StateStored) and event.state == 1:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        setup.run(remark=lambda words: None, on_event=fail)
    assert setup.is_off()
    assert setup.stored() == [0.0, 0.1]


@contextmanager
def emulated(bench: Path, driver: str = "scpi") -> Iterator[CoilSupply]:
    # Serve an emulated supply, and write rig.toml with its address; yield the supply with its coil.
    coil = CoilSupply(WallClock())
    serving = serve_pty if driver == "korad" else serve_tcp
    with serving(emulate(driver, coil)) as address:
        (bench / "rig.toml").write_text(f"""
name = "emulated"
calibration = "calibration.toml"
supply = {{ driver = "{driver}", address = "{address}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
camera = {{ driver = "opencv", source = "{bench / "recording"}" }}
""")
        yield coil


def command(rig: str, *more: str) -> list[str]:
    given = ["acquire", "protocol.toml", "--specimen", "specimen.toml", "--rig", rig, "-o", "run.h5", "--events", *more]
    return [sys.executable, "-m", "eimi_lab", *given]


def read(lines: list[str]) -> list[Event]:
    events = [from_line(line) for line in lines]
    assert None not in events
    return [event for event in events if event is not None]


def assert_whole(events: list[Event]) -> None:
    assert names(events)[:2] == ["run_begun", "output_switched"]
    assert names(events)[2:-3] == ["settled", "state_stored"] * 4
    assert names(events)[-3:] == ["output_switched", "off_confirmed", "run_ended"]
    assert isinstance(events[-1], RunEnded)
    assert events[-1].status == "completed"


def test_events_of_an_emulated_supply_are_lines_of_json(bench: Path) -> None:
    with emulated(bench) as coil:
        done = subprocess.run(
            command("rig.toml"), cwd=bench, capture_output=True, text=True, timeout=PATIENCE_S, check=True
        )
        assert not coil.state.output
    assert_whole(read(done.stdout.splitlines()))
    assert done.stderr.count("acquire ") == 4  # a person at the terminal reads the usual messages


@pytest.mark.parametrize("quiet", [False, True])
def test_events_of_a_virtual_run_are_lines_of_json_and_the_result_comes_after_them(files: Path, quiet: bool) -> None:
    protocol = files / "protocol.toml"
    protocol.write_text(protocol.read_text().replace("drift_window_s = 0.02", "drift_window_s = 0.2"))
    (files / "specimen.toml").write_text(Path("protocols/specimens/type1.toml").read_text())
    for path in Path("protocols/rigs").glob("virtual*.toml"):
        (files / path.name).write_text(path.read_text().replace("mesh = [26, 3, 1]", "mesh = [10, 1, 1]"))
    more = ["--json", "--quiet"] if quiet else ["--json"]
    done = subprocess.run(
        command("virtual.toml", *more), cwd=files, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    last = next(index for index, line in enumerate(lines) if '"run_ended"' in line)
    assert_whole(read(lines[: last + 1]))
    assert json.loads("\n".join(lines[last + 1 :])) == {"dataset": "run.h5", "states": 4}


@pytest.mark.parametrize("reader", ["gone", "full"])
def test_a_reader_that_has_ended_or_does_not_read_never_delays_the_run(bench: Path, reader: str) -> None:
    reads, writes = os.pipe()
    if reader == "full":
        os.set_blocking(writes, False)
        with suppress(BlockingIOError):
            while True:
                os.write(writes, b"\n" * 512)
        os.set_blocking(writes, True)
    else:
        os.close(reads)
    with emulated(bench) as coil:
        done = subprocess.run(
            command("rig.toml"),
            cwd=bench,
            stdout=writes,
            stderr=subprocess.PIPE,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert (done.returncode, done.stderr.count("acquire ")) == (0, 4), done.stderr
        assert not coil.state.output
    os.close(writes)
    if reader == "full":
        os.close(reads)


def test_the_guardian_of_a_killed_run_continues_the_events(bench: Path) -> None:
    give_many_states(bench)
    with emulated(bench) as coil:
        events = []
        with subprocess.Popen(
            command("rig.toml"), cwd=bench, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            for line in process.stdout:
                events += read([line])
                if isinstance(events[-1], StateStored) and events[-1].state == 1:
                    process.kill()
            messages = process.stderr.read()
        assert process.returncode == -signal.SIGKILL
        assert not coil.state.output
    assert isinstance(events[-2], GuardianTookOver)
    off = events[-1]
    assert isinstance(off, OffConfirmed)
    assert (off.by, off.takeover) == ("guardian", "run_died")
    assert f"eimi guardian: {in_words(off)}" in messages


def test_a_supply_that_cannot_measure_is_off_as_commanded() -> None:
    assert off_confirmed(None, "guardian", "run_died", True, "COM3", "; late") == OffConfirmed(
        **{"by": "guardian", "determined_by": "commanded", "takeover": "run_died", "run_killed": True},
        **{"address": "COM3", "remark": "; late"},
    )
    measured = off_confirmed(Off(0.01, 0.02, found_off=True), "run")
    assert (measured.determined_by, measured.current_A, measured.limit_A) == ("measured", 0.01, 0.02)
    assert measured.remark == FOUND_OFF


@pytest.mark.parametrize("kind", EVENTS)
def test_a_field_of_an_event_that_is_left_out_says_nothing(kind: str) -> None:
    stated = [field for field in dataclasses.fields(EVENTS[kind]) if field.default is not dataclasses.MISSING]
    assert all(not field.default for field in stated)


def test_lines_for_a_reader_that_has_ended_are_dropped_with_one_line_in_the_log(
    caplog: pytest.LogCaptureFixture,
) -> None:
    reads, writes = os.pipe()
    os.close(reads)
    with caplog.at_level("INFO"):
        lines = EventLines(writes)
        for _ in range(1000):
            lines(PauseRequested())
        lines.finish()
    (message,) = caplog.messages
    assert message.startswith("the program that read the events has closed its pipe: [Errno 32]")


def test_a_file_name_that_is_no_utf8_is_written_and_read_again() -> None:
    reads, writes = os.pipe()
    name = os.fsdecode(b"caf\xe9.h5")
    ended = RunEnded(status="completed", reason="", stored=4, states=4, dataset=name)
    lines = EventLines(writes)
    for event in (ended, OutputSwitched(on=False)):
        lines(event)
    lines.finish()
    with os.fdopen(reads, "rb") as stored:
        assert [from_line(line) for line in stored] == [ended, OutputSwitched(on=False)]


def test_the_log_contains_messages_to_the_supply_the_guardian_and_events(bench: Path) -> None:
    with emulated(bench):
        logged = subprocess.run(
            command("rig.toml"),
            cwd=bench,
            env=os.environ | {"EIMI_LOG": "debug"},
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=True,
        )
    assert_whole(read(logged.stdout.splitlines()))
    assert re.search(r"eimi_drivers\.supplies\.logged: .* > b'.*CURR", logged.stderr)
    assert re.search(r"\d+ messages, \d+ answers, the slowest answer after \d+\.\d+ s; 0 faults", logged.stderr)
    assert re.search(r"guardian.*: armed", logged.stderr)
    assert re.search(r"eimi_lab\.acquisition\.run: StateStored\(", logged.stderr)


def test_an_unknown_log_level_is_refused_in_one_line(run: Callable[..., tuple[int, str]]) -> None:
    status, message = run("--log", "loud", "instruments")
    assert (status, message) == (2, "eimi: --log loud (or EIMI_LOG): should be one of info, debug\n")
