"""Switch a supply off and measure that no current flows.

A supply with a failed regulator may report that its output is off while a current flows. A supply therefore counts as
off only if its measured current is below a limit. The limit is the largest current that a healthy unit shows when no
current flows.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isnan

from eimi_drivers.interfaces import Clock, Off, PowerSupply, Reading, SwitchOffFailed

LEAST_OFF_A = 0.02
"""The smallest limit (A), unless `Limits.off_below_A` is set."""

DECAYS_WITHIN_S = 2.0
"""Time (s) in which the current of a coil and the charge of a supply's output capacitor decay."""

MEASURE_EVERY_S = 0.05
"""Wait (s) between two measurements of the decaying current."""


def off_limit_A(supply: PowerSupply) -> float:
    """Return the current (A) below which a supply counts as off.

    This is `Limits.off_below_A` if it is set. Otherwise it is the larger of `LEAST_OFF_A` and `reads_zero_within_A`.
    """
    if supply.limits.off_below_A is not None:
        return supply.limits.off_below_A
    return max(LEAST_OFF_A, float(getattr(supply, "reads_zero_within_A", 0.0)))


def measured_off(measure: Callable[[], Reading], limit_A: float, clock: Clock, name: str = "the supply") -> Off:
    """Measure until the current is at most `limit_A`, for at most `DECAYS_WITHIN_S`.

    Parameters
    ----------
    measure : callable
        Measures the output, `PowerSupply.measure`.
    limit_A : float
        The current (A) below which the supply counts as off.
    clock : Clock
        The clock of the supply.
    name : str
        The supply's address, for the message.

    Returns
    -------
    Off
        The last measured current, and the limit.

    Raises
    ------
    SwitchOffFailed
        A current above the limit still flows. The error contains the current and the limit.
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
                f"{name}: {current_A:.2f} A measured although the output was switched off; at most {limit_A:g} A "
                "counts as off",
                current_A,
                limit_A,
            )
        clock.sleep(MEASURE_EVERY_S)


def switch_off(supply: PowerSupply, clock: Clock) -> Off | None:
    """Switch a supply off and measure its current, even if its driver's `safe_off` does not measure.

    Parameters
    ----------
    supply : PowerSupply
        The open supply.
    clock : Clock
        The clock of the supply.

    Returns
    -------
    Off or None
        The measured current and the limit; None if the supply cannot measure a current.

    Raises
    ------
    SwitchOffFailed
        The supply could not be switched off, or a current still flows.
    InstrumentError
        The driver does not measure in `safe_off`, and the supply does not answer.
    """
    off = supply.safe_off()
    if isinstance(off, Off):
        return off
    if not getattr(supply, "measures_current", True):
        return None
    return measured_off(supply.measure, off_limit_A(supply), clock)
