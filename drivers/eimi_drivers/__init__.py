"""Power supplies, cameras and sensors: their interfaces, their drivers, and emulators that replace the instruments.

interfaces    what a supply, a camera and a sensor must offer, and the errors that they raise
contract      check a driver against the interfaces
installed     find a driver by its name: a driver of this package, of another package, or added by a program
supplies      drivers of power supplies; `open_supply` opens one by name
cameras       drivers of cameras; `open_camera` opens one by name
sensors       drivers of gaussmeters and other sensors; `open_sensor` opens one by name
emulators     emulated supplies with a coil, and emulated sensors, for tests and for work without hardware
testing       checks that test a driver, also a driver of another package
serial_ports  list the serial ports of this computer
lan_instruments  list the instruments that announce themselves on the network
discovery     list the instruments that are attached
clock         a clock of real seconds for real instruments, and a clock of simulated seconds for simulated instruments

This package handles set-points, measured values and pixels only. The package imports neither `eimi_lab` nor
`eimi_fitting`.
"""

import logging

logging.getLogger(__name__).addHandler(logging.NullHandler())
