"""Serve an emulated supply that can have a fault, and report the true current in its coil."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.coil_line import serve_coil
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.serial_port import serve_port
from eimi_drivers.emulators.serve import emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.spoiling import begin_fault
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.supplies.transport import Responder

LOOK_EVERY_S = 0.05
LEAST_CHANGE_A = 0.02
"""The smallest change (A) of the true current that is reported."""

OPEN_OHM = 1e9
"""Resistance (ohm) of an output to which nothing is connected."""

AWAY_FOR_S = 1.0
"""Time (s) for which a supply cannot be reached before it is served at another address."""


class EmulatedSession:
    """An emulated supply on a serial port or a TCP port, with at most one fault.

    Parameters
    ----------
    driver : str
        The name of the family of supplies in `DIALECTS`.
    tcp : int or None
        The TCP port; 0 selects a free port. None serves the supply on a pseudo-terminal.
    fault : Fault or None
        The fault; None for no fault.
    after_s : float
        The time until the fault begins, s, from the moment at which the output is on and the current set-point is not
        zero.
    say : callable
        Takes the texts for the user.
    coil : CoilSupply, optional
        The model of the supply and its coil; by default a supply with a coil of 4 ohm.
    address : str
        The address of the supply in the rig file, which contains the channel that feeds the coil.
    announce : callable, optional
        Called with two addresses each time that the supply becomes reachable: the address of the supply, and the
        address at which a virtual camera or gaussmeter reads the true current.
    look : callable, optional
        Called repeatedly while the supply is served. If it raises an error, the session ends.
    """

    def __init__(
        self,
        driver: str,
        tcp: int | None,
        fault: Fault | None,
        after_s: float,
        say: Callable[[str], None],
        *,
        coil: CoilSupply | None = None,
        address: str = "",
        announce: Callable[[str, str], None] | None = None,
        look: Callable[[], None] = lambda: None,
    ) -> None:
        self._driver, self._tcp, self._fault, self._after_s, self._say = driver, tcp, fault, after_s, say
        self._announce, self._look = announce or self._say_addresses, look
        self._clock = WallClock()
        self._coil = coil or CoilSupply(self._clock)
        self._line = FaultyInstrument(emulate(driver, self._coil, address), self._clock)
        self._began_s = self._clock.now()
        self._energised_s: float | None = None
        self._begun = False
        self._reported: tuple[bool, float, float] | None = None

    def serve(self) -> None:
        """Serve the emulated supply until the program is interrupted."""
        ports = 0
        with serve_coil(self._coil) as coil_line:
            while True:
                with self._serve(ports) as address:
                    self._announce(address, coil_line)
                    self._watch()
                ports += 1
                self._clock.sleep(AWAY_FOR_S)
                self._line.reconnect()

    def _say_addresses(self, address: str, coil_line: str) -> None:
        self._say(f'driver = "{self._driver}"\naddress = "{address}"')
        self._say(f'# for a virtual beam in its coil: camera = {{ driver = "virtual", source = "{coil_line}" }}')
        self._say(f"# for an emulated gaussmeter in its coil: eimi emulate lakeshore-425 --coil {coil_line}")

    def _serve(self, ports: int) -> AbstractContextManager[str]:
        if self._tcp is not None:
            return serve_tcp(self._line, port=self._tcp if ports == 0 else 0)
        return serve_pty(self._line) if self._fault is None else serve_port(self._line, f"ttyEMULATED{ports}")

    def _watch(self) -> None:
        # Returns when the fault REENUMERATE has cut the connection. With other faults only an error ends the loop.
        leaves = self._fault is Fault.REENUMERATE
        while not (leaves and self._line.lost):
            self._let_watchdog_act(self._line.instrument)
            self._look()
            if self._fault is not None:
                self._begin_in_time(self._fault)
                self._report()
            self._clock.sleep(LOOK_EVERY_S)

    @staticmethod
    def _let_watchdog_act(instrument: Responder) -> None:
        if watch := getattr(instrument, "watch", None):
            watch()

    def _begin_in_time(self, fault: Fault) -> None:
        state = self._coil.state
        now_s = self._clock.now()
        if self._energised_s is None and state.output and state.set_current_A:
            self._energised_s = now_s
        if not self._begun and self._energised_s is not None and now_s - self._energised_s >= self._after_s:
            self._begun = True
            begin_fault(fault, self._driver, self._coil, self._line)
            self._say(f"# {now_s - self._began_s:.2f} s: the fault {fault.word} begins: {fault.effect}")

    def _report(self) -> None:
        state = self._coil.state
        true_A = self._coil.coil_current_A()
        if self._reported is not None:
            output, set_A, reported_A = self._reported
            if (output, set_A) == (state.output, state.set_current_A) and abs(true_A - reported_A) <= LEAST_CHANGE_A:
                return
        self._reported = (state.output, state.set_current_A, true_A)
        self._say(
            f"# {self._clock.now() - self._began_s:.2f} s: output {'on' if state.output else 'off'}, "
            f"{state.set_current_A:.3f} A set, {true_A:.3f} A in the coil"
        )
