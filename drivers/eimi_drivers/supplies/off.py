"""Switch a supply off and measure that no current flows.

A supply with a failed regulator may report that its output is off while a current flows. A supply therefore counts as
off only if its measured current is not above a limit. The limit is the largest current that a healthy supply measures
when no current flows.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isnan

from eimi_drivers.interfaces import Clock, Off, PowerSupply, Reading, SwitchOffFailed

LEAST_OFF_A = 0.02
"""The smallest limit (A) of the current with which a supply counts as off, unless `Limits.off_below_A` is given."""

DECAYS_WITHIN_S = 2.0
"""Longest time (s) for the decay of the coil's current and the discharge of the supply's output capacitor."""

MEASURE_EVERY_S = 0.05
"""Wait (s) between two measurements of the decaying current."""


def off_limit_A(supply: PowerSupply) -> float:
    """Return the largest measured current (A) with which a supply counts as off.

    The limit is `Limits.off_below_A` if a value is given. Otherwise the limit is `LEAST_OFF_A` or
    `reads_zero_within_A` of the supply, whichever is larger.
    """
    if supply.limits.off_below_A is not None:
        return supply.limits.off_below_A
    return max(LEAST_OFF_A, float(getattr(supply, "reads_zero_within_A", 0.0)))


def measured_off(measure: Callable[[], Reading], limit_A: float, clock: Clock, name: str = "the supply") -> Off:
    """Measure the current of a supply until its magnitude is at most `limit_A`, for at most `DECAYS_WITHIN_S` (s).

    Parameters
    ----------
    measure : callable
        Measures the output; `PowerSupply.measure` of the supply.
    limit_A : float
        The largest current with which the supply counts as off, A.
    clock : Clock
        The clock of the supply.
    name : str
        The address of the supply, for the message.

    Returns
    -------
    Off
        The last measured current and the limit.

    Raises
    ------
    SwitchOffFailed
        The current is still above the limit. The error contains the current and the limit.
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
                f"{name}: {current_A:.2f} A measured although the output was switched off; the current must be at most "
                f"{limit_A:g} A",
                current_A,
                limit_A,
            )
        clock.sleep(MEASURE_EVERY_S)


def switch_off(supply: PowerSupply, clock: Clock) -> Off | None:
    """Switch a supply off and measure its current.

    If `safe_off` of the driver returns no measurement, this function measures the current itself.

    Parameters
    ----------
    supply : PowerSupply
        The open supply.
    clock : Clock
        The clock of the supply.

    Returns
    -------
    Off or None
        The measured current and its limit; None if the supply cannot measure a current.

    Raises
    ------
    SwitchOffFailed
        The supply could not be switched off, or a current above the limit still flows.
    InstrumentError
        `safe_off` returned no measurement, and the supply does not answer when this function measures.
    """
    off = supply.safe_off()
    if isinstance(off, Off):
        return off
    if not getattr(supply, "measures_current", True):
        return None
    return measured_off(supply.measure, off_limit_A(supply), clock)
