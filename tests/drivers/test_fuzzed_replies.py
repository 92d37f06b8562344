"""A driver returns the value in a damaged reply or raises an error in time, and never sets a wrong value.

``pytest -m slow -s tests/drivers/test_fuzzed_replies.py`` prints the number of each outcome.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TypeVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import DIALECTS, CoilSupply, emulate
from eimi_drivers.interfaces import InstrumentError, Limits
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.base import READ_BACK_WITHIN_S
from eimi_drivers.supplies.conversation import LATE_ANSWER_S, REPLY_TIMEOUT_S
from eimi_drivers.supplies.transport import InProcessTransport, Responder

LIMITS = Limits(current_A=1.0, voltage_V=12.0)
LONG_RUN_REPLIES = 10_000
SHORT_RUN_REPLIES = 600

Spoil = Callable[[bytes], bytes]
Found = TypeVar("Found")


def flipped(bit: int) -> Spoil:
    # Return a function that flips one bit of a reply (`bit` modulo the length of the reply).
    def spoil(reply: bytes) -> bytes:
        if not reply:
            return reply
        place = bit // 8 % len(reply)
        return reply[:place] + bytes([reply[place] ^ 1 << bit % 8]) + reply[place + 1 :]

    return spoil


NONSENSE = (
    b"nan",
    b"inf",
    b"-inf",
    b"9.91E+37",
    b"1e400",
    b"1_0",
    b"+",
    b"0x",
    b"OK",
    b"E01",
    b"",
    b"\0",
    b'-113,"Bad"',
)
SPOILS: st.SearchStrategy[Spoil] = st.one_of(
    st.just(lambda reply: reply),
    st.integers(0, 1023).map(flipped),
    st.integers(0, 20).map(lambda length: lambda reply: reply[:length]),
    st.integers(1, 20).map(lambda length: lambda reply: reply[length:]),
    st.binary(max_size=12).map(lambda noise: lambda reply: noise),
    st.binary(max_size=6).map(lambda noise: lambda reply: noise + reply),
    st.binary(max_size=6).map(lambda noise: lambda reply: reply + noise),
    st.sampled_from(NONSENSE).flatmap(
        lambda text: st.sampled_from((b"", b"\n", b"\r")).map(lambda end: lambda reply: text + end)
    ),
    st.just(lambda reply: reply * 2),
    st.just(lambda reply: b""),
)


@dataclass
class FuzzedLine:
    # A connection that damages the reply to every query by the functions in `spoils`, in turn.

    instrument: Responder
    spoils: list[Spoil]
    replies: int = 0
    handed_out: list[bytes] = field(default_factory=list)

    def receive(self, data: bytes) -> bytes:
        reply = self.instrument.receive(data)
        if not reply:
            return reply
        spoil = self.spoils[self.replies % len(self.spoils)]
        self.replies += 1
        self.handed_out.append(spoil(reply))
        return self.handed_out[-1]


def number_in_reply(reply: bytes, driver: str) -> float:
    # Return the number in a complete reply.
    end = b"\r" if driver == "genesys" else b"\n"
    text = reply[:5] if driver == "korad" else reply[: reply.index(end) + 1]
    clean = text.decode("ascii").strip("\0 \t\r\n")
    if driver == "aim-tti":
        clean = clean.removeprefix("V1 ").removeprefix("I1 ").rstrip("AV")
    assert re.fullmatch(r"[-+0-9.eE]+", clean), clean
    return float(clean)


def fuzz(driver: str, spoils: list[Spoil], milliamperes: int, locked: bool, figures: Counter[str]) -> None:
    # Call every method of a driver on a connection with damaged replies, and check the results.
    # spoils : functions that damage the replies in turn
    # milliamperes : requested current
    # locked : whether the supply obeys no command
    # figures : counts replies and outcomes
    clock = SimulatedClock()
    coil = CoilSupply(clock)
    line = FuzzedLine(emulate(driver, coil), spoils)
    link = InProcessTransport(line, clock, "somewhere")
    supply = SUPPLIES[driver](link, LIMITS, clock)
    coil.set_voltage(10.0)
    coil.set_current(0.25)
    coil.switch(True)
    coil.locked = locked
    step_A = Decimal(SUPPLIES[driver].current_step_A)
    asked_A = float(Decimal(milliamperes) / 1000 // step_A * step_A)

    has_modes = getattr(getattr(SUPPLIES[driver], "profile", None), "modes", ())
    reset = (0.0,) if has_modes else ()  # a change of the mode sets both set-points to zero

    def attempt(act: Callable[[], Found], questions: int = 1) -> Found | None:
        # Call `act`; return its result, or None after an InstrumentError.
        # questions : number of queries in the call that may time out; the call must not take longer than these time-
        # outs
        began_s, sent_before = clock.now(), len(link.sent)
        line.handed_out.clear()
        returned = None
        try:
            returned = act()
            figures["answers taken"] += 1
        except InstrumentError as error:
            figures[type(error).__name__] += 1
        patience_s = questions * (LATE_ANSWER_S + REPLY_TIMEOUT_S + 2 * READ_BACK_WITHIN_S)
        assert clock.now() - began_s <= patience_s + 0.1 * (len(link.sent) - sent_before), "hung"
        return returned

    def program(act: Callable[[], None], requested: float, step: float, in_force: Callable[[], float]) -> None:
        before = in_force()
        taken = attempt(lambda: act() or True)
        assert in_force() in (before, requested, *reset), "a set-point that was not requested"
        if taken and in_force() != requested:
            # The instrument did not accept the set-point, but the damaged reply is equal to the requested set-point.
            assert abs(number_in_reply(line.handed_out[-1], driver) - requested) <= 1.001 * step
            figures["false confirmations on the wire"] += 1

    if identity := attempt(supply.identify):
        assert identity.text.isprintable()
    if reading := attempt(supply.measure):
        current, voltage = line.handed_out[-2:]
        assert reading.current_A == pytest.approx(number_in_reply(current, driver))
        assert reading.voltage_V == pytest.approx(number_in_reply(voltage, driver))
    assert attempt(supply.output_on) in (True, False, None)
    attempt(supply.check, 3)
    program(lambda: supply.set_voltage(11.0), 11.0, 0.01, lambda: coil.state.set_voltage_V)
    program(lambda: supply.set_current(milliamperes / 1000), asked_A, float(step_A), lambda: coil.state.set_current_A)
    attempt(lambda: supply.set_output(True), 3)
    attempt(supply.safe_off, 4)
    assert locked or coil.state.set_current_A == 0.0 or not coil.state.output, "left on"
    figures["replies"] += line.replies


def run(driver: str, replies: int) -> Counter[str]:
    # Call the methods of a driver until at least `replies` replies were damaged; return the number of each outcome.
    figures: Counter[str] = Counter()

    @given(
        spoils=st.lists(SPOILS, min_size=1, max_size=12),
        milliamperes=st.integers(300, 999),
        locked=st.booleans(),
    )
    @settings(max_examples=max(replies // 20, 20), database=None)
    def batch(spoils: list[Spoil], milliamperes: int, locked: bool) -> None:
        fuzz(driver, spoils, milliamperes, locked, figures)

    while figures["replies"] < replies:
        batch()
    return figures


@pytest.mark.parametrize("driver", sorted(DIALECTS))
def test_a_fuzzed_reply_gives_a_driver_error_or_the_value_that_it_contains(driver):
    assert run(driver, SHORT_RUN_REPLIES)["answers taken"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("driver", sorted(DIALECTS))
def test_ten_thousand_fuzzed_replies(driver):
    figures = run(driver, LONG_RUN_REPLIES)
    errors = {name: count for name, count in figures.items() if name not in ("replies", "answers taken")}
    print(f"\n{driver}: {figures['replies']} replies, {figures['answers taken']} answers taken, errors {errors}")
    assert figures["answers taken"] > 0
