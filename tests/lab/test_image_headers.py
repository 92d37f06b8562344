"""The headers of image files are read byte by byte, as the specifications of the formats state."""

from __future__ import annotations

import itertools
import struct
import zlib

import numpy as np
import pytest

from eimi_lab.vision.heic import kind_of
from eimi_lab.vision.image_files import _is_transparent, _states_damage, describe_image
from eimi_lab.vision.image_sizes import claimed_size, is_stack, may_be_transparent
from eimi_lab.vision.image_wholeness import is_whole

PNG = b"\x89PNG\r\n\x1a\n"


def chunk(kind: bytes, content: bytes = b"") -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(colour: int = 2, further: bytes = b"") -> bytes:
    header = struct.pack(">IIBBBBB", 640, 480, 8, colour, 0, 0, 0)
    return PNG + chunk(b"IHDR", header) + further + chunk(b"IDAT", b"pixels") + chunk(b"IEND")


def tiff(order: str, pages: tuple[tuple[int, int], ...], kind: int = 3) -> bytes:
    # Return a TIFF file without pixels, whose directories contain the sizes of the pages.
    raw = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", 8)
    for number, size in enumerate(pages):
        entries = [(255, 0), (256, size[0]), (257, size[1])]
        directory = struct.pack(f"{order}H", len(entries))
        for tag, value in entries:
            of_kind = struct.pack(f"{order}HH", value, 0) if kind == 3 else struct.pack(f"{order}I", value)
            directory += struct.pack(f"{order}HHI", tag, kind, 1) + of_kind
        following = len(raw) + len(directory) + 4 if number + 1 < len(pages) else 0
        raw += directory + struct.pack(f"{order}I", following)
    return raw


def big_tiff(order: str, pages: int, width: int = 640, kind: int = 3) -> bytes:
    # Return a BigTIFF file without pixels, whose pages have the stated width and the height 480.
    raw = (b"II+\0" if order == "<" else b"MM\0+") + struct.pack(f"{order}HHQ", 8, 0, 16)
    code = {3: "H6x", 4: "I4x", 16: "Q"}[kind]
    for number in range(pages):
        entries = (struct.pack(f"{order}HHQ{code}", tag, kind, 1, at) for tag, at in ((256, width), (257, 480)))
        directory = struct.pack(f"{order}Q", 2) + b"".join(entries)
        raw += directory + struct.pack(f"{order}Q", len(raw) + len(directory) + 8 if number + 1 < pages else 0)
    return raw


def segment(marker: int, content: bytes = b"") -> bytes:
    return bytes([0xFF, marker]) + struct.pack(">H", len(content) + 2) + content


def jpeg(marker: int = 0xC0, before: bytes = b"", end: bytes = b"\xff\xd9") -> bytes:
    frame = segment(marker, struct.pack(">BHH", 8, 480, 640) + b"\x01\x01\x11\x00")
    return (
        b"\xff\xd8" + segment(0xE0, b"JFIF\0") + before + frame + segment(0xDA, b"\x01") + b"pixels\xff\x00more" + end
    )


@pytest.mark.parametrize(
    ("raw", "size"),
    [
        (png(), (640, 480)),
        (jpeg(), (640, 480)),
        (jpeg(0xC2), (640, 480)),
        (jpeg(0xCF), (640, 480)),
        (jpeg(before=segment(0xC4, b"table" * 7)), (640, 480)),
        (jpeg(before=segment(0xCC, b"\x01\x02\x03\x04\x05\x06\x07")), (640, 480)),
        (jpeg(before=segment(0xC8, b"\x01\x02\x03\x04\x05\x06\x07")), (640, 480)),
        (b"\xff\xd8" + segment(0xE0, b"JFIF\0"), None),
        (b"\xff\xd8\x00\x00" + bytes(20), None),
        (b"BM" + bytes(16) + struct.pack("<ii", 640, -480) + bytes(4), (640, 480)),
        (b"BM" + bytes(16), None),
        (tiff("<", ((640, 480),)), (640, 480)),
        (tiff(">", ((640, 480),)), (640, 480)),
        (tiff("<", ((70000, 480),), 4), (70000, 480)),
        (tiff(">", ((70000, 480),), 4), (70000, 480)),
        (tiff("<", ((640, 480),))[:30], None),
        (big_tiff("<", 1), (640, 480)),
        (big_tiff(">", 2), (640, 480)),
        (big_tiff("<", 1, 70000, 4), (70000, 480)),
        (big_tiff(">", 1, 70000, 16), (70000, 480)),
        (big_tiff("<", 1)[:40], None),
        (b"II+\0\10\0\0\0" + b"\xff" * 8, None),
        (b"P5\n# made by hand\n640 480\n255\n", (640, 480)),
        (b"P2 640 480 255\n", (640, 480)),
        (b"P5\nwide high\n", None),
        (b"P6\n640 480\n255\n", None),
        (b"GIF89a" + bytes(20), None),
        (PNG, None),
    ],
    ids=itertools.count(),
)
def test_the_size_is_read_from_the_header(raw: bytes, size: tuple[int, int] | None) -> None:
    assert claimed_size(raw) == size


