"""The camera driver `opencv` works with video files, and with a simulated device and its faults."""

from __future__ import annotations

import threading
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eimi_drivers.cameras import CameraSettings, list_images, open_camera, opencv
from eimi_drivers.cameras.image_series import natural_key
from eimi_drivers.interfaces import (
    Camera,
    Frame,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    ReplyNotUnderstood,
    SetPointNotTaken,
    SetPointRefused,
)
from tests.patience import PATIENCE_S


def pictures(count: int, dtype: type = np.uint8) -> list[np.ndarray]:
    random = np.random.default_rng(5)
    return [random.integers(0, np.iinfo(dtype).max, (24, 32), dtype=dtype) for _ in range(count)]


def play(camera: Camera, count: int) -> list[Frame]:
    frames = [camera.grab(PATIENCE_S) for _ in range(count)]
    assert [frame.number for frame in frames] == list(range(count))
    assert all(a.timestamp_s < b.timestamp_s for a, b in pairwise(frames))
    return frames


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("by_pattern", [False, True])
def test_a_folder_of_images_is_played_exactly_and_in_natural_order(tmp_path, dtype, by_pattern):
    expected = pictures(12, dtype)
    for number, image in enumerate(expected):
        cv2.imwrite(str(tmp_path / f"f_{number}.png"), image)
    (tmp_path / "notes.txt").write_text("not an image")
    camera = open_camera("opencv", str(tmp_path / "f_%d.png" if by_pattern else tmp_path))
    for frame, image in zip(play(camera, 12), expected, strict=True):
        assert frame.image.dtype == dtype
        np.testing.assert_array_equal(frame.image, image)
    with pytest.raises(InstrumentDisconnected, match="end of playback after 12 images"):
        camera.grab(PATIENCE_S)
    camera.close()


def test_flushing_a_recording_loses_no_frame(tmp_path):
    for number, image in enumerate(pictures(3)):
        cv2.imwrite(str(tmp_path / f"{number:03d}.png"), image)
    camera = open_camera("opencv", str(tmp_path / "%03d.png"))
    for number in range(3):
        camera.flush()
        assert camera.grab(PATIENCE_S).number == number
    camera.close()


def test_a_pattern_selects_only_its_own_images(tmp_path):
    for name in ("f_001.png", "f_1000.png", "f_002.png", "g_001.png", "f_x.png", "f_003.jpg", "xf_001.png"):
        (tmp_path / name).touch()
    assert [path.name for path in list_images(tmp_path / "f_%03d.png")] == [
        "f_001.png",
        "f_002.png",
        "f_1000.png",
    ]
    assert list_images(tmp_path / "h_%03d.png") == ()
    assert list_images(tmp_path / "absent" / "f_%03d.png") == ()


@given(numbers=st.lists(st.integers(0, 10**6), unique=True), prefix=st.text(alphabet="ab_-", max_size=3))
def test_natural_order_is_the_order_of_the_numbers(numbers, prefix):
    names = [f"{prefix}{number}.png" for number in numbers]
    assert sorted(names, key=natural_key) == [f"{prefix}{number}.png" for number in sorted(numbers)]


def test_a_lossless_video_is_played_exactly(tmp_path):
    expected = [cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in pictures(5)]
    path = tmp_path / "run.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 10.0, (32, 24))
    for image in expected:
        writer.write(image)
    writer.release()
    camera = open_camera("opencv", str(path))
    frames = play(camera, 5)
    for frame, image in zip(frames, expected, strict=True):
        np.testing.assert_array_equal(frame.image, image)
    assert [frame.timestamp_s for frame in frames] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    with pytest.raises(InstrumentDisconnected, match="end of playback after 5 frames"):
        camera.grab(PATIENCE_S)
    camera.close()


def test_a_file_that_is_no_image_is_named(tmp_path):
    (tmp_path / "broken.png").write_bytes(b"not a png")
    camera = open_camera("opencv", str(tmp_path))
    with pytest.raises(ReplyNotUnderstood, match=r"broken\.png"):
        camera.grab(PATIENCE_S)
    camera.close()


@pytest.mark.parametrize("source", ["absent", "frames/f_%03d.png", "", "notes.txt", "empty"])
def test_a_source_that_cannot_be_opened_is_named(tmp_path, monkeypatch, source):
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("not a video")
    Path("empty").mkdir()
    with pytest.raises(InstrumentDisconnected) as caught:
        open_camera("opencv", source)
    assert source in str(caught.value)


def test_the_error_for_an_unknown_name_lists_the_drivers():
    with pytest.raises(InstrumentError, match=r"'polaroid'.*opencv"):
        open_camera("polaroid", "0")


