"""Define the interfaces of power supplies, cameras and sensors, and the errors that they raise.

eimi-lab uses an instrument only through these interfaces. A supply is any object with the members of `PowerSupply`. A
camera is any object with the members of `Camera`, and a sensor is any object with the members of `Sensor`. Inheritance
is not needed. A driver is a class or a function that opens an instrument and returns the object for it. The arguments
of a driver are defined by `SupplyDriver`, `CameraDriver` and `SensorDriver`.

Each interface is a `typing.Protocol`. Its members are required. Its docstring lists the optional members, and the value
that eimi-lab assumes if an optional member is absent.

`open_supply`, `open_camera` and `open_sensor` check that the driver and the instrument have the required members, and
report all missing members in one line. `check_supply`, `check_camera` and `check_sensor` of `eimi_drivers.testing`
check the behaviour of a driver.
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
    """Report that a recording, which is played back in place of a camera, has no more frames."""


class ReplyNotUnderstood(InstrumentError):
    """Report an answer that does not have the form that the manual of the instrument describes."""


class SetPointRefused(InstrumentError):
    """Report that a requested set-point is outside the limits and was not sent to the instrument."""


class SetPointNotTaken(InstrumentError):
    """Report that a setting in the instrument differs from the setting that the driver sent."""


class ProtectionTripped(InstrumentError):
    """Report that the output is off without a command: a protection tripped, or a person switched the output off."""


class SwitchOffFailed(InstrumentError):
    """Report that the driver could not confirm that the supply is off.

    Parameters
    ----------
    message : str
        The outcome of every stage of switching off, or the current that still flows, or the reason why the instrument
        at the address may be another supply.
    current_A : float, optional
        The measured current, A. None if no current was measured.
    limit_A : float, optional
        The largest current with which the supply counts as off, A. None if no current was measured.
    """

    def __init__(self, message: str, current_A: float | None = None, limit_A: float | None = None) -> None:
        super().__init__(message)
        self.current_A = current_A
        self.limit_A = limit_A


class AnotherSupply(InstrumentError):
    """Report that the instrument at the supply's address is not the instrument that was identified there before."""


class AnotherSensor(InstrumentError):
    """Report that the instrument at the sensor's address is not the instrument that was identified there before."""


def raised(error: BaseException) -> str:
    """Return the type and the message of an error as one line of text, such as "OSError: no such device".

    The line becomes part of the message of an InstrumentError.
    """
    return " ".join(f"{type(error).__name__}: {error}".split())


class UnusableDriver(InstrumentError):
    """Report that a driver cannot be imported or lacks a member that is needed. The instrument is not at fault."""


class UnknownDriver(UnusableDriver, KeyError):
    """Report that no driver has the requested name."""

    def __str__(self) -> str:
        """Return the message without the quotation marks that `KeyError` puts around a message."""
        return str(self.args[0])


@dataclass(frozen=True)
class Identity:
    """The identity of an instrument that has answered.

    Parameters
    ----------
    driver : str
        The name of the driver.
    text : str
        The identification text that the instrument sent.
    address : str
        The address at which the instrument answered.
    serial_number : str
        The serial number that the instrument sent, or else the serial number of its USB port. Empty if neither exists:
        two instruments of the same model then cannot be distinguished.
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
        The largest permitted current, A; positive. The smallest permitted current is 0, or ``-current_A`` if the supply
        is bipolar.
    voltage_V : float
        The largest permitted voltage, V; positive.
    off_below_A : float, optional
        The largest measured current with which the supply counts as off, A. None selects the value of the supply's
        family, which `eimi_drivers.supplies.off.off_limit_A` returns.
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
        The last measured current, A, whose magnitude is at most `limit_A`.
    limit_A : float
        The largest current with which the supply counts as off, A.
    found_off : bool
        True if the connection to the supply was lost, and the output was off already when the driver had reopened the
        connection.
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
        The number that the camera gives to the frame. Missing numbers between two frames mean that frames were dropped.
    timestamp_s : float
        The camera's time stamp of the frame, s. The zero of the time is arbitrary.
    """

    image: NDArray[Any]
    number: int
    timestamp_s: float


