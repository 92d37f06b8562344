"""The table [virtual.optics] of a rig file: back-light, lens and sensor of the simulated camera."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Optics:
    """The properties of back-light, lens and sensor of the virtual camera."""

    blur_px: float = 1.0
    """Standard deviation of the Gaussian point spread function."""
    full_well_e: float = 10_000.0
    """Number of electrons of a pixel at full scale, which determines the shot noise."""
    background: float = 0.85
    """Brightness of the back-light at its brightest point, as a fraction of full scale."""
    vignette: float = 0.15
    """Loss of light in the corners of the picture, as a fraction of the light in the middle."""
    gradient: float = 0.10
    """Loss of light from one corner of the picture to the opposite corner, as a fraction of the light in the brighter
    corner.
    """
    lumps: float = 0.0
    """Largest relative deviation of the back-light, which is brighter or darker in random areas with smooth borders."""
    silicone_transmission: float = 0.06
    """Fraction of the back-light that passes through the silicone."""
    magnet_transmission: float = 0.01
    """Fraction of the back-light that passes through the magnet."""
    clamp_transmission: float = 0.0
    """Fraction of the back-light that passes through the clamp."""
    bits: int = 8
    """Bit depth of the image, 8 to 16."""
    gamma: float = 1.0
    """Exponent: the camera stores the intensity of the light to the power 1/gamma. For measurements, give 1."""

    def __post_init__(self) -> None:
        shares = ("vignette", "gradient", "lumps", "silicone_transmission", "magnet_transmission")
        for name in (*shares, "clamp_transmission"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(f"{name} = {getattr(self, name)} should be at least 0 and below 1")
        for name in ("full_well_e", "background", "gamma"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)} should be above 0")
        if not self.blur_px >= 0.0:
            raise ValueError(f"blur_px = {self.blur_px} should be 0 or more")
        if not 8 <= self.bits <= 16:
            raise ValueError(f"bits = {self.bits} should be from 8 to 16")
