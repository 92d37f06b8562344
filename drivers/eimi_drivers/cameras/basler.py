"""Read the frames of Basler cameras with pypylon, triggered by software or at a frame rate."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from eimi_drivers.cameras.pixel_formats import decode, depth_of
from eimi_drivers.cameras.rolling_shutter import READOUT_FEATURE, SHUTTER_FEATURES, row_time_s
from eimi_drivers.cameras.settings import FRAMES_ON_THE_WAY, NO_SETTINGS, SOFTWARE, CameraSettings
from eimi_drivers.interfaces import (
    Frame,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    SetPointRefused,
)

EXPOSURE_NODES = ("ExposureTime", "ExposureTimeAbs")
GAIN_NODES = ("Gain",)
FRAME_RATE_NODES = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
RESULTING_RATE_NODES = ("BslResultingAcquisitionFrameRate", "ResultingFrameRate", "ResultingFrameRateAbs")
"""GenICam features that contain the frame rate that the camera reaches with its exposure, region and bandwidth."""

PIXEL_FORMATS = {8: "Mono8", 10: "Mono10", 12: "Mono12", 16: "Mono16"}
USB_TICKS_PER_S = 1e9
BUFFERS = 32
"""Number of frames that pypylon stores while the program does something else and the camera continues to expose."""


class BaslerCamera:
    """A Basler camera that is controlled with pypylon.

    With a frame rate in the settings, the camera exposes at this rate. Otherwise each call of `grab` triggers an
    exposure.

    Parameters
    ----------
    source : str or int
        The serial number, or the index in the list of attached cameras, from 0.
    settings : CameraSettings, optional
        The settings that are applied before the first frame.
    """

    name = "basler"

    def __init__(self, source: str | int, settings: CameraSettings = NO_SETTINGS) -> None:
        """Open the camera, apply the settings, and start the acquisition.

        Raises
        ------
        InstrumentDisconnected
            No attached camera has this serial number or index.
        SetPointRefused
            The camera does not permit the value of a setting.
        SetPointNotTaken
            A value that was read back differs from the requested value.
        InstrumentError
            pypylon is not installed, or the camera reports an error.
        """
        try:
            from pypylon import genicam, pylon
        except ImportError as error:
            raise InstrumentError("Basler cameras need pypylon: pip install 'eimi-lab[basler]'") from error
        self.source = str(source)
        self._pylon = pylon
        self._errors = genicam.GenericException
        self._out_of_range = genicam.OutOfRangeException
        self._readable = genicam.IsReadable
        with self._errors_named():
            self._camera = pylon.InstantCamera(self._find(pylon.TlFactory.GetInstance()))
            self._camera.Open()
        try:
            with self._errors_named():
                self._triggered, self._to_skip = settings.frame_rate_Hz is None, 0
                self.settings = self._set_up(settings)
                self._ticks_per_s = self._tick_frequency()
                self._camera.MaxNumBuffer.Value = BUFFERS
                self._camera.StartGrabbing(pylon.GrabStrategy_OneByOne)
        except InstrumentError:
            self.close()
            raise

    def _find(self, factory: Any) -> Any:
        devices = list(factory.EnumerateDevices())
        for place, device in enumerate(devices):
            if self.source in {str(place), device.GetSerialNumber()}:
                return factory.CreateDevice(device)
        attached = ", ".join(device.GetSerialNumber() for device in devices) or "none"
        raise InstrumentDisconnected(f"Basler camera {self.source}: not found; attached Basler cameras: {attached}")

    @contextmanager
    def _errors_named(self) -> Iterator[None]:
        try:
            yield
        except self._errors as error:
            kind = InstrumentDisconnected if self._removed() else InstrumentError
            raise kind(f"Basler camera {self.source}: {str(error).strip()}") from error

    def _removed(self) -> bool:
        return hasattr(self, "_camera") and bool(self._camera.IsCameraDeviceRemoved())

    def _set_up(self, settings: CameraSettings) -> CameraSettings:
        try:
            self._set(settings)
        except self._out_of_range as error:
            raise SetPointRefused(f"Basler camera {self.source}: {str(error).strip()}") from error
        read_back = self._read_back()
        settings.verify(f"Basler camera {self.source}", read_back)
        self._camera.TriggerSelector.Value = "FrameStart"
        self._camera.TriggerSource.Value = "Software"
        self._camera.TriggerMode.Value = "On" if settings.frame_rate_Hz is None else "Off"
        return read_back

    def _set(self, settings: CameraSettings) -> None:
        camera = self._camera
        if settings.bit_depth is not None:
            if settings.bit_depth not in PIXEL_FORMATS:
                raise SetPointRefused(
                    f"Basler camera {self.source}: bit_depth = {settings.bit_depth} must be one of "
                    f"{', '.join(map(str, PIXEL_FORMATS))}"
                )
            camera.PixelFormat.Value = PIXEL_FORMATS[settings.bit_depth]
        if settings.pixel_format is not None:
            camera.PixelFormat.Value = settings.pixel_format
        if settings.trigger not in (None, SOFTWARE):
            raise SetPointRefused(
                f"Basler camera {self.source}: trigger = {settings.trigger!r} must be {SOFTWARE!r}; for a trigger "
                "input, use driver = 'aravis'"
            )
        if settings.region is not None:
            self._set_region(*settings.region)
        if settings.exposure_s is not None:
            self._node(EXPOSURE_NODES).Value = settings.exposure_s * 1e6
        if settings.gain is not None:
            self._node(GAIN_NODES).Value = settings.gain
        if settings.gamma is not None:
            camera.Gamma.Value = settings.gamma
        if settings.frame_rate_Hz is not None:
            if self._readable(camera.AcquisitionFrameRateEnable):  # some cameras have a frame rate but not this switch
                camera.AcquisitionFrameRateEnable.Value = True
            self._node(FRAME_RATE_NODES).Value = settings.frame_rate_Hz

    def _set_region(self, left: int, top: int, width: int, height: int) -> None:
        camera = self._camera
        camera.OffsetX.Value = camera.OffsetY.Value = 0  # with another offset the size may not fit
        camera.Width.Value, camera.Height.Value = width, height
        camera.OffsetX.Value, camera.OffsetY.Value = left, top

    def _node(self, names: tuple[str, ...]) -> Any:
        node = self._first_readable(names)
        if node is None:
            raise InstrumentError(f"Basler camera {self.source}: the camera has no {' or '.join(names)}")
        return node

    def _first_readable(self, names: tuple[str, ...]) -> Any:
        nodes = (getattr(self._camera, name) for name in names)
        return next((node for node in nodes if self._readable(node)), None)

    def _read_back(self) -> CameraSettings:
        camera = self._camera
        pixel_format = camera.PixelFormat.Value
        return CameraSettings(
            exposure_s=self._node(EXPOSURE_NODES).Value / 1e6,
            gain=float(camera.Gain.Value) if self._readable(camera.Gain) else None,
            gamma=float(camera.Gamma.Value) if self._readable(camera.Gamma) else None,
            region=(camera.OffsetX.Value, camera.OffsetY.Value, camera.Width.Value, camera.Height.Value),
            bit_depth=depth_of(pixel_format),
            pixel_format=pixel_format,
            frame_rate_Hz=None if self._triggered else float(self._node(RESULTING_RATE_NODES + FRAME_RATE_NODES).Value),
            trigger=SOFTWARE if self._triggered else None,
            row_time_s=self._row_time_s(),
        )

    def _row_time_s(self) -> float | None:
        shutter = self._first_readable(SHUTTER_FEATURES)
        if shutter is None:
            return None
        readout = self._first_readable((READOUT_FEATURE,))
        return row_time_s(shutter.Value, readout and readout.Value, self._camera.Height.Value)

    def _tick_frequency(self) -> float:
        node = self._camera.GevTimestampTickFrequency
        return float(node.Value) if self._readable(node) else USB_TICKS_PER_S

    def identify(self) -> Identity:
        """Return the model and serial number of the camera."""
        info = self._camera.GetDeviceInfo()
        return Identity(self.name, f"{info.GetModelName()} {info.GetSerialNumber()}", self.source)

    def flush(self) -> None:
        """Discard the frames that were exposed before this call."""
        self._to_skip = 0 if self._triggered else FRAMES_ON_THE_WAY
        with self._errors_named():
            while self._camera.IsGrabbing():
                with self._camera.RetrieveResult(0, self._pylon.TimeoutHandling_Return) as result:
                    if not result.IsValid():
                        return

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame, after triggering its exposure if no frame rate is set.

        Raises
        ------
        InstrumentTimeout
            No frame arrived within `timeout_s` (s).
        InstrumentDisconnected
            The camera was unplugged or closed.
        InstrumentError
            The frame was not transferred completely.
        """
        if self._removed() or not self._camera.IsGrabbing():
            raise InstrumentDisconnected(f"Basler camera {self.source}: the camera was unplugged or closed")
        if self._triggered:
            self.flush()
        until_s = time.monotonic() + timeout_s
        timeout_ms = max(round(timeout_s * 1000), 1)
        with self._errors_named():
            if self._triggered:
                if not self._camera.WaitForFrameTriggerReady(timeout_ms, self._pylon.TimeoutHandling_Return):
                    raise self._no_frame(timeout_s)
                self._camera.ExecuteSoftwareTrigger()
            while self._to_skip and time.monotonic() < until_s:
                with self._camera.RetrieveResult(timeout_ms, self._pylon.TimeoutHandling_Return) as skipped:
                    self._to_skip -= skipped.IsValid()
                timeout_ms = max(round((until_s - time.monotonic()) * 1000), 1)
            with self._camera.RetrieveResult(timeout_ms, self._pylon.TimeoutHandling_Return) as result:
                if not result.IsValid():
                    raise self._no_frame(timeout_s)
                if not result.GrabSucceeded():
                    raise InstrumentError(
                        f"Basler camera {self.source}: a frame was not transferred: "
                        f"{result.GetErrorDescription().strip()} ({result.GetErrorCode():#010x})"
                    )
                ticks = result.GetTimeStamp()
                return Frame(
                    image=decode(result.GetPixelType(), result.GetBuffer(), result.GetWidth(), result.GetHeight()),
                    number=int(result.GetBlockID()),
                    timestamp_s=ticks / self._ticks_per_s if ticks else time.monotonic(),
                )

    def _no_frame(self, timeout_s: float) -> InstrumentError:
        if self._removed():
            return InstrumentDisconnected(f"Basler camera {self.source}: the camera was unplugged")
        return InstrumentTimeout(
            f"Basler camera {self.source}: no frame within {timeout_s:g} s; check the trigger and the cable of the "
            "camera"
        )

    def close(self) -> None:
        """Stop the acquisition and release the camera. Closing twice is allowed."""
        with self._errors_named():
            self._camera.StopGrabbing()
            self._camera.Close()
