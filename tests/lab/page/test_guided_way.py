"""With the keyboard alone, a user gets from the live picture of the camera through a run to its fit."""

from __future__ import annotations

import re
from typing import Any

from tests.lab.page.test_bench_view import start

PHONE = {"width": 390, "height": 844}
MODULUS = {"modulus_kPa": 46.4, "interval_95_kPa": [46.1, 46.7], "used": 2, "limited_by": "width"}


def test_a_run_is_started_paused_stopped_and_fitted_with_the_keyboard_on_the_screen_of_a_phone(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    page = tab(dashboard(emulated_bench.folder)[1])
    page.set_viewport_size(PHONE)
    page.route("**/api/fit/start", lambda route: route.fulfill(json={}))
    page.get_by_text("live camera of rig.toml, without a run").wait_for()
    press(page, "Start")
    page.get_by_text("COIL ON").wait_for()
    page.locator("#live-plot circle.dot >> nth=1").wait_for()
    page.locator("#live-plot").scroll_into_view_if_needed()
    for place in ("#stop", "#lamp"):
        box = page.locator(place).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= PHONE["width"]
        assert 0 <= box["y"] <= PHONE["height"] - box["height"]
    assert page.locator("html").evaluate("root => root.scrollWidth") <= PHONE["width"]
    press(page, "Pause")
    page.get_by_text("paused, coil off").wait_for()
    assert emulated_bench.is_off()
    press(page, "Resume")
    page.get_by_text("COIL ON").wait_for()
    held: list[Any] = []
    page.route(re.compile(r"/api/fit\?"), lambda route: held.append(route))  # the question whether the run has a fit
    page.keyboard.press("Escape")
    page.get_by_text("the coil is off, confirmed after").wait_for()
    page.get_by_text("The run was stopped").wait_for()
    while not held:
        page.wait_for_timeout(20)
    assert not page.get_by_role("button", name="Fit this").is_visible()  # it would open the run without a fit
    page.unroute(re.compile(r"/api/fit\?"))
    for route in held:
        route.continue_()
    with page.expect_request("**/api/fit/start") as request:
        press(page, "Fit this")
    assert request.value.post_data_json["dataset"] == "run.h5"
    page.locator("#run-title").get_by_text("run.h5").wait_for()


def press(page: Any, name: str) -> None:
    # Move the focus to a button with the key Tab, and press Enter.
    page.get_by_role("button", name=name, exact=True).wait_for()
    page.locator("body").evaluate("() => document.activeElement.blur()")
    for _ in range(60):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.textContent.trim()") == name:
            page.keyboard.press("Enter")
            return
    raise AssertionError(f"the key Tab does not reach {name}")


def test_the_modulus_is_the_largest_text_and_does_not_wait_for_the_edges_of_all_states(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    # The edges of the third state take long.
    page = tab(dashboard(emulated_bench.folder)[1])
    page.route("**/api/dataset/modulus*", lambda route: route.fulfill(json=MODULUS | {"states": 2}))
    held: list[Any] = []
    page.route(re.compile(r"/api/dataset/edges\?.*state=2\b"), lambda route: held.append(route))
    start(page)
    number, interval = page.locator("#modulus-number"), page.locator("#modulus-interval")
    number.get_by_text("46.40 kPa").wait_for()
    page.locator("#progress-facts").get_by_text(re.compile("^([3-9]|\\d\\d+) of 451$")).wait_for()
    page.locator("#live-plot circle.dot >> nth=1").wait_for()
    assert page.locator("#live-plot circle.dot").count() == 2
    page.get_by_role("button", name="Pause").click()
    assert interval.inner_text() == "95 %: 46.10 to 46.70 kPa"
    assert "Largest source of its uncertainty: width" in page.locator("#modulus-words").inner_text()
    size = "element => parseFloat(getComputedStyle(element).fontSize)"
    others = page.locator("body *:visible:not(#modulus-number)").evaluate_all(
        f"elements => elements.filter((element) => element.textContent.trim()).map({size})"
    )
    assert number.evaluate(size) > 1.5 * max(others)
    beside, large = interval.bounding_box(), number.bounding_box()
    assert beside["x"] >= large["x"] + large["width"]
    assert large["y"] <= beside["y"] + beside["height"] / 2 <= large["y"] + large["height"]
    page.keyboard.press("Escape")
    page.get_by_text("the coil is off, confirmed after").wait_for()
    assert number.is_visible()  # the modulus of the stopped run stays until the next run
    for route in held:
        route.continue_()


def test_a_template_that_is_not_filled_in_is_not_chosen_in_advance(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    folder = emulated_bench.folder
    text = (folder / "specimen.toml").read_text()
    (folder / "a_template.toml").write_text("\n".join(line for line in text.splitlines() if "depth_mm" not in line))
    page = tab(dashboard(folder)[1])
    page.locator("#specimen option").first.wait_for(state="attached")
    assert "a_template.toml (not complete)" in page.locator("#specimen").inner_text()
    assert page.locator("#specimen").input_value() == "specimen.toml"
    choices = page.locator("#specimen option").evaluate_all("options => options.map((option) => option.value)")
    assert choices.index("a_template.toml") < choices.index("specimen.toml")
