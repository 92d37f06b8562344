"""A supply driver and a camera driver in a package outside of this project, as a user may write them.

The drivers have no base class. The package imports only data classes and exceptions from this project.
"""

from __future__ import annotations

import time

import numpy as np
import serial

from eimi_drivers.interfaces import (
    Frame,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    ProtectionTripped,
    Reading,
    ReplyNotUnderstood,
    SetPointNotTaken,
    SetPointRefused,
    SwitchOffFailed,
)

TIMEOUT_S = 2.0


class Mine:
    """A driver of a supply with one output, which uses SCPI over a serial line through pyserial."""

    def __init__(self, address, limits, clock):
        self.limits, self._address, self._clock = limits, address, clock
        self._switched_on = False
        try:
            self._port = serial.Serial(address, timeout=TIMEOUT_S, write_timeout=TIMEOUT_S)
        except serial.SerialException as error:
            raise InstrumentDisconnected(f"{address}: {error}") from error

    def identify(self):
        return Identity("mine", self._ask("*IDN?"), self._address)

    def set_voltage(self, voltage_V):
        self._set("VOLT", voltage_V, self.limits.voltage_V)

    def set_current(self, current_A):
        self._set("CURR", current_A, self.limits.current_A)

    def set_output(self, on):
        self._send(f"OUTP {int(on)}")
        if self.output_on() != on:
            raise SetPointNotTaken(f"{self._address}: the output did not switch")
        self._switched_on = on

    def output_on(self):
        return self._number("OUTP?") == 1

    def measure(self):
        return Reading(self._number("MEAS:CURR?"), self._number("MEAS:VOLT?"))

    def check(self):
        if self._switched_on and not self.output_on():
            raise ProtectionTripped(f"{self._address}: the output went off")

    def safe_off(self):
        failed = []
        for stage in (lambda: self._set("CURR", 0.0, 0.0), lambda: self.set_output(False)):
            for last in (False, True):
                try:
                    stage()
                    break
                except InstrumentError as error:
                    failed += [str(error)] if last else []
        if failed:
            raise SwitchOffFailed(f"{self._address}: {'; '.join(failed)}")

    def close(self):
        self._port.close()

    def _set(self, name, value, limit):
        if not 0 <= value <= limit:
            raise SetPointRefused(f"{self._address}: {name} {value} must be from 0 to {limit}")
        self._send(f"{name} {value:.3f}")
        if abs(self._number(f"{name}?") - value) > 0.001:
            raise SetPointNotTaken(f"{self._address}: {name} {value} was not taken")

    def _send(self, message):
        try:
            self._port.reset_input_buffer()
            self._port.write(message.encode() + b"\n")
        except Exception as error:
            raise InstrumentDisconnected(f"{self._address}: {error}") from error

    def _ask(self, question):
        self._send(question)
        try:
            answer = self._port.read_until(b"\n")
        except serial.SerialException as error:
            raise InstrumentDisconnected(f"{self._address}: {error}") from error
        if not answer.endswith(b"\n"):
            raise InstrumentTimeout(f"{self._address}: no answer to {question}")
        if not answer.isascii():
            raise ReplyNotUnderstood(f"{self._address}: {answer!r}")
        return answer.decode().strip()

    def _number(self, question):
        answer = self._ask(question)
        try:
            return float(answer)
        except ValueError:
            raise ReplyNotUnderstood(f"{self._address}: {answer!r}") from None


class Eye:
    """A driver of an emulated camera without settings; frames show a dark beam at rest in front of a bright wall."""

    def __init__(self, source, settings):
        if source == "nowhere":
            raise InstrumentDisconnected("nowhere: no camera")
        if settings.chosen():
            raise InstrumentError(f"{source}: nothing can be set")
        self._noise, self._number, self._open = np.random.default_rng(0), 0, True

    def identify(self):
        return Identity("eye", "an eye", "here")

    def flush(self):
        pass

    def grab(self, timeout_s):
        if not self._open:
            raise InstrumentDisconnected("here: closed")
        time.sleep(0.005)
        self._number += 1
        across = np.abs(np.arange(128) - 64)
        image = np.tile(np.where(across < 8, 30.0, 200.0), (96, 1)) + self._noise.normal(0, 2, (96, 128))
        return Frame(image.clip(0, 255).astype(np.uint8), self._number, time.monotonic())

    def close(self):
        self._open = False
