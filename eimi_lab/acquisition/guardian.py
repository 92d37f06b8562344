"""A process that switches the coil off when the run dies or stands still: the run's side of it.

A pipe leads to it whose writing end only the run has: that end closes with the run, however the run ends. While it is
armed the run beats on that pipe with every step that it takes; a run that lives and does not move on is as bad as one
that died. On another pipe the guardian says that it is there, since a run goes on only under guard. What it does is in
`guardian_process`.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass

from eimi_drivers.interfaces import Identity, InstrumentError, Limits

READY_WITHIN_S = 120.0
STILL_FOR_S = 5.0
"""A run that has not beaten for so long is taken for one that stands still."""

SILENT_FOR_S = 1.5
"""A guardian that has said nothing for so long is taken for one that is gone; it says something every quarter of it."""

BEAT_EVERY_S = 0.1
LONGEST_GAP_S = 10.0
"""A run that did nothing for longer was stopped, or the computer slept: it does not go on."""
TAKING_OVER_WITHIN_S = 10.0

READY, HERE, TAKING_OVER = b"ready\n", b".\n", b"taking over\n"  # of the guardian
ARM, BEAT, DISARM, TAKE_OVER, ALLOW, SUPPLY = b"on", b".", b"off", b"take over", b"allow ", b"supply "  # of the run


def awake_s() -> float:
    """Return seconds of a clock that also counts while the computer sleeps, where the system has one."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()


@dataclass(frozen=True)
class Ward:
    """The supply to switch off: driver, address and limits, as the rig has them.

    packed: the driver itself, if this program added it; see `added_driver.pack`. identity: text and serial number of
    the supply that the run uses; None before the run has asked.
    """

    driver: str
    address: str
    current_A: float
    voltage_V: float
    packed: str = ""
    off_below_A: float | None = None
    identity: tuple[str, str] | None = None

    @property
    def limits(self) -> Limits:
        """The limits that the driver is opened with."""
        return Limits(self.current_A, self.voltage_V, self.off_below_A)


class Guardian:
    """A process that is armed while the output may be on. See `guarding`."""

    def __init__(self, ward: Ward, events: int | None = None) -> None:
        """Start the process; it gets ready while the run goes on. A session of its own keeps Ctrl-C away from it.

        events: a descriptor that it writes its events to, as lines of JSON.
        """
        self._ward = ward
        inherited = [] if events is None else [os.dup(events)]  # above 2: standard output is its pipe to the run
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", f"{__name__}_process", json.dumps(asdict(ward)), *map(str, inherited)],
            pass_fds=inherited,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,
        )
        for descriptor in inherited:
            os.close(descriptor)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin, self._process.stdout
        for end in (self._to, self._from):
            os.set_blocking(end.fileno(), False)
        self._said = b""
        self._armed = False
        self._heard_s = time.monotonic()
        self._beaten_s, self._gap_s = awake_s(), 0.0

    def arm(self) -> None:
        """From here on the end of the run switches the coil off. Raises InstrumentError when nobody is on guard."""
        until = time.monotonic() + READY_WITHIN_S
        while READY not in self._said and self._process.poll() is None and time.monotonic() < until:
            select.select([self._from], [], [], 0.2)
            self._listen()
        if READY not in self._said or not self._send(ARM):
            raise InstrumentError(f"{self._ward.address}: the guardian process did not start; nothing was switched on")
        self._armed = True
        self._heard_s = time.monotonic()
        self._beaten_s, self._gap_s = awake_s(), 0.0

    def expect(self, identity: Identity) -> None:
        """Say which supply the run uses, so that the guardian believes and touches no other one at its address."""
        self._send(SUPPLY + json.dumps([identity.text, identity.serial_number]).encode())

    def beat(self) -> None:
        """The run moves on. Never waits, raises nothing."""
        if self._armed and awake_s() - self._beaten_s > BEAT_EVERY_S:
            self._note_the_gap()
            self._beaten_s = awake_s()
            self._send(BEAT)

    def allow(self, seconds: float) -> None:
        """The next beat may take so long; never waits, raises nothing."""
        if self._armed:
            self._note_the_gap()
            self._beaten_s = awake_s() + seconds
            self._send(ALLOW + f"{seconds:.1f}".encode())

    def refuse_a_gap(self) -> None:
        """Raise InstrumentError if the run did nothing for longer than `LONGEST_GAP_S` while the coil was on."""
        self._note_the_gap()
        if self._armed and self._gap_s:
            raise InstrumentError(
                f"{self._ward.address}: the run stood still for {self._gap_s:.0f} s with the coil on: the computer "
                "slept, or the process was stopped; a run does not go on after that"
            )

    def _note_the_gap(self) -> None:
        gap_s = awake_s() - self._beaten_s
        if self._armed and gap_s > LONGEST_GAP_S:
            self._gap_s = max(self._gap_s, gap_s)

    def check(self) -> None:
        """Raise InstrumentError when the guardian is gone, stopped, or has taken over: the run has to end."""
        if not self._armed:
            return
        self.refuse_a_gap()
        self._listen()
        place = self._ward.address
        if TAKING_OVER in self._said:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(TAKING_OVER_WITHIN_S)
            raise InstrumentError(
                f"{place}: the run stood still for more than {STILL_FOR_S:g} s, and its guardian process took over to "
                "switch the coil off"
            )
        if self._process.poll() is not None:
            raise InstrumentError(
                f"{place}: the guardian process ended (status {self._process.returncode}); a run goes on only under "
                "guard"
            )
        if time.monotonic() - self._heard_s > SILENT_FOR_S:
            raise InstrumentError(
                f"{place}: the guardian process does not answer any more; a run goes on only under guard"
            )

    def disarm(self) -> None:
        """The coil is known to be off; one whose guardian is gone needs none any more."""
        self._armed = False
        self._send(DISARM)

    def dismiss(self) -> None:
        """Close the pipe. One that is armed sets to work now, and is not waited for."""
        if self._armed:
            self._process.send_signal(signal.SIGCONT)  # it may have been stopped
            self._send(TAKE_OVER)
        else:
            self._process.kill()
            self._process.wait()
        self._to.close()
        self._from.close()

    def _listen(self) -> None:
        with suppress(BlockingIOError):
            while heard := os.read(self._from.fileno(), 4096):
                self._heard_s = time.monotonic()
                self._said = (self._said + heard).replace(HERE, b"")

    def _send(self, message: bytes) -> bool:
        try:
            os.write(self._to.fileno(), message + b"\n")
        except OSError:  # it is gone, or stopped for so long that the pipe is full
            return False
        return True


@contextmanager
def guarding(ward: Ward, events: int | None = None) -> Iterator[Guardian]:
    """A guardian for one run. One that was armed and not disarmed switches off when the context is left.

    events: see `Guardian`.
    """
    guardian = Guardian(ward, events)
    try:
        yield guardian
    finally:
        guardian.dismiss()
