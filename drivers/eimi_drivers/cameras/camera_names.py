"""Open a camera by the name of its driver."""

from __future__ import annotations

from eimi_drivers.cameras.aravis import AravisCamera
from eimi_drivers.cameras.basler import BaslerCamera
from eimi_drivers.cameras.gentl import GenTLCamera
from eimi_drivers.cameras.opencv import OpenCVCamera
from eimi_drivers.cameras.settings import NO_SETTINGS, CameraSettings, settings_of
from eimi_drivers.contract import check_camera, check_camera_driver
from eimi_drivers.installed import Drivers
from eimi_drivers.interfaces import Camera, CameraDriver, InstrumentError, raised

CAMERAS: Drivers[CameraDriver] = Drivers(
    "camera",
    "eimi_drivers.cameras",
    {camera.name: camera for camera in (OpenCVCamera, BaslerCamera, AravisCamera, GenTLCamera)},
    reserved=("virtual",),
)
"""Camera drivers by name: drivers of this package, of other installed packages, and drivers added by a program."""


def open_camera(driver: str, source: str | int, settings: CameraSettings = NO_SETTINGS) -> Camera:
    """Open a camera, apply the settings, and compare the settings with the values that are read back.

    Parameters
    ----------
    driver : str
        A name in `CAMERAS`.
    source : str or int
        The camera. For "opencv": a device index, a video file, a folder of images, or a pattern such as ``f_%03d.png``.
        For "basler": a serial number, or an index in the list of attached cameras. For "gentl": a serial number, or the
        identifier that the producer gives to the camera. For "aravis": a serial number or an IP address.
    settings : CameraSettings
        The settings that are applied before the first frame.

    Returns
    -------
    Camera
        The open camera.

    Raises
    ------
    UnusableDriver
        No driver has this name, or the driver lacks a method or an attribute.
    InstrumentError
        The camera does not have a requested setting.
    InstrumentDisconnected
        The source cannot be opened.
    SetPointNotTaken
        A value that was read back differs from the requested value.
    """
    return open_with(CAMERAS[driver], driver, source, settings)


def open_with(driver: CameraDriver, name: str, source: str | int, settings: CameraSettings = NO_SETTINGS) -> Camera:
    """Open a camera with a driver that is given as an object, and return the camera.

    Parameters
    ----------
    driver : CameraDriver
        The class or the function that opens the camera.
    name : str
        The name of the driver in messages.
    source : str or int
        The camera, in the form that the driver expects.
    settings : CameraSettings
        The settings that are applied before the first frame.

    Raises
    ------
    UnusableDriver
        The driver or the camera lacks a method or an attribute.
    InstrumentError
        The camera cannot be opened, or does not have a requested setting.
    SetPointNotTaken
        A value that was read back differs from the requested value.
    """
    check_camera_driver(name, driver)
    try:
        camera = driver(source, settings)
    except (InstrumentError, KeyboardInterrupt):
        raise
    except Exception as error:  # the library of a camera can raise any exception
        raise InstrumentError(f"{name} camera {source}: its driver raised {raised(error)} on opening") from error
    check_camera(name, driver, camera)
    try:
        settings.verify(f"{name} camera {source}", settings_of(camera))
    except InstrumentError:
        camera.close()
        raise
    return camera
