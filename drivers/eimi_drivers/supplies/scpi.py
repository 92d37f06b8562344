"""Drive supplies that use SCPI, the standard command language of instruments (SCPI-99, volume 2)."""

# The drivers never send *RST: some LAN supplies no longer answer after it, and it would
# switch off outputs that another person uses.

from __future__ import annotations

import re
from typing import ClassVar

from eimi_drivers.interfaces import Clock, Identity, InstrumentError, Limits, Reading, SetPointNotTaken
from eimi_drivers.supplies.address import is_serial_port
from eimi_drivers.supplies.base import SupplyBase
from eimi_drivers.supplies.profile import Profile, Watchdog
from eimi_drivers.supplies.protections import PROTECTION_MARGIN, STAYS_ON, armed_in_words, check_level
from eimi_drivers.supplies.transport import Transport
from eimi_drivers.supplies.visa import open_visa

LONGEST_LINE = 4096
LONGEST_ERROR_QUEUE = 50

_ERROR = re.compile(r'([+-]?\d{1,5})\s*[,\s]\s*"?([^"]*)"?')
_HEXADECIMAL = re.compile(rb"(?:0[xX])?[0-9a-fA-F]{1,8}")
_YES_OR_NO = {b"1": True, b"ON": True, b"YES": True, b"0": False, b"OFF": False, b"NO": False}


