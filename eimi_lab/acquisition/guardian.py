"""A process that switches the coil off when the run dies in a way that no program can handle, as of SIGKILL.

It holds the reading end of a pipe whose writing end only the run has: that end closes with the run, however the run
ends. Until then the guardian touches no port. What it needs it has imported before it says that it is ready, and the
run switches the output on only after that.
"""

from __future__ import annotations

import json
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from eimi_drivers.interfaces import InstrumentError, Limits, PowerSupply
from eimi_drivers.supplies.opening import open_supply

READY_WITHIN_S = 30.0
TRY_FOR_S = 60.0  # a port may be busy for a moment after its owner died, or a cable may be put back
TRY_AGAIN_AFTER_S = 0.1
ARM, DISARM = b"on\n", b"off\n"


@dataclass(frozen=True)
class Ward:
    """The supply to switch off: driver, address and limits, as the rig has them."""

    driver: str
    address: str
    current_A: float
    voltage_V: float

    def open(self) -> PowerSupply:
        """Open it. Raises InstrumentError."""
        return open_supply(self.driver, self.address, Limits(self.current_A, self.voltage_V))


class Guardian:
    """The run's side: a process that is armed while the output may be on. See `guarding`."""

    def __init__(self, ward: Ward) -> None:
        """Start the process; it gets ready while the run goes on. A session of its own keeps Ctrl-C away from it."""
        self._ward = ward
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, json.dumps(asdict(ward))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,
        )
        self._ready = self._armed = False

    def arm(self) -> None:
        """From here on the end of the run switches the coil off. Raises InstrumentError when nobody is on guard."""
        assert self._process.stdout is not None
        if not self._ready:
            said, _, _ = select.select([self._process.stdout], [], [], READY_WITHIN_S)
            self._ready = bool(said) and self._process.stdout.readline() == b"ready\n"
        if not self._ready:
            raise InstrumentError(f"{self._ward.address}: the guardian process did not start; nothing was switched on")
        self._armed = True
        self._send(ARM)

    def check(self) -> None:
        """Raise InstrumentError when the guardian is gone: nobody would switch off if the run died."""
        if self._process.poll() is not None:
            raise InstrumentError(
                f"{self._ward.address}: the guardian process ended (status {self._process.returncode}); "
                "a run goes on only under guard"
            )

    def disarm(self) -> None:
        """The coil is known to be off; one whose guardian is gone needs none any more."""
        self._armed = False
        with suppress(InstrumentError):
            self._send(DISARM)

    def dismiss(self) -> None:
        """Close the pipe. One that is armed still sets to work now, and is not waited for."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        if not self._armed:
            self._process.kill()
            self._process.wait()
        self._process.stdin.close()
        self._process.stdout.close()

    def _send(self, message: bytes) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(message)
        except BrokenPipeError as error:
            raise InstrumentError(f"{self._ward.address}: the guardian process is gone") from error


@contextmanager
def guarding(ward: Ward) -> Iterator[Guardian]:
    """A guardian for one run. One that was armed and not disarmed switches off when the context is left."""
    guardian = Guardian(ward)
    try:
        yield guardian
    finally:
        guardian.dismiss()


def stand_guard(ward: Ward) -> None:
    """Wait for the end of standard input, and switch off if the last word before it was to arm."""
    for name in ("SIGINT", "SIGHUP", "SIGTERM"):  # it ends when the run does, no sooner
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    sys.stdout.buffer.write(b"ready\n")
    sys.stdout.buffer.flush()
    last = b""
    for line in sys.stdin.buffer:
        last = line
    if last == ARM:
        _tell(switch_off(ward))


def switch_off(ward: Ward) -> str:
    """Ramp down, zero, off, verify, again and again until the supply says that it is off; what came of it, in words.

    A cable may be put back; a pseudo-terminal that is gone is not, and its name goes to the next one.
    """
    began = time.monotonic()
    said = ""
    while True:
        try:
            with closing(ward.open()) as supply:
                if (words := _ramp_down(supply)) and words != said:
                    said = words
                    _tell(said)
                supply.safe_off()
            return f"the run died; {ward.address}: the coil was switched off"
        except InstrumentError as error:
            emulated = re.search(r"/dev/pts/\d+", ward.address)
            if emulated and not Path(emulated[0]).exists():
                return f"the run died; {ward.address} is gone, and the emulated supply with it"
            if time.monotonic() - began > TRY_FOR_S:
                return f"the run died; THE COIL MAY STILL BE ON, switch it off by hand: {error}"
            time.sleep(TRY_AGAIN_AFTER_S)


def _ramp_down(supply: PowerSupply) -> str:
    """Half way toward zero; what went wrong, in words, for the stages that follow matter more.

    The beam's swing no longer matters and time does: the supply is spared half the leap.
    """
    try:
        supply.set_current(supply.measure().current_A / 2)
    except InstrumentError as error:
        return f"no ramp, straight to zero: {error}"
    return ""


def _tell(words: str) -> None:
    with suppress(OSError):  # the terminal may be gone with the run
        print(f"eimi guardian: {words}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    stand_guard(Ward(**json.loads(sys.argv[1])))
