"""Check that an image file is complete."""

from __future__ import annotations

import re
import zlib

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_JPEG_START = b"\xff\xd8"
_END, _TEMPORARY = 0xD9, 0x01  # the markers EOI and TEM have no length field
# A marker that ends a scan: neither a stuffed byte, nor a fill byte, nor a restart marker.
_MARKER = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]", re.DOTALL)


def is_whole(raw: bytes) -> bool:
    """Return whether a PNG or JPEG file is complete; True for every other format."""
    if raw.startswith(PNG_SIGNATURE):
        return _png_is_whole(raw)
    return _jpeg_is_whole(raw) if raw.startswith(_JPEG_START) else True


def _png_is_whole(raw: bytes) -> bool:
    """Return whether a PNG file has all chunks with right checksums (PNG specification, W3C, section 5.3)."""
    at = len(PNG_SIGNATURE)
    while at + 12 <= len(raw):
        length = int.from_bytes(raw[at : at + 4], "big")
        checksum = raw[at + 8 + length : at + 12 + length]
        if zlib.crc32(raw[at + 4 : at + 8 + length]) != int.from_bytes(checksum, "big") or len(checksum) < 4:
            return False
        if raw[at + 4 : at + 8] == b"IEND":
            return True
        at += 12 + length
    return False


def _jpeg_is_whole(raw: bytes) -> bool:
    """Return whether a JPEG file has an end-of-image marker after its scans (ITU-T T.81, annex B)."""
    at = len(_JPEG_START)
    while (match := _MARKER.search(raw, at)) is not None:
        marker, at = raw[match.start() + 1], match.end()
        if marker == _END:
            return True
        if marker != _TEMPORARY:
            # Segments are skipped, and with them the end-of-image marker of an embedded thumbnail.
            at += int.from_bytes(raw[at : at + 2], "big")
    return False
