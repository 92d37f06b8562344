"""Checks of a supply driver. The name of each check describes the required behaviour."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, suppress
from functools import partial

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.faults import Fault
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import (
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    ProtectionTripped,
    Reading,
    ReplyNotUnderstood,
    SetPointRefused,
    SupplyDriver,
    SwitchOffFailed,
)
from eimi_drivers.supplies.transport import Responder
from eimi_drivers.testing.claims import claim, must_raise, run_checks, within
from eimi_drivers.testing.supply_bench import (
    LIMITS,
    PATIENCE_S,
    RESISTANCE_OHM,
    SETTLED_AFTER_S,
    SupplyBench,
    supply_bench,
)

CURRENT_WITHIN_A, VOLTAGE_WITHIN_V = 0.01, 0.05
LATE_S = 1.3
"""Delay of a late answer, s. The drivers of this package wait for a shorter time."""


def says_who_it_is(bench: SupplyBench) -> None:
    """Check that `identify` returns the name of the driver, the instrument's text and the address."""
    identity = bench.supply.identify()
    claim(isinstance(identity, Identity), f"identify() should return an Identity, not {identity!r}")
    claim(bool(identity.driver and identity.text), f"identify() should return a driver and a text, not {identity}")
    claim(
        identity.address == bench.address,
        f"identify() should return the address {bench.address!r}, not {identity.address!r}",
    )


def drives_the_coil_and_switches_it_off(bench: SupplyBench) -> None:
    """Check that the set current flows and is measured, and that the output switches off."""
    bench.energise(0.7)
    claim(bench.supply.output_on() is True, "output_on() should be True after set_output(True)")
    _flows(bench, 0.7)
    bench.supply.check()
    bench.supply.set_current(0.2)
    bench.clock.sleep(SETTLED_AFTER_S)
    _flows(bench, 0.2)
    bench.supply.set_output(False)
    claim(not bench.energised(), "the instrument's output should be off after set_output(False), but it is on")
    claim(bench.supply.output_on() is False, "output_on() should be False after set_output(False)")
    bench.supply.check()


def refuses_set_points_outside_its_limits(bench: SupplyBench) -> None:
    """Check that a set-point that is outside the limits or not finite raises SetPointRefused and is not sent."""
    claim(
        bench.supply.limits == LIMITS,
        f"limits should be the value with which the supply was opened, {LIMITS}, not {bench.supply.limits}",
    )
    before = bench.coil.state
    for share in (-1.0001, 1.0001, math.nan, math.inf, -math.inf):
        for setter, limit in (("set_current", LIMITS.current_A), ("set_voltage", LIMITS.voltage_V)):
            set_it = partial(getattr(bench.supply, setter), share * limit)
            must_raise((SetPointRefused,), f"{setter}({share * limit:g})", set_it)
    claim(bench.coil.state == before, "a refused set-point changed the instrument")
    claim(bench.sent == [], f"a refused set-point was sent: {bench.sent}")


def reverses_its_current_only_if_it_is_bipolar(bench: SupplyBench) -> None:
    """Check that the driver sets negative currents if `bipolar` is true, and refuses them otherwise."""
    if not bench.bipolar:
        must_raise((SetPointRefused,), "set_current(-0.001)", lambda: bench.supply.set_current(-0.001))
        claim(bench.sent == [], f"a refused set-point was sent: {bench.sent}")
        return
    bench.energise(-0.7)
    claim(bench.supply.output_on() is True, "output_on() should be True at -0.7 A")
    _flows(bench, -0.7)


def reads_its_set_points_back(bench: SupplyBench) -> None:
    """Check that a set-point that the instrument does not accept raises InstrumentError."""
    bench.coil.max_current_A = 0.5
    must_raise(
        (InstrumentError,),
        "set_current(0.7) on an instrument that accepts 0.5 A at most",
        lambda: bench.supply.set_current(0.7),
    )
    bench.coil.max_voltage_V = 5.0
    must_raise(
        (InstrumentError,),
        "set_voltage(12) on an instrument that accepts 5 V at most",
        lambda: bench.supply.set_voltage(12.0),
    )


def notices_a_locked_front_panel(bench: SupplyBench) -> None:
    """Check that `set_current`, `set_output` and `safe_off` raise an error if the instrument ignores all commands."""
    bench.energise(0.7)
    bench.coil.locked = True
    must_raise((InstrumentError,), "set_current(0.2) of a locked supply", lambda: bench.supply.set_current(0.2))
    must_raise((SwitchOffFailed,), "safe_off() of a locked supply", bench.supply.safe_off)
    must_raise((InstrumentError,), "set_output(False) of a locked supply", lambda: bench.supply.set_output(False))


