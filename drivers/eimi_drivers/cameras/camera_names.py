"""Opening a camera by the name of its driver."""

from __future__ import annotations

from eimi_drivers.cameras.basler import BaslerCamera
from eimi_drivers.cameras.opencv import OpenCVCamera
from eimi_drivers.cameras.settings import NO_SETTINGS, CameraSettings, settings_of
from eimi_drivers.contract import check_camera, check_camera_driver
from eimi_drivers.installed import Drivers
from eimi_drivers.interfaces import Camera, CameraDriver, InstrumentError, raised

CAMERAS: Drivers[CameraDriver] = Drivers(
    "camera",
    "eimi_drivers.cameras",
    {OpenCVCamera.name: OpenCVCamera, BaslerCamera.name: BaslerCamera},
    reserved=("virtual",),
)
"""Every camera driver by name: those of this package, those of other installed packages, and those that are added."""


def open_camera(driver: str, source: str | int, settings: CameraSettings = NO_SETTINGS) -> Camera:
    """Open a camera.

    Parameters
    ----------
    driver : str
        A name in `CAMERAS`.
    source : str or int
        As the driver takes it; for "opencv" a device index, a video file, a folder of images or a numbered pattern,
        for "basler" a serial number.
    settings : CameraSettings
        Set before the first frame and read back.

    Returns
    -------
    Camera
        The open camera, which has every member of `Camera`.

    Raises
    ------
    UnusableDriver
        The driver is unknown, or lacks a member.
    InstrumentError
        The camera does not have one of the settings.
    InstrumentDisconnected
        The source cannot be opened.
    SetPointNotTaken
        A setting did not take.
    """
    return open_with(CAMERAS[driver], driver, source, settings)


def open_with(driver: CameraDriver, name: str, source: str | int, settings: CameraSettings = NO_SETTINGS) -> Camera:
    """Open a camera with a driver that needs no entry in `CAMERAS`. See `open_camera`; `name` is for messages."""
    check_camera_driver(name, driver)
    try:
        camera = driver(source, settings)
    except (InstrumentError, KeyboardInterrupt):
        raise
    except Exception as error:  # a camera's library raises errors of its own
        raise InstrumentError(f"{name} camera {source}: its driver raised {raised(error)}") from error
    check_camera(name, driver, camera)
    try:
        settings.verify(f"{name} camera {source}", settings_of(camera))
    except InstrumentError:
        camera.close()
        raise
    return camera
