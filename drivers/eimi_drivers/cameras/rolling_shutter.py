"""Compute the time between neighbouring rows of a rolling shutter from values that the camera reports."""

from __future__ import annotations

SHUTTER_FEATURES = ("SensorShutterMode", "ShutterMode")
"""Names of the feature that contains the kind of shutter: in GenICam SFNC 2.7, and on the Basler ace."""

READOUT_FEATURE = "SensorReadoutTime"
"""Name of the feature that contains the readout time of all rows, µs."""


def row_time_s(shutter: str, readout_us: float | None, rows: int) -> float | None:
    """Return the time between the exposures of neighbouring rows, s.

    For a rolling shutter this time is the readout time of all rows divided by the number of rows (Basler ace USB 3.0,
    User's Manual AW00123409, pages 145 and 147).

    Parameters
    ----------
    shutter : str
        The kind of shutter that the camera reports: "Global", "Rolling" or another text.
    readout_us : float or None
        The readout time of all rows, µs; None if the camera does not report this time.
    rows : int
        The number of rows of the image.

    Returns
    -------
    float or None
        The time, s; 0 for a global shutter. None if the shutter is of another kind or the readout time is unknown.
    """
    if shutter == "Global":
        return 0.0
    return readout_us / 1e6 / rows if shutter == "Rolling" and readout_us else None
