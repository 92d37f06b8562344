"""[virtual.optics] of a rig: the back-light, lens and sensor of the virtual camera."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Optics:
    """Back-light, lens and sensor of the virtual camera. The text below a field describes it."""

    blur_px: float = 1.0
    """Standard deviation of the Gaussian point spread function."""
    full_well_e: float = 10_000.0
    """Electrons at full scale; they determine the shot noise."""
    background: float = 0.85
    """Brightness of the back-light at its brightest point, as a fraction of full scale."""
    vignette: float = 0.15
    """Loss of light in the corners, as a fraction of the light."""
    gradient: float = 0.10
    """Loss of light from one corner to the opposite one, as a fraction of the light."""
    lumps: float = 0.0
    """Largest deviation of smooth irregular patches of the back-light, as a fraction of the light."""
    silicone_transmission: float = 0.06
    """Fraction of the back-light that passes through the silicone."""
    magnet_transmission: float = 0.01
    """Fraction of the back-light that passes through the magnet."""
    clamp_transmission: float = 0.0
    """Fraction of the back-light that passes through the clamp."""
    bits: int = 8
    """Bit depth of the image, 8 to 16."""
    gamma: float = 1.0
    """The camera stores the light to the power 1/gamma; measurements need 1."""

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
