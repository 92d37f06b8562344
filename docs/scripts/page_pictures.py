"""Take the pictures of the live page for the documentation: ``python docs/scripts/page_pictures.py``.

The script controls a Chromium browser without a window. The rig is the virtual rig with smaller frames and an emulated
supply, so that no instrument is needed. Look at every picture before you commit it.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.coil_line import serve_coil
from eimi_drivers.emulators.serve import emulate, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.reading import open_dataset

FOLDER = Path(__file__).parents[1] / "page"
SIZE = {"width": 1280, "height": 720}
WITHOUT_FOLDER = """(body, place) => {
  const texts = document.createTreeWalker(body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const node = texts.currentNode;
    if (node.data.includes(place)) node.data = node.data.replace(/\\S*\\/(my_runs)/, "$1");
  }
}"""
SCALE = 2  # the frames have half the width and half the height of the frames of the virtual rig


def small_bench(folder: Path, supply: str, coil: str) -> None:
    """Write the files of a virtual rig with smaller frames and a coarse mesh, whose supply is emulated.

    Parameters
    ----------
    folder : Path
        The folder for the files.
    supply : str
        The address of the emulated supply, to which the program sends its commands.
    coil : str
        The address from which the virtual camera reads the current in the emulated coil of this supply.
    """
    rig = load_rig("virtual")
    assert rig.virtual is not None
    wide, high = (side // SCALE for side in rig.virtual.frame_size_px)
    text = re.sub(r"mesh = \[.*?\]", "mesh = [14, 1, 1]", rig.text).replace("[1280, 1024]", f"[{wide}, {high}]")
    clamp = [place / SCALE for place in rig.calibration.clamp_midpoint_px]
    calibration = rig.calibration.text.replace("pixels_per_mm = 25.0", f"pixels_per_mm = {25.0 / SCALE}")
    calibration = calibration.replace("clamp_midpoint_px = [640.0, 80.0]", f"clamp_midpoint_px = {clamp}")
    (folder / "virtual_calibration.toml").write_text(calibration)
    text = text.replace('driver = "virtual"\naddress = "virtual"', f'driver = "scpi"\naddress = "{supply}"')
    text = text.replace('source = "virtual"', f'source = "{coil}"')
    (folder / "emulated_rig.toml").write_text(
        text + "\n[coil]\ncontinuous_current_A = 2.0\nthermal_time_constant_s = 300.0\n"
    )
    (folder / "virtual_materials.toml").write_text(rig.virtual.materials.text)
    protocol = re.sub(r"drift_window_s = \S+", "drift_window_s = 2.5", load_protocol("dragon_skin_10_quick").text)
    (folder / "protocol.toml").write_text(protocol)
    (folder / "beam.toml").write_text(load_specimen("type1").text)


def keep(page: Any, name: str) -> None:
    """Save a picture of the page, in which the path of the temporary folder is removed from all texts."""
    page.locator("body").evaluate(WITHOUT_FOLDER, tempfile.gettempdir())
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    # A palette of fewer colours would be visible in the picture of the camera.
    picture.save(FOLDER / f"{name}.png", optimize=True)


def of_the_bench(browser: Browser, address: str) -> None:
    """Save pictures of the page that shows a run: before the run begins, during the run, and after it was stopped."""
    page = browser.new_page(viewport=SIZE)
    page.set_default_timeout(120_000)
    page.goto(address)
    page.locator("#protocol option").first.wait_for(state="attached")
    page.get_by_label("Note").fill("third casting, from the left")
    page.get_by_role("button", name="Dry run").click()
    page.get_by_text("duration:").first.wait_for()
    page.get_by_text("live camera of").wait_for()
    page.wait_for_timeout(1500)
    keep(page, "idle")
    page.get_by_role("button", name="Start").click()
    page.locator("#progress-facts").get_by_text("2 of 6").wait_for()
    page.get_by_role("button", name="Pause").click()  # the page computes the modulus while the run waits
    page.locator("#modulus-plot circle.dot").first.wait_for()
    page.get_by_text("paused, coil off").wait_for()
    page.get_by_role("button", name="Resume").click()
    page.get_by_text("COIL ON").wait_for()
    page.locator("#live polyline >> nth=1").wait_for(state="attached")
    keep(page, "running")
    page.keyboard.press("Escape")
    page.get_by_text("confirmed after").wait_for()
    page.get_by_role("button", name="Start").wait_for()
    stored = int(page.locator("#progress").get_attribute("value") or 0)
    page.locator(f"#live-plot circle.dot >> nth={stored - 1}").wait_for()  # the page has read all states
    page.wait_for_timeout(1500)
    keep(page, "stopped")
    page.get_by_label("continue this dataset").check()
    page.get_by_role("button", name="Start").click()
    page.get_by_text("6 of 6").wait_for()
    page.get_by_role("button", name="Start").wait_for()
    page.close()


def of_a_fit(browser: Browser, address: str) -> None:
    """Save a picture of the page that shows the result of a fit."""
    page = browser.new_page(viewport={**SIZE, "height": 1100})
    page.set_default_timeout(300_000)
    page.goto(f"{address}#runs")
    page.get_by_role("button", name="run.h5").click()
    page.locator("#run-plot circle.dot >> nth=5").wait_for()
    page.get_by_role("button", name="Fit", exact=True).click()
    page.get_by_role("link", name="Report", exact=True).wait_for()
    page.get_by_role("slider").press("End")
    page.wait_for_timeout(1500)
    keep(page, "fit")
    page.close()


def of_own_pictures(browser: Browser, address: str, folder: Path) -> None:
    """Save a picture, in dark colours, of the page on which a user calibrates pictures by hand.

    The frames of the run take the place of a user's pictures.
    """
    (folder / "my_pictures").mkdir()
    with open_dataset(folder / "run.h5") as dataset:
        for state in dataset.states:
            cv2.imwrite(str(folder / f"my_pictures/shot_{state.index}.png"), dataset.images(state.index)[0])
    page = browser.new_page(viewport=SIZE, color_scheme="dark")
    page.set_default_timeout(120_000)
    page.goto(f"{address}#pictures")
    page.get_by_role("button", name="shot_4.png").click()
    values = {"#scale": "12.5", "#clamp-x": "320", "#clamp-y": "40", "#coil-constant": "4.7"}
    for place, value in values.items():
        page.fill(place, value)
    for number in range(6):
        page.get_by_label(f"current of shot_{number}.png").fill(f"{0.3 * number:.1f}")
    page.get_by_role("button", name="middle of the clamp").focus()
    page.locator("#by-hand polyline.edge >> nth=1").wait_for(state="attached")
    page.wait_for_timeout(1500)
    keep(page, "calibrating_by_hand")
    page.close()


def main() -> None:
    """Save all pictures of the live page that the documentation shows."""
    FOLDER.mkdir(exist_ok=True)
    emulated = CoilSupply(WallClock())
    with (
        TemporaryDirectory() as name,
        serve_tcp(emulate("scpi", emulated)) as supply,
        serve_coil(emulated) as coil,
    ):
        folder = Path(name) / "my_runs"
        folder.mkdir()
        small_bench(folder, supply, coil)
        command = [sys.executable, "-m", "eimi_lab", "dashboard", str(folder)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server, sync_playwright() as driver:
            assert server.stdout is not None
            address = server.stdout.readline().strip()
            installed = shutil.which("chromium") or shutil.which("chromium-browser")
            args = ["--no-sandbox"] if os.geteuid() == 0 else []
            browser = driver.chromium.launch(executable_path=installed, args=args)
            try:
                of_the_bench(browser, address)
                of_a_fit(browser, address)
                of_own_pictures(browser, address, folder)
            finally:
                server.terminate()


if __name__ == "__main__":
    main()
