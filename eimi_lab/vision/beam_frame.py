"""The map between image pixels and the beam frame in millimetres."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.beam.view import View
from eimi_lab.config.calibration import Calibration

Array = NDArray[np.float64]

# Undistorting iterates; OpenCV's default of five rounds leaves hundredths of a pixel on a strong lens.
_ROUNDS, _ENOUGH = 50, 1e-10


def undistorted(points_px: Array, matrix: Array, distortion: Array) -> Array:
    """(n, 2) px as a lens without distortion would have them; matrix and distortion are OpenCV's."""
    import cv2  # slow to load, and a fit of stored edges does without

    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, _ROUNDS, _ENOUGH)
    ideal = cv2.undistortPoints(points_px.reshape(-1, 1, 2), matrix, distortion, None, None, matrix, until)
    return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)


class BeamFrame:
    """Origin amid the clamp line, x along the undeformed beam, y across it toward the positive coil field.

    Whether y is a quarter turn clockwise or anticlockwise of x in the image follows from the field's
    direction. With a camera matrix, points are undistorted first (OpenCV's model); clamp_midpoint_px is a
    place in the camera's own image, while the angles are those of the undistorted one.

    gravity_deg, field_deg: directions in the beam frame, from +x toward +y, in -180..180. hand: +1 where y is
    a quarter turn clockwise of x in the image, -1 where it is anticlockwise.
    """

    def __init__(self, calibration: Calibration) -> None:
        axis = math.radians(calibration.axis_angle_deg)
        to_field = math.radians(calibration.field_angle_deg) - axis
        self.hand = -1.0 if math.sin(to_field) < 0.0 else 1.0
        self._scale = calibration.pixels_per_mm
        along = (math.cos(axis), math.sin(axis))
        across = (-self.hand * math.sin(axis), self.hand * math.cos(axis))
        self._axes = np.array([along, across])
        self._matrix = None if calibration.camera_matrix is None else np.array(calibration.camera_matrix)
        self._distortion = np.array(calibration.distortion or ())
        self._origin = self._undistort(np.array([calibration.clamp_midpoint_px], dtype=np.float64))[0]
        self._stand_off_mm = None if calibration.telecentric else calibration.stand_off_mm
        self.field_deg = self._turned(calibration.field_angle_deg - calibration.axis_angle_deg)
        self.gravity_deg = self._turned(calibration.gravity_angle_deg - calibration.axis_angle_deg)

    def to_mm(self, points_px: ArrayLike) -> Array:
        """(n, 2) image pixels to (n, 2) millimetres in the beam frame."""
        points = self._undistort(np.asarray(points_px, dtype=np.float64).reshape(-1, 2))
        return (points - self._origin) @ self._axes.T / self._scale

    def to_px(self, points_mm: ArrayLike) -> Array:
        """(n, 2) millimetres in the beam frame to (n, 2) image pixels."""
        points = np.asarray(points_mm, dtype=np.float64).reshape(-1, 2) @ self._axes * self._scale + self._origin
        if self._matrix is None or len(points) == 0:
            return points
        import cv2  # see `undistorted`

        rays = np.linalg.solve(self._matrix, np.column_stack([points, np.ones(len(points))]).T).T
        still = np.zeros(3)
        image_points = cv2.projectPoints(rays, still, still, self._matrix, self._distortion)[0]
        return np.asarray(image_points, dtype=np.float64).reshape(-1, 2)

    def view(self, depth_mm: float, size: tuple[int, int]) -> View | None:
        """How the lens sees a specimen's depth in images of a width and height; None for one that does not matter.

        The optical axis is at the camera matrix's principal point, or amid the image where there is none. Raises
        ValueError where the specimen reaches the lens.
        """
        if self._stand_off_mm is None:
            return None
        centre = (np.array(size) - 1.0) / 2.0 if self._matrix is None else self._matrix[:2, 2]
        if not 0.5 * depth_mm < self._stand_off_mm:
            raise ValueError(f"a stand-off of {self._stand_off_mm:g} mm is within the depth of {depth_mm:g} mm")
        return View((centre - self._origin) @ self._axes.T / self._scale, self._stand_off_mm)

    def _undistort(self, points: Array) -> Array:
        if self._matrix is None or len(points) == 0:
            return points
        return undistorted(points, self._matrix, self._distortion)

    def _turned(self, from_axis_deg: float) -> float:
        return (self.hand * from_axis_deg + 180.0) % 360.0 - 180.0
