"""Define one dataclass for each kind of event (record of what happened) in a run.

Units are in the names of the fields. Times are seconds since 1970-01-01 UTC, from the clock of the computer.
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
    """The base class of all events of a run. An event is the record of one thing that happened.

    `time_s` is the time at which it happened. `event` is the name of the kind of event, for JSON.
    """

    event: ClassVar[str]
    time_s: float = field(default_factory=time.time, compare=False)


FOUND_OFF = "; the output was already off when the connection was opened again"

OnEvent = Callable[[Event], None]
"""A listener: a function that receives every event and must return at once. An exception in a listener ends the run.

The thread of the run calls the listener, with three exceptions. Another thread calls it for `PageGone`, for
`OffNotConfirmed` while the run still tries to switch the coil off, and for `InterlockOpened` during a ring-down.
"""


def ignore_event(event: Event) -> None:
    """Do nothing with an event."""


@dataclass(frozen=True, kw_only=True)
class RunBegun(Event):
    """A run begins; no instrument has been used yet.

    `states` is the number of states (load steps), `currents_A` their currents. `resumes` is true if the run continues
    an earlier run. `guardian` is true if a guardian process is ready to switch the coil off when the run dies.
    `without_contact` tells, in words, what the supply does when its data connection is cut; empty for a simulated
    supply. `hottest_share` is the largest predicted temperature rise of the coil, divided by its rise after a long time
    at the rated continuous current; null without a rating of the coil. `interlocks` are the names of the readings whose
    bounds the run checks.
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
    """The supply confirmed that its output is now on (`on` is true) or off (`on` is false)."""

    event: ClassVar[str] = "output_switched"
    on: bool


@dataclass(frozen=True, kw_only=True)
class ShapeChange:
    """The change of the shape of the beam at one current that the load cycles before the first state caused.

    An image of the still beam from the last load cycle is compared with an image from the earlier cycle `since_cycle`;
    0 means before the first cycle. `tip_moved_px` and `tip_moved_mm` are the distance between the two positions of the
    tip (pixels and mm). If the tip is not visible in both images, they are null, and `difference_ratio` is given: the
    difference of the two images, divided by the difference that the noise of the camera alone causes.
    """

    current_A: float
    since_cycle: int
    tip_moved_px: float | None = None
    tip_moved_mm: float | None = None
    difference_ratio: float | None = None


@dataclass(frozen=True, kw_only=True)
class ConditioningDone(Event):
    """All load cycles before the first state (load step) are done.

    `cycles` is the number of load cycles. `changes` describes, for each current, how far the cycles changed the shape
    of the still beam.
    """

    event: ClassVar[str] = "conditioning_done"
    cycles: int
    changes: tuple[ShapeChange, ...]


@dataclass(frozen=True, kw_only=True)
class Settled(Event):
    """The run has finished its wait for the beam to come to rest.

    `state` is the number of the state (load step), from 0. `waited_s` is the duration of the wait. `at_rest` is false
    if the beam still moved at the end of the wait.
    """

    event: ClassVar[str] = "settled"
    state: int
    waited_s: float
    at_rest: bool


@dataclass(frozen=True, kw_only=True)
class StateStored(Event):
    """The frames and readings of one state (load step) were written to the dataset on the disk.

    `state` is the number of the state, from 0. `current_A` is its set-point. `waited_s` is the duration of the wait for
    the beam to come to rest. `flags` are the names of the defects of the frames.
    """

    event: ClassVar[str] = "state_stored"
    state: int
    current_A: float
    waited_s: float
    flags: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class RingDownStored(Event):
    """A ring-down (a recording of the beam while it swings freely) was written to the dataset on the disk.

    `ring_down` is the number of this ring-down, from 0, out of `ring_downs`. The current was set from `from_A` to zero
    in one step. `frames` is the number of frames, `lost` the number of frames that did not arrive, and `rate_Hz` the
    number of frames per second. `step_uncertainty_s` is the standard uncertainty of the time of the step. `flags` are
    the names of the defects of the recording.
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
    """The dataset of a resumed run already contains this state (load step). The state is not measured again."""

    event: ClassVar[str] = "state_stored_before"
    state: int
    current_A: float


@dataclass(frozen=True, kw_only=True)
class PauseRequested(Event):
    """A person asked for a pause. The pause begins after the present state (load step) was stored."""

    event: ClassVar[str] = "pause_requested"


@dataclass(frozen=True, kw_only=True)
class Paused(Event):
    """The run waits for a person, with the coil off, before it measures the state (load step) with number `state`.

    Before the ring-downs, `state` equals `states`. `swap_leads` is true if the person has to swap the leads of the coil
    before the run continues.
    """

    event: ClassVar[str] = "paused"
    state: int
    states: int
    dataset: str
    swap_leads: bool = False


@dataclass(frozen=True, kw_only=True)
class Resumed(Event):
    """The pause has ended. The current ramps through the currents of all earlier states (load steps) again.

    The run then continues with the state number `state`.
    """

    event: ClassVar[str] = "resumed"
    state: int


@dataclass(frozen=True, kw_only=True)
class StopRequested(Event):
    """A signal asked the run to stop. `signal` is the name of the signal, such as SIGINT."""

    event: ClassVar[str] = "stop_requested"
    signal: str


@dataclass(frozen=True, kw_only=True)
class SuspendRefused(Event):
    """Ctrl-Z was refused, because a suspended run would leave the coil on."""

    event: ClassVar[str] = "suspend_refused"


@dataclass(frozen=True, kw_only=True)
class PageGone(Event):
    """The program that serves the page in the browser, and that started the run, has ended. The run stops."""

    event: ClassVar[str] = "page_gone"


@dataclass(frozen=True, kw_only=True)
class Warned(Event):
    """A warning, which does not end the run. `message` is a text for a person."""

    event: ClassVar[str] = "warned"
    message: str


@dataclass(frozen=True, kw_only=True)
class FramesLost(Event):
    """Some frames did not arrive completely and are not stored. The run continues.

    `state` is the number of the state (load step) during which the frames were exposed; null at other times. `frames`
    is the number of lost frames. `reasons` gives the number of lost frames for each reason that the camera driver
    reports.
    """

    event: ClassVar[str] = "frames_lost"
    state: int | None
    frames: int
    reasons: dict[str, int]


@dataclass(frozen=True, kw_only=True)
class InterlockOpened(Event):
    """A reading left its bounds or did not come. The run ends with the coil off.

    `reading` is the name of the reading in the rig file. `value` is the value in the unit of the reading; null if no
    value came. `minimum`, `maximum` and `longest_silence_s` are the bounds in the rig file; null if not given.
    `silent_s` is the time since the last value if this time was too long; otherwise null.
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
    """An error ends the run. `kind` is the type of the error. `message` is a text for a person."""

    event: ClassVar[str] = "fault"
    kind: str
    message: str


