"""Conformance suites for people who write a driver of a supply, a camera or a sensor. No test framework is needed.

supply_checks   the checks of a supply; `check_supply` runs them all
camera_checks   the checks of a camera; `check_camera` runs them all
sensor_checks   the checks of a sensor; `check_sensor` runs them all
supply_bench    a supply driver on an emulated instrument with a coil
claims          the claim of a check, and the error if the claim does not hold

`check_supply`, `check_camera` and `check_sensor` raise one AssertionError that lists every failed check.
`SUPPLY_CHECKS`, `CAMERA_CHECKS` and `SENSOR_CHECKS` are the single checks, for a test framework that reports each of
them separately.
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