def reports_a_protection_trip(bench: SupplyBench) -> None:
    """Check that `check` raises ProtectionTripped after a protection has switched the output off."""
    bench.energise()
    bench.coil.trip()
    must_raise((ProtectionTripped,), "check() after a trip", bench.supply.check)


def is_off_after_safe_off_from_every_state(bench: SupplyBench) -> None:
    """Check that `safe_off` sets the current to zero and switches the output off, whatever was done before."""

    def set_points() -> None:
        bench.supply.set_voltage(LIMITS.voltage_V)
        bench.supply.set_current(0.7)

    def tripped() -> None:
        bench.energise()
        bench.coil.trip()

    states: dict[str, Callable[[], object]] = {
        "just opened": lambda: None,
        "off with set-points other than zero": set_points,
        "on at 0.7 A": bench.energise,
        "on at 0 A": lambda: bench.energise(0.0),
        "off already": bench.supply.safe_off,
    }
    if bench.bipolar:
        states["on at -0.7 A"] = lambda: bench.energise(-0.7)
    states["off after a trip"] = tripped
    for state, bring_about in states.items():
        bring_about()
        bench.supply.safe_off()
        where = f"after safe_off() of a supply that was {state}"
        claim(not bench.energised(), f"the output should be off {where}, but it is on")
        claim(
            bench.coil.state.set_current_A == 0.0,
            f"the current set-point should be 0 A {where}, but it is {bench.coil.state.set_current_A:g} A",
        )
        claim(bench.supply.output_on() is False, f"output_on() should be False {where}")
        if bring_about is not tripped:  # after a trip, an instrument may still report the trip
            bench.supply.check()
    bench.clock.sleep(SETTLED_AFTER_S)
    claim(abs(bench.coil.coil_current_A()) < 1e-4, "no current should flow in the coil after safe_off()")


def tries_every_stage_of_switching_off(bench: SupplyBench) -> None:
    """Check that `safe_off` switches the output off even if the first message is lost."""
    bench.energise()
    lost: list[bytes] = []

    def is_the_first(message: bytes) -> bool:
        lost.append(message)
        return len(lost) == 1

    bench.line.inject(Fault.SILENCE, is_the_first)
    with suppress(SwitchOffFailed):  # safe_off may report that a stage failed
        bench.supply.safe_off()
    claim(not bench.energised(), f"safe_off() should switch off although the message {lost[:1]} was lost")


def gives_up_on_a_silent_line(bench: SupplyBench) -> None:
    """Check that a missing answer raises InstrumentTimeout in time, and that later queries work."""
    bench.line.inject(Fault.SILENCE)
    must_raise(
        (InstrumentTimeout,), "output_on() on a silent line", lambda: _in_time(bench, "output_on()", "output_on")
    )
    must_raise((InstrumentTimeout,), "measure() on a silent line", lambda: _in_time(bench, "measure()", "measure"))
    bench.line.inject(None)
    claim(bench.supply.output_on() is False, "output_on() should be False after the instrument answers again")


def understands_no_garbage(bench: SupplyBench) -> None:
    """Check that an unreadable answer raises ReplyNotUnderstood and does not affect the next query."""
    bench.line.inject(Fault.GARBAGE)
    must_raise((ReplyNotUnderstood,), "identify() with an unreadable answer", bench.supply.identify)
    bench.line.inject(None)
    claim(bench.supply.output_on() is False, "output_on() should be False after an unreadable answer to identify()")


def understands_no_half_answers(bench: SupplyBench) -> None:
    """Check that an incomplete answer raises InstrumentTimeout or ReplyNotUnderstood, and that the next query works."""
    bench.energise()
    bench.line.inject(Fault.PARTIAL)
    must_raise((InstrumentTimeout, ReplyNotUnderstood), "measure() with an incomplete answer", bench.supply.measure)
    bench.line.inject(None)
    _reads(bench, 0.7)


def waits_for_a_slow_answer(bench: SupplyBench) -> None:
    """Check that the driver waits for an answer that arrives after 0.3 s."""
    bench.energise()
    bench.line.inject(Fault.SLOW)
    _reads(bench, 0.7)


def takes_no_late_answer_for_the_next(bench: SupplyBench) -> None:
    """Check that an answer after an InstrumentTimeout is not used for the next query."""
    bench.energise()
    bench.line.late_s = LATE_S
    bench.line.inject(Fault.SLOW)
    with suppress(InstrumentTimeout):  # a driver may wait longer
        bench.supply.measure()
    bench.line.inject(None)
    claim(bench.supply.output_on() is True, "output_on() should be True after measure() was answered late")
    _reads(bench, 0.7)


