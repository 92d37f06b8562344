"""The codes and names of other programs and standards are right in the tables of this program."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_lab.config import toml
from eimi_lab.config.calibration import DISTORTION_LENGTHS
from eimi_lab.process import console, replacing
from eimi_lab.process.errors import InputError
from eimi_lab.publishing.contents import MEDIA_TYPES, PublishedFile
from eimi_lab.reporting.elements import _LATEX, _latex
from eimi_lab.vision import image_files
from eimi_lab.vision.calibration.board import _DICTIONARIES
from eimi_lab.vision.heic import _BRANDS, kind_of
from eimi_lab.vision.projection import _CHANNELS


def test_grey_is_the_luma_of_opencv_and_a_channel_is_itself() -> None:
    # The weights are those of ITU-R BT.601; the colour channels are blue, green and red.
    colours = np.random.default_rng(1).integers(0, 256, (50, 1, 3), dtype=np.uint8)
    places = {"blue": colours[..., 0], "green": colours[..., 1], "red": colours[..., 2]}
    places["grey"] = cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)
    assert _CHANNELS.keys() == places.keys()
    for name, weights in _CHANNELS.items():
        np.testing.assert_allclose(colours @ np.array(weights), places[name], atol=0.51, err_msg=name)


def test_the_numbers_of_distortion_coefficients_are_those_of_opencv() -> None:
    def is_read(number: int) -> bool:
        try:
            cv2.undistortPoints(np.zeros((1, 1, 2)), np.eye(3), np.zeros(number))
        except cv2.error:
            return False
        return True

    assert [number for number in range(1, 20) if is_read(number)] == list(DISTORTION_LENGTHS)


def test_each_dictionary_of_markers_has_its_number_of_markers() -> None:
    for count, name in _DICTIONARIES.items():
        dictionary = cv2.aruco.getPredefinedDictionary(name)
        assert (len(dictionary.bytesList), dictionary.markerSize) == (count, 4)
    assert list(_DICTIONARIES) == sorted(_DICTIONARIES)


@pytest.mark.parametrize(
    ("brand", "words"),
    [
        (b"heic", "a HEIC picture"),
        (b"heix", "a HEIC picture"),
        (b"mif1", "a HEIF picture"),
        (b"msf1", "a HEIF picture"),
        (b"avif", "an AVIF picture"),
        (b"mp42", ""),
    ],
)
def test_the_brands_of_heic_pictures(brand: bytes, words: str) -> None:
    # The brand is the code of the format in the first bytes of a HEIC file (ISO/IEC 23008-12, annex B).
    assert _BRANDS.keys() == {b"heic", b"heix", b"mif1", b"msf1", b"avif"}
    assert kind_of(b"\0\0\0\x18ftyp" + brand) == words
    assert kind_of(b"\0\0\0\x18free" + brand) == ""


def test_the_codes_of_windows() -> None:
    # The errors of a file in use are ERROR_ACCESS_DENIED, ERROR_SHARING_VIOLATION and ERROR_LOCK_VIOLATION.
    assert replacing._IN_USE == (5, 32, 33)
    assert console._CLOSING == (2, 5, 6)


def test_every_sign_of_latex_is_escaped() -> None:
    # A sign outside ASCII becomes a command.
    for sign in "&%$#_{}":
        assert _latex(f"a{sign}b") == f"a\\{sign}b"
    commands = {"\\": "textbackslash", "~": "textasciitilde", "^": "textasciicircum", "µ": "textmu", "…": "ldots"}
    commands |= {"<": "textless", ">": "textgreater"}
    in_mathematics = {"≥": r"\geq", "×": r"\times", "±": r"\pm", "−": "-", "³": "^3", "Δ": r"\Delta"}
    in_mathematics |= {"λ": r"\lambda", "°": r"^\circ"}
    assert set(_LATEX) == {*"&%$#_{}", *commands, *in_mathematics}
    assert {sign: _latex(sign) for sign in commands} == {sign: f"\\{name}{{}}" for sign, name in commands.items()}
    assert {sign: _latex(sign) for sign in in_mathematics} == {sign: f"${tex}$" for sign, tex in in_mathematics.items()}


@pytest.mark.parametrize(
    ("ending", "media_type"),
    [
        (".h5", "application/x-hdf5"),
        (".toml", "application/toml"),
        (".json", "application/json"),
        (".inp", "text/plain"),
        (".feb", "application/xml"),
        (".html", "text/html"),
        (".HTML", "text/html"),
        (".png", "image/png"),
        (".unknown", "application/octet-stream"),
    ],
)
def test_the_media_type_of_a_published_file(ending: str, media_type: str) -> None:
    # The types are those of the IANA registry; HDF5, which is not registered, has its usual type.
    assert MEDIA_TYPES.keys() == {".h5", ".toml", ".json", ".inp", ".feb", ".html"}
    file = PublishedFile(PurePosixPath(f"a{ending}"), Path("a"), "other", 1, "", "", "")
    assert file.media_type == media_type


@pytest.mark.parametrize("ending", [".xlsx", ".xls", ".ods", ".numbers", ".XLSX"])
def test_a_spreadsheet_in_place_of_a_text_is_named(tmp_path: Path, ending: str) -> None:
    assert {".xlsx", ".xls", ".ods", ".numbers"} == toml.SPREADSHEETS
    path = tmp_path / f"states{ending}"
    path.write_bytes(b"PK\x03\x04\xff\xfe")
    with pytest.raises(InputError, match="is a spreadsheet; save its table as CSV"):
        toml.read_text(path)


@pytest.mark.parametrize("ending", sorted(image_files.ENDINGS - {".heic", ".heif"}))
def test_an_image_of_every_ending_is_listed_and_read(tmp_path: Path, ending: str) -> None:
    image: Any = np.full((20, 30), 100, np.uint8)
    cv2.imwrite(str(tmp_path / f"a{ending}"), image)
    (path,) = image_files.find_images(tmp_path)
    assert np.abs(image_files.read_image(path).astype(int) - 100).max() <= 2


OTHERS = (".avif", ".dng", ".webp", ".gif", ".jp2", ".jxl", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf")


@pytest.mark.parametrize("ending", OTHERS)
def test_a_folder_of_other_pictures_gets_advice(tmp_path: Path, ending: str) -> None:
    assert set(OTHERS) == image_files._OTHER_ENDINGS
    (tmp_path / f"a{ending}").write_bytes(b"picture")
    with pytest.raises(InputError, match=f"; save a{ending} and similar files as JPEG or PNG"):
        image_files.find_images(tmp_path)
