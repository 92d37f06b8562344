"""Lake Shore 425 and 475 gaussmeters.

Every query is in the manuals. The drivers change no setting: range, filter, unit and the zero of the probe keep the
values of the front panel.
"""

from __future__ import annotations

from typing import ClassVar

from eimi_drivers.interfaces import SensorReading
from eimi_drivers.sensors.base import SensorBase

MILLITESLA: dict[str, float] = {"1": 0.1, "2": 1000.0, "3": 0.1, "4": 4e-4 * 3.141592653589793}
"""Millitesla for each unit that ``UNIT?`` can name: gauss, tesla, oersted and A/m (of air)."""


class LakeShore425(SensorBase):
    """Read the field of a Lake Shore 425 over USB, a serial port of 57600 baud, 7 data bits and odd parity.

    ``*IDN?`` answers with maker, model, serial number and firmware (Model 425 User's Manual, section 6.3.1, page 52),
    ``UNIT?`` with the unit of all readings (page 57), ``RDGFIELD?`` with the field, such as ``+123.450E-03`` (section
    6.3.1, table of commands). The meter states no uncertainty of a reading; the rig file can state one.
    """

    name: str = "lakeshore-425"
    baud_rate: ClassVar[int] = 57600
    data_bits: ClassVar[int] = 7
    parity: ClassVar[str] = "O"

    def read(self) -> SensorReading:
        """Ask for the unit and for the field, mT.

        The unit is asked each time, because a person can change it at the front panel.
        """
        unit = self._ask("UNIT?").strip()
        if unit not in MILLITESLA:
            raise self._not_understood("UNIT?", unit, f"one of {', '.join(MILLITESLA)}")
        field = self._number("RDGFIELD?", self._ask("RDGFIELD?"), "+123.450E-03")
        return self._reading(MILLITESLA[unit] * field, "mT")


class LakeShore475(LakeShore425):
    """Read the field of a Lake Shore 475 over its serial port (9600 baud, 7 data bits, odd parity) or over GPIB.

    The queries are those of the 425. The serial interface has the commands of the IEEE-488 interface (Model 475 User's
    Manual, sections 6.0 and 6.3, pages 6-1 and 6-37 f.).
    """

    name: str = "lakeshore-475"
    baud_rate: ClassVar[int] = 9600
    ends_with: ClassVar[bytes] = b"\r\n"
