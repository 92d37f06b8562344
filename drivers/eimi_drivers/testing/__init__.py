"""Conformance suites for supplies and cameras, for whoever writes a driver.

`check_supply` puts a driver on an emulated instrument with a coil, and `check_camera` opens a camera or its stand-in;
each raises one AssertionError that says in words what does not hold. Both need no test framework. `SUPPLY_CHECKS` and
`CAMERA_CHECKS` are the single checks, for a framework that shows each as a test of its own.
"""

from eimi_drivers.testing.camera_checks import CAMERA_CHECKS, check_camera
from eimi_drivers.testing.supply_bench import SupplyBench, supply_bench
from eimi_drivers.testing.supply_checks import SUPPLY_CHECKS, check_supply

__all__ = ["CAMERA_CHECKS", "SUPPLY_CHECKS", "SupplyBench", "check_camera", "check_supply", "supply_bench"]
