"""What the camera delivered as numbers: its depth, its colours, one grey image of them, several frames of a state."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_FULL_SCALES = (255, 1023, 4095, 16383, 65535)
_GREY_SHARE = 1 / 64  # of full scale: by so much a compressed grey picture's channels may differ, for rounding


def grey(image: ArrayLike) -> NDArray[Any]:
    """One channel of an image, (height, width).

    Of a colour image (height, width, channels) it is the brightest channel alone: under a coloured back-light
    the others hold noise, and a mixture would hide that one of them is clipped. uint8 stays uint8 and the
    rest becomes float32; what is not finite becomes 0. Raises ValueError for an array of another shape.
    """
    pixels = _channels(image)
    if pixels.ndim == 3:
        brightest = np.argmax(pixels[::8, ::8].mean(axis=(0, 1), dtype=np.float64))
        pixels = pixels[:, :, brightest]
    return np.ascontiguousarray(pixels)


def _channels(image: ArrayLike) -> NDArray[Any]:
    """(H, W) or (H, W, 3): uint8, or else float32 in which what is not finite is 0. Raises ValueError."""
    pixels = np.asarray(image)
    if pixels.ndim == 3 and pixels.size:
        pixels = pixels[:, :, :3] if pixels.shape[2] >= 3 else pixels[:, :, 0]
    elif pixels.ndim != 2:
        raise ValueError(f"an image has two dimensions, or three with the colours last, not {pixels.shape}")
    if pixels.dtype == np.uint8:
        return np.ascontiguousarray(pixels)
    if pixels.dtype.kind == "f":
        pixels = np.nan_to_num(pixels, posinf=0.0, neginf=0.0)
    return np.ascontiguousarray(pixels, dtype=np.float32)


def camera_grey(image: NDArray[Any]) -> NDArray[Any]:
    """(H, W) or (H, W, 3) to (H, W) by the rule of `grey`, of the image's own type: the camera's depth is kept."""
    return grey(image).astype(image.dtype, copy=False)


def mean_grey(image: NDArray[Any]) -> NDArray[Any]:
    """(H, W): the mean of the colours, to compare frames with one another; grey values stay as they are.

    `camera_grey` may take another channel for the next frame, where two are about as bright.
    """
    return image if image.ndim == 2 else image.mean(axis=2, dtype=np.float32)


def is_coloured(image: NDArray[Any]) -> bool:
    """Whether an image (H, W) or (H, W, 3) has colours, and not but one grey value in all of its channels."""
    if image.ndim == 2:
        return False
    apart = np.ptp(image.astype(np.int32), axis=2).max(initial=0)
    return bool(apart > _GREY_SHARE * np.iinfo(image.dtype).max)


def in_channels(image: NDArray[Any], coloured: bool) -> NDArray[Any]:
    """An image (H, W) or (H, W, 3) with three channels if coloured, and else with one; but no colour is given up."""
    if coloured:
        return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    return image if image.ndim == 2 or is_coloured(image) else image[..., 0]


def eight_bit(image: ArrayLike) -> NDArray[np.uint8]:
    """An image of any depth as grey values 0..255 of 255, to be drawn on or searched by OpenCV, (height, width)."""
    pixels = grey(image)
    return np.rint(pixels * (255.0 / full_scale(pixels))).astype(np.uint8)


def full_scale(image: NDArray[Any]) -> float:
    """The largest grey value of the camera: that of 8, 10, 12, 14 or 16 bits, the first that holds the image."""
    brightest = float(image.max(initial=0))
    return float(next((value for value in _FULL_SCALES if value >= brightest), _FULL_SCALES[-1]))


def state_mean(frames: Iterable[ArrayLike]) -> NDArray[np.float32]:
    """Mean of a state's frames, (height, width) or (height, width, 3) float32, in the frames' own grey levels.

    Averaging n frames before the search lowers the noise by the root of n and costs one search instead of n.
    Raises ValueError when there is no frame, or when the frames differ in size.
    """
    total: NDArray[np.float32] | None = None
    count = 0
    for frame in frames:
        pixels = _channels(frame)
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


class FieldCorrection:
    """Takes out what the sensor adds without light (dark frame) and the unevenness of light and pixels (flat field).

    (image - dark) * mean / (flat - dark), with the median of flat - dark as mean: against what EMVA standard 1288
    calls dark signal and photo response non-uniformity. A pixel at full scale stays there: clipping still shows.
    """

    def __init__(self, dark: ArrayLike | None, flat: ArrayLike | None) -> None:
        """Images without light and of the bare back-light, one of them or both; each colour corrects its own.

        Raises ValueError for images that differ in size, a flat field no brighter than the dark frame, or neither.
        """
        images = [None if image is None else _channels(image).astype(np.float32) for image in (dark, flat)]
        given = [image for image in images if image is not None]
        if not given:
            raise ValueError("neither a dark frame nor a flat field is given")
        if len({image.shape for image in given}) > 1:
            raise ValueError(f"the flat field has the shape {given[1].shape}, the dark frame {given[0].shape}")
        self._dark = images[0] if images[0] is not None else np.zeros_like(given[0])
        self._gain: NDArray[np.float32] = np.ones_like(given[0])
        if images[1] is not None:
            light = images[1] - self._dark
            middle = np.median(light, axis=(0, 1))  # of each colour: a lamp is as yellow afterwards as before
            if (middle <= 0.0).any() or ((light < 0.05 * middle).mean(axis=(0, 1)) > 0.01).any():
                raise ValueError("the flat field is dark in places, and can correct nothing there")
            self._gain = (middle / np.maximum(light, 0.05 * middle)).astype(np.float32)

    def apply(self, image: ArrayLike) -> NDArray[np.float32]:
        """The corrected image, with the colours that it has. Raises ValueError for an image of another size."""
        pixels = _channels(image)
        if pixels.shape != self._dark.shape:
            raise ValueError(f"the image has the shape {pixels.shape}, dark frame and flat field {self._dark.shape}")
        largest = full_scale(pixels)
        corrected = np.clip((pixels - self._dark) * self._gain, 0.0, largest)
        return np.asarray(np.where(pixels >= largest, largest, corrected), dtype=np.float32)
