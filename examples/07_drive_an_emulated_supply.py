"""Control an emulated Korad supply and its coil. The commands are the same as for a real supply on a serial port."""

import time

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators import CoilSupply, emulate, serve_pty
from eimi_drivers.interfaces import InstrumentError, Limits
from eimi_drivers.supplies import open_supply


def main() -> float:
    """Return the measured current (A) at a set-point of 0.7 A."""
    coil = CoilSupply(WallClock(), resistance_ohm=4.0, time_constant_s=0.01)
    with serve_pty(emulate("korad", coil)) as address:
        supply = open_supply("korad", address, Limits(current_A=1.0, voltage_V=12.0))
        print(supply.identify().text)
        try:
            supply.set_voltage(12.0)
            supply.set_current(0.7)
            supply.set_output(True)
            time.sleep(0.2)
            current_A = supply.measure().current_A
            print(f"{current_A:.3f} A")
            supply.set_current(1.2)
        except InstrumentError as error:
            print(f"refused: {error}")
        finally:
            supply.safe_off()
            supply.close()
    assert not coil.state.output
    return current_A


if __name__ == "__main__":
    main()
