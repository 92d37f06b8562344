"""Drivers of power supplies, cameras and sensors, and emulators (software that behaves like an instrument).

interfaces    the methods of a supply, a camera and a sensor, and the errors that they raise
contract      check that a driver has the required methods
installed     find a driver by its name
supplies      drivers of power supplies; `open_supply` opens a supply by name
cameras       drivers of cameras; `open_camera` opens a camera by name
sensors       drivers of gaussmeters and other sensors; `open_sensor` opens a sensor by name
emulators     emulated supplies with a coil, and emulated sensors
testing       test the behaviour of a driver
serial_ports  list the serial ports of this computer
lan_instruments  list the instruments that announce themselves on the network
discovery     list the instruments that are attached
clock         a clock of real seconds, and a clock of simulated seconds
"""

import logging

logging.getLogger(__name__).addHandler(logging.NullHandler())
