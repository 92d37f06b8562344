"""Describe the events of a run (records of what happened) in English for a person."""

from __future__ import annotations

from collections.abc import Callable
from functools import singledispatch

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
    OnEvent,
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
    Takeover,
    Warned,
)
from eimi_lab.acquisition.guardian import STILL_FOR_S
from eimi_lab.process.errors import tell

VISIBLE_MOTION_PX = 0.2
"""Smallest motion of the tip (px) that is reported. The corners of the tip are located to about a tenth of a pixel."""

_TAKEOVER: dict[Takeover, str] = {
    "run_died": "the run died",
    "run_stood_still": f"the run stood still for more than {STILL_FOR_S:g} s",
    "run_could_not_switch_off": "the run could not switch the coil off",
}

CONTINUE_PAUSED = "Enter continues the run, Ctrl-C ends it"
CONTINUE_ENDED = "the same command with --resume continues the run"
"""What a person at a terminal can do while a run is paused, and after a run that ended before its last state."""

_REMARKS = (ConditioningDone, PauseRequested, Paused, Resumed, SuspendRefused, PageGone, Warned, FramesLost)


def on_terminal(report: Callable[[str], None], remark: Callable[[str], None] = tell) -> OnEvent:
    """Return a function that describes events (records of what happened) in sentences.

    An error that ends the run gives no sentence.

    Parameters
    ----------
    report : callable
        Receives the sentences about stored states (load steps) and ring-downs (recordings of the swinging beam).
    remark : callable
        Receives the sentences about all other events.

    Returns
    -------
    OnEvent
        The function, which receives an event.
    """
    doubted = False

    def listen(event: Event) -> None:
        nonlocal doubted
        if isinstance(event, OffNotConfirmed) and event.trying_process is not None:
            doubted = True
            remark(in_words(event))
        elif isinstance(event, OffConfirmed) and doubted:
            doubted = False
            remark(in_words(event))
        elif isinstance(event, StateStored | StateStoredBefore | RingDownStored):
            report(in_words(event))
        elif isinstance(event, RunBegun) and event.guardian:
            remark(protection_in_words(event.without_contact, event.interlocks))
        elif isinstance(event, _REMARKS) or _left_unfinished(event):
            remark(in_words(event))

    return listen


def protection_in_words(without_contact: str, interlocks: tuple[str, ...] = ()) -> str:
    """Return a sentence about what protects the coil if the run itself fails.

    Parameters
    ----------
    without_contact : str
        What the output does without contact to the computer, in words.
    interlocks : tuple of str
        Names of the readings with bounds outside which the run ends.
    """
    checked = (
        f"only the run checks the interlocks ({', '.join(interlocks)}); if the run stands still for {STILL_FOR_S:g} s "
        "or ends, its guardian switches the coil off; "
    )
    return (
        f"{checked if interlocks else ''}if the cable or the computer fails, or this program and its guardian are "
        f"killed together: {without_contact}; see docs/why/safety.md"
    )


def _left_unfinished(event: Event) -> bool:
    return isinstance(event, RunEnded) and event.status == "failed" and event.stored is not None


@singledispatch
def in_words(event: Event) -> str:
    """Return a sentence, without a full stop, about an event (a record of what happened in a run)."""
    raise TypeError(f"there is no sentence for the event {type(event).__name__}")


@in_words.register
def _(event: RunBegun) -> str:
    how = "continues" if event.resumes else "begins"
    return f"the run {how}: {event.protocol} on {event.specimen} with rig {event.rig}, {event.states} states"


@in_words.register
def _(event: RingDownStored) -> str:
    flags = f", {', '.join(event.flags)}" if event.flags else ""
    lost = "1 frame" if event.lost == 1 else f"{event.lost} frames"
    return (
        f"ring-down {event.ring_down + 1} of {event.ring_downs} from {event.from_A:g} A: {event.frames} frames at "
        f"{event.rate_Hz:.4g} Hz, {lost} lost{flags}"
    )


@in_words.register
def _(event: OutputSwitched) -> str:
    return f"the output of the supply was switched {'on' if event.on else 'off'}"


@in_words.register
def _(event: ConditioningDone) -> str:
    cycles = "1 conditioning cycle" if event.cycles == 1 else f"{event.cycles} conditioning cycles"
    return f"after {cycles}: {'; '.join(map(_change, event.changes))}"


def _change(change: ShapeChange) -> str:
    then = f"in cycle {change.since_cycle}" if change.since_cycle else "before cycle 1"
    if change.tip_moved_px is None:
        shape = (
            f"the tip of the beam is not visible; the image differs from the image {then} by "
            f"{change.difference_ratio:.3g} times the difference due to noise"
        )
    elif change.tip_moved_px < VISIBLE_MOTION_PX:
        shape = f"the tip is within {VISIBLE_MOTION_PX} px of its position {then}"
    else:
        shape = f"the tip is {change.tip_moved_mm:.3g} mm ({change.tip_moved_px:.1f} px) from its position {then}"
    return f"at {change.current_A:g} A {shape}"


@in_words.register
def _(event: Settled) -> str:
    how = "settled after" if event.at_rest else "did not settle within"
    return f"state {event.state}: the beam {how} {event.waited_s:.1f} s"


@in_words.register
def _(event: StateStored) -> str:
    how = "did not settle within" if "NOT_SETTLED" in event.flags else "settled after"
    return ", ".join((f"{event.current_A:g} A", f"{how} {event.waited_s:.1f} s", *event.flags))


@in_words.register
def _(event: StateStoredBefore) -> str:
    return f"{event.current_A:g} A, stored before"


