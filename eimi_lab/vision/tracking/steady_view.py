"""Remove the motion of the camera from a recording.

Textured points are followed by the method of Lucas and Kanade (Bouguet 2000, as in OpenCV). A shift, a rotation and a
scale are fitted by RANSAC (Fischler and Bolles 1981).
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.intensity import eight_bit

Array = NDArray[np.float64]

MOVED_PX = 0.3
"""If the picture moves less than this (px), the camera counts as fixed. Corners cannot be followed more accurately."""
_CORNERS, _FEWEST = 80, 12
_QUALITY, _DISTANCE_PX = 0.02, 12
_WINDOW = (15, 15)
_LEVELS = 3
_OFF_PX = 0.8  # a corner farther from its place does not move with the others
_WIDEST_PX = 1400  # a wider picture is halved before its corners are followed


class SteadyView:
    """A reference frame, to which the other frames of a recording are aligned.

    Parameters
    ----------
    reference : ndarray, shape (rows, columns) or (rows, columns, 3)
        The reference frame.
    outline_px : ndarray, shape (n, 2)
        Corners of a polygon around the moving part of the frame.

    Attributes
    ----------
    moved_px : float
        Largest motion of the picture so far.
    """

    def __init__(self, reference: NDArray[Any], outline_px: Array) -> None:
        self._halved = reference.shape[1] > _WIDEST_PX
        self._reference = self._small(reference)
        still = np.full(self._reference.shape, 255, np.uint8)
        cv2.fillPoly(still, [np.rint(outline_px / self._scale).astype(np.int32)], 0)
        corners = cv2.goodFeaturesToTrack(self._reference, _CORNERS, _QUALITY, _DISTANCE_PX, mask=still)
        self._corners = np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2)
        self._to_frame = np.eye(2, 3)
        self._is_moving = False
        self.moved_px = 0.0

    @property
    def is_possible(self) -> bool:
        """Whether the reference frame has enough textured points to measure the motion of the camera."""
        return len(self._corners) >= _FEWEST

    def steadied(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return a frame, moved so that fixed objects are at the same pixels as in the reference frame."""
        if not self.is_possible:
            return image
        measured = self._follow(self._small(image))
        if measured is not None:
            self._to_frame = measured
            height, width = self._reference.shape
            ends = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]])
            moved = ends @ measured[:, :2].T + measured[:, 2] - ends
            self.moved_px = max(self.moved_px, self._scale * float(np.hypot(*moved.T).max()))
            self._is_moving |= self.moved_px > MOVED_PX
        if not self._is_moving:
            return image
        to_frame = self._to_frame.copy()
        to_frame[:, 2] *= self._scale
        if self._halved:  # the centre of pixel 0 of the halved picture lies at 0.5 px
            to_frame[:, 2] += 0.5 - to_frame[:, :2] @ np.full(2, 0.5)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        size = (image.shape[1], image.shape[0])
        return np.asarray(cv2.warpAffine(image, to_frame, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))

    @property
    def _scale(self) -> float:
        return 2.0 if self._halved else 1.0

    def _small(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """Return a frame as 8-bit grey values; a wide frame at half of its size."""
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        grey = grey if grey.dtype == np.uint8 else eight_bit(grey)
        if self._halved:
            grey = np.asarray(cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        return np.asarray(grey, np.uint8)

    def _follow(self, grey: NDArray[np.uint8]) -> Array | None:
        """Return the affine map (2 x 3) from the reference frame to a frame; None with too few textured points."""
        guess = (self._corners @ self._to_frame[:, :2].T + self._to_frame[:, 2]).astype(np.float32)
        places, followed, _ = cv2.calcOpticalFlowPyrLK(
            self._reference, grey, self._corners, guess.copy(), winSize=_WINDOW, maxLevel=_LEVELS,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )  # fmt: skip
        kept = followed.ravel() > 0
        if kept.sum() < _FEWEST:
            return None
        similarity, inliers = cv2.estimateAffinePartial2D(
            self._corners[kept], places[kept], method=cv2.RANSAC, ransacReprojThreshold=_OFF_PX / self._scale
        )
        if similarity is None or int(inliers.sum()) < max(_FEWEST, int(kept.sum()) // 4):
            return None
        return np.asarray(similarity, float)
