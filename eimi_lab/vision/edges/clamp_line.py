"""The line at which the beam leaves its clamp, as the image shows it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.profiles import AVERAGED_PX, fit_steps, read_profiles, stations

Array = NDArray[np.float64]

SEARCH_MM = 0.5  # to both sides of the calibrated line
_CLEAR_OF_BEAM_PX = 8.0  # beyond the blur of the beam's own edge
_STEP_SHARE = 0.3  # of the back-light; a fainter step beside the beam is not the clamp's


@dataclass(frozen=True)
class ClampLine:
    """point_px (2,): a place on the line. ahead (2,): unit vector away from the clamp, square to the line.

    seen: share of the profiles beside the beam that show the clamp's edge; below one half the line is the
    calibration's.
    """

    point_px: Array
    ahead: Array
    seen: float

    def distance_px(self, points_px: Array) -> Array:
        """How far points (..., 2) are ahead of the line."""
        return (points_px - self.point_px) @ self.ahead


def find_clamp_line(image: NDArray[Any], frame: BeamFrame, width_mm: float, back_light: float) -> ClampLine:
    """Look for the clamp's lower edge to both sides of the beam, near where the calibration has it.

    back_light: the back-light's grey value there.
    """
    origin, ahead_mm, across_mm = frame.to_px([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    scale = float(np.linalg.norm(ahead_mm - origin))
    ahead, across = (ahead_mm - origin) / scale, (across_mm - origin) / np.linalg.norm(across_mm - origin)

    width = width_mm * scale
    beside = np.arange(0.5 * width + _CLEAR_OF_BEAM_PX, 0.75 * width + 2.0 * _CLEAR_OF_BEAM_PX, AVERAGED_PX)
    beside = np.concatenate([-beside, beside])
    lines = beside[:, None] + np.arange(AVERAGED_PX) - 0.5 * (AVERAGED_PX - 1)
    reach = max(SEARCH_MM * scale, 8.0)
    u = stations(1.5 * reach, 1.5 * reach)
    profiles, inside = read_profiles(
        image, origin + lines[..., None] * across, np.broadcast_to(ahead, (*lines.shape, 2)), u
    )
    steps = fit_steps(u, profiles)
    seen = inside & steps.sound & (steps.bright - steps.dark > _STEP_SHARE * back_light)
    seen &= np.abs(steps.offset_px) < reach
    if seen.any():
        seen &= np.abs(steps.offset_px - np.median(steps.offset_px[seen])) < max(2.0, 0.2 * reach)
    share = float(seen.mean())
    if share < 0.5:
        return ClampLine(origin, ahead, share)
    offset, tilt = float(steps.offset_px[seen].mean()), 0.0
    if seen[beside < 0.0].sum() > 1 and seen[beside > 0.0].sum() > 1:
        tilt, offset = (float(value) for value in np.polyfit(beside[seen], steps.offset_px[seen], 1))
    square = ahead - tilt * across
    return ClampLine(origin + offset * ahead, square / np.linalg.norm(square), share)
