"""Switching off, and measuring that no current flows any more.

A supply may say that its output is off while its regulator, which has failed, lets a current through. So off is what
was measured: the current is below a limit, which is the largest current that a healthy unit shows when none flows.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isnan

from eimi_drivers.interfaces import Clock, Off, PowerSupply, Reading, SwitchOffFailed

LEAST_OFF_A = 0.02
"""The limit is no smaller than this, unless `Limits.off_below_A` says so."""

DECAYS_WITHIN_S = 2.0
"""The current of a coil and the charge of a supply's output capacitor have gone after this time."""

MEASURE_EVERY_S = 0.05


def off_limit_A(supply: PowerSupply) -> float:
    """Return the current (A) below which a supply counts as off.

    It is `Limits.off_below_A`, or else the larger of `LEAST_OFF_A` and what a healthy unit of the family reads at zero.
    """
    if supply.limits.off_below_A is not None:
        return supply.limits.off_below_A
    return max(LEAST_OFF_A, float(getattr(supply, "reads_zero_within_A", 0.0)))


def measured_off(measure: Callable[[], Reading], limit_A: float, clock: Clock, name: str = "the supply") -> Off:
    """Measure until the current is below `limit_A`, for `DECAYS_WITHIN_S` at most.

    Parameters
    ----------
    measure : callable
        Measures the output, `PowerSupply.measure`.
    limit_A : float
        The current (A) below which the supply counts as off.
    clock : Clock
        The time of the supply.
    name : str
        The supply's address, for the message.

    Returns
    -------
    Off
        The current that was measured last, and the limit.

    Raises
    ------
    SwitchOffFailed
        A current above the limit still flows. The error has the current and the limit.
    InstrumentError
        The supply cannot be asked.
    """
    began_s = clock.now()
    while True:
        current_A = measure().current_A
        if abs(current_A) <= limit_A:
            return Off(current_A, limit_A)
        if clock.now() - began_s >= DECAYS_WITHIN_S or isnan(current_A):
            raise SwitchOffFailed(
                f"{name}: {current_A:.2f} A measured although the output was switched off; at most {limit_A:g} A "
                "counts as off",
                current_A,
                limit_A,
            )
        clock.sleep(MEASURE_EVERY_S)


def switch_off(supply: PowerSupply, clock: Clock) -> Off | None:
    """Switch a supply off and measure that it is off, also if its driver's `safe_off` does not measure.

    Returns
    -------
    Off or None
        What was measured; None if the supply cannot measure and was switched off as commanded.

    Raises
    ------
    SwitchOffFailed
        The supply could not be switched off, or a current still flows.
    InstrumentError
        The driver does not measure in `safe_off`, and the supply cannot be asked.
    """
    off = supply.safe_off()
    if isinstance(off, Off):
        return off
    if not getattr(supply, "measures_current", True):
        return None
    return measured_off(supply.measure, off_limit_A(supply), clock)
