"""Opening a camera by the name of its driver."""

from __future__ import annotations

from collections.abc import Callable

from eimi_drivers.cameras.opencv import OpenCVCamera
from eimi_drivers.interfaces import Camera, InstrumentError

CAMERAS: dict[str, Callable[[str | int], Camera]] = {OpenCVCamera.name: OpenCVCamera}


def open_camera(driver: str, source: str | int) -> Camera:
    """Open a camera.

    driver: "opencv". source: a device index, a video file, a folder of images or a numbered pattern.

    Raises InstrumentError for an unknown driver, InstrumentDisconnected when the source cannot be opened.
    """
    if driver not in CAMERAS:
        raise InstrumentError(f"there is no camera driver {driver!r}; those that exist: {', '.join(sorted(CAMERAS))}")
    return CAMERAS[driver](source)
