"""Cameras, and the one way to open one by name.

`opencv` serves a device, a video file and a series of images through one class; `image_series` puts image
files in the order in which a person numbered them; `opening` knows the drivers by name.
"""

from eimi_drivers.cameras.image_series import list_images
from eimi_drivers.cameras.opening import CAMERAS, open_camera

__all__ = ["CAMERAS", "list_images", "open_camera"]
