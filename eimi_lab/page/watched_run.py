"""The run's side of the page: an ordinary `eimi acquire` that shows what it does and hears what is asked.

Nothing here may keep the run waiting. Frames go into memory that is shared, events through a pipe that a thread writes
to. What the page asks comes in lines on standard input, as if it were typed; when that closes the page is gone, and the
run ends with its coil off.
"""

from __future__ import annotations

import json
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

from eimi_drivers.interfaces import Clock, Identity, Limits, PowerSupply, Reading
from eimi_lab.acquisition.coil import without_contact
from eimi_lab.acquisition.heating import Warming, hottest
from eimi_lab.acquisition.live_view import Live, Show, show_nobody
from eimi_lab.acquisition.open_bench import Bench
from eimi_lab.acquisition.pausing import typed_line
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.page.frame_memory import FrameMemory
from eimi_lab.process.errors import tell

SHOWN_EVERY_S = 1 / 40
RATE_OVER_S = 1.0
LAST_WORDS_S = 1.0


@dataclass(frozen=True)
class Watched:
    """What `acquire` is given so that somebody sees the run, and may pause it."""

    bench: Bench
    report: Callable[[str], None]
    remark: Callable[[str], None] = tell
    show: Show = show_nobody
    typed: Callable[[], str | None] = typed_line


@contextmanager
def watched(
    descriptors: str | None, bench: Bench, protocol: Protocol, rig: Rig, report: Callable[[str], None]
) -> Iterator[Watched]:
    """For a run that a page began: numbers of the descriptors of memory, of a bell and of events, with commas.

    None is a run at a terminal.
    """
    if descriptors is None:
        yield Watched(bench, report)
        return
    memory, bell, events = map(int, descriptors.split(","))
    say = _Events(events)
    supply = WatchedSupply(bench.supply, bench.clock, rig, say)
    typed: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(typed,), daemon=True).start()
    say(
        "begun",
        states=len(protocol.currents_A),
        currents_A=list(protocol.currents_A),
        without_contact="nothing is switched: the coil is simulated" if rig.simulated else without_contact(supply),
        guardian=bench.guardian is not None,
        hottest_share=hottest(protocol, rig.coil).share if rig.coil else None,
    )

    def stored(words: str) -> None:
        say("stored", words=words)
        report(words)

    def remark(words: str) -> None:
        say("remark", words=words)
        tell(words)

    def next_line() -> str | None:
        with suppress(queue.Empty):
            return typed.get_nowait()
        return None

    try:
        shown = _Shown(FrameMemory(memory), bell, supply)
        yield Watched(replace(bench, supply=supply), stored, remark, shown.show, next_line)
    finally:
        say.finish()


def _listen(typed: queue.SimpleQueue[str]) -> None:
    for line in sys.stdin:
        typed.put(line.strip())
    tell("the page is gone; the run ends, coil off")
    os.kill(os.getpid(), signal.SIGTERM)


class _Events:
    """Lines of JSON to the page; a thread writes them, so that nobody waits for a reader."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._writer = threading.Thread(target=self._write, daemon=True)
        self._writer.start()

    def __call__(self, what: str, **told: Any) -> None:
        line = json.dumps({"what": what, "at_s": time.monotonic(), **told})
        self._waiting.put(line.encode() + b"\n")

    def finish(self) -> None:
        self._waiting.put(None)
        self._writer.join(LAST_WORDS_S)

    def _write(self) -> None:
        with suppress(OSError), open(self._descriptor, "wb", buffering=0) as pipe:
            while line := self._waiting.get():
                pipe.write(line)


class WatchedSupply:
    """A supply that tells what is asked of it and what it measured; see `PowerSupply` for what each method does.

    watched: the supply itself.
    """

    def __init__(self, supply: PowerSupply, clock: Clock, rig: Rig, say: _Events) -> None:
        self.watched, self._clock, self._say = supply, clock, say
        self._warming = Warming(rig.coil) if rig.coil else None
        self.limits: Limits = supply.limits
        self.set_A, self.measured_A = 0.0, 0.0
        self.on = False

    @property
    def without_contact(self) -> str:
        """As the driver has it."""
        return without_contact(self.watched)

    def values(self) -> dict[str, Any]:
        """What is known of the coil now; heat is a share of what it bears for ever."""
        heat = self._warming.share(self._clock.now()) if self._warming else None
        return {"set_A": self.set_A, "measured_A": self.measured_A, "on": self.on, "heat_share": heat}

    def identify(self) -> Identity:
        return self.watched.identify()

    def set_voltage(self, voltage_V: float) -> None:
        self.watched.set_voltage(voltage_V)

    def set_current(self, current_A: float) -> None:
        self.watched.set_current(current_A)
        self.set_A = current_A
        if self._warming:
            self._warming.flows(self._clock.now(), current_A if self.on else 0.0)

    def set_output(self, on: bool) -> None:
        self.watched.set_output(on)
        self._told_on(on)

    def output_on(self) -> bool:
        return self.watched.output_on()

    def measure(self) -> Reading:
        reading = self.watched.measure()
        self.measured_A = reading.current_A
        return reading

    def check(self) -> None:
        self.watched.check()

    def safe_off(self) -> None:
        self.watched.safe_off()
        self.set_A = self.measured_A = 0.0
        self._told_on(False)

    def close(self) -> None:
        self.watched.close()

    def _told_on(self, on: bool) -> None:
        self.on = on
        if self._warming and not on:
            self._warming.flows(self._clock.now(), 0.0)
        self._say("output", on=on)


class _Shown:
    """Puts frames where the page sees them, and rings."""

    def __init__(self, memory: FrameMemory, bell: int, supply: WatchedSupply) -> None:
        self._memory, self._bell, self._supply = memory, bell, supply
        os.set_blocking(bell, False)
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
        with suppress(OSError):  # nobody listens, or the bell rings already
            os.write(self._bell, b"\0")
