"""Define the settings of a camera and compare them with the values that the camera reads back."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from eimi_drivers.interfaces import SetPointNotTaken, UnusableDriver

WITHIN = 0.02
"""Largest relative difference between a setting and its read-back; cameras round exposure, gain and gamma."""


@dataclass(frozen=True)
class CameraSettings:
    """Hold the settings of a camera; None leaves a setting unchanged.

    Parameters
    ----------
    exposure_s : float, optional
        Exposure time, s.
    gain : float, optional
        Gain, in dB on Basler cameras and in the device's unit with OpenCV.
    gamma : float, optional
        Gamma, the exponent on Basler cameras and in the device's unit with OpenCV.
    region : tuple of int, optional
        Left, top, width and height of the part of the image to use, px.
    bit_depth : int, optional
        Number of bits of a grey value.
    frame_rate_Hz : float, optional
        Frames per second of a camera that runs freely. If it is set, the camera exposes at this rate, and `grab`
        returns its frames one after the other. If it is None, the driver chooses when the camera exposes.
    pixel_format : str, optional
        Pixel format of a GenICam camera by its name there, such as "Mono8", "Mono12Packed" or "BayerRG8".
    trigger : str, optional
        "software", or the name of the camera's input that triggers an exposure, such as "Line1". None is "software",
        unless a frame rate is set.
    row_time_s : float, optional
        Time between the exposures of two neighbouring rows of a rolling shutter, s, as the camera states it; 0 for a
        global shutter. It cannot be set: it is None in a request, and in the answer of a camera that does not state it.
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
        """Return the settings that are not None, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def verify(self, camera: str, answered: CameraSettings) -> None:
        """Compare the settings with the values that `camera` read back. Raises SetPointNotTaken if any differ."""
        read_back = asdict(answered)
        wrong = [
            f"{name} was set to {value} but reads back {read_back[name]}"
            for name, value in self.chosen().items()
            if not _same(value, read_back[name])
        ]
        if wrong:
            raise SetPointNotTaken(f"{camera}: {'; '.join(wrong)}")


SOFTWARE = "software"
"""The trigger of a camera that exposes on request; GenICam calls this source "Software"."""

NO_SETTINGS = CameraSettings()
"""Leave every setting of the camera unchanged."""


def settings_of(camera: object) -> CameraSettings:
    """Return the settings that a camera read back when it was opened; `NO_SETTINGS` if it has no such attribute.

    Raises UnusableDriver if the attribute `settings` is not a `CameraSettings`.
    """
    settings = getattr(camera, "settings", NO_SETTINGS)
    if not isinstance(settings, CameraSettings):
        raise UnusableDriver(f"the settings of a camera should be CameraSettings, not {settings!r}")
    return settings


def _same(requested: Any, read_back: Any) -> bool:
    if isinstance(requested, float) and read_back is not None:
        return math.isclose(requested, read_back, rel_tol=WITHIN, abs_tol=1e-9)
    return bool(requested == read_back)
