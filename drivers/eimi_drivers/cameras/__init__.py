"""Drivers of cameras, and `open_camera`, which opens one by name.

camera_names   the drivers by name
opencv         a device, a video file or a series of images through OpenCV
basler         Basler cameras through pypylon
aravis         GigE Vision and USB3 Vision cameras of any vendor through Aravis
aravis_settings    write the settings of a camera through Aravis, and read them back
aravis_library     the functions of the library Aravis
gentl          cameras through the GenTL producer of their vendor
labelled       put the name of a camera before the message of an error
pixel_formats  decode the pixel formats of GenICam cameras
rolling_shutter    the time between the rows of a rolling shutter
image_series   sort image files by the numbers in their names
settings       the settings of a camera, and whether the camera took them
frame_format   check that a frame has the shape and type of the frames before it
timed          enforce a timeout on every call of a camera
"""

from eimi_drivers.cameras.camera_names import CAMERAS, open_camera
from eimi_drivers.cameras.image_series import list_images
from eimi_drivers.cameras.settings import CameraSettings

__all__ = ["CAMERAS", "CameraSettings", "list_images", "open_camera"]
