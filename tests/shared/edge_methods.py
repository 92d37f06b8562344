"""Detect edges by published methods: from a grey image (height, width) to n points (x, y) in px, shape (n, 2)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Array = NDArray[np.float64]
_DEVERNAY_BLUR_PX = 2.0
_LEAST_GRADIENT = 0.3  # as a share of the largest gradient in the image


def otsu_contours(image: NDArray[np.uint8]) -> Array:
    """Return the border pixels of the regions that are darker than Otsu's threshold (IEEE Trans. SMC 9, 1979)."""
    _, mask = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.concatenate([contour.reshape(-1, 2) for contour in contours]).astype(np.float64)


def marching_squares(image: NDArray[np.uint8]) -> Array:
    """Return the points of the contour lines at Otsu's threshold, which matplotlib interpolates between pixels."""
    from matplotlib.figure import Figure

    level, _ = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    lines = Figure().add_subplot().contour(image, levels=[level + 0.5]).allsegs[0]
    return np.concatenate([np.asarray(line, dtype=np.float64) for line in lines])


def devernay(image: NDArray[np.uint8]) -> Array:
    """Return the points of largest gradient along its direction, between pixels (Devernay, INRIA RR-2724, 1995)."""
    smooth: NDArray[Any] = gaussian_filter(image.astype(np.float32), _DEVERNAY_BLUR_PX)
    slope_y, slope_x = np.gradient(smooth)
    size = np.hypot(slope_x, slope_y)
    inner = size[1:-1, 1:-1]
    y, x = np.nonzero(inner > _LEAST_GRADIENT * inner.max())
    x, y = x + 1, y + 1
    points = []
    for dx, dy, mostly in (
        (1, 0, np.abs(slope_x[y, x]) >= np.abs(slope_y[y, x])),
        (0, 1, np.abs(slope_x[y, x]) < np.abs(slope_y[y, x])),
    ):
        before, here, after = (size[y + k * dy, x + k * dx] for k in (-1, 0, 1))
        top = mostly & (here > before) & (here >= after)
        offset = 0.5 * (before - after)[top] / (before - 2.0 * here + after)[top]
        points.append(np.column_stack([x[top] + dx * offset, y[top] + dy * offset]))
    return np.concatenate(points)


METHODS = {"Otsu + contours": otsu_contours, "marching squares": marching_squares, "Devernay": devernay}
