"""Opening a camera by the name of its driver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from eimi_drivers.cameras.basler import BaslerCamera
from eimi_drivers.cameras.opencv import OpenCVCamera
from eimi_drivers.cameras.settings import NO_SETTINGS, CameraSettings
from eimi_drivers.installed import Drivers
from eimi_drivers.interfaces import Camera


class SetCamera(Camera, Protocol):
    """A camera whose settings were set when it was opened; `settings` are those that it reads back."""

    settings: CameraSettings


CAMERAS: Drivers[Callable[[str | int, CameraSettings], SetCamera]] = Drivers(
    "camera", "eimi_drivers.cameras", {OpenCVCamera.name: OpenCVCamera, BaslerCamera.name: BaslerCamera}
)
"""Every camera driver by its name, those of other installed packages included."""


def open_camera(driver: str, source: str | int, settings: CameraSettings = NO_SETTINGS) -> SetCamera:
    """Open a camera.

    driver: a name in `CAMERAS`. source: as the driver takes it; for "opencv" a device index, a video file, a
    folder of images or a numbered pattern, for "basler" a serial number.
    settings: set before the first frame and read back.

    Raises InstrumentError for an unknown driver or a setting that the camera does not have,
    InstrumentDisconnected when the source cannot be opened, SetPointNotTaken for a setting that did not take.
    """
    return CAMERAS.find(driver)(source, settings)
