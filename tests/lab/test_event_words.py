"""Each event of a run is described by the right sentence, which is passed to the right function."""

from __future__ import annotations

from dataclasses import replace

import pytest

from eimi_lab.acquisition.event_words import in_words, left_behind, off_after, on_terminal, protection_in_words
from eimi_lab.acquisition.events import (
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
)

BEGUN = RunBegun(
    dataset="run.h5",
    protocol="p",
    specimen="s",
    rig="r",
    states=2,
    currents_A=(0.0, 0.1),
    resumes=False,
    guardian=True,
    without_contact="it stays on",
    hottest_share=None,
)
RING_DOWN = RingDownStored(
    ring_down=0, ring_downs=2, from_A=0.9, frames=1200, lost=1, rate_Hz=120.0, step_uncertainty_s=0.02, flags=("LATE",)
)
VOLTAGE = InterlockOpened(
    reading="coil_voltage_V", value=12.5, minimum=None, maximum=12.0, silent_s=None, longest_silence_s=5.0
)
OFF = OffConfirmed(by="run", determined_by="measured", current_A=0.001, limit_A=0.01)
ENDED = RunEnded(status="stopped", reason="SIGINT", stored=1, states=2, dataset="run.h5")
SWAP = "swap its two leads at the supply before state 1; Enter continues the run, Ctrl-C ends it"


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (BEGUN, "the run begins: p on s with rig r, 2 states"),
        (replace(BEGUN, resumes=True), "the run continues: p on s with rig r, 2 states"),
        (RING_DOWN, "ring-down 1 of 2 from 0.9 A: 1200 frames at 120 Hz, 1 frame lost, LATE"),
        (replace(RING_DOWN, flags=()), "ring-down 1 of 2 from 0.9 A: 1200 frames at 120 Hz, 1 frame lost"),
        (OutputSwitched(on=True), "the output of the supply was switched on"),
        (OutputSwitched(on=False), "the output of the supply was switched off"),
        (Settled(state=1, waited_s=2.5, at_rest=True), "state 1: the beam settled after 2.5 s"),
        (Settled(state=1, waited_s=2.5, at_rest=False), "state 1: the beam did not settle within 2.5 s"),
        (StateStored(state=1, current_A=0.1, waited_s=2.5, flags=()), "0.1 A, settled after 2.5 s"),
        (
            StateStored(state=1, current_A=0.1, waited_s=2.5, flags=("NOT_SETTLED", "DROPPED")),
            "0.1 A, did not settle within 2.5 s, NOT_SETTLED, DROPPED",
        ),
        (StateStoredBefore(state=0, current_A=0.25), "0.25 A, stored before"),
        (PauseRequested(), "the run will pause after the present state is stored"),
        (
            Paused(state=1, states=2, dataset="run.h5"),
            "paused before state 1: the coil is off, and 1 of 2 states are in run.h5; Enter continues the run, "
            "Ctrl-C ends it",
        ),
        (
            Paused(state=1, states=2, dataset="run.h5", swap_leads=True),
            f"the next states reverse the current: the coil is off, {SWAP}",
        ),
        (
            Paused(state=2, states=2, dataset="run.h5"),
            "paused before the ring-downs: the coil is off, and 2 of 2 states are in run.h5; Enter continues the run, "
            "Ctrl-C ends it",
        ),
        (Resumed(state=1), "the run continues; the current first passes through the set-points of the previous states"),
        (StopRequested(signal="SIGINT"), "the run was asked to stop by SIGINT"),
        (SuspendRefused(), "Ctrl-Z is refused, because the coil would stay on; Ctrl-C ends the run with the coil off"),
        (PageGone(), "the program of the page that started the run has ended; the run ends with the coil off"),
        (Warned(message="µ"), "warning: µ"),
        (
            FramesLost(state=2, frames=3, reasons={"missing packets": 2, "no packet": 1}),
            "3 frames were lost during state 2 (2 with missing packets, 1 with no packet); none of them is stored",
        ),
        (
            FramesLost(state=None, frames=1, reasons={"no packet": 1}),
            "1 frame was lost (1 with no packet); none of them is stored",
        ),
        (
            FramesLost(state=0, frames=2, reasons={"x": 2}),
            "2 frames were lost during state 0 (2 with x); none of them is stored",
        ),
        (VOLTAGE, "interlock coil_voltage_V: 12.5 measured, above maximum = 12"),
        (replace(VOLTAGE, value=None), "interlock coil_voltage_V: the sensor gives no reading"),
        (replace(VOLTAGE, value=float("nan")), "interlock coil_voltage_V: nan measured, above maximum = 12"),
        (
            replace(VOLTAGE, value=0.5, minimum=1.0),
            "interlock coil_voltage_V: 0.5 measured, below minimum = 1",
        ),
        (
            replace(VOLTAGE, value=0.5, minimum=1.0, maximum=None),
            "interlock coil_voltage_V: 0.5 measured, below minimum = 1",
        ),
        (
            replace(VOLTAGE, value=None, silent_s=7.25),
            "interlock coil_voltage_V: no reading for 7.2 s, longer than longest_silence_s = 5",
        ),
        (Fault(kind="InstrumentTimeout", message="no answer"), "no answer"),
        (OFF, "the coil is off, the measured current is below 0.01 A"),
        (replace(OFF, limit_A=None), "the coil is off, as measured"),
        (replace(OFF, remark=", it was off"), "the coil is off, the measured current is below 0.01 A, it was off"),
        (
            replace(OFF, takeover="run_died", address="COM3"),
            "the run died; COM3: the coil was switched off, the measured current is below 0.01 A",
        ),
        (
            replace(OFF, takeover="run_could_not_switch_off", address="COM3", run_killed=True),
            "the run could not switch the coil off and was ended; COM3: the coil was switched off, the measured "
            "current is below 0.01 A",
        ),
        (
            OffNotConfirmed(by="run", reason="silent"),
            "THE COIL MAY STILL BE ON, switch it off by hand: silent",
        ),
        (
            OffNotConfirmed(by="run", reason="", current_A=0.4567, limit_A=0.01),
            "THE COIL MAY STILL BE ON: 0.457 A measured, switch it off by hand",
        ),
        (
            OffNotConfirmed(by="run", reason="silent", trying_process=7),
            (
                "THE COIL MAY STILL BE ON, switch it off by hand; process 7 continues to try to switch the coil off: "
                "silent"
            ),
        ),
        (
            OffNotConfirmed(by="guardian", reason="silent", takeover="run_died", trying_process=7),
            (
                "the run died; THE COIL MAY STILL BE ON, switch it off by hand; process 7 continues to try to switch "
                "the coil off: silent"
            ),
        ),
        (
            OffNotConfirmed(by="guardian", reason="silent", takeover="run_died", run_killed=True),
            "the run died and was ended; THE COIL MAY STILL BE ON, switch it off by hand, and no process tries any "
            "more to switch it off: silent",
        ),
        (
            GuardianTookOver(takeover="run_could_not_switch_off", address="COM3"),
            "the run could not switch the coil off; COM3: the guardian process switches the coil off",
        ),
        (
            EmulatedSupplyGone(takeover="run_died", address="COM3"),
            "the run died; the emulated supply at COM3 does not exist any more",
        ),
        (ENDED, "1 of 2 states are in run.h5; the same command with --resume continues the run"),
        (replace(ENDED, stored=2), "all 2 states are in run.h5"),
        (
            replace(ENDED, stored=2, missing_ring_downs=2),
            "all 2 states are in run.h5; 2 ring-downs are missing; the same command with --resume continues the run",
        ),
        (replace(ENDED, stored=0), "no state was stored, so there is no file"),
        (replace(ENDED, stored=None), "no state was stored, so there is no file"),
    ],
)
def test_an_event_has_these_words(event: Event, words: str) -> None:
    assert in_words(event) == words


