"""A camera call that does not return in time raises an error, and the program can still end."""

from __future__ import annotations

import subprocess
import sys
import threading

import numpy as np
import pytest

from eimi_drivers.cameras import timed
from eimi_drivers.cameras.settings import NO_SETTINGS
from eimi_drivers.cameras.timed import TimedCamera, calls_under_way
from eimi_drivers.interfaces import Camera, Frame, Identity, InstrumentDisconnected, InstrumentError, InstrumentTimeout
from tests.patience import PATIENCE_S


class StubbornCamera:
    # A camera whose method `stuck` waits for the event `release`.

    settings = NO_SETTINGS

    def __init__(self, stuck: str = "") -> None:
        self.stuck = stuck
        self.release = threading.Event()
        self.calls: list[tuple[str, int]] = []

    def _called(self, what: str) -> None:
        self.calls.append((what, threading.get_ident()))
        if what == self.stuck:
            self.release.wait()

    def identify(self) -> Identity:
        self._called("identify")
        return Identity("stubborn", "a camera", "here")

    def flush(self) -> None:
        self._called("flush")

    def grab(self, timeout_s: float) -> Frame:
        self._called("grab")
        return Frame(np.zeros((2, 3), np.uint8), 7, 0.5)

    def close(self) -> None:
        self._called("close")


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    # A busy computer may delay the thread that calls the camera, so the time limits are long here. A test in which a
    # call never returns sets a short limit.
    monkeypatch.setattr(timed, "ANSWER_WITHIN_S", PATIENCE_S)
    monkeypatch.setattr(timed, "OPEN_WITHIN_S", PATIENCE_S)
    monkeypatch.setattr(timed, "_callers", [])


def test_all_calls_are_made_from_one_separate_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timed, "LOOK_EVERY_S", PATIENCE_S)
    inner = StubbornCamera()
    camera: Camera = TimedCamera("here", lambda: inner)
    camera.flush()
    assert camera.grab(PATIENCE_S).number == 7
    assert camera.identify().text == "a camera"
    camera.close()
    assert [what for what, _ in inner.calls] == ["flush", "grab", "identify", "close"]
    assert not calls_under_way()
    assert len({thread for _, thread in inner.calls}) == 1
    assert inner.calls[0][1] != threading.get_ident()


@pytest.mark.parametrize("call", ["flush", "grab", "identify", "close"])
def test_a_call_that_never_returns_raises_a_timeout(monkeypatch: pytest.MonkeyPatch, call: str) -> None:
    inner = StubbornCamera(call)
    camera = TimedCamera("cam 3", lambda: inner)
    monkeypatch.setattr(timed, "ANSWER_WITHIN_S", 0.3)
    monkeypatch.setattr(timed, "GRACE_S", 0.2)
    act = (lambda: camera.grab(0.1)) if call == "grab" else getattr(camera, call)
    with pytest.raises(InstrumentTimeout, match=f"cam 3: .*did not return from {call} within"):
        act()
    with pytest.raises(InstrumentTimeout, match=f"did not return from {call}"):
        camera.grab(1.0)
    camera.close()  # returns at once, because an earlier call has not returned
    assert calls_under_way()
    inner.release.set()


def test_a_camera_that_does_not_open_in_time_raises_a_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timed, "OPEN_WITHIN_S", 0.3)
    never = threading.Event()
    with pytest.raises(InstrumentTimeout, match="did not return from being opened"):
        TimedCamera("cam 3", lambda: never.wait())  # type: ignore[arg-type,return-value]
    never.set()


def test_errors_of_the_interface_pass_unchanged_through_a_timed_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timed, "LOOK_EVERY_S", PATIENCE_S)

    def missing() -> StubbornCamera:
        raise InstrumentDisconnected("cam 3: no such device")

    with pytest.raises(InstrumentDisconnected, match="no such device"):
        TimedCamera("cam 3", missing)
    assert not calls_under_way()


def test_an_error_of_the_cameras_library_is_one_line_that_names_the_camera() -> None:
    class Broken:
        def identify(self) -> Identity:
            return Identity("broken", "broken", "cam 3")

        def flush(self) -> None:
            raise RuntimeError("0xE1000014:\n  the stream was lost")

        def grab(self, timeout_s: float) -> Frame:
            raise ZeroDivisionError

        def close(self) -> None: ...

    camera = TimedCamera("cam 3", Broken)
    with pytest.raises(InstrumentError, match=r"^cam 3: its driver raised RuntimeError: 0xE1000014: the stream was"):
        camera.flush()
    with pytest.raises(InstrumentError, match="cam 3: its driver raised ZeroDivisionError"):
        camera.grab(PATIENCE_S)
    camera.close()


def test_the_caller_may_stop_waiting_for_a_camera_call() -> None:
    inner = StubbornCamera("grab")
    calls = []

    def leave() -> None:
        calls.extend([True] if inner.calls else [])  # the opening may take long too
        if len(calls) == 2:
            raise KeyboardInterrupt

    camera = TimedCamera("cam 3", lambda: inner, meanwhile=leave)
    with pytest.raises(KeyboardInterrupt):
        camera.grab(30.0)
    inner.release.set()
    camera.close()
    assert [what for what, _ in inner.calls] == ["grab", "close"]


def test_a_gap_that_the_caller_notices_is_reported_before_the_timeout_of_the_camera() -> None:
    # The computer sleeps while the run waits for a frame, so that the time limit of the camera's call has passed too.
    inner, now = StubbornCamera("grab"), [0.0]

    def is_waiting() -> bool:  # neither the opening nor the closing, which may take long too
        return bool(inner.calls) and not inner.release.is_set()

    def refuse() -> None:
        if is_waiting():
            raise InstrumentError("the run stood still for 60 s")

    def clock_after_a_sleep() -> float:
        now[0] += 60.0 if is_waiting() else 0.0
        return now[0]

    camera = TimedCamera("cam 3", lambda: inner, seconds=clock_after_a_sleep, meanwhile=refuse)
    with pytest.raises(InstrumentError, match="the run stood still for 60 s"):
        camera.grab(3.0)
    inner.release.set()
    camera.close()


def test_a_simulated_camera_is_timed_by_its_processor_time() -> None:
    inner = StubbornCamera("grab")
    waits: list[bool] = []

    def wait() -> None:
        waits.append(True)
        if len(waits) == 6:  # after 0.6 s of real time, which is longer than the time limit
            inner.release.set()

    camera = TimedCamera("virtual", lambda: inner, seconds=lambda: 0.0, meanwhile=wait)
    assert camera.grab(0.0).number == 7
    camera.close()


def test_a_simulated_camera_that_computes_too_long_raises_a_timeout() -> None:
    inner, now = StubbornCamera("grab"), iter(range(1000))
    # The time passes only after the camera has been opened, because this test is about the time of `grab`.
    camera = TimedCamera("virtual", lambda: inner, seconds=lambda: float(next(now)) if inner.calls else 0.0)
    with pytest.raises(InstrumentTimeout, match="did not return from grab"):
        camera.grab(3.0)
    inner.release.set()


def test_a_program_can_end_during_a_camera_call_that_never_returns() -> None:
    script = """
import threading
from eimi_drivers.cameras import timed
from eimi_drivers.interfaces import InstrumentTimeout
timed.OPEN_WITHIN_S = 0.2
try:
    timed.TimedCamera("cam", threading.Event().wait)
except InstrumentTimeout as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    assert "did not return" in done.stdout
