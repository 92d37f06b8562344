"""Drivers of cameras, and `open_camera`, which opens a camera by the name of its driver.

camera_names   the drivers by name
opencv         a device, a video file or a series of images through OpenCV
basler         Basler cameras through pypylon
aravis         GigE Vision and USB3 Vision cameras of any vendor through Aravis
aravis_settings    write the settings of a camera with the library Aravis, and read them back
aravis_library     the functions of the library Aravis
gentl          cameras through a GenTL producer, a library of the camera's maker
labelled       put the name of a camera before the message of an error
pixel_formats  decode the pixel formats of GenICam cameras
rolling_shutter    the time between the rows of a rolling shutter
image_series   read the images of a folder in the order of the numbers in their names
settings       the settings of a camera, and their comparison with the values read back
frame_format   check that a frame has the size, the bit depth and the colours of the first frame
timed          a time limit for every call of a camera
"""

from eimi_drivers.cameras.camera_names import CAMERAS, open_camera
from eimi_drivers.cameras.image_series import list_images
from eimi_drivers.cameras.settings import CameraSettings

__all__ = ["CAMERAS", "CameraSettings", "list_images", "open_camera"]
