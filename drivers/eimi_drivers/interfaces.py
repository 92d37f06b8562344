"""What a power supply and a camera are to the suite, and the errors that they raise.

This is all that the suite uses of an instrument. A supply is any object with the members of `PowerSupply`, a camera
any object with those of `Camera`; nothing has to be inherited. A driver is the class of such an object, or a function
that returns one; `SupplyDriver` and `CameraDriver` say how it is called. The members are required. Each docstring then
names the optional members, and what the suite assumes where one is absent.

`open_supply` and `open_camera` check driver and instrument, and name in one line what is missing. The functions
`check_supply` and `check_camera` of `eimi_drivers.testing` check how they behave.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray


class InstrumentError(Exception):
    """Anything that an instrument or its connection did wrong; the message names the instrument's address."""


class InstrumentTimeout(InstrumentError):
    """No complete answer within the time allowed."""


class InstrumentDisconnected(InstrumentError):
    """The port, the socket or the device is gone."""


class EndOfPlayback(InstrumentDisconnected):
    """A recording that plays the camera has no more frames."""


class ReplyNotUnderstood(InstrumentError):
    """The instrument answered, but not in its own language."""


class SetPointRefused(InstrumentError):
    """A set-point outside the limits was asked for; nothing was sent."""


class SetPointNotTaken(InstrumentError):
    """The set-point read back differs from the one that was sent."""


class ProtectionTripped(InstrumentError):
    """Over-current, over-voltage or over-temperature protection switched the output off."""


class SwitchOffFailed(InstrumentError):
    """The supply is not known to be off; the message lists every stage with its outcome, or the measured current.

    Parameters
    ----------
    message : str
        What failed.
    current_A, limit_A : float, optional
        The measured current, and the limit below which the supply counts as off; None if nothing was measured.
    """

    def __init__(self, message: str, current_A: float | None = None, limit_A: float | None = None) -> None:
        super().__init__(message)
        self.current_A = current_A
        self.limit_A = limit_A


class AnotherSupply(InstrumentError):
    """After the line was opened anew another instrument answers at the address of the coil's supply."""


def raised(error: BaseException) -> str:
    """Return the type and the words of an error on one line, for the message of an InstrumentError."""
    return " ".join(f"{type(error).__name__}: {error}".split())


class UnusableDriver(InstrumentError):
    """A driver cannot be imported, or does not have what this module asks for; no instrument is at fault."""


class UnknownDriver(UnusableDriver, KeyError):
    """There is no driver of that name."""

    def __str__(self) -> str:
        """Return the message as it is; a KeyError shows its representation."""
        return str(self.args[0])


@dataclass(frozen=True)
class Identity:
    """Who answered: driver name, the instrument's own identification text, its address.

    serial_number: of the instrument, or of its USB port; empty if neither has one. Only with it is the identity unique.
    """

    driver: str
    text: str
    address: str
    serial_number: str = ""


@dataclass(frozen=True)
class Limits:
    """The largest current (A) and voltage (V) that may ever be asked for. Both positive.

    A bipolar supply may be asked for the same current the other way. off_below_A: the measured current (A) below which
    the supply counts as off; None takes the limit of its family, see `eimi_drivers.supplies.off.off_limit_A`.
    """

    current_A: float
    voltage_V: float
    off_below_A: float | None = None


@dataclass(frozen=True)
class Reading:
    """Measured output current (A) and voltage (V)."""

    current_A: float
    voltage_V: float


@dataclass(frozen=True)
class Off:
    """A supply that was switched off and measured.

    current_A: the current measured last. limit_A: the limit that it is below. found_off: whether the output was already
    off when the line to the supply had been opened anew.
    """

    current_A: float
    limit_A: float
    found_off: bool = False


@dataclass(frozen=True)
class Frame:
    """One camera image.

    image: (height, width) uint8 or uint16, or (height, width, 3) in blue, green, red order.
    number: the device's own running frame number (gaps mean dropped frames).
    timestamp_s: the device's time stamp, seconds; the zero is the device's own.
    """

    image: NDArray[Any]
    number: int
    timestamp_s: float


