"""List image files and read them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_drivers.cameras.image_series import natural_key
from eimi_lab.process.errors import InputError
from eimi_lab.process.limits import refuse_unpacked
from eimi_lab.process.replacing import patiently
from eimi_lab.process.stderr import library_words
from eimi_lab.vision.heic import kind_of, read_heic
from eimi_lab.vision.image_sizes import MOST_PIXELS, claimed_size, is_stack, may_be_transparent
from eimi_lab.vision.image_wholeness import is_whole
from eimi_lab.vision.intensity import camera_grey

ENDINGS = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".heic", ".heif"})
_BYTES_PER_PIXEL = 8  # of 4 channels of 16 bits
_PADDING_BYTES = 16
"""Most superfluous bytes before the end of a JPEG scan that do not count as damage. Webcams add up to about ten."""
_DAMAGED_JPEG = re.compile(r"(Corrupt JPEG data|Premature end of JPEG)")  # libjpeg, jerror.h
_PADDED = re.compile(r"Corrupt JPEG data: (\d+) extraneous bytes before marker")
_OTHER_ENDINGS = frozenset(  # files of phones and browsers, and raw files of cameras
    {".avif", ".dng", ".webp", ".gif", ".jp2", ".jxl", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf"}
)


def find_images(folder: Path) -> list[Path]:
    """Return the image files of a folder in natural order: ``frame_2`` before ``frame_10``.

    Raises
    ------
    InputError
        If the path is not a folder, or if the folder contains no images.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder of images")
    images = [file for file in folder.iterdir() if file.suffix.lower() in ENDINGS and not file.name.startswith(".")]
    if not images:
        others = sorted(file.name for file in folder.iterdir() if file.suffix.lower() in _OTHER_ENDINGS)
        advice = f"; save {others[0]} and similar files as JPEG or PNG" if others else ""
        raise InputError(f"{folder}: holds no images (files that end in {', '.join(sorted(ENDINGS))}){advice}")
    return sorted(images, key=lambda file: (natural_key(file.name), file.name))


def read_image(path: Path) -> NDArray[Any]:
    """Read an image file.

    Returns
    -------
    ndarray, shape (rows, columns) or (rows, columns, 3)
        Pixels as uint8 or uint16; blue, green, red.

    Raises
    ------
    InputError
        If the file cannot be read, is incomplete, has transparent pixels, holds several pictures, or is too large.
    """
    try:
        if path.exists() and not path.is_file():  # reading might wait for ever
            raise InputError(f"{path}: is a folder, a device or a pipe, not a file")
        raw = patiently(path.read_bytes)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if not raw:
        raise InputError(f"{path}: is empty")
    if kind_of(raw):
        return read_heic(raw, path)
    if not is_whole(raw):
        raise InputError(f"{path}: is truncated or damaged; copy it again")
    size = claimed_size(raw)
    if size is not None and size[0] * size[1] > MOST_PIXELS:
        raise InputError(f"{path}: has a size of {size[0]} x {size[1]} px; at most {MOST_PIXELS:_} pixels are read")
    if size is not None:
        refuse_unpacked(size[0] * size[1] * _BYTES_PER_PIXEL, f"{path}: an image of {size[0]} x {size[1]} px")
    if is_stack(raw):
        raise InputError(
            f"{path}: is a stack of pictures; save each picture as a separate file, and list the files in states.csv"
        )
    image = _decoded(raw, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    if image is None:
        raise InputError(f"{path}: is not an image, or is truncated or damaged")
    if may_be_transparent(raw) and _is_transparent(_decoded(raw, cv2.IMREAD_UNCHANGED)):
        raise InputError(
            f"{path}: is transparent in places, where its colour is not defined; save the picture on a background of "
            "one colour"
        )
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: has pixels of type {image.dtype}; it should have unsigned pixels of 8 or 16 bits")
    return np.asarray(image[..., :3] if image.ndim == 3 else image)


def _decoded(raw: bytes, how: int) -> NDArray[Any] | None:
    """Decode an image file by OpenCV (`how`: its reading flags); return None if the file is damaged or unknown."""
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        with library_words() as words:
            image = cv2.imdecode(np.frombuffer(raw, np.uint8), how)
    except cv2.error:
        return None
    finally:
        logging.setLogLevel(level)
    return None if any(map(_states_damage, words)) else image


def _states_damage(line: str) -> bool:
    padded = _PADDED.match(line)
    return int(padded[1]) > _PADDING_BYTES if padded else bool(_DAMAGED_JPEG.match(line))


def _is_transparent(image: NDArray[Any] | None) -> bool:
    """Return whether an image with four channels has a pixel that is less than 95 % opaque."""
    if image is None or image.ndim != 3 or image.shape[2] != 4:
        return False
    return bool(image[..., 3].min() < 0.95 * np.iinfo(image.dtype).max)


def read_grey(path: Path) -> NDArray[Any]:
    """Read an image file as grey values (uint8 or uint16); in colour, the brightest channel.

    Raises
    ------
    InputError
        See `read_image`.
    """
    return camera_grey(read_image(path))


def describe_image(image: NDArray[Any]) -> str:
    """Return the size, the bit depth and the colour of an image in words.

    Examples
    --------
    >>> describe_image(np.zeros((480, 640), np.uint8))
    '640 x 480 px of 8 bits'
    """
    colour = " in colour" if image.ndim == 3 else ""
    return f"{image.shape[1]} x {image.shape[0]} px of {8 * image.dtype.itemsize} bits{colour}"
