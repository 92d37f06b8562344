"""What happens in a run: one dataclass for each thing, sent by the run and its guardian to whoever listens.

Listeners decide by the type of an event and by its fields, never by words. `event_words` says an event in English;
`event_lines` writes it as a line of JSON and reads it back. Units are in the names of the fields. Times are seconds
since 1970-01-01 UTC by the clock of the computer. Currents are in ampere.
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
    """Something that happened at `time_s`. event: its name in JSON, which never changes."""

    event: ClassVar[str]
    time_s: float = field(default_factory=time.time, compare=False)


FOUND_OFF = "; the output was found off when the line was opened anew"

OnEvent = Callable[[Event], None]
"""Is given every event, in the thread of the run: it has to return at once, and an error in it ends the run."""


def unheard(event: Event) -> None:
    """Listen to nothing."""


@dataclass(frozen=True, kw_only=True)
class RunBegun(Event):
    """A run begins; no instrument was asked yet.

    without_contact: what becomes of the coil when the cable is pulled, in the driver's words; empty where the coil is
    simulated. hottest_share: the most heat that the coil will hold, as a share of what it bears; null if not rated.
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


@dataclass(frozen=True, kw_only=True)
class OutputSwitched(Event):
    """The output of the supply was switched on or off, and the supply read it back."""

    event: ClassVar[str] = "output_switched"
    on: bool


@dataclass(frozen=True, kw_only=True)
class ShapeChange:
    """How far a beam at rest moved from one conditioning cycle to the last, at one current.

    since_cycle: the cycle compared with; 0 is before the first. tip_moved_px, tip_moved_mm: null where no tip is found;
    then difference_ratio is the difference of the images over what noise alone would make.
    """

    current_A: float
    since_cycle: int
    tip_moved_px: float | None = None
    tip_moved_mm: float | None = None
    difference_ratio: float | None = None


@dataclass(frozen=True, kw_only=True)
class ConditioningDone(Event):
    """The conditioning cycles are over; how far they changed the beam at each current."""

    event: ClassVar[str] = "conditioning_done"
    cycles: int
    changes: tuple[ShapeChange, ...]


@dataclass(frozen=True, kw_only=True)
class Settled(Event):
    """The wait for the beam of a state is over: it is at rest, or the time allowed was used up."""

    event: ClassVar[str] = "settled"
    state: int
    waited_s: float
    at_rest: bool


@dataclass(frozen=True, kw_only=True)
class StateStored(Event):
    """A state is in the dataset, on the disk. flags: the names of what is wrong with its frames."""

    event: ClassVar[str] = "state_stored"
    state: int
    current_A: float
    waited_s: float
    flags: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class StateStoredBefore(Event):
    """A resumed run found this state in the dataset and does not take it again."""

    event: ClassVar[str] = "state_stored_before"
    state: int
    current_A: float


@dataclass(frozen=True, kw_only=True)
class PauseRequested(Event):
    """A person asked for a pause; it begins once the state under way is stored."""

    event: ClassVar[str] = "pause_requested"


@dataclass(frozen=True, kw_only=True)
class Paused(Event):
    """The run waits for a person before `state`, with the coil off."""

    event: ClassVar[str] = "paused"
    state: int
    states: int
    dataset: str


@dataclass(frozen=True, kw_only=True)
class Resumed(Event):
    """The pause is over; the run comes back to `state` through those before it."""

    event: ClassVar[str] = "resumed"
    state: int


@dataclass(frozen=True, kw_only=True)
class StopRequested(Event):
    """A signal asked the run to stop, and the run heeds it. signal: its name, such as SIGINT."""

    event: ClassVar[str] = "stop_requested"
    signal: str


@dataclass(frozen=True, kw_only=True)
class SuspendRefused(Event):
    """Ctrl-Z was refused: a suspended run would leave the coil on."""

    event: ClassVar[str] = "suspend_refused"


@dataclass(frozen=True, kw_only=True)
class PageGone(Event):
    """The page that began the run is gone; the run stops."""

    event: ClassVar[str] = "page_gone"


@dataclass(frozen=True, kw_only=True)
class Warned(Event):
    """Something that a person should know and that does not end the run. message: in words, for a person alone."""

    event: ClassVar[str] = "warned"
    message: str


@dataclass(frozen=True, kw_only=True)
class Fault(Event):
    """An error ends the run. kind: the type of the error. message: in words, for a person alone."""

    event: ClassVar[str] = "fault"
    kind: str
    message: str


@dataclass(frozen=True, kw_only=True)
class OffConfirmed(Event):
    """The coil is off.

    by: who switched it off. determined_by: "commanded" where the supply reads back zero and off, "measured" where a
    measured current is below the limit as well. current_A, limit_A: that current and that limit; null if not measured.
    takeover: why the guardian did it; null where the run did. run_killed: whether the guardian ended the run for that.
    address: of the supply; empty where the run did it. remark: what did not go well on the way, in words; mostly empty.
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
    """Return the event of a coil that is off. off: what was measured; None if the supply cannot measure."""
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
    """Nobody knows that the coil is off: it may still be on.

    reason: in words, for a person alone. current_A, limit_A: the current measured and the limit it was compared with;
    null if not measured. trying_process: the process that goes on trying; null where nobody does. The other fields are
    those of `off_confirmed`.
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
    """The guardian begins to switch the coil off in place of the run."""

    event: ClassVar[str] = "guardian_took_over"
    takeover: Takeover
    address: str


@dataclass(frozen=True, kw_only=True)
class RunKilled(Event):
    """The guardian ends the run, which stands still and holds the line to the supply. reason: in words."""

    event: ClassVar[str] = "run_killed"
    address: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class EmulatedSupplyGone(Event):
    """The guardian found the emulated supply gone with its pseudo-terminal: there is nothing to switch off."""

    event: ClassVar[str] = "emulated_supply_gone"
    takeover: Takeover
    address: str


@dataclass(frozen=True, kw_only=True)
class RunEnded(Event):
    """The run is over.

    reason: the name of the signal that stopped it or the type of the error; empty for "completed". stored: the states
    in the dataset, of `states`; null where the run failed before its first state could be taken.
    """

    event: ClassVar[str] = "run_ended"
    status: Literal["completed", "stopped", "failed"]
    reason: str
    stored: int | None
    states: int
    dataset: str


EVENTS: dict[str, type[Event]] = {kind.event: kind for kind in Event.__subclasses__()}
"""Every event by its name in JSON."""
