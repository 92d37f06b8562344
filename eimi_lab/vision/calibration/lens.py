"""A camera's matrix and distortion from views of a flat board, and how large a millimetre is in the beam's plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.beam_frame import undistorted

Array = NDArray[np.float64]
View = tuple[Array, Array]  # points on the board (n, 2) mm and in the image (n, 2) px

FEWEST_VIEWS = 4
_LEAST_TILT_DEG = 15.0  # between two of the views: of flat ones distance and focal length cannot be told apart


@dataclass(frozen=True)
class Lens:
    """OpenCV's pinhole model with distortion k1, k2, p1, p2 (k3 = 0) and square pixels.

    matrix: (3, 3); distortion: (5,). focal_length_sigma_px: standard deviation of the focal length. residual_px: root
    mean square distance of the points from where the model puts them.
    """

    matrix: Array
    distortion: Array
    focal_length_sigma_px: float
    residual_px: float

    @property
    def focal_length_px(self) -> float:
        return float(self.matrix[0, 0])

    def undistort(self, points_px: Array) -> Array:
        """(n, 2) px as a lens without distortion would have them."""
        return undistorted(points_px, self.matrix, self.distortion)

    def stand_off_mm(self, view: View) -> float:
        """Distance from the entrance pupil to the board's middle, along the optical axis. Raises ValueError."""
        board = np.column_stack([view[0], np.zeros(len(view[0]))])
        found, turn, shift = cv2.solvePnP(board, view[1], self.matrix, self.distortion)
        if not found:
            raise ValueError("the board's place before the camera cannot be found")
        place = cv2.Rodrigues(turn)[0] @ board.mean(axis=0) + shift.ravel()
        return float(place[2])


def calibrate_lens(views: Sequence[View], size: tuple[int, int]) -> Lens:
    """Zhang's method (IEEE PAMI 22, 2000) by OpenCV, from at least four views; size: width and height of the images.

    Raises ValueError where the views cannot tell the focal length to 2 %: they are too alike, or not tilted.
    """
    if len(views) < FEWEST_VIEWS:
        raise ValueError(f"{len(views)} views of the board; a lens needs at least {FEWEST_VIEWS}")
    boards = [np.column_stack([board, np.zeros(len(board))]).astype(np.float32) for board, _ in views]
    images = [image.astype(np.float32).reshape(-1, 1, 2) for _, image in views]
    start = np.array([[max(size), 0.0, size[0] / 2], [0.0, max(size), size[1] / 2], [0.0, 0.0, 1.0]])
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_FIX_ASPECT_RATIO
    residual, matrix, distortion, turns, _, deviations, _, _ = cv2.calibrateCameraExtended(
        boards, images, size, start, np.zeros(5), flags=flags
    )
    focal, sigma = float(matrix[0, 0]), float(np.max(deviations[:2]))
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    apart = math.degrees(math.acos(float(np.clip((normals @ normals.T).min(), -1.0, 1.0))))
    if not sigma < 0.02 * focal or apart < _LEAST_TILT_DEG:
        raise ValueError(
            f"the views differ in tilt by {apart:.0f} degrees and give a focal length of {focal:.0f} ± {sigma:.0f} px; "
            "tilt the board by 20 to 40 degrees about different axes in most views"
        )
    return Lens(
        np.array(matrix, dtype=np.float64), np.array(distortion, dtype=np.float64).ravel()[:5], sigma, float(residual)
    )


@dataclass(frozen=True)
class BoardPose:
    """How a board in the beam's middle plane lies in the (undistorted) image.

    pixels_per_mm and angle_deg (of the board's rows, clockwise from +x) with their standard deviations; tilt_deg: of
    the board out of a plane parallel to the sensor, as far as its shape shows it; residual_px: of the fit.
    """

    pixels_per_mm: float
    pixels_per_mm_sigma: float
    angle_deg: float
    angle_sigma_deg: float
    tilt_deg: float
    residual_px: float


def place_in_plane(view: View, board_error: float) -> BoardPose:
    """Scale and orientation by least squares; view: undistorted points, board_error: of the print, as a share.

    The scale's deviation holds that of the points, of the print and of half the foreshortening of a tilted board.
    """
    board, image = (points @ np.array([1.0, 1.0j]) for points in view)
    across, down = board - board.mean(), image - image.mean()
    size = float((np.abs(across) ** 2).sum())
    turn = complex((np.conj(across) * down).sum() / size)
    left_over = down - turn * across
    deviation = math.sqrt(float((np.abs(left_over) ** 2).sum()) / (2 * len(board) - 4))
    affine = np.linalg.lstsq(view[0] - view[0].mean(axis=0), view[1] - view[1].mean(axis=0), rcond=None)[0]
    long, short = np.linalg.svd(affine)[1]
    scale, of_points = abs(turn), deviation / math.sqrt(size)
    return BoardPose(
        pixels_per_mm=scale,
        pixels_per_mm_sigma=math.hypot(of_points, scale * board_error, 0.5 * (long - short)),
        angle_deg=math.degrees(math.atan2(turn.imag, turn.real)),
        angle_sigma_deg=math.degrees(of_points / scale),
        tilt_deg=math.degrees(math.acos(min(1.0, short / long))),
        residual_px=math.sqrt(float((np.abs(left_over) ** 2).mean())),
    )
