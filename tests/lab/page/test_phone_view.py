"""In the view "Weights and a phone", photographs, clicks and typed values lead to the modulus of a beam."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.reading import open_dataset
from tests.shared.phone_photographs import RULER_MM, bent_bodies, clicks, drawn_scene, measured_sizes, photograph

GRAMS = (0.0, 1.0, 3.0)
SHARE = 0.3  # share of 4032 x 3024 px


@pytest.fixture(scope="module")
def scene() -> Any:
    return replace(drawn_scene(3, SHARE), grams=GRAMS)


@pytest.fixture(scope="module")
def bodies(scene: Any) -> Any:
    return bent_bodies(scene)


@pytest.fixture(scope="module")
def photographs(scene: Any, bodies: Any, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    # Three rendered photographs: of the beam alone, and of the beam with each of two weights.
    folder = tmp_path_factory.mktemp("phone")
    paths = [folder / f"IMG_{number}.jpg" for number in range(len(GRAMS))]
    for number, (path, body, grams) in enumerate(zip(paths, bodies, GRAMS, strict=True)):
        path.write_bytes(photograph(scene, body, grams, number))
    return paths


class Phone:
    def __init__(self, page: Any, size: tuple[int, int]) -> None:
        self.page, self.size = page, size

    def drop(self, photographs: list[Path]) -> None:
        self.page.locator("#phone-files").set_input_files([str(path) for path in photographs])
        self.page.get_by_text(re.compile(r"pictures? (is|are) in the folder")).wait_for()

    def click(self, place: list[float]) -> None:
        # Click at `place` (x, y in px of the photograph), and correct the point with the arrow keys.
        marks = self.page.locator("#phone-picture .mark")
        before = marks.count()
        box = self.page.locator("#phone-picture svg").bounding_box()
        x, y = ((at + 0.5) / extent for at, extent in zip(place, self.size, strict=True))
        self.page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        marks.nth(before).wait_for(state="attached")
        placed = position(marks.nth(before))
        for key, off in zip(("Arrow{}Right Arrow{}Left", "Arrow{}Down Arrow{}Up"), (0, 1), strict=True):
            more = round(place[off] - placed[off])
            for _ in range(abs(more)):
                marks.nth(before).press(key.replace("{}", "").split()[more < 0])

    def type(self, **values: object) -> None:
        for key, value in values.items():
            self.page.locator(f'[data-key="{key}"]').fill(f"{value}")


@pytest.fixture
def phone(served: Any, tab: Any, scene: Any) -> Any:
    page = tab(f"{served.address}#phone")
    page.set_viewport_size({"width": 1280, "height": 900})
    return Phone(page, scene.size)


def test_photographs_clicks_and_typed_numbers_lead_to_the_modulus(
    served: Any, phone: Phone, scene: Any, bodies: Any, photographs: list[Path]
) -> None:
    folder = served.folder / "level"
    folder.mkdir()
    (folder / "IMG_0.jpg").write_bytes(photographs[0].read_bytes())  # so that the folder can be chosen
    page = phone.page
    page.reload()
    page.locator("#phone-folder option[value=level]").wait_for(state="attached")
    page.locator("#phone-folder").select_option("level")
    page.get_by_text("Click 1 of 4").wait_for()
    phone.drop(photographs)
    rng = np.random.default_rng(1)
    clicked = clicks(scene, bodies[0].tip, RULER_MM, rng, 0.5)
    for place in (*clicked["clamp_px"], clicked["tip_px"], *clicked["ruler_px"]):
        phone.click(place)
    page.get_by_role("button", name="Undo the last point").click()
    page.get_by_text("Click 4 of 4: second tick of the ruler").wait_for()
    phone.click(clicked["ruler_px"][1])
    page.get_by_role("button", name="Save and fit").click()
    page.locator(
        ".field-error", has_text="length_mm is missing"
    ).wait_for()  # the message is beside the field with the mistake
    assert page.locator('[data-key="length_mm"]').get_attribute("aria-invalid") == "true"
    phone.type(**measured_sizes(scene, rng), width_mm_sigma="0,03", ruler_mm="50,0")
    page.locator("#phone-picture polyline.edge >> nth=1").wait_for(state="attached")
    page.get_by_text("edges found in IMG_").wait_for()
    phone.type(**{path.name: grams for path, grams in zip(photographs, GRAMS, strict=True)})
    (folder / "states.csv").write_text("of another program\n")  # after the view has opened the folder
    replaces = page.get_by_label("replace existing files in the folder")
    assert replaces.is_hidden()
    page.get_by_role("button", name="Save and fit").click()
    replaces.check()
    page.get_by_role("button", name="Save and fit").click()
    page.locator("#phone-report[href]").wait_for()
    page.locator("#phone-words", has_text="done").wait_for()
    shown = float(page.locator("#phone-modulus").inner_text().removesuffix(" kPa"))
    low, high = (float(end) for end in re.findall(r"[\d.]+", page.locator("#phone-interval").inner_text())[1:3])
    assert low < scene.modulus_Pa / 1e3 < high
    assert shown == pytest.approx(scene.modulus_Pa / 1e3, rel=0.05)
    assert "width: " in page.locator("#phone-budget").inner_text()
    page.get_by_role("button", name="Show the states").click()
    page.locator("#run-title", has_text="level/level.h5").wait_for()
    check_files(folder, scene)


def check_files(folder: Path, scene: Any) -> None:
    # Assert that other commands can read the files that the view has written.
    calibration = load_calibration(folder / "calibration.toml")
    assert (calibration.coil_constant_mT_per_A, calibration.field_angle_deg) == (None, None)
    assert not calibration.telecentric
    assert calibration.stand_off_mm == pytest.approx(float(np.linalg.norm(scene.camera_mm)), rel=0.1)
    assert "# ticks of the ruler, 50 mm" in calibration.text
    assert load_specimen(folder / "specimen.toml").tip_load is not None
    assert (folder / "states.csv").read_text().splitlines()[:2] == ["frame,tip_force_N", "IMG_0.jpg,0"]
    with open_dataset(folder / "level.h5") as dataset:
        assert [round(state.tip_force_N / 9.80665e-3, 6) for state in dataset.states] == list(GRAMS)


def test_points_can_be_set_and_moved_on_the_screen_of_a_phone(
    served: Any, tab: Any, scene: Any, photographs: list[Path]
) -> None:
    # Arrow keys move a cross, Enter sets a point, Backspace removes the last point, and Ctrl+Y sets it again.
    page = tab(f"{served.address}#phone")
    page.set_viewport_size({"width": 390, "height": 844})
    (served.folder / "hand").mkdir(exist_ok=True)
    (served.folder / "hand" / "IMG_0.jpg").write_bytes(photographs[0].read_bytes())
    page.reload()
    page.locator("#phone-folder option[value=hand]").wait_for(state="attached")
    page.locator("#phone-folder").select_option("hand")
    page.get_by_text("Click 1 of 4").wait_for()
    figure = page.locator("#phone-picture")
    figure.focus()
    for key in ("ArrowRight", "ArrowDown", "Shift+ArrowLeft", "Enter", "ArrowRight", "Enter"):
        page.keyboard.press(key)
    page.get_by_text("Click 3 of 4").wait_for()
    page.keyboard.press("Backspace")
    page.get_by_text("Click 2 of 4").wait_for()
    marks = page.locator("#phone-picture .mark")
    assert marks.count() == 1
    assert page.locator("html").evaluate("root => root.scrollWidth") <= 390
    page.get_by_role("button", name="Remove all points").click()
    page.get_by_text("Click 1 of 4").wait_for()
    page.get_by_role("button", name="Redo").click()
    page.get_by_text("Click 2 of 4").wait_for()
    figure.focus()
    page.keyboard.press("Control+y")
    page.get_by_text("Click 3 of 4").wait_for()
    assert page.get_by_role("button", name="Redo").is_disabled()
    touched = page.context.new_cdp_session(page)
    touched.send("Emulation.setTouchEmulationEnabled", {"enabled": True})
    figure.scroll_into_view_if_needed()
    before, box = position(marks.last), figure.bounding_box()
    at = [(before[axis] + 0.5) / scene.size[0] * box["width"] + box["xy"[axis]] for axis in (0, 1)]
    for moved in range(0, 50, 10):
        kind = "touchMove" if moved else "touchStart"
        place = {"x": at[0] + moved, "y": at[1] + moved}
        touched.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [place]})
    loupe = page.locator("#phone-picture .loupe")
    loupe.wait_for(state="visible")
    touched.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    loupe.wait_for(state="hidden")
    off = np.subtract(position(marks.last), before) / scene.size[0] * box["width"]
    assert off == pytest.approx([40.0, 40.0], abs=1.0)  # the drag has moved the point instead of the page


def test_typed_values_stay_with_their_folder(served: Any, tab: Any, frame: Any) -> None:
    for name in ("first_beam", "second_beam"):
        (served.folder / name).mkdir()
        cv2.imwrite(str(served.folder / name / "a.png"), frame(1, 2.0))
    page = tab(f"{served.address}#phone")
    page.locator("#phone-folder option[value=first_beam]").wait_for(state="attached")
    page.locator("#phone-folder").select_option("first_beam")
    keys = ("a.png", "thread_mm", "length_mm", "density_kg_m3", "width_mm_sigma")
    fields = {key: page.locator(f'#phone-form [data-key="{key}"]') for key in keys}
    page.get_by_text("Click 1 of 4").wait_for()
    page.get_by_text("More", exact=True).click()
    before = {key: field.input_value() for key, field in fields.items()}
    for field in fields.values():
        field.fill("2.5")
    page.locator("#phone-folder").select_option("second_beam")
    page.get_by_text("Click 1 of 4").wait_for()
    assert {key: field.input_value() for key, field in fields.items()} == before


def position(mark: Any) -> list[float]:
    # Return x and y of a mark in px of the photograph.
    return [float(number) for number in re.findall(r"[-\d.]+", mark.get_attribute("transform"))]


def test_the_loupe_is_small_and_lies_beside_the_point(served: Any, phone: Phone, photographs: list[Path]) -> None:
    # The loupe is a magnified part of the picture.
    (served.folder / "loupe").mkdir(exist_ok=True)
    (served.folder / "loupe" / "IMG_0.jpg").write_bytes(photographs[0].read_bytes())
    page = phone.page
    page.reload()
    page.locator("#phone-folder option[value=loupe]").wait_for(state="attached")
    page.locator("#phone-folder").select_option("loupe")
    page.get_by_text("Click 1 of 4").wait_for()
    box = page.locator("#phone-picture svg").bounding_box()
    for share in (0.2, 0.8):
        x = box["x"] + share * box["width"]
        page.mouse.move(x, box["y"] + 0.5 * box["height"])
        loupe = page.locator("#phone-picture .loupe")
        loupe.wait_for(state="visible")
        covered = loupe.bounding_box()
        assert 150.0 < covered["width"] < 0.5 * box["width"]
        assert not covered["x"] <= x <= covered["x"] + covered["width"]
    page.mouse.move(box["x"] - 20.0, box["y"] + 0.5 * box["height"])
    page.locator("#phone-picture .loupe").wait_for(state="hidden")


@pytest.mark.parametrize(
    ("name", "body", "words"),
    [
        ("IMG_1.webp", b"RIFF\0\0\0\0WEBP", "IMG_1.webp: is not a picture that can be read"),
        ("IMG_1.HEIC", b"\0\0\0\x18ftypheic\0\0", "IMG_1.HEIC: is a HEIC picture"),
        ("IMG_1.jpg", b"\xff\xd8\xff\xe0 cut", "IMG_1.jpg: is truncated or damaged"),
        ("../IMG_1.jpg", b"", "should be a file name of at most"),
        (".IMG_1.jpg", b"", "should be a file name of at most"),
    ],
)
def test_a_file_that_is_not_a_photograph_is_refused_and_not_stored(
    served: Any, name: str, body: bytes, words: str
) -> None:
    before = sorted(served.folder.iterdir())
    with served.socket() as socket:
        state = json.loads(socket.recv())
        while state["control"] != "you":
            socket.send(json.dumps({"take": True}))
            state = json.loads(socket.recv())
        where = f"/api/phone/receive?folder=&name={name}"
        answer = served.ask(where, "POST", body, Origin=f"http://{served.host}", X_Tab=state["tab"])
    assert (answer.status, words in json.loads(answer.body)["error"]) == (400, True)
    assert sorted(served.folder.iterdir()) == before


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tip_px": [1200.0, 300.0]}, "mm from the clamp by the ruler, but length_mm = 40"),
        ({"ruler_px": [[100.0, 100.0], [110.0, 100.0]]}, "the two ticks of the ruler are 10 px apart"),
        ({"ruler_px": [[100.0, 100.0], [300.0, 300.0]]}, "neither horizontal nor vertical"),
        ({"clamp_px": [[-5.0, 300.0]]}, "should lie in the picture"),
        ({"clamp_px": [[600.0, 320.0]], "tip_px": [400.0, 300.0]}, "Click the clamp first and then the tip"),
        ({"leaves": "clamp"}, "click both ends of the clamp's edge"),
        ({"ruler_mm": "five"}, "ruler_mm = 'five' should be a number"),
        ({"ruler_mm": ""}, "ruler_mm is missing"),
    ],
)
def test_a_wrong_click_or_number_is_named(
    served: Any, photographs: list[Path], changes: dict[str, Any], words: str
) -> None:
    (served.folder / "wrong").mkdir(exist_ok=True)
    (served.folder / "wrong" / "IMG_0.jpg").write_bytes(photographs[0].read_bytes())
    clicked = {"clamp_px": [[400.0, 300.0]], "tip_px": [600.0, 320.0], "ruler_px": [[400.0, 200.0], [700.0, 203.0]]}
    sizes = {"length_mm": "40", "width_mm": "4", "depth_mm": "6", "density_kg_m3": "1070"}
    sigmas = {"length_mm_sigma": "0.3", "width_mm_sigma": "0.05", "depth_mm_sigma": "0.05"}
    request = {
        "folder": "wrong",
        "picture": "IMG_0.jpg",
        "clicks": {**clicked, "ruler_mm": "60", **changes},
        "beam": {**sizes, **sigmas},
    }
    answer = served.ask("/api/phone/edges", "POST", json.dumps(request).encode(), Origin=f"http://{served.host}")
    assert answer.status == 400
    assert words in json.loads(answer.body)["error"]


def test_a_picture_that_is_dropped_while_a_folder_is_opened_goes_into_this_folder(
    served: Any, tab: Any, frame: Any, tmp_path: Path
) -> None:
    chosen = served.folder / "zzz"
    chosen.mkdir()
    cv2.imwrite(str(chosen / "a.png"), frame(1, 2.0))
    cv2.imwrite(str(tmp_path / "dropped.png"), frame(2, 3.0))
    page = tab(f"{served.address}#phone")
    page.get_by_text("in control", exact=True).wait_for()
    page.get_by_text("Click 1 of 4").wait_for()
    held: list[Any] = []
    page.route(re.compile(r"/api/phone\?folder=zzz"), lambda route: held.append(route), times=2)
    page.locator("#phone-folder").select_option("zzz")
    page.locator("#phone-files").set_input_files(str(tmp_path / "dropped.png"))
    while len(held) < 2 and not list(served.folder.rglob("dropped.png")):
        page.wait_for_timeout(10)
    for route in held:
        route.continue_()
    page.get_by_text("1 picture is in the folder").wait_for()
    stored = list(served.folder.rglob("dropped.png"))
    shutil.rmtree(chosen)
    assert stored == [chosen / "dropped.png"]
