"""Decode the pixel formats of GenICam cameras: grey values, packed grey values, and Bayer mosaics.

Sources of the names and codes: Pixel Format Naming Convention (EMVA, PFNC 2.1), and GigE Vision 1.2 for the names
that end in "Packed".
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_drivers.interfaces import ReplyNotUnderstood, SetPointRefused

Packing = Literal["", "p", "Packed"]

_DEMOSAIC = {
    "RG": cv2.COLOR_BayerRGGB2BGR,
    "GR": cv2.COLOR_BayerGRBG2BGR,
    "GB": cv2.COLOR_BayerGBRG2BGR,
    "BG": cv2.COLOR_BayerBGGR2BGR,
}


@dataclass(frozen=True)
class PixelFormat:
    """A pixel format, which defines how a camera stores the pixel values of a frame.

    Parameters
    ----------
    kind : str
        "Mono" for grey values, "RGB" or "BGR" for colours. For a Bayer mosaic, the colours of the first two pixels in
        the first row: "RG", "GR", "GB" or "BG".
    bits : int
        The number of bits of one value.
    packing : str
        How the values are stored. "": in whole bytes, little-endian. "p": without unused bits, least significant bit
        first. "Packed": two values in three bytes.
    """

    kind: str
    bits: int
    packing: Packing = ""

    @property
    def name(self) -> str:
        """The name of the format in the GenICam feature PixelFormat, such as "Mono12p"."""
        return f"{'Bayer' if self.kind in _DEMOSAIC else ''}{self.kind}{self.bits}{self.packing}"


def _table() -> dict[int, PixelFormat]:
    mono: dict[int, tuple[int, Packing]] = {
        0x01080001: (8, ""),
        0x01100003: (10, ""),
        0x010C0004: (10, "Packed"),
        0x010A0046: (10, "p"),
        0x01100005: (12, ""),
        0x010C0006: (12, "Packed"),
        0x010C0047: (12, "p"),
        0x01100025: (14, ""),
        0x01100007: (16, ""),
    }
    bayer: dict[tuple[int, Packing], tuple[int, int, int, int]] = {
        (8, ""): (0x01080008, 0x01080009, 0x0108000A, 0x0108000B),
        (10, ""): (0x0110000C, 0x0110000D, 0x0110000E, 0x0110000F),
        (10, "Packed"): (0x010C0026, 0x010C0027, 0x010C0028, 0x010C0029),
        (10, "p"): (0x010A0056, 0x010A0058, 0x010A0054, 0x010A0052),
        (12, ""): (0x01100010, 0x01100011, 0x01100012, 0x01100013),
        (12, "Packed"): (0x010C002A, 0x010C002B, 0x010C002C, 0x010C002D),
        (12, "p"): (0x010C0057, 0x010C0059, 0x010C0055, 0x010C0053),
        (16, ""): (0x0110002E, 0x0110002F, 0x01100030, 0x01100031),
    }
    formats = {code: PixelFormat("Mono", bits, packing) for code, (bits, packing) in mono.items()}
    for (bits, packing), codes in bayer.items():
        for kind, code in zip(("GR", "RG", "GB", "BG"), codes, strict=True):
            formats[code] = PixelFormat(kind, bits, packing)
    return formats | {0x02180014: PixelFormat("RGB", 8), 0x02180015: PixelFormat("BGR", 8)}


PIXEL_FORMATS = _table()
"""The pixel formats that `decode` supports, by their PFNC codes."""

PIXEL_FORMAT_NAMES = tuple(pixel_format.name for pixel_format in PIXEL_FORMATS.values())

GREY_BY_DEPTH = {
    8: ("Mono8",),
    10: ("Mono10p", "Mono10Packed", "Mono10"),
    12: ("Mono12p", "Mono12Packed", "Mono12"),
    14: ("Mono14",),
    16: ("Mono16",),
}
"""The names of the grey formats by bit depth. The format that needs the fewest bytes is the first."""


def depth_of(name: str) -> int | None:
    """Return the number of bits of one value in the pixel format `name`; None for an unknown format."""
    return next((pixel_format.bits for pixel_format in PIXEL_FORMATS.values() if pixel_format.name == name), None)


def choose_format(pixel_format: str | None, bit_depth: int | None, present: str, offered: Iterable[str]) -> str:
    """Return the name of the pixel format to which a camera is to be set.

    Parameters
    ----------
    pixel_format : str, optional
        The requested format.
    bit_depth : int, optional
        The requested number of bits of a grey value.
    present : str
        The present format of the camera, which is returned if nothing is requested.
    offered : iterable of str
        The formats of the camera.

    Raises
    ------
    SetPointRefused
        The requested format is not available or cannot be decoded.
    """
    if pixel_format is not None:
        wanted: tuple[str, ...] = (pixel_format,)
    elif bit_depth is not None:
        wanted = GREY_BY_DEPTH.get(bit_depth, ())
    else:
        wanted = (present,)
    readable = [name for name in offered if name in PIXEL_FORMAT_NAMES]
    usable = [name for name in wanted if name in readable]
    if not usable:
        request = f"bit_depth = {bit_depth}" if pixel_format is None and bit_depth else f"pixel_format = {wanted[0]!r}"
        raise SetPointRefused(f"{request}: pixel_format must be one of {', '.join(readable)} on this camera")
    return usable[0]


def decode(code: int, data: bytes | memoryview, width: int, height: int) -> NDArray[Any]:
    """Return the image that the data of a frame contain.

    Parameters
    ----------
    code : int
        The PFNC code of the pixel format.
    data : bytes-like
        The data of the frame.
    width, height : int
        The size of the image, px.

    Returns
    -------
    ndarray, shape (height, width) or (height, width, 3), uint8 or uint16
        Grey values, or colours in the order blue, green, red.

    Raises
    ------
    ReplyNotUnderstood
        The pixel format is not supported, or the data are too short.
    """
    pixel_format = PIXEL_FORMATS.get(code)
    if pixel_format is None:
        raise ReplyNotUnderstood(
            f"the pixel format {code:#010x} cannot be decoded; pixel_format must be one of "
            f"{', '.join(PIXEL_FORMAT_NAMES)}"
        )
    channels = 3 if pixel_format.kind in ("RGB", "BGR") else 1
    values = _unpack(pixel_format, np.frombuffer(data, np.uint8), width * height * channels)
    if values is None:
        raise ReplyNotUnderstood(
            f"a frame of {width} x {height} pixels in {pixel_format.name} has only {len(data)} bytes"
        )
    if channels == 3:
        colours = values.reshape(height, width, 3)
        return colours if pixel_format.kind == "BGR" else np.ascontiguousarray(colours[..., ::-1])
    image = values.reshape(height, width)
    return cv2.cvtColor(image, _DEMOSAIC[pixel_format.kind]) if pixel_format.kind in _DEMOSAIC else image


def _unpack(pixel_format: PixelFormat, data: NDArray[np.uint8], count: int) -> NDArray[Any] | None:
    """Return the first `count` pixel values in the data, shape (count,); None if the data contain fewer values."""
    if pixel_format.packing == "":
        values = data.view(np.uint8) if pixel_format.bits == 8 else data[: len(data) // 2 * 2].view("<u2")
        return values[:count].astype(values.dtype.newbyteorder("=")) if len(values) >= count else None
    bits = 12 if pixel_format.packing == "Packed" else pixel_format.bits  # "Packed" also stores a 10-bit value in 12
    if 8 * len(data) < bits * count:
        return None
    bytes_in_group, values_in_group = {10: (5, 4), 12: (3, 2)}[bits]
    groups = -(-count // values_in_group)
    padded = np.zeros(groups * bytes_in_group, np.uint8)
    padded[: min(len(data), len(padded))] = data[: len(padded)]
    byte = padded.reshape(groups, bytes_in_group).T.astype(np.uint16)
    values = np.empty((groups, values_in_group), np.uint16)
    match pixel_format.packing, pixel_format.bits:
        case "Packed", 12:
            values[:, 0] = byte[0] << 4 | byte[1] & 0x0F
            values[:, 1] = byte[2] << 4 | byte[1] >> 4
        case "Packed", 10:
            values[:, 0] = byte[0] << 2 | byte[1] & 0x03
            values[:, 1] = byte[2] << 2 | byte[1] >> 4 & 0x03
        case "p", 12:
            values[:, 0] = byte[0] | (byte[1] & 0x0F) << 8
            values[:, 1] = byte[1] >> 4 | byte[2] << 4
        case "p", 10:
            for place in range(4):
                shift = 2 * place
                values[:, place] = (byte[place] >> shift | byte[place + 1] << 8 - shift) & 0x3FF
    return values.reshape(-1)[:count]
