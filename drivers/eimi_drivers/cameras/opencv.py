"""Cameras through OpenCV: a device by its index, a video file, or a series of images."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import cv2
from numpy.typing import NDArray

from eimi_drivers.cameras.image_series import ImageSeries, list_images, refuse_on_recording
from eimi_drivers.cameras.settings import NO_SETTINGS, CameraSettings
from eimi_drivers.interfaces import (
    EndOfPlayback,
    Frame,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    SetPointRefused,
)

CLOSE_WITHIN_S = 2.0
DEVICES = Path("/dev")
"""Where Linux keeps its cameras' device nodes."""


V4L2 = "V4L2"
V4L2_EXPOSURES_PER_S = 1e4
"""V4L2 counts exposure in units of 100 µs; the backends of Windows in powers of two of a second."""
POWERS_OF_TWO = frozenset({"DSHOW", "MSMF"})
V4L2_MANUAL_EXPOSURE = 1
WINDOWS_MANUAL_EXPOSURE = 0.25
GREY_16 = cv2.VideoWriter.fourcc(*"Y16 ")


class _Source(Protocol):
    def set_up(self, settings: CameraSettings) -> CameraSettings: ...

    def read(self) -> tuple[NDArray[Any], float]: ...

    def release(self) -> None: ...


class _Capture:
    """A device, by its index, or a video file of OpenCV."""

    def __init__(self, source: str | int) -> None:
        self._is_device = isinstance(source, int)
        self._name = f"camera {source}" if self._is_device else source
        node = DEVICES / f"video{source}"
        self._node = node if self._is_device and node.exists() else None
        self._capture = cv2.VideoCapture(source)
        self._count = 0
        if not self._capture.isOpened():
            raise InstrumentDisconnected(f"{self._name}: cannot be opened")

    def set_up(self, settings: CameraSettings) -> CameraSettings:
        """Set a device's settings and read them back."""
        if not self._is_device:
            refuse_on_recording(str(self._name), settings)
            return NO_SETTINGS
        capture, found = self._capture, NO_SETTINGS
        if settings.bit_depth is not None:  # first: it may choose another mode of the device
            found = replace(found, bit_depth=self._set_bit_depth(settings.bit_depth))
        if settings.exposure_s is not None:
            found = replace(found, exposure_s=self._set_exposure(settings.exposure_s))
        if settings.gain is not None:
            capture.set(cv2.CAP_PROP_GAIN, settings.gain)
            found = replace(found, gain=capture.get(cv2.CAP_PROP_GAIN))
        if settings.gamma is not None:
            capture.set(cv2.CAP_PROP_GAMMA, settings.gamma)
            found = replace(found, gamma=capture.get(cv2.CAP_PROP_GAMMA))
        return found

    def _set_bit_depth(self, depth: int) -> int:
        if depth not in (8, 16):
            raise SetPointRefused(f"{self._name}: bit_depth = {depth} must be 8 or 16")
        if depth == 16:
            self._capture.set(cv2.CAP_PROP_FOURCC, GREY_16)
            self._capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        return 16 if int(self._capture.get(cv2.CAP_PROP_FOURCC)) == GREY_16 else 8

    def _set_exposure(self, exposure_s: float) -> float:
        capture, backend = self._capture, self._capture.getBackendName()
        if not exposure_s > 0:
            raise SetPointRefused(f"{self._name}: exposure_s = {exposure_s} must be greater than 0")
        if backend == V4L2:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, V4L2_MANUAL_EXPOSURE)
            capture.set(cv2.CAP_PROP_EXPOSURE, round(exposure_s * V4L2_EXPOSURES_PER_S))
            return float(capture.get(cv2.CAP_PROP_EXPOSURE)) / V4L2_EXPOSURES_PER_S
        if backend in POWERS_OF_TWO:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, WINDOWS_MANUAL_EXPOSURE)
            capture.set(cv2.CAP_PROP_EXPOSURE, round(math.log2(exposure_s)))
            return float(2.0 ** capture.get(cv2.CAP_PROP_EXPOSURE))
        raise InstrumentError(f"{self._name}: the unit of exposure is not known for OpenCV's backend {backend}")

    def read(self) -> tuple[NDArray[Any], float]:
        success, image = self._capture.read()
        # OpenCV may go on reporting success after a camera is unplugged; its device node does go.
        if not success or (self._node and not self._node.exists()):
            end = "no more frames: unplugged?" if self._is_device else f"end of playback after {self._count} frames"
            raise (InstrumentDisconnected if self._is_device else EndOfPlayback)(f"{self._name}: {end}")
        self._count += 1
        if self._is_device:
            return image, self._stamp() or time.monotonic()
        return image, self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0

    def _stamp(self) -> float:
        """The kernel's own time stamp of the frame, on the clock of time.monotonic, s; 0 where there is none."""
        if self._capture.getBackendName() != V4L2:
            return 0.0
        return max(self._capture.get(cv2.CAP_PROP_POS_MSEC), 0.0) / 1000.0

    def release(self) -> None:
        self._capture.release()


