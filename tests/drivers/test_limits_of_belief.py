"""Drivers accept a set value if the supply reports it within a tolerance; each message has a time limit."""

from __future__ import annotations

import os
import select
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import CoilSupply
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.interfaces import InstrumentTimeout, Limits, ReplyNotUnderstood, SetPointNotTaken
from eimi_drivers.supplies import transport
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.transport import WRITE_TIMEOUT_S, InProcessTransport, SerialTransport
from eimi_drivers.supplies.visa import VisaTransport
from tests.patience import PATIENCE_S


class Rounding(KoradDialect):
    # An emulated supply that reports its set current with an error of `more_A`.

    more_A = 0.0

    def receive(self, data: bytes) -> bytes:
        answer = super().receive(data)
        if data == b"ISET1?":
            return f"{self.supply.state.set_current_A + self.more_A:.3f}K".encode()
        return answer


@pytest.mark.parametrize(
    ("more_A", "believed"), [(0.0, True), (0.001, True), (-0.001, True), (0.003, False), (-0.005, False)]
)
def test_a_read_back_may_differ_by_at_most_one_step(more_A: float, believed: bool) -> None:
    clock = SimulatedClock()
    dialect = Rounding(CoilSupply(clock))
    dialect.more_A = more_A
    supply = KoradSupply(InProcessTransport(dialect, clock), Limits(1.0, 10.0), clock)
    if believed:
        supply.set_current(0.5)
        return
    with pytest.raises(SetPointNotTaken, match=r"was set to 0\.500 A but reads back"):
        supply.set_current(0.5)


@pytest.mark.timeout(60)
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo-terminals")
def test_a_serial_line_that_takes_no_bytes_is_a_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport, "WRITE_TIMEOUT_S", 0.2)
    far, near = os.openpty()  # no program reads from the far end
    try:
        line = SerialTransport(os.ttyname(near))
        with pytest.raises(InstrumentTimeout, match="accepts no more bytes"):
            line.write(b"*IDN?\n" * 100_000)
    finally:
        os.close(near)
        os.close(far)


@pytest.mark.timeout(60)
@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo-terminals")
def test_unread_bytes_are_not_used_as_the_answer_to_the_next_query() -> None:
    far, near = os.openpty()
    try:
        line = SerialTransport(os.ttyname(near))
        os.write(far, b"1.234\n" * 3)
        select.select([near], [], [])
        line.write(b"ISET1?\n")
        os.write(far, b"0.500\n")
        assert line.read(6, PATIENCE_S) == b"0.500\n"
    finally:
        os.close(near)
        os.close(far)


def test_a_visa_write_has_its_own_time_limit() -> None:
    line = VisaTransport.__new__(VisaTransport)
    timeouts_ms: list[float] = []
    resource: Any = SimpleNamespace(timeout=None, read_termination=None)
    resource.write_raw = lambda message: timeouts_ms.append(resource.timeout)
    resource.read_bytes = lambda size, break_on_termchar: b"1\n"
    line.address, line._failed, line._is_stream, line._resource = "TCPIP::here::INSTR", False, False, resource
    line.write(b"CURR 1\n")
    line.read(10, 60.0, b"\n")
    line.write(b"OUTP 0\n")
    assert timeouts_ms == [round(1000 * WRITE_TIMEOUT_S)] * 2


def test_a_line_that_returns_the_query_is_not_accepted_as_an_instrument() -> None:
    clock = SimulatedClock()
    dialect = KoradDialect(CoilSupply(clock))
    dialect.identification = b"*IDN?"
    supply = KoradSupply(InProcessTransport(dialect, clock), Limits(1.0, 10.0), clock)
    with pytest.raises(ReplyNotUnderstood, match="must be a line of text, but it is"):
        supply.identify()
