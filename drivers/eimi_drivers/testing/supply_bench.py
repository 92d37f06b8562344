"""Connect a supply driver to an emulated instrument that feeds a coil."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.contract import check_supply, check_supply_driver
from eimi_drivers.emulators.faults import FaultyInstrument
from eimi_drivers.emulators.serve import serve_pty
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Clock, Limits, PowerSupply, SupplyDriver
from eimi_drivers.supplies.supply_names import open_with
from eimi_drivers.supplies.transport import InProcessTransport, Responder

LIMITS = Limits(current_A=1.0, voltage_V=12.0)
RESISTANCE_OHM = 4.0
TIME_CONSTANT_S = 0.01
SETTLED_AFTER_S = 20 * TIME_CONSTANT_S
PATIENCE_S = 60.0
"""Largest duration (s of real time) of a call of a driver that runs in simulated time."""


@dataclass
class SupplyBench:
    """An open supply, and the emulated instrument with a coil to which it is connected.

    Parameters
    ----------
    supply : PowerSupply
        Open supply.
    coil : CoilSupply
        Model of the emulated supply and its coil.
    line : FaultyInstrument
        Emulated instrument that can produce faults.
    clock : Clock
        Clock of the driver and of the emulated instrument.
    bipolar : bool
        True if the driver can set negative currents.
    address : str
        Address of the supply.
    sent : list of bytes
        Messages of the driver; they are recorded only if the driver does not open the connection itself.
    open_again : callable
        Opens the supply once more and returns it.
    answer_within_s : float
        Time in s after which a query must fail if the instrument does not answer.
    """

    supply: PowerSupply
    coil: CoilSupply
    line: FaultyInstrument
    clock: Clock
    bipolar: bool
    address: str
    sent: list[bytes]
    open_again: Callable[[], PowerSupply]
    answer_within_s: float

    def energise(self, current_A: float = 0.7) -> None:
        """Set voltage and current (A), switch the output on, and wait until the current of the coil is constant."""
        self.supply.set_voltage(LIMITS.voltage_V)
        self.supply.set_current(current_A)
        self.supply.set_output(True)
        self.clock.sleep(SETTLED_AFTER_S)

    def energised(self) -> bool:
        """Return whether the output of the emulated supply is on and its current set-point is not zero."""
        return self.coil.state.output and self.coil.state.set_current_A != 0.0


@contextmanager
def supply_bench(
    open: SupplyDriver,
    emulator: Callable[[CoilSupply], Responder],
    serve: Callable[[Responder], AbstractContextManager[str]] | None = None,
    answer_within_s: float = 5.0,
) -> Iterator[SupplyBench]:
    """Connect a supply driver to an emulated instrument while the `with` block runs, and yield both as a `SupplyBench`.

    Parameters
    ----------
    open : SupplyDriver
        Driver.
    emulator : callable
        Takes a `CoilSupply` and returns an object whose `receive(data: bytes) -> bytes` answers messages.
    serve : callable, optional
        Context manager that yields the address of the emulated instrument, such as `serve_pty` or `serve_tcp`.
    answer_within_s : float
        Time in s after which a query must fail if the instrument does not answer.
    """
    with ExitStack() as stack:
        sent: list[bytes] = []
        name = str(getattr(open, "name", getattr(open, "__name__", "supply")))
        if serve is None and hasattr(open, "connect"):
            clock: Clock = SimulatedClock()
            coil, line = _instrument(clock, emulator)
            address = "in-process"

            def open_it() -> PowerSupply:
                check_supply_driver(name, open)
                link = InProcessTransport(line, clock, address)
                link.sent = sent
                supply = open(link, LIMITS, clock)
                check_supply(name, open, supply)
                return supply
        else:
            clock = WallClock()
            coil, line = _instrument(clock, emulator)
            address = stack.enter_context((serve or serve_pty)(line))

            def open_it() -> PowerSupply:
                return open_with(open, name, address, LIMITS, clock)

        supply = open_it()
        stack.callback(supply.close)
        bipolar = bool(getattr(open, "bipolar", False))
        yield SupplyBench(supply, coil, line, clock, bipolar, address, sent, open_it, answer_within_s)


def _instrument(clock: Clock, emulator: Callable[[CoilSupply], Responder]) -> tuple[CoilSupply, FaultyInstrument]:
    coil = CoilSupply(clock, resistance_ohm=RESISTANCE_OHM, time_constant_s=TIME_CONSTANT_S)
    return coil, FaultyInstrument(emulator(coil), clock)
