"""What a power supply and a camera are to the suite, and the errors that they raise.

A driver is any class with these methods; nothing has to be inherited.
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
    """At least one stage of switching off failed; the message lists every stage and its outcome."""


@dataclass(frozen=True)
class Identity:
    """Who answered: driver name, the instrument's own identification text, its address."""

    driver: str
    text: str
    address: str


@dataclass(frozen=True)
class Limits:
    """The largest current (A) and voltage (V) that may ever be asked for. Both positive.

    A bipolar supply may be asked for the same current the other way.
    """

    current_A: float
    voltage_V: float


@dataclass(frozen=True)
class Reading:
    """Measured output current (A) and voltage (V)."""

    current_A: float
    voltage_V: float


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
    """A current source for a coil."""

    limits: Limits

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

    def safe_off(self) -> None:
        """Program zero, switch off, verify; each is tried even when another fails. Raises SwitchOffFailed."""

    def close(self) -> None:
        """Release the port. Does not switch off: safe_off does."""


@runtime_checkable
class Camera(Protocol):
    """A camera, or whatever plays one."""

    def identify(self) -> Identity:
        """Ask the camera who it is."""

    def flush(self) -> None:
        """Throw away frames that were exposed before this call."""

    def grab(self, timeout_s: float) -> Frame:
        """The next frame. Raises InstrumentTimeout, InstrumentDisconnected."""

    def close(self) -> None:
        """Release the device."""


class Clock(Protocol):
    """Time as the rig sees it: the wall clock on a bench, simulated seconds on the virtual rig."""

    def now(self) -> float:
        """Seconds since an arbitrary zero; never goes back."""

    def sleep(self, seconds: float) -> None:
        """Let that much time pass."""
