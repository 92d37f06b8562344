"""The fraction of each pixel's area that a polygon covers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def coverage(polygon_px: ArrayLike, size: tuple[int, int]) -> Array:
    """Return the fraction of each pixel's area that is inside a polygon.

    Parameters
    ----------
    polygon_px
        The n vertices x, y of a polygon that does not intersect itself, px, shape (n, 2). Pixel centres are at integer
        coordinates.
    size
        Width and height of the frame, px.

    Returns
    -------
    Array
        Fractions from 0 to 1, shape (height, width).

    Raises
    ------
    ValueError
        If the polygon has fewer than three vertices, or if a vertex is not finite.

    Examples
    --------
    >>> coverage([(-0.5, -0.5), (1.0, -0.5), (1.0, 0.5), (-0.5, 0.5)], (3, 1))
    array([[1. , 0.5, 0. ]])
    """
    vertices = np.asarray(polygon_px, dtype=np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 2 or len(vertices) < 3 or not np.isfinite(vertices).all():
        raise ValueError("a polygon needs at least three vertices, all finite, as an (n, 2) array")
    width, height = size
    frame = np.zeros((height, width))
    corner = np.array([0.5, 0.5])  # shift from integer pixel centres to integer pixel borders
    low = np.clip(np.floor(vertices.min(axis=0) + corner), 0, size).astype(int)
    high = np.clip(np.ceil(vertices.max(axis=0) + corner), 0, size).astype(int)
    if (high > low).all():
        window = _accumulate(vertices + corner - low, tuple(high - low))
        frame[low[1] : high[1], low[0] : high[0]] = window
    return frame


def _accumulate(vertices: Array, size: tuple[int, int]) -> Array:
    """Return the fraction of each pixel's area that a polygon covers, in a rectangle of `size` (width, height) pixels.

    `vertices`, shape (n, 2): px from the upper left corner, with the borders of the pixels at integer coordinates.
    """
    width, height = size
    start, side = vertices, np.roll(vertices, -1, axis=0) - vertices
    cuts = [_crossings(start, side, axis, limit) for axis, limit in enumerate(size)]
    sides = np.arange(len(start))
    index = np.concatenate([sides, sides, *(which for which, _ in cuts)])
    along = np.concatenate([np.zeros(len(start)), np.ones(len(start)), *(t for _, t in cuts)])
    order = np.lexsort((along, index))
    index, along = index[order], along[order]
    same_side = index[1:] == index[:-1]
    index, begin, end = index[:-1][same_side], along[:-1][same_side], along[1:][same_side]

    middle = start[index] + side[index] * (0.5 * (begin + end))[:, None]
    rise = side[index, 1] * (end - begin)
    row = np.floor(middle[:, 1]).astype(np.int64)
    # A piece to the left of the window covers a whole row of the window; a piece to the right covers nothing.
    x = np.maximum(middle[:, 0], 0.0)
    inside = (row >= 0) & (row < height) & (x < width)
    row, x, rise = row[inside], x[inside], rise[inside]
    column = np.floor(x).astype(np.int64)
    left_of_piece = x - column
    stride = width + 1
    cell = row * stride + column
    change = np.bincount(cell, rise * (1.0 - left_of_piece), minlength=height * stride)
    change += np.bincount(cell + 1, rise * left_of_piece, minlength=height * stride)
    winding = np.cumsum(change.reshape(height, stride), axis=1)[:, :width]
    return np.minimum(np.abs(winding), 1.0)


def _crossings(start: Array, side: Array, axis: int, limit: int) -> tuple[NDArray[np.int64], Array]:
    """Return where the n sides of a polygon cross the pixel borders 0 to ``limit`` along an axis (0: x, 1: y).

    The result is the number of the side of each crossing, and its place on the side, from 0 to 1.
    """
    first, length = start[:, axis], side[:, axis]
    low = np.clip(np.ceil(np.minimum(first, first + length)), 0, limit + 1).astype(np.int64)
    high = np.clip(np.floor(np.maximum(first, first + length)), -1, limit).astype(np.int64)
    count = np.where(length == 0.0, 0, np.maximum(high - low + 1, 0))
    index = np.repeat(np.arange(len(start)), count)
    border = low[index] + np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    return index, np.clip((border - first[index]) / length[index], 0.0, 1.0)