@pytest.mark.parametrize(
    ("raw", "stacked"),
    [
        (tiff("<", ((640, 480), (640, 480))), True),
        (tiff(">", ((640, 480), (640, 480))), True),
        (tiff("<", ((640, 480), (64, 48))), False),
        (tiff("<", ((640, 480),)), False),
        (tiff("<", ((640, 480), (640, 480)))[:60], False),
        (big_tiff("<", 2), True),
        (big_tiff(">", 2), True),
        (big_tiff("<", 1), False),
        (b"II+\0\10\0\0\0" + b"\xff" * 8, False),
        (png(), False),
    ],
    ids=itertools.count(),
)
def test_a_second_page_of_the_same_size_makes_a_stack(raw: bytes, stacked: bool) -> None:
    assert is_stack(raw) is stacked


@pytest.mark.parametrize(
    ("raw", "may_be"),
    [
        (png(2), False),
        (png(4), True),
        (png(6), True),
        (png(3, chunk(b"tRNS", b"\0")), True),
        (png(3, chunk(b"tEXt", b"t")), False),
        (PNG + chunk(b"IHDR", bytes(13)) + chunk(b"IDAT", b"a tRNS b"), False),
        (b"BM" + bytes(23) + b"\6", False),
    ],
    ids=itertools.count(),
)
def test_a_png_file_may_be_transparent(raw: bytes, may_be: bool) -> None:
    assert may_be_transparent(raw) is may_be


@pytest.mark.parametrize(
    ("raw", "whole"),
    [
        (png(), True),
        (png() + b"further", True),
        (png()[:-1], False),
        (png()[:-12], False),
        (png()[:-4], False),
        (png().replace(b"pixels", b"pixelz"), False),
        (jpeg(), True),
        (jpeg(end=b""), False),
        (jpeg(end=b"\xff"), False),
        (jpeg(end=b"\xff\xd0\xff\xd7\xff\xff\xd9"), True),
        (jpeg(end=b"\xff\xd9film"), True),
        (jpeg(before=segment(0xE1, b"\xff\xd9"), end=b""), False),
        (jpeg(before=b"\xff\x01"), True),
        (jpeg(end=b"\xff\x01"), False),
        (b"GIF89a", True),
        (b"", True),
    ],
    ids=itertools.count(),
)
def test_a_file_is_whole_if_it_reaches_its_end(raw: bytes, whole: bool) -> None:
    assert is_whole(raw) is whole


@pytest.mark.parametrize(
    ("line", "damaged"),
    [
        ("Corrupt JPEG data: 16 extraneous bytes before marker 0xd9", False),
        ("Corrupt JPEG data: 17 extraneous bytes before marker 0xd9", True),
        ("Corrupt JPEG data: bad Huffman code", True),
        ("Premature end of JPEG file", True),
        ("a warning: Corrupt JPEG data", False),
    ],
)
def test_superfluous_bytes_up_to_sixteen_are_no_damage(line: str, damaged: bool) -> None:
    assert _states_damage(line) is damaged


def test_an_image_with_a_pixel_below_95_per_cent_is_transparent() -> None:
    for dtype, full in ((np.uint8, 255), (np.uint16, 65535)):
        image = np.full((3, 4, 4), full, dtype)
        assert not _is_transparent(image)
        image[1, 2, 3] = round(0.96 * full)
        assert not _is_transparent(image)
        image[1, 2, 3] = round(0.94 * full)
        assert _is_transparent(image)
        assert not _is_transparent(image[..., :3])
        assert not _is_transparent(image[..., 0])
    assert not _is_transparent(None)
    assert describe_image(np.zeros((480, 640, 3), np.uint16)) == "640 x 480 px of 16 bits in colour"


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (b"\0\0\0\x18ftypheic", "a HEIC picture"),
        (b"\0\0\0\x18ftypheix", "a HEIC picture"),
        (b"\0\0\0\x18ftypmif1", "a HEIF picture"),
        (b"\0\0\0\x18ftypmsf1", "a HEIF picture"),
        (b"\0\0\0\x18ftypavif", "an AVIF picture"),
        (b"\0\0\0\x18ftypmp42", ""),
        (b"\0\0\0\x18moovheic", ""),
        (b"", ""),
    ],
    ids=itertools.count(),
)
def test_the_brand_of_a_heif_file(raw: bytes, words: str) -> None:
    assert kind_of(raw) == words
