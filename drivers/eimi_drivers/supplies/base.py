"""Implement the functions of all supply drivers: limits, read-back, protections, and switching off.

Switching off ends with a measurement of the current.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import ClassVar, TypeVar

from eimi_drivers.interfaces import (
    AnotherSupply,
    Clock,
    Identity,
    InstrumentError,
    Limits,
    Off,
    ProtectionTripped,
    Reading,
    SetPointNotTaken,
    SetPointRefused,
    SwitchOffFailed,
)
from eimi_drivers.supplies.address import split_address
from eimi_drivers.supplies.conversation import Conversation
from eimi_drivers.supplies.off import confirmed_off, failed_stages, off_limit_A
from eimi_drivers.supplies.protections import STAYS_ON
from eimi_drivers.supplies.transport import Transport
from eimi_drivers.supplies.values import set_point_text

READ_BACK_WITHIN_S = 0.6
"""Time (s) within which a supply must report a new set-point; some Korad firmware needs 0.45 s."""

_Value = TypeVar("_Value")


class SupplyBase(Conversation, ABC):
    """Base class of supply drivers, which keeps set-points within limits and verifies every set-point.

    The current can be set from 0 to the limit, or from minus the limit to the limit if the supply is bipolar. A
    subclass gives the steps of the set-points and implements the methods that exchange messages with the supply.
    `korad` and `genesys` are examples. Set-points are rounded toward zero to a multiple of the step. A rounded
    set-point is therefore never outside the limits.

    Parameters
    ----------
    link : Transport
        The line (the serial, USB or network connection) to the supply. The constructor sends nothing.
    limits : Limits
        The largest permitted set-points.
    clock : Clock
        The clock for all waits: real or simulated time.

    Raises
    ------
    InstrumentError
        The address contains a channel number that supplies of this family do not have.

    Attributes
    ----------
    name : str
        The name of the driver in a rig file, which lists the instruments of a set-up.
    current_step_A, voltage_step_V : str
        The steps of the set-points (A, V) as decimal text.
    bipolar : bool
        True if negative currents can be set.
    channels : tuple of int
        The lowest and the highest channel number that an address may contain after ``#``.
    default_channel : int
        The channel that is used if the address contains no channel number.
    read_backs : int
        The number of consecutive correct answers after which a set-point counts as verified.
    protections : str
        A description of the protections inside the supply that `set_output` arms (switches on) and reads back. Empty if
        the driver arms no protection.
    without_contact : str
        A text that describes what the output does if the cable is pulled or the computer fails.
    """

    current_step_A: str = "0.001"
    voltage_step_V: ClassVar[str] = "0.01"
    bipolar: ClassVar[bool] = False
    channels: ClassVar[tuple[int, int]] = (1, 1)
    default_channel: ClassVar[int] = 1
    read_backs: ClassVar[int] = 1
    protections: ClassVar[str] = ""
    without_contact: str = STAYS_ON

    @property
    def reads_zero_within_A(self) -> float:
        """Return the largest current (A) that a healthy supply of the family measures when no current flows.

        The value 0 means that this current is below `off.LEAST_OFF_A` or not known.
        """
        return 0.0

    def __init__(self, link: Transport, limits: Limits, clock: Clock) -> None:
        super().__init__(link, clock)
        self.limits = limits
        self._switched_on = False
        channel = split_address(link.address)[1]
        self._channel = self.default_channel if channel is None else channel
        first, last = self.channels
        if not first <= self._channel <= last:
            raise InstrumentError(
                f"{link.address}: there is no channel {self._channel}; {self.name} has the channels {first} to {last}"
            )

    @classmethod
    @abstractmethod
    def connect(cls, address: str) -> Transport:
        """Open the line (connection) to the supply at this address and return the line."""

    @abstractmethod
    def identify(self) -> Identity:
        """Return the identity that the supply reports.

        Raises AnotherSupply if the identity differs from the first identity since the driver was opened.
        """

    @abstractmethod
    def output_on(self) -> bool:
        """Return whether the supply reports that its output is on."""

    @abstractmethod
    def measure(self) -> Reading:
        """Return the measured output current (A) and output voltage (V)."""

    @abstractmethod
    def _send_voltage(self, text: str) -> None: ...

    @abstractmethod
    def _send_current(self, text: str) -> None: ...

    @abstractmethod
    def _send_output(self, on: bool) -> None: ...

    @abstractmethod
    def _voltage_set(self) -> float: ...

    @abstractmethod
    def _current_set(self) -> float: ...

    def _raise_reported_errors(self) -> None:
        """Read the error queue of the supply, and raise InstrumentError if the queue contains errors."""

    def _enabled(self) -> bool:
        """Return whether the output itself is switched on, even if `output_on` is False because the current is zero.

        Some supplies are switched off by a current of zero, while the output itself stays on. For all other supplies,
        the result is equal to `output_on`.
        """
        return self.output_on()

    def _trip(self) -> str:
        """Return a text that names the tripped protections of the supply; empty if no protection has tripped."""
        return ""

    def _protect(self) -> None:
        """Arm (switch on) the protections inside the supply and read them back, before the output is switched on."""

    def _arm_watchdog(self) -> None:
        """Start the watchdog before the output is switched on.

        The watchdog is a timer inside the supply that switches the output off if no message arrives in time. A driver
        of a supply without a watchdog does nothing here.
        """

    def _disarm_watchdog(self) -> None:
        """Stop the watchdog, a timer inside the supply, after the output was switched off."""

    def set_voltage(self, voltage_V: float) -> None:
        """Set the compliance voltage (V), the largest voltage of the output, and verify the set-point.

        Raises
        ------
        SetPointRefused
            The voltage is outside the limits. Nothing was sent.
        SetPointNotTaken
            The supply reports another set-point.
        """
        self._refuse_outside("voltage", voltage_V, 0.0, self.limits.voltage_V, "V")
        sent = set_point_text(voltage_V, self.voltage_step_V)
        self._send_voltage(sent)
        self._verify("voltage", sent, self.voltage_step_V, "V", self._voltage_set)

    def set_current(self, current_A: float) -> None:
        """Set the current (A) and verify the set-point.

        Raises
        ------
        SetPointRefused
            The current is outside the limits. Nothing was sent.
        SetPointNotTaken
            The supply reports another set-point.
        """
        lowest = -self.limits.current_A if self.bipolar else 0.0
        self._refuse_outside("current", current_A, lowest, self.limits.current_A, "A")
        self._send_current(set_point_text(current_A, self.current_step_A))
        self._verify_current(current_A)

    def set_output(self, on: bool) -> None:
        """Switch the output on or off, and verify that the output has switched.

        The protections and the watchdog (a timer) inside the supply are switched on before the output.

        Raises
        ------
        SetPointNotTaken
            The output has not switched, or a protection or the watchdog reads back wrong.
        """
        if on:
            self._protect()
            self._arm_watchdog()
        self._send_output(on)
        self._raise_reported_errors()
        self._verify_output(on)
        if not on:
            self._disarm_watchdog()
        self._switched_on = on

    def check(self) -> None:
        """Raise an error if the supply reports a fault, or if its output is off without a command.

        Raises
        ------
        ProtectionTripped
            A protection has tripped, or a person has switched the output off.
        InstrumentError
            The supply reports an error.
        """
        self._raise_reported_errors()
        if cause := self._trip():
            raise ProtectionTripped(f"{self._link.address}: {cause}")
        if self._switched_on and not self._enabled():
            raise ProtectionTripped(
                f"{self._link.address}: the output is off, but this run did not switch it off. The cause is a person "
                "at the front panel, or a protection that the supply does not report"
            )

    def safe_off(self) -> Off:
        """Set the current to zero, switch the output off, verify both settings, and measure until no current flows.

        The stages are: set zero, switch off, verify zero, verify that the output is off. Every stage is tried even if
        an earlier stage fails. If a stage fails, the line is reopened and all stages are tried once more. The current
        set-point of zero is verified only after the output is switched off, because the query takes long on a slow
        line.

        Returns
        -------
        Off
            The measured current and the limit, the largest current with which the supply counts as off.

        Raises
        ------
        SwitchOffFailed
            - A stage failed twice. The message lists the outcome of every stage.
            - The current is still above the limit, or cannot be measured.
            - Another supply answers on the reopened line.
            - The supply on the reopened line has no serial number and may be another supply.
        """
        found_off = self._unconfirmed and self._compare()
        failed = self._try_to_switch_off()
        if failed:
            found_off = self._reopen_and_compare()
            failed = self._try_to_switch_off()
        if failed:
            raise failed from failed.__cause__
        if self._unconfirmed:
            self._confirm_identity()
        off = confirmed_off(self.measure, off_limit_A(self), self._clock, self._link.address)
        with suppress(InstrumentError):
            self._disarm_watchdog()
        self._switched_on = False
        return replace(off, found_off=found_off)

    def _reopen_and_compare(self) -> bool:
        """Reopen the connection to the supply, and return whether its output is off already.

        After the reopening, another supply may answer at the same address. SwitchOffFailed is raised unless the supply
        is recognised as the same one. If the connection cannot be reopened, or if no supply was identified before,
        nothing is checked and the result is False.
        """
        try:
            if not self._link.reopen() or self._bound is None:
                return False
        except InstrumentError:
            return False
        self._unconfirmed = True
        return self._compare()

    def _compare(self) -> bool:
        """Check that the same supply answers on the reopened connection; return whether its output is off already.

        A name such as /dev/ttyUSB0 or a network address may meanwhile belong to another supply. Therefore the identity
        is compared with the identity before. A supply without a serial number is accepted only if its output is on, as
        it was before the connection was lost.

        Returns
        -------
        bool
            True if the output is off already; False if the output is on or the supply does not answer.

        Raises
        ------
        SwitchOffFailed
            Another supply answers, or the output is off and the supply has no serial number.
        """
        assert self._bound is not None
        try:
            self.identify()
            found_off = not self.output_on()
        except AnotherSupply as error:
            raise SwitchOffFailed(str(error)) from error
        except InstrumentError:
            return False
        if found_off and not self._bound.serial_number:
            raise SwitchOffFailed(
                f"{self._link.address}: the line was lost and reopened. The supply there is off, but "
                f"{self._bound.text!r} has no serial number: it may be another supply, not the supply of the coil"
            )
        return found_off

    def _confirm_identity(self) -> None:
        """Check that a supply that was switched off on a reopened connection is certainly the supply of the coil.

        Raises
        ------
        SwitchOffFailed
            The supply does not answer, has no serial number, or is another supply.
        """
        try:
            identity = self.identify()
        except InstrumentError as error:
            raise SwitchOffFailed(str(error)) from error
        if not identity.serial_number:
            self._unconfirmed = True
            raise SwitchOffFailed(
                f"{self._link.address}: the line was lost and reopened. {identity.text!r} was then switched off, but "
                "has no serial number: it may be another supply, not the supply of the coil"
            )

    def _try_to_switch_off(self) -> SwitchOffFailed | None:
        stages: tuple[tuple[str, Callable[[], None]], ...] = (
            ("current to zero", lambda: self._send_current(set_point_text(0.0, self.current_step_A))),
            ("output off", lambda: self._send_output(False)),
            ("current to zero", lambda: self._verify_current(0.0)),
            ("read back", lambda: self._verify_output(False)),
        )
        return failed_stages(stages, self._link.address)

    def close(self) -> None:
        """Release the connection and leave the output as it is. `safe_off` switches the output off."""
        self._link.close()

    def _refuse_outside(self, quantity: str, value: float, lowest: float, limit: float, unit: str) -> None:
        if not lowest <= value <= limit:  # in this form the condition also refuses "not a number"
            raise SetPointRefused(
                f"{self._link.address}: {quantity} {value:g} {unit} was refused and not sent; "
                f"the {quantity} must be from {lowest:g} to {limit:g} {unit}"
            )

    def _verify_current(self, current_A: float) -> None:
        self._verify(
            "current", set_point_text(current_A, self.current_step_A), self.current_step_A, "A", self._current_set
        )

    def _verify(self, quantity: str, sent: str, step: str, unit: str, ask: Callable[[], float]) -> None:
        """Compare the set-point that the supply reports with the text that was sent.

        Parameters
        ----------
        quantity : str
            "current" or "voltage", for the message.
        sent : str
            The set-point that was sent, as text.
        step : str
            The step of the set-points, as text. A difference of one step is permitted.
        unit : str
            The unit, for the message.
        ask : callable
            Asks the supply for the set-point.

        Raises
        ------
        SetPointNotTaken
            The supply reports another set-point.
        InstrumentError
            The supply reports an error.
        """
        self._raise_reported_errors()
        wrong_value = self._read_back(ask, lambda answer: abs(answer - float(sent)) <= 1.001 * float(step))
        if wrong_value is not None:
            raise SetPointNotTaken(
                f"{self._link.address}: {quantity} was set to {sent} {unit} but reads back {wrong_value:g} {unit}"
            )

    def _verify_output(self, on: bool) -> None:
        if self._read_back(self._enabled, lambda answer: answer == on) is not None:
            raise SetPointNotTaken(
                f"{self._link.address}: the output was switched {'on' if on else 'off'}, "
                f"but the supply reports that the output is {'off' if on else 'on'}"
            )

    def _read_back(self, ask: Callable[[], _Value], is_right: Callable[[_Value], bool]) -> _Value | None:
        """Ask the supply for a value until the answer is right several times in a row, or the time is over.

        The number of right answers is `read_backs`, and the time is `READ_BACK_WITHIN_S`.

        Parameters
        ----------
        ask : callable
            Sends the query and returns the answer.
        is_right : callable
            Returns whether an answer is right.

        Returns
        -------
        None or the type of the answer
            None if the answers are right, otherwise the last wrong answer.
        """
        deadline = self._clock.now() + READ_BACK_WITHIN_S
        right = 0
        while right < self.read_backs:
            if is_right(answer := ask()):
                right += 1
                continue
            if self._clock.now() >= deadline:
                return answer
            right = 0
            self._clock.sleep(0.05)
        return None