def test_a_run_that_stands_still_is_described_with_the_time_that_counts() -> None:
    killed = RunKilled(address="COM3", reason="busy")
    still = "the run stood still for more than 5 s"
    assert in_words(killed) == f"{still} and occupies the line to COM3; the run is killed (busy)"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ShapeChange(current_A=0.3, since_cycle=1, tip_moved_px=2.0, tip_moved_mm=0.25),
            "at 0.3 A the tip is 0.25 mm (2.0 px) from its position in cycle 1",
        ),
        (
            ShapeChange(current_A=0.0, since_cycle=0, tip_moved_px=0.2, tip_moved_mm=0.025),
            "at 0 A the tip is 0.025 mm (0.2 px) from its position before cycle 1",
        ),
        (
            ShapeChange(current_A=0.0, since_cycle=0, tip_moved_px=0.19, tip_moved_mm=0.024),
            "at 0 A the tip is within 0.2 px of its position before cycle 1",
        ),
        (
            ShapeChange(current_A=0.3, since_cycle=1, difference_ratio=1.234),
            "at 0.3 A the tip of the beam is not visible; the image differs from the image in cycle 1 by 1.23 times "
            "the difference due to noise",
        ),
    ],
)
def test_a_change_of_shape_has_these_words(change: ShapeChange, words: str) -> None:
    assert in_words(ConditioningDone(cycles=3, changes=(change,))) == f"after 3 conditioning cycles: {words}"
    assert in_words(ConditioningDone(cycles=1, changes=(change,))) == f"after 1 conditioning cycle: {words}"