class ScpiSupply(SupplyBase):
    """Driver of one SCPI supply over a socket, VXI-11, HiSLIP, USB or a serial line.

    After commands the driver raises all errors in the error queue of the supply as one InstrumentError.
    """

    profile: ClassVar[Profile]
    ends_with: ClassVar[bytes] = b"\n"

    def __init__(self, link: Transport, limits: Limits, clock: Clock) -> None:
        super().__init__(link, limits, clock)
        self._is_local = bool(self.profile.remote) and is_serial_port(link.address)

    @classmethod
    def connect(cls, address: str) -> Transport:
        """Open the VISA resource or the serial line at the address, and return the connection."""
        return open_visa(address, cls.profile.baud_rate, cls.profile.stop_bits)

    @property
    def reads_zero_within_A(self) -> float:
        """Return the largest current (A) that a healthy supply measures when no current flows."""
        return self.profile.reads_zero_within_A

    def identify(self) -> Identity:
        """Return the identity from the answer to ``*IDN?``.

        Raises AnotherSupply if the identity has changed since the driver was opened.
        """
        return self._identity(self._ask("*IDN?"))

    def output_on(self) -> bool:
        """Return whether the supply reports that its output is on."""
        if not self.profile.output_bit:
            return self._ask_whether(self.profile.output)
        reply = self._ask_channel(self.profile.output)
        if not _HEXADECIMAL.fullmatch(reply.strip()):
            raise self._not_understood(self.profile.output, reply, "a hexadecimal number")
        return bool(int(reply, 16) & self.profile.output_bit << (self._channel - 1))

    def measure(self) -> Reading:
        """Return the measured output current (A) and output voltage (V)."""
        return Reading(
            current_A=self._ask_value(self.profile.measure_current),
            voltage_V=self._ask_value(self.profile.measure_voltage),
        )

    def _fill(self, message: str, value: str = "") -> str:
        return message.format(
            value=value,
            channel=self._channel,
            voltage=f"{self.limits.voltage_V * PROTECTION_MARGIN:.2f}",
            current=f"{self.limits.current_A * PROTECTION_MARGIN:.3f}",
            limit=f"{self.limits.current_A:.3f}",
        )

    def _reopen_and_compare(self) -> bool:
        self._is_local = bool(self.profile.remote) and is_serial_port(self._link.address)
        return super()._reopen_and_compare()

    def _go_remote(self) -> None:
        if self._is_local:
            self._link.write(self.profile.remote.encode("ascii") + self.ends_with)
            self._is_local = False

    def _send(self, message: str) -> None:
        self._go_remote()
        self._link.write(message.encode("ascii") + self.ends_with)

    def _ask(self, question: str) -> bytes:
        self._go_remote()
        message = question.encode("ascii") + self.ends_with
        return self._question(message, LONGEST_LINE, b"\n", self.profile.query_delay_s)

    def _select(self) -> None:
        # Before every message, because a person may have selected another channel at the front panel.
        if self.profile.select:
            self._send(self._fill(self.profile.select))

    def _send_channel(self, *messages: str, value: str = "") -> None:
        self._select()
        for message in messages:
            self._send(self._fill(message, value))

    def _ask_channel(self, question: str) -> bytes:
        self._select()
        return self._ask(self._fill(question))

    def _ask_value(self, question: str) -> float:
        return self._number(self._fill(question), self._ask_channel(question))

    def _ask_whether(self, question: str) -> bool:
        reply = self._ask_channel(question)
        try:
            return _YES_OR_NO[reply.strip().upper()]
        except KeyError as error:
            raise self._not_understood(self._fill(question), reply, "0 or 1") from error

    def _raise_reported_errors(self) -> None:
        reported = []
        question = self.profile.errors
        if not question:
            return
        for _ in range(LONGEST_ERROR_QUEUE):
            reply = self._ask(question)
            match = _ERROR.fullmatch(reply.decode("latin-1").strip())
            if match is None:
                raise self._not_understood(question, reply, 'a number and a text such as 0,"No error"')
            if int(match[1]) == 0:
                break
            reported.append(f"{match[1]} {match[2]}")
        if reported:
            raise InstrumentError(f"{self._link.address}: the supply reports: {'; '.join(reported)}")

    def _trip(self) -> str:
        tripped = [question for question in self.profile.trip if self._ask_whether(question)]
        if tripped:
            return f"a protection tripped, as the answer to {' and '.join(tripped)} shows"
        causes = []
        for register in self.profile.registers:
            bits = int(self._ask_value(register.question))
            causes += [words for bit, words in register.trips if bits & bit]
        watchdog = self.profile.watchdog
        if self._switched_on and watchdog and watchdog.expired:
            question, answer_if_expired = watchdog.expired
            if self._ask_value(question) == answer_if_expired:
                causes.append("the watchdog of the supply switched the output off")
        return ", ".join(causes)

    def _protect(self) -> None:
        if not self.profile.protect:
            return
        self._send_channel(*self.profile.protect)
        self._raise_reported_errors()
        for question, expected in self.profile.armed:
            self._verify_protection(question, self._fill(expected))

    def _verify_protection(self, question: str, expected: str) -> None:
        if expected in {"0", "1"}:
            if self._ask_whether(question) != (expected == "1"):
                raise SetPointNotTaken(
                    f"{self._link.address}: the protection of the supply was not switched "
                    f"{'on' if expected == '1' else 'off'}, as the answer to {self._fill(question)} shows"
                )
            return
        level = float(expected)
        reply, _, switch = self._ask_channel(question).partition(b",")
        if switch and not _YES_OR_NO.get(switch.strip().upper(), False):
            raise SetPointNotTaken(
                f"{self._link.address}: the protection of the supply was not switched on, as the answer to "
                f"{self._fill(question)} shows"
            )
        answer = self._number(self._fill(question), reply)
        check_level(self._link.address, self._fill(question), level, level / PROTECTION_MARGIN, answer)

    def _bring_about_modes(self) -> None:
        """Set the required modes of the supply, such as constant current; raise SetPointNotTaken if this fails."""
        for question, right, message in self.profile.modes:
            beginnings = tuple(right.split("|"))
            if self._mode(question).startswith(beginnings):
                continue
            self._send(message)
            self._raise_reported_errors()
            if not (answer := self._mode(question)).startswith(beginnings):
                raise SetPointNotTaken(
                    f"{self._link.address}: {message} was sent, but the answer to {question} is {answer}; the supply "
                    "did not accept the message"
                )

    def _mode(self, question: str) -> str:
        return self._line(question, self._ask(question)).strip().strip('"').upper()

    def _arm_watchdog(self) -> None:
        watchdog = self.profile.watchdog
        if watchdog is None:
            return
        for message in watchdog.arm:
            self._send(message.format(seconds=watchdog.seconds))
        self._raise_reported_errors()
        for question, expected in watchdog.verify:
            answer = self._number(question, self._ask(question))
            if answer != (watchdog.seconds if expected is None else expected):
                raise SetPointNotTaken(
                    f"{self._link.address}: the watchdog of the supply was not set to {watchdog.seconds} s: the answer "
                    f"to {question} is {answer:g}"
                )

    def _disarm_watchdog(self) -> None:
        if self.profile.watchdog is not None:
            self._send(self.profile.watchdog.disarm)
            self._raise_reported_errors()

    def _send_voltage(self, text: str) -> None:
        self._bring_about_modes()
        self._send_channel(self.profile.set_voltage, value=text)

    def _send_current(self, text: str) -> None:
        if float(text) != 0:  # a current of zero is sent without any query before it
            self._bring_about_modes()
        self._send_channel(self.profile.set_current, value=text)

    def _send_output(self, on: bool) -> None:
        self._send_channel(*(self.profile.on if on else self.profile.off))

    def _voltage_set(self) -> float:
        return self._ask_value(self.profile.voltage_set)

    def _current_set(self) -> float:
        return self._ask_value(self.profile.current_set)


def scpi_driver(family: Profile) -> type[ScpiSupply]:
    """Return a driver class for a family of SCPI supplies."""

    class FamilySupply(ScpiSupply):
        __doc__ = ScpiSupply.__doc__
        name = family.driver
        profile = family
        channels = family.channels
        protections = family.protections
        without_contact = effect_without_contact(family.watchdog) + armed_in_words(family.protections)

    return FamilySupply


def effect_without_contact(watchdog: Watchdog | None) -> str:
    """Return a text that describes what the output does if the computer fails or the cable is pulled.

    `watchdog` is a timer inside the supply that then switches the output off; None if there is none.
    """
    return watchdog.effect.format(seconds=watchdog.seconds) if watchdog else STAYS_ON
