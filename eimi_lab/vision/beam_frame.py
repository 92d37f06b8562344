"""Map image pixels to millimetres in the beam frame, whose x axis runs along the undeformed beam."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.beam.view import View
from eimi_lab.config.calibration import Calibration

Array = NDArray[np.float64]

# OpenCV undistorts by iteration. With its default of five iterations a strong lens leaves errors of hundredths of a px.
_ITERATIONS, _TOLERANCE = 50, 1e-10


def undistorted(points_px: Array, matrix: Array, distortion: Array) -> Array:
    """Return image points without the distortion of the lens.

    Parameters
    ----------
    points_px : ndarray, shape (n, 2)
        Points in the camera's image.
    matrix : ndarray, shape (3, 3)
        Camera matrix in OpenCV's convention, px.
    distortion : ndarray, shape (4,), (5,), (8,), (12,) or (14,)
        Distortion coefficients in OpenCV's convention.

    Returns
    -------
    ndarray, shape (n, 2)
        Points in the undistorted image, px.
    """
    import cv2  # slow to import, and not needed for a fit of stored edges

    stop_criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, _ITERATIONS, _TOLERANCE)
    ideal = cv2.undistortPoints(points_px.reshape(-1, 1, 2), matrix, distortion, None, None, matrix, stop_criteria)
    return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)


class BeamFrame:
    """The map between image pixels and the beam frame.

    The x axis runs from the clamp along the undeformed beam. The y axis is perpendicular to it, on the side toward
    which the positive field points. A point p of the undistorted image (px) has the coordinates

        x = (p - p0) · a / s,    y = (p - p0) · b / s

    in mm, with the middle of the clamp's edge p0 (px), the unit vectors a (along x) and b (along y) in the image, and
    the scale s (px/mm).

    Parameters
    ----------
    calibration : Calibration
        Scale, clamp, angles and, optionally, the lens.

    Attributes
    ----------
    hand : float
        +1 if y is a quarter turn clockwise of x in the image, else -1.
    gravity_deg, field_deg : float
        Directions of gravity and of the positive field, from +x toward +y, -180 to 180.

    Examples
    --------
    >>> calibration = Calibration(
    ...     pixels_per_mm=20.0, coil_constant_mT_per_A=4.7, clamp_midpoint_px=(100.0, 50.0),
    ...     axis_angle_deg=90.0, gravity_angle_deg=90.0, field_angle_deg=0.0,
    ... )
    >>> frame = BeamFrame(calibration)
    >>> frame.to_mm([[120.0, 50.0]]).round(6).tolist()
    [[0.0, 1.0]]
    >>> frame.hand
    -1.0
    """

    def __init__(self, calibration: Calibration) -> None:
        axis = math.radians(calibration.axis_angle_deg)
        to_field = math.radians(calibration.positive_field_deg) - axis
        self.hand = -1.0 if math.sin(to_field) < 0.0 else 1.0
        self._scale = calibration.pixels_per_mm
        along = (math.cos(axis), math.sin(axis))
        across = (-self.hand * math.sin(axis), self.hand * math.cos(axis))
        self._axes = np.array([along, across])
        self._matrix = None if calibration.camera_matrix is None else np.array(calibration.camera_matrix)
        self._distortion = np.array(calibration.distortion or ())
        # The clamp is given in the camera's own image, but the angles are given in the undistorted image.
        self._origin = self._undistort(np.array([calibration.clamp_midpoint_px], dtype=np.float64))[0]
        self._stand_off_mm = None if calibration.telecentric else calibration.stand_off_mm
        self._tilt_deg, self._ruler_px = calibration.camera_tilt_deg or (0.0, 0.0), calibration.ruler_px
        self.field_deg = self._in_beam_frame(calibration.positive_field_deg - calibration.axis_angle_deg)
        self.gravity_deg = self._in_beam_frame(calibration.gravity_angle_deg - calibration.axis_angle_deg)

    def to_mm(self, points_px: ArrayLike) -> Array:
        """Convert points, shape (n, 2), from px in the image to mm along and across the undeformed beam."""
        points = self._undistort(np.asarray(points_px, dtype=np.float64).reshape(-1, 2))
        return (points - self._origin) @ self._axes.T / self._scale

    def components(self, vector: tuple[float, float]) -> Array:
        """Return the components along and across the undeformed beam of a vector (right, down) in the image."""
        return np.asarray(self._axes @ np.array(vector))

    def to_px(self, points_mm: ArrayLike) -> Array:
        """Convert points, shape (n, 2), from mm along and across the undeformed beam to px in the image."""
        points = np.asarray(points_mm, dtype=np.float64).reshape(-1, 2) @ self._axes * self._scale + self._origin
        if self._matrix is None or len(points) == 0:
            return points
        import cv2  # see `undistorted`

        rays = np.linalg.solve(self._matrix, np.column_stack([points, np.ones(len(points))]).T).T
        no_motion = np.zeros(3)
        image_points = cv2.projectPoints(rays, no_motion, no_motion, self._matrix, self._distortion)[0]
        return np.asarray(image_points, dtype=np.float64).reshape(-1, 2)

    def view(self, depth_mm: float, size: tuple[int, int]) -> View | None:
        """Return the perspective in which the lens images a specimen of the given depth.

        Parameters
        ----------
        depth_mm : float
            Depth of the specimen, along the optical axis.
        size : tuple of int
            Width and height of the images, px.

        Returns
        -------
        View or None
            None for a telecentric lens, or if the distance from the lens to the beam is unknown.

        Raises
        ------
        ValueError
            If this distance is not more than half of the depth.
        """
        if self._stand_off_mm is None:
            return None
        centre = (np.array(size) - 1.0) / 2.0 if self._matrix is None else self._matrix[:2, 2]
        if not 0.5 * depth_mm < self._stand_off_mm:
            raise ValueError(
                f"stand_off_mm = {self._stand_off_mm:g} (from the lens to the middle of the beam) should be more than "
                f"half of depth_mm = {depth_mm:g}"
            )
        along, across = self.components(self._tilt_deg).tolist()
        return View(
            (centre - self._origin) @ self._axes.T / self._scale,
            self._stand_off_mm,
            (along, across),
            None if self._ruler_px is None else self.to_mm(self._ruler_px),
        )

    def _undistort(self, points: Array) -> Array:
        if self._matrix is None or len(points) == 0:
            return points
        return undistorted(points, self._matrix, self._distortion)

    def _in_beam_frame(self, from_axis_deg: float) -> float:
        # Convert an angle (clockwise in the image, from the axis of the beam) to the beam frame, -180 to 180 degrees.
        # Angles in the beam frame are measured from +x toward +y.
        return (self.hand * from_axis_deg + 180.0) % 360.0 - 180.0
