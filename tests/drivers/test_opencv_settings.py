"""The driver `opencv` writes settings and reads frames, with a replacement for OpenCV's capture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_drivers.cameras import opencv
from eimi_drivers.cameras.opencv import OpenCVCamera
from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.interfaces import (
    EndOfPlayback,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    SetPointRefused,
)
from tests.patience import PATIENCE_S

IMAGE = np.arange(48, dtype=np.uint8).reshape(6, 8)


class Capture:
    # A replacement for `cv2.VideoCapture` with `frames` frames, which records written properties.

    backend = "V4L2"
    is_open = True
    frames = 3
    error: cv2.error | None = None

    def __init__(self, source: str | int) -> None:
        self.source = source
        self.written: list[tuple[int, float]] = []
        self.properties: dict[int, float] = {}
        self.was_released = False

    def isOpened(self) -> bool:
        return self.is_open

    def getBackendName(self) -> str:
        return self.backend

    def get(self, prop: int) -> float:
        return self.properties.get(prop, 0.0)

    def set(self, prop: int, value: float) -> bool:
        self.written.append((prop, value))
        self.properties[prop] = value
        return True

    def read(self) -> tuple[bool, np.ndarray | None]:
        if self.error is not None:
            raise self.error
        self.frames -= 1
        return (True, IMAGE) if self.frames >= 0 else (False, None)

    def release(self) -> None:
        self.was_released = True


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Any]:
    # Return a function that opens a camera or a video file without a thread.
    monkeypatch.setattr(opencv, "DEVICES", tmp_path)
    monkeypatch.setattr(cv2, "VideoCapture", Capture)

    def make(source: str | int = 3, backend: str = "V4L2") -> Any:
        monkeypatch.setattr(Capture, "backend", backend)
        return opencv._Capture(source)

    return make


def test_the_settings_of_a_linux_device_are_written_after_the_bit_depth(opened: Callable[..., Any]) -> None:
    device = opened()
    wanted = CameraSettings(exposure_s=0.005, gain=12.0, gamma=100.0, bit_depth=16, frame_rate_Hz=60.0)
    assert device.set_up(wanted) == wanted
    assert device._capture.source == 3
    assert device._capture.written == [
        (cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc("Y", "1", "6", " ")),
        (cv2.CAP_PROP_CONVERT_RGB, 0),
        (cv2.CAP_PROP_AUTO_EXPOSURE, 1),  # V4L2_EXPOSURE_MANUAL
        (cv2.CAP_PROP_EXPOSURE, 50),  # units of 100 us
        (cv2.CAP_PROP_FPS, 60.0),
        (cv2.CAP_PROP_GAIN, 12.0),
        (cv2.CAP_PROP_GAMMA, 100.0),
    ]


@pytest.mark.parametrize("backend", ["DSHOW", "MSMF"])
@pytest.mark.parametrize(("exposure_s", "exponent"), [(1.0, 0), (0.01, -7), (1 / 64, -6), (4.0, 2)])
def test_an_exposure_on_windows_is_a_power_of_two(
    opened: Callable[..., Any], backend: str, exposure_s: float, exponent: int
) -> None:
    device = opened(3, backend)
    assert device.set_up(CameraSettings(exposure_s=exposure_s)) == CameraSettings(exposure_s=2.0**exponent)
    assert device._capture.written == [
        (cv2.CAP_PROP_AUTO_EXPOSURE, 0.25),  # manual exposure of OpenCV's backends for Windows
        (cv2.CAP_PROP_EXPOSURE, exponent),
    ]


def test_a_depth_of_8_bits_and_no_settings_leave_the_device_as_it_is(opened: Callable[..., Any]) -> None:
    device = opened()
    assert device.set_up(CameraSettings()) == CameraSettings()
    assert device.set_up(CameraSettings(bit_depth=8)) == CameraSettings(bit_depth=8)
    assert device._capture.written == []


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"bit_depth": 12}, "bit_depth = 12 must be 8 or 16"),
        ({"exposure_s": 0.0}, r"exposure_s = 0\.0 must be greater than 0"),
        ({"exposure_s": float("nan")}, "exposure_s = nan must be greater than 0"),
        ({"frame_rate_Hz": 0.0}, r"frame_rate_Hz = 0\.0 must be greater than 0"),
    ],
)
def test_an_impossible_setting_is_refused_before_anything_is_written(
    opened: Callable[..., Any], settings: dict[str, Any], message: str
) -> None:
    device = opened()
    with pytest.raises(SetPointRefused, match=f"^camera 3: {message}$"):
        device.set_up(CameraSettings(**settings))
    assert device._capture.written == []


@pytest.mark.parametrize("settings", [{"exposure_s": 0.01}, {"gain": 2.0, "bit_depth": 8}, {"frame_rate_Hz": 30.0}])
def test_a_film_has_no_settings(opened: Callable[..., Any], settings: dict[str, Any]) -> None:
    film = opened("film.avi")
    with pytest.raises(InstrumentError, match=rf"film\.avi.* has no {', '.join(settings)}"):
        film.set_up(CameraSettings(**settings))
    assert film.set_up(CameraSettings()) == CameraSettings()
    assert film._capture.written == []


def test_a_source_that_opencv_cannot_open_is_named(opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Capture, "is_open", False)
    with pytest.raises(InstrumentDisconnected, match=r"^camera 3: cannot be opened$"):
        opened()
    with pytest.raises(InstrumentDisconnected, match=r"^film\.avi: cannot be opened$"):
        opened("film.avi")


def test_a_frame_of_a_device_has_the_time_of_the_kernel_or_of_the_computer(
    opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opencv, "time", SimpleNamespace(monotonic=lambda: 77.0))
    for backend, stamp_ms, time_s in (
        ("V4L2", 1500.0, 1.5),
        ("V4L2", 0.0, 77.0),
        ("V4L2", -1.0, 77.0),
        ("DSHOW", 1500.0, 77.0),
    ):
        device = opened(3, backend)
        device._capture.properties[cv2.CAP_PROP_POS_MSEC] = stamp_ms
        image, at_s = device.read()
        assert image is IMAGE
        assert at_s == time_s
    film = opened("film.avi")
    film._capture.properties[cv2.CAP_PROP_POS_MSEC] = 1500.0
    assert film.read()[1] == 1.5


def test_the_end_of_a_film_names_the_number_of_its_frames_and_a_device_is_unplugged(
    opened: Callable[..., Any], tmp_path: Path
) -> None:
    film, device = opened("film.avi"), opened()
    for source in (film, device):
        for _ in range(3):
            source.read()
    with pytest.raises(EndOfPlayback, match=r"^film\.avi: end of playback after 3 frames$"):
        film.read()
    with pytest.raises(InstrumentDisconnected, match=r"^camera 3: the camera sends no more frames; is it unplugged\?$"):
        device.read()
    (tmp_path / "video3").touch()
    device = opened()
    device.read()
    (tmp_path / "video3").unlink()
    with pytest.raises(InstrumentDisconnected, match="is it unplugged"):
        device.read()


@pytest.mark.parametrize(
    ("region", "is_possible"),
    [
        ((0, 0, 1, 1), True),
        ((7, 5, 1, 1), True),
        ((-1, 0, 2, 2), False),
        ((0, -1, 2, 2), False),
        ((0, 0, 0, 2), False),
        ((0, 0, 2, 0), False),
    ],
)
def test_a_region_is_at_least_a_pixel_within_the_image(
    opened: Callable[..., Any], region: tuple[int, int, int, int], is_possible: bool
) -> None:
    if not is_possible:
        with pytest.raises(SetPointRefused, match=r"^3: region = .* must be left, top, width, height in pixels$"):
            OpenCVCamera(3, CameraSettings(region=region))
        return
    camera = OpenCVCamera(3, CameraSettings(region=region))
    left, top, width, height = region
    np.testing.assert_array_equal(camera.grab(PATIENCE_S).image, IMAGE[top : top + height, left : left + width])
    camera.close()


@pytest.mark.parametrize(
    ("source", "kind"), [("5", "Capture"), (5, "Capture"), ("film", "Capture"), ("images", "ImageSeries")]
)
def test_the_identity_names_the_kind_of_source(
    opened: Callable[..., Any], tmp_path: Path, source: str | int, kind: str
) -> None:
    (tmp_path / "film").touch()
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "a.png"), IMAGE)
    path = str(source) if str(source) == "5" else str(tmp_path / str(source))
    camera = OpenCVCamera(path)
    identity = camera.identify()
    assert (identity.driver, identity.text, identity.address) == ("opencv", f"{kind} of OpenCV {cv2.__version__}", path)
    camera.close()


def test_an_error_of_opencv_ends_the_frames_and_releases_the_device(
    opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Capture, "error", cv2.error("broken"))
    camera = OpenCVCamera(3)
    for _ in range(2):  # the same error at every further call
        with pytest.raises(InstrumentDisconnected, match=r"^3: .*broken"):
            camera.grab(PATIENCE_S)
    camera._reader.join(PATIENCE_S)
    assert camera._input._capture.was_released  # type: ignore[attr-defined]
    with pytest.raises(InstrumentError):
        OpenCVCamera(3, CameraSettings(region=(0, 0, 0, 1)))


class Slow:
    # A camera device whose frames the test delivers one by one, without a thread.

    def __init__(self) -> None:
        self.time_s = 0.0
        self.during: Callable[[], None] = lambda: None
        self.left = 1

    def read(self) -> tuple[np.ndarray, float]:
        if not self.left:
            raise InstrumentDisconnected("no more")
        self.left -= 1
        self.during()
        return IMAGE, self.time_s

    def release(self) -> None:
        pass


@pytest.mark.parametrize(
    ("time_s", "is_live", "flushed_meanwhile", "is_kept"),
    [
        (10.0, True, False, True),
        (9.9, True, False, False),
        (9.9, False, False, True),
        (10.1, True, True, False),
        (10.1, True, False, True),
    ],
)
def test_a_frame_is_kept_unless_its_exposure_may_have_begun_before_the_flush(
    opened: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
    time_s: float,
    is_live: bool,
    flushed_meanwhile: bool,
    is_kept: bool,
) -> None:
    camera = OpenCVCamera(3)
    camera._reader.join(PATIENCE_S)
    monkeypatch.setattr(opencv, "time", SimpleNamespace(monotonic=lambda: 10.0))
    camera.flush()
    source = Slow()
    source.time_s = time_s
    if flushed_meanwhile:
        source.during = camera.flush
    camera._input, camera._live, camera._failure = source, is_live, None  # type: ignore[assignment]
    monkeypatch.setattr(camera, "_wait_for_room", lambda: True)
    camera._read_frames()
    if is_kept:
        frame = camera.grab(0.0)
        assert (frame.number, frame.timestamp_s) == (0, time_s)
    with pytest.raises(InstrumentDisconnected, match=r"^no more$"):
        camera.grab(0.0)
    camera._failure = None
    with pytest.raises(InstrumentTimeout, match=r"^3: no frame within 0 s; check the cable of the camera$"):
        camera.grab(0.0)
    camera.close()
    with pytest.raises(InstrumentDisconnected, match=r"^3: the camera was closed; open the camera again$"):
        camera.grab(0.0)
