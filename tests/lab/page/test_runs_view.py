"""The view of stored runs in a browser shows a run and its fits, and starts new fits."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROD = """
[specimen]
name = "rod"
material = "silicone"
length_mm = 60.0
width_mm = 5.0
depth_mm = 5.0
density_kg_m3 = 1070.0
section = "plane-stress"
"""
YOUNG_PA, FORCES_N = 150e3, (1e-4, 2e-4, 3e-4)


@pytest.fixture
def rod(served: Any, run: Callable[..., tuple[int, str]]) -> Path:
    # The dataset rods/rod.h5: the tip of a cantilever under three forces, by slender-beam theory.
    folder: Path = served.folder / "rods"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    sag_mm = [force * 60.0**3 / (3 * 1e-6 * YOUNG_PA * 5.0**4 / 12) for force in FORCES_N]
    rows = [f"{k},tip,60,0,60,{sag:.5f},0.005" for k, sag in enumerate(sag_mm)]
    (folder / "points.csv").write_text("\n".join(["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm", *rows]) + "\n")
    states = [f"{k},0,{force},90" for k, force in enumerate(FORCES_N)]
    (folder / "states.csv").write_text("\n".join(["state,field_mT,tip_force_N,tip_force_angle_deg", *states]) + "\n")
    (folder / "rod.toml").write_text(ROD)
    tables = ("--states", folder / "states.csv", "--specimen", folder / "rod.toml", "--no-gravity")
    status, message = run("import", folder / "points.csv", *tables, "-o", folder / "rod.h5")
    assert status == 0, message
    return folder / "rod.h5"


def test_a_run_is_opened_and_browsed_with_the_keyboard(served: Any, tab: Any) -> None:
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


def open_rod(page: Any) -> None:
    page.get_by_role("button", name="rods/").click()
    page.get_by_role("button", name="rod.h5").click()


def test_a_late_list_of_a_folder_does_not_replace_the_list_of_the_next_folder(served: Any, tab: Any, rod: Path) -> None:
    page = tab(f"{served.address}#runs")
    page.get_by_role("button", name="run.h5").wait_for()
    late: list[Any] = []
    page.route(re.compile(r"/api/folder\?in=$"), lambda route: late.append(route))
    page.get_by_role("button", name="run.h5").click()
    page.get_by_text("2 of 2").wait_for()
    page.get_by_role("button", name="rods/").click()
    page.get_by_role("button", name="rod.h5").wait_for()
    (route,) = late
    with page.expect_response(route.request.url):
        route.continue_()
    page.wait_for_timeout(200)  # a script of the page reads the answer
    assert page.get_by_role("button", name="rod.h5").is_visible()


def test_the_fit_button_fits_the_dataset_on_the_screen_while_it_still_loads(served: Any, tab: Any, rod: Path) -> None:
    page = tab(f"{served.address}#runs")
    page.get_by_text("in control", exact=True).first.wait_for()
    page.get_by_role("button", name="run.h5").click()
    page.get_by_text("2 of 2").wait_for()
    page.locator("#files button[aria-current]").wait_for()  # the list is written again after a dataset was opened
    page.get_by_role("button", name="rods/").click()
    page.get_by_role("button", name="rod.h5").wait_for()
    held: list[Any] = []
    page.route("**/api/folder*", lambda route: held.append(route))
    page.route("**/api/fit/start", lambda route: route.fulfill(json={}))
    page.get_by_role("button", name="rod.h5").click()
    page.get_by_text("rods/rod.h5: rod").wait_for()
    with page.expect_request("**/api/fit/start") as request:
        page.get_by_role("button", name="Fit", exact=True).click()
    assert held, "the list of files was not held back"
    assert request.value.post_data_json["dataset"] == "rods/rod.h5"
    for route in held:
        route.continue_()


def test_a_run_is_fitted_and_its_report_opened(served: Any, tab: Any, rod: Path) -> None:
    page = tab(f"{served.address}#runs")
    page.get_by_text("in control", exact=True).first.wait_for()
    open_rod(page)
    page.locator("#law").select_option("neo-hookean")
    page.get_by_role("button", name="Fit", exact=True).click()
    page.get_by_text("neo-hookean: done").wait_for()
    page.get_by_text("Fit again and replace this fit").wait_for()
    result = page.locator("#fit-result").inner_text()
    assert "only noise" in result
    assert page.locator("#fit-plot circle.dot").count() > 3  # the plot of the convergence
    assert "so that the error of the result is usually smaller" in page.locator("#fit-plot-words").inner_text()
    (fit,) = json.loads(rod.with_suffix(".fits.json").read_text())["fits"]
    assert fit["initial_shear_modulus"]["value"] == pytest.approx(YOUNG_PA / 3, rel=0.02)
    shown = re.search(r"initial shear modulus ([\d.]+)\skPa \(95 % interval: ([\d.]+) to ([\d.]+)\skPa", result)
    numbers = [fit["initial_shear_modulus"]["value"], *fit["initial_shear_modulus"]["interval_95"]]
    assert [float(text) for text in shown.groups()] == pytest.approx([1e-3 * number for number in numbers], abs=0.006)
    # The page requests the address of the report only after the fit has ended.
    page.get_by_role("link", name="Report", exact=True).wait_for()
    report = served.ask(page.locator("#fit-report").get_attribute("href"))
    assert report.status == 200
    assert b"rod" in report.body
    late = tab(f"{served.address}#runs")  # the tab receives the state of the fit before it shows a dataset
    late.get_by_text("watching").first.wait_for()
    open_rod(late)
    late.get_by_text("neo-hookean: done").wait_for()
