"""Drivers of cameras, and `open_camera`, which opens one by name.

camera_names   the drivers by name
opencv         a device, a video file or a series of images through OpenCV
basler         Basler cameras through pypylon
image_series   sort image files by the numbers in their names
settings       the settings of a camera, and whether the camera took them
frame_format   check that a frame has the shape and type of the frames before it
timed          enforce a timeout on every call of a camera
"""

from eimi_drivers.cameras.camera_names import CAMERAS, open_camera
from eimi_drivers.cameras.image_series import list_images
from eimi_drivers.cameras.settings import CameraSettings

__all__ = ["CAMERAS", "CameraSettings", "list_images", "open_camera"]
