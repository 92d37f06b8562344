"""In a browser, a user drags the marks of clamp, axis and scale into place in a picture, and saves the calibration."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eimi_lab.config.calibration import load_calibration
from eimi_lab.dataset.reading import open_dataset


def drag(page: Any, name: str, x: float, y: float) -> None:
    # Drag the handle `name` to the pixel (x, y) of a picture of 128 x 96 pixels.
    box = page.locator("#by-hand svg").bounding_box()
    handle = page.get_by_role("button", name=name).bounding_box()
    page.mouse.move(handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + (x + 0.5) / 128 * box["width"], box["y"] + (y + 0.5) / 96 * box["height"], steps=4)
    page.mouse.up()


def test_a_calibration_is_dragged_into_place_saved_and_used(served: Any, tab: Any) -> None:
    folder = served.folder / "own"
    shutil.copytree(served.folder / "frames", folder)
    page = tab(f"{served.address}#pictures")
    page.get_by_label("Folder of pictures").select_option("own")
    page.get_by_label("Specimen (for length").select_option("specimen.toml")
    page.get_by_role("button", name="frame_2.png").wait_for()
    page.locator("#by-hand-words:not(:empty)").wait_for()  # the handles no longer move
    page.get_by_label("current of frame_1.png").fill("0")
    page.get_by_label("current of frame_2.png").fill("0,2")
    drag(page, "first end of the ruler", 30, 90)
    drag(page, "second end of the ruler", 110, 90)  # the length of the beam, 10 mm, is 80 px
    drag(page, "middle of the clamp", 66, 8)
    drag(page, "direction of the straight beam", 66, 70)
    page.get_by_role("button", name="middle of the clamp").press("ArrowRight")
    page.get_by_role("button", name="middle of the clamp").press("ArrowLeft")
    page.locator("#by-hand polyline.edge >> nth=1").wait_for(state="attached")
    page.get_by_role("button", name="Save").click()
    page.get_by_text("2 pictures have a current").wait_for()
    saved = load_calibration(folder / "calibration.toml")
    assert saved.pixels_per_mm == pytest.approx(8.0, rel=0.02)
    assert saved.clamp_midpoint_px == pytest.approx((66.0, 8.0), abs=0.6)
    assert saved.axis_angle_deg == pytest.approx(90.0, abs=1.5)
    assert (folder / "states.csv").read_text() == "frame,current_A\nframe_1.png,0\nframe_2.png,0.2\n"
    page.get_by_role("button", name="Save").click()
    page.get_by_text("exists already").wait_for()
    page.get_by_label("current of frame_2.png").fill("1.5")
    page.get_by_role("button", name="Make a dataset").click()
    page.get_by_text("press Save first").wait_for()
    assert not (folder / "own.h5").exists()
    page.get_by_label("current of frame_2.png").fill("0,2")
    page.get_by_role("button", name="Make a dataset").click()
    page.get_by_text("own/own.h5: 2 states").wait_for()
    with open_dataset(folder / "own.h5") as dataset:
        assert [state.current_A for state in dataset.states] == [0.0, 0.2]


def test_points_clicked_along_the_beam_are_stored_with_the_dataset(served: Any, tab: Any) -> None:
    folder = served.folder / "clicked"
    shutil.copytree(served.folder / "frames", folder)
    (folder / "calibration.toml").write_text((served.folder / "calibration.toml").read_text())
    page = tab(f"{served.address}#pictures")
    page.get_by_label("Folder of pictures").select_option("clicked")
    page.get_by_label("Specimen (for length").select_option("specimen.toml")
    page.locator("#by-hand-words:not(:empty)").wait_for()
    for name in ("frame_1.png", "frame_2.png"):
        page.get_by_label(f"current of {name}").fill("0,1")
    box = page.locator("#by-hand svg").bounding_box()

    def click(x: float, y: float) -> None:
        page.mouse.click(box["x"] + (x + 0.5) / 128 * box["width"], box["y"] + (y + 0.5) / 96 * box["height"])

    for place in ((64, 26), (64, 38), (80, 70)):
        click(*place)
    page.get_by_text("3 points along the beam").wait_for()
    page.get_by_role("button", name="Undo the last point").locator("visible=true").click()
    page.get_by_text("2 points along the beam").wait_for()
    page.get_by_role("button", name="frame_2.png").click()
    page.get_by_role("button", name="frame_2.png").and_(page.locator("[aria-current=true]")).wait_for()
    click(70, 40)  # this point is clicked on the second picture
    page.locator("#replace").check()
    page.get_by_role("button", name="Save", exact=True).click()
    page.get_by_text("2 pictures have a current").wait_for()
    page.get_by_role("button", name="Make a dataset").click()
    page.get_by_text("clicked/clicked.h5: 1 states").wait_for()
    with open_dataset(folder / "clicked.h5") as dataset:
        assert dataset.calibration is not None
        assert dataset.calibration.picture is not None
        assert np.allclose(dataset.calibration.picture.along_px or (), [(64, 26), (64, 38)], atol=0.6)


def test_nothing_of_the_previous_folder_is_saved_or_searched_while_a_folder_is_opened(served: Any, tab: Any) -> None:
    chosen = served.folder / "zzz"
    shutil.copytree(served.folder / "frames", chosen)
    page = tab(f"{served.address}#pictures")
    page.get_by_text("in control", exact=True).wait_for()
    page.locator("#by-hand-words:not(:empty)").wait_for()
    held: list[Any] = []
    page.route(re.compile(r"/api/pictures\?folder=zzz"), lambda route: held.append(route))
    page.get_by_label("Folder of pictures").select_option("zzz")
    page.get_by_role("button", name="middle of the clamp").press("ArrowRight")
    page.get_by_role("button", name="Save").click()
    page.get_by_text("the folder is still being opened").wait_for()
    page.wait_for_timeout(400)  # the edges would be searched after 120 ms
    assert page.locator("#by-hand-words").inner_text() == ""
    for route in held:
        route.continue_()
    page.locator("#by-hand-words:not(:empty)").wait_for()
    page.get_by_label("current of frame_1.png").fill("0")
    page.get_by_role("button", name="Save").click()
    page.get_by_text("saved calibration.toml and states.csv in zzz: 1 pictures have a current").wait_for()
    shutil.rmtree(chosen)


@pytest.mark.parametrize(
    ("requested", "words"),
    [
        ({"folder": "..", "picture": "x.png"}, "leads out of the folder"),
        ({"folder": "frames", "picture": "../../x.png"}, "leads out of the folder"),
        ({"folder": "frames", "picture": "frame_1.png", "specimen": "type1"}, "calibration is missing"),
        ({"folder": "frames", "picture": "frame_1.png", "specimen": "type1", "calibration": {}}, "are missing"),
        ({"folder": "frames", "picture": "frame_1.png", "specimen": "../type1"}, "leads out of the folder"),
    ],
)
def test_the_answer_to_a_wrong_request_names_the_mistake(served: Any, requested: dict[str, Any], words: str) -> None:
    answer = served.ask("/api/pictures/edges", "POST", json.dumps(requested).encode(), Origin=f"http://{served.host}")
    assert answer.status == 400
    assert words in json.loads(answer.body)["error"]


def test_only_the_tab_in_control_writes_files(served: Any, tmp_path: Path) -> None:
    answer = served.ask("/api/pictures/save", "POST", b"{}", Origin=f"http://{served.host}", X_Tab="")
    assert (answer.status, "take control first" in answer.body.decode()) == (400, True)
