"""Interfaces of power supplies, cameras and sensors, and the errors that they raise.

An instrument is any object with the methods and attributes of `PowerSupply`, `Camera` or `Sensor`; inheritance is not
needed. A driver is a class or a function that opens an instrument and returns this object.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray


class InstrumentError(Exception):
    """Report a fault of an instrument or of its connection."""


class InstrumentTimeout(InstrumentError):
    """Report that no complete answer arrived within the time limit."""


class InstrumentDisconnected(InstrumentError):
    """Report that the port, the socket or the device does not exist or was closed."""


class EndOfPlayback(InstrumentDisconnected):
    """Report that a recording, which replaces a camera, has no more frames."""


class ReplyNotUnderstood(InstrumentError):
    """Report an answer whose form differs from the manual of the instrument."""


class SetPointRefused(InstrumentError):
    """Report that a requested set-point is outside the limits and was not sent."""


class SetPointNotTaken(InstrumentError):
    """Report that a setting in the instrument differs from the setting that the driver sent."""


class ProtectionTripped(InstrumentError):
    """Report that a protection has tripped, or that a person has switched the output off."""


class SwitchOffFailed(InstrumentError):
    """Report that the driver could not confirm that the supply is off.

    Parameters
    ----------
    message : str
        Reason.
    current_A : float, optional
        Measured current, A; None if no current was measured.
    limit_A : float, optional
        Largest current with which the supply counts as off, A; None if no current was measured.
    """

    def __init__(self, message: str, current_A: float | None = None, limit_A: float | None = None) -> None:
        super().__init__(message)
        self.current_A = current_A
        self.limit_A = limit_A


class AnotherSupply(InstrumentError):
    """Report that another instrument than before answers at the address of the supply."""


class AnotherSensor(InstrumentError):
    """Report that another instrument than before answers at the address of the sensor."""


def raised(error: BaseException) -> str:
    """Return the type and the message of an error as one line, such as "OSError: no such device"."""
    return " ".join(f"{type(error).__name__}: {error}".split())


class UnusableDriver(InstrumentError):
    """Report that a driver cannot be imported or lacks a required member."""


class UnknownDriver(UnusableDriver, KeyError):
    """Report that no driver has the requested name."""

    def __str__(self) -> str:
        """Return the message without the quotation marks that `KeyError` adds."""
        return str(self.args[0])


@dataclass(frozen=True)
class Identity:
    """The identity of an instrument.

    Parameters
    ----------
    driver : str
        Name of the driver.
    text : str
        Identification text of the instrument.
    address : str
        Address of the instrument.
    serial_number : str
        Serial number of the instrument or of its USB port; empty if neither exists.
    """

    driver: str
    text: str
    address: str
    serial_number: str = ""


@dataclass(frozen=True)
class Limits:
    """The limits of the set-points of a supply.

    Parameters
    ----------
    current_A : float
        Largest permitted current, A; positive.
    voltage_V : float
        Largest permitted voltage, V; positive.
    off_below_A : float, optional
        Largest measured current with which the supply counts as off, A; None for the default of the driver.
    """

    current_A: float
    voltage_V: float
    off_below_A: float | None = None


@dataclass(frozen=True)
class Reading:
    """The output current (A) and the output voltage (V) that a supply measured."""

    current_A: float
    voltage_V: float


@dataclass(frozen=True)
class Off:
    """The measurement that confirms that a supply is off.

    Parameters
    ----------
    current_A : float
        Last measured current, A.
    limit_A : float
        Largest current with which the supply counts as off, A.
    found_off : bool
        True if the connection was lost, and the output was already off when the driver had reopened the connection.
    """

    current_A: float
    limit_A: float
    found_off: bool = False


@dataclass(frozen=True)
class Frame:
    """One image of a camera, with its number and its time.

    Parameters
    ----------
    image : ndarray, shape (height, width) or (height, width, 3), uint8 or uint16
        Grey values, or colours in the order blue, green, red.
    number : int
        Number of the frame; a gap between two numbers means lost frames.
    timestamp_s : float
        Time stamp of the camera, s, from an arbitrary zero.
    """

    image: NDArray[Any]
    number: int
    timestamp_s: float


@runtime_checkable
class PowerSupply(Protocol):
    """The interface of a power supply that feeds a coil with a constant current.

    Every call ends within 5 s, except `safe_off`, which tries several times and ends within 12 s if the supply does
    not answer. Every error is an InstrumentError.

    Optional members:

    without_contact: str
        Description of what the output does if the cable is pulled or the computer fails; "not known" if absent.
    reads_zero_within_A: float
        Largest current (A) that `measure` returns when no current flows; 0 if absent.
    measures_current: bool
        True if `measure` returns a measured current, not a set-point; True if absent.
    """

    limits: Limits
    """The limits with which the supply was opened. A set-point outside the limits is never sent."""

    def identify(self) -> Identity:
        """Return the identity that the supply reports."""

    def set_voltage(self, voltage_V: float) -> None:
        """Set the compliance voltage (V) and verify the set-point.

        The compliance voltage is the largest voltage of the output.

        Raises
        ------
        SetPointRefused
            The voltage is outside the limits. Nothing was sent.
        SetPointNotTaken
            The supply reports another set-point.
        """

    def set_current(self, current_A: float) -> None:
        """Set the current (A) and verify the set-point.

        Raises
        ------
        SetPointRefused
            The current is outside the limits. Nothing was sent.
        SetPointNotTaken
            The supply reports another set-point.
        """

    def set_output(self, on: bool) -> None:
        """Switch the output on or off, and verify that the output has switched."""

    def output_on(self) -> bool:
        """Return whether the supply reports that its output is on."""

    def measure(self) -> Reading:
        """Return the measured output current (A) and output voltage (V)."""

    def check(self) -> None:
        """Raise ProtectionTripped or InstrumentError if the supply reports a fault."""

    def safe_off(self) -> Off | None:
        """Set the current to zero, switch the output off, verify both settings, and measure the current.

        Every step is tried even if an earlier step fails.

        Returns
        -------
        Off or None
            Measured current and its limit; None if the driver does not measure the current in this call.

        Raises
        ------
        SwitchOffFailed
            The driver could not confirm that the supply is off.
        """

    def close(self) -> None:
        """Release the port without changing the output. Closing twice is allowed."""


class SupplyDriver(Protocol):
    """A supply driver: a class or a function that opens a supply without sending a message.

    Optional members:

    connect(address) -> Transport
        Opens the connection to the supply, with which the driver is then called. If `connect` is absent, the driver is
        called with the address.
    bipolar: bool
        True if negative currents can be set; False if absent.
    without_contact: str
        Description of what the output does if the cable is pulled or the computer fails; "not known" if absent.
    channels: tuple[int, int]
        Lowest and highest channel number that may follow `#` in an address; (1, 1) if absent.
    """

    def __call__(self, link: Any, limits: Limits, clock: Clock, /) -> PowerSupply:
        """Open a supply and return it; `link` is an open connection, or the address if the driver opens it itself."""


@runtime_checkable
class Camera(Protocol):
    """The interface of a camera. Every error is an InstrumentError.

    Optional members:

    settings: CameraSettings
        Settings of the open camera; if absent, no setting can be requested.
    lost_frames: Mapping[str, int]
        Number of lost frames for each reason; if absent, eimi-lab counts the missing frame numbers.
    """

    def identify(self) -> Identity:
        """Return the identity of the camera."""

    def flush(self) -> None:
        """Discard the frames that were exposed before this call."""

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame within `timeout_s` (s).

        Raises
        ------
        InstrumentTimeout
            No complete frame arrived in time.
        InstrumentDisconnected
            The camera was unplugged or closed, or a recording has no more frames.
        """

    def close(self) -> None:
        """Release the camera. Closing twice is allowed."""


