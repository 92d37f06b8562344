"""Serve an emulated power supply in a separate process, and cause faults on request.

    python -m benchmarks.emulated_supply DRIVER CONNECTION

CONNECTION is `pty` (a pseudo-terminal), `port` (a serial port that can be unplugged), `tcp` or `hislip`. The script
prints the address, and a line for every change of output, set-point or true current: the time (s, monotonic clock), 1
or 0 for the output, the set-point (A) and the true current (A).

A fault begins when its name (see ``eimi emulate --faults``) is written to the standard input. Further words are
`contact` (6 ohm more in the leads of the coil) and `none` (all faults end). `slow` delays answers by 0.4 s.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.hislip import serve_hislip
from eimi_drivers.emulators.serial_port import serve_port
from eimi_drivers.emulators.serve import emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.spoiling import begin_fault, end_faults
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Reading

WATCH_EVERY_S = 0.002
LATE_S = 0.4
CONTACT_OHM = 6.0
LEAST_CHANGE_A = 0.02


class CoilOnLeads(CoilSupply):
    """A supply whose coil leads have the additional resistance `contact_ohm` (ohm)."""

    contact_ohm = 0.0

    def read(self) -> Reading:
        measured = super().read()
        return replace(measured, voltage_V=measured.voltage_V + self.contact_ohm * measured.current_A)


SERVE = {"pty": serve_pty, "port": serve_port, "tcp": serve_tcp, "hislip": serve_hislip}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("driver")
    parser.add_argument("transport", choices=SERVE)
    chosen = parser.parse_args()
    coil = CoilOnLeads(WallClock())
    instrument = emulate(chosen.driver, coil)
    line = FaultyInstrument(instrument, late_s=LATE_S)
    threading.Thread(target=_watch, args=(coil, getattr(instrument, "watch", None)), daemon=True).start()
    with SERVE[chosen.transport](line) as address:
        _write_line(address)
        for word in sys.stdin:
            if word.strip() == "none":
                end_faults(coil, line)
                coil.contact_ohm = 0.0
            elif word.strip() == "contact":
                coil.contact_ohm = CONTACT_OHM
            else:
                begin_fault(Fault[word.strip().upper()], chosen.driver, coil, line)


def _write_line(words: str) -> None:
    """Write a whole line at once, so that lines of two threads cannot mix."""
    sys.stdout.write(f"{words}\n")
    sys.stdout.flush()


def _watch(coil: CoilSupply, watchdog: Callable[[], None] | None) -> None:
    before: tuple[bool, float] | None = None
    printed_A = 0.0
    while True:
        if watchdog:
            watchdog()
        now = (coil.state.output, coil.state.set_current_A)
        true_A = coil.coil_current_A()
        if now != before or abs(true_A - printed_A) > LEAST_CHANGE_A:
            _write_line(f"{time.monotonic():.4f} {int(now[0])} {now[1]:g} {true_A:.3f}")
            before, printed_A = now, true_A
        time.sleep(WATCH_EVERY_S)


if __name__ == "__main__":
    main()