class FakeDevice:
    # A simulated device for OpenCV; a read waits until the test exposes a frame or unplugs the device.

    def __init__(self, index: int) -> None:
        self._exposures = threading.Semaphore(0)
        self.waiting = threading.Semaphore(0)
        self.unplugged = False
        self.released = threading.Event()
        self._value = 0
        self.properties: dict[int, float] = {}
        self.stuck: set[int] = set()

    def expose(self) -> None:
        self.waiting.acquire(timeout=PATIENCE_S)
        self._exposures.release()

    def isOpened(self) -> bool:
        return True

    def get(self, prop: int) -> float:
        return self.properties.get(prop, 0.0)

    def set(self, prop: int, value: float) -> bool:
        if prop not in self.stuck:
            self.properties[prop] = value
        return True  # real devices return True even if they refuse a value

    def getBackendName(self) -> str:
        return "V4L2"

    def read(self) -> tuple[bool, np.ndarray | None]:
        self.waiting.release()
        self._exposures.acquire()
        if self.unplugged:
            return False, None
        self._value += 1
        return True, np.full((2, 2), self._value, np.uint8)

    def release(self) -> None:
        self.released.set()


@pytest.fixture
def device(monkeypatch, tmp_path):
    (tmp_path / "video97").touch()
    monkeypatch.setattr(opencv, "DEVICES", tmp_path)
    made: list[FakeDevice] = []

    def make(index: int) -> FakeDevice:
        made.append(FakeDevice(index))
        return made[0]

    monkeypatch.setattr(cv2, "VideoCapture", make)
    camera = open_camera("opencv", "97")
    yield camera, made[0]
    made[0].unplugged = True
    made[0].expose()
    camera.close()
    assert made[0].released.is_set()


def test_a_device_that_hangs_is_a_timeout(device):
    camera, _ = device
    with pytest.raises(InstrumentTimeout, match="97"):
        camera.grab(0.05)


def test_only_the_newest_frame_of_a_device_is_kept_and_the_gap_is_counted(device):
    camera, fake = device
    for _ in range(3):
        fake.expose()
    fake.waiting.acquire(timeout=PATIENCE_S)  # the camera reads the fourth frame, so that the third frame is stored
    fake.waiting.release()
    frame = camera.grab(PATIENCE_S)
    assert (frame.number, int(frame.image[0, 0])) == (2, 3)


def test_a_device_with_a_frame_rate_keeps_its_frames_in_order_until_its_ring_is_full(monkeypatch, tmp_path):
    (tmp_path / "video97").touch()
    monkeypatch.setattr(opencv, "DEVICES", tmp_path)
    fake = FakeDevice(97)
    monkeypatch.setattr(cv2, "VideoCapture", lambda index: fake)
    camera = open_camera("opencv", "97", CameraSettings(frame_rate_Hz=100.0))
    try:
        for _ in range(32 + 3):
            fake.expose()
        fake.waiting.acquire(timeout=PATIENCE_S)  # the next frame is being read: all earlier frames are stored
        fake.waiting.release()
        assert [camera.grab(PATIENCE_S).number for _ in range(4)] == [3, 4, 5, 6]  # the first three were lost
        fake.expose()
        fake.waiting.acquire(timeout=PATIENCE_S)
        fake.waiting.release()
        camera.flush()
        with pytest.raises(InstrumentTimeout):
            camera.grab(0.01)
    finally:
        fake.unplugged = True
        fake.expose()
        camera.close()


def test_flushing_a_device_also_drops_the_frame_under_exposure(device):
    camera, fake = device
    fake.expose()
    fake.waiting.acquire(timeout=PATIENCE_S)  # frame 0 is stored, frame 1 is being exposed
    fake.waiting.release()
    camera.flush()
    fake.expose()
    fake.expose()
    frame = camera.grab(PATIENCE_S)
    assert (frame.number, int(frame.image[0, 0])) == (2, 3)


def test_an_unplugged_device_is_disconnected(device):
    camera, fake = device
    fake.unplugged = True
    fake.expose()
    with pytest.raises(InstrumentDisconnected, match="unplugged"):
        camera.grab(PATIENCE_S)
    fake.waiting.release()  # the fixture waits for a read, but no read follows


def test_a_device_without_its_node_is_disconnected_even_if_opencv_reports_success(device, tmp_path):
    camera, fake = device
    (tmp_path / "video97").unlink()
    fake.expose()
    with pytest.raises(InstrumentDisconnected, match="unplugged"):
        camera.grab(PATIENCE_S)
    fake.waiting.release()  # the fixture waits for a read, but no read follows


def test_a_grab_from_a_closed_camera_is_an_error(device):
    camera, fake = device
    fake.unplugged = True
    fake.waiting.acquire(timeout=PATIENCE_S)  # a frame is being exposed
    closing = threading.Thread(target=camera.close)
    closing.start()
    with pytest.raises(InstrumentDisconnected, match="97"):
        camera.grab(PATIENCE_S)
    fake.waiting.release()
    fake.expose()
    closing.join()
    fake.waiting.release()  # the fixture waits for a read, but no read follows


