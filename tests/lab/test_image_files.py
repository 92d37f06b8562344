"""Image files of cameras and phones are read or refused: complete, truncated, rotated, in several formats."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from eimi_lab.process.errors import InputError
from eimi_lab.vision.calibration.exif_lens import focal_length
from eimi_lab.vision.image_files import _is_transparent, find_images, read_image


@pytest.mark.parametrize("ending", [".png", ".jpg", ".tif", ".bmp", ".pgm"])
@pytest.mark.parametrize("share", [0.05, 0.5, 0.9, 0.999])
def test_a_truncated_image_is_never_read(
    tmp_path: Path, frame: Callable[..., np.ndarray], ending: str, share: float
) -> None:
    path = tmp_path / f"image{ending}"
    cv2.imwrite(str(path), frame(1))
    whole = path.read_bytes()
    assert read_image(path).shape == (96, 128)
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=path.name):
        read_image(path)


def test_an_appended_film_and_a_thumbnail_do_not_hide_a_truncated_jpeg(
    tmp_path: Path, frame: Callable[..., np.ndarray]
) -> None:
    path = tmp_path / "image.jpg"
    whole, small = (cv2.imencode(".jpg", image)[1].tobytes() for image in (frame(1), frame(1)[::4, ::4]))
    thumbnail = b"Exif\0\0" + small
    whole = whole[:2] + b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail + whole[2:]
    path.write_bytes(whole + b"ftypmp42" + bytes(5000))
    assert read_image(path).shape == (96, 128)
    path.write_bytes(whole[: len(whole) - len(whole) // 4])
    with pytest.raises(InputError, match="truncated or damaged"):
        read_image(path)


def test_a_jpeg_whose_pixels_are_damaged_is_refused_and_nothing_else_is_printed(
    tmp_path: Path, frame: Callable[..., np.ndarray], capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "image.jpg"
    whole = cv2.imencode(".jpg", frame(1))[1].tobytes()
    middle = len(whole) // 2
    path.write_bytes(whole[:middle] + bytes(64) + whole[middle + 64 :])
    with pytest.raises(InputError, match="truncated or damaged"):
        read_image(path)
    path.write_bytes(whole[:-2] + b"\xa5" * 4 + whole[-2:])  # some webcams add bytes after the end of a picture
    assert read_image(path).shape == (96, 128)
    assert capfd.readouterr() == ("", "")


def test_a_heic_picture_is_read_as_the_same_jpeg(tmp_path: Path) -> None:
    pillow_heif = pytest.importorskip("pillow_heif")
    pillow_heif.register_heif_opener()
    pixels = np.full((96, 128, 3), 200, np.uint8)
    pixels[:20, 64:] = (220, 30, 30)  # red, at the upper right
    exif = Image.Exif()
    exif.get_ifd(IFD.Exif)[Base.FocalLengthIn35mmFilm] = 26
    path = tmp_path / "IMG_1.HEIC"
    Image.fromarray(pixels).save(path, format="HEIF", exif=exif, quality=95)
    assert find_images(tmp_path) == [path]
    image = read_image(path)
    assert (image.shape, image.dtype) == ((96, 128, 3), np.uint8)
    assert np.abs(image.astype(int) - pixels[..., ::-1]).mean() < 5
    lens = focal_length(path, (128, 96))
    assert lens is not None
    assert "26 mm" in lens.source
    (tmp_path / "cut.heic").write_bytes(path.read_bytes()[:400])
    with pytest.raises(InputError, match=r"cut.heic: is a HEI. picture that is truncated or damaged"):
        read_image(tmp_path / "cut.heic")


def test_a_heic_picture_without_its_library_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    (tmp_path / "IMG_1.HEIC").write_bytes(b"\0\0\0\x18ftypheic" + bytes(100))
    with pytest.raises(InputError, match=r"pip install 'eimi-lab\[heic\]'.*Most Compatible, or export") as refused:
        read_image(tmp_path / "IMG_1.HEIC")
    assert "\n" not in str(refused.value)
    (tmp_path / "IMG_1.HEIC").rename(tmp_path / "IMG_1.avif")
    with pytest.raises(InputError, match=r"holds no images .*; save IMG_1.avif and similar files as JPEG or PNG"):
        find_images(tmp_path)


def test_the_orientation_of_a_phone_is_obeyed(tmp_path: Path) -> None:
    # A picture with Exif orientation 6 is stored on its side (CIPA DC-008, 4.6.4).
    upright = np.full((96, 64, 3), 200, np.uint8)
    upright[:20] = (30, 30, 220)
    raw = cv2.imencode(".jpg", cv2.rotate(upright, cv2.ROTATE_90_COUNTERCLOCKWISE))[1].tobytes()
    entry = b"\x01\x12\0\x03\0\0\0\x01\0\x06\0\0"
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01" + entry + bytes(4)
    path = tmp_path / "image.jpg"
    path.write_bytes(raw[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + raw[2:])
    assert np.abs(read_image(path).astype(int) - upright).max() < 40


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("opacity", "is_transparent"), [(1.0, False), (0.96, False), (0.94, True), (0.0, True)])
def test_an_image_is_transparent_if_one_pixel_is_clearly_less_than_opaque(
    dtype: type, opacity: float, is_transparent: bool
) -> None:
    largest = np.iinfo(dtype).max
    image = np.full((4, 5, 4), largest, dtype)
    image[2, 3, 3] = round(opacity * largest)
    assert _is_transparent(image) is is_transparent
    assert not _is_transparent(image[..., :3] // 2)  # a colour image has no opacity
    assert not _is_transparent(image[..., 0] // 2)
    assert not _is_transparent(None)


@pytest.mark.parametrize("big_tiff", [False, True])
def test_a_stack_of_pictures_is_refused(tmp_path: Path, frame: Callable[..., np.ndarray], big_tiff: bool) -> None:
    first, *others = (Image.fromarray(frame(seed)) for seed in (1, 2))
    path = tmp_path / "stack.tif"
    first.save(path, save_all=True, append_images=others, big_tiff=big_tiff)
    with pytest.raises(InputError, match=r"stack\.tif: is a stack of pictures; save each picture as a separate file"):
        read_image(path)
    first.save(path, big_tiff=big_tiff)
    np.testing.assert_array_equal(read_image(path), frame(1))
