"""Read the frames of a camera device, a video file or a series of images with OpenCV."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
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
BUFFERS = 32
"""Number of frames that are stored while the program does something else and the camera exposes at a frame rate."""

DEVICES = Path("/dev")
"""The folder of the cameras' device nodes on Linux."""


V4L2 = "V4L2"
V4L2_EXPOSURES_PER_S = 1e4
"""Units of the exposure setting in one second: V4L2 uses units of 100 µs.

On Windows (`POWERS_OF_TWO`) the setting is the exponent n of an exposure time of 2^n s.
"""
POWERS_OF_TWO = frozenset({"DSHOW", "MSMF"})
V4L2_MANUAL_EXPOSURE = 1
WINDOWS_MANUAL_EXPOSURE = 0.25
GREY_16 = cv2.VideoWriter.fourcc(*"Y16 ")


class _Source(Protocol):
    def set_up(self, settings: CameraSettings) -> CameraSettings: ...

    def read(self) -> tuple[NDArray[Any], float]: ...

    def release(self) -> None: ...


class _Capture:
    """A camera device or a video file that OpenCV reads."""

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
        """Apply the settings to the camera device, and return the settings that are read back."""
        if not self._is_device:
            refuse_on_recording(str(self._name), settings)
            return NO_SETTINGS
        capture, read_back = self._capture, NO_SETTINGS
        if settings.bit_depth is not None:  # the first setting, because the bit depth may change the mode of the device
            read_back = replace(read_back, bit_depth=self._set_bit_depth(settings.bit_depth))
        if settings.exposure_s is not None:
            read_back = replace(read_back, exposure_s=self._set_exposure(settings.exposure_s))
        if settings.frame_rate_Hz is not None:
            read_back = replace(read_back, frame_rate_Hz=self._set_frame_rate(settings.frame_rate_Hz))
        if settings.gain is not None:
            capture.set(cv2.CAP_PROP_GAIN, settings.gain)
            read_back = replace(read_back, gain=capture.get(cv2.CAP_PROP_GAIN))
        if settings.gamma is not None:
            capture.set(cv2.CAP_PROP_GAMMA, settings.gamma)
            read_back = replace(read_back, gamma=capture.get(cv2.CAP_PROP_GAMMA))
        return read_back

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

    def _set_frame_rate(self, rate_Hz: float) -> float:
        if not rate_Hz > 0:
            raise SetPointRefused(f"{self._name}: frame_rate_Hz = {rate_Hz} must be greater than 0")
        self._capture.set(cv2.CAP_PROP_FPS, rate_Hz)
        return float(self._capture.get(cv2.CAP_PROP_FPS))

    def read(self) -> tuple[NDArray[Any], float]:
        success, image = self._capture.read()
        # OpenCV may still report success after a camera is unplugged, but its device node disappears.
        if not success or (self._node and not self._node.exists()):
            reason = (
                "the camera sends no more frames; is it unplugged?"
                if self._is_device
                else f"end of playback after {self._count} frames"
            )
            raise (InstrumentDisconnected if self._is_device else EndOfPlayback)(f"{self._name}: {reason}")
        self._count += 1
        if self._is_device:
            return image, self._stamp() or time.monotonic()
        return image, self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0

    def _stamp(self) -> float:
        """Return the time at which the Linux kernel received the last frame, s; 0 if the time is unknown."""
        if self._capture.getBackendName() != V4L2:
            return 0.0
        return max(self._capture.get(cv2.CAP_PROP_POS_MSEC), 0.0) / 1000.0

    def release(self) -> None:
        self._capture.release()


class OpenCVCamera:
    """A camera device, a video file or a series of images that OpenCV reads.

    Without a frame rate in the settings, `grab` returns the newest frame of a device. With a frame rate, `grab` returns
    the frames of a device in the order of their exposure. From a recording (video file or images), `grab` returns every
    frame in order.

    Parameters
    ----------
    source : str or int
        A device index (`0` or `"0"`), a video file, a folder of images, or a pattern such as `f_%03d.png`.
    settings : CameraSettings, optional
        The requested settings. A recording permits only `region`, the part that is cut out of every image.
    """

    name = "opencv"

    def __init__(self, source: str | int, settings: CameraSettings = NO_SETTINGS) -> None:
        """Open the source and apply the settings.

        Raises
        ------
        InstrumentDisconnected
            The source cannot be opened.
        SetPointRefused
            A value is not permitted.
        SetPointNotTaken
            A value that was read back differs from the requested value.
        InstrumentError
            The source does not have a requested setting.
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
        runs_freely = self._live and self.settings.frame_rate_Hz is not None
        self._waiting: deque[Frame] = deque(maxlen=BUFFERS if runs_freely else 1)
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
            f"{self.source}: the source of a camera must be a device index, a video file, a folder of images, or a "
            "pattern such as frames/f_%03d.png that matches a file"
        )

    def _set_up(self, settings: CameraSettings) -> CameraSettings:
        if (
            settings.region is not None
            and min(*settings.region[:2], settings.region[2] - 1, settings.region[3] - 1) < 0
        ):
            raise SetPointRefused(
                f"{self.source}: region = {settings.region} must be left, top, width, height in pixels"
            )
        read_back = replace(self._input.set_up(replace(settings, region=None)), region=settings.region)
        settings.verify(self.source, read_back)
        return read_back

    def identify(self) -> Identity:
        """Return the kind of source and the version of OpenCV."""
        text = f"{type(self._input).__name__.strip('_')} of OpenCV {cv2.__version__}"
        return Identity(driver=self.name, text=text, address=self.source)

    def flush(self) -> None:
        """Discard the frames of a device whose exposure may have begun before this call."""
        if self._live:
            with self._changed:
                self._waiting.clear()
                self._flushes += 1
                self._flushed_s = time.monotonic()

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame of the device or the recording.

        Raises
        ------
        InstrumentTimeout
            No frame arrived within `timeout_s` (s).
        InstrumentDisconnected
            The device was unplugged or the camera was closed.
        EndOfPlayback
            The recording has no further frame.
        ReplyNotUnderstood
            An image file cannot be read.
        SetPointRefused
            The region does not fit into the image.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._failure or self._closing, timeout_s)
            frame = self._waiting.popleft() if self._waiting else None
            self._changed.notify_all()
            if self._closing:
                raise InstrumentDisconnected(f"{self.source}: the camera was closed; open the camera again")
            if frame is not None:
                return frame
            if self._failure is not None:
                raise type(self._failure)(str(self._failure)) from self._failure
            raise InstrumentTimeout(f"{self.source}: no frame within {timeout_s:g} s; check the cable of the camera")

    def close(self) -> None:
        """Release the device. Closing twice is allowed."""
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
                    # Discard a frame that was read, or was waiting in the device's buffer, before the flush.
                    if flushes == self._flushes and not (self._live and time_s < self._flushed_s):
                        self._waiting.append(Frame(image=image, number=number, timestamp_s=time_s))
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
                self._changed.wait_for(lambda: not self._waiting or self._closing)
            return not self._closing
