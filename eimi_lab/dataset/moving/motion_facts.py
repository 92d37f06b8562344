"""Facts that the user gives about the recording of a motion, because the recording does not contain them."""

from __future__ import annotations

from dataclasses import dataclass

from eimi_fitting.time.measured import Kind


@dataclass(frozen=True, kw_only=True)
class MotionFacts:
    """Facts that the user gives about the recording of a motion; None for a fact that is not given.

    Parameters
    ----------
    kind : {"ring_down", "creep"}
        "ring_down" if the beam swings freely, "creep" if the beam creeps under a constant load.
    rate_Hz : float, optional
        Frames per second of the recording. The times of the frames are then computed from this rate, and the times in
        the file are ignored. A video that is played in slow motion needs this rate.
    released_s : float, optional
        Time in the recording, in s, at which the beam was released, or at which the load of the beam changed.
    hanging_N : float
        Weight that hangs at the tip during the motion, N. For creep without ``removed_N``, this weight was hung on the
        beam at the time ``released_s``.
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
