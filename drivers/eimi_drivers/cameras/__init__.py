"""Cameras, and the one way to open one by name.

`opencv` serves a device, a video file and a series of images through one class; `basler` Basler cameras;
`image_series` puts image files in the order in which a person numbered them; `settings` says what can be set on
a camera; `opening` knows the drivers by name.
"""

from eimi_drivers.cameras.camera_names import CAMERAS, open_camera
from eimi_drivers.cameras.image_series import list_images
from eimi_drivers.cameras.settings import CameraSettings

__all__ = ["CAMERAS", "CameraSettings", "list_images", "open_camera"]