class CameraDriver(Protocol):
    """A camera driver: a class or a function that opens a camera."""

    def __call__(self, source: str | int, settings: Any, /) -> Camera:
        """Open a camera, apply the `CameraSettings`, and return the camera.

        `source` is, for example, a device number, a serial number or the path of a recording.
        """


@dataclass(frozen=True)
class SensorReading:
    """One value of a sensor, with its unit and its time.

    Parameters
    ----------
    value : float
        Value in `unit`; finite.
    unit : str
        "mT" for a field, "degC" for a temperature, the unit of the sensor for another quantity.
    time_s : float
        Time at which the value arrived, s, on the clock of the sensor's driver.
    standard_uncertainty : float or None
        Standard uncertainty in `unit`; None if the sensor reports none.
    """

    value: float
    unit: str
    time_s: float
    standard_uncertainty: float | None = None


@runtime_checkable
class Sensor(Protocol):
    """The interface of a sensor, an instrument that measures one number, such as a gaussmeter.

    Every call ends within 4 s, or within 2 s if no instrument answers. Every error is an InstrumentError.
    No call changes a setting of the sensor.
    """

    name: str
    """The name of the driver."""

    timeout_s: float
    """The longest time that the driver waits for an answer, s."""

    def identify(self) -> Identity:
        """Return the identity that the sensor reports."""

    def read(self) -> SensorReading:
        """Return a new value of the sensor.

        Raises
        ------
        InstrumentTimeout
            No complete answer arrived within `timeout_s`.
        InstrumentDisconnected
            The connection was cut or closed.
        ReplyNotUnderstood
            The answer does not have the form that the manual of the sensor describes.
        """

    def close(self) -> None:
        """Release the port. Closing twice is allowed."""


class SensorDriver(Protocol):
    """A sensor driver: a class or a function that opens a sensor.

    Optional members:

    connect(address) -> Transport
        Opens the connection to the sensor, with which the driver is then called. If `connect` is absent, the driver is
        called with the address.
    """

    def __call__(self, link: Any, clock: Clock, /) -> Sensor:
        """Open a sensor and return it; `link` is an open connection, or the address if the driver opens it itself."""


class Clock(Protocol):
    """A clock with which drivers measure time and wait, in real or simulated seconds."""

    def now(self) -> float:
        """Return the time since an arbitrary zero, s. The time never decreases."""

    def sleep(self, seconds: float) -> None:
        """Wait until the time of this clock has advanced by `seconds` (s)."""
