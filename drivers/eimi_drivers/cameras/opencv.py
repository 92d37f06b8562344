"""Cameras through OpenCV: a device by its index, a video file, or a series of images."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any, Protocol

import cv2
from numpy.typing import NDArray

from eimi_drivers.cameras.image_series import ImageSeries, list_images
from eimi_drivers.interfaces import (
    Frame,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
)

CLOSE_WITHIN_S = 2.0
DEVICES = Path("/dev")
"""Where Linux keeps its cameras' device nodes."""


class _Source(Protocol):
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

    def read(self) -> tuple[NDArray[Any], float]:
        success, image = self._capture.read()
        # OpenCV may go on reporting success after a camera is unplugged; its device node does go.
        if not success or (self._node and not self._node.exists()):
            end = "no more frames: unplugged?" if self._is_device else f"end of playback after {self._count} frames"
            raise InstrumentDisconnected(f"{self._name}: {end}")
        self._count += 1
        if self._is_device:
            return image, time.monotonic()
        return image, self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0

    def release(self) -> None:
        self._capture.release()


class OpenCVCamera:
    """A camera that a thread of its own reads, since OpenCV's read blocks for as long as the device likes.

    source: a device index (`0` or `"0"`), a video file, a folder of images, or a pattern such as
    `f_%03d.png`.

    Of a device only the newest frame is kept: no stale frame waits in a buffer, and `Frame.number` counts
    those that were passed over. A recording waits: every frame is handed out, in order, and `flush` leaves
    it alone. Time stamps are the host's monotonic clock for a device, the file's own for a video, and the
    place in the series for images.
    """

    name = "opencv"

    def __init__(self, source: str | int) -> None:
        self.source = str(source)
        self._live = self.source.isdecimal()
        self._input = self._open()
        self._changed = threading.Condition()
        self._newest: Frame | None = None
        self._failure: InstrumentError | None = None
        self._flushes = 0
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

    def grab(self, timeout_s: float) -> Frame:
        """The next frame.

        Raises InstrumentTimeout after `timeout_s`, InstrumentDisconnected when the device is gone or the
        recording is at its end, ReplyNotUnderstood for an image file that cannot be read.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest or self._failure or self._closing, timeout_s)
            frame, self._newest = self._newest, None
            self._changed.notify_all()
            if frame is not None:
                return frame
            if self._failure is not None:
                raise type(self._failure)(str(self._failure)) from self._failure
            if self._closing:
                raise InstrumentDisconnected(f"{self.source}: the camera was closed")
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
                with self._changed:
                    if flushes == self._flushes:  # else this read began before the flush
                        self._newest = Frame(image=image, number=number, timestamp_s=time_s)
                        self._changed.notify_all()
                number += 1
        except InstrumentError as error:
            self._fail(error)
        except cv2.error as error:
            self._fail(InstrumentDisconnected(f"{self.source}: {error}"))
        finally:
            self._input.release()

    def _fail(self, failure: InstrumentError) -> None:
        with self._changed:
            self._failure = failure
            self._changed.notify_all()

    def _wait_for_room(self) -> bool:
        with self._changed:
            if not self._live:
                self._changed.wait_for(lambda: self._newest is None or self._closing)
            return not self._closing
