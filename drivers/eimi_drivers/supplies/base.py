"""Implement what all supply drivers share: limits, read-back, protection, and switching off with a measurement."""

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
    Limits,
    Off,
    ProtectionTripped,
    Reading,
    ReplyNotUnderstood,
    SetPointNotTaken,
    SetPointRefused,
    SwitchOffFailed,
)
from eimi_drivers.supplies.identity import in_words, serial_number_in
from eimi_drivers.supplies.off import measured_off, off_limit_A
from eimi_drivers.supplies.transport import Transport, split_address, usb_serial_number
from eimi_drivers.supplies.values import line_in, number_in, set_point_text

REPLY_TIMEOUT_S = 1.0
READ_BACK_WITHIN_S = 0.6
"""Time (s) within which a new set-point must read back; some Korad firmware needs 0.45 s."""

LATE_ANSWER_S = 1.0
"""Time (s) after an unanswered query in which no other query is sent; a late answer to the first query is discarded."""

PROTECTION_MARGIN = 1.1
"""Ratio of the level of the instrument's own protection to the limit. The protection is for a failed regulator."""

MEASURING_ATTEMPTS = 2
"""Number of attempts to measure the current after the output was switched off."""

STAYS_ON = "nothing switches the output off, it stays as it was set"
"""The text of `without_contact` for a supply without a watchdog."""


def armed_in_words(protections: str) -> str:
    """Return the end of `without_contact` that names the armed protections; empty if there are none."""
    return f"; armed in the supply: {protections}" if protections else ""


_Value = TypeVar("_Value")


