"""Read the focal length from the Exif data of a picture."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path

from PIL import Image
from PIL.ExifTags import IFD, Base

from eimi_lab.vision.heic import let_pillow_read_heic

DIAGONAL_35MM = 43.2666
"""Diagonal (mm) of a frame of 36 x 24 mm. A lens with the "35 mm equivalent" focal length has the same angle of view
over the diagonal of this frame as the phone has over its own (CIPA DCG-001, 2005)."""
FOCAL_LENGTH_SHARE = 0.03
"""Assumed relative standard uncertainty of a focal length from Exif. The focal length in Exif is rounded to 1 mm of
about 26 mm, and is valid for focus at infinity. The focal length in Exif does not take into account that the correction
of the distortion crops the picture.
"""
_SAME_SHAPE = 0.01  # relative difference of two ratios of width to height
_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}  # FocalPlaneResolutionUnit: inch (Exif 2.3, 4.6.5), cm, mm, µm


@dataclass(frozen=True)
class FocalLength:
    """A focal length in pixels, and a text on how it was obtained."""

    px: float
    source: str


def focal_length(path: Path, size: tuple[int, int]) -> FocalLength | None:
    """Return the focal length from the Exif data of a picture.

    Parameters
    ----------
    path : Path
        The picture.
    size : tuple of int
        Its width and height, px.

    Returns
    -------
    FocalLength or None
        None without a focal length, or if the picture was cropped.
    """
    let_pillow_read_heic()
    try:
        with Image.open(path) as picture:
            exif = picture.getexif()
            table = exif.get_ifd(IFD.Exif)
            exif_size = _number(table.get(Base.ExifImageWidth)), _number(table.get(Base.ExifImageHeight))
            equivalent_mm = _number(table.get(Base.FocalLengthIn35mmFilm))
            focal_mm = _number(table.get(Base.FocalLength))
            per_unit = _number(table.get(Base.FocalPlaneXResolution))
            unit_mm = _MM_PER_UNIT.get(int(_number(table.get(Base.FocalPlaneResolutionUnit)) or 2), 25.4)
    except (OSError, ValueError, TypeError, SyntaxError, KeyError, struct.error, Image.DecompressionBombError):
        return None  # the Exif data are absent or damaged
    if all(exif_size) and abs(max(exif_size) / min(exif_size) * min(size) / max(size) - 1.0) > _SAME_SHAPE:
        return None
    if equivalent_mm:
        source = f"focal length of {equivalent_mm:g} mm (35 mm equivalent) from the Exif data of the picture"
        return FocalLength(equivalent_mm / DIAGONAL_35MM * math.hypot(*size), source)
    if focal_mm and per_unit and all(exif_size):
        source = f"focal length of {focal_mm:g} mm and resolution of the sensor from the Exif data of the picture"
        return FocalLength(focal_mm * per_unit / unit_mm * max(size) / max(exif_size), source)
    return None


def _number(value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0
    return number if math.isfinite(number) and number > 0 else 0.0
