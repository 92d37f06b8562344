"""Facts that the user gives about the recording of a motion."""

from __future__ import annotations

from dataclasses import dataclass

from eimi_fitting.time.measured import Kind


@dataclass(frozen=True, kw_only=True)
class MotionFacts:
    """Facts that the user gives about the recording of a motion; None for a fact that is not given.

    Parameters
    ----------
    kind : {"ring_down", "creep"}
        "ring_down" for free oscillations, "creep" for creep under a constant load.
    rate_Hz : float, optional
        Frames per second of the recording; it replaces the times in the file.
    released_s : float, optional
        Time in the recording at which the beam was released, or at which its load changed, s.
    hanging_N : float
        Weight that hangs at the tip during the motion, N.
    removed_N : float
        Weight that was taken from the tip at the time ``released_s``, N.
    exposure_s : float, optional
        Exposure time of a frame, s.
    row_time_s : float
        Time between the exposures of two neighbouring rows of the sensor, s; 0 for a global shutter.
    """

    kind: Kind
    rate_Hz: float | None = None
    released_s: float | None = None
    hanging_N: float = 0.0
    removed_N: float = 0.0
    exposure_s: float | None = None
    row_time_s: float = 0.0
