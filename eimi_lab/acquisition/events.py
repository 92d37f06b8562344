"""Events of a run: one dataclass for each kind of event, sent by the run and by its guardian to their listeners.

Listeners use the type and the fields of an event, never its words. `event_words` describes an event in English, and
`event_lines` writes and reads it as a line of JSON. Units are in the names of the fields. Times are seconds since
1970-01-01 UTC, from the clock of the computer. Currents are in ampere.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from eimi_drivers.interfaces import Off

Speaker = Literal["run", "guardian"]
Takeover = Literal["run_died", "run_stood_still", "run_could_not_switch_off"]


@dataclass(frozen=True, kw_only=True)
class Event:
    """An event at `time_s`. event: its name in JSON, which never changes."""

    event: ClassVar[str]
    time_s: float = field(default_factory=time.time, compare=False)


FOUND_OFF = "; the output was already off when the connection was opened again"

OnEvent = Callable[[Event], None]
"""Receives every event in the thread of the run. It must return at once, and an error in it ends the run."""


def ignore_event(event: Event) -> None:
    """Do nothing: the listener of a run whose events nobody receives."""


@dataclass(frozen=True, kw_only=True)
class RunBegun(Event):
    """A run begins; the run has not used any instrument yet.

    without_contact: state of the coil after its cable is pulled, in the words of the driver; empty if the coil is
    simulated. hottest_share: largest predicted heat of the coil, as a fraction of the allowed heat; null if the rig
    states no rating. interlocks: the readings with interlocks, which the run checks and its guardian does not.
    """

    event: ClassVar[str] = "run_begun"
    dataset: str
    protocol: str
    specimen: str
    rig: str
    states: int
    currents_A: tuple[float, ...]
    resumes: bool
    guardian: bool
    without_contact: str
    hottest_share: float | None
    interlocks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class OutputSwitched(Event):
    """The output of the supply was switched on or off, and the read-back confirmed it."""

    event: ClassVar[str] = "output_switched"
    on: bool


@dataclass(frozen=True, kw_only=True)
class ShapeChange:
    """Motion of the beam at rest between an earlier conditioning cycle and the last one, at one current.

    since_cycle: the earlier cycle; 0 means before the first cycle. tip_moved_px, tip_moved_mm: motion of the tip; null
    if no tip is visible. difference_ratio: without a tip, the difference of the images divided by the difference due to
    noise; otherwise null.
    """

    current_A: float
    since_cycle: int
    tip_moved_px: float | None = None
    tip_moved_mm: float | None = None
    difference_ratio: float | None = None


@dataclass(frozen=True, kw_only=True)
class ConditioningDone(Event):
    """The conditioning cycles are over. changes: the change of the beam at each current."""

    event: ClassVar[str] = "conditioning_done"
    cycles: int
    changes: tuple[ShapeChange, ...]


@dataclass(frozen=True, kw_only=True)
class Settled(Event):
    """The wait until the beam is at rest is over. at_rest: false if the beam was still moving when it ended."""

    event: ClassVar[str] = "settled"
    state: int
    waited_s: float
    at_rest: bool


@dataclass(frozen=True, kw_only=True)
class StateStored(Event):
    """A state was written to the dataset on the disk. flags: names of the defects of its frames."""

    event: ClassVar[str] = "state_stored"
    state: int
    current_A: float
    waited_s: float
    flags: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class RingDownStored(Event):
    """A ring-down was written to the dataset on the disk.

    ring_down: the number of this ring-down, from 0, out of `ring_downs`. from_A: current before the step to zero.
    frames: number of frames. lost: number of frames that the camera counted but that did not arrive. rate_Hz: frames
    per second. step_uncertainty_s: standard uncertainty of the moment of the step. flags: names of the defects.
    """

    event: ClassVar[str] = "ring_down_stored"
    ring_down: int
    ring_downs: int
    from_A: float
    frames: int
    lost: int
    rate_Hz: float
    step_uncertainty_s: float
    flags: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class StateStoredBefore(Event):
    """The dataset of a resumed run already contains this state; the state is not measured again."""

    event: ClassVar[str] = "state_stored_before"
    state: int
    current_A: float


@dataclass(frozen=True, kw_only=True)
class PauseRequested(Event):
    """A person asked for a pause, which begins once the present state is stored."""

    event: ClassVar[str] = "pause_requested"


@dataclass(frozen=True, kw_only=True)
class Paused(Event):
    """The run waits for a person before `state`, with the coil off.

    swap_leads: whether the person has to swap the leads of the coil before the run continues.
    """

    event: ClassVar[str] = "paused"
    state: int
    states: int
    dataset: str
    swap_leads: bool = False


@dataclass(frozen=True, kw_only=True)
class Resumed(Event):
    """The pause is over; the run returns to `state` through the states before it."""

    event: ClassVar[str] = "resumed"
    state: int


@dataclass(frozen=True, kw_only=True)
class StopRequested(Event):
    """A signal asked the run to stop, and the run stops. signal: the name of the signal, such as SIGINT."""

    event: ClassVar[str] = "stop_requested"
    signal: str


@dataclass(frozen=True, kw_only=True)
class SuspendRefused(Event):
    """Ctrl-Z was refused: a suspended run would leave the coil on."""

    event: ClassVar[str] = "suspend_refused"


@dataclass(frozen=True, kw_only=True)
class PageGone(Event):
    """The page that started the run is gone; the run stops."""

    event: ClassVar[str] = "page_gone"


@dataclass(frozen=True, kw_only=True)
class Warned(Event):
    """A warning, which does not end the run. message: text for a person."""

    event: ClassVar[str] = "warned"
    message: str


@dataclass(frozen=True, kw_only=True)
class FramesLost(Event):
    """Frames did not arrive completely, and none of them is stored. The run continues.

    state: the state during which they were exposed; null before, between and after the states. frames: number of lost
    frames. reasons: number of lost frames for each reason that the camera's driver states.
    """

    event: ClassVar[str] = "frames_lost"
    state: int | None
    frames: int
    reasons: dict[str, int]


@dataclass(frozen=True, kw_only=True)
class InterlockOpened(Event):
    """A reading left the bounds of its interlock, or did not come; the run ends with the coil off.

    reading: the name of the reading in the rig file. value: the value in the unit of the reading; null if there is
    none. minimum, maximum, longest_silence_s: the bounds in the rig file, null where it states none. silent_s: how long
    no reading came; null if one came.
    """

    event: ClassVar[str] = "interlock_opened"
    reading: str
    value: float | None
    minimum: float | None
    maximum: float | None
    silent_s: float | None
    longest_silence_s: float


@dataclass(frozen=True, kw_only=True)
class Fault(Event):
    """An error ends the run. kind: the type of the error. message: text for a person."""

    event: ClassVar[str] = "fault"
    kind: str
    message: str


@dataclass(frozen=True, kw_only=True)
class OffConfirmed(Event):
    """The coil is off.

    by: the process that switched it off. determined_by: "commanded" if the supply reads back zero and off, "measured"
    if in addition a measured current is below the limit. current_A, limit_A: the measured current and the limit; null
    if not measured. takeover: reason why the guardian switched off; null if the run did. run_killed: whether the
    guardian killed the run for this. address: address of the supply; empty if the run switched off. remark: failures
    before the coil was off, in words; usually empty.
    """

    event: ClassVar[str] = "off_confirmed"
    by: Speaker
    determined_by: Literal["measured", "commanded"]
    current_A: float | None = None
    limit_A: float | None = None
    takeover: Takeover | None = None
    run_killed: bool = False
    address: str = ""
    remark: str = ""


def off_confirmed(
    off: Off | None,
    by: Speaker,
    takeover: Takeover | None = None,
    run_killed: bool = False,
    address: str = "",
    remark: str = "",
) -> OffConfirmed:
    """Return the event of a coil that is off. off: the measured current; None if the supply cannot measure."""
    return OffConfirmed(
        by=by,
        determined_by="commanded" if off is None else "measured",
        current_A=None if off is None else off.current_A,
        limit_A=None if off is None else off.limit_A,
        takeover=takeover,
        run_killed=run_killed,
        address=address,
        remark=f"{FOUND_OFF if off and off.found_off else ''}{remark}",
    )


@dataclass(frozen=True, kw_only=True)
class OffNotConfirmed(Event):
    """The coil could not be confirmed off, so that it may still be on.

    reason: text for a person. current_A, limit_A: the measured current and the limit with which it was compared; null
    if not measured. trying_process: number of the process that continues to try; null if there is none. The other
    fields are those of `off_confirmed`.
    """

    event: ClassVar[str] = "off_not_confirmed"
    by: Speaker
    reason: str
    current_A: float | None = None
    limit_A: float | None = None
    takeover: Takeover | None = None
    run_killed: bool = False
    trying_process: int | None = None


@dataclass(frozen=True, kw_only=True)
class GuardianTookOver(Event):
    """The guardian begins to switch the coil off, instead of the run."""

    event: ClassVar[str] = "guardian_took_over"
    takeover: Takeover
    address: str


@dataclass(frozen=True, kw_only=True)
class RunKilled(Event):
    """The guardian kills the run, which stands still and holds the line to the supply. reason: text for a person."""

    event: ClassVar[str] = "run_killed"
    address: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class EmulatedSupplyGone(Event):
    """The emulated supply and its pseudo-terminal do not exist any more: the guardian has nothing to switch off."""

    event: ClassVar[str] = "emulated_supply_gone"
    takeover: Takeover
    address: str


@dataclass(frozen=True, kw_only=True)
class RunEnded(Event):
    """The run is over.

    reason: the name of the signal that stopped it or the type of the error; empty for "completed". stored: number of
    states in the dataset, out of `states`; null if the run failed before its first state could be taken.
    """

    event: ClassVar[str] = "run_ended"
    status: Literal["completed", "stopped", "failed"]
    reason: str
    stored: int | None
    states: int
    dataset: str


EVENTS: dict[str, type[Event]] = {kind.event: kind for kind in Event.__subclasses__()}
"""Every event by its name in JSON."""
