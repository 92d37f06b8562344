"""The camera driver `aravis` reports GigE cameras that lose packets, disappear, return or are replaced by another."""

from __future__ import annotations

import re
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_drivers.cameras import CAMERAS, CameraSettings, aravis
from eimi_drivers.cameras.aravis import AravisCamera
from eimi_drivers.cameras.aravis_library import BUFFER_STATUS, SUCCESS, load_aravis
from eimi_drivers.emulators.gige_camera import LOOPBACK
from eimi_drivers.emulators.gige_process import CameraProcess
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentTimeout,
    SetPointNotTaken,
)
from eimi_drivers.testing import CAMERA_CHECKS, camera_checks, check_camera
from tests.patience import PATIENCE_S
from tests.shared.emulated_gige import close_all, gige_camera, needs_aravis, numbered, only_gige_camera, opened

GRAB_S = 20.0


@pytest.fixture(scope="module")
def alone() -> Iterator[None]:
    # Lock the GigE camera until the end of this module.
    with only_gige_camera():
        yield


@pytest.fixture(autouse=True)
def closed_at_the_end() -> Iterator[None]:
    yield
    close_all()


@pytest.fixture(scope="module")
def kept(alone: None) -> Iterator[list[tuple[ExitStack, CameraProcess]]]:
    # A list with the emulated camera that several tests share; empty before the first start.
    holder: list[tuple[ExitStack, CameraProcess]] = []
    yield holder
    for stack, _ in holder:
        stack.close()


@pytest.fixture
def served(kept: list[tuple[ExitStack, CameraProcess]]) -> CameraProcess:
    # The shared emulated camera, whose pixels contain the exposure number; restarted if it has ended.
    if not kept or not kept[0][1].alive:
        end(kept)
        stack = ExitStack()
        kept.append((stack, stack.enter_context(gige_camera(serial_number="EIMI01"))))
    process = kept[0][1]
    process.lose_packets(0.0)
    return process


@pytest.fixture
def fresh(kept: list[tuple[ExitStack, CameraProcess]]) -> Iterator[CameraProcess]:
    # A new emulated camera, which has not exposed a frame yet.
    end(kept)
    with gige_camera(serial_number="EIMI01") as process:
        yield process


@pytest.fixture
def none_served(kept: list[tuple[ExitStack, CameraProcess]]) -> None:
    # End the shared emulated camera.
    end(kept)


def end(kept: list[tuple[ExitStack, CameraProcess]]) -> None:
    for stack, _ in kept:
        stack.close()
    kept.clear()


def answer_patiently(check, monkeypatch: pytest.MonkeyPatch) -> None:
    # On a busy computer, the emulated camera may answer late. The limit stays short in the check that unplugs the
    # camera.
    if check is camera_checks.gives_up_on_a_camera_that_hangs:
        monkeypatch.setattr(aravis, "ANSWER_WITHIN_S", PATIENCE_S)


@needs_aravis
@pytest.mark.parametrize("check", CAMERA_CHECKS)
def test_an_aravis_camera_conforms(served: CameraProcess, check, monkeypatch: pytest.MonkeyPatch) -> None:
    answer_patiently(check, monkeypatch)
    check_camera(
        CAMERAS["aravis"],
        LOOPBACK,
        settings=CameraSettings(exposure_s=0.005, gain=6.0, region=(16, 8, 100, 50), bit_depth=12),
        absent="EIMI99",
        freeze=lambda: served.lose_packets(1.0),
        unplug=served.kill,
        checks=[check],
    )


@needs_aravis
def test_a_region_that_the_camera_rounds_is_an_error(none_served: None) -> None:
    with (
        gige_camera(rows_step=16),
        pytest.raises(SetPointNotTaken, match=r"region was set to \(0, 0, 64, 50\) but reads"),
    ):
        opened(CameraSettings(region=(0, 0, 64, 50)))


@needs_aravis
def test_frame_numbers_keep_increasing_when_the_counter_of_the_camera_begins_again(fresh: CameraProcess) -> None:
    camera = opened(CameraSettings(region=(0, 0, 8, 8)))  # the counter of the emulated camera begins at 65400
    numbers = [camera.grab(GRAB_S).number for _ in range(150)]
    camera.close()
    assert numbers[0] < 65535 < numbers[-1]
    assert set(np.diff(numbers)) == {1}


@needs_aravis
@pytest.mark.parametrize(("share", "frames"), [(0.0, 40), (0.001, 40), (0.02, 20)])
def test_no_frame_with_lost_packets_is_returned_and_each_is_counted(
    fresh: CameraProcess, share: float, frames: int
) -> None:
    camera = opened()
    fresh.lose_packets(share)
    taken = [camera.grab(GRAB_S) for _ in range(frames)]
    camera.close()
    numbers = [frame.number for frame in taken]
    lost = camera.lost_frames
    assert sum(lost.values()) == numbers[-1] - numbers[0] + 1 - frames + (numbers[0] - 65401)
    assert (sum(lost.values()) > 0) == (share == 0.02) or share == 0.001
    for frame in taken:  # every pixel contains the number of the exposure
        assert np.unique(frame.image).tolist() == [(frame.number - 65401) % 250]
    assert lost.keys() <= {"timeout before all packets came", "missing packets", "no packet"}


@needs_aravis
def test_without_a_complete_frame_the_error_names_why_the_frames_were_incomplete(served: CameraProcess) -> None:
    camera = opened()
    served.lose_packets(0.5)
    with pytest.raises(
        InstrumentTimeout,
        match=r"no complete frame within 5 s; incomplete frames: .*\d+ with (timeout before all packets|missing)",
    ):
        camera.grab(5.0)
    camera.close()


