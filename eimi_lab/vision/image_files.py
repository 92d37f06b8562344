"""Image files that a lab already has: found in natural order, read whole or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_drivers.cameras.image_series import natural_key
from eimi_lab.process.errors import InputError
from eimi_lab.vision.image_sizes import MOST_PIXELS, claimed_size, is_stack, may_be_transparent
from eimi_lab.vision.image_wholeness import is_whole
from eimi_lab.vision.intensity import camera_grey

ENDINGS = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm"})
_HEIC, _HEIF, _AVIF = "a HEIC picture", "a HEIF picture", "an AVIF picture"
_BRANDS = {b"heic": _HEIC, b"heix": _HEIC, b"mif1": _HEIF, b"msf1": _HEIF, b"avif": _AVIF}  # ISO/IEC 23008-12, annex B
_OTHER_ENDINGS = frozenset(  # of phones, of browsers, and of cameras' raw pictures
    {".heic", ".heif", ".avif", ".dng", ".webp", ".gif", ".jp2", ".jxl", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf"}
)


def find_images(folder: Path) -> list[Path]:
    """The images in a folder in natural order; other files and hidden ones are passed over. Raises InputError."""
    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder of images")
    images = [file for file in folder.iterdir() if file.suffix.lower() in ENDINGS and not file.name.startswith(".")]
    if not images:
        others = sorted(file.name for file in folder.iterdir() if file.suffix.lower() in _OTHER_ENDINGS)
        told = f"; save {others[0]} and its like as JPEG or PNG" if others else ""
        raise InputError(f"{folder}: holds no images ({', '.join(sorted(ENDINGS))}){told}")
    return sorted(images, key=lambda file: (natural_key(file.name), file.name))


def read_image(path: Path) -> NDArray[Any]:
    """(H, W) or (H, W, 3: blue, green, red), uint8 or uint16. Raises InputError for what is not a whole image."""
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):  # one that never ends, or for whose writer to wait
            raise InputError(f"{path}: is no file but a device or a pipe")
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if not raw:
        raise InputError(f"{path}: is empty")
    if raw[4:8] == b"ftyp" and raw[8:12] in _BRANDS:
        raise InputError(f"{path}: is {_BRANDS[raw[8:12]]}; save it as JPEG or PNG")
    if not is_whole(raw):
        raise InputError(f"{path}: is truncated or damaged; copy it again")
    size = claimed_size(raw)
    if size is not None and size[0] * size[1] > MOST_PIXELS:
        raise InputError(f"{path}: says that it is {size[0]} x {size[1]} px; more than {MOST_PIXELS:_} are not read")
    if is_stack(raw):
        raise InputError(f"{path}: is a stack of pictures; save each as a file of its own, and list them in states.csv")
    image = _decoded(raw, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    if image is None:
        raise InputError(f"{path}: is not an image, or is truncated or damaged")
    if may_be_transparent(raw) and _is_transparent(_decoded(raw, cv2.IMREAD_UNCHANGED)):
        raise InputError(
            f"{path}: is transparent in places, and has no colour there that anybody sees; save it on a background"
        )
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: has pixels of type {image.dtype}; 8 or 16 bits without sign are wanted")
    return np.asarray(image[..., :3] if image.ndim == 3 else image)


def _decoded(raw: bytes, how: int) -> NDArray[Any] | None:
    """None where OpenCV reads no image; nothing is printed."""
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        return cv2.imdecode(np.frombuffer(raw, np.uint8), how)
    except cv2.error:
        return None
    finally:
        logging.setLogLevel(level)


def _is_transparent(image: NDArray[Any] | None) -> bool:
    """Whether an image (H, W, 4: blue, green, red, opacity) lets something through, by more than nobody sees."""
    if image is None or image.ndim != 3 or image.shape[2] != 4:
        return False
    return bool(image[..., 3].min() < 0.95 * np.iinfo(image.dtype).max)


def read_grey(path: Path) -> NDArray[Any]:
    """(H, W) uint8 or uint16: of colours the brightest, by the rule of `intensity.grey`. Raises as `read_image`."""
    return camera_grey(read_image(path))


def described(image: NDArray[Any]) -> str:
    """Size and depth of an image (H, W) or (H, W, 3) in words."""
    colour = " in colour" if image.ndim == 3 else ""
    return f"{image.shape[1]} x {image.shape[0]} px of {8 * image.dtype.itemsize} bits{colour}"