def reports_a_cut_line(bench: SupplyBench) -> None:
    """Check that after the connection was cut a query raises an error, and `safe_off` raises SwitchOffFailed."""
    bench.energise()
    bench.line.inject(Fault.DISCONNECT)
    # PyVISA reports a socket that the other side closed as a timeout.
    must_raise(
        (InstrumentDisconnected, InstrumentTimeout),
        "measure() on a line that was cut",
        lambda: _in_time(bench, "measure()", "measure"),
    )
    must_raise((SwitchOffFailed,), "safe_off() on a line that was cut", bench.supply.safe_off)


def leaves_the_output_alone_when_it_is_opened_or_closed(bench: SupplyBench) -> None:
    """Check that opening and closing do not change the instrument, and that closing twice is allowed."""
    bench.energise()
    before = bench.coil.state
    bench.supply.close()
    bench.supply.close()
    claim(bench.coil.state == before, "close() should not change the instrument; only safe_off() switches off")
    again = bench.open_again()
    try:
        claim(bench.coil.state == before, "opening should not change the instrument; an output that is on stays on")
        claim(again.output_on() is True, "output_on() should be True for a supply that was on when it was opened")
    finally:
        again.close()


SUPPLY_CHECKS: tuple[Callable[[SupplyBench], None], ...] = (
    says_who_it_is,
    drives_the_coil_and_switches_it_off,
    refuses_set_points_outside_its_limits,
    reverses_its_current_only_if_it_is_bipolar,
    reads_its_set_points_back,
    notices_a_locked_front_panel,
    reports_a_protection_trip,
    is_off_after_safe_off_from_every_state,
    tries_every_stage_of_switching_off,
    gives_up_on_a_silent_line,
    understands_no_garbage,
    understands_no_half_answers,
    waits_for_a_slow_answer,
    takes_no_late_answer_for_the_next,
    reports_a_cut_line,
    leaves_the_output_alone_when_it_is_opened_or_closed,
)
"""The checks that `check_supply` runs."""


def check_supply(
    open: SupplyDriver,
    emulator: Callable[[CoilSupply], Responder],
    *,
    serve: Callable[[Responder], AbstractContextManager[str]] | None = None,
    answer_within_s: float = 5.0,
    checks: Iterable[Callable[[SupplyBench], None]] = SUPPLY_CHECKS,
) -> None:
    """Check a supply driver with an emulated instrument.

    Parameters
    ----------
    open : SupplyDriver
        Driver: a class or a function that opens a supply.
    emulator : callable
        Takes a `CoilSupply` and returns an object whose `receive(data: bytes) -> bytes` answers messages, such as
        ``lambda coil: emulate("scpi", coil)``.
    serve : callable, optional
        Context manager that yields the address of the emulated instrument, such as `serve_pty` or `serve_tcp`. If None,
        the connection and the time are simulated, or, if the driver opens the connection itself, `serve_pty` is used.
    answer_within_s : float
        Time in s after which a query must fail if the instrument does not answer.
    checks : iterable of functions, optional
        Selection of `SUPPLY_CHECKS`; all checks by default.

    Raises
    ------
    AssertionError
        At least one check failed; the message lists all failed checks.
    """
    subject = f"the supply driver {getattr(open, '__name__', open)}"
    run_checks(subject, checks, lambda: supply_bench(open, emulator, serve, answer_within_s))


def _in_time(bench: SupplyBench, doing: str, question: str) -> object:
    simulated = isinstance(bench.clock, SimulatedClock)
    began_s = bench.clock.now()
    try:
        return within(PATIENCE_S if simulated else bench.answer_within_s, doing, getattr(bench.supply, question))
    finally:
        if simulated:
            took_s = bench.clock.now() - began_s
            claim(
                took_s <= bench.answer_within_s,
                f"{doing} should end within {bench.answer_within_s:g} s, but took {took_s:g} s",
            )


def _flows(bench: SupplyBench, current_A: float) -> None:
    true_A = bench.coil.coil_current_A()
    claim(
        abs(true_A - current_A) <= CURRENT_WITHIN_A,
        f"the current in the coil should be {current_A:g} A as set, but it is {true_A:g} A",
    )
    _reads(bench, current_A)


def _reads(bench: SupplyBench, current_A: float) -> None:
    reading = bench.supply.measure()
    claim(isinstance(reading, Reading), f"measure() should return a Reading, not {reading!r}")
    claim(
        abs(reading.current_A - current_A) <= CURRENT_WITHIN_A
        and abs(reading.voltage_V - current_A * RESISTANCE_OHM) <= VOLTAGE_WITHIN_V,
        f"measure() should return {current_A:g} A and {current_A * RESISTANCE_OHM:g} V, the true values, not {reading}",
    )