@runtime_checkable
class PowerSupply(Protocol):
    """The interface through which eimi-lab uses a power supply, which feeds a coil with a constant current.

    Every call ends within 5 s, either with an answer or with InstrumentTimeout. Every error is an InstrumentError.

    Optional members:

    without_contact: str
        A text that describes what the output does if the cable is pulled or the computer fails. eimi-lab stores this
        text in the dataset. If this member is absent, eimi-lab stores that the behaviour is not known.
    reads_zero_within_A: float
        The largest current (A) that `measure` of a healthy supply returns when no current flows; 0 if this member is
        absent.
    measures_current: bool
        True if `measure` returns a measured current, not a set-point; True if this member is absent.
    """

    limits: Limits
    """The limits with which the supply was opened. A set-point outside the limits is never sent."""

    def identify(self) -> Identity:
        """Return the identity that the supply reports."""

    def set_voltage(self, voltage_V: float) -> None:
        """Set the compliance voltage (V) and verify the set-point.

        The compliance voltage is the largest voltage that the supply applies in order to reach the set current.

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
            The measured current and the largest current with which the supply counts as off. None if the driver does
            not measure the current in this call. eimi-lab then calls `measure`.

        Raises
        ------
        SwitchOffFailed
            The driver could not confirm that the supply is off.
        """

    def close(self) -> None:
        """Release the port, and leave the output on or off as it is. Closing twice is allowed."""


class SupplyDriver(Protocol):
    """The arguments of a supply driver, which is a class or a function that opens a supply.

    The driver sends no message when it opens a supply. An output that is on therefore stays on.

    Optional members:

    connect(address) -> Transport
        Opens the line (the serial, USB or network connection) to the supply. The driver is then called with the line
        instead of the address. With `connect`, eimi-lab can record every message (`eimi acquire --transcript`), and a
        second stop signal (Ctrl-C) takes effect between two messages. If this member is absent, the driver is called
        with the address, and no call of the supply is interrupted.
    bipolar: bool
        True if negative currents can be set; False if this member is absent.
    without_contact: str
        A text that describes what the output does if the cable is pulled or the computer fails. If this member is
        absent, eimi-lab reports that the behaviour is not known.
    channels: tuple[int, int]
        The lowest and the highest channel number that an address may have after `#`; (1, 1) if this member is absent.
    """

    def __call__(self, link: Any, limits: Limits, clock: Clock, /) -> PowerSupply:
        """Open a supply and return it. `link` is the connection that `connect` returned, or the address as text."""


@runtime_checkable
class Camera(Protocol):
    """The interface through which eimi-lab uses a camera, or an object that takes the place of a camera.

    `eimi_drivers.cameras.timed` makes all calls from one thread and sets a deadline for each call. Every error is an
    InstrumentError.

    Optional members:

    settings: CameraSettings
        The settings that were read back from the camera when it was opened. If this member is absent, the camera has no
        settings, and eimi-lab refuses to open the camera if a setting is requested.
    lost_frames: Mapping[str, int]
        For each reason, the number of frames that did not arrive completely since the camera was opened. Frames that
        `flush` discards do not count. If this member is absent, eimi-lab counts the missing frame numbers instead.
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
    """The arguments of a camera driver, which is a class or a function that opens a camera."""

    def __call__(self, source: str | int, settings: Any, /) -> Camera:
        """Open a camera, apply the `CameraSettings`, and return the camera.

        `source` identifies the camera. The driver defines its meaning, such as a device number, a serial number or the
        path of a recording.
        """


@dataclass(frozen=True)
class SensorReading:
    """One value of a sensor, with its unit and its time.

    Parameters
    ----------
    value : float
        The value in `unit`; finite.
    unit : str
        "mT" for a field, "degC" for a temperature, and for any other quantity the unit that the sensor uses.
    time_s : float
        The time at which the value arrived, s, on the clock with which the sensor was opened.
    standard_uncertainty : float or None
        The standard uncertainty of the value in `unit`, as the sensor reports it. None if the sensor reports none.
    """

    value: float
    unit: str
    time_s: float
    standard_uncertainty: float | None = None


@runtime_checkable
class Sensor(Protocol):
    """The interface through which eimi-lab uses a sensor: an instrument that measures one number.

    Examples are a gaussmeter and a thermometer.

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
    """The arguments of a sensor driver, which is a class or a function that opens a sensor.

    Optional members:

    connect(address) -> Transport
        Opens the line (the serial, USB or network connection) to the sensor. The driver is then called with the line
        instead of the address. If this member is absent, the driver is called with the address.
    """

    def __call__(self, link: Any, clock: Clock, /) -> Sensor:
        """Open a sensor and return it. `link` is the connection that `connect` returned, or the address as text."""


class Clock(Protocol):
    """A clock with which drivers measure time and wait: real time, or simulated time with simulated instruments."""

    def now(self) -> float:
        """Return the time since an arbitrary zero, s. The time never decreases."""

    def sleep(self, seconds: float) -> None:
        """Wait until the time of this clock has advanced by `seconds` (s)."""
