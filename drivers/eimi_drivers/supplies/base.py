"""What every supply driver shares: limits, read-back, protection, and switching off until no current is measured."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from decimal import ROUND_DOWN, Decimal
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
    ReplyNotUnderstood,
    SetPointNotTaken,
    SetPointRefused,
    SwitchOffFailed,
)
from eimi_drivers.supplies.off import measured_off, off_limit_A
from eimi_drivers.supplies.transport import Transport, split_address, usb_serial_number

REPLY_TIMEOUT_S = 1.0
READ_BACK_WITHIN_S = 0.6
"""Some firmware needs 0.45 s before a new set-point reads back."""

LATE_ANSWER_S = 1.0
"""After a question without an answer, the next one waits so long and throws away what has come until then."""

PROTECTION_MARGIN = 1.1
"""An instrument's own protection is set this far above the limits: it is for a regulator that has failed."""

MEASURING_ATTEMPTS = 2
"""A measurement that fails after the output was switched off is tried again so many times in all."""

WATCHDOG_S = 10
"""A supply's own watchdog switches off after so long without a message; a run sends one every 2 s at least."""

STAYS_ON = "nothing switches the output off, it stays as it was set"

_NUMBER = re.compile(rb"[ \t\r\n]*[+-]?(\d{1,12}\.?\d{0,12}|\.\d{1,12})([eE][+-]?\d{1,2})?[ \t\r\n\0]*")
_NOT_A_MEASUREMENT = 1e30
"""SCPI answers 9.91E+37 for "not a number" and 9.9E+37 for infinity (SCPI-99, volume 1, 7.2.1)."""

_Value = TypeVar("_Value")