@runtime_checkable
class PowerSupply(Protocol):
    """A current source for a coil.

    Every call ends within 5 s: with an answer, or with InstrumentTimeout. Every error is an InstrumentError.

    Optional members:

    without_contact: str
        See `SupplyDriver`; the one of the instrument is stored with the dataset.
    reads_zero_within_A: float
        The largest current (A) that `measure` of a healthy unit gives when no current flows. Absent: 0.
    measures_current: bool
        Whether `measure` gives a measured current. Absent: True.
    """

    limits: Limits
    """Those that the supply was opened with; no set-point outside of them is sent."""

    def identify(self) -> Identity:
        """Ask the instrument who it is."""

    def set_voltage(self, voltage_V: float) -> None:
        """Set the compliance voltage and read it back. Raises SetPointRefused, SetPointNotTaken."""

    def set_current(self, current_A: float) -> None:
        """Set the current and read the set-point back. Raises SetPointRefused, SetPointNotTaken."""

    def set_output(self, on: bool) -> None:
        """Switch the output and verify it."""

    def output_on(self) -> bool:
        """Whether the output is on, as the instrument says."""

    def measure(self) -> Reading:
        """Measure the output."""

    def check(self) -> None:
        """Raise ProtectionTripped or InstrumentError when the instrument reports a fault."""

    def safe_off(self) -> Off | None:
        """Program zero, switch off, verify, measure; each is tried even when another fails. Raises SwitchOffFailed.

        Returns what was measured. A driver that does not measure here returns None: the suite then calls `measure`.
        """

    def close(self) -> None:
        """Release the port. Does not switch off: safe_off does. Closing twice is allowed."""


class SupplyDriver(Protocol):
    """A class or a function that opens a supply. Opening sends nothing: an output that is on stays on.

    Optional members:

    connect(address) -> Transport
        Opens the line to the instrument; the driver is then called with the line in place of the address, every
        exchange can be recorded (`eimi acquire --transcript`), and a second signal is heeded between two messages.
        Absent: the driver is called with the address, and no call of the supply is ever interrupted.
    bipolar: bool
        Whether negative currents can be set. Absent: False.
    without_contact: str
        What becomes of the output when the cable is pulled or the computer dies, in words. Absent: not known.
    channels: tuple[int, int]
        The first and the last channel that an address may name after `#`. Absent: (1, 1).
    """

    def __call__(self, link: Any, limits: Limits, clock: Clock, /) -> PowerSupply:
        """Open the supply at `link`: what `connect` returned, or the address, a text."""


@runtime_checkable
class Camera(Protocol):
    """A camera, or whatever plays one.

    `eimi_drivers.cameras.timed` calls it from one thread and gives every call a deadline. Every error is an
    InstrumentError.

    Optional member: `settings`, the `CameraSettings` that the camera read back when it was opened. Absent: nothing can
    be set, and opening such a camera with a setting is refused.
    """

    def identify(self) -> Identity:
        """Ask the camera who it is."""

    def flush(self) -> None:
        """Throw away frames that were exposed before this call."""

    def grab(self, timeout_s: float) -> Frame:
        """The next frame. Raises InstrumentTimeout, InstrumentDisconnected."""

    def close(self) -> None:
        """Release the device. Closing twice is allowed."""


class CameraDriver(Protocol):
    """A class or a function that opens a camera and sets it up."""

    def __call__(self, source: str | int, settings: Any, /) -> Camera:
        """Open the camera at `source`, a device's number or a path as the rig file has it, and set `CameraSettings`."""


class Clock(Protocol):
    """Time as the rig sees it: the wall clock on a bench, simulated seconds on the virtual rig."""

    def now(self) -> float:
        """Seconds since an arbitrary zero; never goes back."""

    def sleep(self, seconds: float) -> None:
        """Let that much time pass."""
