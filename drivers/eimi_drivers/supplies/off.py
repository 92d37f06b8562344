"""Switch a supply off and measure that no current flows.

A supply counts as off if its measured current is at most the current that a healthy supply measures when no current
flows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isnan

from eimi_drivers.interfaces import Clock, Off, PowerSupply, Reading, SwitchOffFailed

LEAST_OFF_A = 0.02
"""The smallest limit (A) of the current with which a supply counts as off, unless `Limits.off_below_A` is given."""

DECAYS_WITHIN_S = 2.0
"""Longest time (s) for the decay of the coil's current and the discharge of the supply's output capacitor."""

MEASURE_EVERY_S = 0.05
"""Wait (s) between two measurements of the decaying current."""


MEASURING_ATTEMPTS = 2
"""Number of attempts to measure the current after the output was switched off."""


def off_limit_A(supply: PowerSupply) -> float:
    """Return the largest measured current (A) with which a supply counts as off."""
    if supply.limits.off_below_A is not None:
        return supply.limits.off_below_A
    return max(LEAST_OFF_A, float(getattr(supply, "reads_zero_within_A", 0.0)))


def measured_off(measure: Callable[[], Reading], limit_A: float, clock: Clock, name: str = "the supply") -> Off:
    """Measure the current of a supply until its magnitude is at most `limit_A`, for at most `DECAYS_WITHIN_S` (s).

    Parameters
    ----------
    measure : callable
        Measures the output and returns a `Reading`.
    limit_A : float
        Largest current with which the supply counts as off, A.
    clock : Clock
        Clock of the supply.
    name : str
        Address of the supply, for the message.

    Returns
    -------
    Off
        Last measured current and the limit.

    Raises
    ------
    SwitchOffFailed
        The current is still above the limit.
    InstrumentError
        The supply does not answer.
    """
    began_s = clock.now()
    while True:
        current_A = measure().current_A
        if abs(current_A) <= limit_A:
            return Off(current_A, limit_A)
        if clock.now() - began_s >= DECAYS_WITHIN_S or isnan(current_A):
            raise SwitchOffFailed(
                f"{name}: {current_A:.3f} A measured although the output was switched off; the current must be at most "
                f"{limit_A:g} A",
                current_A,
                limit_A,
            )
        clock.sleep(MEASURE_EVERY_S)


def confirmed_off(measure: Callable[[], Reading], limit_A: float, clock: Clock, name: str) -> Off:
    """Measure the current of a supply until its magnitude is at most `limit_A`; repeat if no answer arrives.

    Parameters
    ----------
    measure : callable
        Measures the output and returns a `Reading`.
    limit_A : float
        Largest current with which the supply counts as off, A.
    clock : Clock
        Clock of the supply.
    name : str
        Address of the supply, for the message.

    Returns
    -------
    Off
        Last measured current and the limit.

    Raises
    ------
    SwitchOffFailed
        The current is still above the limit, or every measurement failed.
    """
    for _ in range(MEASURING_ATTEMPTS):
        try:
            return measured_off(measure, limit_A, clock, name)
        except SwitchOffFailed:
            raise
        except Exception as error:  # a fault of a driver must not end the attempts
            failed = error
    raise SwitchOffFailed(
        f"{name}: switching off the supply: current to zero: done; output off: done; read back: "
        f"done; measured current: failed ({type(failed).__name__}: {failed})"
    ) from failed


def failed_stages(stages: Sequence[tuple[str, Callable[[], None]]], name: str) -> SwitchOffFailed | None:
    """Carry out all stages of switching a supply off, and return an error that lists failed and successful stages.

    Parameters
    ----------
    stages : sequence of (str, callable)
        Name and function of each stage; if a stage fails, later stages with the same name are left out.
    name : str
        Address of the supply, for the message.

    Returns
    -------
    SwitchOffFailed or None
        Error with the result of every stage; None if no stage failed.
    """
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
    failed = SwitchOffFailed(f"{name}: switching off the supply: {listed}")
    failed.__cause__ = first
    return failed


def switch_off(supply: PowerSupply, clock: Clock) -> Off | None:
    """Switch a supply off and measure its current.

    Parameters
    ----------
    supply : PowerSupply
        Open supply.
    clock : Clock
        Clock of the supply.

    Returns
    -------
    Off or None
        Measured current and its limit; None if the supply cannot measure a current.

    Raises
    ------
    SwitchOffFailed
        The supply could not be switched off, or a current above the limit still flows.
    InstrumentError
        The current could not be measured.
    """
    off = supply.safe_off()
    if isinstance(off, Off):
        return off
    if not getattr(supply, "measures_current", True):
        return None
    return measured_off(supply.measure, off_limit_A(supply), clock)
