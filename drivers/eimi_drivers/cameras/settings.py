"""Define the settings of a camera, and compare requested settings with the values read back from the camera."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from eimi_drivers.interfaces import SetPointNotTaken, UnusableDriver

WITHIN = 0.02
"""Largest permitted difference between a value read back and the requested value, divided by the larger value.

A difference is permitted because cameras round exposure, gain and gamma.
"""

FRAMES_ON_THE_WAY = 2
"""Number of frames that a freely running camera began before a flush and delivers after the flush.

During the flush one frame is being transferred and one frame is being exposed. The driver discards both frames.
"""


@dataclass(frozen=True)
class CameraSettings:
    """The settings of a camera, either requested or read back.

    None means that a setting is not requested, or that a setting was not read back.

    Parameters
    ----------
    exposure_s : float, optional
        Exposure time, s.
    gain : float, optional
        Gain: in dB for Basler cameras, in the unit of the device for OpenCV.
    gamma : float, optional
        Gamma: the exponent for Basler cameras, in the unit of the device for OpenCV.
    region : tuple of int, optional
        Left, top, width and height of the used part of the image, px.
    bit_depth : int, optional
        Number of bits of a grey value.
    frame_rate_Hz : float, optional
        Number of exposures per second.
    pixel_format : str, optional
        Name of the pixel format in GenICam, such as "Mono8", "Mono12Packed" or "BayerRG8".
    trigger : str, optional
        "software", or the name of the camera's input that triggers an exposure, such as "Line1".
    row_time_s : float, optional
        Time between the exposures of two neighbouring rows of a rolling shutter, s; 0 for a global shutter. This value
        cannot be set.
    """

    exposure_s: float | None = None
    gain: float | None = None
    gamma: float | None = None
    region: tuple[int, int, int, int] | None = None
    bit_depth: int | None = None
    frame_rate_Hz: float | None = None
    pixel_format: str | None = None
    trigger: str | None = None
    row_time_s: float | None = None

    def chosen(self) -> dict[str, Any]:
        """Return the settings that are not None as a dictionary of names and values."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def verify(self, camera: str, answered: CameraSettings) -> None:
        """Raise an error if the settings that were read back from a camera differ from these requested settings.

        Parameters
        ----------
        camera : str
            The name of the camera, for the message.
        answered : CameraSettings
            The settings that were read back.

        Raises
        ------
        SetPointNotTaken
            At least one setting differs.
        """
        read_back = asdict(answered)
        wrong = [
            f"{name} was set to {value} but reads back {read_back[name]}"
            for name, value in self.chosen().items()
            if not _same(value, read_back[name])
        ]
        if wrong:
            raise SetPointNotTaken(f"{camera}: {'; '.join(wrong)}")


SOFTWARE = "software"
"""The trigger of a camera that exposes when the program requests a frame; "Software" in GenICam."""

NO_SETTINGS = CameraSettings()
"""Settings that leave every setting of a camera unchanged."""


def settings_of(camera: object) -> CameraSettings:
    """Return the settings that were read back when the camera was opened; `NO_SETTINGS` if the camera stores none.

    Raises
    ------
    UnusableDriver
        The attribute `settings` of the camera is not a `CameraSettings`.
    """
    settings = getattr(camera, "settings", NO_SETTINGS)
    if not isinstance(settings, CameraSettings):
        raise UnusableDriver(f"the attribute settings of a camera should be a CameraSettings, not {settings!r}")
    return settings


def _same(requested: Any, read_back: Any) -> bool:
    if isinstance(requested, float) and read_back is not None:
        return math.isclose(requested, read_back, rel_tol=WITHIN, abs_tol=1e-9)
    return bool(requested == read_back)