class SupplyBase(ABC):
    """Drive a supply within limits, read every set-point back, and switch off in stages.

    The current may be set from 0 to the limit, and from minus the limit if the supply is bipolar. A driver names its
    steps and implements the methods that send set-points and ask for values; `korad` and `genesys` are examples.
    Set-points are rounded toward zero to the step, so that rounding never exceeds the limit.

    Parameters
    ----------
    link : Transport
        The line to the instrument. Nothing is sent when the supply is opened.
    limits : Limits
        The largest permitted set-points.
    clock : Clock
        The clock of the rig.

    Raises
    ------
    InstrumentError
        The address names a channel that the family does not have.

    Attributes
    ----------
    name : str
        The name in a rig file.
    current_step_A, voltage_step_V : str
        The steps of the set-points as decimal text.
    bipolar : bool
        True if negative currents can be set.
    channels : tuple of int
        The lowest and the highest channel that an address may name after ``#``.
    default_channel : int
        The channel that is used if the address names none.
    read_backs : int
        The number of consecutive correct answers after which a read-back is accepted.
    protections : str
        The limits inside the supply that `set_output` arms and reads back, in words; empty if there are none.
    without_contact : str
        What the output does if the cable is pulled or the computer fails, in words.
    """

    name: ClassVar[str]
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
        """Return the largest current (A) that a healthy unit of the family shows when no current flows.

        The value 0 means that this current is below `off.LEAST_OFF_A`, or that it is not known.
        """
        return 0.0

    def __init__(self, link: Transport, limits: Limits, clock: Clock) -> None:
        self.limits = limits
        self._link = link
        self._clock = clock
        self._switched_on = False
        self._unanswered = False
        self._late_until_s = 0.0
        self._bound: Identity | None = None
        self._unconfirmed = False  # the line was reopened and the instrument was not identified since
        channel = split_address(link.address)[1]
        self._channel = self.default_channel if channel is None else channel
        first, last = self.channels
        if not first <= self._channel <= last:
            raise InstrumentError(
                f"{link.address}: there is no channel {self._channel}; {self.name} has {first} to {last}"
            )

    @classmethod
    @abstractmethod
    def connect(cls, address: str) -> Transport:
        """Open the line to the instrument at this address."""

    @abstractmethod
    def identify(self) -> Identity:
        """Ask the instrument for its identity. Raises AnotherSupply if the identity has changed."""

    @abstractmethod
    def output_on(self) -> bool:
        """Ask the instrument whether its output is on."""

    @abstractmethod
    def measure(self) -> Reading:
        """Measure the output current and voltage."""

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

    def _raise_reported_errors(self) -> None:  # noqa: B027  an instrument without an error queue has none
        """Raise InstrumentError with the errors in the instrument's error queue."""

    def _enabled(self) -> bool:
        """Return whether the output is switched on. It differs from `output_on` if a current of zero counts as off."""
        return self.output_on()

    def _trip(self) -> str:
        """Return the protection that the instrument reports as tripped, in words; empty if there is none."""
        return ""

    def _protect(self) -> None:  # noqa: B027  not every instrument has protections to set
        """Set the instrument's own protections and read them back; called before the output is switched on."""

    def _arm_watchdog(self) -> None:  # noqa: B027  few instruments have one
        """Start the instrument's own watchdog; called before the output is switched on."""

    def _disarm_watchdog(self) -> None:  # noqa: B027
        """Stop the instrument's own watchdog; called after the output was switched off."""

    def set_voltage(self, voltage_V: float) -> None:
        """Set the compliance voltage and read it back. Raises SetPointRefused, SetPointNotTaken."""
        self._refuse_outside("voltage", voltage_V, 0.0, self.limits.voltage_V, "V")
        sent = set_point_text(voltage_V, self.voltage_step_V)
        self._send_voltage(sent)
        self._verify("voltage", sent, self.voltage_step_V, "V", self._voltage_set)

    def set_current(self, current_A: float) -> None:
        """Set the current and read the set-point back. Raises SetPointRefused, SetPointNotTaken."""
        lowest = -self.limits.current_A if self.bipolar else 0.0
        self._refuse_outside("current", current_A, lowest, self.limits.current_A, "A")
        self._send_current(set_point_text(current_A, self.current_step_A))
        self._verify_current(current_A)

    def set_output(self, on: bool) -> None:
        """Switch the output and verify it; arm the protections before it is switched on. Raises SetPointNotTaken."""
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
        """Raise InstrumentError for reported errors, ProtectionTripped if a protection or a person switched off."""
        self._raise_reported_errors()
        if cause := self._trip():
            raise ProtectionTripped(f"{self._link.address}: {cause}")
        if self._switched_on and not self._enabled():
            raise ProtectionTripped(
                f"{self._link.address}: the output is off and this run did not switch it off: a protection that it "
                "does not report, or a person at its front panel"
            )

    def safe_off(self) -> Off:
        """Set zero current, switch off, read both back, and measure until no current flows.

        Every stage is tried even if an earlier one fails. The output is switched off before zero is read back, because
        on a slow line this query takes longer than all other messages. If a stage fails, the line is reopened and all
        stages are tried once more.

        Returns
        -------
        Off
            The measured current and the limit below which it lies, see `eimi_drivers.supplies.off`.

        Raises
        ------
        SwitchOffFailed
            A stage failed twice; the message lists the outcome of every stage. Or a current above the limit still
            flows. Or another supply answers on the reopened line. Or a supply without a serial number is off already
            when the line is reopened.
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
        off = self._measured_off(found_off)
        with suppress(InstrumentError):
            self._disarm_watchdog()
        self._switched_on = False
        return off

    def _reopen_and_compare(self) -> bool:
        """Reopen the line and compare the supply, see `_compare`.

        A line that cannot be reopened leads to the same supply.
        """
        try:
            if not self._link.reopen() or self._bound is None:
                return False
        except InstrumentError:
            return False
        self._unconfirmed = True
        return self._compare()

    def _compare(self) -> bool:
        """Identify the supply and return whether its output is off already; False if it does not answer.

        A name such as /dev/ttyUSB0 or a network address may meanwhile belong to another supply. Raises SwitchOffFailed
        if another supply answers, or may have answered.
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
                f"{self._link.address}: after the line was lost and opened anew the supply there is off, but "
                f"{self._bound.text!r} has no serial number: it may be another supply than the coil's"
            )
        return found_off

    def _confirm_identity(self) -> None:
        """Identify the supply that was switched off on a reopened line. Raises SwitchOffFailed if in doubt."""
        try:
            identity = self.identify()
        except InstrumentError as error:
            raise SwitchOffFailed(str(error)) from error
        if not identity.serial_number:
            self._unconfirmed = True
            raise SwitchOffFailed(
                f"{self._link.address}: after the line was lost and opened anew {identity.text!r} was switched off, "
                "but it has no serial number: it may be another supply than the coil's"
            )

    def _measured_off(self, found_off: bool) -> Off:
        for _ in range(MEASURING_ATTEMPTS):
            try:
                off = measured_off(self.measure, off_limit_A(self), self._clock, self._link.address)
                return replace(off, found_off=found_off)
            except SwitchOffFailed:
                raise
            except Exception as error:  # a fault of a driver must not end the attempts
                failed = error
        raise SwitchOffFailed(
            f"{self._link.address}: zero: done; off: done; verify: done; measure: failed ({type(failed).__name__}: "
            f"{failed})"
        ) from failed

    def _try_to_switch_off(self) -> SwitchOffFailed | None:
        stages: tuple[tuple[str, Callable[[], None]], ...] = (
            ("zero", lambda: self._send_current(set_point_text(0.0, self.current_step_A))),
            ("off", lambda: self._send_output(False)),
            ("zero", lambda: self._verify_current(0.0)),
            ("verify", lambda: self._verify_output(False)),
        )
        outcomes: dict[str, str] = {}
        first: Exception | None = None
        for stage, act in stages:
            if outcomes.get(stage, "done") != "done":
                continue
            try:
                act()
                outcomes[stage] = "done"
            except Exception as error:  # a fault of a driver must not prevent the later stages
                outcomes[stage] = f"failed ({type(error).__name__}: {error})"
                first = first or error
        if first is None:
            return None
        listed = "; ".join(f"{stage}: {outcome}" for stage, outcome in outcomes.items())
        failed = SwitchOffFailed(f"{self._link.address}: {listed}")
        failed.__cause__ = first
        return failed

    def close(self) -> None:
        """Release the line and leave the output as it is; `safe_off` switches it off."""
        self._link.close()

    def _question(self, message: bytes, size: int, end: bytes = b"", pause_s: float = 0.0) -> bytes:
        """Send a query, wait `pause_s` (s), and read the answer as `Transport.read` does.

        If the previous query had no answer, the function first waits, so that a late answer is not used for this query.
        """
        if self._unanswered and (remaining_s := self._late_until_s - self._clock.now()) > 0:
            self._clock.sleep(remaining_s)
        self._link.write(message)
        self._clock.sleep(pause_s)
        self._unanswered = True
        self._late_until_s = self._clock.now() + REPLY_TIMEOUT_S + LATE_ANSWER_S
        try:
            reply = self._link.read(size, REPLY_TIMEOUT_S, end)
        except InstrumentDisconnected:
            self._late_until_s -= REPLY_TIMEOUT_S
            raise
        self._unanswered = False
        return reply

    def _refuse_outside(self, quantity: str, value: float, lowest: float, limit: float, unit: str) -> None:
        if not lowest <= value <= limit:  # in this form the condition also refuses "not a number"
            raise SetPointRefused(
                f"{self._link.address}: {quantity} {value:g} {unit} was refused, nothing was sent: "
                f"it must be from {lowest:g} to {limit:g} {unit}"
            )

    def _verify_current(self, current_A: float) -> None:
        self._verify(
            "current", set_point_text(current_A, self.current_step_A), self.current_step_A, "A", self._current_set
        )

    def _verify(self, quantity: str, sent: str, step: str, unit: str, ask: Callable[[], float]) -> None:
        """Compare the text that was sent with the read-back. Raises SetPointNotTaken, InstrumentError."""
        self._raise_reported_errors()
        wrong_value = self._read_back(ask, lambda answer: abs(answer - float(sent)) <= 1.001 * float(step))
        if wrong_value is not None:
            raise SetPointNotTaken(
                f"{self._link.address}: {quantity} was set to {sent} {unit} but reads back {wrong_value:g} {unit}"
            )

    def _verify_output(self, on: bool) -> None:
        if self._read_back(self._enabled, lambda answer: answer == on) is not None:
            raise SetPointNotTaken(
                f"{self._link.address}: the output was switched {'on' if on else 'off'} "
                f"but the instrument says that it is {'off' if on else 'on'}"
            )

    def _read_back(self, ask: Callable[[], _Value], taken: Callable[[_Value], bool]) -> _Value | None:
        """Ask until `read_backs` consecutive answers are right; return None, or the last wrong answer."""
        deadline = self._clock.now() + READ_BACK_WITHIN_S
        right = 0
        while right < self.read_backs:
            if taken(answer := ask()):
                right += 1
                continue
            if self._clock.now() >= deadline:
                return answer
            right = 0
            self._clock.sleep(0.05)
        return None

    def _verify_level(self, question: str, level: float, limit: float, answer: float) -> None:
        """Raise SetPointNotTaken if the level of a protection reads back further from `level` than the margin.

        An instrument may round the level. The tolerance keeps it above the limit and below 1.2 times the limit.
        """
        if abs(answer - level) > (PROTECTION_MARGIN - 1) * limit:
            raise SetPointNotTaken(
                f"{self._link.address}: its own protection was set to {level:g} but {question} is answered {answer:g}"
            )

    def _number(self, question: str, reply: bytes) -> float:
        if (number := number_in(reply)) is None:
            raise self._not_understood(question, reply, "a number")
        return number

    def _identity(self, reply: bytes) -> Identity:
        text = self._line("*IDN?", reply)
        return self._bind(text, serial_number_in(text))

    def _line(self, question: str, reply: bytes) -> str:
        text = line_in(reply)
        if text is None or text == question:  # a line that returns what is sent to it
            raise self._not_understood(question, reply, "a line of text")
        return text

    def _bind(self, text: str, serial_number: str) -> Identity:
        """Return the identity of the instrument. Raises AnotherSupply if another instrument answered first."""
        address = self._link.address
        identity = Identity(self.name, text, address, serial_number or usb_serial_number(address))
        self._bound = self._bound or identity
        if self._bound != identity:
            raise AnotherSupply(
                f"{address}: the coil's supply is not there: {in_words(identity)} answers in place of "
                f"{in_words(self._bound)}"
            )
        self._unconfirmed = False
        return identity

    def _not_understood(self, question: str, reply: bytes, expected: str) -> ReplyNotUnderstood:
        return ReplyNotUnderstood(
            f"{self._link.address}: the answer to {question} must be {expected}, but it is {reply!r}"
        )
