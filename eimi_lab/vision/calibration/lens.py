"""Calibrate a lens on views of a flat board, and measure the pose of a board in the beam's plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.beam_frame import undistorted

Array = NDArray[np.float64]
View = tuple[Array, Array]
"""n points on the board in mm, shape (n, 2), and the same points in the image in px, shape (n, 2)."""

FEWEST_VIEWS = 4
_LEAST_TILT_DEG = 15.0  # between two views: parallel views do not separate the distance from the focal length


@dataclass(frozen=True)
class Lens:
    """A pinhole camera with square pixels and distortion (OpenCV's coefficients; k3 = 0).

    Attributes
    ----------
    matrix : ndarray, shape (3, 3)
        Camera matrix, px.
    distortion : ndarray, shape (5,)
        Coefficients k1, k2, p1, p2, k3.
    focal_length_sigma_px : float
        Standard deviation of the focal length.
    residual_px : float
        RMS distance between measured and computed image points.
    """

    matrix: Array
    distortion: Array
    focal_length_sigma_px: float
    residual_px: float

    @property
    def focal_length_px(self) -> float:
        """Focal length in px."""
        return float(self.matrix[0, 0])

    def undistort(self, points_px: Array) -> Array:
        """Return image points (px, shape (n, 2)) without the distortion of the lens."""
        return undistorted(points_px, self.matrix, self.distortion)

    def stand_off_mm(self, view: View) -> float:
        """Return the distance (mm) along the optical axis from the entrance pupil to the middle of a board.

        Parameters
        ----------
        view : View
            Points on the board (mm) and in the image (px).

        Raises
        ------
        ValueError
            If the pose of the board cannot be computed.
        """
        board = np.column_stack([view[0], np.zeros(len(view[0]))])
        solved, turn, shift = cv2.solvePnP(board, view[1], self.matrix, self.distortion)
        if not solved:
            raise ValueError("the pose of the board in front of the camera cannot be computed")
        place = cv2.Rodrigues(turn)[0] @ board.mean(axis=0) + shift.ravel()
        return float(place[2])


def calibrate_lens(views: Sequence[View], size: tuple[int, int]) -> Lens:
    """Calibrate a lens on views of a flat board by Zhang's method.

    Parameters
    ----------
    views : sequence of View
        Points on the board (mm) and in the image (px), for at least four images.
    size : tuple of int
        Width and height of the images, px.

    Returns
    -------
    Lens
        The lens, with the residual.

    Raises
    ------
    ValueError
        If there are fewer than four views, if no lens fits the views, if no two views differ in tilt by 15 degrees, or
        if the focal length is uncertain by 2 % or more.

    References
    ----------
    Z. Zhang, "A flexible new technique for camera calibration", IEEE Transactions on Pattern Analysis and Machine
    Intelligence 22 (2000) 1330; implemented in OpenCV.
    """
    if len(views) < FEWEST_VIEWS:
        raise ValueError(
            f"there are {len(views)} views of the board; the calibration of a lens needs at least {FEWEST_VIEWS}"
        )
    boards = [np.column_stack([board, np.zeros(len(board))]).astype(np.float32) for board, _ in views]
    images = [image.astype(np.float32).reshape(-1, 1, 2) for _, image in views]
    start = np.array([[max(size), 0.0, size[0] / 2], [0.0, max(size), size[1] / 2], [0.0, 0.0, 1.0]])
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_FIX_ASPECT_RATIO
    try:
        residual, matrix, distortion, turns, _, deviations, _, _ = cv2.calibrateCameraExtended(
            boards, images, size, start, np.zeros(5), flags=flags
        )
    except cv2.error as error:
        raise ValueError("no lens fits the views of the board; take views that show more of the board") from error
    focal, sigma = float(matrix[0, 0]), float(np.max(deviations[:2]))
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    tilt_range_deg = math.degrees(math.acos(float(np.clip((normals @ normals.T).min(), -1.0, 1.0))))
    if not sigma < 0.02 * focal or tilt_range_deg < _LEAST_TILT_DEG:
        raise ValueError(
            f"the views of the board do not determine the focal length ({focal:.0f} ± {sigma:.0f} px): they differ in "
            f"tilt by {tilt_range_deg:.0f} degrees; tilt the board by 20 to 40 degrees about different axes in most "
            "views"
        )
    return Lens(
        np.array(matrix, dtype=np.float64), np.array(distortion, dtype=np.float64).ravel()[:5], sigma, float(residual)
    )


@dataclass(frozen=True)
class BoardPose:
    """The orientation and scale of a board in the beam's middle plane, in the undistorted image.

    Attributes
    ----------
    pixels_per_mm : float
        Scale in the plane of the board.
    pixels_per_mm_sigma : float
        Standard deviation of the scale.
    angle_deg : float
        Direction of the board's rows, clockwise from +x of the image.
    angle_sigma_deg : float
        Standard deviation of this direction.
    tilt_deg : float
        Angle between board and sensor plane.
    residual_px : float
        RMS residual of the fit.
    """

    pixels_per_mm: float
    pixels_per_mm_sigma: float
    angle_deg: float
    angle_sigma_deg: float
    tilt_deg: float
    residual_px: float


def fit_board_pose(view: View, board_error: float) -> BoardPose:
    """Fit the scale and the orientation of a calibration board by least squares.

    With every point as a complex number x + i y relative to the mean, b on the board (mm) and q in the image (px), the
    fit of q = t b is

        t = Σ b* q / Σ |b|²    (b* is the conjugate of b).

    |t| is the scale (px/mm), and the argument of t is the direction of the board's rows. The tilt is arccos(s₂ / s₁),
    with the singular values s₁ ≥ s₂ of an affine fit.

    Parameters
    ----------
    view : View
        Points on the board (mm) and in the undistorted image (px), both of shape (n, 2).
    board_error : float
        Relative standard uncertainty of the size of the print.

    Returns
    -------
    BoardPose
        Scale, direction and tilt of the board.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))
    >>> board = np.column_stack([x.ravel(), y.ravel()])
    >>> pose = fit_board_pose((board, 25.0 * board + [100.0, 50.0]), board_error=0.001)
    >>> round(pose.pixels_per_mm, 6), round(pose.pixels_per_mm_sigma, 6)
    (25.0, 0.025)
    """
    board, image = (points @ np.array([1.0, 1.0j]) for points in view)
    on_board, in_image = board - board.mean(), image - image.mean()
    square_sum = float((np.abs(on_board) ** 2).sum())
    turn = complex((np.conj(on_board) * in_image).sum() / square_sum)
    residuals = in_image - turn * on_board
    deviation = math.sqrt(float((np.abs(residuals) ** 2).sum()) / (2 * len(board) - 4))
    affine = np.linalg.lstsq(view[0] - view[0].mean(axis=0), view[1] - view[1].mean(axis=0), rcond=None)[0]
    long, short = np.linalg.svd(affine)[1]
    scale, of_points = abs(turn), deviation / math.sqrt(square_sum)
    return BoardPose(
        pixels_per_mm=scale,
        pixels_per_mm_sigma=math.hypot(of_points, scale * board_error, 0.5 * (long - short)),
        angle_deg=math.degrees(math.atan2(turn.imag, turn.real)),
        angle_sigma_deg=math.degrees(of_points / scale),
        tilt_deg=math.degrees(math.acos(min(1.0, short / long))),
        residual_px=math.sqrt(float((np.abs(residuals) ** 2).mean())),
    )
