"""Start the guardian process, and exchange messages with it during a run.

The guardian process switches the coil off if the run dies or stands still. Over one pipe, the run reports that it is
alive (a beat); over a second pipe, the guardian reports that it is alive.
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
"""Time (s) without a message from the run after which the guardian process switches the coil off."""

SILENT_FOR_S = 1.5
"""Time (s) without a message from the guardian process after which the run ends. The messages come four times as often.
"""

BEAT_EVERY_S = 0.1
LONGEST_GAP_S = 10.0
"""Longest time (s) between two messages of the run to its guardian process. After a longer gap the run ends, because
its process was stopped or the computer slept.
"""
TAKING_OVER_WITHIN_S = 10.0

READY, HERE, TAKING_OVER = b"ready\n", b".\n", b"taking over\n"  # messages of the guardian
ARM, BEAT, DISARM, TAKE_OVER, ALLOW, SUPPLY = b"on", b".", b"off", b"take over", b"allow ", b"supply "
RECOGNISED = b"recognised"  # the constants from ARM on are messages of the run


class StoodStill(InstrumentError):
    """Report that the coil carries a current, but the run has made no progress within the time limit."""


@dataclass(frozen=True)
class Ward:
    """The supply that the guardian process switches off if the run dies.

    Attributes
    ----------
    driver, address : str
        Driver and address in the rig file.
    current_A, voltage_V : float
        Limits in the rig file, A and V.
    off_below_A : float or None
        Largest current that counts as off, A; None for the default.
    packed : str
        Class of a driver that the user's own program defines, pickled and written as text; empty for other drivers.
    identity : tuple or None
        Identification text and serial number of the run's supply; None until they are known.
    recognised : bool
        Whether the run measured a current of the supply, which shows that it is the supply of the coil.
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
        """The limits for the driver: largest current, largest voltage, and the largest current that counts as off."""
        return Limits(self.current_A, self.voltage_V, self.off_below_A)


class Guardian:
    """The connection of a run to its guardian process, which switches the coil off if the run dies.

    The constructor starts the process and does not wait for it. `guarding` creates and closes the connection.

    Parameters
    ----------
    ward : Ward
        The supply to switch off.
    events : int or None
        File descriptor for the events of the guardian as lines of JSON; None writes no events.
    """

    def __init__(self, ward: Ward, events: int | None = None) -> None:
        self._ward = ward
        inherited = [] if events is None else [os.dup(events)]  # a copy, because descriptor 1 is the pipe to the run
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
        """Arm the guardian process: if the run ends before `disarm`, the guardian switches the coil off.

        Raises InstrumentError if the guardian process did not start.
        """
        until = time.monotonic() + READY_WITHIN_S
        while READY not in self._said and self._process.poll() is None and time.monotonic() < until:
            readable(self._from.fileno(), 0.2)
            self._listen()
        if READY not in self._said or not self._send(ARM):
            raise InstrumentError(
                f"{self._ward.address}: the guardian process, which switches the coil off if the run dies, did not "
                "start; nothing was switched on"
            )
        self._armed = True
        self._heard_s = time.monotonic()
        self._beaten_s, self._gap_s = awake_s(), 0.0

    def expect(self, identity: Identity) -> None:
        """Tell the guardian process which supply it must switch off if the run fails."""
        # The guardian process does not switch off a supply with another identity.
        self._send(SUPPLY + json.dumps([identity.text, identity.serial_number]).encode())

    def recognise(self) -> None:
        """Tell the guardian process that this supply drives the coil, because the run measured a current in it."""
        self._send(RECOGNISED)

    def beat(self) -> None:
        """Tell the guardian process that the run is alive. Never waits and raises no error.

        Without this message for some seconds, the guardian process switches the coil off.
        """
        if self._armed and awake_s() - self._beaten_s > BEAT_EVERY_S:
            self._note_the_gap()
            self._beaten_s = awake_s()
            self._send(BEAT)

    def allow(self, seconds: float) -> None:
        """Tell the guardian process that the run may be silent for `seconds` (s). Never waits and raises no error."""
        if self._armed:
            self._note_the_gap()
            self._beaten_s = awake_s() + seconds
            self._send(ALLOW + f"{seconds:.1f}".encode())

    def refuse_a_gap(self) -> None:
        """Raise StoodStill if the run took no step for too long while the coil was on."""
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
        """Raise InstrumentError if the guardian process ended, does not answer or has begun to switch the coil off.

        Raise StoodStill if the run took no step for too long.
        """
        if not self._armed:
            return
        self.refuse_a_gap()
        self._listen()
        place = self._ward.address
        if TAKING_OVER in self._said:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(TAKING_OVER_WITHIN_S)
            raise InstrumentError(
                f"{place}: the run stood still for more than {STILL_FOR_S:g} s; its guardian process took over and "
                "switches the coil off"
            )
        if self._process.poll() is not None:
            raise InstrumentError(
                f"{place}: the guardian process, which switches the coil off if the run dies, ended (status "
                f"{self._process.returncode}); the run ends, because it needs this process"
            )
        if self.silent_s() > SILENT_FOR_S:
            raise InstrumentError(
                f"{place}: the guardian process, which switches the coil off if the run dies, does not answer any "
                "more; the run ends, because it needs this process"
            )

    def silent_s(self) -> float:
        """Return the time (s) since the guardian process last reported that it is alive."""
        return time.monotonic() - self._heard_s

    def disarm(self) -> None:
        """Tell the guardian process that the coil is off. No error is raised if the process is gone."""
        self._armed = False
        self._send(DISARM)

    def dismiss(self) -> None:
        """Close the pipes to the guardian process, without waiting for its end.

        An armed guardian switches the coil off; a guardian that is not armed ends.
        """
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
    """Start a guardian process, which switches the coil off if the run dies, and yield the connection to it.

    At the end of the context, a guardian that is armed switches the coil off.

    Parameters
    ----------
    ward : Ward
        The supply of the coil.
    events : int or None
        File descriptor for the events of the guardian as lines of JSON; None writes no events.
    """
    guardian = Guardian(ward, events)
    try:
        yield guardian
    finally:
        guardian.dismiss()
