"""Read Lake Shore 425 and 475 gaussmeters without changing a setting."""

from __future__ import annotations

from typing import ClassVar

from eimi_drivers.interfaces import SensorReading
from eimi_drivers.sensors.base import SensorBase

MILLITESLA: dict[str, float] = {"1": 0.1, "2": 1000.0, "3": 0.1, "4": 4e-4 * 3.141592653589793}
"""The size of the sensor's unit in mT, by the answer to ``UNIT?``.

"1" is gauss, "2" is tesla, "3" is oersted, and "4" is A/m (in air).
"""


class LakeShore425(SensorBase):
    """Driver of a Lake Shore 425 gaussmeter on USB.

    Source: Model 425 User's Manual, section 6.3.1, pages 52 and 57.
    """

    name: str = "lakeshore-425"
    baud_rate: ClassVar[int] = 57600
    data_bits: ClassVar[int] = 7
    parity: ClassVar[str] = "O"

    def read(self) -> SensorReading:
        """Return the measured field, mT."""
        unit = self._ask("UNIT?").strip()  # a person can change the unit at the front panel
        if unit not in MILLITESLA:
            raise self._not_understood("UNIT?", unit, f"one of {', '.join(MILLITESLA)}")
        field = self._number("RDGFIELD?", self._ask("RDGFIELD?"), "+123.450E-03")
        return self._reading(MILLITESLA[unit] * field, "mT")


class LakeShore475(LakeShore425):
    """Driver of a Lake Shore 475 gaussmeter on a serial port or on GPIB.

    Source: Model 475 User's Manual, sections 6.0 and 6.3, pages 6-1 and 6-37 f.
    """

    name: str = "lakeshore-475"
    baud_rate: ClassVar[int] = 9600
    ends_with: ClassVar[bytes] = b"\r\n"