class SupplyBase(ABC):
    """A supply whose current runs from 0 to the limit, or from minus the limit where it is bipolar.

    A driver names itself, gives its steps and says how to send and ask eight things; see `korad` and
    `genesys`. Set-points are rounded toward zero to the step, so that no rounding ever passes the limit.

    bipolar: whether negative currents can be set.
    channels: the first and the last channel that an address may name after `#`; default_channel: the one
    used when it names none. read_backs: how often in a row a read-back must be right to be believed.
    without_contact: what becomes of the output when the cable is pulled or the computer dies, in words.
    reads_zero_within_A: the read-back accuracy at zero, see `PowerSupply`.
    """

    name: ClassVar[str]
    current_step_A: ClassVar[str] = "0.001"
    voltage_step_V: ClassVar[str] = "0.01"
    bipolar: ClassVar[bool] = False
    channels: ClassVar[tuple[int, int]] = (1, 1)
    default_channel: ClassVar[int] = 1
    read_backs: ClassVar[int] = 1
    without_contact: str = STAYS_ON

    @property
    def reads_zero_within_A(self) -> float:
        """The largest current (A) that a healthy unit of the family shows when none flows.

        0 stands for a family whose value is below `off.LEAST_OFF_A` or not stated here.
        """
        return 0.0

    def __init__(self, link: Transport, limits: Limits, clock: Clock) -> None:
        """Sends nothing. Raises InstrumentError when the address names a channel that there is not."""
        self.limits = limits
        self._link = link
        self._clock = clock
        self._switched_on = False
        self._unanswered = False
        self._bound: Identity | None = None
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
        """Open the transport that this driver speaks over."""

    @abstractmethod
    def identify(self) -> Identity:
        """Ask the instrument who it is."""

    @abstractmethod
    def output_on(self) -> bool:
        """Whether the output is on, as the instrument says."""

    @abstractmethod
    def measure(self) -> Reading:
        """Measure the output."""

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
        """Raise InstrumentError with the errors in the instrument's own queue."""

    def _enabled(self) -> bool:
        """Whether the output is switched on; differs from `output_on` where off is a current of zero."""
        return self.output_on()

    def _trip(self) -> str:
        """What tripped, in a few words, as the instrument itself reports it; empty when nothing did."""
        return ""

    def _protect(self) -> None:  # noqa: B027  not every instrument has protections to set
        """Set the instrument's own protections; called before the output is switched on."""

    def _arm_watchdog(self) -> None:  # noqa: B027  few instruments have one
        """Let the instrument switch off by itself when nothing is heard for `WATCHDOG_S`; before the output is on."""

    def _disarm_watchdog(self) -> None:  # noqa: B027
        """The output is off: nobody has to be heard any more."""

    def set_voltage(self, voltage_V: float) -> None:
        """Set the compliance voltage and read it back. Raises SetPointRefused, SetPointNotTaken."""
        self._refuse_outside("voltage", voltage_V, 0.0, self.limits.voltage_V, "V")
        sent = _text(voltage_V, self.voltage_step_V)
        self._send_voltage(sent)
        self._verify("voltage", sent, self.voltage_step_V, "V", self._voltage_set)

    def set_current(self, current_A: float) -> None:
        """Set the current and read the set-point back. Raises SetPointRefused, SetPointNotTaken."""
        lowest = -self.limits.current_A if self.bipolar else 0.0
        self._refuse_outside("current", current_A, lowest, self.limits.current_A, "A")
        self._send_current(_text(current_A, self.current_step_A))
        self._verify_current(current_A)

    def set_output(self, on: bool) -> None:
        """Switch the output and verify it. Raises SetPointNotTaken."""
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
        """Raise InstrumentError for reported errors, ProtectionTripped for a trip or an output gone off."""
        self._raise_reported_errors()
        if cause := self._trip():
            raise ProtectionTripped(f"{self._link.address}: {cause}")
        if self._switched_on and not self._enabled():
            raise ProtectionTripped(
                f"{self._link.address}: the output is off and this run did not switch it off: a protection that it "
                "does not report, or somebody at its front panel"
            )

    def safe_off(self) -> Off:
        """Program zero, switch off, read both back, and measure until no current flows.

        Each stage is tried whatever became of the others. The output is switched off before zero is read back: on a
        slow line that question takes longer than all the rest. If a stage fails, the line is opened anew and all are
        tried again.

        Returns
        -------
        Off
            The measured current and the limit that it is below, see `eimi_drivers.supplies.off`.

        Raises
        ------
        SwitchOffFailed
            A stage failed twice, with the outcome of every stage; or a current above the limit still flows; or another
            supply answers once the line is opened anew; or a supply without a serial number is then found off.
        """
        found_off = False
        failed = self._try_to_switch_off()
        if failed:
            found_off = self._reopen_and_compare()
            failed = self._try_to_switch_off()
        if failed:
            raise failed from failed.__cause__
        off = self._measured_off(found_off)
        with suppress(InstrumentError):
            self._disarm_watchdog()
        self._switched_on = False
        return off

    def _reopen_and_compare(self) -> bool:
        """Open the line anew and return whether the output is off already. Raises SwitchOffFailed for another supply.

        A name such as /dev/ttyUSB0 or an address in a network may belong to another supply by then. A line that cannot
        be opened anew leads to the same supply as before.
        """
        try:
            if not self._link.reopen() or self._bound is None:
                return False
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

    def _measured_off(self, found_off: bool) -> Off:
        for _ in range(MEASURING_ATTEMPTS):
            try:
                off = measured_off(self.measure, off_limit_A(self), self._clock, self._link.address)
                return replace(off, found_off=found_off)
            except SwitchOffFailed:
                raise
            except Exception as error:  # as in _try_to_switch_off
                failed = error
        raise SwitchOffFailed(
            f"{self._link.address}: zero: done; off: done; verify: done; measure: failed ({type(failed).__name__}: "
            f"{failed})"
        ) from failed

    def _try_to_switch_off(self) -> SwitchOffFailed | None:
        stages: tuple[tuple[str, Callable[[], None]], ...] = (
            ("zero", lambda: self._send_current(_text(0.0, self.current_step_A))),
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
            except Exception as error:  # a mistake in a driver must not keep the stages after it from being tried
                outcomes[stage] = f"failed ({type(error).__name__}: {error})"
                first = first or error
        if first is None:
            return None
        said = "; ".join(f"{stage}: {outcome}" for stage, outcome in outcomes.items())
        failed = SwitchOffFailed(f"{self._link.address}: {said}")
        failed.__cause__ = first
        return failed

    def close(self) -> None:
        """Release the port. Does not switch off: safe_off does."""
        self._link.close()

    def _question(self, message: bytes, size: int, end: bytes = b"", pause_s: float = 0.0) -> bytes:
        """Send a question, wait `pause_s`, and read the answer as `Transport.read` does.

        An answer that comes after its time is up must not be taken for the answer to the next question.
        """
        if self._unanswered:
            self._clock.sleep(LATE_ANSWER_S)
        self._link.write(message)
        self._clock.sleep(pause_s)
        self._unanswered = True
        reply = self._link.read(size, REPLY_TIMEOUT_S, end)
        self._unanswered = False
        return reply

    def _refuse_outside(self, quantity: str, value: float, lowest: float, limit: float, unit: str) -> None:
        if not lowest <= value <= limit:  # so written, "not a number" is refused as well
            raise SetPointRefused(
                f"{self._link.address}: {quantity} {value:g} {unit} was refused, nothing was sent: "
                f"it must be from {lowest:g} to {limit:g} {unit}"
            )

    def _verify_current(self, current_A: float) -> None:
        self._verify("current", _text(current_A, self.current_step_A), self.current_step_A, "A", self._current_set)

    def _verify(self, quantity: str, sent: str, step: str, unit: str, ask: Callable[[], float]) -> None:
        """What was sent, against the instrument's errors and what it reads back. Raises SetPointNotTaken."""
        self._raise_reported_errors()
        found = self._read_back(ask, lambda answer: abs(answer - float(sent)) <= 1.001 * float(step))
        if found is not None:
            raise SetPointNotTaken(
                f"{self._link.address}: {quantity} was set to {sent} {unit} but reads back {found:g} {unit}"
            )

    def _verify_output(self, on: bool) -> None:
        if self._read_back(self._enabled, lambda answer: answer == on) is not None:
            raise SetPointNotTaken(
                f"{self._link.address}: the output was switched {'on' if on else 'off'} "
                f"but the instrument says that it is {'off' if on else 'on'}"
            )

    def _read_back(self, ask: Callable[[], _Value], taken: Callable[[_Value], bool]) -> _Value | None:
        """Ask until the answer is right `read_backs` times in a row: None then, or the last wrong answer."""
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

    def _number(self, question: str, reply: bytes) -> float:
        if not _NUMBER.fullmatch(reply) or abs(number := float(reply.strip(b"\0 \t\r\n"))) > _NOT_A_MEASUREMENT:
            raise self._not_understood(question, reply, "a number")
        return number

    def _identity(self, reply: bytes) -> Identity:
        text = self._line("*IDN?", reply)
        return self._bind(text, serial_number_in(text))

    def _line(self, question: str, reply: bytes) -> str:
        text = reply.strip(b"\0 \t\r\n").decode("latin-1")
        if not (text.isascii() and text.isprintable() and text):
            raise self._not_understood(question, reply, "a line of text")
        return text

    def _bind(self, text: str, serial_number: str) -> Identity:
        """Return the identity of the instrument. Raises AnotherSupply if it is not the one that answered first."""
        address = self._link.address
        identity = Identity(self.name, text, address, serial_number or usb_serial_number(address))
        self._bound = self._bound or identity
        if self._bound != identity:
            raise AnotherSupply(
                f"{address}: the coil's supply is not there: {_shown(identity)} answers in place of "
                f"{_shown(self._bound)}"
            )
        return identity

    def _not_understood(self, question: str, reply: bytes, expected: str) -> ReplyNotUnderstood:
        return ReplyNotUnderstood(
            f"{self._link.address}: the answer to {question} must be {expected}, but it is {reply!r}"
        )


def serial_number_in(text: str) -> str:
    """Return the serial number in an answer to `*IDN?`, or "" if there is none.

    It is the third of four fields (IEEE 488.2, 10.14), and "0" stands for none. Some Korad supplies add `SN:` and the
    number instead.
    """
    if match := re.search(r"\bSN:\s*(\w+)", text):
        return match[1]
    fields = [field.strip() for field in text.split(",")]
    return fields[2] if len(fields) >= 4 and fields[2].strip("0") else ""


def _shown(identity: Identity) -> str:
    serial_number = f" with serial number {identity.serial_number}" if identity.serial_number else ""
    return f"{identity.text!r}{serial_number}"


def _text(value: float, step: str) -> str:
    """A value as it is sent, in whole steps. The rounding removes what binary fractions add: 0.7999999999999999."""
    return str(Decimal(repr(round(float(value), 9))).quantize(Decimal(step), ROUND_DOWN) + 0)  # no minus zero
