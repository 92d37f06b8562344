"""The log of a connection counts messages and faults, and does not change messages."""

from __future__ import annotations

import logging
from typing import Any

import pytest

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.emulators.sensors import EmulatedQuantity, emulate_sensor
from eimi_drivers.emulators.serve import emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentTimeout, Limits
from eimi_drivers.sensors.sensor_names import open_sensor
from eimi_drivers.supplies.logged import LoggedTransport
from eimi_drivers.supplies.owon import OwonSpeSupply
from eimi_drivers.supplies.supply_names import open_supply
from eimi_drivers.supplies.transport import SerialTransport, Transport
from tests.shared.processes import wait_until


class Line:
    # A connection that returns prepared answers in turn, or raises an exception among them.

    address = "/dev/ttyX"

    def __init__(self, clock: SimulatedClock, *answers: bytes | Exception) -> None:
        self._clock, self._answers = clock, list(answers)
        self.written: list[bytes] = []
        self.opened = self.closed = 0
        self.refuses = False

    def write(self, message: bytes) -> None:
        if self.refuses:
            raise InstrumentDisconnected(f"{self.address}: unplugged")
        self.written.append(message)

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        self._clock.sleep(0.25)
        answer = self._answers.pop(0) if self._answers else InstrumentTimeout(f"{self.address}: no answer")
        if isinstance(answer, Exception):
            raise answer
        return answer

    def reopen(self) -> bool:
        self.opened += 1
        return True

    def close(self) -> None:
        self.closed += 1


def test_a_logged_line_passes_everything_on_and_counts_it(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    clock = SimulatedClock(5.0)
    line = Line(clock, b"1.0\n", InstrumentTimeout("/dev/ttyX: no complete answer"))
    logged: Transport = LoggedTransport(line, clock)
    assert logged.address == line.address
    logged.write(b"CURR?\n")
    assert logged.read(10, 1.0, b"\n") == b"1.0\n"
    logged.write(b"VOLT?\n")
    with pytest.raises(InstrumentTimeout):
        logged.read(10, 1.0, b"\n")
    line.refuses = True
    with pytest.raises(InstrumentDisconnected):
        logged.write(b"OUTP 0\n")
    assert logged.reopen()
    logged.close()
    assert (line.written, line.opened, line.closed) == ([b"CURR?\n", b"VOLT?\n"], 1, 1)
    messages = [record.getMessage() for record in caplog.records]
    assert "/dev/ttyX > b'CURR?\\n'" in messages
    assert "/dev/ttyX < b'1.0\\n'" in messages
    assert "/dev/ttyX: InstrumentTimeout: /dev/ttyX: no complete answer" in messages
    assert "/dev/ttyX: InstrumentDisconnected: /dev/ttyX: unplugged" in messages
    assert messages[-1].startswith("/dev/ttyX: 3 messages, 1 answers, the slowest answer after 0.250 s; 2 faults")
    assert messages[-1].endswith(" 1 times")


def test_an_answer_that_is_cut_off_is_in_the_message() -> None:
    class Partial:
        def receive(self, data: bytes) -> bytes:
            return b"1.2" if b"half" in data else b""

    with serve_tcp(Partial()) as address:
        line = SerialTransport(address)
        try:
            for query, words in ((b"half\n", r"only b'1\.2' came"), (b"none\n", "nothing came")):
                line.write(query)
                if query == b"half\n":
                    wait_until(lambda: line._port.in_waiting > 0, "the server did not answer")
                with pytest.raises(InstrumentTimeout, match=f"no complete answer within 0.2 s .{words}") as error:
                    line.read(10, 0.2, b"\n")
                assert str(error.value).startswith(address)
        finally:
            line.close()


def owon_on(*answers: bytes | Exception) -> OwonSpeSupply:
    clock = SimulatedClock()
    return OwonSpeSupply(Line(clock, *answers), Limits(1.0, 10.0), clock)


@pytest.mark.parametrize("refusals", [0, 1, 2])
def test_late_refusals_of_commands_are_skipped(refusals: int) -> None:
    assert owon_on(*[b"ERR\n"] * refusals, b"0.5\n")._ask("CURR?") == b"0.5\n"


def test_a_question_that_is_refused_is_an_error_after_the_refusals_end() -> None:
    with pytest.raises(Exception, match=r"/dev/ttyX: the supply answers ERR to CURR\?"):
        owon_on(b"ERR\n")._ask("CURR?")
    with pytest.raises(Exception, match=r"/dev/ttyX: the supply answers ERR to CURR\?"):
        owon_on(*[b"ERR\n"] * 3, b"0.5\n")._ask("CURR?")  # a question that is refused forever must not hang a run


@pytest.mark.parametrize("level", [logging.INFO, logging.WARNING])
@pytest.mark.parametrize("kind", ["supply", "sensor"])
def test_the_lines_of_supplies_and_sensors_are_logged_only_if_the_log_accepts_it(
    caplog: pytest.LogCaptureFixture, level: int, kind: str
) -> None:
    clock = WallClock()
    driver, instrument = {
        "supply": ("scpi", emulate("scpi", CoilSupply(clock))),
        "sensor": ("text-line", emulate_sensor("text-line", EmulatedQuantity(clock, lambda: 20.0, "degC"))),
    }[kind]
    with caplog.at_level(level, "eimi_drivers"), serve_pty(instrument) as address:
        opened: Any = (
            open_supply(driver, address, Limits(1.0, 10.0), clock)
            if kind == "supply"
            else open_sensor(driver, address, clock)
        )
        opened.identify()
        opened.close()
    summaries = [record.getMessage() for record in caplog.records if "messages" in record.getMessage()]
    assert len(summaries) == (level == logging.INFO)
