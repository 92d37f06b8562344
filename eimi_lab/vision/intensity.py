"""Grey values of images: bit depth, colours, mean of several frames, and correction by dark frame and flat field."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_FULL_SCALES = (255, 1023, 4095, 16383, 65535)
_GREY_SHARE = 1 / 64  # of full scale: rounding may make the channels of a compressed grey picture differ by this much


def grey(image: ArrayLike) -> NDArray[Any]:
    """Return the grey values of an image; for a colour image, the values of its brightest channel.

    Under a coloured back-light, the other channels contain almost only noise. A mean of the channels would hide that
    one channel is clipped.

    Parameters
    ----------
    image : array_like, shape (H, W) or (H, W, channels)
        Grey values of any type; H rows, W columns.

    Returns
    -------
    ndarray, shape (H, W)
        uint8 if the image is uint8, else float32. Values that are not finite become 0.

    Raises
    ------
    ValueError
        If the array has another shape.
    """
    pixels = _channels(image)
    if pixels.ndim == 3:
        brightest = np.argmax(pixels[::8, ::8].mean(axis=(0, 1), dtype=np.float64))
        pixels = pixels[:, :, brightest]
    return np.ascontiguousarray(pixels)


def _channels(image: ArrayLike) -> NDArray[Any]:
    """Return an image as uint8 or float32, shape (H, W) or (H, W, 3); values that are not finite become 0.

    Of an image with two channels, the first channel is returned. Of an image with more than three channels, the first
    three are returned. Raise ValueError if the array has another shape.
    """
    pixels = np.asarray(image)
    if pixels.ndim == 3 and pixels.size:
        pixels = pixels[:, :, :3] if pixels.shape[2] >= 3 else pixels[:, :, 0]
    elif pixels.ndim != 2:
        raise ValueError(f"an image should have the shape (H, W) or (H, W, channels), not {pixels.shape}")
    if pixels.dtype == np.uint8:
        return np.ascontiguousarray(pixels)
    if pixels.dtype.kind == "f":
        pixels = np.nan_to_num(pixels, posinf=0.0, neginf=0.0)
    return np.ascontiguousarray(pixels, dtype=np.float32)


def camera_grey(image: NDArray[Any]) -> NDArray[Any]:
    """Return the brightest channel of an image of H by W pixels, in the number type of the image, shape (H, W)."""
    return grey(image).astype(image.dtype, copy=False)


def mean_grey(image: NDArray[Any]) -> NDArray[Any]:
    """Return the mean of the colour channels of an image of H by W pixels, in its grey levels, shape (H, W).

    Use this function to compare frames with each other. If two channels are about equally bright, `camera_grey` may
    choose different channels in two frames.
    """
    return image if image.ndim == 2 else image.mean(axis=2, dtype=np.float32)


def is_coloured(image: NDArray[Any]) -> bool:
    """Return whether the colour channels of an image differ by more than the rounding in a compressed file."""
    if image.ndim == 2:
        return False
    difference = np.ptp(image.astype(np.int32), axis=2).max(initial=0)
    return bool(difference > _GREY_SHARE * np.iinfo(image.dtype).max)


def in_channels(image: NDArray[Any], coloured: bool) -> NDArray[Any]:
    """Convert an image to three colour channels or to grey values.

    Parameters
    ----------
    image : ndarray, shape (H, W) or (H, W, 3)
        The image; H rows, W columns.
    coloured : bool
        True to return three channels; those of a grey image are equal. False to return one channel of an image with
        three equal channels; an image with different channels stays unchanged.

    Returns
    -------
    ndarray, shape (H, W) or (H, W, 3)
        The converted image.
    """
    if coloured:
        return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    return image if image.ndim == 2 or is_coloured(image) else image[..., 0]


def eight_bit(image: ArrayLike) -> NDArray[np.uint8]:
    """Return an image of H by W pixels, of any bit depth and colour, as grey values from 0 to 255, shape (H, W)."""
    pixels = grey(image)
    return np.rint(pixels * (255.0 / full_scale(pixels))).astype(np.uint8)


def full_scale(image: NDArray[Any]) -> float:
    """Return the largest grey value that the camera can give, judged by the brightest pixel of an image.

    The result is the smallest of 255, 1023, 4095, 16383 and 65535 (8 to 16 bits) that no pixel exceeds.

    Examples
    --------
    >>> full_scale(np.array([[12, 900]], dtype=np.uint16))
    1023.0
    """
    brightest = float(image.max(initial=0))
    return float(next((value for value in _FULL_SCALES if value >= brightest), _FULL_SCALES[-1]))


def state_mean(frames: Iterable[ArrayLike]) -> NDArray[np.float32]:
    """Return the mean of the frames of a state (load step), in grey levels of the frames.

    The noise in the mean of n frames has 1/√n of the standard deviation of the noise in one frame.

    Parameters
    ----------
    frames : iterable of array_like, shape (H, W) or (H, W, 3)
        Frames of one state; H rows, W columns.

    Returns
    -------
    ndarray of float32, shape (H, W) or (H, W, 3)
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
    """Correction of an image by a dark frame and a flat field.

    A dark frame is an image taken without light. A flat field is an image of the bare back-light. The corrected image
    is

        (image - dark) · m / (flat - dark),

    with the median m of flat - dark over the pixels of each colour. Without a dark frame, dark is 0. Without a flat
    field, the corrected image is image - dark.

    The correction removes the dark signal and the photo response non-uniformity (terms of EMVA standard 1288). A pixel
    at full scale keeps its value, so that clipping remains visible.
    """

    def __init__(self, dark: ArrayLike | None, flat: ArrayLike | None) -> None:
        """Prepare the correction from a dark frame (taken without light), a flat field (the bare back-light), or both.

        Parameters
        ----------
        dark, flat : array_like, shape (H, W) or (H, W, 3), or None
            The images in grey levels of the camera; H rows, W columns.

        Raises
        ------
        ValueError
            If both images are None, if the shapes of the images differ, or if the difference flat - dark is below 5 %
            of its median at more than 1 % of the pixels.
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
        """Return the corrected image as float32.

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
