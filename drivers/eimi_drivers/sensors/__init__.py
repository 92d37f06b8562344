"""Drivers of gaussmeters, thermometers and other sensors; `open_sensor` opens a sensor by the name of its driver.

sensor_names      the drivers by name
base              the functions of every driver: send a query, read one line
lake_shore        Lake Shore 425 and 475 gaussmeters
fw_bell           F.W. Bell 5080 gaussmeters
coil_thermometer  the coil as a thermometer: its resistance increases with its temperature
text_line         a microcontroller board that answers in lines of text
foreign           every error of another package's sensor driver as an InstrumentError
"""

from eimi_drivers.sensors.sensor_names import SENSORS, open_sensor

__all__ = ["SENSORS", "open_sensor"]
