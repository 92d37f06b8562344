"""The camera driver `gentl` works with the emulated camera of the package genicam."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eimi_drivers.cameras import CAMERAS, CameraSettings, open_camera
from eimi_drivers.cameras.gentl import PRODUCERS
from eimi_drivers.discovery import list_gentl_cameras
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, SetPointNotTaken, SetPointRefused
from eimi_drivers.testing import CAMERA_CHECKS, check_camera

GRAB_S = 20.0


@pytest.fixture
def producer(monkeypatch: pytest.MonkeyPatch) -> Path:
    # The folder with the GenTL producer (the vendor's driver) of the package genicam.
    genicam = pytest.importorskip("genicam", reason="needs harvesters: pip install 'eimi-lab[gentl]'")
    folder = Path(genicam.__file__).parent
    if not list(folder.glob("*.cti")):
        pytest.skip("this version of genicam has no test producer")
    monkeypatch.setenv(PRODUCERS, str(folder))
    return folder


@pytest.mark.parametrize("check", CAMERA_CHECKS)
def test_a_gentl_camera_conforms(producer: Path, check) -> None:
    settings = CameraSettings(region=(0, 0, 200, 100), pixel_format="Mono8", frame_rate_Hz=40.0)
    check_camera(CAMERAS["gentl"], "1", settings=settings, absent="99", checks=[check])


def test_settings_are_read_back_and_a_camera_without_a_trigger_runs_freely(producer: Path) -> None:
    camera = open_camera("gentl", "0", CameraSettings(region=(0, 0, 320, 200), bit_depth=8))
    settings, frames = camera.settings, [camera.grab(GRAB_S) for _ in range(3)]
    camera.close()
    assert (settings.region, settings.pixel_format, settings.trigger) == ((0, 0, 320, 200), "Mono8", None)
    assert np.diff([frame.number for frame in frames]).tolist() == [1, 1]
    assert all((frame.image.shape, frame.image.dtype) == ((200, 320), np.uint8) for frame in frames)
    assert camera.identify().serial_number == "0"


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (CameraSettings(exposure_s=0.01), r"exposure_s = 0\.01: this camera has no ExposureTime or ExposureTimeAbs"),
        (CameraSettings(region=(0, 0, 9999, 100)), r"region = \(0, 0, 9999, 100\): .*"),
        (CameraSettings(region=(8, 0, 200, 100)), r"region = .*: this camera has no OffsetX"),
        (CameraSettings(bit_depth=12), r"bit_depth = 12: pixel_format must be one of Mono8"),
        (CameraSettings(trigger="Line1"), r"trigger = 'Line1' must be one of the trigger sources of this camera: none"),
    ],
)
def test_settings_that_the_camera_cannot_have_are_refused(producer: Path, settings: CameraSettings, words: str) -> None:
    with pytest.raises((SetPointRefused, SetPointNotTaken), match=f"camera 0: {words}"):
        open_camera("gentl", "0", settings if settings.bit_depth else replace(settings, pixel_format="Mono8"))
    open_camera("gentl", "0", CameraSettings(pixel_format="Mono8")).close()


def test_attached_cameras_are_listed_by_serial_number(producer: Path) -> None:
    assert {found.address for found in list_gentl_cameras()} == {"0", "1", "2"}
    with pytest.raises(
        InstrumentDisconnected, match=r"camera 7: no camera has this serial number; attached cameras: 0 "
    ):
        open_camera("gentl", "7")


def test_without_a_producer_the_error_names_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("harvesters", reason="needs harvesters: pip install 'eimi-lab[gentl]'")
    monkeypatch.delenv(PRODUCERS, raising=False)
    assert list_gentl_cameras() == ()
    with pytest.raises(
        InstrumentError, match=f"there is no GenTL producer; install .* variable {PRODUCERS} to the folder"
    ):
        open_camera("gentl", "0")


def test_without_harvesters_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "genicam", None)
    with pytest.raises(InstrumentError, match=r"pip install 'eimi-lab\[gentl\]'"):
        open_camera("gentl", "0")