@contextmanager
def packets_of_another_program(frame_number: int) -> Iterator[None]:
    # Send packets that look like parts of the frame `frame_number` to a port of this computer that Aravis does not use.
    ended = threading.Event()

    def send() -> None:
        with socket.socket(type=socket.SOCK_DGRAM) as other, socket.socket(type=socket.SOCK_DGRAM) as line:
            other.bind((LOOPBACK, 0))
            while not ended.wait(5e-4):
                line.sendto(struct.pack(">HHI", 0, frame_number, 0x01000000) + bytes(40), other.getsockname())

    sender = threading.Thread(target=send)
    sender.start()
    yield
    ended.set()
    sender.join()


@needs_aravis
def test_packets_of_another_program_are_no_frames_of_the_camera(none_served: None) -> None:
    # If the tests run as root, Aravis could receive every packet of the computer. The first frame of the emulated
    # camera has the number 65401, and Aravis discards frames whose numbers are slightly smaller than the last number.
    with gige_camera(serial_number="EIMI01"), packets_of_another_program(65450):
        for _ in range(6):
            camera = opened()
            camera.grab(GRAB_S)
            camera.close()


def large() -> Callable[[], NDArray[np.uint8]]:
    # Return a function that returns a picture whose packets need more memory than Linux gives to a socket by default.
    picture = np.arange(1280 * 1024, dtype=np.uint32).astype(np.uint8).reshape(1024, 1280)
    return lambda: picture


@needs_aravis
def test_large_frames_arrive_completely(none_served: None) -> None:
    with gige_camera(large, (1280, 1024)):
        camera = opened()
        numbers = [camera.grab(GRAB_S).number for _ in range(30)]
        assert np.array_equal(camera.grab(GRAB_S).image, large()())
        camera.close()
    # The camera waits at most 0.2 s for the driver. If a busy computer delays the driver longer, a frame is incomplete.
    assert numbers[-1] - numbers[0] <= 29 + 10, camera.lost_frames


@needs_aravis
@pytest.mark.parametrize("serial_number", ["EIMI01", "EIMI02"], ids=["same camera", "another camera"])
def test_a_camera_that_was_restarted_or_replaced_gives_no_frame(none_served: None, serial_number: str) -> None:
    with gige_camera(serial_number="EIMI01") as first:
        camera = opened()
        camera.grab(GRAB_S)
        first.kill()
    with gige_camera(serial_number=serial_number):
        for _ in range(3):
            with pytest.raises((InstrumentDisconnected, InstrumentTimeout), match=r"camera 127\.0\.0\.1: "):
                camera.grab(0.5)
        camera.close()
        again = opened()
        assert again.identify().serial_number == serial_number
        assert np.unique(again.grab(GRAB_S).image).size == 1
        again.close()
        if serial_number != "EIMI01":
            with pytest.raises(
                InstrumentDisconnected, match=r"no camera has this serial number; attached cameras: EIMI02"
            ):
                opened(source="EIMI01")


def error_after_a_frame(camera: AravisCamera, timeout_s: float) -> str:
    # Return the error of the first grab during which an incomplete frame comes: on a busy computer, none may come.
    until_s = time.monotonic() + PATIENCE_S
    while True:
        with pytest.raises(InstrumentTimeout) as caught:
            camera.grab(timeout_s)
        if "incomplete frames" in str(caught.value) or time.monotonic() > until_s:
            return str(caught.value)


@needs_aravis
@pytest.mark.parametrize("status", sorted(BUFFER_STATUS.keys() - {SUCCESS}))
def test_every_status_of_a_buffer_is_named_in_the_error(
    served: CameraProcess, monkeypatch: pytest.MonkeyPatch, status: int
) -> None:
    camera = opened()
    monkeypatch.setattr(load_aravis(), "buffer_get_status", lambda buffer: status, raising=False)
    assert re.search(rf"incomplete frames: \d+ with {BUFFER_STATUS[status]}", error_after_a_frame(camera, 1.0))
    monkeypatch.undo()
    assert np.unique(camera.grab(GRAB_S).image).size == 1
    camera.close()


@needs_aravis
@pytest.mark.parametrize(
    "check",
    [
        camera_checks.gives_frames_in_order,
        camera_checks.goes_on_after_a_flush,
        camera_checks.gives_up_on_a_camera_that_hangs,
        camera_checks.says_that_it_was_unplugged,
    ],
)
def test_an_aravis_camera_that_runs_freely_conforms(
    served: CameraProcess, check, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer_patiently(check, monkeypatch)
    check_camera(
        CAMERAS["aravis"],
        LOOPBACK,
        settings=CameraSettings(frame_rate_Hz=100.0),
        freeze=lambda: served.lose_packets(1.0),
        unplug=served.kill,
        checks=[check],
    )


def slow() -> Callable[[], np.ndarray]:
    # Return a function that needs half a second for a picture.
    picture = numbered()

    def slowly() -> np.ndarray:
        time.sleep(0.5)
        return picture()

    return slowly


@needs_aravis
def test_a_frame_that_comes_after_its_grab_is_not_returned_by_the_next_one(
    none_served: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(aravis, "ANSWER_WITHIN_S", PATIENCE_S)
    with gige_camera(slow):
        camera = opened()
        for expected in (1, 3):
            with pytest.raises(InstrumentTimeout):
                camera.grab(0.1)
            assert np.unique(camera.grab(GRAB_S).image).tolist() == [expected]
        camera.close()
