"""Before a run, make sure that the output of the supply is off: switch it off, or raise an error."""

from __future__ import annotations

from eimi_drivers.interfaces import InstrumentError, SwitchOffFailed
from eimi_drivers.supplies.off import off_limit_A
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.events import OffNotConfirmed, OnEvent
from eimi_lab.acquisition.open_bench import Bench
from eimi_lab.acquisition.open_coil import CoilBench
from eimi_lab.acquisition.switching_off import switching_off
from eimi_lab.config.protocol import Ramp

SWITCH_OFF_FIRST = ", and --take-over switches it off first"
"""What a person at a terminal can do if the output of the supply is on before a run."""

AT_THE_SUPPLY = "; switch it off at the supply"
"""What a person can do if a command without the option --take-over finds the output on."""


def begin_with_output_off(
    bench: Bench | CoilBench,
    ramp: Ramp,
    take_over: bool,
    simulated: bool,
    on_event: OnEvent,
    instruction: str = SWITCH_OFF_FIRST,
) -> None:
    """Make sure that the output of the supply is off before a run begins.

    Parameters
    ----------
    bench : Bench or CoilBench
        The open instruments.
    ramp : Ramp
        Rate and step of the ramp to zero current.
    take_over : bool
        Whether an output that is on is switched off; otherwise InstrumentError is raised.
    simulated : bool
        Whether the supply is simulated.
    on_event : OnEvent
        Receives the events (records of what happened).
    instruction : str
        What a person can do if the output is on; the end of the error message.

    Raises
    ------
    InstrumentError
        If the output is on and `take_over` is false, or if the supply fails.
    SwitchOffFailed
        If the coil could not be confirmed off, or a current is measured although the output is off.
    Stopped
        If a signal came while the output was switched off.
    """
    supply = bench.supply
    if simulated and not supply.output_on():
        return
    reading = supply.measure()
    if not supply.output_on():
        limit_A = off_limit_A(supply)
        if getattr(supply, "measures_current", True) and abs(reading.current_A) > limit_A:
            reason = (
                f"{supply.identify().address}: {reading.current_A:.3f} A measured although the output is off; the "
                f"output counts as off at {limit_A:g} A or less"
            )
            on_event(OffNotConfirmed(by="run", reason=reason, current_A=reading.current_A, limit_A=limit_A))
            raise SwitchOffFailed(reason, reading.current_A, limit_A)
        return
    if not take_over:
        reason = (
            f"{supply.identify().address}: the output is on ({reading.current_A:.3f} A, {reading.voltage_V:.2f} V); "
            "another program may use the supply or may have crashed; a run begins with the output off"
            f"{instruction}"
        )
        on_event(OffNotConfirmed(by="run", reason=reason))
        raise InstrumentError(reason)
    limit = supply.limits.current_A
    coil = Coil(supply, bench.clock, ramp, asked_A=max(-limit, min(reading.current_A, limit)))
    with switching_off(coil, bench.guardian, bench.interruption, on_event):
        return
