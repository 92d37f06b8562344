"""What can be set on a camera, and whether it took."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from eimi_drivers.interfaces import SetPointNotTaken, UnusableDriver

WITHIN = 0.02
"""Cameras round exposure, gain and gamma to steps of their own; further off than this part is not taken."""


@dataclass(frozen=True)
class CameraSettings:
    """Settings of a camera; None leaves one as it is.

    exposure_s: seconds. gain: dB on Basler cameras, the device's own unit through OpenCV. gamma: the exponent
    on Basler cameras, the device's own unit through OpenCV. region: left, top, width, height of the part of
    the image to use, pixels. bit_depth: bits of a grey value.
    """

    exposure_s: float | None = None
    gain: float | None = None
    gamma: float | None = None
    region: tuple[int, int, int, int] | None = None
    bit_depth: int | None = None

    def chosen(self) -> dict[str, Any]:
        """Those that are not None, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def verify(self, camera: str, found: CameraSettings) -> None:
        """Compare with what `camera` reads back. Raises SetPointNotTaken naming every setting that differs."""
        read_back = asdict(found)
        wrong = [
            f"{name} was set to {value} but reads back {read_back[name]}"
            for name, value in self.chosen().items()
            if not _same(value, read_back[name])
        ]
        if wrong:
            raise SetPointNotTaken(f"{camera}: {'; '.join(wrong)}")


NO_SETTINGS = CameraSettings()
"""Everything stays as it is."""


def settings_of(camera: object) -> CameraSettings:
    """Return the settings that a camera read back when it was opened; none if it keeps no `settings`.

    Raises UnusableDriver if its `settings` are something else.
    """
    settings = getattr(camera, "settings", NO_SETTINGS)
    if not isinstance(settings, CameraSettings):
        raise UnusableDriver(f"the settings of a camera should be CameraSettings, not {settings!r}")
    return settings


def _same(asked: Any, found: Any) -> bool:
    if isinstance(asked, float) and found is not None:
        return math.isclose(asked, found, rel_tol=WITHIN, abs_tol=1e-9)
    return bool(asked == found)
