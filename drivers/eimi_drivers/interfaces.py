"""Define the interfaces of power supplies, cameras and sensors, and the errors that they raise.

The suite uses an instrument only through these interfaces. A supply is any object with the members of `PowerSupply`. A
camera is any object with the members of `Camera`, and a sensor is any object with the members of `Sensor`. Inheritance
is not needed. A driver is the class of such an object, or a function that returns one; `SupplyDriver`, `CameraDriver`
and `SensorDriver` define how it is called. The members listed in a protocol are required. The protocol's docstring
lists the optional members, and the value that the suite assumes if one is absent.

`open_supply`, `open_camera` and `open_sensor` check that the driver and the instrument have these members, and report
missing ones in one line. `check_supply`, `check_camera` and `check_sensor` of `eimi_drivers.testing` check the
behaviour of a driver.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray


class InstrumentError(Exception):
    """Report a fault of an instrument or of its connection; the message contains the instrument's address."""


class InstrumentTimeout(InstrumentError):
    """Report that no complete answer arrived within the time limit."""


class InstrumentDisconnected(InstrumentError):
    """Report that the port, the socket or the device no longer exists or was closed."""


class EndOfPlayback(InstrumentDisconnected):
    """Report that a recording, which replaces a camera, has no more frames."""


class ReplyNotUnderstood(InstrumentError):
    """Report an answer that does not follow the instrument's protocol."""


class SetPointRefused(InstrumentError):
    """Report that a requested set-point is outside the limits; it was not sent."""


class SetPointNotTaken(InstrumentError):
    """Report that the set-point read back differs from the one that was sent."""


class ProtectionTripped(InstrumentError):
    """Report that over-current, over-voltage or over-temperature protection switched the output off."""


class SwitchOffFailed(InstrumentError):
    """Report that the supply could not be confirmed to be off.

    The message lists every stage of switching off with its outcome, or gives the measured current.

    Parameters
    ----------
    message : str
        The stages that failed, or the current that still flows.
    current_A, limit_A : float, optional
        The measured current (A), and the current (A) below which the supply counts as off. None if no current was
        measured.
    """

    def __init__(self, message: str, current_A: float | None = None, limit_A: float | None = None) -> None:
        super().__init__(message)
        self.current_A = current_A
        self.limit_A = limit_A


class AnotherSupply(InstrumentError):
    """Report that a different instrument answers at the supply's address after the line was reopened."""


class AnotherSensor(InstrumentError):
    """Report that a different instrument answers at the sensor's address after the line was reopened."""


def raised(error: BaseException) -> str:
    """Return the type and the words of an error on one line, for the message of an InstrumentError."""
    return " ".join(f"{type(error).__name__}: {error}".split())


class UnusableDriver(InstrumentError):
    """Report that a driver cannot be imported or lacks a required member; the instrument is not at fault."""


class UnknownDriver(UnusableDriver, KeyError):
    """Report that no driver has the requested name."""

    def __str__(self) -> str:
        """Return the message without the quotation marks that a KeyError adds."""
        return str(self.args[0])


@dataclass(frozen=True)
class Identity:
    """Identify the instrument that answered.

    Parameters
    ----------
    driver : str
        The name of the driver.
    text : str
        The identification text that the instrument sent.
    address : str
        The address at which the instrument answered.
    serial_number : str
        The serial number of the instrument or of its USB port; empty if neither has one. Without a serial number two
        instruments of the same model cannot be distinguished.
    """

    driver: str
    text: str
    address: str
    serial_number: str = ""


@dataclass(frozen=True)
class Limits:
    """Bound the set-points of a supply.

    Parameters
    ----------
    current_A : float
        The largest permitted current, A; positive. A bipolar supply may also be set to currents down to
        ``-current_A``.
    voltage_V : float
        The largest permitted voltage, V; positive.
    off_below_A : float, optional
        The supply counts as off if the measured current (A) is below this value. None selects the value of the
        supply's family, see `eimi_drivers.supplies.off.off_limit_A`.
    """

    current_A: float
    voltage_V: float
    off_below_A: float | None = None


@dataclass(frozen=True)
class Reading:
    """Hold the measured output current (A) and voltage (V)."""

    current_A: float
    voltage_V: float


@dataclass(frozen=True)
class Off:
    """Record that a supply was switched off and that its current was measured afterwards.

    Parameters
    ----------
    current_A : float
        The last measured current, A.
    limit_A : float
        The current below which the supply counts as off, A; `current_A` is below it.
    found_off : bool
        True if the line to the supply had to be reopened and the output was already off then.
    """

    current_A: float
    limit_A: float
    found_off: bool = False


@dataclass(frozen=True)
class Frame:
    """Hold one camera image.

    Parameters
    ----------
    image : ndarray, shape (height, width) or (height, width, 3), uint8 or uint16
        Grey values, or colours in the order blue, green, red.
    number : int
        The frame number that the device counts. A gap in the numbers means that frames were dropped.
    timestamp_s : float
        The device's time stamp, s. Its zero is arbitrary.
    """

    image: NDArray[Any]
    number: int
    timestamp_s: float


