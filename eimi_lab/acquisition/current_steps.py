"""Refuse currents that lie between the steps in which the supply sets its current."""

from __future__ import annotations

from decimal import Decimal

from eimi_drivers.interfaces import PowerSupply
from eimi_lab.config.protocol import Protocol
from eimi_lab.process.errors import InputError


def refuse_between_steps(protocol: Protocol, supply: PowerSupply) -> None:
    """Raise InputError if the supply cannot set a current of the run exactly.

    The driver would round the current toward zero, and the dataset would contain a field that was never set. Nothing is
    refused if the driver does not state its step `current_step_A`. `supply` was identified before.
    """
    step = getattr(supply, "current_step_A", None)
    if step is None:
        return
    places = [(f"state {state}", current_A) for state, current_A in enumerate(protocol.currents_A)]
    if protocol.ring_down:
        places.append(("ring_down.from_A", protocol.ring_down_from_A))
    for place, current_A in places:
        current = Decimal(repr(round(current_A, 9)))  # drivers round in the same way
        if beyond := current % Decimal(str(step)):
            lower = current - beyond
            upper = lower + Decimal(str(step)).copy_sign(current)
            raise InputError(
                f"protocol {protocol.name}: the current at {place} is {current:f} A, but the supply sets its "
                f"current in steps of {step} A; use {lower.normalize():f} or {upper.normalize():f} A"
            )
