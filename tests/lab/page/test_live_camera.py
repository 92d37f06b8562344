"""The live camera of the page before a run, in a browser and with an emulated bench."""

from __future__ import annotations

import re
from typing import Any

from tests.lab.page.test_bench_view import frames_arrive


def test_the_camera_is_shown_before_a_run_without_a_message_to_the_supply(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    page = tab(dashboard(emulated_bench.folder)[1])
    page.get_by_text("live camera of rig.toml, without a run").wait_for()
    frames_arrive(page)
    page.locator("#live polyline").first.wait_for(state="attached")
    assert "blur" in page.locator("#values").inner_text()  # the focus
    page.locator("#light rect").first.wait_for(state="attached")  # the exposure
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
