"""Camera drivers pass the checks for every driver, with image files, a simulated device and emulated cameras."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from eimi_drivers.cameras import CAMERAS, CameraSettings, open_camera, opencv
from eimi_drivers.interfaces import Frame, Identity, InstrumentDisconnected, InstrumentError, SetPointNotTaken
from eimi_drivers.testing import CAMERA_CHECKS, camera_checks, check_camera


class Device:
    # A simulated device for OpenCV, which delivers a frame every millisecond until it is stopped or unplugged.

    frozen, unplugged = False, False

    def __init__(self, index: int) -> None:
        self._properties: dict[int, float] = {}
        self._count = 0
        type(self).frozen = type(self).unplugged = False

    def isOpened(self) -> bool:
        return True

    def getBackendName(self) -> str:
        return "V4L2"

    def get(self, prop: int) -> float:
        return 1000 * time.monotonic() if prop == cv2.CAP_PROP_POS_MSEC else self._properties.get(prop, 0.0)

    def set(self, prop: int, value: float) -> bool:
        self._properties[prop] = value
        return True

    def read(self) -> tuple[bool, np.ndarray | None]:
        time.sleep(0.001)
        while self.frozen and not self.unplugged:
            time.sleep(0.001)
        self._count += 1
        return (False, None) if self.unplugged else (True, np.full((24, 32), self._count % 256, np.uint8))

    def release(self) -> None:
        pass


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type[Device]:
    monkeypatch.setattr(opencv, "DEVICES", tmp_path)
    monkeypatch.setattr(opencv, "CLOSE_WITHIN_S", 0.1)  # the time limit for a device that hangs
    monkeypatch.setattr(cv2, "VideoCapture", Device)
    yield Device
    Device.unplugged = True


@pytest.mark.parametrize("check", CAMERA_CHECKS)
def test_a_device_of_opencv_conforms(device, check):
    check_camera(
        CAMERAS["opencv"],
        97,
        settings=CameraSettings(exposure_s=0.005, gain=12.0, region=(2, 3, 20, 10)),
        freeze=lambda: setattr(device, "frozen", True),
        unplug=lambda: setattr(device, "unplugged", True),
        checks=[check],
    )


@pytest.mark.parametrize("check", CAMERA_CHECKS)
def test_a_folder_of_images_conforms(tmp_path, check):
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((24, 32), number, np.uint8))
    region = CameraSettings(region=(3, 5, 10, 7))
    check_camera(CAMERAS["opencv"], str(tmp_path), settings=region, absent=str(tmp_path / "no"), checks=[check])


@pytest.mark.parametrize("check", CAMERA_CHECKS)
def test_a_basler_camera_conforms(monkeypatch, check):
    monkeypatch.setitem(os.environ, "PYLON_CAMEMU", "2")
    pytest.importorskip("pypylon.pylon", reason="needs pypylon: pip install 'eimi-lab[basler]'")
    settings = CameraSettings(exposure_s=0.002, region=(0, 0, 64, 48))
    check_camera(CAMERAS["basler"], 0, settings=settings, absent="12345", checks=[check])


class Sloppy:
    # A camera with one fault: it returns the same array for every frame.

    def __init__(self, source: str | int, settings: CameraSettings) -> None:
        if settings != CameraSettings():
            raise InstrumentError("nothing can be set")
        self.number, self.closed = 0, False
        self.image = np.zeros((4, 5), np.uint8)

    def identify(self) -> Identity:
        return Identity("sloppy", "a camera", "here")

    def flush(self) -> None:
        pass

    def grab(self, timeout_s: float) -> Frame:
        if self.closed:
            raise InstrumentDisconnected("here: closed")
        self.number += 1
        self.image[:] = self.number
        return Frame(self.image, self.number, float(self.number))

    def close(self) -> None:
        self.closed = True


class Restarting(Sloppy):
    # A camera whose frame numbers begin at 1 again after a flush.

    def flush(self) -> None:
        self.number = 0


class Unending(Sloppy):
    # A camera whose `grab` does not return after `close`.

    def grab(self, timeout_s: float) -> Frame:
        if self.closed:
            threading.Event().wait()
        return super().grab(timeout_s)


class Colourful(Sloppy):
    # A camera that returns colours as floating-point numbers.

    def grab(self, timeout_s: float) -> Frame:
        frame = super().grab(timeout_s)
        return Frame(np.zeros((4, 5, 3)), frame.number, frame.timestamp_s)


class Crashing(Sloppy):
    # A camera with a programming error in `identify`.

    def identify(self) -> Identity:
        return self.nothing


class Careless(Sloppy):
    # A camera that ignores the requested settings.

    def __init__(self, source: str | int, settings: CameraSettings) -> None:
        super().__init__(source, CameraSettings())


@pytest.mark.parametrize(
    ("driver", "expected"),
    [
        (Sloppy, "keeps_frames_apart: a frame changed when the next frame was grabbed; its image should be a copy"),
        (Restarting, "goes_on_after_a_flush: the frame after flush() should have a number above 1, but it is frame 1"),
        (Unending, r"is_closed_when_it_is_closed: grab(0.2) should end within 0.5 s, but did not"),
        (Colourful, "uint8 or uint16, not (4, 5, 3) of float64"),
        (Crashing, "says_who_it_is: AttributeError: 'Crashing' object has no attribute 'nothing'"),
        (lambda source, settings: Sloppy(source, settings), "the camera driver <lambda>: keeps_frames_apart: a frame"),
    ],
)
def test_each_fault_of_a_camera_is_reported_in_words(monkeypatch, driver, expected):
    monkeypatch.setattr(camera_checks, "ENDS_WITHIN_S", 0.5)
    with pytest.raises(AssertionError) as caught:
        check_camera(driver, 0)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_setting_that_a_camera_does_not_read_back_is_reported():
    with pytest.raises(AssertionError, match=r"gain was set to 3\.0 but reads back None"):
        check_camera(Careless, 0, settings=CameraSettings(gain=3.0))


def test_a_camera_that_ignores_the_disturbance_is_reported():
    for what, error in (("freeze", "InstrumentTimeout"), ("unplug", "InstrumentDisconnected")):
        with pytest.raises(AssertionError, match=rf"should raise {error}, but returned Frame"):
            check_camera(Sloppy, 0, **{what: lambda: None})
    with pytest.raises(AssertionError, match="opening 'nowhere' should raise InstrumentDisconnected"):
        check_camera(Sloppy, 0, absent="nowhere")


def test_a_camera_that_does_not_read_a_setting_back_is_refused_and_closed(monkeypatch):
    closed = []
    monkeypatch.setattr(Careless, "close", lambda self: closed.append(self))
    monkeypatch.setitem(CAMERAS, "careless", Careless)
    with pytest.raises(SetPointNotTaken, match=r"careless camera 0: gain was set to 3\.0 but reads back None"):
        open_camera("careless", 0, CameraSettings(gain=3.0))
    assert len(closed) == 1
