"""The functions of all supply drivers: limits, read-back, protections, and switching off."""

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
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
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

LINE_LOST = (InstrumentDisconnected, InstrumentTimeout)
"""Errors after which the connection may be lost, so that `SupplyBase.safe_off` reopens it."""

_Value = TypeVar("_Value")


class SupplyBase(Conversation, ABC):
    """Base class of supply drivers: keeps set-points within limits and verifies every set-point.

    A subclass defines the steps of the set-points and the methods that exchange messages with the supply.

    Parameters
    ----------
    link : Transport
        Serial, USB or network connection to the supply.
    limits : Limits
        Largest permitted set-points.
    clock : Clock
        Clock for all waits: real or simulated time.

    Raises
    ------
    InstrumentError
        The address contains a channel number that the supplies of this driver do not have.

    Attributes
    ----------
    name : str
        Name of the driver.
    current_step_A, voltage_step_V : str
        Steps of the set-points (A, V) as decimal text.
    bipolar : bool
        True if negative currents can be set.
    channels : tuple of int
        Lowest and highest channel number that may follow ``#`` in an address.
    default_channel : int
        Channel of an address without a channel number.
    read_backs : int
        Number of consecutive correct answers that verify a set-point.
    protections : str
        Description of the protections inside the supply that the driver switches on; empty if none.
    without_contact : str
        Description of what the output does if the cable is pulled or the computer fails.
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
        """Return the largest current (A) that the supply measures when no current flows; 0 if not known."""
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
        """Open the connection to the supply at this address and return it."""

    @abstractmethod
    def identify(self) -> Identity:
        """Return the identity that the supply reports.

        Raises AnotherSupply if the identity has changed since the driver was opened.
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
        """Read the error queue of the supply, and raise InstrumentError if it contains errors."""

    def _enabled(self) -> bool:
        """Return whether the output is switched on, even if the current is set to zero."""
        return self.output_on()

    def _trip(self) -> str:
        """Return the names of the tripped protections of the supply; empty if none has tripped."""
        return ""

    def _protect(self) -> None:
        """Switch on the protections inside the supply and read them back, before the output is switched on."""

    def _arm_watchdog(self) -> None:
        """Start the watchdog: a timer inside the supply that switches the output off if no message arrives."""

    def _disarm_watchdog(self) -> None:
        """Stop the watchdog after the output was switched off."""

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

        Before the output is switched on, the protections inside the supply are switched on.

        Raises
        ------
        SetPointNotTaken
            The output has not switched, or a protection has a wrong setting.
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
        """Raise an error if the supply reports a fault, or if a person has switched its output off.

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

        Every step is tried even if an earlier step fails.

        Returns
        -------
        Off
            Measured current and the largest current with which the supply counts as off.

        Raises
        ------
        SwitchOffFailed
            A step failed repeatedly, a current still flows, or the instrument at the address may be another supply.
        """
        found_off = self._unconfirmed and self._compare()
        failed = self._try_to_switch_off()
        if failed and not isinstance(failed.__cause__, LINE_LOST):  # the supply answered, so it is still the same
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
        """Reopen a lost connection, and return whether the same supply is there with its output off."""
        try:
            if not self._link.reopen() or self._bound is None:
                return False
        except InstrumentError:
            return False
        self._unconfirmed = True
        return self._compare()

    def _compare(self) -> bool:
        # Return whether the output of the supply at the reopened line is already off. Raises SwitchOffFailed if it may
        # be another supply than before.
        assert self._bound is not None
        try:
            self.identify()
            found_off = not self.output_on()
        except AnotherSupply as error:
            raise SwitchOffFailed(str(error)) from error
        except InstrumentError:
            return False
        if found_off and not self._bound.serial_number:  # the output was on before the connection was lost
            raise SwitchOffFailed(
                f"{self._link.address}: the line was lost and reopened. The supply there is off, but "
                f"{self._bound.text!r} has no serial number: it may be another supply, not the supply of the coil"
            )
        return found_off

    def _confirm_identity(self) -> None:
        """Raise SwitchOffFailed unless the supply has a serial number and is the same as before."""
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
            # This query is slow on a serial line. It therefore follows the message that switches the output off.
            ("current to zero", lambda: self._verify_current(0.0)),
            ("read back", lambda: self._verify_output(False)),
        )
        return failed_stages(stages, self._link.address)

    def close(self) -> None:
        """Release the connection without changing the output."""
        self._link.close()

    def _refuse_outside(self, quantity: str, value: float, lowest: float, limit: float, unit: str) -> None:
        if not lowest <= value <= limit:  # in this form the condition also refuses "not a number"
            raise SetPointRefused(
                f"{self._link.address}: {quantity} {value:.10g} {unit} was refused and not sent; "
                f"the {quantity} must be from {lowest:g} to {limit:g} {unit}"
            )

    def _verify_current(self, current_A: float) -> None:
        self._verify(
            "current", set_point_text(current_A, self.current_step_A), self.current_step_A, "A", self._current_set
        )

    def _verify(self, quantity: str, sent: str, step: str, unit: str, ask: Callable[[], float]) -> None:
        """Raise SetPointNotTaken if the set-point in the supply differs from `sent` by more than `step`."""
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
        # Ask until `read_backs` consecutive answers are right, and return None; after a time limit, return the answer.
        # The time limit is READ_BACK_WITHIN_S; only a wrong answer after this time is returned.
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
