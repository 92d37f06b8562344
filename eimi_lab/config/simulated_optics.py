"""[virtual.optics] of a rig: the back-light, lens and sensor of the virtual camera."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Optics:
    """Back-light, lens and sensor.

    blur_px: standard deviation of the Gaussian point spread. full_well_e: electrons at full scale.
    background: the brightest place of the back-light as a share of full scale. vignette: loss in the corners;
    gradient: loss from one corner to the opposite one; lumps: largest deviation of smooth irregular patches;
    all as shares of the light. Transmissions are shares of the light behind the body. bits: depth of the
    image, 8 to 16. gamma: the camera stores light to the power 1 / gamma; 1 is what measurements need.
    """

    blur_px: float = 1.0
    """Standard deviation of the point spread."""
    full_well_e: float = 10_000.0
    """Electrons at full scale: sets the shot noise."""
    background: float = 0.85
    """The brightest place of the back-light, as a share of full scale."""
    vignette: float = 0.15
    """Loss in the corners, as a share of the light."""
    gradient: float = 0.10
    """Loss from one corner to the opposite one."""
    lumps: float = 0.0
    """Largest deviation of smooth irregular patches."""
    silicone_transmission: float = 0.06
    """Share of the light behind the body."""
    magnet_transmission: float = 0.01
    """Share of the light behind the body."""
    clamp_transmission: float = 0.0
    """Share of the light behind the body."""
    bits: int = 8
    """Depth of the image, 8 to 16."""
    gamma: float = 1.0
    """The camera stores light to the power 1 / gamma; 1 is what measurements need."""

    def __post_init__(self) -> None:
        shares = ("vignette", "gradient", "lumps", "silicone_transmission", "magnet_transmission")
        for name in (*shares, "clamp_transmission"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be at least 0 and below 1")
        for name in ("full_well_e", "background", "gamma"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be positive")
        if not self.blur_px >= 0.0:
            raise ValueError(f"blur_px is {self.blur_px}; it must not be negative")
        if not 8 <= self.bits <= 16:
            raise ValueError(f"bits is {self.bits}; it must be 8 to 16")
