"""Whether an image file is there to its end: some decoders leave the rest grey or black, and say nothing."""

from __future__ import annotations

import re
import zlib

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_JPEG_START = b"\xff\xd8"
_END, _ALONE = 0xD9, 0x01  # markers without a length, of those that are looked for
_MARKER = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]", re.DOTALL)  # that ends a scan: no stuffed byte, fill byte or restart


def is_whole(raw: bytes) -> bool:
    """Whether a PNG or a JPEG ends as it should; true for what is neither. What comes behind its end does not count."""
    if raw.startswith(PNG_SIGNATURE):
        return _png_is_whole(raw)
    return _jpeg_is_whole(raw) if raw.startswith(_JPEG_START) else True


def _png_is_whole(raw: bytes) -> bool:
    """Every chunk up to IEND is there and has its checksum (PNG specification, W3C, section 5.3)."""
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
    """Segment after segment and scan after scan up to the end of the image (ITU-T T.81, annex B).

    A thumbnail inside has an end of its own, and phones append a film or a second picture behind the end.
    """
    at = len(_JPEG_START)
    while (found := _MARKER.search(raw, at)) is not None:
        marker, at = raw[found.start() + 1], found.end()
        if marker == _END:
            return True
        if marker != _ALONE:
            at += int.from_bytes(raw[at : at + 2], "big")
    return False
