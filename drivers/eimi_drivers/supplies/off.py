"""Switch a supply off and measure that no current flows.

A supply with a failed regulator may report that its output is off while a current flows. A supply therefore counts as
off only if its measured current is not above a limit. The limit is the largest current that a healthy supply measures
when no current flows.
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


def confirmed_off(measure: Callable[[], Reading], limit_A: float, clock: Clock, name: str) -> Off:
    """Measure the current of a supply that was switched off, until its magnitude is at most `limit_A`.

    If the supply does not answer, the measurement is begun again, up to `MEASURING_ATTEMPTS` times in all.

    Parameters
    ----------
    measure : callable
        Measures the output.
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
    """Carry out all stages of switching a supply off, also after a failed stage, and return an error that lists them.

    Two stages with the same name are parts of one action. If the first part has failed, the second part is left out.

    Parameters
    ----------
    stages : sequence of (str, callable)
        The name of each stage for the message, and the function that carries it out.
    name : str
        The address of the supply, for the message.

    Returns
    -------
    SwitchOffFailed or None
        The error with the outcome of every stage, whose cause is the first error; None if no stage failed.
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
