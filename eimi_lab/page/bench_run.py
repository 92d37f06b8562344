"""Start, watch and end a run (the measurement of one dataset) from the live web page.

The run is `eimi acquire` in a separate process.
"""

# When the page ends, the run ends with its coil off.
#
# STOP sends two signals to the run. The run reacts to a signal even while it waits for a frame or a message. After the
# second signal it switches the coil off without a ramp. If no event confirms within some seconds that the coil is off,
# the run is killed. Its guardian (a separate process that switches the coil off if the run dies) then switches the coil
# off.
#
# The server derives the state of the run only from the events of the run and its guardian. The last line of the run on
# standard error is shown to the person, and does not change the state. In this line and in the sentences about events,
# instructions for a terminal are replaced by those for the page.

from __future__ import annotations

import asyncio
import os
import re
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eimi_lab.acquisition.event_lines import from_line
from eimi_lab.acquisition.event_words import in_words, off_after
from eimi_lab.acquisition.events import (
    ConditioningDone,
    Event,
    FramesLost,
    OffConfirmed,
    OffNotConfirmed,
    OutputSwitched,
    Paused,
    PauseRequested,
    Resumed,
    RunBegun,
    StateStored,
    StateStoredBefore,
    SuspendRefused,
    Warned,
)
from eimi_lab.page.frame_memory import new_memory
from eimi_lab.page.instructions import at_the_page
from eimi_lab.page.opened_eyes import OpenedEyes, Seen
from eimi_lab.page.watched_run import SIGNAL
from eimi_lab.process.detached import detached
from eimi_lab.process.pipes import handed_down
from eimi_lab.process.stopping import SIGNALS_BETWEEN_PROCESSES

CONFIRMED_WITHIN_S = 4.0
"""Time (s) after STOP within which a run has to confirm that the coil is off. Otherwise the run is killed."""

_SIGNAL_NAME = re.compile(r"^stopped by SIG[A-Z]+: ")
CLOSED_WITHIN_S = 10.0
KEPT_LINES = 40
LONGEST_LINE = 1 << 24  # bytes: the first event of a run holds every current of its protocol
NOTHING_SWITCHED = "nothing happens, because the coil is simulated"
NOTHING_ON = "this run has switched nothing on"
"""The answer to STOP before a run has switched the coil on."""

SAID = (
    StateStored,
    StateStoredBefore,
    ConditioningDone,
    PauseRequested,
    Paused,
    Resumed,
    SuspendRefused,
    Warned,
    FramesLost,
)
"""The types of events that the page shows to the person as sentences."""

AT_ONCE = (signal.SIGINT, signal.SIGTERM)  # two different signals, because the kernel merges two equal ones


@dataclass(frozen=True, kw_only=True)
class Order:
    """The input files and the options of a run, as texts for the command `eimi acquire`.

    `resume` continues an incomplete dataset, `take_over` switches off an output that is on before the run, and `note`
    is a remark for the dataset.
    """

    protocol: str
    specimen: str
    rig: str
    dataset: Path
    resume: bool = False
    take_over: bool = False
    note: str = ""

    def arguments(self) -> list[str]:
        """Return the command-line arguments for `eimi acquire`."""
        arguments = ["acquire", f"--specimen={self.specimen}", f"--rig={self.rig}", f"--output={self.dataset}"]
        arguments += [f"--note={self.note}"] if self.note else []
        arguments += ["--resume"] if self.resume else []
        arguments += ["--take-over"] if self.take_over else []
        return [*arguments, "--", self.protocol]


@dataclass
class Progress:
    """The progress of a run as the live web page shows it.

    Attributes
    ----------
    number : int
        Number of the run on this page.
    phase : str
        "beginning", "running", "pausing", "paused", "ending" (with a ramp), "stopping" or "ended".
    coil : str
        "off", "on", "switching off" or "unknown".
    off_by : str
        "measured" if a measured current confirmed that the coil is off, "commanded" if only the settings of the supply
        confirmed it; otherwise empty.
    coil_A : float or None
        Current that was measured when the coil was switched off, A; None if no current was measured.
    left_s : float or None
        Estimated remaining time, s; None before two load steps are stored.
    stopped : bool
        Whether a person ended the run.
    last_words : str
        The last line that the run wrote to standard error.
    said : deque of str
        Sentences about the last events of the run.
    """

    number: int
    dataset: str
    protocol: str
    specimen: str
    rig: str
    phase: str = "beginning"
    coil: str = "off"
    off_by: str = ""
    coil_A: float | None = None
    states: int = 0
    currents_A: list[float] = field(default_factory=list)
    stored: int = 0
    without_contact: str = ""
    guardian: bool = False
    hottest_share: float | None = None
    left_s: float | None = None
    status: int | None = None
    stopped: bool = False
    last_words: str = ""
    said: deque[str] = field(default_factory=lambda: deque(maxlen=KEPT_LINES))

    def as_json(self) -> dict[str, Any]:
        """Return the progress of the run as a JSON object."""
        return {**vars(self), "said": list(self.said)}


