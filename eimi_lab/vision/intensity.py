"""One grey image of what the camera delivered: colour, depth and several frames of a state."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_FULL_SCALES = (255, 1023, 4095, 16383, 65535)


def grey(image: ArrayLike) -> NDArray[Any]:
    """One channel of an image, (height, width).

    Of a colour image (height, width, channels) it is the brightest channel alone: under a coloured back-light
    the others hold noise, and a mixture would hide that one of them is clipped. uint8 stays uint8 and the
    rest becomes float32; what is not finite becomes 0. Raises ValueError for an array of another shape.
    """
    pixels = np.asarray(image)
    if pixels.ndim == 3 and pixels.size:
        colours = pixels[:, :, :3]
        brightest = np.argmax(colours[::8, ::8].mean(axis=(0, 1), dtype=np.float64))
        pixels = colours[:, :, brightest]
    if pixels.ndim != 2:
        raise ValueError(f"an image has two dimensions, or three with the colours last, not {pixels.shape}")
    if pixels.dtype == np.uint8:
        return np.ascontiguousarray(pixels)
    if pixels.dtype.kind == "f":
        pixels = np.nan_to_num(pixels, posinf=0.0, neginf=0.0)
    return np.ascontiguousarray(pixels, dtype=np.float32)


def full_scale(image: NDArray[Any]) -> float:
    """The largest grey value of the camera: that of 8, 10, 12, 14 or 16 bits, the first that holds the image."""
    brightest = float(image.max(initial=0))
    return float(next((value for value in _FULL_SCALES if value >= brightest), _FULL_SCALES[-1]))


def state_mean(frames: Iterable[ArrayLike]) -> NDArray[np.float32]:
    """Mean of a state's frames, (height, width) float32, in the frames' own grey levels.

    Averaging n frames before the search lowers the noise by the root of n and costs one search instead of n.
    Raises ValueError when there is no frame, or when the frames differ in size.
    """
    total: NDArray[np.float32] | None = None
    count = 0
    for frame in frames:
        pixels = grey(frame)
        if total is None:
            total = pixels.astype(np.float32)
        elif pixels.shape != total.shape:
            raise ValueError(f"frame {count} has the shape {pixels.shape}, the ones before it {total.shape}")
        else:
            total += pixels
        count += 1
    if total is None:
        raise ValueError("a state without frames has no mean")
    total /= count
    return total
