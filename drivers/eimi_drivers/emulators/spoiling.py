"""Begin and end the faults of an emulated supply, of its coil, and of its line (the connection to the supply)."""

from __future__ import annotations

from eimi_drivers.emulators.faults import (
    DRIFTS_TO_A,
    HUNTING_A,
    OFFSET_A,
    RESTARTS_WITHIN_S,
    SHORTED_A,
    Fault,
    FaultyInstrument,
)
from eimi_drivers.emulators.genesys import GenesysDialect
from eimi_drivers.emulators.scpi import ScpiDialect
from eimi_drivers.emulators.serve import emulate
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Clock
from eimi_drivers.supplies.transport import Responder

OTHER_SERIAL_NUMBER = "ANOTHER1"


def begin_fault(fault: Fault, driver: str, coil: CoilSupply, line: FaultyInstrument) -> None:
    """Begin a fault of an emulated supply, of its coil, or of its line (the connection to the supply).

    Parameters
    ----------
    fault : Fault
        The fault.
    driver : str
        The name of the family of supplies in `DIALECTS`.
    coil : CoilSupply
        The model of the supply and its coil.
    line : FaultyInstrument
        The emulated supply on its line.
    """
    match fault:
        case Fault.SHORTED:
            coil.shorted_A = SHORTED_A
        case Fault.DRIFT:
            coil.drift(DRIFTS_TO_A)
        case Fault.FALLEN:
            coil.fallen = True
        case Fault.OFFSET:
            coil.offset_A = OFFSET_A
        case Fault.LOCKED:
            coil.locked = True
        case Fault.HUNTING:
            coil.hunting_A = HUNTING_A
        case Fault.TRIP:
            coil.trip()
        case Fault.BROWNOUT:
            coil.restart()
            line.instrument = emulate(driver, coil)
            line.be_silent(RESTARTS_WITHIN_S)
        case Fault.SWAP:
            line.swap(another_unit(driver, coil.clock))
        case _:
            line.inject(fault)


def end_faults(coil: CoilSupply, line: FaultyInstrument) -> None:
    """End the present faults of an emulated supply, of its coil, and of its line (the connection to the supply).

    If the fault SWAP has replaced the supply by another supply, the other supply still answers.
    """
    coil.shorted_A = coil.offset_A = coil.hunting_A = 0.0
    coil.fallen = coil.locked = False
    coil.drift(0.0, 0.0)
    line.inject(None)
    line.be_silent(0.0)


def another_unit(driver: str, clock: Clock) -> Responder:
    """Return a second emulated supply of the same model, with another serial number; its output is off.

    `driver` is the name of the family of supplies in `DIALECTS`.
    """
    unit = emulate(driver, CoilSupply(clock))
    if isinstance(unit, ScpiDialect):
        fields = unit.identification.split(",")
        unit.identification = ",".join([*fields[:2], OTHER_SERIAL_NUMBER, *fields[3:]])
    elif isinstance(unit, GenesysDialect):
        unit.serial_number = OTHER_SERIAL_NUMBER
    return unit
