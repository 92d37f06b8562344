"""The dashboard is legible and usable: contrast, small windows, and a STOP button that is always visible."""

from __future__ import annotations

import re
from typing import Any

import pytest

from eimi_lab.page.server import STATIC

AA = 4.5  # WCAG 2.2, success criterion 1.4.3
PAIRS = [
    *((ink, ground) for ink in ("ink", "faint", "accent", "warn", "bad", "good") for ground in ("ground", "raised")),
    ("ground", "accent"),
    ("stop-ink", "stop"),
    ("on-ink", "on"),
]


def colours() -> dict[str, dict[str, str]]:
    # Return the colours of the style sheet, by colour scheme ("light", "dark") and name.
    sheet = (STATIC / "page.css").read_text()
    blocks = re.findall(r":root \{(.*?)\}", sheet, re.DOTALL)
    return {
        name: dict(re.findall(r"--([\w-]+): (#\w+);", block))
        for name, block in zip(("light", "dark"), blocks, strict=True)
    }


def luminance(colour: str) -> float:
    # Return the relative luminance of a colour as WCAG 2.2 defines it.
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    parts = [int(digits[at : at + 2], 16) / 255 for at in (0, 2, 4)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_has_enough_contrast_with_its_background(scheme: str) -> None:

    named = colours()[scheme]
    for ink, ground in PAIRS:
        lighter, darker = sorted((luminance(named[ink]), luminance(named[ground])), reverse=True)
        assert (lighter + 0.05) / (darker + 0.05) >= AA, (ink, ground)


@pytest.mark.parametrize(("wide", "high"), [(1280, 720), (768, 1024)])
def test_stop_is_visible_wherever_the_page_is_scrolled(served: Any, tab: Any, wide: int, high: int) -> None:
    page = tab(served.address)
    page.set_viewport_size({"width": wide, "height": high})
    for view in ("Bench", "Runs", "Pictures"):
        page.get_by_role("link", name=view).click()
        page.mouse.wheel(0, 5000)
        box = page.get_by_role("button", name="STOP").bounding_box()
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= high
        assert box["x"] + box["width"] <= wide
        assert min(box["width"], box["height"]) >= 44  # large enough for a finger
        assert page.locator("html").evaluate("root => root.scrollWidth") <= wide


@pytest.mark.parametrize(("wide", "high"), [(1280, 720), (1363, 800), (390, 844)])
def test_no_message_moves_stop_or_makes_the_page_wider(served: Any, tab: Any, wide: int, high: int) -> None:
    page = tab(served.address)
    page.set_viewport_size({"width": wide, "height": high})
    page.get_by_text("in control", exact=True).wait_for()
    stop = page.get_by_role("button", name="STOP")
    before = stop.bounding_box()
    for place, words in {
        "#told": "an error of three lines " * 20,
        "#coil-words": "COIL MAY STILL BE ON",
        "#where": "/a/long/path" + "/without_a_space" * 20,
        "#outcome-words": "/a/long/path" * 30,
    }.items():
        page.locator(place).evaluate("(element, words) => { element.textContent = words; }", words)
        assert stop.bounding_box() == before
    for view in ("Bench", "Runs"):
        page.get_by_role("link", name=view).click()
        assert page.locator("html").evaluate("root => root.scrollWidth") <= wide
        assert stop.bounding_box() == before


@pytest.mark.parametrize(
    "points",
    [
        [[1, 46.2]],
        [[0, 0.0031]],
        [[1, 46.231], [2, 46.2324]],
        [[1, 1234567.25], [2, 1234567.5]],
        [[k, -1e-5 * k] for k in range(1, 452)],
    ],
)
def test_the_texts_of_a_plot_do_not_overlap_and_states_are_counted_in_whole_numbers(
    served: Any, tab: Any, points: list[list[float]]
) -> None:
    page = tab(served.address)
    texts = page.evaluate(
        """async (points) => {
          const { plot } = await import("/static/plot.js");
          const figure = document.body.appendChild(document.createElement("figure"));
          plot(figure, points.map(([x, y]) => ({ x, y })), { x: "states", y: "modulus, kPa", high: 180, whole: true });
          return [...figure.querySelectorAll("text")].map((text) => {
            const { left, right, top, bottom } = text.getBoundingClientRect();
            return { words: text.textContent, anchor: text.getAttribute("text-anchor"), left, right, top, bottom };
          });
        }""",
        points,
    )
    counts = [text["words"] for text in texts if text["anchor"] == "middle"][:-2]
    assert counts
    assert all(words.lstrip("-").isdigit() for words in counts)
    for index, one in enumerate(texts):
        for other in texts[index + 1 :]:
            apart_x = one["right"] <= other["left"] or other["right"] <= one["left"]
            apart_y = one["bottom"] <= other["top"] + 3 or other["bottom"] <= one["top"] + 3  # a line has empty margins
            assert apart_x or apart_y, (one["words"], other["words"])
