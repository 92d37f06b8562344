"""Test the behaviour of a new driver of a supply, a camera or a sensor, without a test framework.

supply_checks   the checks of a supply driver; `check_supply` runs all of them
camera_checks   the checks of a camera driver; `check_camera` runs all of them
sensor_checks   the checks of a sensor driver; `check_sensor` runs all of them
supply_bench    connect a supply driver to an emulated instrument with a coil
claims          raise an error if a driver does not do what a check requires
"""

from eimi_drivers.testing.camera_checks import CAMERA_CHECKS, check_camera
from eimi_drivers.testing.sensor_checks import SENSOR_CHECKS, SensorBench, check_sensor, sensor_bench
from eimi_drivers.testing.supply_bench import SupplyBench, supply_bench
from eimi_drivers.testing.supply_checks import SUPPLY_CHECKS, check_supply

__all__ = [
    "CAMERA_CHECKS",
    "SENSOR_CHECKS",
    "SUPPLY_CHECKS",
    "SensorBench",
    "SupplyBench",
    "check_camera",
    "check_sensor",
    "check_supply",
    "sensor_bench",
    "supply_bench",
]
