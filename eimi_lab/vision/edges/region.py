"""The part of the pictures in which a person says the beam is, and nothing else of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.process.errors import InputError
from eimi_lab.vision.edges.edge_set import EdgeSet


@dataclass(frozen=True)
class Region:
    """A rectangle of the pictures. calibration: of what is in it, for pixels that are counted from its corner."""

    left: int
    top: int
    width: int
    height: int
    calibration: Calibration
    digest: str

    def cut(self, image: NDArray[Any]) -> NDArray[Any]:
        """What of an image (H, W) or (H, W, 3) is in it."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]

    def in_picture(self, found: EdgeSet) -> EdgeSet:
        """What was found in it, with corners counted from the picture's."""
        corners = found.corners_px + np.array([self.left, self.top])
        return replace(found, corners_px=corners, calibration_digest=self.digest)


def region_of(calibration: Calibration, shape: tuple[int, ...]) -> Region | None:
    """The region that a calibration states for pictures of a shape; None without one.

    Raises InputError for one that leaves the pictures, or in which the clamp is not.
    """
    if calibration.picture is None or calibration.picture.region_px is None:
        return None
    left, top, width, height = calibration.picture.region_px
    x, y = calibration.clamp_midpoint_px
    wrong = ""
    if left + width > shape[1] or top + height > shape[0]:
        wrong = f"should lie in the pictures of {shape[1]} x {shape[0]} px"
    elif not (left <= x < left + width and top <= y < top + height):
        wrong = f"should hold clamp_midpoint_px = {[x, y]}, where the beam begins"
    if wrong:
        raise InputError(f"region_px = {[left, top, width, height]} (left, top, width, height) {wrong}")
    changed: dict[str, Any] = {"clamp_midpoint_px": (x - left, y - top)}
    if calibration.camera_matrix is not None:
        (fx, skew, cx), (zero, fy, cy), last = calibration.camera_matrix
        changed["camera_matrix"] = ((fx, skew, cx - left), (zero, fy, cy - top), last)
    return Region(left, top, width, height, calibration.model_copy(update=changed), calibration.digest)
