"""Camera settings pass from rig.toml to the camera; the dataset contains the values that the camera then reports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
import pytest

from eimi_drivers.cameras.settings import NO_SETTINGS, CameraSettings
from eimi_drivers.clock import WallClock
from eimi_drivers.emulators import CoilSupply, emulate, serve_tcp
from eimi_drivers.interfaces import InstrumentError
from eimi_lab.acquisition.open_bench import open_bench
from eimi_lab.acquisition.run import acquire
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.process.errors import InputError

ALL = """
exposure_s = 0.008
gain = 6
gamma = 1.0
region = [320, 0, 640, 1024]
bit_depth = 12
frame_rate_Hz = 120.0
"""


def rig_with(files: Path, camera: str, address: str = "/dev/ttyACM0") -> Rig:
    (files / "rig.toml").write_text(f"""
name = "bench"
calibration = "calibration.toml"
supply = {{ driver = "scpi", address = "{address}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
[camera]
{camera}
""")
    return load_rig(files / "rig.toml")


def test_settings_are_read_from_the_rig(files: Path) -> None:
    rig = rig_with(files, f'driver = "basler"\nsource = "40012345"{ALL}')
    assert rig.camera.settings == CameraSettings(0.008, 6, 1.0, (320, 0, 640, 1024), 12, 120.0)
    assert rig_with(files, 'driver = "opencv"\nsource = 0').camera.settings == NO_SETTINGS
    assert load_rig("bench_example").camera.settings == NO_SETTINGS


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("exposure_s = 0", "camera.exposure_s = 0 should be greater than 0"),
        ("exposure_ms = 8.0", "camera.exposure_ms is not a known key; did you mean exposure_s?"),
        ("gain = '6 dB'", "camera.gain = '6 dB' should be a valid number"),
        ("gamma = -1.0", "camera.gamma = -1.0 should be greater than 0"),
        ("region = [0, 0, 640]", "camera.region should have more than 3 values"),
        ("region = [0, 0, 640, 0]", "camera.region = [0, 0, 640, 0] should be left and top (0 or more), width and"),
        ("region = [-1, 0, 640, 5]", "camera.region = [-1, 0, 640, 5] should be left and top (0 or more), width and"),
        ("bit_depth = 4", "camera.bit_depth = 4 should be greater than or equal to 8"),
        ("frame_rate_Hz = 0", "camera.frame_rate_Hz = 0 should be greater than 0"),
        (
            'trigger = "Line1"\nframe_rate_Hz = 9.0',
            "[camera] trigger = 'Line1' and frame_rate_Hz = 9 exclude each other",
        ),
        ("bit_depth = 12.0", "camera.bit_depth = 12.0 should be a valid integer"),
    ],
)
def test_a_wrong_setting_is_refused_in_one_line(files: Path, line: str, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        rig_with(files, f'driver = "opencv"\nsource = 0\n{line}')
    assert str(caught.value).removeprefix(f"{files / 'rig.toml'}: ").startswith(expected)


def test_the_virtual_camera_has_no_settings(files: Path) -> None:
    shipped = load_rig("virtual")
    assert shipped.virtual is not None
    (files / "virtual_calibration.toml").write_text(shipped.calibration.text)
    (files / "virtual_materials.toml").write_text(shipped.virtual.materials.text)
    (files / "rig.toml").write_text(
        shipped.text.replace('source = "virtual"', 'source = "virtual"\nexposure_s = 0.01\ngain = 1.0')
    )
    with pytest.raises(InputError, match=r"\[camera\] should not have exposure_s, gain with driver = 'virtual'"):
        load_rig(files / "rig.toml")


@pytest.fixture
def recording(files: Path, frame: Callable[..., np.ndarray]) -> Path:
    folder = files / "recording"
    folder.mkdir()
    for number in range(1000):
        cv2.imwrite(str(folder / f"f_{number}.bmp"), frame(number % 20))
    return folder


def test_the_region_of_the_camera_is_stored_in_the_dataset(setup: Any, recording: Path) -> None:
    coil = CoilSupply(WallClock(), time_constant_s=0.01)
    with serve_tcp(emulate("scpi", coil)) as address:
        camera = f'driver = "opencv"\nsource = "{recording}"\nregion = [32, 0, 64, 96]'
        rig = rig_with(recording.parent, camera, address)
        with open_bench(rig, setup.specimen, setup.protocol.limits) as bench:
            assert bench.camera_settings == CameraSettings(region=(32, 0, 64, 96))
            acquire(setup.protocol, setup.specimen, rig, bench, setup.path)
    assert not coil.state.output
    with h5py.File(setup.path) as file:
        assert file["entry/data/frames"].shape[1:] == (96, 64)
        assert {name: found[()].tolist() for name, found in file["entry/instrument/detector/settings"].items()} == {
            "region": [32, 0, 64, 96]
        }


def test_the_settings_that_the_camera_reads_back_are_stored(setup: Any) -> None:
    read_back = CameraSettings(exposure_s=0.00799, gain=6.02, gamma=1.0, bit_depth=8)
    setup.bench = replace(setup.bench, camera_settings=read_back)
    setup.run()
    with h5py.File(setup.path) as file:
        kept = {name: found[()] for name, found in file["entry/instrument/detector/settings"].items()}
    assert kept == read_back.chosen()


def test_a_setting_that_the_camera_does_not_have_ends_before_anything_is_switched_on(
    setup: Any, recording: Path
) -> None:
    heard: list[bytes] = []

    class Listening:
        def receive(self, data: bytes) -> bytes:
            heard.append(data)
            return b""

    with serve_tcp(Listening()) as address:
        rig = rig_with(recording.parent, f'driver = "opencv"\nsource = "{recording}"\nexposure_s = 0.01', address)
        with (
            pytest.raises(InstrumentError, match="recording: a recording has no exposure_s to set"),
            open_bench(rig, setup.specimen, setup.protocol.limits),
        ):
            pass
    assert heard == []
