"""Read the size of an image from the header of its file, before the pixels are decoded."""

from __future__ import annotations

import struct

MOST_PIXELS = 100_000_000

_JPEG_SIZES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})  # start-of-frame markers
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257
# By the first bytes: byte order, and codes of `struct` for the number of entries of a page and for offsets.
_TIFF_LAYOUTS = {
    b"II*\0": ("<", "H", "I"),
    b"MM\0*": (">", "H", "I"),
    b"II+\0": ("<", "Q", "Q"),  # BigTIFF
    b"MM\0+": (">", "Q", "Q"),
}


def claimed_size(raw: bytes) -> tuple[int, int] | None:
    """Return the width and height (px) in the header of a PNG, JPEG, BMP, TIFF or PGM file.

    Parameters
    ----------
    raw : bytes
        The whole file.

    Returns
    -------
    tuple of int, or None
        None for another format or an incomplete header.

    References
    ----------
    PNG specification (W3C), section 11.2.2; JPEG, ITU-T T.81, table B.2; BITMAPINFOHEADER (Microsoft);
    TIFF 6.0 (Adobe), section 2; the BigTIFF file format (LibTIFF); the netpbm manual of the PGM format.
    """
    try:
        if raw.startswith(b"\x89PNG"):
            width, height = struct.unpack_from(">II", raw, 16)
        elif raw.startswith(b"\xff\xd8"):
            return _jpeg(raw)
        elif raw.startswith(b"BM"):
            width, height = struct.unpack_from("<ii", raw, 18)
        elif raw[:4] in _TIFF_LAYOUTS:
            return _tiff_page(raw)[0]
        elif raw[:2] in (b"P2", b"P5"):
            lines = [line for line in raw[:4096].split(b"\n") if not line.startswith(b"#")]
            width, height = (int(word) for word in b" ".join(lines).split()[1:3])
        else:
            return None
    except (struct.error, ValueError, OverflowError):
        return None
    return abs(width), abs(height)


def _jpeg(raw: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 < len(raw) and raw[at] == 0xFF:
        if raw[at + 1] in _JPEG_SIZES:
            height, width = struct.unpack_from(">HH", raw, at + 5)
            return width, height
        at += 2 + int.from_bytes(raw[at + 2 : at + 4], "big")
    return None


def _tiff_page(raw: bytes, at: int | None = None) -> tuple[tuple[int, int] | None, int]:
    """Return the size (px) on a page of a TIFF file, None if unknown, and the next page's offset in bytes (0 for none).

    `at`: offset of the page's directory, bytes; None for the first page.
    """
    order, count_code, offset_code = _TIFF_LAYOUTS[raw[:4]]
    wide = struct.calcsize(offset_code)
    if at is None:
        (at,) = struct.unpack_from(order + offset_code, raw, wide)
    (count,) = struct.unpack_from(order + count_code, raw, at)
    begin, step = at + struct.calcsize(count_code), 4 + 2 * wide
    end = begin + step * count
    sizes = {}
    for entry in range(begin, end, step):
        tag, kind = struct.unpack_from(f"{order}HH", raw, entry)
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT):
            value_code = {3: "H", 16: "Q"}.get(kind, "I")
            (sizes[tag],) = struct.unpack_from(order + value_code, raw, entry + 4 + wide)
    size = (sizes[_TIFF_WIDTH], sizes[_TIFF_HEIGHT]) if len(sizes) == 2 else None
    return size, int.from_bytes(raw[end : end + wide], "little" if order == "<" else "big")


def is_stack(raw: bytes) -> bool:
    """Return whether the second page of a TIFF file contains an image of the same size as the first page."""
    if raw[:4] not in _TIFF_LAYOUTS:
        return False
    try:
        size, following = _tiff_page(raw)
        return bool(following) and _tiff_page(raw, following)[0] == size
    except (struct.error, OverflowError):
        return False


def may_be_transparent(raw: bytes) -> bool:
    """Return whether a PNG file has an opacity channel or transparent colours (PNG, sections 11.2.2 and 11.3.2)."""
    return raw.startswith(b"\x89PNG") and (raw[25:26] in (b"\4", b"\6") or b"tRNS" in raw[: raw.find(b"IDAT")])
