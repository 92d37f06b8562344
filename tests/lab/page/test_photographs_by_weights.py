"""The view "Weights and a phone" gives the right answers about photographs, and writes the right files."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.page.by_weights import accepted, edges, opened, picture, saved
from eimi_lab.process.errors import InputError

CLICKED = {  # the drawn beam is 80 px long and 16 px wide, at 8 px/mm
    "clamp_px": [[64, 8]],
    "tip_px": [64, 88],
    "ruler_px": [[20, 4], [100, 4]],
    "ruler_mm": "10,0",
    "leaves": "downward",
    "stand_off_mm": 200,
}
BEAM = {
    "name": " drawn ",
    "material": 'a "soft" one',
    "length_mm": "10",
    "width_mm": "2,0",
    "depth_mm": 2,
    "density_kg_m3": "1070",
    "length_mm_sigma": "0,1",
    "width_mm_sigma": "0.02",
    "depth_mm_sigma": "0.03",
    "thread_mm": "9,5",
}
GRAMS = {"IMG_2.png": "0", "IMG_10.png": "1,5", "IMG_11.png": " "}
SPECIMEN_TEXT = """\
# Written by the page "Weights and a phone". The length is the distance from the clamp to the tip. The camera
# sees the width. The depth is the size along the line of sight of the camera.
[specimen]
name = "drawn"
material = "a \\"soft\\" one"
length_mm = 10
width_mm = 2
depth_mm = 2
density_kg_m3 = 1070

[tip_load]    # where the thread of the weights is attached
x_mm = 9.5
y_mm = 0.0

