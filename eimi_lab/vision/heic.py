"""Read HEIC pictures, in which an iPhone stores photographs, by pillow-heif (the extra ``heic``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.process.errors import InputError
from eimi_lab.vision.image_sizes import MOST_PIXELS

_HEIC, _HEIF, _AVIF = "a HEIC picture", "a HEIF picture", "an AVIF picture"
_BRANDS = {b"heic": _HEIC, b"heix": _HEIC, b"mif1": _HEIF, b"msf1": _HEIF, b"avif": _AVIF}  # ISO/IEC 23008-12, annex B
_AS_JPEG = "on an iPhone choose Settings > Camera > Formats > Most Compatible, or export the picture as JPEG"


def kind_of(raw: bytes) -> str:
    r"""Return the format of a HEIC, HEIF or AVIF file in words; empty for every other format.

    Parameters
    ----------
    raw : bytes
        The contents of the file.

    Examples
    --------
    >>> kind_of(b"\x00\x00\x00\x18ftypheic")
    'a HEIC picture'
    """
    return _BRANDS.get(raw[8:12], "") if raw[4:8] == b"ftyp" else ""


def let_pillow_read_heic() -> None:
    """Make `PIL.Image.open` read HEIC pictures, if pillow-heif is installed."""
    try:
        from pillow_heif import register_heif_opener
    except ImportError:
        return
    register_heif_opener()


def read_heic(raw: bytes, path: Path) -> NDArray[np.uint8]:
    """Decode a HEIC picture.

    Parameters
    ----------
    raw : bytes
        The contents of the file.
    path : Path
        Its path, for messages.

    Returns
    -------
    ndarray of uint8, shape (rows, columns, 3)
        The upright picture of 8 bits; blue, green, red.

    Raises
    ------
    InputError
        If pillow-heif is not installed, if the file is damaged or too large, or if it is an AVIF picture.
    """
    kind = kind_of(raw)
    if kind == _AVIF:
        raise InputError(f"{path}: is {kind}, which cannot be read; save the picture as JPEG or PNG")
    try:
        from pillow_heif import open_heif
    except ImportError as error:
        raise InputError(
            f"{path}: is {kind}, which needs the library pillow-heif (pip install 'eimi-lab[heic]'); "
            f"without this library, {_AS_JPEG}"
        ) from error
    try:
        picture = open_heif(raw, convert_hdr_to_8bit=True, bgr_mode=True)
        width, height = picture.size
        if width * height <= MOST_PIXELS:
            pixels: NDArray[Any] = np.asarray(picture)
    except (ValueError, OSError, RuntimeError, SyntaxError, EOFError) as error:
        raise InputError(f"{path}: is {kind} that is truncated or damaged; copy it again, or {_AS_JPEG}") from error
    if width * height > MOST_PIXELS:
        raise InputError(f"{path}: has a size of {width} x {height} px; at most {MOST_PIXELS:_} pixels are read")
    return np.ascontiguousarray(pixels[..., :3])
