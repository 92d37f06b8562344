"""Facts about the recording of a motion that no file contains and a person states."""

from __future__ import annotations

from dataclasses import dataclass

from eimi_fitting.time.measured import Kind


@dataclass(frozen=True, kw_only=True)
class MotionFacts:
    """Stated facts of a recording; None for a fact that is not stated.

    Parameters
    ----------
    kind : {"ring_down", "creep"}
        Whether the beam swings freely, or creeps under a load that no longer changes.
    rate_Hz : float, optional
        Frames per second; it replaces the times of the file. A video in slow motion needs it.
    released_s : float, optional
        Time in the recording at which the beam was released, or its load changed.
    hanging_N : float
        Weight that hangs at the tip during the motion.
    removed_N : float
        Weight that was taken from the tip at the release.
    exposure_s : float, optional
        Exposure of a frame.
    row_time_s : float
        Time from one row of the picture to the next below; 0 for a global shutter.
    """

    kind: Kind
    rate_Hz: float | None = None
    released_s: float | None = None
    hanging_N: float = 0.0
    removed_N: float = 0.0
    exposure_s: float | None = None
    row_time_s: float = 0.0