class BenchRun:
    """A run that the live web page started, in progress or ended.

    Parameters
    ----------
    order : Order
        Input files and options of the run.
    number : int
        Number of the run on this page.
    name : str
        Name of the dataset on the page.
    changed : callable
        Called at every change of ``progress``.
    seen : callable
        Receives the frames of the run, and the edges that were found in a frame.
    """

    def __init__(
        self,
        order: Order,
        number: int,
        name: str,
        changed: Callable[[], None],
        seen: Seen,
    ) -> None:
        self.order = order
        protocol, specimen, rig = (Path(chosen).stem for chosen in (order.protocol, order.specimen, order.rig))
        self.progress = Progress(number, name, protocol, specimen, rig)
        self._changed = changed
        self._eyes = OpenedEyes(number, seen)
        self._run: asyncio.subprocess.Process | None = None
        self._called_off = False  # a person ended the run before its process was started
        self._tasks: list[asyncio.Task[None]] = []
        self._answered = asyncio.Event()
        self._answered.set()
        self._last_off: OffConfirmed | OffNotConfirmed | None = None
        self._ended = asyncio.Event()
        self._taking: tuple[float, int] | None = None

    @property
    def going_on(self) -> bool:
        """Whether the run, or the process that switches its coil off after a crash, is still active."""
        return not self._ended.is_set()

    async def begin(self) -> None:
        """Start the run, and start the processes that compress its frames and find edges.

        A run that a person has ended already is not started.
        """
        try:
            if self._called_off:
                self._has_ended()
            else:
                await self._start()
        except BaseException:
            self._kill()
            self._has_ended()
            raise

    async def _start(self) -> None:
        memory = new_memory()
        bell_read_end, bell = os.pipe()
        events_read_end, events = os.pipe()
        try:
            await self._start_with(memory, bell, bell_read_end, events)
        except BaseException:
            os.close(events_read_end)
            raise
        finally:
            for descriptor in (memory, bell, events, bell_read_end):
                os.close(descriptor)
        for work in (self._hear(events_read_end), self._eyes.see()):
            self._tasks.append(asyncio.create_task(work))

    async def _start_with(self, memory: int, bell: int, bell_read_end: int, events: int) -> None:
        with handed_down(memory, bell, events) as (names, inherited):
            self._run = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", "eimi_lab", *self.order.arguments()[:1]),
                *("--quiet", f"--watched-by={','.join(names)}", *self.order.arguments()[1:]),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                **(inherited | detached()),
            )
        if self._called_off:
            self._signal(signal.SIGTERM)
        rig, specimen = self.order.rig, self.order.specimen
        await self._eyes.open(memory, bell_read_end, rig, specimen)

    def pause(self) -> None:
        """Ask the run to pause after the present load step."""
        if self.progress.phase == "running":
            self._type("p")

    def go_on(self) -> None:
        """Ask a paused run to continue."""
        if self.progress.phase == "paused":
            self._type("")

    def end(self) -> None:
        """Ask the run to reduce the current to zero with a ramp and then to end."""
        if self.going_on:
            self._signal(signal.SIGINT)
            self.progress.stopped = True
            self._phase("ending")

    def stop(self) -> asyncio.Task[str]:
        """Switch the coil off at once, without a ramp.

        The result of the returned task is a sentence that says whether the coil is off.
        """
        if self.going_on:
            for number in AT_ONCE:
                self._signal(number)
            if self.progress.coil == "on":
                self.progress.coil = "switching off"
            self.progress.stopped = True
            self._phase("stopping")
        return asyncio.create_task(self._confirmed())

    async def closed(self) -> None:
        """End the run with a ramp of the current to zero, and wait until all processes of the run have ended."""
        if self.going_on:
            self.end()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._ended.wait(), CLOSED_WITHIN_S)
            if self.going_on:
                self._kill()
        self._eyes.kill()
        await asyncio.gather(*self._tasks)

    async def _confirmed(self) -> str:
        began = time.monotonic()
        try:
            await asyncio.wait_for(self._answered.wait(), CONFIRMED_WITHIN_S)
        except TimeoutError:
            self._kill()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._answered.wait(), CLOSED_WITHIN_S)
        off = self._last_off
        if self.progress.coil == "off":
            return off_after(off, time.monotonic() - began) if isinstance(off, OffConfirmed) else NOTHING_ON
        if isinstance(off, OffNotConfirmed):
            return at_the_page(in_words(off))
        return in_words(OffNotConfirmed(by="run", reason=""))

    def _signal(self, number: int) -> None:
        if self._run is None:
            self._called_off = True
        elif SIGNALS_BETWEEN_PROCESSES:
            with suppress(ProcessLookupError):
                self._run.send_signal(number)
        else:
            self._type(f"{SIGNAL}{number:d}")

    def _kill(self) -> None:
        if self._run is not None:
            with suppress(ProcessLookupError):
                self._run.kill()

    def _type(self, line: str) -> None:
        assert self._run is not None
        assert self._run.stdin is not None
        with suppress(ConnectionError):
            self._run.stdin.write(line.encode() + b"\n")

    def _phase(self, phase: str) -> None:
        self.progress.phase = phase
        self._changed()

    def _coil(self, state: str, event: OffConfirmed | OffNotConfirmed | None = None) -> None:
        self.progress.coil = state
        self.progress.coil_A = event.current_A if event else None
        self.progress.off_by = event.determined_by if isinstance(event, OffConfirmed) else ""
        if state in ("on", "switching off"):
            self._answered.clear()
        else:  # the coil is off, or it is unknown whether the coil is off
            self._answered.set()

    async def _hear(self, events: int) -> None:
        """Read the events and messages of the run until the run has ended."""
        assert self._run is not None
        await asyncio.gather(self._hear_events(events), self._hear_words())
        self.progress.status = await self._run.wait()
        if self.progress.coil in (
            "on",
            "switching off",
        ):  # no event confirmed that the coil is off; a run without a guardian has a simulated supply
            self._coil("unknown" if self.progress.guardian else "off")
        self._has_ended()

    def _has_ended(self) -> None:
        self._ended.set()
        self._phase("ended")

    async def _hear_events(self, descriptor: int) -> None:
        """Read the events of the run until its pipe is closed."""
        loop = asyncio.get_running_loop()
        lines: asyncio.Queue[bytes] = asyncio.Queue()

        def read() -> None:
            with os.fdopen(descriptor, "rb") as pipe, suppress(RuntimeError):  # the page has ended
                while line := pipe.readline(LONGEST_LINE):
                    loop.call_soon_threadsafe(lines.put_nowait, line)
                loop.call_soon_threadsafe(lines.put_nowait, b"")

        # On Windows, asyncio cannot read a pipe of this kind.
        threading.Thread(target=read, name="events", daemon=True).start()
        while line := await lines.get():
            with suppress(ValueError):  # a killed run leaves an incomplete line
                self.heard(from_line(line))

    def heard(self, event: Event | None) -> None:
        """Update `progress` from an event of the run. None stands for an event of an unknown type."""
        progress = self.progress
        match event:
            case RunBegun():
                progress.states, progress.currents_A = event.states, list(event.currents_A)
                progress.guardian, progress.hottest_share = event.guardian, event.hottest_share
                progress.without_contact = event.without_contact or NOTHING_SWITCHED
            case OutputSwitched(on=True):
                self._coil("on" if progress.phase != "stopping" else "switching off")
                if progress.phase in ("beginning", "paused"):
                    progress.phase = "running"
            case OffConfirmed():
                self._last_off = event
                self._coil("off", event)
            case OffNotConfirmed():
                self._last_off = event
                self._coil("unknown", event)
            case PauseRequested() if progress.phase == "running":  # not in the last state, after which nothing follows
                progress.phase = "pausing"
            case Paused() if progress.phase == "pausing" or event.swap_leads:
                progress.phase = "paused"
            case StateStored():
                progress.stored += 1
                self._estimate(event.time_s)
            case StateStoredBefore():
                progress.stored += 1
        if isinstance(event, SAID):
            progress.said.append(at_the_page(in_words(event)))
        self._changed()

    def _estimate(self, at_s: float) -> None:
        """Estimate the remaining time of the run. `at_s` (s) is the time at which a load step was stored."""
        if self._taking is None:
            self._taking = at_s, self.progress.stored
            return
        since_s, states = self._taking
        a_state_s = (at_s - since_s) / (self.progress.stored - states)
        self.progress.left_s = a_state_s * (self.progress.states - self.progress.stored)

    async def _hear_words(self) -> None:
        """Store the last line that the run wrote to standard error."""
        assert self._run is not None
        assert self._run.stderr is not None
        async for raw in self._run.stderr:
            if line := raw.decode("utf-8", "replace").strip():
                self.progress.last_words = at_the_page(_SIGNAL_NAME.sub("", line.removeprefix("eimi: ")))
