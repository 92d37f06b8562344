"""The rectangular region of the pictures in which the program searches for the beam."""

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
    """The rectangular region of the pictures in which the program searches for the beam.

    Attributes
    ----------
    left, top, width, height : int
        Upper left corner and size, px.
    calibration : Calibration
        Calibration for pixels counted from this corner.
    digest : str
        Checksum of the calibration of the whole picture.
    """

    left: int
    top: int
    width: int
    height: int
    calibration: Calibration
    digest: str

    def cut(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return the part of an image that lies inside the region."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]

    def in_picture(self, edges: EdgeSet) -> EdgeSet:
        """Convert edges from pixels of the region to pixels of the whole picture."""
        corners = edges.corners_px + np.array([self.left, self.top])
        return replace(edges, corners_px=corners, calibration_digest=self.digest)


def region_of(calibration: Calibration, shape: tuple[int, ...]) -> Region | None:
    """Return the region to which the calibration restricts the search for the beam.

    Parameters
    ----------
    calibration : Calibration
        The calibration of the whole picture.
    shape : tuple of int
        Shape of the pictures: height, width and, in colour, number of channels.

    Returns
    -------
    Region or None
        None if the calibration has no `region_px`.

    Raises
    ------
    InputError
        If the region is not entirely in the picture, or does not contain the clamp and all clicked points.
    """
    if calibration.picture is None or calibration.picture.region_px is None:
        return None
    left, top, width, height = calibration.picture.region_px
    x, y = calibration.clamp_midpoint_px
    problem = ""
    if left + width > shape[1] or top + height > shape[0]:
        problem = f"should lie in the pictures of {shape[1]} x {shape[0]} px"
    elif not (left <= x < left + width and top <= y < top + height):
        problem = f"should contain clamp_midpoint_px = {[x, y]}, where the beam begins"
    points = calibration.picture.along_px or ()
    clicks = np.array(points).reshape(-1, 2) - [left, top]
    if not problem and ((clicks < 0).any() or (clicks >= [width, height]).any()):
        problem = f"should contain all points of along_px = {[list(point) for point in points]}"
    if problem:
        raise InputError(f"region_px = {[left, top, width, height]} (left, top, width, height) {problem}")
    changed: dict[str, Any] = {"clamp_midpoint_px": (x - left, y - top)}
    if len(clicks):
        moved = tuple((float(x), float(y)) for x, y in clicks)
        changed["picture"] = calibration.picture.model_copy(update={"along_px": moved})
    if calibration.ruler_px is not None:
        changed["ruler_px"] = tuple((x - left, y - top) for x, y in calibration.ruler_px)
    if calibration.camera_matrix is None and calibration.stand_off_mm is not None:
        # Without a camera matrix, the optical axis passes through the centre of the whole picture.
        focal_px = calibration.stand_off_mm * calibration.pixels_per_mm
        x_axis, y_axis = 0.5 * (shape[1] - 1) - left, 0.5 * (shape[0] - 1) - top
        changed["camera_matrix"] = ((focal_px, 0.0, x_axis), (0.0, focal_px, y_axis), (0.0, 0.0, 1.0))
    elif calibration.camera_matrix is not None:
        (fx, skew, cx), (zero, fy, cy), last = calibration.camera_matrix
        changed["camera_matrix"] = ((fx, skew, cx - left), (zero, fy, cy - top), last)
    return Region(left, top, width, height, calibration.model_copy(update=changed), calibration.digest)