[uncertainty]    # standard uncertainties
length_mm = 0.1
width_mm = 0.02
depth_mm = 0.03
density_kg_m3 = 10    # assumed
"""


@pytest.fixture
def photographed(tmp_path: Path, frame: Callable[..., Any]) -> Path:
    # A folder with three photographs of a beam, a hidden photograph and a file that is no photograph.
    folder = tmp_path / "weights"
    folder.mkdir()
    for seed, name in enumerate(("IMG_2", "IMG_10", "IMG_11")):
        cv2.imwrite(str(folder / f"{name}.png"), frame(seed, 2.0 * seed))
    shutil.copy(folder / "IMG_2.png", folder / ".IMG_1.png")
    (folder / "notes.txt").write_text("notes")
    return folder


def test_an_empty_folder_and_a_folder_of_photographs_are_described(photographed: Path, tmp_path: Path) -> None:
    about = {"lens": "", "beam": {}, "grams": {}, "written": []}
    assert opened(photographed) == {
        "pictures": ["IMG_2.png", "IMG_10.png", "IMG_11.png"],
        "size_px": [128, 96],
        "dataset": "weights.h5",
        **about,
    }
    (tmp_path / "empty").mkdir()
    assert opened(tmp_path / "empty") == {"pictures": [], "size_px": [0, 0], "dataset": "empty.h5", **about}
    (tmp_path / "empty" / "states.csv").write_text("frame,tip_force_N\nIMG_2.png,0.01\n")  # the photographs come later
    described = opened(tmp_path / "empty")
    assert (described["pictures"], described["grams"], described["written"]) == ([], {}, ["states.csv"])
    with pytest.raises(InputError, match="is not a folder"):
        opened(tmp_path / "none")


def test_the_focal_length_of_a_photograph_is_described(photographed: Path, tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(IFD.Exif)[Base.FocalLengthIn35mmFilm] = 26
    (tmp_path / "phone").mkdir()
    Image.open(photographed / "IMG_2.png").save(tmp_path / "phone" / "a.jpg", exif=exif)
    about = opened(tmp_path / "phone")
    assert about["lens"] == "focal length of 26 mm (35 mm equivalent) from the Exif data of the picture"
    clicked = {key: value for key, value in CLICKED.items() if key != "stand_off_mm"}
    found = edges(tmp_path / "phone" / "a.jpg", clicked, BEAM)
    # The focal length in pixels is 26 mm times the diagonal of 160 px over 43.27 mm.
    assert [row[1] for row in found["sources"] if row[0] == "stand_off_mm"] == ["12 ± 0.36"]


def test_the_edges_of_a_photograph_and_the_sources_of_its_numbers(photographed: Path) -> None:
    os.utime(photographed / "IMG_2.png", (86_400.0 * 20_000, 86_400.0 * 20_000))
    found = edges(photographed / "IMG_2.png", CLICKED, BEAM)
    middles = sorted(np.mean(found[side], axis=0)[0] for side in ("left", "right"))
    assert middles == pytest.approx([56.0, 72.0], abs=0.3)
    assert found["tip_angle_deg"] == pytest.approx(0.0, abs=1.5)
    assert {key: value for key, value, _ in found["sources"]} == {
        "pixels_per_mm": "8 ± 0.15",
        "clamp_midpoint_px": "64, 8.2 ± 1",
        "axis_angle_deg": "90 ± 0.5",
        "gravity_angle_deg": "90 ± 1.1",
        "stand_off_mm": "200 ± 10",
        "camera_tilt_deg": "0, 0 ± 2",
    }
    assert found["sources"][0][2] == "ticks of the ruler, 10 mm and 80.0 px apart"


def test_points_along_the_beam_belong_to_the_first_photograph(photographed: Path) -> None:
    clicked = {**CLICKED, "along_px": [[64, 40]], "tip_px": [64, 85]}
    other = edges(photographed / "IMG_11.png", clicked, BEAM)  # its beam lies 4 px beside these points
    middles = sorted(np.mean(other[side], axis=0)[0] for side in ("left", "right"))
    assert middles == pytest.approx([60.0, 76.0], abs=0.3)
    with pytest.raises(InputError) as refused:
        saved(photographed, clicked, BEAM, {"IMG_10.png": 0, "IMG_11.png": 1}, False)
    assert str(refused.value) == (
        "IMG_2.png: points along the beam were clicked on this picture; type also the weight on the beam, in grams"
    )
    assert saved(photographed, clicked, BEAM, GRAMS, False)["states"] == 2
    along = load_calibration(photographed / "calibration.toml").picture
    assert along is not None
    assert along.along_px == ((64.0, 40.0), (64.0, 85.0))


@pytest.mark.parametrize(
    "text",
    [
        "frame,field_mT,tip_force_N\nIMG_2.png,0,0\n",
        "frame,current_A\nIMG_2.png,0\nIMG_10.png,0.3\n",
        "frame,tip_force_N,note\nIMG_2,0,at noon\n",
        "\ufeffframe;tip_force_N;\n2;0,01;\n",
    ],
)
def test_saved_weights_can_be_imported(photographed: Path, text: str) -> None:
    (photographed / "states.csv").write_text(text, encoding="utf-8")
    assert saved(photographed, CLICKED, BEAM, GRAMS, True)["states"] == 2


def test_temperatures_stay_in_the_table_of_weights(photographed: Path) -> None:
    (photographed / "states.csv").write_text("frame,tip_force_N,temperature_degC\n10,0.01,21.5\n")
    saved(photographed, CLICKED, BEAM, GRAMS, True)
    lines = (photographed / "states.csv").read_text().splitlines()
    assert lines == ["frame,tip_force_N,temperature_degC", "IMG_2.png,0,", "IMG_10.png,0.01470998,21.5"]


def test_a_table_that_is_not_csv_is_refused(photographed: Path) -> None:
    (photographed / "states.csv").write_text("frame,tip_force_N\nIMG_2.png," + 140_000 * "1" + "\n")
    with pytest.raises(InputError, match=r"states\.csv: row 2: is not CSV"):
        opened(photographed)


def test_the_files_beside_the_photographs_contain_what_was_typed(photographed: Path) -> None:
    done = saved(photographed, CLICKED, BEAM, GRAMS, False)
    files = ["specimen.toml", "calibration.toml", "states.csv"]
    assert {key: done[key] for key in ("written", "states", "dataset")} == {
        "written": files,
        "states": 2,
        "dataset": "weights.h5",
    }
    assert done["sources"] == edges(photographed / "IMG_2.png", CLICKED, BEAM)["sources"]
    assert (photographed / "specimen.toml").read_text() == SPECIMEN_TEXT
    assert (photographed / "states.csv").read_text() == "frame,tip_force_N\nIMG_2.png,0\nIMG_10.png,0.01470998\n"
    with open_dataset(photographed / "weights.h5") as dataset:
        assert [state.tip_force_N for state in dataset.states] == [0.0, 0.01470998]
        assert dataset.specimen.specimen.material == 'a "soft" one'
    about = opened(photographed)
    assert about["written"] == files
    assert about["grams"] == {"IMG_2.png": "0", "IMG_10.png": "1.5"}
    typed = {key: str(value).strip().replace(",", ".") for key, value in BEAM.items()}
    assert about["beam"] == {**typed, "width_mm": "2"}
    assert load_specimen(photographed / "specimen.toml").uncertainty == {
        "length_mm": 0.1,
        "width_mm": 0.02,
        "depth_mm": 0.03,
        "density_kg_m3": 10.0,
    }


def test_existing_files_are_replaced_only_on_request(photographed: Path) -> None:
    saved(photographed, CLICKED, BEAM, GRAMS, False)
    (photographed / "specimen.toml").unlink()
    before = {file.name: file.read_bytes() for file in photographed.iterdir()}
    with pytest.raises(InputError, match=r"calibration\.toml: exists already"):
        saved(photographed, CLICKED, {**BEAM, "name": ""}, GRAMS, False)
    assert {file.name: file.read_bytes() for file in photographed.iterdir()} == before
    changed = saved(photographed, CLICKED, {**BEAM, "name": "", "material": None}, {**GRAMS, "IMG_11.png": 2}, True)
    assert changed["states"] == 3
    written = load_specimen(photographed / "specimen.toml").specimen
    assert (written.name, written.material) == ("weights", "not given")


def test_a_photograph_that_cannot_be_imported_leaves_no_new_file(photographed: Path) -> None:
    cv2.imwrite(str(photographed / "IMG_10.png"), np.zeros((128, 96), np.uint8))  # upright, unlike the first one
    (photographed / "states.csv").write_text("old")
    before = sorted(photographed.iterdir())
    with pytest.raises(InputError, match="all pictures of a dataset need the same size"):
        saved(photographed, CLICKED, BEAM, GRAMS, True)
    assert sorted(photographed.iterdir()) == before
    (photographed / "states.csv").unlink()
    cv2.imwrite(str(photographed / "IMG_10.png"), np.zeros((96, 128), np.uint8))
    assert saved(photographed, CLICKED, BEAM, GRAMS, False)["states"] == 2


@pytest.mark.parametrize(
    ("clicks", "beam", "grams", "words"),
    [
        ({"ruler_mm": "ten"}, {}, {}, "ruler_mm = 'ten' should be a number"),
        ({"stand_off_mm": "inf"}, {}, {}, "stand_off_mm = 'inf' should be a number"),
        ({"stand_off_mm": " "}, {}, {}, "stand_off_mm is missing: the picture has no focal length"),
        ({"reached": 1}, {}, {}, "clicks: reached is not a known key"),
        ({}, {"depth_mm": None}, {}, "depth_mm is missing; type a number"),
        ({}, {"depth_mm_sigma": ""}, {}, "depth_mm_sigma is missing; type a number"),
        ({}, {"thread_mm": "x"}, {}, "thread_mm = 'x' should be a number"),
        ({}, {}, {"IMG_10.png": "much"}, "IMG_10.png = 'much' should be a number"),
        ({}, {}, {"IMG_10.png": "0"}, "the folder needs at least two pictures with different weights"),
        ({}, {}, {"IMG_10.png": ""}, "the folder needs at least two pictures with different weights"),
    ],
)
def test_a_wrong_number_is_refused_before_anything_is_written(
    photographed: Path, clicks: dict[str, Any], beam: dict[str, Any], grams: dict[str, Any], words: str
) -> None:
    before = sorted(photographed.iterdir())
    with pytest.raises(InputError) as refused:
        saved(photographed, {**CLICKED, **clicks}, {**BEAM, **beam}, {**GRAMS, **grams}, False)
    assert words in str(refused.value)
    assert sorted(photographed.iterdir()) == before


def test_a_folder_without_photographs_has_no_edges(photographed: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="there is no picture in the folder; drop the pictures of the beam first"):
        saved(tmp_path / "empty", CLICKED, BEAM, GRAMS, False)


def test_without_a_thread_the_weights_hang_at_the_tip(photographed: Path) -> None:
    saved(photographed, CLICKED, {**BEAM, "thread_mm": ""}, GRAMS, False)
    assert "x_mm" not in (photographed / "specimen.toml").read_text()
    assert opened(photographed)["beam"]["thread_mm"] == ""


def test_rows_of_states_without_a_force_are_left_out(photographed: Path) -> None:
    (photographed / "states.csv").write_text("frame,tip_force_N\nIMG_2.png,\nIMG_10.png,0.02941995\nIMG_11.png,x\n")
    assert opened(photographed)["grams"] == {"IMG_10.png": "3"}


def test_a_photograph_is_shown_in_its_full_size(photographed: Path, frame: Callable[..., Any]) -> None:
    wide = np.tile(frame(1), (1, 16))
    cv2.imwrite(str(photographed / "wide.png"), wide)
    shown = cv2.imdecode(np.frombuffer(picture(photographed / "wide.png"), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert shown.shape == (96, 2048)
    assert np.mean(np.abs(shown.astype(float) - wide)) < 3.0


def test_a_received_photograph_gets_its_name_unless_a_different_one_has_it(photographed: Path) -> None:
    received, target = photographed / ".received.png", photographed / "IMG_12.png"
    shutil.copy(photographed / "IMG_2.png", received)
    assert accepted(received, target) == {"picture": "IMG_12.png", "size_px": [128, 96]}
    assert (received.exists(), target.read_bytes()) == (False, (photographed / "IMG_2.png").read_bytes())
    shutil.copy(photographed / "IMG_2.png", received)
    assert accepted(received, target)["picture"] == "IMG_12.png"  # the same photograph again
    shutil.copy(photographed / "IMG_10.png", received)
    with pytest.raises(InputError) as refused:
        accepted(received, target)
    assert str(refused.value) == (
        "IMG_12.png: a different picture with this name is in the folder; rename one of the two pictures"
    )
    assert (received.exists(), target.read_bytes()) == (False, (photographed / "IMG_2.png").read_bytes())
    received.write_bytes(b"\x89PNG")
    with pytest.raises(InputError, match=r"^IMG_13\.png: is "):
        accepted(received, photographed / "IMG_13.png")
    assert not received.exists()
    assert not (photographed / "IMG_13.png").exists()
