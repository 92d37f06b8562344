"""Read the frames of cameras through a GenTL producer, a library of the camera's maker.

This module uses the package harvesters.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from eimi_drivers.cameras.aravis_settings import RESULTING_RATES
from eimi_drivers.cameras.labelled import labelled
from eimi_drivers.cameras.pixel_formats import choose_format, decode, depth_of
from eimi_drivers.cameras.rolling_shutter import READOUT_FEATURE, SHUTTER_FEATURES, row_time_s
from eimi_drivers.cameras.settings import FRAMES_ON_THE_WAY, NO_SETTINGS, SOFTWARE, CameraSettings
from eimi_drivers.interfaces import (
    Frame,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    ReplyNotUnderstood,
    SetPointRefused,
)

PRODUCERS = "GENICAM_GENTL64_PATH"
"""The environment variable that lists the folders of the GenTL producers (GenTL standard 1.5, section 1.6.2)."""

BUFFERS = 32

SHORTEST_S = 0.001
EXPOSURE_FEATURES = ("ExposureTime", "ExposureTimeAbs")
RATE_FEATURES = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
_IMAGE = 1
"""The value of PAYLOAD_TYPE_IMAGE in GenTL: the buffer contains an image."""


def producer_files() -> tuple[Path, ...]:
    """Return the files (``*.cti``) of the GenTL producers, the camera makers' libraries.

    The environment variable ``GENICAM_GENTL64_PATH`` lists the folders.
    """
    folders = os.environ.get(PRODUCERS, "").split(os.pathsep)
    return tuple(file for folder in folders if folder for file in sorted(Path(folder).glob("*.cti")))


class GenTLCamera:
    """A camera that is controlled through a GenTL producer, a library of the camera's maker.

    With a frame rate in the settings, the camera exposes at this rate. With a trigger input, the camera exposes at each
    signal on this input. Otherwise each call of `grab` triggers an exposure, if the camera has a software trigger.

    Parameters
    ----------
    source : str or int
        The serial number of the camera, or the identifier that the producer gives to the camera.
    settings : CameraSettings, optional
        The settings that are applied before the first frame.

    Attributes
    ----------
    settings : CameraSettings
        The settings that were read back from the camera.
    lost_frames : Counter
        The number of frames that did not arrive completely, by reason.
    """

    name = "gentl"

    def __init__(self, source: str | int, settings: CameraSettings = NO_SETTINGS) -> None:
        """Open the camera, apply the settings, and start the acquisition.

        Raises
        ------
        InstrumentDisconnected
            No camera has this serial number or identifier.
        SetPointRefused
            The camera does not permit the value of a setting.
        SetPointNotTaken
            A value that was read back differs from the requested value.
        InstrumentError
            harvesters or a producer is not installed, or the camera reports an error.
        """
        self.source = str(source)
        self._label = f"camera {self.source}"
        try:
            from genicam import genapi, gentl
            from harvesters.core import Harvester
        except ImportError as error:
            raise InstrumentError(
                "cameras with a GenTL producer need harvesters: pip install 'eimi-lab[gentl]'"
            ) from error
        self._api, self._timeout, self._errors = genapi, gentl.TimeoutException, gentl.GenericException
        self._out_of_range = (genapi.OutOfRangeException, genapi.InvalidArgumentException)
        self.lost_frames: Counter[str] = Counter()
        self._last_number: int | None = None
        self._to_skip = 0
        self._counting = self._closed = False
        self._acquirer: Any = None
        self._producers = Harvester()
        try:
            with self._errors_named():
                device = self._find()
                self._acquirer = self._producers.create(device)
                self._acquirer.num_buffers = BUFFERS
                self._identity = Identity(
                    self.name,
                    f"{device.vendor} {device.model} {device.serial_number}",
                    self.source,
                    device.serial_number,
                )
                self._nodes = self._acquirer.remote_device.node_map
                self.settings = self._set_up(settings)
                settings.verify(self._label, self.settings)
                self._triggered = self.settings.trigger == SOFTWARE
                self._acquirer.start()
        except InstrumentError:
            self.close()
            raise

    @contextmanager
    def _errors_named(self) -> Iterator[None]:
        try:
            with labelled(self._label):
                yield
        except self._out_of_range as error:
            raise SetPointRefused(f"{self._label}: {' '.join(str(error).split())}") from error
        except (self._errors, self._api.GenericException) as error:
            raise InstrumentError(f"{self._label}: {' '.join(str(error).split())}") from error

    def _find(self) -> Any:
        files = producer_files()
        if not files:
            raise InstrumentError(
                "there is no GenTL producer; install the producer of the camera's maker, and set the environment "
                f"variable {PRODUCERS} to the folder of its *.cti file"
            )
        for file in files:
            self._producers.add_file(str(file))
        self._producers.update()
        devices = self._producers.device_info_list
        for device in devices:
            if self.source in (device.serial_number, device.id_):
                return device
        listed = ", ".join(f"{device.serial_number} ({device.model})" for device in devices) or "none"
        raise InstrumentDisconnected(f"no camera has this serial number; attached cameras: {listed}")

    def _node(self, *names: str) -> Any:
        """Return the first GenICam feature in `names` that can be read from the camera; None if there is none."""
        for name in names:
            if self._nodes.has_node(name) and self._api.is_readable(node := self._nodes.get_node(name)):
                return node
        return None

    def _set(self, key: str, value: object, number: object, *names: str) -> None:
        """Write a number to the first GenICam feature in `names` that the camera has.

        An error message contains `key` and `value`, the setting in the rig file.
        """
        node = self._node(*names)
        if node is None:
            raise SetPointRefused(f"{key} = {value}: this camera has no {' or '.join(names)}")
        try:
            node.value = number
        except (*self._out_of_range, self._api.AccessException) as error:
            raise SetPointRefused(f"{key} = {value}: {' '.join(str(error).split())}") from error

    def _set_up(self, settings: CameraSettings) -> CameraSettings:
        self._set_pixel_format(settings)
        if settings.region is not None:
            left, top, width, height = settings.region
            # Set the offsets to zero first, because a larger size may not fit with the old offsets.
            for name, number in (("OffsetX", 0), ("OffsetY", 0), ("Width", width), ("Height", height)):
                if number or self._node(name):
                    self._set("region", settings.region, number, name)
            for name, number in (("OffsetX", left), ("OffsetY", top)):
                if number:
                    self._set("region", settings.region, number, name)
        if settings.exposure_s is not None:
            self._switch_off("ExposureAuto")
            self._set("exposure_s", settings.exposure_s, settings.exposure_s * 1e6, *EXPOSURE_FEATURES)
        if settings.gain is not None:
            self._switch_off("GainAuto")
            self._set("gain", settings.gain, settings.gain, "Gain")
        if settings.gamma is not None:
            self._set("gamma", settings.gamma, settings.gamma, "Gamma")
        return self._read_back(self._set_pace(settings), settings.frame_rate_Hz is not None)

    def _switch_off(self, name: str) -> None:
        if node := self._node(name):
            node.value = "Off"

    def _set_pixel_format(self, settings: CameraSettings) -> None:
        node = self._node("PixelFormat")
        node.value = choose_format(settings.pixel_format, settings.bit_depth, node.value, node.symbolics)

    def _set_pace(self, settings: CameraSettings) -> str | None:
        """Set the trigger or the frame rate; return the trigger source, or None if the camera is not triggered."""
        mode, source = self._node("TriggerMode"), self._node("TriggerSource")
        if settings.frame_rate_Hz is not None:
            if mode:
                mode.value = "Off"
            if enable := self._node("AcquisitionFrameRateEnable"):
                enable.value = True
            self._set("frame_rate_Hz", settings.frame_rate_Hz, settings.frame_rate_Hz, *RATE_FEATURES)
            return None
        sources = source.symbolics if mode and source else ()
        requested = settings.trigger or SOFTWARE
        name = "Software" if requested == SOFTWARE else requested
        if name not in sources:
            if settings.trigger is None:
                return None  # the camera runs freely
            listed = ", ".join(SOFTWARE if offered == "Software" else offered for offered in sources) or "none"
            raise SetPointRefused(
                f"trigger = {requested!r} must be one of the trigger sources of this camera: {listed}"
            )
        if selector := self._node("TriggerSelector"):
            selector.value = "FrameStart"
        mode.value, source.value = "On", name
        return SOFTWARE if source.value == "Software" else str(source.value)

    def _read_back(self, trigger: str | None, has_rate: bool) -> CameraSettings:
        left, top, width, height = (
            int(node.value) if (node := self._node(name)) else 0 for name in ("OffsetX", "OffsetY", "Width", "Height")
        )
        pixel_format = str(self._nodes.PixelFormat.value)
        exposure, shutter = self._node(*EXPOSURE_FEATURES), self._node(*SHUTTER_FEATURES)
        rate, readout = self._node(*RESULTING_RATES, *RATE_FEATURES), self._node(READOUT_FEATURE)
        readout_us = float(readout.value) if readout else None
        return CameraSettings(
            exposure_s=float(exposure.value) / 1e6 if exposure else None,
            gain=float(node.value) if (node := self._node("Gain")) else None,
            gamma=float(node.value) if (node := self._node("Gamma")) else None,
            region=(left, top, width, height),
            bit_depth=depth_of(pixel_format),
            frame_rate_Hz=float(rate.value) if has_rate else None,
            pixel_format=pixel_format,
            trigger=trigger,
            row_time_s=row_time_s(shutter.value, readout_us, height) if shutter else None,
        )

    def identify(self) -> Identity:
        """Return the maker, model and serial number of the camera."""
        return self._identity

    def flush(self) -> None:
        """Discard the frames that were exposed before this call."""
        self._counting, self._to_skip = False, 0 if self.settings.trigger else FRAMES_ON_THE_WAY
        with self._errors_named():
            # At most BUFFERS frames from before this call are stored. A fast camera always has a newer frame, so that a
            # loop without this limit would not end.
            for _ in range(BUFFERS):
                if self._closed or (buffer := self._fetched(SHORTEST_S)) is None:
                    return
                self._queue(buffer)

    def grab(self, timeout_s: float) -> Frame:
        """Return the next complete frame, after triggering an exposure if the camera is triggered by software.

        Raises
        ------
        InstrumentTimeout
            No complete frame arrived within `timeout_s` (s).
        InstrumentDisconnected
            The camera was closed.
        ReplyNotUnderstood
            The size of the frame is wrong, or the pixel format cannot be decoded.
        """
        if self._closed:
            raise InstrumentDisconnected(f"{self._label}: the camera was closed; open the camera again")
        until_s = time.monotonic() + timeout_s
        with self._errors_named():
            if self._triggered:
                self.flush()
                self._counting = True
                self._nodes.TriggerSoftware.execute()
            while (left_s := until_s - time.monotonic()) > 0:
                buffer = self._fetched(left_s)
                if buffer is None:
                    continue
                try:
                    frame = self._taken(buffer)
                finally:
                    self._queue(buffer)
                if not self._to_skip:
                    return frame
                self._to_skip -= 1
        raise InstrumentTimeout(
            f"{self._label}: no complete frame within {timeout_s:g} s; check the trigger and the cable of the camera"
        )

    def _fetched(self, timeout_s: float) -> Any:
        """Return the next complete frame as a buffer; None if no complete frame arrives within `timeout_s` (s)."""
        try:
            return self._acquirer.fetch(timeout=max(timeout_s, SHORTEST_S), is_raw=True)
        except self._timeout:
            return None

    @staticmethod
    def _queue(buffer: Any) -> None:
        buffer.parent.queue_buffer(buffer)

    def _taken(self, buffer: Any) -> Frame:
        if buffer.payload_type != _IMAGE:
            raise ReplyNotUnderstood(
                f"a frame has the GenTL payload type {buffer.payload_type}; the type of an image is {_IMAGE}"
            )
        number, size = int(buffer.frame_id), (int(buffer.width), int(buffer.height))
        if self.settings.region is not None and size != self.settings.region[2:]:
            raise ReplyNotUnderstood(
                f"frame {number} has {size[0]} x {size[1]} pixels, but the region in the settings is "
                f"{self.settings.region} (left, top, width, height)"
            )
        offset = 0
        with suppress(self._errors):  # some producers do not report the offset
            offset = int(buffer.image_offset)
        image = decode(int(buffer.pixel_format), memoryview(buffer.raw_buffer)[offset:], *size)
        stamp_s = time.monotonic()
        with suppress(self._errors):  # some producers do not report time stamps
            stamp_s = int(buffer.timestamp_ns) / 1e9
        if self._counting and self._last_number is not None:
            self.lost_frames += Counter({"no complete frame": number - self._last_number - 1})
        self._last_number, self._counting = number, True
        return Frame(image, number, stamp_s)

    def close(self) -> None:
        """Stop the acquisition and release the camera. Closing twice is allowed."""
        if self._closed:
            return
        self._closed = True
        with suppress(self._errors, self._api.GenericException):
            if self._acquirer is not None:
                self._acquirer.stop()
                self._acquirer.destroy()
        with suppress(self._errors, self._api.GenericException):
            self._producers.reset()
