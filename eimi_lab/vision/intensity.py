"""Convert images to grey values, average frames, and correct images by a dark frame and a flat field."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_FULL_SCALES = (255, 1023, 4095, 16383, 65535)
_GREY_SHARE = 1 / 64  # of full scale: rounding may make the channels of a compressed grey picture differ by this much


def grey(image: ArrayLike) -> NDArray[Any]:
    """Return the grey values of an image; in colour, the values of its brightest channel.

    Parameters
    ----------
    image : array_like, shape (rows, columns) or (rows, columns, channels)
        The image.

    Returns
    -------
    ndarray, shape (rows, columns)
        uint8 if the image is uint8, else float32. Values that are not finite become 0.

    Raises
    ------
    ValueError
        If the array has another shape.
    """
    pixels = _channels(image)
    if pixels.ndim == 3:
        # Under a coloured back-light, the other channels are almost only noise. A mean would hide a clipped channel.
        brightest = np.argmax(pixels[::8, ::8].mean(axis=(0, 1), dtype=np.float64))
        pixels = pixels[:, :, brightest]
    return np.ascontiguousarray(pixels)


def _channels(image: ArrayLike) -> NDArray[Any]:
    """Return the first three channels, or the only grey channel, of an image as uint8 or float32.

    Values that are not finite become 0. Raise ValueError if the array is not an image.
    """
    pixels = np.asarray(image)
    if pixels.ndim == 3 and pixels.size:
        pixels = pixels[:, :, :3] if pixels.shape[2] >= 3 else pixels[:, :, 0]
    elif pixels.ndim != 2:
        raise ValueError(
            f"an image should have the shape (rows, columns) or (rows, columns, channels), not {pixels.shape}"
        )
    if pixels.dtype == np.uint8:
        return np.ascontiguousarray(pixels)
    if pixels.dtype.kind == "f":
        pixels = np.nan_to_num(pixels, posinf=0.0, neginf=0.0)
    return np.ascontiguousarray(pixels, dtype=np.float32)


def camera_grey(image: NDArray[Any]) -> NDArray[Any]:
    """Return the brightest channel of an image in its own number type, shape (rows, columns)."""
    return grey(image).astype(image.dtype, copy=False)


def mean_grey(image: NDArray[Any]) -> NDArray[Any]:
    """Return the mean of the colour channels of an image, shape (rows, columns)."""
    # For two frames with about equally bright channels, `camera_grey` may choose different channels.
    return image if image.ndim == 2 else image.mean(axis=2, dtype=np.float32)


def is_coloured(image: NDArray[Any]) -> bool:
    """Return whether the colour channels of an image differ by more than rounding."""
    if image.ndim == 2:
        return False
    difference = np.ptp(image.astype(np.int32), axis=2).max(initial=0)
    return bool(difference > _GREY_SHARE * np.iinfo(image.dtype).max)


def in_channels(image: NDArray[Any], coloured: bool) -> NDArray[Any]:
    """Convert an image to three channels, or a colourless image to one channel.

    Parameters
    ----------
    image : ndarray, shape (rows, columns) or (rows, columns, 3)
        The image.
    coloured : bool
        True for three channels. False for one channel, unless the channels differ.

    Returns
    -------
    ndarray, shape (rows, columns) or (rows, columns, 3)
        The converted image.
    """
    if coloured:
        return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    return image if image.ndim == 2 or is_coloured(image) else image[..., 0]


def eight_bit(image: ArrayLike) -> NDArray[np.uint8]:
    """Return an image of any bit depth and colour as grey values from 0 to 255, shape (rows, columns)."""
    pixels = grey(image)
    return np.rint(pixels * (255.0 / full_scale(pixels))).astype(np.uint8)


def full_scale(image: NDArray[Any]) -> float:
    """Return the largest possible grey value of the camera (8 to 16 bits), judged by the brightest pixel.

    Examples
    --------
    >>> full_scale(np.array([[12, 900]], dtype=np.uint16))
    1023.0
    """
    brightest = float(image.max(initial=0))
    return float(next((value for value in _FULL_SCALES if value >= brightest), _FULL_SCALES[-1]))


def state_mean(frames: Iterable[ArrayLike]) -> NDArray[np.float32]:
    """Return the mean of the frames of a state (load step).

    Parameters
    ----------
    frames : iterable of array_like, shape (rows, columns) or (rows, columns, 3)
        Frames of one state.

    Returns
    -------
    ndarray of float32, shape (rows, columns) or (rows, columns, 3)
        The mean frame.

    Raises
    ------
    ValueError
        If there is no frame, or if the frames differ in shape.
    """
    total: NDArray[np.float32] | None = None
    count = 0
    for frame in frames:
        pixels = _channels(frame)
        if total is None:
            total = pixels.astype(np.float32)
        elif pixels.shape != total.shape:
            raise ValueError(
                f"frame {count} has the shape {pixels.shape}, but earlier frames have {total.shape}; all frames of a "
                "state should have the same shape"
            )
        else:
            total += pixels
        count += 1
    if total is None:
        raise ValueError("a state (load step) needs at least one frame")
    total /= count
    return total


class FieldCorrection:
    """Correction of an image by a dark frame (without light) and a flat field (the bare back-light).

    The corrected image is

        (image - dark) · m / (flat - dark),

    with the median m of flat - dark over the pixels of each colour. Without a dark frame, dark is 0. Without a flat
    field, the corrected image is image - dark. Pixels at full scale keep their value.
    """

    def __init__(self, dark: ArrayLike | None, flat: ArrayLike | None) -> None:
        """Prepare the correction from a dark frame, a flat field, or both.

        Parameters
        ----------
        dark, flat : array_like, shape (rows, columns) or (rows, columns, 3), or None
            The images in grey levels of the camera.

        Raises
        ------
        ValueError
            If both images are None, if their shapes differ, or if the flat field is dark in places.
        """
        images = [None if image is None else _channels(image).astype(np.float32) for image in (dark, flat)]
        present = [image for image in images if image is not None]
        if not present:
            raise ValueError("a correction needs a dark frame or a flat field")
        if len({image.shape for image in present}) > 1:
            raise ValueError(
                f"the flat field has the shape {present[1].shape}; it should have the shape of the dark frame, "
                f"{present[0].shape}"
            )
        self._dark = images[0] if images[0] is not None else np.zeros_like(present[0])
        self._gain: NDArray[np.float32] = np.ones_like(present[0])
        if images[1] is not None:
            light = images[1] - self._dark
            median = np.median(light, axis=(0, 1))  # for each colour, so that the colour of the lamp is kept
            if (median <= 0.0).any() or ((light < 0.05 * median).mean(axis=(0, 1)) > 0.01).any():
                raise ValueError("the flat field is dark in places; it should show the bare back-light everywhere")
            self._gain = (median / np.maximum(light, 0.05 * median)).astype(np.float32)

    def apply(self, image: ArrayLike) -> NDArray[np.float32]:
        """Return the corrected image.

        Raises
        ------
        ValueError
            If the image differs in shape from the dark frame and the flat field.
        """
        pixels = _channels(image)
        if pixels.shape != self._dark.shape:
            raise ValueError(
                f"the image has the shape {pixels.shape}; it should have the shape of the dark frame and the flat "
                f"field, {self._dark.shape}"
            )
        largest = full_scale(pixels)
        corrected = np.clip((pixels - self._dark) * self._gain, 0.0, largest)
        return np.asarray(np.where(pixels >= largest, largest, corrected), dtype=np.float32)
