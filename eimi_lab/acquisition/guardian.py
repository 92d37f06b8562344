"""Start the guardian process, and exchange messages with it during a run.

The guardian process switches the coil off if the run dies or stands still; its code is in `guardian_process`. The run
holds the only writing end of a pipe to the guardian. The system closes this end when the run ends, for any reason.
While the guardian is armed, every step of the run writes a beat to the pipe, so that the guardian also notices a run
that stands still. On a second pipe the guardian reports that it is alive. Without these reports the run ends, because a
run without a guardian is not allowed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass

from eimi_drivers.interfaces import Identity, InstrumentError, Limits
from eimi_lab.process.awake import awake_s
from eimi_lab.process.detached import detached, resume
from eimi_lab.process.pipes import handed_down, never_wait_to_write, readable

READY_WITHIN_S = 120.0
STILL_FOR_S = 5.0
"""Time without a beat after which the guardian treats the run as standing still."""

SILENT_FOR_S = 1.5
"""Time without a report after which the run treats the guardian as gone; it reports four times as often."""

BEAT_EVERY_S = 0.1
LONGEST_GAP_S = 10.0
"""Longest time between two beats. A longer gap means the process was stopped or the computer slept: the run ends."""
TAKING_OVER_WITHIN_S = 10.0

READY, HERE, TAKING_OVER = b"ready\n", b".\n", b"taking over\n"  # messages of the guardian
ARM, BEAT, DISARM, TAKE_OVER, ALLOW, SUPPLY = b"on", b".", b"off", b"take over", b"allow ", b"supply "  # of the run
RECOGNISED = b"recognised"


class StoodStill(InstrumentError):
    """The run did nothing for longer than `LONGEST_GAP_S` while the coil was on."""


@dataclass(frozen=True)
class Ward:
    """The supply that the guardian switches off: driver, address and limits of the rig.

    packed: the code of a driver that this program added, see `added_driver.pack`. identity: text and serial number of
    the supply that the run uses; None until the run has read them. recognised: whether the run switched the output off
    and still measured a current.
    """

    driver: str
    address: str
    current_A: float
    voltage_V: float
    packed: str = ""
    off_below_A: float | None = None
    identity: tuple[str, str] | None = None
    recognised: bool = False

    @property
    def limits(self) -> Limits:
        """The current limit, the voltage limit and the off limit with which the driver is opened."""
        return Limits(self.current_A, self.voltage_V, self.off_below_A)


class Guardian:
    """The run's connection to its guardian process, which is armed while the output may be on; see `guarding`.

    Parameters
    ----------
    ward : Ward
        The supply to switch off.
    events : int or None
        File descriptor to which the guardian writes its events, as lines of JSON.

    Notes
    -----
    The constructor starts the process and does not wait until it is ready. The process has its own session, so that
    Ctrl-C on the terminal does not reach it.
    """

    def __init__(self, ward: Ward, events: int | None = None) -> None:
        self._ward = ward
        inherited = [] if events is None else [os.dup(events)]  # not 1: standard output is the pipe to the run
        with handed_down(*inherited) as (names, options):
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", f"{__name__}_process", json.dumps(asdict(ward)), *names],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                **options,
                **detached(),
            )
        for descriptor in inherited:
            os.close(descriptor)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin, self._process.stdout
        never_wait_to_write(self._to.fileno())
        self._said = b""
        self._armed = False
        self._heard_s = time.monotonic()
        self._beaten_s, self._gap_s = awake_s(), 0.0

    def arm(self) -> None:
        """Arm the guardian: if the run ends before `disarm`, the guardian switches the coil off.

        Raises InstrumentError if the guardian process did not start.
        """
        until = time.monotonic() + READY_WITHIN_S
        while READY not in self._said and self._process.poll() is None and time.monotonic() < until:
            readable(self._from.fileno(), 0.2)
            self._listen()
        if READY not in self._said or not self._send(ARM):
            raise InstrumentError(f"{self._ward.address}: the guardian process did not start; nothing was switched on")
        self._armed = True
        self._heard_s = time.monotonic()
        self._beaten_s, self._gap_s = awake_s(), 0.0

    def expect(self, identity: Identity) -> None:
        """Send the identity of the run's supply, so that the guardian uses no other supply at the same address."""
        self._send(SUPPLY + json.dumps([identity.text, identity.serial_number]).encode())

    def recognise(self) -> None:
        """Report that the run itself switched the output off and still measured a current.

        The guardian then finds the output off although this is the supply of the coil.
        """
        self._send(RECOGNISED)

    def beat(self) -> None:
        """Report that the run has taken a step. The method never waits and raises no error."""
        if self._armed and awake_s() - self._beaten_s > BEAT_EVERY_S:
            self._note_the_gap()
            self._beaten_s = awake_s()
            self._send(BEAT)

    def allow(self, seconds: float) -> None:
        """Allow the run this time (s) until its next beat. The method never waits and raises no error."""
        if self._armed:
            self._note_the_gap()
            self._beaten_s = awake_s() + seconds
            self._send(ALLOW + f"{seconds:.1f}".encode())

    def refuse_a_gap(self) -> None:
        """Raise StoodStill if the run did nothing for longer than `LONGEST_GAP_S` while the coil was on."""
        self._note_the_gap()
        if self._armed and self._gap_s:
            raise StoodStill(
                f"{self._ward.address}: the run stood still for {self._gap_s:.0f} s with the coil on, because the "
                "computer slept or the process was stopped; the run ends"
            )

    def _note_the_gap(self) -> None:
        gap_s = awake_s() - self._beaten_s
        if self._armed and gap_s > LONGEST_GAP_S:
            self._gap_s = max(self._gap_s, gap_s)

    def check(self) -> None:
        """Raise InstrumentError, which ends the run, if the guardian process ended, was stopped or has taken over."""
        if not self._armed:
            return
        self.refuse_a_gap()
        self._listen()
        place = self._ward.address
        if TAKING_OVER in self._said:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(TAKING_OVER_WITHIN_S)
            raise InstrumentError(
                f"{place}: the run stood still for more than {STILL_FOR_S:g} s, and its guardian process took over and "
                "switches the coil off"
            )
        if self._process.poll() is not None:
            raise InstrumentError(
                f"{place}: the guardian process ended (status {self._process.returncode}); the run ends, because it "
                "needs a guardian"
            )
        if self.silent_s() > SILENT_FOR_S:
            raise InstrumentError(
                f"{place}: the guardian process does not answer any more; the run ends, because it needs a guardian"
            )

    def silent_s(self) -> float:
        """Return the time (s) since the last report of the guardian."""
        return time.monotonic() - self._heard_s

    def disarm(self) -> None:
        """Disarm the guardian, after the coil was confirmed off. A guardian that is gone raises no error."""
        self._armed = False
        self._send(DISARM)

    def dismiss(self) -> None:
        """Close the pipes. An armed guardian now switches the coil off; this method does not wait for it."""
        if self._armed:
            resume(self._process)
            self._send(TAKE_OVER)
        else:
            self._process.kill()
            self._process.wait()
        self._to.close()
        self._from.close()

    def _listen(self) -> None:
        while readable(self._from.fileno(), 0.0) and (received := os.read(self._from.fileno(), 4096)):
            self._heard_s = time.monotonic()
            self._said = (self._said + received).replace(HERE, b"")

    def _send(self, message: bytes) -> bool:
        try:
            os.write(self._to.fileno(), message + b"\n")
        except OSError:  # the guardian is gone, or was stopped for so long that the pipe is full
            return False
        return True


@contextmanager
def guarding(ward: Ward, events: int | None = None) -> Iterator[Guardian]:
    """Start a guardian for one run. If it is still armed at the end of the context, it switches the coil off.

    events: see `Guardian`.
    """
    guardian = Guardian(ward, events)
    try:
        yield guardian
    finally:
        guardian.dismiss()
