"""Run a protocol with a supply that eimi_lab does not contain and that has SCPI commands of its own."""

import eimi_lab as eimi
from eimi_drivers.supplies.profile import Profile
from eimi_drivers.supplies.scpi import scpi_driver

eimi.SUPPLIES["mine"] = scpi_driver(
    Profile("mine", on=("OUTP ON",), off=("OUTP OFF",), measure_current="MEAS:CURR:DC?")
)
result = [state.current_A for state in eimi.acquire("protocol.toml", "specimen.toml", "rig.toml", "mine.h5").states]
