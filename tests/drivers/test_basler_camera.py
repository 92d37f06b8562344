"""The driver of Basler cameras works with Basler's emulated cameras, and names pypylon if pypylon is missing."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

from eimi_drivers.cameras import CameraSettings, open_camera
from eimi_drivers.interfaces import (
    Camera,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    SetPointRefused,
)
from tests.patience import PATIENCE_S


@pytest.fixture(scope="module")
def two_cameras():
    # The serial numbers of two emulated cameras of pypylon.
    before = os.environ.get("PYLON_CAMEMU")
    os.environ["PYLON_CAMEMU"] = "2"
    pytest.importorskip("pypylon.pylon", reason="needs pypylon: pip install 'eimi-lab[basler]'")
    from pypylon import pylon

    devices = pylon.TlFactory.GetInstance().EnumerateDevices()
    yield [device.GetSerialNumber() for device in devices if device.GetDeviceClass() == "BaslerCamEmu"]
    if before is None:
        del os.environ["PYLON_CAMEMU"]
    else:
        os.environ["PYLON_CAMEMU"] = before


@pytest.fixture
def camera(two_cameras):
    opened = open_camera("basler", two_cameras[0], CameraSettings(region=(0, 0, 64, 48)))
    yield opened
    opened.close()


def test_frames_are_numbered_without_a_gap(camera):
    assert isinstance(camera, Camera)
    frames = [camera.grab(PATIENCE_S) for _ in range(5)]
    assert np.diff([frame.number for frame in frames]).tolist() == [1, 1, 1, 1]
    assert all(np.diff([frame.timestamp_s for frame in frames]) > 0)
    assert all(frame.image.shape == (48, 64) and frame.image.dtype == np.uint8 for frame in frames)


def test_settings_are_set_and_read_back(two_cameras):
    settings = CameraSettings(exposure_s=0.002, gain=6.0, gamma=0.8, region=(16, 32, 640, 480), bit_depth=12)
    camera = open_camera("basler", two_cameras[1], settings)
    assert (camera.settings.exposure_s, camera.settings.gain) == pytest.approx((0.002, 6.0), rel=1e-3)
    assert camera.settings.gamma == pytest.approx(0.8, rel=1e-3)
    assert (camera.settings.region, camera.settings.bit_depth) == ((16, 32, 640, 480), 12)
    image = camera.grab(PATIENCE_S).image
    assert (image.shape, image.dtype) == ((480, 640), np.uint16)
    assert two_cameras[1] in camera.identify().text
    camera.close()


@pytest.mark.parametrize(
    "settings",
    [
        CameraSettings(exposure_s=1e6),
        CameraSettings(gain=-1.0),
        CameraSettings(gamma=99.0),
        CameraSettings(region=(4090, 0, 640, 480)),
        CameraSettings(bit_depth=9),
    ],
)
def test_settings_out_of_range_are_refused_and_the_camera_is_free_again(two_cameras, settings):
    with pytest.raises(SetPointRefused, match="must be"):
        open_camera("basler", two_cameras[0], settings)
    open_camera("basler", two_cameras[0]).close()


def test_a_failed_grab_is_an_error_and_the_next_frame_shows_the_gap(camera):
    before = camera.grab(PATIENCE_S).number
    camera._camera.ForceFailedBufferCount.Value = 1
    camera._camera.ForceFailedBuffer.Execute()
    with pytest.raises(InstrumentError, match="a frame was not transferred"):
        camera.grab(PATIENCE_S)
    assert camera.grab(PATIENCE_S).number == before + 2


def test_with_a_frame_rate_the_camera_runs_freely(two_cameras):
    camera = open_camera("basler", two_cameras[0], CameraSettings(region=(0, 0, 64, 48), frame_rate_Hz=50.0))
    assert camera.settings.frame_rate_Hz == pytest.approx(50.0)
    first = camera.grab(PATIENCE_S).number
    assert [camera.grab(PATIENCE_S).number for _ in range(3)] == [first + 1, first + 2, first + 3]
    camera.flush()
    assert camera.grab(PATIENCE_S).number > first + 4
    camera.close()


def test_a_late_frame_is_not_returned_for_the_next_grab(camera):
    with pytest.raises(InstrumentTimeout, match=r"no frame within 0\.001 s"):
        camera.grab(0.001)  # the emulated camera takes ten times as long
    time.sleep(0.3)
    assert camera.grab(PATIENCE_S).number == 1


def test_images_are_served_pixel_for_pixel(camera, tmp_path):
    image = np.random.default_rng(3).integers(0, 255, (48, 64), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), image)
    emulator = camera._camera
    emulator.StopGrabbing()
    emulator.TestImageSelector.Value = "Off"
    emulator.ImageFilename.Value = str(tmp_path)
    emulator.ImageFileMode.Value = "On"
    emulator.StartGrabbing()
    np.testing.assert_array_equal(camera.grab(PATIENCE_S).image, image)


def test_a_grab_from_a_closed_camera_is_an_error(camera):
    camera.close()
    camera.close()
    with pytest.raises(InstrumentDisconnected, match="unplugged or closed"):
        camera.grab(PATIENCE_S)


def test_the_error_for_a_missing_camera_lists_the_attached_cameras(two_cameras):
    with pytest.raises(InstrumentDisconnected, match=rf"12345: not found; attached Basler cameras: .*{two_cameras[0]}"):
        open_camera("basler", "12345")


def test_without_pypylon_the_error_names_the_extra_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pypylon", None)
    with pytest.raises(InstrumentError, match=r"pip install 'eimi-lab\[basler\]'"):
        open_camera("basler", 0)


def test_attached_cameras_are_listed(two_cameras):
    from eimi_drivers.discovery import list_basler_cameras

    assert {found.address for found in list_basler_cameras()} >= set(two_cameras)


def test_drivers_are_imported_without_pypylon():
    code = "import sys; import eimi_drivers.cameras; sys.exit('pypylon' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=PATIENCE_S).returncode == 0