@pytest.fixture
def bare_device(monkeypatch, tmp_path):
    # A simulated device that the driver has not opened yet.
    monkeypatch.setattr(opencv, "DEVICES", tmp_path)
    fake = FakeDevice(97)
    monkeypatch.setattr(cv2, "VideoCapture", lambda index: fake)
    return fake


def close(camera: Camera, fake: FakeDevice) -> None:
    fake.unplugged = True
    fake.expose()
    camera.close()


def test_settings_are_set_and_read_back(bare_device):
    settings = CameraSettings(exposure_s=0.005, gain=12.0, gamma=100.0, bit_depth=16, frame_rate_Hz=60.0)
    camera = open_camera("opencv", 97, settings)
    assert camera.settings == settings
    assert bare_device.properties[cv2.CAP_PROP_EXPOSURE] == 50  # in units of 100 µs
    assert bare_device.properties[cv2.CAP_PROP_AUTO_EXPOSURE] == 1  # manual exposure
    close(camera, bare_device)


@pytest.mark.parametrize(
    ("stuck", "settings", "name"),
    [
        (cv2.CAP_PROP_EXPOSURE, CameraSettings(exposure_s=0.005), "exposure_s was set to 0.005 but reads back 0"),
        (cv2.CAP_PROP_GAIN, CameraSettings(gain=12.0), "gain was set to 12.0 but reads back 0"),
        (cv2.CAP_PROP_GAMMA, CameraSettings(gamma=100.0), "gamma was set to 100.0 but reads back 0"),
        (cv2.CAP_PROP_FPS, CameraSettings(frame_rate_Hz=60.0), "frame_rate_Hz was set to 60.0 but reads back 0"),
        (cv2.CAP_PROP_FOURCC, CameraSettings(bit_depth=16), "bit_depth was set to 16 but reads back 8"),
    ],
)
def test_a_setting_that_reads_back_wrong_is_named_and_the_device_is_released(bare_device, stuck, settings, name):
    bare_device.stuck.add(stuck)
    with pytest.raises(SetPointNotTaken, match=name):
        open_camera("opencv", 97, settings)
    assert bare_device.released.is_set()


@pytest.mark.parametrize(
    "settings",
    [
        CameraSettings(bit_depth=9),
        CameraSettings(exposure_s=-1.0),
        CameraSettings(region=(0, 0, 0, 5)),
        CameraSettings(frame_rate_Hz=-1.0),
        CameraSettings(exposure_s=0.0),
        CameraSettings(frame_rate_Hz=0.0),
    ],
)
def test_impossible_settings_are_refused(bare_device, settings):
    with pytest.raises(SetPointRefused, match="must be"):
        open_camera("opencv", 97, settings)
    assert bare_device.released.is_set()


def test_an_exposure_in_unknown_units_is_refused(monkeypatch, bare_device):
    monkeypatch.setattr(FakeDevice, "getBackendName", lambda self: "GSTREAMER")
    with pytest.raises(InstrumentError, match="the unit of exposure is not known for OpenCV's backend GSTREAMER"):
        open_camera("opencv", 97, CameraSettings(exposure_s=0.01))


def test_a_frame_that_was_ready_before_the_flush_is_skipped(bare_device):
    bare_device.properties[cv2.CAP_PROP_POS_MSEC] = 1000.0  # a time stamp from long before the flush
    camera = open_camera("opencv", 97)
    bare_device.waiting.acquire(timeout=PATIENCE_S)
    bare_device.waiting.release()
    camera.flush()
    for _ in range(3):  # the frame that is being exposed, and two frames from the device's buffer
        bare_device.expose()
    bare_device.waiting.acquire(timeout=PATIENCE_S)
    bare_device.waiting.release()
    with pytest.raises(InstrumentTimeout):
        camera.grab(0.05)
    bare_device.properties[cv2.CAP_PROP_POS_MSEC] = 1e15  # a time stamp after the flush
    bare_device.expose()
    frame = camera.grab(PATIENCE_S)
    assert (frame.number, frame.timestamp_s) == (3, 1e12)
    close(camera, bare_device)


def test_the_region_is_cut_out_of_every_image(tmp_path):
    image = pictures(1)[0]
    cv2.imwrite(str(tmp_path / "a.png"), image)
    camera = open_camera("opencv", str(tmp_path), CameraSettings(region=(3, 5, 10, 7)))
    np.testing.assert_array_equal(camera.grab(PATIENCE_S).image, image[5:12, 3:13])
    camera.close()


def test_a_region_beyond_the_image_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), pictures(1)[0])
    camera = open_camera("opencv", str(tmp_path), CameraSettings(region=(30, 0, 10, 7)))
    with pytest.raises(SetPointRefused, match="does not fit into images of 32 x 24"):
        camera.grab(PATIENCE_S)
    camera.close()


def test_a_recording_has_no_settings(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), pictures(1)[0])
    with pytest.raises(InstrumentError, match="a recording has no exposure_s, gain to set"):
        open_camera("opencv", str(tmp_path), CameraSettings(exposure_s=0.01, gain=1.0))
