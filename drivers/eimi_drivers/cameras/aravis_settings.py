"""Write the settings of a camera with the library Aravis, and read them back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import byref, c_int
from dataclasses import replace

from eimi_drivers.cameras.aravis_library import Aravis
from eimi_drivers.cameras.pixel_formats import choose_format, depth_of
from eimi_drivers.cameras.rolling_shutter import READOUT_FEATURE, SHUTTER_FEATURES, row_time_s
from eimi_drivers.cameras.settings import SOFTWARE, CameraSettings
from eimi_drivers.interfaces import InstrumentError, SetPointRefused

RESULTING_RATES = ("ResultingFrameRate", "AcquisitionResultingFrameRate", "BslResultingAcquisitionFrameRate")
"""GenICam features that contain the frame rate that the camera reaches with its exposure, region and bandwidth."""

_CONTINUOUS, _AUTO_OFF, _CHECK_RANGES = 0, 0, 1
"""Values of ArvAcquisitionMode, ArvAuto (arvenums.h) and ArvRangeCheckPolicy (arvgcenums.h)."""


def set_up(aravis: Aravis, camera: int, settings: CameraSettings) -> CameraSettings:
    """Write the settings to an open camera and return the settings that are read back from the camera.

    Parameters
    ----------
    aravis : Aravis
        The library.
    camera : int
        The pointer to the camera in the library.
    settings : CameraSettings
        The requested settings.

    Raises
    ------
    SetPointRefused
        The camera does not permit the value of a setting.
    InstrumentDisconnected, InstrumentError
        The camera does not answer, or reports an error.
    """
    aravis.camera_set_range_check_policy(camera, _CHECK_RANGES)
    aravis.camera_set_acquisition_mode(camera, _CONTINUOUS)
    _set_pixel_format(aravis, camera, settings)
    if settings.region is not None:
        with _named("region", settings.region):
            aravis.camera_set_region(camera, *settings.region)
    if settings.exposure_s is not None:
        with _named("exposure_s", settings.exposure_s):
            if aravis.camera_is_exposure_auto_available(camera):
                aravis.camera_set_exposure_time_auto(camera, _AUTO_OFF)
            aravis.camera_set_exposure_time(camera, settings.exposure_s * 1e6)
    if settings.gain is not None:
        with _named("gain", settings.gain):
            if aravis.camera_is_gain_auto_available(camera):
                aravis.camera_set_gain_auto(camera, _AUTO_OFF)
            aravis.camera_set_gain(camera, settings.gain)
    if settings.gamma is not None:
        with _named("gamma", settings.gamma):
            aravis.camera_set_float(camera, b"Gamma", settings.gamma)
    trigger, frame_rate_Hz = _set_pace(aravis, camera, settings)
    return replace(_read_back(aravis, camera), trigger=trigger, frame_rate_Hz=frame_rate_Hz)


@contextmanager
def _named(key: str, value: object) -> Iterator[None]:
    """Put the name and the value of a setting before the message of an InstrumentError in the `with` block."""
    try:
        yield
    except InstrumentError as error:
        raise type(error)(f"{key} = {value}: {error}") from error


def _set_pixel_format(aravis: Aravis, camera: int, settings: CameraSettings) -> None:
    present = aravis.camera_get_pixel_format_as_string(camera).decode()
    offered = aravis.strings("camera_dup_available_pixel_formats_as_strings", camera)
    chosen = choose_format(settings.pixel_format, settings.bit_depth, present, offered)
    if chosen != present:
        aravis.camera_set_pixel_format_from_string(camera, chosen.encode())


def _set_pace(aravis: Aravis, camera: int, settings: CameraSettings) -> tuple[str | None, float | None]:
    """Set the trigger or the frame rate, and return the trigger source and the frame rate (Hz) that are read back.

    One of the two results is None.
    """
    if settings.frame_rate_Hz is not None:
        if settings.trigger is not None:
            raise SetPointRefused(
                f"trigger = {settings.trigger!r}: a triggered camera has no frame_rate_Hz; set only one of the two"
            )
        with _named("frame_rate_Hz", settings.frame_rate_Hz):
            aravis.camera_set_frame_rate(camera, settings.frame_rate_Hz)
        return None, _frame_rate_Hz(aravis, camera)
    trigger = settings.trigger or SOFTWARE
    source = "Software" if trigger == SOFTWARE else trigger
    offered = aravis.strings("camera_dup_available_trigger_sources", camera)
    if source not in offered:
        sources = ", ".join(SOFTWARE if name == "Software" else name for name in offered) or "none"
        raise SetPointRefused(f"trigger = {trigger!r} must be one of the trigger sources of this camera: {sources}")
    aravis.camera_set_trigger(camera, source.encode())
    answered = aravis.camera_get_trigger_source(camera).decode()
    return (SOFTWARE if answered == "Software" else answered), None


def _frame_rate_Hz(aravis: Aravis, camera: int) -> float:
    for name in RESULTING_RATES:
        if aravis.camera_is_feature_available(camera, name.encode()):
            return float(aravis.camera_get_float(camera, name.encode()))
    return float(aravis.camera_get_frame_rate(camera))


def _read_back(aravis: Aravis, camera: int) -> CameraSettings:
    left, top, width, height = (c_int() for _ in range(4))
    aravis.camera_get_region(camera, byref(left), byref(top), byref(width), byref(height))
    pixel_format = aravis.camera_get_pixel_format_as_string(camera).decode()
    has_exposure = aravis.camera_is_exposure_time_available(camera)
    return CameraSettings(
        exposure_s=aravis.camera_get_exposure_time(camera) / 1e6 if has_exposure else None,
        gain=aravis.camera_get_gain(camera) if aravis.camera_is_gain_available(camera) else None,
        gamma=_number(aravis, camera, "Gamma"),
        region=(left.value, top.value, width.value, height.value),
        bit_depth=depth_of(pixel_format),
        pixel_format=pixel_format,
        row_time_s=_row_time_s(aravis, camera, height.value),
    )


def _row_time_s(aravis: Aravis, camera: int, rows: int) -> float | None:
    for name in SHUTTER_FEATURES:
        if aravis.camera_is_feature_available(camera, name.encode()):
            shutter = aravis.camera_get_string(camera, name.encode()).decode()
            return row_time_s(shutter, _number(aravis, camera, READOUT_FEATURE), rows)
    return None


def _number(aravis: Aravis, camera: int, feature: str) -> float | None:
    if not aravis.camera_is_feature_available(camera, feature.encode()):
        return None
    return float(aravis.camera_get_float(camera, feature.encode()))
