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
    """An open supply of the driver that is checked, and the emulated instrument with a coil to which it is connected.

    Parameters
    ----------
    supply : PowerSupply
        The supply that the driver opened with `LIMITS`.
    coil : CoilSupply
        The model of the emulated supply and its coil.
    line : FaultyInstrument
        The emulated instrument with its command language, into which faults can be injected.
    clock : Clock
        The clock of the driver and of the emulated instrument.
    bipolar : bool
        True if the driver can set negative currents.
    address : str
        The address at which the supply was opened.
    sent : list of bytes
        The messages that the driver has sent. Always empty if the emulated instrument is served at an address.
    open_again : callable
        Opens the emulated instrument with the driver once more and returns the supply.
    answer_within_s : float
        The longest permitted duration of a query without an answer, s.
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
        """Set the voltage and the current (A), switch the output on, and wait until the coil's current is constant."""
        self.supply.set_voltage(LIMITS.voltage_V)
        self.supply.set_current(current_A)
        self.supply.set_output(True)
        self.clock.sleep(SETTLED_AFTER_S)

    def energised(self) -> bool:
        """Return whether the emulated supply gives current: its output is on, and its current set-point is not zero.

        The output may stay on without a current, because some drivers switch off by a current of zero.
        """
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
        The driver.
    emulator : callable
        Takes a `CoilSupply` and returns the emulated instrument, whose `receive(data: bytes) -> bytes` answers
        messages.
    serve : callable, optional
        A context manager that makes the emulated instrument reachable and yields the instrument's address. If `serve`
        is None, a driver with `connect` is connected in this process in simulated time, and a driver without `connect`
        through a pseudo-terminal.
    answer_within_s : float
        The longest permitted duration of a query without an answer, s.
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
