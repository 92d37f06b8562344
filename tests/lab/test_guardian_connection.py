"""A run exchanges the right messages with its guardian, the process that switches the coil off."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import pytest

from eimi_drivers.interfaces import Identity, InstrumentError
from eimi_lab.acquisition import guardian as module
from eimi_lab.acquisition.guardian import Guardian, StoodStill, Ward, guarding
from tests.shared.changed_module import changed_module

WARD = Ward("korad", "COM3", 1.5, 12.0, off_below_A=0.03)


class Process:
    # A replacement for the guardian process; the test reads the messages of the run, and writes the answers.

    def __init__(self) -> None:
        heard, to = os.pipe()
        said, says = os.pipe()
        self.heard, self.says = os.fdopen(heard, "rb", buffering=0), os.fdopen(says, "wb", buffering=0)
        self.stdin, self.stdout = os.fdopen(to, "wb", buffering=0), os.fdopen(said, "rb", buffering=0)
        os.set_blocking(heard, False)
        self.returncode: int | None = None
        self.done: list[Any] = []
        self.command: list[str] = []
        self.options: dict[str, Any] = {}

    def __call__(self, command: list[str], **options: Any) -> Process:
        self.command, self.options = command, options
        return self

    def poll(self) -> int | None:
        return self.returncode

    def wait(self, timeout: float | None = None) -> None:
        self.done.append(("wait", timeout))
        if timeout is not None:
            raise subprocess.TimeoutExpired("guardian", timeout)

    def kill(self) -> None:
        self.done.append("kill")

    def told(self) -> bytes:
        return self.heard.read() or b""


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> Iterator[Process]:
    made = Process()
    monkeypatch.setattr(module.subprocess, "Popen", made)
    monkeypatch.setattr(module, "resume", lambda process: made.done.append("resume"))
    yield made
    for file in (made.heard, made.says, made.stdin, made.stdout):
        file.close()


@pytest.fixture
def armed(process: Process) -> Guardian:
    process.says.write(b"ready\n")
    connection = Guardian(WARD)
    connection.arm()
    assert process.told() == b"on\n"
    return connection


def test_the_process_is_started_with_its_supply_and_the_end_of_the_events(process: Process) -> None:
    Guardian(WARD)
    assert process.command == [
        *(sys.executable, "-P", "-m", "eimi_lab.acquisition.guardian_process"),
        json.dumps(asdict(WARD)),
    ]
    assert (process.options["stdin"], process.options["stdout"]) == (subprocess.PIPE, subprocess.PIPE)
    assert process.options["bufsize"] == 0
    assert not os.get_blocking(process.stdin.fileno())
    events, end = os.pipe()
    open_before = os.listdir("/proc/self/fd") if os.path.isdir("/proc/self/fd") else []
    Guardian(WARD, end)
    assert len(process.command) == 6
    if open_before:
        assert len(os.listdir("/proc/self/fd")) == len(open_before)  # the copy of the descriptor is closed
    os.close(end)
    assert os.read(events, 1) == b""
    os.close(events)


def test_each_message_has_its_words(armed: Guardian, process: Process) -> None:
    armed.expect(Identity("korad", "KORAD KA3005P", "COM3", "4711"))
    assert process.told() == b'supply ["KORAD KA3005P", "4711"]\n'
    armed.recognise()
    armed.allow(30.0)
    assert process.told() == b"recognised\nallow 30.0\n"
    armed.disarm()
    assert process.told() == b"off\n"
    armed.allow(30.0)
    armed.beat()
    assert process.told() == b""


def test_a_beat_is_sent_if_the_last_one_is_older_than_0_1_s(
    armed: Guardian, process: Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = armed._beaten_s
    for after_s, told in ((0.05, b""), (0.2, b".\n"), (0.25, b""), (0.4, b".\n")):
        monkeypatch.setattr(module, "awake_s", lambda after_s=after_s: now_s + after_s)
        armed.beat()
        assert process.told() == told


@pytest.mark.parametrize("why", ["ended", "never ready", "deaf"])
def test_nothing_is_switched_on_without_a_guardian(process: Process, monkeypatch: pytest.MonkeyPatch, why: str) -> None:
    if why == "ended":
        process.returncode = 1
    if why == "never ready":
        monkeypatch.setattr(module, "READY_WITHIN_S", 0.01)
    if why == "deaf":
        process.says.write(b"ready\n")
        process.heard.close()
    connection = Guardian(WARD)
    with pytest.raises(
        InstrumentError,
        match=r"^COM3: the guardian process, which switches the coil off if the run dies, did not start; nothing was",
    ):
        connection.arm()
    connection.check()  # a guardian that is not armed is not checked
    connection.dismiss()
    assert process.done == ["kill", ("wait", None)]


def test_a_guardian_that_reports_every_time_is_not_silent(
    armed: Guardian, process: Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = {"s": armed._heard_s + 1.4}
    monkeypatch.setattr(module, "time", changed_module(time, monotonic=lambda: clock["s"]))
    armed.check()
    clock["s"] += 0.2
    assert armed.silent_s() == pytest.approx(1.6)
    with pytest.raises(
        InstrumentError, match=r"^COM3: the guardian process, .* does not answer any more; the run ends"
    ):
        armed.check()
    process.says.write(b".\n")
    armed.check()
    assert armed.silent_s() < 1.0
    armed.disarm()
    armed._heard_s -= 60.0
    armed.check()


def test_an_ended_guardian_is_reported_with_its_status(armed: Guardian, process: Process) -> None:
    process.returncode = -9
    with pytest.raises(
        InstrumentError, match=r"^COM3: the guardian process, .*, ended \(status -9\); the run ends, because"
    ):
        armed.check()


def test_a_takeover_is_awaited_for_10_s_and_reported(armed: Guardian, process: Process) -> None:
    process.says.write(b".\ntaking over\n")
    with pytest.raises(
        InstrumentError,
        match=r"^COM3: the run stood still for more than 5 s; its guardian process took over and switches",
    ):
        armed.check()
    assert process.done == [("wait", 10.0)]


def test_an_armed_guardian_is_resumed_and_takes_over_at_the_end(process: Process) -> None:
    process.says.write(b"ready\n")

    def run() -> None:
        with guarding(WARD) as connection:
            connection.arm()
            raise RuntimeError("the run fails")

    with pytest.raises(RuntimeError, match="the run fails"):
        run()
    assert process.told() == b"on\ntake over\n"
    assert process.done == ["resume"]
    assert process.stdin.closed
    assert process.stdout.closed


def test_a_guardian_that_is_not_armed_is_ended_at_the_end(process: Process) -> None:
    process.says.write(b"ready\n")
    with guarding(WARD) as connection:
        connection.arm()
        connection.disarm()
    assert process.told() == b"on\noff\n"
    assert process.done == ["kill", ("wait", None)]
    assert process.stdin.closed


def test_the_limits_of_the_guardian_are_those_of_the_rig() -> None:
    assert (WARD.limits.current_A, WARD.limits.voltage_V, WARD.limits.off_below_A) == (1.5, 12.0, 0.03)


@pytest.mark.parametrize("message", ["beat", "allow", "nothing"])
def test_a_gap_before_a_message_is_not_forgotten_by_the_message(
    armed: Guardian, monkeypatch: pytest.MonkeyPatch, message: str
) -> None:
    now_s = armed._beaten_s
    for gap_s in (9.9, 30.0, 12.0):  # only the longest gap above 10 s is reported
        now_s += gap_s
        monkeypatch.setattr(module, "awake_s", lambda now_s=now_s: now_s)
        {"beat": armed.beat, "allow": lambda: armed.allow(0.0), "nothing": armed._note_the_gap}[message]()
        if gap_s < 10.0:
            armed.refuse_a_gap()
            armed.beat()
    longest_s = 42 if message == "nothing" else 30
    with pytest.raises(
        StoodStill, match=rf"^COM3: the run stood still for {longest_s} s with the coil on, because the"
    ):
        armed.refuse_a_gap()
    armed.disarm()
    armed.refuse_a_gap()
    armed.arm()  # a new beginning
    armed.refuse_a_gap()
