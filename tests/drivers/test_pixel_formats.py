"""The decoding of pixel formats agrees with bits that were arranged by hand from the standards."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_drivers.cameras.pixel_formats import PIXEL_FORMATS, decode
from eimi_drivers.interfaces import ReplyNotUnderstood

CODES = {known.name: code for code, known in PIXEL_FORMATS.items()}


@pytest.mark.parametrize(
    ("name", "data", "values"),
    [
        ("Mono8", b"\x01\x02\xff\x80", [1, 2, 255, 128]),
        ("Mono16", b"\x34\x12\xff\xff\x00\x80\x01\x00", [0x1234, 0xFFFF, 0x8000, 1]),
        # GigE Vision: the high bits of the first value, the low bits of both values, the high bits of the second value.
        ("Mono12Packed", b"\xab\x5c\x12\xff\x0f\x00", [0xABC, 0x125, 0xFFF, 0x000]),
        ("Mono10Packed", b"\xff\x23\x00\x80\x10\x01", [0x3FF, 0x002, 0x200, 0x005]),
        # PFNC: a stream of bits, least significant first.
        ("Mono12p", b"\xbc\x5a\x12\xff\x0f\x00", [0xABC, 0x125, 0xFFF, 0x000]),
        ("Mono10p", b"\xff\x03\x00\x40\x40", [0x3FF, 0x000, 0x000, 0x101]),
    ],
)
def test_packed_values_are_unpacked(name: str, data: bytes, values: list[int]) -> None:
    image = decode(CODES[name], data, 2, 2)
    assert image.ravel().tolist() == values
    assert image.shape == (2, 2)


@pytest.mark.parametrize("bits", [10, 12])
def test_a_stream_of_bits_agrees_with_its_bits_one_by_one(bits: int) -> None:
    data = np.random.default_rng(bits).integers(0, 256, 15 * bits // 2, dtype=np.uint8)
    stream = np.unpackbits(data, bitorder="little").reshape(-1, bits)
    expected = stream.astype(int) @ (1 << np.arange(bits))
    assert decode(CODES[f"Mono{bits}p"], data.tobytes(), 12, 5).ravel().tolist() == expected.tolist()


@pytest.mark.parametrize("kind", ["RG", "GR", "GB", "BG"])
def test_each_colour_of_a_bayer_mosaic_is_found_at_its_place(kind: str) -> None:
    tile = {"RG": "RGGB", "GR": "GRBG", "GB": "GBRG", "BG": "BGGR"}[kind]
    for place, colour in enumerate("BGR"):
        mosaic = np.tile(
            [
                [255 * (tile[0] == colour), 255 * (tile[1] == colour)],
                [255 * (tile[2] == colour), 255 * (tile[3] == colour)],
            ],
            (6, 6),
        ).astype(np.uint8)
        image = decode(CODES[f"Bayer{kind}8"], mosaic.tobytes(), 12, 12)
        inside = image[3:-3, 3:-3].reshape(-1, 3)
        assert (inside[:, place] == 255).all()
        assert (np.delete(inside, place, axis=1) == 0).all()


def test_colours_are_in_the_order_blue_green_red() -> None:
    assert decode(CODES["RGB8"], bytes([1, 2, 3]), 1, 1).tolist() == [[[3, 2, 1]]]
    assert decode(CODES["BGR8"], bytes([1, 2, 3]), 1, 1).tolist() == [[[1, 2, 3]]]
    wide = np.arange(18).reshape(2, 3, 3)
    np.testing.assert_array_equal(decode(CODES["BGR8"], bytes(range(18)), 3, 2), wide)
    np.testing.assert_array_equal(decode(CODES["RGB8"], bytes(range(18)), 3, 2), wide[..., ::-1])


@pytest.mark.parametrize(
    ("code", "data", "words"),
    [
        (CODES["Mono8"], b"123", "a frame of 2 x 2 pixels in Mono8 has only 3 bytes"),
        (CODES["Mono12p"], b"12345", "a frame of 2 x 2 pixels in Mono12p has only 5 bytes"),
        (0x02100032, b"12345678", "the pixel format 0x02100032 cannot be decoded; pixel_format must be one of Mono8"),
    ],
)
def test_a_frame_that_cannot_be_decoded_is_an_error(code: int, data: bytes, words: str) -> None:
    with pytest.raises(ReplyNotUnderstood, match=words):
        decode(code, data, 2, 2)


@pytest.mark.parametrize(
    ("name", "pylon_name", "kept_bits"),
    [
        ("Mono12Packed", "PixelType_Mono12packed", 0xFF),
        ("Mono12p", "PixelType_Mono12p", 0xFF),
        ("Mono10Packed", "PixelType_Mono10packed", 0x33),  # the middle byte has two bits of each value
        ("Mono10p", "PixelType_Mono10p", 0xFF),
    ],
)
def test_packed_values_agree_with_the_converter_of_pylon(name: str, pylon_name: str, kept_bits: int) -> None:
    pylon = pytest.importorskip("pypylon.pylon", reason="needs pypylon: pip install 'eimi-lab[basler]'")
    bits = 10 if name == "Mono10p" else 12
    data = np.random.default_rng(7).integers(0, 256, 16 * 6 * bits // 8, dtype=np.uint8)
    data[1::3] &= kept_bits
    source, converter = pylon.PylonImage(), pylon.ImageFormatConverter()
    converter.OutputPixelFormat = pylon.PixelType_Mono16
    converter.OutputBitAlignment.Value = "LsbAligned"
    source.AttachMemoryView(memoryview(bytearray(data.tobytes())), getattr(pylon, pylon_name), 16, 6, 0)
    expected = converter.Convert(source).GetArray()
    np.testing.assert_array_equal(decode(CODES[name], data.tobytes(), 16, 6), expected)
