"""Read cameras through the GenTL producer of their vendor, with the package harvesters. Needs the extra `gentl`."""

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
from eimi_drivers.cameras.settings import NO_SETTINGS, SOFTWARE, CameraSettings
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
"""The environment variable with the folders of the producers (GenTL standard 1.5, section 1.6.2)."""

BUFFERS = 32
FRAMES_ON_THE_WAY = 2
"""Frames that a freely running camera still delivers after a flush, and that are discarded as well.

At the flush, one of them is being transferred and one is being exposed.
"""

SHORTEST_S = 0.001
EXPOSURE_FEATURES = ("ExposureTime", "ExposureTimeAbs")
RATE_FEATURES = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
_IMAGE = 1
"""PAYLOAD_TYPE_IMAGE of GenTL."""


def producer_files() -> tuple[Path, ...]:
    """Return the GenTL producers (``*.cti``) in the folders that the environment variable lists."""
    folders = os.environ.get(PRODUCERS, "").split(os.pathsep)
    return tuple(file for folder in folders if folder for file in sorted(Path(folder).glob("*.cti")))


class GenTLCamera:
    """Control a camera through a GenTL producer.

    A camera that has a software trigger is triggered by every `grab`, unless a frame rate or a trigger input is set.
    Without a software trigger the camera runs freely, and `grab` returns its frames in order. harvesters discards
    incomplete frames; they leave a gap in the frame numbers, and `lost_frames` counts them.

    Parameters
    ----------
    source : str or int
        The serial number of the camera, or its identifier in the producer.
    settings : CameraSettings, optional
        Settings to apply before the first frame.

    Attributes
    ----------
    settings : CameraSettings
        The settings that were read back.
    lost_frames : Counter
        Number of frames that were exposed for a `grab` but did not arrive completely.
    """

    name = "gentl"

    def __init__(self, source: str | int, settings: CameraSettings = NO_SETTINGS) -> None:
        """Open the camera, apply the settings, and start the acquisition.

        Raises
        ------
        InstrumentDisconnected
            No camera of a producer has this serial number or identifier.
        SetPointRefused, SetPointNotTaken
            A setting is outside the camera's range, or differs when it is read back.
        InstrumentError
            harvesters is not installed, there is no producer, or the camera reports an error.
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
                f"there is no GenTL producer; install the vendor's, and set {PRODUCERS} to the folder of its *.cti file"
            )
        for file in files:
            self._producers.add_file(str(file))
        self._producers.update()
        devices = self._producers.device_info_list
        for device in devices:
            if self.source in (device.serial_number, device.id_):
                return device
        listed = ", ".join(f"{device.serial_number} ({device.model})" for device in devices) or "none"
        raise InstrumentDisconnected(f"no camera has this serial number; attached: {listed}")

    def _node(self, *names: str) -> Any:
        """Return the first of these features that the camera has and that can be read now, or None."""
        for name in names:
            if self._nodes.has_node(name) and self._api.is_readable(node := self._nodes.get_node(name)):
                return node
        return None

    def _set(self, key: str, value: object, number: object, *names: str) -> None:
        """Write a number to the first of these features that the camera has."""
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
        """Set the trigger or the frame rate; return the trigger source, or None if the camera runs freely."""
        mode, source = self._node("TriggerMode"), self._node("TriggerSource")
        if settings.frame_rate_Hz is not None:
            if mode:
                mode.value = "Off"
            if enable := self._node("AcquisitionFrameRateEnable"):
                enable.value = True
            self._set("frame_rate_Hz", settings.frame_rate_Hz, settings.frame_rate_Hz, *RATE_FEATURES)
            return None
        sources = source.symbolics if mode and source else ()
        asked = settings.trigger or SOFTWARE
        name = "Software" if asked == SOFTWARE else asked
        if name not in sources:
            if settings.trigger is None:
                return None  # the camera runs freely
            listed = ", ".join(SOFTWARE if offered == "Software" else offered for offered in sources) or "none"
            raise SetPointRefused(f"trigger = {asked!r} must be one of the sources of this camera: {listed}")
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
        """Return the vendor, model and serial number that the producer states."""
        return self._identity

    def flush(self) -> None:
        """Discard the frames that have arrived, because they were exposed before this call."""
        self._counting, self._to_skip = False, 0 if self.settings.trigger else FRAMES_ON_THE_WAY
        with self._errors_named():
            while not self._closed and (buffer := self._fetched(SHORTEST_S)) is not None:
                self._queue(buffer)

    def grab(self, timeout_s: float) -> Frame:
        """Return the next complete frame; if the camera is triggered by software, trigger it.

        Raises
        ------
        InstrumentTimeout
            No complete frame came within `timeout_s`.
        InstrumentDisconnected
            The camera was closed.
        ReplyNotUnderstood
            The size of the frame differs from that of the region, or the frame cannot be decoded.
        """
        if self._closed:
            raise InstrumentDisconnected(f"{self._label}: it was closed")
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
        raise InstrumentTimeout(f"{self._label}: no complete frame within {timeout_s:g} s")

    def _fetched(self, timeout_s: float) -> Any:
        """Return the next complete buffer, or None if no complete one arrives within `timeout_s`."""
        try:
            return self._acquirer.fetch(timeout=max(timeout_s, SHORTEST_S), is_raw=True)
        except self._timeout:
            return None

    @staticmethod
    def _queue(buffer: Any) -> None:
        buffer.parent.queue_buffer(buffer)

    def _taken(self, buffer: Any) -> Frame:
        if buffer.payload_type != _IMAGE:
            raise ReplyNotUnderstood(f"a frame has the payload type {buffer.payload_type}, not that of an image")
        number, size = int(buffer.frame_id), (int(buffer.width), int(buffer.height))
        if self.settings.region is not None and size != self.settings.region[2:]:
            raise ReplyNotUnderstood(
                f"frame {number} has {size[0]} x {size[1]} pixels, but the region is {self.settings.region}"
            )
        offset = 0
        with suppress(self._errors):  # a producer need not state the offset
            offset = int(buffer.image_offset)
        image = decode(int(buffer.pixel_format), memoryview(buffer.raw_buffer)[offset:], *size)
        stamp_s = time.monotonic()
        with suppress(self._errors):  # a producer need not have time stamps
            stamp_s = int(buffer.timestamp_ns) / 1e9
        if self._counting and self._last_number is not None:
            self.lost_frames += Counter({"no complete frame": number - self._last_number - 1})
        self._last_number, self._counting = number, True
        return Frame(image, number, stamp_s)

    def close(self) -> None:
        """Stop the acquisition and release the camera; closing twice is allowed."""
        if self._closed:
            return
        self._closed = True
        with suppress(self._errors, self._api.GenericException):
            if self._acquirer is not None:
                self._acquirer.stop()
                self._acquirer.destroy()
        with suppress(self._errors, self._api.GenericException):
            self._producers.reset()
