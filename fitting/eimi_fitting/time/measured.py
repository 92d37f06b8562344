"""Measured motions of a beam: free vibrations and creep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Kind = Literal["ring_down", "creep"]


@dataclass(frozen=True)
class Motion:
    """A recorded free vibration or creep of a beam: positions of points on the centre line, or of tracked markers.

    Times are measured from the step of the load, if there is one.

    Parameters
    ----------
    kind : {"ring_down", "creep"}
        A free vibration ("ring_down"), or the slow motion after a step of the load ("creep").
    points_mm : ndarray, shape (n, p, 2)
        Positions (x, y) of p points in n frames, in the beam frame; NaN where a point was not visible.
    rest_mm : ndarray, shape (p, 2)
        Positions (x, y) of the points in the undeformed beam.
    time_s : ndarray, shape (n, p)
        Time of each point in each frame.
    sigma_mm : ndarray, shape (n, p)
        Standard deviation of the white noise in x and in y.
    exposure_s : float or None
        Exposure time of a frame; None if it is not known.
    from_A, to_A : float
        Current of the coil before and after the step of the load.
    step_uncertainty_s : float
        Standard uncertainty of the time of the step.
    history : tuple of (float, float)
        Earlier currents of the coil: time of the setting in s, and current in A.
    lost_frames : int
        Number of frames that are missing.
    tip_force_N : float
        Load along gravity that was taken away from the tip at the step.
    hanging_N : float
        Weight that hangs at the tip during the motion.
    label : str
        The name of the recording.

    Raises
    ------
    ValueError
        An array has a wrong shape, or the kind is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from eimi_fitting.time.measured import Motion
    >>> time = np.linspace(0, 1, 30)[:, None]
    >>> place = np.stack([np.full((30, 1), 30.0), np.sin(30 * time)], axis=-1)
    >>> flick = Motion("ring_down", place, np.array([[30.0, 0.0]]), time, np.full((30, 1), 0.01), label="flick")
    >>> flick.duration_s
    1.0
    """

    kind: Kind
    points_mm: Array
    rest_mm: Array
    time_s: Array
    sigma_mm: Array
    exposure_s: float | None = None
    # Both currents are 0 without a coil.
    from_A: float = 0.0
    to_A: float = 0.0
    step_uncertainty_s: float = 0.0
    # Times are relative to the step, and therefore negative.
    history: tuple[tuple[float, float], ...] = ()
    lost_frames: int = 0
    tip_force_N: float = 0.0
    hanging_N: float = 0.0
    label: str = ""

    def __post_init__(self) -> None:
        if self.kind not in ("ring_down", "creep"):
            raise ValueError(f"kind: {self.kind!r} should be ring_down or creep")
        frames, points = np.shape(self.time_s) if np.ndim(self.time_s) == 2 else (-1, -1)
        for name, shape in (
            ("points_mm", (frames, points, 2)),
            ("rest_mm", (points, 2)),
            ("sigma_mm", (frames, points)),
        ):
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(
                    f"{name}: the shape is {np.shape(getattr(self, name))}, but time_s has the shape "
                    f"{np.shape(self.time_s)} (frames, points)"
                )

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Whether each point was visible in each frame, (frames, points)."""
        return np.asarray(
            np.isfinite(self.points_mm).all(axis=2) & np.isfinite(self.time_s) & np.isfinite(self.sigma_mm)
        )

    @property
    def duration_s(self) -> float:
        """The time in s from the first to the last measurement of a visible point."""
        times = self.time_s[self.seen]
        return float(np.ptp(times)) if times.size else 0.0
