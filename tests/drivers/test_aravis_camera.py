"""The camera driver `aravis` works with an emulated GigE Vision camera."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from eimi_drivers.cameras import CameraSettings, aravis, aravis_library, open_camera
from eimi_drivers.discovery import list_genicam_cameras
from eimi_drivers.emulators.gige_camera import LOOPBACK
from eimi_drivers.emulators.gige_process import CameraProcess, gige_process
from eimi_drivers.interfaces import (
    InstrumentError,
    InstrumentTimeout,
    SetPointNotTaken,
    SetPointRefused,
)
from tests.patience import PATIENCE_S
from tests.shared.emulated_gige import (
    SIZE_PX,
    close_all,
    gige_camera,
    needs_aravis,
    numbered,
    only_gige_camera,
    opened,
    ramp,
)

GRAB_S = 20.0


@pytest.fixture(scope="module")
def alone() -> Iterator[None]:
    # Lock the GigE camera until the end of this module.
    with only_gige_camera():
        yield


@pytest.fixture(scope="module")
def still(alone: None) -> Iterator[CameraProcess]:
    # An emulated camera with a ramp of grey values, which several tests share.
    with gige_camera(ramp, serial_number="EIMI01", shutter="Rolling") as process:
        yield process


@pytest.fixture(autouse=True)
def closed_at_the_end() -> Iterator[None]:
    yield
    close_all()


def expected() -> np.ndarray:
    return ramp()()


@needs_aravis
def test_settings_are_read_back_in_si_units_and_the_region_is_that_of_the_sensor(still: CameraProcess) -> None:
    camera = opened(CameraSettings(exposure_s=0.002, gain=3.5, region=(10, 20, 60, 40), bit_depth=8))
    settings, image = camera.settings, camera.grab(GRAB_S).image
    camera.close()
    assert (settings.exposure_s, settings.gain) == pytest.approx((0.002, 3.5))
    assert (settings.region, settings.bit_depth, settings.trigger) == ((10, 20, 60, 40), 8, "software")
    assert settings.row_time_s == pytest.approx(10e-6)
    np.testing.assert_array_equal(image, expected()[20:60, 10:70])


@needs_aravis
@pytest.mark.parametrize("name", ["Mono12", "Mono12Packed", "Mono12p", "Mono16"])
def test_values_with_more_than_8_bits_arrive_unpacked(still: CameraProcess, name: str) -> None:
    camera = opened(CameraSettings(region=(0, 0, *SIZE_PX), pixel_format=name))
    image = camera.grab(GRAB_S).image
    camera.close()
    assert image.dtype == np.uint16
    np.testing.assert_array_equal(image, expected().astype(np.uint16) << (4 if "12" in name else 8))


@needs_aravis
@pytest.mark.parametrize(
    ("name", "dtype"), [("BayerRG8", np.uint8), ("BayerGB8", np.uint8), ("BayerRG12Packed", np.uint16)]
)
def test_a_bayer_mosaic_arrives_in_colours(still: CameraProcess, name: str, dtype: type) -> None:
    camera = opened(CameraSettings(region=(0, 0, *SIZE_PX), pixel_format=name))
    image = camera.grab(GRAB_S).image
    camera.close()
    assert (image.shape, image.dtype) == ((*SIZE_PX[::-1], 3), dtype)


@needs_aravis
@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (
            CameraSettings(exposure_s=1e6),
            r"exposure_s = 1000000\.0: \[ExposureTime\] Value '1e\+12' greater than",
        ),
        (CameraSettings(region=(150, 0, 100, 50)), r"region = \(150, 0, 100, 50\): \[OffsetX\]"),
        (CameraSettings(region=(0, 0, 5000, 50)), "Width"),
        (CameraSettings(gain=99.0), r"gain = 99\.0: \[Gain\] Value"),
        (CameraSettings(frame_rate_Hz=1e5), "frame_rate_Hz was set to 100000"),
        (CameraSettings(bit_depth=9), r"bit_depth = 9: pixel_format must be one of Mono8, Mono12, "),
        (CameraSettings(pixel_format="YUV422"), r"pixel_format = 'YUV422': pixel_format must be one of Mono8"),
        (
            CameraSettings(trigger="Line7"),
            r"trigger = 'Line7' must be one of the trigger sources of this camera: Line0, software",
        ),
        (CameraSettings(trigger="Line0", frame_rate_Hz=5.0), "a triggered camera has no frame_rate_Hz"),
    ],
)
def test_settings_that_the_camera_cannot_have_are_refused_and_the_camera_is_free_again(
    still: CameraProcess, settings: CameraSettings, words: str
) -> None:
    with pytest.raises((SetPointRefused, SetPointNotTaken), match=rf"camera 127\.0\.0\.1: .*{words}"):
        opened(settings)
    camera = opened(CameraSettings(region=(0, 0, *SIZE_PX), bit_depth=8))
    camera.grab(GRAB_S)
    camera.close()


@needs_aravis
def test_with_a_frame_rate_the_camera_runs_freely_and_no_frame_is_missing(still: CameraProcess) -> None:
    camera = opened(CameraSettings(region=(0, 0, 64, 48), frame_rate_Hz=50.0))
    assert camera.settings.frame_rate_Hz == pytest.approx(50.0)
    frames = [camera.grab(GRAB_S) for _ in range(10)]
    camera.close()
    assert np.diff([frame.number for frame in frames]).tolist() == [1] * 9
    intervals_s = np.diff([frame.timestamp_s for frame in frames])
    assert (intervals_s > 0).all()
    assert 1e-3 < np.median(intervals_s) < 10.0  # 0.02 s on an idle computer, never nanoseconds


@needs_aravis
def test_with_a_trigger_input_the_camera_waits_for_its_signal(
    still: CameraProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(aravis, "ANSWER_WITHIN_S", PATIENCE_S)
    camera = opened(CameraSettings(trigger="Line0"))
    assert camera.settings.trigger == "Line0"
    with pytest.raises(InstrumentTimeout, match=r"camera 127\.0\.0\.1: no complete frame within 0\.3 s"):
        camera.grab(0.3)  # nothing is connected to the trigger input
    camera.close()


@needs_aravis
def test_a_camera_that_another_program_controls_is_refused_until_that_program_ends(
    still: CameraProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = (
        "from eimi_drivers.cameras import open_camera\n"
        f"camera = open_camera('aravis', '{LOOPBACK}'); print('open', flush=True); input()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "open\n"
        with pytest.raises(InstrumentError, match="another program controls this camera"):
            opened()
        other.kill()
    monkeypatch.setattr(aravis, "CONTROL_FREE_WITHIN_S", PATIENCE_S)
    opened().close()  # the camera becomes free after the program that controlled it has ended


@needs_aravis
def test_attached_cameras_are_listed_by_serial_number(still: CameraProcess) -> None:
    cameras = {found.address: found for found in list_genicam_cameras()}
    assert cameras["EIMI01"].driver == "aravis"
    assert "GigEVision at 127.0.0.1" in cameras["EIMI01"].text


@needs_aravis
def test_a_second_emulated_camera_at_an_address_is_refused(still: CameraProcess) -> None:
    with (
        pytest.raises(InstrumentError, match=r"cannot serve a GigE camera on 127\.0\.0\.1, port 3956"),
        gige_process(numbered, SIZE_PX),
    ):
        pass


def test_without_the_library_the_error_names_the_package_and_nothing_is_listed(monkeypatch) -> None:
    monkeypatch.setattr(aravis_library, "_FOLDERS", {})
    aravis_library.load_aravis.cache_clear()
    try:
        with pytest.raises(
            InstrumentError, match=r"the library Aravis 0\.8 is not installed: `apt install libaravis-0.8-0`"
        ):
            open_camera("aravis", LOOPBACK)
        assert list_genicam_cameras() == ()
    finally:
        aravis_library.load_aravis.cache_clear()
