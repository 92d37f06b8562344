"""Find the line at which the beam leaves its clamp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.profiles import AVERAGED_PX, fit_steps, read_profiles, stations

Array = NDArray[np.float64]

SEARCH_MM = 0.5  # on both sides of the calibrated line
_CLEAR_OF_BEAM_PX = 8.0  # from the beam's edge, beyond its blur
_STEP_SHARE = 0.3  # of the back-light; a fainter step beside the beam is not the edge of the clamp


@dataclass(frozen=True)
class ClampLine:
    """The line in an image at which the beam leaves its clamp.

    Attributes
    ----------
    point_px : ndarray, shape (2,)
        A point on the line.
    ahead : ndarray, shape (2,)
        Unit vector perpendicular to the line, away from the clamp.
    visible_share : float
        Share of the places beside the beam at which the clamp's edge is visible.
    """

    point_px: Array
    ahead: Array
    visible_share: float

    def distance_px(self, points_px: Array) -> Array:
        """Return the distance (px) of points from the clamp line; positive on the side of the beam."""
        return (points_px - self.point_px) @ self.ahead


def find_clamp_line(image: NDArray[Any], frame: BeamFrame, width_mm: float, back_light: float) -> ClampLine:
    """Find the edge of the clamp on both sides of the beam.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey values with a dark beam and a dark clamp.
    frame : BeamFrame
        Clamp and axis of the calibration.
    width_mm : float
        Width of the specimen at the clamp.
    back_light : float
        Grey value of the back-light beside the beam.

    Returns
    -------
    ClampLine
        The edge of the clamp; if it is not visible, the clamp line of the calibration.
    """
    origin, ahead_mm, across_mm = frame.to_px([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    scale = float(np.linalg.norm(ahead_mm - origin))
    ahead, across = (ahead_mm - origin) / scale, (across_mm - origin) / np.linalg.norm(across_mm - origin)

    width = width_mm * scale
    beside = np.arange(0.5 * width + _CLEAR_OF_BEAM_PX, 0.75 * width + 2.0 * _CLEAR_OF_BEAM_PX, AVERAGED_PX)
    beside = np.concatenate([-beside, beside])
    lines = beside[:, None] + np.arange(AVERAGED_PX) - 0.5 * (AVERAGED_PX - 1)
    reach = max(SEARCH_MM * scale, 8.0)
    stations_px = stations(1.5 * reach, 1.5 * reach)
    profiles, inside = read_profiles(
        image, origin + lines[..., None] * across, np.broadcast_to(ahead, (*lines.shape, 2)), stations_px
    )
    steps = fit_steps(stations_px, profiles)
    shows_clamp = inside & steps.sound & (steps.bright - steps.dark > _STEP_SHARE * back_light)
    shows_clamp &= np.abs(steps.offset_px) < reach
    if shows_clamp.any():
        shows_clamp &= np.abs(steps.offset_px - np.median(steps.offset_px[shows_clamp])) < max(2.0, 0.2 * reach)
    share = float(shows_clamp.mean())
    if share < 0.5:
        return ClampLine(origin, ahead, share)
    offset, tilt = float(steps.offset_px[shows_clamp].mean()), 0.0
    if shows_clamp[beside < 0.0].sum() > 1 and shows_clamp[beside > 0.0].sum() > 1:
        tilt, offset = (float(value) for value in np.polyfit(beside[shows_clamp], steps.offset_px[shows_clamp], 1))
    square = ahead - tilt * across
    return ClampLine(origin + offset * ahead, square / np.linalg.norm(square), share)