@runtime_checkable
class PowerSupply(Protocol):
    """Define the members of a supply that drives a coil with a set current.

    Every call ends within 5 s, either with an answer or with InstrumentTimeout. Every error is an InstrumentError.

    Optional members:

    without_contact: str
        See `SupplyDriver`. The text of the open instrument is stored with the dataset.
    reads_zero_within_A: float
        The largest current (A) that `measure` of a healthy unit returns when no current flows. Absent: 0.
    measures_current: bool
        True if `measure` returns a measured current, not a set-point. Absent: True.
    """

    limits: Limits
    """The limits with which the supply was opened; a set-point outside them is never sent."""

    def identify(self) -> Identity:
        """Ask the instrument for its identity."""

    def set_voltage(self, voltage_V: float) -> None:
        """Set the compliance voltage and read it back. Raises SetPointRefused, SetPointNotTaken."""

    def set_current(self, current_A: float) -> None:
        """Set the current and read the set-point back. Raises SetPointRefused, SetPointNotTaken."""

    def set_output(self, on: bool) -> None:
        """Switch the output and verify it."""

    def output_on(self) -> bool:
        """Ask the instrument whether its output is on."""

    def measure(self) -> Reading:
        """Measure the output."""

    def check(self) -> None:
        """Raise ProtectionTripped or InstrumentError if the instrument reports a fault."""

    def safe_off(self) -> Off | None:
        """Set zero current, switch the output off, verify both, and measure the current.

        Every step is attempted even if an earlier step fails. Raises SwitchOffFailed.

        Returns the measured current with its limit. A driver that does not measure here returns None; the suite then
        calls `measure`.
        """

    def close(self) -> None:
        """Release the port and leave the output as it is; `safe_off` switches it off. Closing twice is allowed."""


class SupplyDriver(Protocol):
    """Define how a class or a function that opens a supply is called.

    Opening a supply sends no message, so that an output that is on stays on.

    Optional members:

    connect(address) -> Transport
        Opens the line to the instrument. The driver is then called with the line instead of the address. The suite can
        record every message (`eimi acquire --transcript`), and a second stop signal (Ctrl-C) takes effect between two
        messages. Absent: the driver is called with the address, and no call of the supply is ever interrupted.
    bipolar: bool
        True if negative currents can be set. Absent: False.
    without_contact: str
        A text that describes what the output does if the cable is pulled or the computer fails. Absent: not known.
    channels: tuple[int, int]
        The lowest and the highest channel number that an address may have after `#`. Absent: (1, 1).
    """

    def __call__(self, link: Any, limits: Limits, clock: Clock, /) -> PowerSupply:
        """Open the supply at `link`: the line that `connect` returned, or the address as text."""


@runtime_checkable
class Camera(Protocol):
    """Define the members of a camera, or of an object that replaces one.

    `eimi_drivers.cameras.timed` makes all calls from one thread and sets a deadline for each call. Every error is an
    InstrumentError.

    Optional members:

    settings: CameraSettings
        The settings that the camera read back when it was opened. Absent: the camera has no settings, and the suite
        refuses to open it with one.
    lost_frames: Mapping[str, int]
        How many of the frames that were exposed for a `grab` did not arrive completely since the camera was opened, by
        the reason. Absent: not known; gaps in the numbers of the frames count them.
    """

    def identify(self) -> Identity:
        """Ask the camera for its identity."""

    def flush(self) -> None:
        """Discard the frames that were exposed before this call."""

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame. Raises InstrumentTimeout, InstrumentDisconnected."""

    def close(self) -> None:
        """Release the device. Closing twice is allowed."""


class CameraDriver(Protocol):
    """Define how a class or a function that opens a camera and applies its settings is called."""

    def __call__(self, source: str | int, settings: Any, /) -> Camera:
        """Open the camera at `source` (device number or path, as in the rig file) and apply the `CameraSettings`."""


@dataclass(frozen=True)
class SensorReading:
    """Hold one value of a sensor.

    Parameters
    ----------
    value : float
        The value, in `unit`; finite.
    unit : str
        The unit: "mT" for a field, "degC" for a temperature, and otherwise the sensor's own.
    time_s : float
        The time at which the value came, s on the clock with which the sensor was opened.
    standard_uncertainty : float or None
        The standard uncertainty of the value in `unit`, as the sensor states it; None if it states none.
    """

    value: float
    unit: str
    time_s: float
    standard_uncertainty: float | None = None


@runtime_checkable
class Sensor(Protocol):
    """Define the members of a sensor: a gaussmeter, a thermometer, or another source of one number.

    Every call ends within 4 s, and within 2 s on a line on which nothing answers. Every error is an InstrumentError. No
    call changes a setting of the instrument.
    """

    name: str
    """The name of the driver."""

    timeout_s: float
    """The longest time until an answer, s."""

    def identify(self) -> Identity:
        """Ask the instrument for its identity."""

    def read(self) -> SensorReading:
        """Ask for a new value. Raises InstrumentTimeout, InstrumentDisconnected, ReplyNotUnderstood."""

    def close(self) -> None:
        """Release the port. Closing twice is allowed."""


class SensorDriver(Protocol):
    """Define how a class or a function that opens a sensor is called.

    Optional members:

    connect(address) -> Transport
        Opens the line to the instrument. The driver is then called with the line instead of the address. Absent: the
        driver is called with the address.
    """

    def __call__(self, link: Any, clock: Clock, /) -> Sensor:
        """Open the sensor at `link`: the line that `connect` returned, or the address as text."""


class Clock(Protocol):
    """Define the clock of a rig: real time on a bench, simulated time on the virtual rig."""

    def now(self) -> float:
        """Return the seconds since an arbitrary zero; the value never decreases."""

    def sleep(self, seconds: float) -> None:
        """Wait for this number of seconds of the clock's time."""
