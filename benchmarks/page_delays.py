"""Measure two delays and the memory of the live page, which shows a running measurement in a browser.

    python -m benchmarks.page_delays [--stream 20]

The first delay is the time from the arrival of a frame until the browser reports that the frame is drawn. The second
delay is the time from the press of STOP until the emulated supply is switched off. All processor cores are busy. With
`--stream 20` the script prints the memory of every process each minute for 20 minutes. The script needs the extras
`page` and `test`, and Chromium.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.serve import DIALECTS, emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.supplies.kepco import READS_ZERO_WITHIN_A, KepcoBopSupply
from eimi_drivers.supplies.off import LEAST_OFF_A
from eimi_drivers.supplies.supply_names import supply_driver
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.specimen import load_specimen

SIZE_PX = (1280, 1024)
SUPPLIES = ("scpi", "korad")
PICTURES = 6
NOTE_ESCAPE = """addEventListener("keydown", (event) => {
  if (event.key === "Escape") window.escapeAt = performance.timeOrigin + event.timeStamp;
}, true)"""
"""A script for the page that notes the time (ms since 1970) which the browser gives to the key press."""

CALIBRATION = """
pixels_per_mm = 25.0
coil_constant_mT_per_A = 4.7
clamp_midpoint_px = [640.0, 80.0]
axis_angle_deg = 90.0
gravity_angle_deg = 90.0
field_angle_deg = 0.0
"""


class TimedSupply(CoilSupply):
    """An emulated supply and its coil, with the times at which the supply was switched off.

    Parameters
    ----------
    driver : str
        Name of the driver. A Kepco supply is switched off by a current of zero, every other supply by its output.

    Attributes
    ----------
    off_s : list of float
        Times of switching off, s on the monotonic clock.
    """

    def __init__(self, driver: str) -> None:
        super().__init__(WallClock())
        chosen = supply_driver(driver)
        self._output_stays_on = isinstance(chosen, type) and issubclass(chosen, KepcoBopSupply)
        self.off_s = list[float]()

    def is_off(self) -> bool:
        """Return whether the supply is switched off and the current in the coil has decayed."""
        if self._output_stays_on:
            return self.state.set_current_A == 0 and abs(self.coil_current_A()) <= READS_ZERO_WITHIN_A
        return not self.state.output and abs(self.coil_current_A()) <= LEAST_OFF_A

    def switch(self, on: bool) -> bool:
        """Switch the output, and record the time if the supply is now off; return whether the supply obeyed."""
        obeyed = super().switch(on)
        self._note(not on and not self._output_stays_on)
        return obeyed

    def set_current(self, current_A: float) -> bool:
        """Set the current (A), and record the time if the supply is now off; return whether the supply obeyed."""
        accepted = super().set_current(current_A)
        self._note(current_A == 0 and self._output_stays_on)
        return accepted

    def _note(self, off: bool) -> None:
        if off:
            self.off_s.append(time.monotonic())


def draw(number: int) -> np.ndarray:
    """Return a picture of a beam below a clamp; the bend grows with `number`."""
    rng = np.random.default_rng(number)
    wide, high = SIZE_PX
    y, x = np.mgrid[0:high, 0:wide].astype(np.float32)
    middle = 640 + number * 12 * ((y - 80) / 700) ** 2
    half = 0.5 * 25 * load_specimen("type1").specimen.width_mm
    dark = np.clip(half + 0.5 - np.abs(x - middle), 0, 1) * ((y > 80) & (y < 80 + 25 * 40))
    dark = np.maximum(dark, (y < 80) & (np.abs(x - 640) < 300))
    image = 210 - 180 * dark + rng.normal(0, 2, dark.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def write_bench(folder: Path, addresses: dict[str, str], states: int) -> None:
    """Write a specimen, a protocol of about `states` states, and a rig file for each emulated supply.

    `addresses` has the address of each supply by the name of the driver.
    """
    (folder / "shots").mkdir(exist_ok=True)
    for number in range(PICTURES):
        cv2.imwrite(str(folder / "shots" / f"f_{number}.png"), draw(number))
    (folder / "calibration.toml").write_text(CALIBRATION)
    for driver, address in addresses.items():
        (folder / f"{driver}.toml").write_text(f"""
