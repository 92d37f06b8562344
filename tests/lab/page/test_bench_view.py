"""Runs on an emulated supply are started, watched, paused and stopped in a browser."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import time
from collections.abc import Callable
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest

from eimi_lab.dataset.reading import open_dataset
from tests.patience import PATIENCE_S


def wait_until(true: Callable[[], bool], seconds: float = PATIENCE_S) -> None:
    until = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < until
        time.sleep(0.02)


def start(page: Any) -> None:
    page.locator("#protocol option").first.wait_for(state="attached")
    page.get_by_role("button", name="Start").click()
    page.locator("#live[data-seen]").wait_for()


def frames_arrive(page: Any) -> None:
    live = page.locator("#live[data-seen]")
    live.wait_for()
    before = int(live.get_attribute("data-seen"))
    wait_until(lambda: int(live.get_attribute("data-seen")) > before + 3)


def test_a_run_is_started_watched_by_two_tabs_reloaded_and_stopped(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    text = (emulated_bench.folder / "protocol.toml").read_text()
    short = text.replace("stop_A = 0.9\nstep_A = 0.002", "stop_A = 0.3\nstep_A = 0.1")
    (emulated_bench.folder / "short.toml").write_text(short)  # the dry run of 451 states takes 9 s of processor time
    address = dashboard(emulated_bench.folder)[1]
    page = tab(address)
    page.locator("#protocol option").first.wait_for(state="attached")
    page.get_by_label("Protocol").select_option("short.toml")
    page.get_by_role("button", name="Dry run").click()
    page.get_by_text("duration:").first.wait_for()
    assert "4 states" in page.locator("#dry-lines").inner_text()
    page.get_by_label("Protocol").select_option("protocol.toml")
    start(page)
    frames_arrive(page)
    page.get_by_text("COIL ON").wait_for()
    page.locator("#live-plot circle.dot >> nth=1").wait_for()
    assert "no rating" not in page.locator("#bench").inner_text()  # of the heat of the coil
    page.reload()
    page.get_by_text("in control", exact=True).first.wait_for()
    frames_arrive(page)
    assert not emulated_bench.is_off()

    other = tab(address)
    other.get_by_text("watching").wait_for()
    frames_arrive(other)
    assert other.get_by_role("button", name="End").is_disabled()
    other.get_by_role("button", name="Take control").click()
    page.get_by_text("watching").wait_for()
    assert page.get_by_role("button", name="End").is_disabled()

    other.get_by_role("button", name="Pause").click()
    other.get_by_text("paused, coil off").wait_for()
    other.get_by_text("Resume continues the run, STOP ends it").wait_for()
    other.locator("#live polyline").first.wait_for(state="attached")  # the picture does not change during a pause
    assert emulated_bench.is_off()
    other.get_by_role("button", name="Resume").click()
    other.get_by_text("COIL ON").wait_for()
    other.close()
    frames_arrive(page)  # a tab that closes stops nothing
    page.keyboard.press("Escape")  # a tab that is not in control may stop the run
    page.get_by_text("the coil is off, confirmed after").wait_for()
    assert emulated_bench.is_off()
    page.get_by_role("button", name="Start").wait_for()
    page.locator("#values").get_by_text("0 Hz", exact=True).wait_for()  # the frame rate of an ended run
    stored = len(stored_currents(emulated_bench.folder / "run.h5"))
    assert 2 <= stored < 451
    page.reload()
    page.locator(
        f"#live-plot circle.dot >> nth={stored - 1}"
    ).wait_for()  # all states of the dataset, after a reload too
    assert page.locator("#live-plot circle.dot").count() == stored
    outcome = page.locator("#outcome").inner_text()
    assert outcome.count(f"{stored} of 451 states") == 1
    assert "The run was stopped" in outcome
    assert "tick “continue this dataset” and press Start" in outcome
    assert not re.search(r"SIG|--resume", outcome)  # words for a terminal
    page.get_by_text("the last state of run.h5").wait_for()
    page.locator("#live polyline >> nth=1").wait_for(state="attached")
    assert page.locator("#live canvas").get_attribute("aria-label") == f"state {stored - 1} of run.h5"
    assert page.locator("#live polyline").count() == 2
    page.get_by_role("button", name="Fit this").wait_for()


def test_a_run_that_fails_shows_its_reason_and_nothing_of_the_previous_run(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    page = tab(dashboard(emulated_bench.folder)[1])
    start(page)
    page.locator("#live-plot circle.dot >> nth=1").wait_for()
    page.locator("#coil.on").wait_for()
    on = page.locator("#lamp").bounding_box(), colour_of(page, "#coil")
    page.keyboard.press("Escape")
    page.locator("#coil.off").wait_for()
    off = page.locator("#lamp").bounding_box(), colour_of(page, "#coil")
    assert on[0]["width"] == off[0]["width"] == 48
    assert on[1] != off[1]
    assert "as measured" in page.locator("#coil").inner_text()
    page.get_by_role("button", name="Start").wait_for()
    page.locator("#values").get_by_text("0 mT").wait_for()

    rig = emulated_bench.folder / "rig.toml"
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))  # no other test on this computer can lock a supply with this address
        address = f'address = "TCPIP::127.0.0.1::{silent.getsockname()[1]}::SOCKET"'
        rig.write_text(re.sub(r'address = "[^"]*"', address, rig.read_text()))
        page.get_by_label("Dataset to write").fill("second.h5")
        page.get_by_role("button", name="Start").click()
        page.get_by_text("The run did not complete").wait_for()
    assert "Connection refused" in page.locator("#outcome-words").inner_text()
    reason = page.locator("#outcome-words").bounding_box()
    assert reason["x"] > 300  # beside the form, above the picture
    assert reason["y"] < 300
    outcome = page.locator("#outcome").inner_text()
    assert "No state was stored" in outcome
    assert "choose “virtual” under Rig" in outcome
    assert not re.search(r"--[a-z]", outcome)  # words for a terminal
    assert page.locator("#live-plot circle.dot").count() == 0
    assert page.locator("#values").inner_text() == ""
    assert not page.locator("#modulus").is_visible()
    assert not page.get_by_role("button", name="Fit this").is_visible()


def colour_of(page: Any, place: str) -> str:
    return str(page.locator(place).evaluate("element => getComputedStyle(element).backgroundColor"))


def test_a_killed_server_takes_the_coil_off_and_loses_no_state(emulated_bench: Any, dashboard: Any, tab: Any) -> None:
    server, address = dashboard(emulated_bench.folder)
    page = tab(address)
    start(page)
    page.locator("#live-plot circle.dot >> nth=1").wait_for()
    assert not emulated_bench.is_off()
    server.send_signal(signal.SIGKILL)
    wait_until(emulated_bench.is_off)
    page.get_by_text("not connected").wait_for()
    again = tab(dashboard(emulated_bench.folder)[1])
    again.locator("#coil.off").wait_for()
    again.get_by_label("continue this dataset").check()
    stored = len(stored_currents(emulated_bench.folder / "run.h5"))
    start(again)
    again.get_by_role("button", name="End with a ramp down").click()
    again.get_by_role("button", name="Start").wait_for()
    assert emulated_bench.is_off()
    assert len(stored_currents(emulated_bench.folder / "run.h5")) >= stored >= 2


def test_a_run_that_does_not_react_to_stop_is_killed_and_its_guardian_switches_the_coil_off(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    server, address = dashboard(emulated_bench.folder)
    page = tab(address)
    start(page)
    page.get_by_text("COIL ON").wait_for()
    children = Path(f"/proc/{server.pid}/task/{server.pid}/children").read_text().split()
    (run,) = [int(child) for child in children if b"acquire" in Path(f"/proc/{child}/cmdline").read_bytes()]
    os.kill(run, signal.SIGSTOP)  # the process reacts to no signal except SIGKILL
    page.keyboard.press("Escape")
    page.get_by_text("the coil is off, confirmed after").wait_for()
    assert emulated_bench.is_off()
    page.get_by_role("button", name="Start").wait_for()
    assert not Path(f"/proc/{run}").exists()


def test_a_coil_whose_current_still_flows_is_never_reported_as_off(
    emulated_bench: Any, dashboard: Any, tab: Any
) -> None:
    page = tab(dashboard(emulated_bench.folder)[1])
    start(page)
    page.get_by_text("COIL ON").wait_for()
    emulated_bench.coil.shorted_A = 0.8
    page.keyboard.press("Escape")
    page.get_by_text("stopping: switching the coil off").wait_for()
    page.get_by_text("THE COIL MAY STILL BE ON: 0.800 A measured").first.wait_for()
    page.get_by_text("COIL MAY BE ON").wait_for()
    page.locator("#values").get_by_text("0.8 A").wait_for()
    for words, whole in (("the coil is off", False), ("coil off", True)):
        assert page.get_by_text(words, exact=whole).all_inner_texts() == []
    emulated_bench.coil.shorted_A = 0.0  # the guardian of the run still tries to switch off
    page.locator("#coil.off").wait_for()
    assert emulated_bench.is_off()


def stored_currents(path: Any) -> list[float]:
    with open_dataset(path) as dataset:
        return [state.current_A for state in dataset.states]


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": ""}, 403),
        ({"Host": "evil.example"}, 403),
        ({}, 101),
    ],
)
def test_the_websocket_accepts_only_the_page(served: Any, headers: dict[str, str], status: int) -> None:
    sent = {
        "Host": served.host,
        "Origin": f"http://{served.host}",
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    }
    connection = HTTPConnection("127.0.0.1", served.port, timeout=PATIENCE_S)
    connection.putrequest("GET", "/live", skip_host=True)
    for name, value in (sent | headers).items():
        if value:
            connection.putheader(name, value)
    connection.endheaders()
    assert connection.getresponse().status == status
    connection.close()


@pytest.mark.parametrize("act", ["start", "pause", "go-on", "end", "dry"])
def test_only_the_tab_in_control_starts_pauses_and_ends_runs(served: Any, act: str) -> None:
    answer = served.ask(f"/api/run/{act}", "POST", b"{}", Origin=f"http://{served.host}", X_Tab="guess")
    assert answer.status == 400
    assert "take control first" in json.loads(answer.body)["error"]
