"""Fixtures: a browser, and the page (the dashboard) of a folder with a dataset."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any

import cv2
import pytest
import uvicorn
from websockets.sync.client import ClientConnection, connect

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.serve import emulate, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.importing import import_frames
from eimi_lab.page.server import Page, guarded
from tests.patience import PATIENCE_S
from tests.shared.processes import wait_until

TOKEN = "t" * 43


@dataclass
class Answer:
    status: int
    headers: dict[str, str]
    body: bytes


@dataclass
class Served:
    folder: Path
    port: int
    page: Page
    headers: dict[str, str] = field(default_factory=dict)

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.port}"

    @property
    def address(self) -> str:
        return f"http://{self.host}/#token={TOKEN}"

    @contextmanager
    def socket(self, introduced: bool = True) -> Iterator[ClientConnection]:
        # Open a WebSocket of the page; if `introduced`, its first message is the secret token of the page.
        origin = f"http://{self.host}"
        with connect(f"ws://{self.host}/live", origin=origin, proxy=None, open_timeout=PATIENCE_S) as connection:
            if introduced:
                connection.send(json.dumps({"token": TOKEN}))
            yield connection

    def ask(self, path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> Answer:
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        sent = {"Host": self.host, "X-Eimi-Token": TOKEN} | named
        connection = HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        try:
            connection.putrequest(method, path, skip_host=True)
            for name, value in sent.items():
                if value:
                    connection.putheader(name, value)
            if body is not None and "Content-Length" not in sent:
                connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body)
            response: HTTPResponse = connection.getresponse()
            return Answer(response.status, {k.lower(): v for k, v in response.getheaders()}, response.read())
        finally:
            connection.close()


@pytest.fixture(scope="session")
def data_folder(tmp_path_factory: pytest.TempPathFactory, texts: dict[str, str], frame: Callable[..., Any]) -> Path:
    # A folder with two images in `frames/`, `states.csv`, the TOML files, and the dataset `run.h5`.
    folder = tmp_path_factory.mktemp("data")
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text)
    (folder / "frames").mkdir()
    for index in (1, 2):
        cv2.imwrite(str(folder / "frames" / f"frame_{index}.png"), frame(index, 2.0 * index))
    (folder / "states.csv").write_text("frame,current_A\nframe_1.png,0\nframe_2.png,0.2\n")
    specimen, calibration = load_specimen(folder / "specimen.toml"), load_calibration(folder / "calibration.toml")
    import_frames(folder / "frames", folder / "states.csv", specimen, calibration, folder / "run.h5")
    return folder


@pytest.fixture(scope="session")
def served(data_folder: Path) -> Iterator[Served]:
    page = Page(data_folder)
    listening = socket.create_server(("127.0.0.1", 0))
    port = listening.getsockname()[1]
    app = guarded(page, frozenset({f"127.0.0.1:{port}", f"localhost:{port}"}), TOKEN)
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning", access_log=False))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    yield Served(data_folder, port, page)
    server.should_exit = True
    thread.join()
    page.worker.close()


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    # The Chromium browser of the system or of Playwright.
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install -e '.[test]'")
    with playwright.sync_playwright() as driver:
        installed = shutil.which("chromium") or shutil.which("chromium-browser")
        try:
            browser = driver.chromium.launch(
                executable_path=installed,
                args=["--no-sandbox"] if os.geteuid() == 0 else [],
                timeout=1000 * PATIENCE_S,
            )
        except playwright.TimeoutError:
            raise
        except playwright.Error as error:
            pytest.skip(f"needs a browser: install Debian's chromium ({str(error).splitlines()[0]})")
        yield browser
        browser.close()


@pytest.fixture
def tab(chromium: Any, request: pytest.FixtureRequest) -> Iterator[Callable[[str], Any]]:
    # Return a function that opens an address in a new tab; the test fails if a script of the page raises an error.
    context = chromium.new_context(viewport={"width": 1280, "height": 720})
    context.set_default_timeout(1000 * PATIENCE_S)
    faults: list[str] = []

    def open_tab(address: str) -> Any:
        page = context.new_page()
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on(
            "console",
            lambda message: faults.append(message.text) if "Content Security Policy" in message.text else None,
        )
        page.goto(address)
        return page

    yield open_tab
    context.close()
    if "served" in request.fixturenames:  # the next tab is in control only if the server has noticed the end of these
        tabs = request.getfixturevalue("served").page.tabs
        wait_until(lambda: not tabs.any_open(), "the server did not notice that the tabs were closed")
    assert faults == []


@dataclass
class EmulatedBench:
    folder: Path
    coil: CoilSupply

    def is_off(self) -> bool:
        return not self.coil.state.output and self.coil.state.set_current_A == 0.0


@pytest.fixture
def emulated_bench(files: Path, frame: Callable[..., Any]) -> Iterator[EmulatedBench]:
    # A served emulated bench whose protocol takes minutes, so that no run ends during a test.
    (files / "shots").mkdir()
    for number in range(4):
        cv2.imwrite(str(files / "shots" / f"f_{number}.png"), frame(number, 3.0 * number))
    protocol = (files / "protocol.toml").read_text().replace("drift_window_s = 0.02", "drift_window_s = 1.0")
    (files / "protocol.toml").write_text(protocol.replace("stop_A = 0.3\nstep_A = 0.1", "stop_A = 0.9\nstep_A = 0.002"))
    coil = CoilSupply(WallClock())
    with serve_tcp(emulate("scpi", coil)) as address:
        (files / "rig.toml").write_text(f"""
name = "desk"
calibration = "calibration.toml"
supply = {{ driver = "scpi", address = "{address}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
coil = {{ continuous_current_A = 1.0, thermal_time_constant_s = 60.0 }}

[camera]
driver = "opencv"
source = "{files / "shots"}"
playback = {{ picture_a_state = true, loop = true }}
""")
        yield EmulatedBench(files, coil)
    assert not coil.state.output


@pytest.fixture
def dashboard() -> Iterator[Callable[[Path], tuple[subprocess.Popen[str], str]]]:
    # Return a function that starts `eimi dashboard` on a folder; it returns the process and the printed address.
    begun: list[subprocess.Popen[str]] = []

    def begin(folder: Path) -> tuple[subprocess.Popen[str], str]:
        command = [sys.executable, "-m", "eimi_lab", "dashboard", str(folder)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        begun.append(process)
        assert process.stdout is not None
        return process, process.stdout.readline().strip()

    yield begin
    for process in begun:
        process.terminate()
        process.wait(PATIENCE_S)
        assert process.stdout is not None
        process.stdout.close()