def test_the_protection_of_a_coil_is_described_with_its_interlocks() -> None:
    tail = (
        "if the cable or the computer fails, or this program and its guardian are killed together: it stays on; see "
        "docs/why/safety.md"
    )
    assert protection_in_words("it stays on") == tail
    assert protection_in_words("it stays on", ("a", "b")) == (
        "only the run checks the interlocks (a, b); if the run stands still for 5 s or ends, its guardian switches "
        f"the coil off; {tail}"
    )


def test_the_last_words_of_a_run_and_of_a_stop() -> None:
    off = "the measured current is below 0.01 A"
    ended = in_words(ENDED)
    assert left_behind(OFF, ENDED) == f"the coil is off, {off}; {ended}"
    assert left_behind(None, ENDED) == ended
    assert off_after(OFF, 0.126) == f"the coil is off, confirmed after 0.13 s, {off}"
    with pytest.raises(TypeError, match="no sentence for the event Event"):
        in_words(Event())


def test_states_are_reported_and_the_rest_that_a_person_needs_is_remarked() -> None:
    reports: list[str] = []
    remarks: list[str] = []
    listen = on_terminal(reports.append, remarks.append)
    stored = [
        StateStored(state=1, current_A=0.1, waited_s=2.5, flags=()),
        StateStoredBefore(state=0, current_A=0.0),
        RING_DOWN,
    ]
    told = [
        ConditioningDone(cycles=2, changes=()),
        PauseRequested(),
        Paused(state=1, states=2, dataset="run.h5"),
        Resumed(state=1),
        SuspendRefused(),
        PageGone(),
        Warned(message="m"),
        FramesLost(state=2, frames=3, reasons={"x": 3}),
        replace(ENDED, status="failed"),
    ]
    silent = [
        replace(BEGUN, guardian=False),
        OutputSwitched(on=True),
        Settled(state=1, waited_s=2.5, at_rest=True),
        StopRequested(signal="SIGINT"),
        VOLTAGE,
        Fault(kind="InstrumentTimeout", message="no answer"),
        OFF,
        OffNotConfirmed(by="run", reason="silent"),
        ENDED,
        replace(ENDED, status="completed"),
        replace(ENDED, status="failed", stored=None),
    ]
    for event in (*stored, *silent, *told):
        listen(event)
    assert reports == [in_words(event) for event in stored]
    assert remarks == [in_words(event) for event in told]
    listen(BEGUN)
    assert remarks[-1] == protection_in_words("it stays on")


def test_the_end_of_a_doubt_is_remarked_once() -> None:
    remarks: list[str] = []
    listen = on_terminal(lambda words: None, remarks.append)
    doubt = OffNotConfirmed(by="run", reason="silent", trying_process=7)
    for event in (OFF, doubt, doubt, OFF, OFF):
        listen(event)
    assert remarks == [in_words(event) for event in (doubt, doubt, OFF)]
