"""The web page for a folder of pictures gives the right answers about the folder, and writes the right files."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.csv_tables import read_table
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.state_loads import LOAD_COLUMNS, load_of
from eimi_lab.page.by_hand import MOST_FOLDERS, dataset_of, edges, folders, opened, picture, saved
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.process.errors import InputError

NUMBERS = {
    "pixels_per_mm": 8.0,
    "coil_constant_mT_per_A": 4.7,
    "clamp_midpoint_px": [64.0, 8.0],
    "axis_angle_deg": 90.0,
    "gravity_angle_deg": 90.0,
    "field_angle_deg": 0.0,
}


@pytest.fixture
def own(files: Path, frame: Callable[..., Any]) -> Path:
    # A folder with three pictures of a beam; the alphabetical order of their names is not that of the numbers.
    folder = files / "own"
    folder.mkdir()
    for seed, name in enumerate(("p_2", "p_10", "p_11")):
        cv2.imwrite(str(folder / f"{name}.png"), frame(seed, 2.0 * seed))
    return folder


def test_the_first_guess_of_a_calibration_puts_the_beam_into_the_upper_part_of_the_picture(own: Path) -> None:
    # The picture is taken as 60 mm high, with the clamp at 1/6 of the height and the beam below it.
    assert opened(own) == {
        "pictures": ["p_2.png", "p_10.png", "p_11.png"],
        "size_px": [128, 96],
        "currents": {},
        "calibration": {
            "pixels_per_mm": 1.6,
            "coil_constant_mT_per_A": 1.0,
            "clamp_midpoint_px": [64.0, 16.0],
            "axis_angle_deg": 90.0,
            "gravity_angle_deg": 90.0,
            "field_angle_deg": 0.0,
        },
        "written": [],
    }


def test_saved_values_are_read_back_and_give_a_dataset(own: Path, files: Path) -> None:
    typed = {"p_2.png": "0", "p_10.png": "0,25", "p_11.png": " ", "other.png": "1"}
    done = saved(own, {**NUMBERS, "made_by": "page"}, typed, False)
    assert done == {"written": ["calibration.toml", "states.csv"], "states": 2}
    states = (own / "states.csv").read_text().splitlines()
    assert (states[0], sorted(states[1:])) == ("frame,current_A", ["p_10.png,0.25", "p_2.png,0"])
    about = opened(own)
    assert about["calibration"] == NUMBERS
    assert about["currents"] == {"p_2.png": "0", "p_10.png": "0.25"}
    assert about["written"] == ["calibration.toml", "states.csv"]
    assert dataset_of(own, str(files / "specimen.toml"), own / "own.h5", False) == 2
    with open_dataset(own / "own.h5") as dataset:
        assert sorted(state.current_A for state in dataset.states) == [0.0, 0.25]
        assert max(state.field_mT for state in dataset.states) == pytest.approx(4.7 * 0.25)
        assert dataset.specimen.specimen.name == "small"
    with pytest.raises(InputError, match="exists already"):
        dataset_of(own, str(files / "specimen.toml"), own / "own.h5", False)
    assert dataset_of(own, str(files / "specimen.toml"), own / "own.h5", True) == 2


def test_values_that_the_page_cannot_change_stay_in_the_calibration(own: Path) -> None:
    (own / "calibration.toml").write_text(
        "pixels_per_mm = 5.0\ncoil_constant_mT_per_A = 2.0\nclamp_midpoint_px = [1.0, 1.0]\naxis_angle_deg = 80.0\n"
        "gravity_angle_deg = 70.0\nfield_angle_deg = 3.0\ncalibrated_on = 2026-01-02\n"
        "[uncertainty]\npixels_per_mm = 0.04\n"
    )
    saved(own, {"pixels_per_mm": 8.0, "calibrated_on": "2025-05-05"}, {"p_2.png": 1}, True)
    written = load_calibration(own / "calibration.toml")
    assert (written.pixels_per_mm, written.axis_angle_deg, written.field_angle_deg) == (8.0, 80.0, 3.0)
    assert str(written.calibrated_on) == "2026-01-02"
    assert (written.uncertainty or {})["pixels_per_mm"] == 0.04


@pytest.mark.parametrize(
    ("currents", "words"),
    [
        ({"p_2.png": "much"}, "p_2.png: current_A = 'much' should be a number"),
        ({"p_2.png": "nan"}, "p_2.png: current_A = 'nan' should be a number"),
        ({"p_2.png": None, "p_10.png": "x"}, "p_2.png: current_A = None should be a number"),
        ({"p_2.png": "  "}, "own: no picture has a current; enter the current of at least one picture"),
        ({}, "own: no picture has a current; enter the current of at least one picture"),
    ],
)
def test_a_wrong_current_is_refused_before_anything_is_written(own: Path, currents: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as refused:
        saved(own, NUMBERS, currents, False)
    assert str(refused.value) == words
    assert sorted(file.name for file in own.iterdir()) == ["p_10.png", "p_11.png", "p_2.png"]


def test_existing_files_are_replaced_only_on_request(own: Path) -> None:
    (own / "states.csv").write_text("frame,current_A\n,1\np_2.png,\np_10.png,0.5\n")
    assert opened(own)["currents"] == {"p_10.png": "0.5"}
    with pytest.raises(InputError, match=r"states\.csv: exists already"):
        saved(own, NUMBERS, {"p_2.png": 1}, False)
    assert not (own / "calibration.toml").exists()
    assert saved(own, NUMBERS, {"p_2.png": 1}, True)["states"] == 1


def test_other_columns_of_the_states_stay(own: Path) -> None:
    (own / "states.csv").write_text(
        "frame,temperature_degC,current_A,tip_force_N\np_2.png,21.5,0,0\np_10,22,0.5,0.01,more\nold.png,23\n"
    )
    saved(own, NUMBERS, {"p_2.png": "0.1", "p_10.png": "0,6", "p_11.png": "0.7"}, True)
    header, *rows = (own / "states.csv").read_text().splitlines()
    assert header == "frame,current_A,temperature_degC,tip_force_N"
    assert sorted(rows) == ["p_10.png,0.6,22,0.01", "p_11.png,0.7,,", "p_2.png,0.1,21.5,0"]


@pytest.mark.parametrize(
    "text",
    [
        "frame,field_mT,field_sigma_mT\np_2.png,0,0.1\n",
        "frame, current_A, temperature_degC\np_2.png, 0, 21.5\n",
        "\ufeff\nframe;current_A;temperature_degC\np_2.png;0,5;21,5\n",
    ],
)
def test_saved_states_can_be_imported(own: Path, text: str) -> None:
    (own / "states.csv").write_text(text, encoding="utf-8")
    saved(own, NUMBERS, {"p_2.png": "0.1", "p_10.png": "0.6"}, True)
    rows = read_table(own / "states.csv", ["frame"], ["current_A", "temperature_degC"])
    assert {row.cells["frame"]: row.number("current_A") for row in rows} == {"p_2.png": 0.1, "p_10.png": 0.6}
    if "temperature" in text:
        assert rows[0].number("temperature_degC") == 21.5


def test_rows_that_name_pictures_by_their_numbers_keep_their_other_columns(own: Path) -> None:
    (own / "states.csv").write_text("frame,current_A,tip_force_N\n2,0,0.01\n10,0.5,0.02\n77,1,0.03\n")
    assert opened(own)["currents"] == {"p_2.png": "0", "p_10.png": "0.5"}
    saved(own, NUMBERS, {"p_2.png": "0", "p_11.png": "0.7"}, True)
    assert (own / "states.csv").read_text().splitlines() == [
        "frame,current_A,tip_force_N",
        "p_2.png,0,0.01",
        "p_11.png,0.7,",
    ]
    rows = read_table(own / "states.csv", ["frame"], LOAD_COLUMNS)
    calibration = load_calibration(own / "calibration.toml")
    assert [load_of(row, calibration).tip_force_N for row in rows] == [0.01, 0.0]


@pytest.mark.parametrize("written", [False, True])
def test_an_empty_field_is_no_zero(own: Path, written: bool) -> None:
    if written:
        saved(own, NUMBERS, {"p_2.png": 1}, False)
    with pytest.raises(InputError, match="gravity_angle_deg = None should be a valid number"):
        saved(own, {**NUMBERS, "gravity_angle_deg": None}, {"p_2.png": 1}, True)
    saved(own, {**NUMBERS, "coil_constant_mT_per_A": None}, {"p_2.png": 1}, True)
    assert load_calibration(own / "calibration.toml").coil_constant_mT_per_A is None


def test_the_edges_follow_from_the_calibration_on_the_page(own: Path, files: Path) -> None:
    found = edges(own / "p_11.png", NUMBERS, str(files / "specimen.toml"))
    middles = sorted(np.mean(found[side], axis=0)[0] for side in ("left", "right"))
    assert middles == pytest.approx([60.0, 76.0], abs=0.3)
    assert set(found) == {
        *("left", "right", "flags", "tip_angle_deg", "tip_angle_sigma_deg", "blur_px", "blur_limit_px")
    }


def test_points_along_the_beam_are_used_for_the_first_picture_only(own: Path, files: Path) -> None:
    # In the third picture, the beam is 4 px beside the points.
    beside = {**NUMBERS, "picture": {"along_px": [[64.0, 40.0], [64.0, 80.0]], "region_px": [20, 0, 90, 96]}}
    for name, middle in (("p_2.png", 64.0), ("p_11.png", 68.0)):
        found = edges(own / name, beside, str(files / "specimen.toml"))
        middles = sorted(np.mean(found[side], axis=0)[0] for side in ("left", "right"))
        assert middles == pytest.approx([middle - 8.0, middle + 8.0], abs=0.5)


def test_a_wide_picture_is_reduced_to_1600_px(own: Path, frame: Callable[..., Any]) -> None:
    wide = np.tile(frame(1), (1, 25))  # 3200 px
    cv2.imwrite(str(own / "wide.png"), wide)
    shown = cv2.imdecode(np.frombuffer(picture(own / "wide.png"), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert shown.shape == (48, 1600)
    same = cv2.imdecode(np.frombuffer(picture(own / "p_2.png"), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert same.shape == (96, 128)
    changed = frame(9, 20.0)
    cv2.imwrite(str(own / "p_2.png"), changed)  # a picture that is replaced is read again
    again = cv2.imdecode(np.frombuffer(picture(own / "p_2.png"), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert np.mean(np.abs(again.astype(float) - changed)) < 3.0


def test_folders_with_pictures_are_listed_down_to_two_levels(own: Path, files: Path) -> None:
    for name in ("a/b", "a/b/c", ".hidden", "none", "outside"):
        (files / name).mkdir(parents=True, exist_ok=True)
    for name in ("a/b", "a/b/c", ".hidden"):
        shutil.copy(own / "p_2.png", files / name)
    (files / "none" / ".p.png").write_bytes((own / "p_2.png").read_bytes())
    (files / "none" / "p.txt").write_text("no picture")
    assert folders(DataFolder(files)) == ["a/b", "own"]
    shutil.copy(own / "p_2.png", files)
    assert folders(DataFolder(files)) == [".", "a/b", "own"]
    assert folders(DataFolder(files / "a")) == ["b", "b/c"]
    (files / "a" / "link").symlink_to(own)
    assert folders(DataFolder(files / "a")) == ["b", "b/c"]  # a link out of the data folder is not followed


def test_a_folder_that_may_not_be_read_is_left_out(own: Path, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (files / "lost+found").mkdir()
    iterdir = Path.iterdir

    def refused(path: Path) -> Any:
        if path.name == "lost+found":
            raise PermissionError(13, "Permission denied", str(path))
        return iterdir(path)

    monkeypatch.setattr(Path, "iterdir", refused)
    assert folders(DataFolder(files)) == ["own"]


def test_at_most_200_folders_are_searched(tmp_path: Path, own: Path) -> None:
    for number in range(MOST_FOLDERS + 2):
        folder = tmp_path / "many" / f"{number:03d}"
        folder.mkdir(parents=True)
        (folder / "p.png").touch()
    assert len(folders(DataFolder(tmp_path / "many"))) == 199  # the data folder itself is one of the 200