@dataclass(frozen=True, kw_only=True)
class OffConfirmed(Event):
    """The coil is off.

    `by` is the process that switched the coil off: the run, or the guardian process if the run cannot do it.
    `determined_by` is "commanded" if the supply reports a set-point of zero and an output that is off, and "measured"
    if in addition the measured current `current_A` is below the limit `limit_A`. These two currents are null if the
    supply cannot measure. `takeover` is the reason why the guardian switched the coil off; otherwise null. `run_killed`
    is true if the guardian killed the run first. `address` is the address of the supply; empty if the run switched the
    coil off. `remark` describes failures before the coil was off, in words; usually empty.
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
    """Return the event (the record of what happened) for a coil that is off.

    Parameters
    ----------
    off : Off or None
        The measured current and the largest current that counts as off; None if the supply cannot measure.
    by : str
        The process that switched the coil off: "run" or "guardian".
    takeover : str or None
        The reason why the guardian process switched the coil off; None if the run did it.
    run_killed : bool
        Whether the guardian process killed the run before.
    address : str
        Address of the supply; empty if the run switched the coil off.
    remark : str
        Failures before the coil was off, in words; empty if there was none.
    """
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
    """It could not be confirmed that the coil is off. The coil may still be on.

    A run that refuses to begin, because the output is on or a current flows, reports this, too.
    `by` is the process that tried to switch the coil off: the run, or the guardian process if the run cannot do it.
    `reason` tells a person why this failed. `current_A` and `limit_A` are the measured current and the limit below
    which the coil counts as off; null if no current was measured. `takeover` is the reason why the guardian tried; null
    if the run tried. `run_killed` is true if the guardian killed the run first. `trying_process` is the number of the
    process that continues to try; null if no process tries.
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
    """The guardian process begins to switch the coil off.

    `takeover` is the reason: the run has died, does not respond any more, or cannot switch the coil off itself.
    `address` is the address of the supply.
    """

    event: ClassVar[str] = "guardian_took_over"
    takeover: Takeover
    address: str


@dataclass(frozen=True, kw_only=True)
class RunKilled(Event):
    """The guardian process kills the run, because the run does not respond and occupies the connection.

    `reason` tells why the guardian process could not switch the coil off before this. `address` is the address of the
    supply.
    """

    event: ClassVar[str] = "run_killed"
    address: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class EmulatedSupplyGone(Event):
    """The emulated (simulated) supply does not exist any more, so that the guardian process has nothing to switch off.

    `takeover` is the reason why the guardian process tried to switch the supply off.
    """

    event: ClassVar[str] = "emulated_supply_gone"
    takeover: Takeover
    address: str


@dataclass(frozen=True, kw_only=True)
class RunEnded(Event):
    """The run has ended.

    `status` is "completed", "stopped" (by a signal) or "failed" (by an error). `reason` is the name of the signal or
    the type of the error; empty if `status` is "completed". `stored` is the number of states (load
    steps) in the dataset, out of `states`; null if the run failed before the first state. `missing_ring_downs` is the
    number of ring-downs in the protocol that the dataset does not contain yet.
    """

    event: ClassVar[str] = "run_ended"
    status: Literal["completed", "stopped", "failed"]
    reason: str
    stored: int | None
    states: int
    dataset: str
    missing_ring_downs: int = 0


EVENTS: dict[str, type[Event]] = {kind.event: kind for kind in Event.__subclasses__()}
"""The class of every event, by the name of the event in JSON."""