class OpenCVCamera:
    """A camera that a thread of its own reads, since OpenCV's read blocks for as long as the device likes.

    source: a device index (`0` or `"0"`), a video file, a folder of images, or a pattern such as
    `f_%03d.png`.

    settings: set before the first frame. `region` is cut out of every image, of a recording's too; the others
    are the device's. Afterwards `settings` holds what was read back.

    Of a device only the newest frame is kept: no stale frame waits in a buffer, and `Frame.number` counts
    those that were passed over. A frame that the device had ready before a `flush`, by its time stamp or
    because it was being read, is stale and passed over as well. A recording waits: every frame is handed out,
    in order, and `flush` leaves it alone. Time stamps are the host's monotonic clock for a device (the
    kernel's stamp on V4L2), the file's own for a video, and the place in the series for images.
    """

    name = "opencv"

    def __init__(self, source: str | int, settings: CameraSettings = NO_SETTINGS) -> None:
        """Open the source and set it up.

        Raises InstrumentDisconnected when it cannot be opened, InstrumentError for a setting that it does not
        have, SetPointRefused and SetPointNotTaken for one that it does not take.
        """
        self.source = str(source)
        self._live = self.source.isdecimal()
        self._input = self._open()
        try:
            self.settings = self._set_up(settings)
        except InstrumentError:
            self._input.release()
            raise
        self._changed = threading.Condition()
        self._newest: Frame | None = None
        self._failure: InstrumentError | None = None
        self._flushes = 0
        self._flushed_s = -math.inf
        self._closing = False
        self._reader = threading.Thread(target=self._read_frames, name=f"camera {self.source}", daemon=True)
        self._reader.start()

    def _open(self) -> _Source:
        if self._live:
            return _Capture(int(self.source))
        if images := list_images(self.source):
            return ImageSeries(images)
        if Path(self.source).is_file():
            return _Capture(self.source)
        raise InstrumentDisconnected(
            f"{self.source}: must be a device index, a video file, a folder of images, or a pattern "
            "such as frames/f_%03d.png that matches a file"
        )

    def _set_up(self, settings: CameraSettings) -> CameraSettings:
        if (
            settings.region is not None
            and min(*settings.region[:2], settings.region[2] - 1, settings.region[3] - 1) < 0
        ):
            raise SetPointRefused(
                f"{self.source}: region = {settings.region} must be left, top, width, height in pixels"
            )
        found = replace(self._input.set_up(replace(settings, region=None)), region=settings.region)
        settings.verify(self.source, found)
        return found

    def identify(self) -> Identity:
        """What plays the camera."""
        text = f"{type(self._input).__name__.strip('_')} of OpenCV {cv2.__version__}"
        return Identity(driver=self.name, text=text, address=self.source)

    def flush(self) -> None:
        """Throw away frames of a device whose exposure may have begun before this call."""
        if self._live:
            with self._changed:
                self._newest = None
                self._flushes += 1
                self._flushed_s = time.monotonic()

    def grab(self, timeout_s: float) -> Frame:
        """The next frame.

        Raises InstrumentTimeout after `timeout_s`, InstrumentDisconnected when the device is gone or the
        recording is at its end, ReplyNotUnderstood for an image file that cannot be read.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest or self._failure or self._closing, timeout_s)
            frame, self._newest = self._newest, None
            self._changed.notify_all()
            if self._closing:
                raise InstrumentDisconnected(f"{self.source}: the camera was closed")
            if frame is not None:
                return frame
            if self._failure is not None:
                raise type(self._failure)(str(self._failure)) from self._failure
            raise InstrumentTimeout(f"{self.source}: no frame within {timeout_s:g} s")

    def close(self) -> None:
        """Release the device; one whose read hangs is released by its thread as soon as the read returns."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._reader.join(CLOSE_WITHIN_S)

    def _read_frames(self) -> None:
        number = 0
        try:
            while self._wait_for_room():
                flushes = self._flushes
                image, time_s = self._input.read()
                image = self._cut(image)
                with self._changed:
                    # A stale frame was read, or was ready in the device's buffer, before the flush.
                    if flushes == self._flushes and not (self._live and time_s < self._flushed_s):
                        self._newest = Frame(image=image, number=number, timestamp_s=time_s)
                        self._changed.notify_all()
                number += 1
        except InstrumentError as error:
            self._fail(error)
        except cv2.error as error:
            self._fail(InstrumentDisconnected(f"{self.source}: {error}"))
        finally:
            self._input.release()

    def _cut(self, image: NDArray[Any]) -> NDArray[Any]:
        if self.settings.region is None:
            return image
        left, top, width, height = self.settings.region
        part = image[top : top + height, left : left + width]
        if part.shape[:2] != (height, width):
            raise SetPointRefused(
                f"{self.source}: region = {self.settings.region} does not fit into images of "
                f"{image.shape[1]} x {image.shape[0]} pixels"
            )
        return part

    def _fail(self, failure: InstrumentError) -> None:
        with self._changed:
            self._failure = failure
            self._changed.notify_all()

    def _wait_for_room(self) -> bool:
        with self._changed:
            if not self._live:
                self._changed.wait_for(lambda: self._newest is None or self._closing)
            return not self._closing
