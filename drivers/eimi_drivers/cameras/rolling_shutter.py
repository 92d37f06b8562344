"""Compute the time between the exposures of neighbouring rows of a rolling shutter."""

from __future__ import annotations

SHUTTER_FEATURES = ("SensorShutterMode", "ShutterMode")
"""Names of the feature that contains the kind of shutter: in GenICam SFNC 2.7, and on the Basler ace."""

READOUT_FEATURE = "SensorReadoutTime"
"""Name of the feature that contains the readout time of all rows, µs."""


def row_time_s(shutter: str, readout_us: float | None, rows: int) -> float | None:
    """Return the time between the exposures of neighbouring rows, s; 0 for a global shutter, None if unknown.

    Source: Basler ace USB 3.0, User's Manual AW00123409, pages 145 and 147.

    Parameters
    ----------
    shutter : str
        The kind of shutter, such as "Global" or "Rolling".
    readout_us : float or None
        The readout time of all rows, µs.
    rows : int
        The number of rows of the image.

    Returns
    -------
    float or None
        The time, s.
    """
    if shutter == "Global":
        return 0.0
    return readout_us / 1e6 / rows if shutter == "Rolling" and readout_us else None
