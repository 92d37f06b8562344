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
    """

    exposure_s: float | None = None
    gain: float | None = None
    gamma: float | None = None
    region: tuple[int, int, int, int] | None = None
    bit_depth: int | None = None

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
