"""Serve an emulated supply in a separate process, which reports the current of the coil and simulates faults.

    python -m benchmarks.emulated_supply korad pty

The first argument is the driver of the supply. The second is the kind of connection: `pty` (a pseudo-terminal in place
of a serial port), `port` (a serial port that can be unplugged), `tcp` or `hislip`.

The script prints the address of the supply. It then prints a line of text for every change of the output, of the
set-point or of the true current. The line contains four values: the time (s) on the monotonic clock, which all
processes of a machine share; 1 if the output is on, otherwise 0; the current set-point (A); and the true current (A).

A fault begins when its name, such as `shorted`, is written to the standard input of the script; ``eimi emulate
--faults`` lists the names. In this script, `slow` delays answers by 0.4 s. The script knows two more words: `contact`
causes a bad contact that adds 6 ohm to the leads of the coil, and `none` ends all faults.
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
    """A supply with a coil whose leads have a bad contact of resistance `contact_ohm` (ohm).

    The measured voltage includes the voltage across the contact.
    """

    contact_ohm = 0.0

    def read(self) -> Reading:
        """Return the values that the meters of the supply show."""
        measured = super().read()
        return replace(measured, voltage_V=measured.voltage_V + self.contact_ohm * measured.current_A)


SERVE = {"pty": serve_pty, "port": serve_port, "tcp": serve_tcp, "hislip": serve_hislip}


def main() -> None:
    """Serve the emulated supply until the standard input ends."""
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
    """Write a line and its line break at once; with `print`, the lines of two threads could mix."""
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
