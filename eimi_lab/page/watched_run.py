"""Connect a run to the live web page: send frames and events, and receive requests as lines on standard input.

When standard input closes, the run ends with its coil off. The connection never delays the run.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

from eimi_drivers.interfaces import Clock, Identity, Limits, Off, PowerSupply, Reading, SwitchOffFailed
from eimi_drivers.supplies.off import switch_off
from eimi_lab.acquisition.coil import without_contact
from eimi_lab.acquisition.events import OnEvent, PageGone
from eimi_lab.acquisition.heating import Warming
from eimi_lab.acquisition.live_view import Live, Show, show_nothing
from eimi_lab.acquisition.open_bench import Bench
from eimi_lab.config.rig import Rig
from eimi_lab.page.frame_memory import FrameMemory
from eimi_lab.process.console import typed_line
from eimi_lab.process.pipes import never_wait_to_write, received
from eimi_lab.process.stopping import signal_main_thread

SIGNAL = "signal "
"""Beginning of a line with which the page sends a signal on Windows. The number of the signal follows."""

SHOWN_EVERY_S = 1 / 40
RATE_OVER_S = 1.0


@dataclass(frozen=True)
class Descriptors:
    """File descriptors that a run inherits from the server of the live web page.

    `memory` is the shared memory for the newest frame. `bell` is a pipe that announces new frames. `events` is a pipe
    for the events of the run.
    """

    memory: int
    bell: int
    events: int

    @classmethod
    def of(cls, names: str) -> Descriptors:
        """Read the three file descriptors from a command-line argument: numbers, separated by commas."""
        return cls(*map(received, names.split(",")))


@dataclass(frozen=True)
class Watched:
    """Arguments for `acquire` with which a person can watch and pause a run.

    `bench` contains the open instruments, `show` receives every frame, and `typed` returns the next line that a person
    typed.
    """

    bench: Bench
    show: Show = show_nothing
    typed: Callable[[], str | None] = typed_line


@contextmanager
def watched(page: Descriptors | None, bench: Bench, rig: Rig, on_event: OnEvent) -> Iterator[Watched]:
    """Connect a run to the live web page, and yield arguments for `acquire` with which a person can watch and pause it.

    Parameters
    ----------
    page : Descriptors or None
        File descriptors that the page passed to the run; None without a page.
    bench : Bench
        The open instruments.
    rig : Rig
        The rig, which gives the rating of the coil.
    on_event : OnEvent
        Receives `PageGone` if the program of the page ends.
    """
    if page is None:
        yield Watched(bench)
        return
    supply = WatchedSupply(bench.supply, bench.clock, rig)
    typed: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(typed, on_event), daemon=True).start()

    def next_line() -> str | None:
        with suppress(queue.Empty):
            return typed.get_nowait()
        return None

    sender = _FrameSender(FrameMemory(page.memory), page.bell, supply)
    yield Watched(replace(bench, supply=supply), sender.show, next_line)


def _listen(typed: queue.SimpleQueue[str], on_event: OnEvent) -> None:
    for line in sys.stdin:
        if line.startswith(SIGNAL):
            signal_main_thread(int(line.removeprefix(SIGNAL)))
        else:
            typed.put(line.strip())
    on_event(PageGone())
    signal_main_thread(signal.SIGTERM)


class WatchedSupply:
    """A power supply that stores its set-point, its measured current and the heating of the coil for the live web page.

    Other calls are passed to the wrapped supply.
    """

    def __init__(self, supply: PowerSupply, clock: Clock, rig: Rig) -> None:
        self._supply, self._clock = supply, clock
        self._warming = Warming(rig.coil) if rig.coil else None
        self.limits: Limits = supply.limits
        self.set_A, self.measured_A = 0.0, 0.0
        self.on = False

    @property
    def without_contact(self) -> str:
        """Sentence on whether the coil is on or off after the cable to the supply is pulled."""
        return without_contact(self._supply)

    @property
    def measures_current(self) -> bool:
        """Whether the supply can measure its current."""
        return bool(getattr(self._supply, "measures_current", True))

    @property
    def reads_zero_within_A(self) -> float:
        """Largest current that the meter of the supply shows when no current flows, A."""
        return float(getattr(self._supply, "reads_zero_within_A", 0.0))

    @property
    def current_step_A(self) -> str | None:
        """Step in which the supply sets its current, A, as decimal text; None if not known."""
        return getattr(self._supply, "current_step_A", None)

    def values(self) -> dict[str, Any]:
        """Return the set-point (A), the measured current (A), whether the output is on, and the heating of the coil.

        The heating is the rise of the coil's temperature, divided by the rise at the continuous current of the coil;
        None without a rating of the coil.
        """
        heat = self._warming.share(self._clock.now()) if self._warming else None
        return {"set_A": self.set_A, "measured_A": self.measured_A, "on": self.on, "heat_share": heat}

    def identify(self) -> Identity:
        """Return the identity of the supply."""
        return self._supply.identify()

    def set_voltage(self, voltage_V: float) -> None:
        """Set the voltage, V."""
        self._supply.set_voltage(voltage_V)

    def set_current(self, current_A: float) -> None:
        """Set the current, A, and store it as the set-point."""
        self._supply.set_current(current_A)
        self.set_A = current_A
        if self._warming:
            self._warming.flows(self._clock.now(), current_A if self.on else 0.0)

    def set_output(self, on: bool) -> None:
        """Switch the output on or off, and store whether it is on."""
        self._supply.set_output(on)
        self._switched(on)

    def output_on(self) -> bool:
        """Return whether the output of the supply is on."""
        return self._supply.output_on()

    def measure(self) -> Reading:
        """Measure voltage and current, and store the current."""
        reading = self._supply.measure()
        self.measured_A = reading.current_A
        return reading

    def check(self) -> None:
        """Raise an error if the supply reports a fault."""
        self._supply.check()

    def safe_off(self) -> Off | None:
        """Switch the supply off, and return the measured current; None if the supply cannot measure.

        Raises SwitchOffFailed if the supply could not be confirmed off.
        """
        try:
            off = switch_off(self._supply, self._clock)
        except SwitchOffFailed as error:
            self.measured_A = self.measured_A if error.current_A is None else error.current_A
            raise
        self.set_A, self.measured_A = 0.0, off.current_A if off else 0.0
        self._switched(False)
        return off

    def close(self) -> None:
        """Close the connection to the supply."""
        self._supply.close()

    def _switched(self, on: bool) -> None:
        self.on = on
        if self._warming and not on:
            self._warming.flows(self._clock.now(), 0.0)


class _FrameSender:
    """Writes frames into the shared memory for the page, and signals each new frame through a pipe."""

    def __init__(self, memory: FrameMemory, bell: int, supply: WatchedSupply) -> None:
        self._memory, self._bell, self._supply = memory, bell, supply
        never_wait_to_write(bell)
        self._times: deque[float] = deque()
        self._shown_s = 0.0

    def show(self, live: Live) -> None:
        now = time.monotonic()
        self._times.append(now)
        while self._times[0] < now - RATE_OVER_S:
            self._times.popleft()
        if now - self._shown_s < SHOWN_EVERY_S:
            return
        self._shown_s = now
        about = {
            "at_s": now,
            "rate_Hz": len(self._times) / RATE_OVER_S,
            "state": live.state,
            "number": live.frame.number,
        }
        self._memory.write(live.frame.image, about | self._supply.values())
        with suppress(OSError):  # the page has ended, or the pipe is full of signals
            os.write(self._bell, b"\0")
