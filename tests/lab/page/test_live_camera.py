"""The dashboard shows the live picture of an emulated camera before a run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from tests.lab.page.test_bench_view import frames_arrive


def test_the_camera_is_shown_before_a_run_without_a_message_to_the_supply(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    page = tab(dashboard(emulated_bench.folder)[1])
    page.get_by_text("live camera of rig.toml, without a run").wait_for()
    frames_arrive(page)
    page.locator("#live polyline").first.wait_for(state="attached")
    assert "blur" in page.locator("#values").inner_text()  # the measure of the focus
    assert "no rating" not in page.locator("#values").inner_text()  # the rig file rates the coil
    page.locator("#light rect").first.wait_for(state="attached")  # the measure of the exposure
    assert emulated_bench.is_off()
    assert page.locator("#coil-how").inner_text() == "not measured"
    page.get_by_role("button", name="Start").click()  # the run opens the same camera
    page.get_by_text("COIL ON").wait_for()
    assert page.get_by_role("button", name="Live camera").is_hidden()
    page.keyboard.press("Escape")
    page.get_by_text("the coil is off, confirmed after").wait_for()
    page.get_by_role("button", name="Live camera").click()
    page.get_by_text("live camera of rig.toml, without a run").wait_for()
    frames_arrive(page)


def test_a_camera_that_cannot_be_opened_gives_its_reason_instead_of_a_picture(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    rig = emulated_bench.folder / "rig.toml"
    rig.write_text(re.sub(r'source = "[^"]*"', 'source = "missing.mp4"', rig.read_text()))
    page = tab(dashboard(emulated_bench.folder)[1])
    page.get_by_text("no live picture: ").wait_for()
    assert "missing.mp4" in page.locator("#camera-words").inner_text()
    assert page.get_by_role("button", name="Start").is_enabled()


def test_an_empty_folder_offers_the_virtual_rig_and_says_how_to_see_its_camera(
    dashboard: Any, tab: Any, tmp_path: Path
) -> None:
    page = tab(dashboard(tmp_path)[1])
    page.locator("#rig option").first.wait_for(state="attached")
    page.get_by_text("“Live camera” shows the picture of the chosen rig. “Start” begins a run.").wait_for()
    assert page.locator("#rig").input_value() == "virtual"


def test_edges_are_drawn_only_while_the_picture_resembles_the_picture_in_which_they_were_detected(
    served: Any, tab: Any
) -> None:
    page = tab(served.address)
    holds = page.evaluate(
        """async () => {
          const { Stillness } = await import("/static/stillness.js");
          const canvas = Object.assign(document.createElement("canvas"), { width: 960, height: 768 });
          const context = canvas.getContext("2d"), stillness = new Stillness();
          const draw = (number, tip_px) => {
            context.fillStyle = "rgb(210, 210, 210)";
            context.fillRect(0, 0, 960, 768);
            context.fillStyle = "rgb(30, 30, 30)";
            context.beginPath();
            context.moveTo(470, 60);
            context.quadraticCurveTo(470, 300, 470 + tip_px, 600);
            context.lineTo(510 + tip_px, 600);
            context.quadraticCurveTo(510, 300, 510, 60);
            context.fill();
            for (let k = 0; k < 3000; k++) { // the noise of the camera
              context.fillStyle = `rgba(0, 0, 0, ${0.03 * ((k * 7919) % 13) / 13})`;
              context.fillRect((k * 7907 + number * 31) % 960, (k * 104729 + number * 17) % 768, 2, 2);
            }
            stillness.see(canvas, number);
          };
          const none = stillness.holds(7);
          draw(5, 0);
          draw(9, 0); // still: edges of the frames from 5 on belong to this picture
          const still = [4, 5, 7, 9].map((number) => stillness.holds(number));
          draw(11, 6); // the tip moved by 6 of 960 pixels
          const moved = [5, 9, 11].map((number) => stillness.holds(number));
          stillness.forget();
          return { none, still, moved, forgotten: stillness.holds(11) };
        }"""
    )
    assert holds == {
        "none": False,
        "still": [False, True, True, True],
        "moved": [False, False, True],
        "forgotten": False,
    }


def test_a_value_is_shown_with_as_many_digits_as_its_uncertainty_allows(served: Any, tab: Any) -> None:
    page = tab(served.address)
    cases = [[0.00228, 0.0213], [-0.0004, 0.021], [43.7281, 0.0121], [43.7281, 2.6], [43.7281, None], [None, 0.1]]
    shown = page.evaluate(
        """async (cases) => {
          const { withSigma } = await import("/static/dom.js");
          return cases.map(([value, sigma]) => withSigma(value, sigma, "°"));
        }""",
        cases,
    )
    assert shown == ["0.00 ± 0.02°", "0.00 ± 0.02°", "43.728 ± 0.012°", "44 ± 3°", "43.7°", "—"]


def test_a_picture_that_is_decoded_late_neither_replaces_a_later_one_nor_appears_after_a_clear(
    served: Any, tab: Any
) -> None:
    page = tab(served.address)
    shown = page.evaluate(
        """async () => {
          const { Picture } = await import("/static/picture.js");
          const figure = document.createElement("figure"), picture = new Picture(figure), decoded = [];
          const decode = globalThis.createImageBitmap;
          const bitmap = (width) => decode(new ImageData(width, 3));
          globalThis.createImageBitmap = () => new Promise((resolve) => decoded.push(resolve));
          const early = picture.show(null, null, "early"), late = picture.show(null, null, "late");
          decoded[1](await bitmap(5));
          decoded[0](await bitmap(4));
          const answers = [await early, await late], { width } = picture.canvas;
          const words = picture.canvas.getAttribute("aria-label");
          const cleared = picture.show(null, null, "cleared");
          picture.clear();
          decoded[2](await bitmap(6));
          answers.push(await cleared);
          globalThis.createImageBitmap = decode;
          return { answers, width, words, hidden: figure.hidden };
        }"""
    )
    assert shown == {"answers": [False, True, False], "width": 5, "words": "late", "hidden": True}