name = "emulated"
calibration = "calibration.toml"
supply = {{ driver = "{driver}", address = "{address}", limits = {{ current_A = 2.0, voltage_V = 30.0 }} }}
[camera]
driver = "opencv"
source = "{folder / "shots"}"
playback = {{ picture_a_state = true, loop = true }}
""")
    text = load_protocol("dragon_skin_10").text
    before, _, after = text.partition("[current]")
    rest = after[after.index("\n[") :]
    currents = ", ".join(["0.0", *(["1.5", "1.4"] * (states // 2))])
    (folder / "protocol.toml").write_text(f"{before}[current]\nvalues_A = [{currents}]\n{rest}")
    (folder / "beam.toml").write_text(load_specimen("type1").text)


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep as many processor cores busy as `processes` says while the context lasts."""
    workers = [subprocess.Popen([sys.executable, "-S", "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for worker in workers:
            worker.kill()
            worker.wait()


@contextmanager
def opened(folder: Path) -> Iterator[tuple[Any, subprocess.Popen[str]]]:
    """Start the live page of a folder; yield the page in a browser and the process of the server."""
    from playwright.sync_api import sync_playwright

    command = [sys.executable, "-m", "eimi_lab", "dashboard", str(folder)]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert server.stdout is not None
    address = server.stdout.readline().strip()
    try:
        with sync_playwright() as driver:
            chromium = shutil.which("chromium") or shutil.which("chromium-browser")
            args = ["--no-sandbox"] if os.geteuid() == 0 else []
            page = driver.chromium.launch(executable_path=chromium, args=args).new_page()
            page.set_default_timeout(120_000)
            page.goto(address)
            yield page, server
    finally:
        server.terminate()
        server.wait(60)


def start(page: Any, dataset: str, driver: str) -> None:
    """Start a measurement on the page that writes the file `dataset`, and wait until the coil is on."""
    page.locator("#protocol option").first.wait_for(state="attached")
    page.locator("#rig").select_option(f"{driver}.toml")
    page.get_by_label("Dataset to write").fill(dataset)
    page.get_by_role("button", name="Start").click()
    page.get_by_text("COIL ON").wait_for()


def frame_to_screen_s(page: Any) -> list[float]:
    """Return the last delays (s) between the arrival of a frame and its display in the browser."""
    headers = {"X-Eimi-Token": page.evaluate("sessionStorage.getItem('token')")}
    return page.request.get(f"{page.url.partition('#')[0]}api/figures", headers=headers).json()["frame_to_screen_s"]


def stops(drivers: Sequence[str], runs: int) -> Iterator[tuple[str, list[float], list[float]]]:
    """Run and stop measurements on the page with each emulated supply, ``runs`` times each.

    Yields
    ------
    driver : str
        The driver of the supply.
    took : list of float
        Delays from the key press until the supply was off, s.
    ages : list of float
        Delays from the arrival of a frame until its display, s.
    """
    coils = {driver: TimedSupply(driver) for driver in drivers}
    with TemporaryDirectory() as name, ExitStack() as served:
        addresses = {driver: served.enter_context(_served(driver, coil)) for driver, coil in coils.items()}
        folder = Path(name)
        write_bench(folder, addresses, states=200)
        with opened(folder) as (page, _):
            page.evaluate(NOTE_ESCAPE)
            for driver, coil in coils.items():
                took, ages = [], []
                for run in range(runs):
                    start(page, f"{driver}_{run}.h5", driver)
                    before = frame_to_screen_s(page)
                    with busy(os.cpu_count() or 1):
                        page.wait_for_timeout(3000 + 790 * run)  # ms
                        took.append(_stopped(page, coil, driver))
                        ages += _new(before, frame_to_screen_s(page))
                    page.get_by_role("button", name="Start").wait_for()
                yield driver, took, ages


def _new(before: list[float], now: list[float]) -> list[float]:
    """Return the delays that were added to a list between two readings; old delays may have been removed."""
    return now[now.index(before[-1]) + 1 :] if before and before[-1] in now else now


def _served(driver: str, coil: TimedSupply) -> AbstractContextManager[str]:
    return (serve_pty if driver == "korad" else serve_tcp)(emulate(driver, coil))


# The delay begins at the time that the browser gives to the key event. The tool that presses the key needs two more
# processes, which also wait for a busy processor; the longer delay from the call of the tool is printed in brackets.
def _stopped(page: Any, coil: TimedSupply, driver: str) -> float:
    """Press STOP on the page, wait until the coil is confirmed off, and return the delay (s)."""
    load = Path("/proc/loadavg").read_text().split()[0] if Path("/proc/loadavg").exists() else "?"
    coil.off_s.clear()
    wall_s = time.time() - time.monotonic()
    asked_s = time.monotonic()
    page.keyboard.press("Escape")
    page.get_by_text("confirmed after").wait_for()
    assert coil.is_off()
    pressed_s = 1e-3 * page.evaluate("window.escapeAt") - wall_s
    print(
        f"{driver}: off after {coil.off_s[0] - pressed_s:.3f} s ({coil.off_s[0] - asked_s:.3f} s), load {load}",
        flush=True,
    )
    return coil.off_s[0] - pressed_s


def memory_MB(server: int) -> dict[str, float]:
    """Return the memory (MB) of the server with the process number `server` and of its processes, by name."""
    memory = {}
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            lines = dict(line.split(":", 1) for line in status.read_text().splitlines() if ":" in line)
            command = status.with_name("cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:  # the process has ended
            continue
        is_server = int(lines["Pid"]) == server
        if is_server or int(lines["PPid"]) == server:
            what = "server" if is_server else next((w for w in ("acquire", "eye", "spawn") if w in command), "other")
            memory[what] = int(lines.get("VmRSS", "0 kB").split()[0]) / 1e3
    return memory


def stream(minutes: float) -> None:
    """Run a measurement with live pictures for some minutes, and print the memory of all processes each minute."""
    coil = CoilSupply(WallClock())
    with TemporaryDirectory() as name, serve_tcp(emulate("scpi", coil)) as address:
        folder = Path(name)
        write_bench(folder, {"scpi": address}, states=900)
        with opened(folder) as (page, server):
            start(page, "run.h5", "scpi")
            until = time.monotonic() + 60 * minutes
            while True:
                ages = frame_to_screen_s(page)
                memory = ", ".join(f"{what} {size:.0f}" for what, size in sorted(memory_MB(server.pid).items()))
                remaining = (until - time.monotonic()) / 60
                print(
                    f"{minutes - remaining:5.1f} min: {memory} MB; {len(ages)} frames kept for the figures", flush=True
                )
                if remaining <= 0:
                    break
                page.wait_for_timeout(1000 * min(60, max(1, 60 * remaining)))
            page.keyboard.press("Escape")
            page.get_by_text("confirmed after").wait_for()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=6, help="number of runs for each supply")
    parser.add_argument(
        "--stream", type=float, default=0.0, help="minutes of live pictures, instead of measuring the delays"
    )
    parser.add_argument("--all", action="store_true", help="measure every family of supplies that can be emulated")
    parser.add_argument("--supply", action="append", choices=list(DIALECTS), help="measure this family; repeatable")
    options = parser.parse_args()
    if options.stream:
        stream(options.stream)
        return
    drivers = options.supply or list(DIALECTS if options.all else SUPPLIES)
    for driver, took, ages in stops(drivers, options.runs):
        print(
            f"{driver}: STOP to off, {len(took)} runs: median {statistics.median(took):.3f} s, most {max(took):.3f} s"
        )
        median, late = statistics.median(ages), float(np.quantile(ages, 0.95))
        print(f"{driver}: frame to screen, {len(ages)} frames: median {median:.3f} s, 95 % within {late:.3f} s")


if __name__ == "__main__":
    main()