@in_words.register
def _(event: PauseRequested) -> str:
    return "the run will pause after the present state is stored"


@in_words.register
def _(event: Paused) -> str:
    before = f"state {event.state}" if event.state < event.states else "the ring-downs"
    if event.swap_leads:
        return (
            f"the next states reverse the current: the coil is off, swap its two leads at the supply before {before}; "
            f"{CONTINUE_PAUSED}"
        )
    return (
        f"paused before {before}: the coil is off, and {event.state} of {event.states} states are in "
        f"{event.dataset}; {CONTINUE_PAUSED}"
    )


@in_words.register
def _(event: Resumed) -> str:
    return "the run continues; the current first passes through the set-points of the previous states"


@in_words.register
def _(event: StopRequested) -> str:
    return f"the run was asked to stop by {event.signal}"


@in_words.register
def _(event: SuspendRefused) -> str:
    return "Ctrl-Z is refused, because the coil would stay on; Ctrl-C ends the run with the coil off"


@in_words.register
def _(event: PageGone) -> str:
    return "the program of the page that started the run has ended; the run ends with the coil off"


@in_words.register
def _(event: Warned) -> str:
    return f"warning: {event.message}"


@in_words.register
def _(event: FramesLost) -> str:
    reasons = ", ".join(f"{count} with {reason}" for reason, count in event.reasons.items())
    during = "" if event.state is None else f" during state {event.state}"
    frames = "1 frame was lost" if event.frames == 1 else f"{event.frames} frames were lost"
    return f"{frames}{during} ({reasons}); none of them is stored"


@in_words.register
def _(event: InterlockOpened) -> str:
    interlock = f"interlock {event.reading}:"
    if event.silent_s is not None:
        return (
            f"{interlock} no reading for {event.silent_s:.1f} s, longer than longest_silence_s = "
            f"{event.longest_silence_s:g}"
        )
    if event.value is None:
        return f"{interlock} the sensor gives no reading"
    if event.maximum is not None and not event.value <= event.maximum:
        return f"{interlock} {event.value:.4g} measured, above maximum = {event.maximum:g}"
    return f"{interlock} {event.value:.4g} measured, below minimum = {event.minimum:g}"


@in_words.register
def _(event: Fault) -> str:
    return event.message


@in_words.register
def _(event: OffConfirmed) -> str:
    measured = f", {_how_off(event)}"
    if event.takeover is None:
        return f"the coil is off{measured}{event.remark}"
    return (
        f"{_why(event.takeover, event.run_killed)}; {event.address}: the coil was switched off{measured}{event.remark}"
    )


@in_words.register
def _(event: OffNotConfirmed) -> str:
    why = f"{_why(event.takeover, event.run_killed)}; " if event.takeover else ""
    measured = "" if event.current_A is None else f": {event.current_A:.3f} A measured"
    words = f"{why}THE COIL MAY STILL BE ON{measured}, switch it off by hand"
    if event.trying_process is not None:
        words += f"; process {event.trying_process} continues to try to switch the coil off"
    elif event.takeover:
        words += ", and no process tries any more to switch it off"
    return f"{words}: {event.reason}" if event.reason else words


@in_words.register
def _(event: GuardianTookOver) -> str:
    return f"{_why(event.takeover)}; {event.address}: the guardian process switches the coil off"


@in_words.register
def _(event: RunKilled) -> str:
    return f"{_why('run_stood_still')} and occupies the line to {event.address}; the run is killed ({event.reason})"


@in_words.register
def _(event: EmulatedSupplyGone) -> str:
    return f"{_why(event.takeover)}; the emulated supply at {event.address} does not exist any more"


@in_words.register
def _(event: RunEnded) -> str:
    if not event.stored:
        return "no state was stored, so there is no file"
    if event.stored == event.states and event.missing_ring_downs:
        missing = missing_in_words(event.missing_ring_downs)
        return f"all {event.states} states are in {event.dataset}; {missing}; {CONTINUE_ENDED}"
    if event.stored == event.states:
        return f"all {event.states} states are in {event.dataset}"
    return f"{event.stored} of {event.states} states are in {event.dataset}; {CONTINUE_ENDED}"


def missing_in_words(ring_downs: int) -> str:
    """Return a sentence about the number of ring-downs (free vibrations) that a dataset does not contain yet."""
    return "1 ring-down is missing" if ring_downs == 1 else f"{ring_downs} ring-downs are missing"


def left_behind(off: OffConfirmed | None, ended: RunEnded) -> str:
    """Return a sentence about the coil and the dataset after a run that was asked to stop.

    Parameters
    ----------
    off : OffConfirmed or None
        The event that confirmed the coil off, if there was one.
    ended : RunEnded
        The last event of the run.
    """
    return f"{in_words(off)}; {in_words(ended)}" if off else in_words(ended)


def _how_off(event: OffConfirmed) -> str:
    if event.determined_by == "commanded":
        return "as the supply reads back; this supply cannot measure a current"
    if event.limit_A is None:
        return "as measured"
    return f"the measured current is below {event.limit_A:.3g} A"


def off_after(off: OffConfirmed, seconds: float) -> str:
    """Return a sentence for the web page: the coil is off, `seconds` after a person pressed STOP."""
    # The event says how this was found out.
    return f"the coil is off, confirmed after {seconds:.2f} s, {_how_off(off)}"


def _why(takeover: Takeover, run_killed: bool = False) -> str:
    return _TAKEOVER[takeover] + (" and was ended" if run_killed else "")
