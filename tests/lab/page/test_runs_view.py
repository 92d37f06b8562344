"""Past runs in a browser."""

from __future__ import annotations

from typing import Any


def test_a_run_is_opened_and_gone_through_by_keyboard(served: Any, tab: Any) -> None:
    page = tab(served.address)
    assert "token" not in page.url
    page.get_by_role("link", name="Runs").press("Enter")
    page.get_by_role("button", name="run.h5").click()
    page.get_by_text("2 of 2").wait_for()
    page.locator(".plot circle.dot >> nth=1").wait_for()  # the tip angles of both states
    assert page.locator("#run-picture polyline").count() == 2
    page.get_by_role("slider").press("ArrowRight")
    page.get_by_text("1: 0.2 A, 0.94 mT").wait_for()
    page.locator('canvas[aria-label="state 1 at 0.94 mT"]').wait_for()
    assert page.get_by_role("button", name="next").is_disabled()
