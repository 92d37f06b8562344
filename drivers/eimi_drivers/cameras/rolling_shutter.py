"""Compute the time between neighbouring rows of a rolling shutter from the values that a camera states."""

from __future__ import annotations

SHUTTER_FEATURES = ("SensorShutterMode", "ShutterMode")
"""The feature that states the kind of shutter: its name in GenICam SFNC 2.7, and its name on the Basler ace."""

READOUT_FEATURE = "SensorReadoutTime"
"""The feature that states the readout time of all rows, µs."""


def row_time_s(shutter: str, readout_us: float | None, rows: int) -> float | None:
    """Return the time between the exposures of neighbouring rows, s.

    It is the readout time of all rows divided by their number (Basler ace USB 3.0, User's Manual AW00123409, pages 145
    and 147).

    Parameters
    ----------
    shutter : str
        The kind of the shutter in the words of the camera: "Global", "Rolling" or another.
    readout_us : float or None
        The readout time of all rows, µs; None if the camera does not state it.
    rows : int
        The number of rows that are read.

    Returns
    -------
    float or None
        0 for a global shutter; None if the camera does not state what is needed.
    """
    if shutter == "Global":
        return 0.0
    return readout_us / 1e6 / rows if shutter == "Rolling" and readout_us else None
