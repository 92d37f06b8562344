"""Small pictures of a beam that is clamped at the top, for quick tests of the edge search."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile

Array = NDArray[np.float64]

SIZE = (112, 128)  # height and width, px
CLAMP = (60.0, 10.0)
CALIBRATION = Calibration(
    pixels_per_mm=7.0,
    coil_constant_mT_per_A=4.7,
    clamp_midpoint_px=CLAMP,
    axis_angle_deg=90.0,
    gravity_angle_deg=90.0,
    field_angle_deg=0.0,
)


def specimen(width_mm: object = 2.0, length_mm: float = 12.0, depth_mm: float = 4.0) -> SpecimenFile:
    """Return a specimen; its width may be a list of rows: distance from the clamp and width, mm."""
    beam = {"name": "bar", "material": "silicone", "length_mm": length_mm, "width_mm": width_mm, "depth_mm": depth_mm}
    return SpecimenFile.model_validate({"specimen": {**beam, "density_kg_m3": 1070.0}})


def edge(values: Array, blur_px: float = 0.8) -> Array:
    """Return 0 at negative and 1 at positive values, with a smooth transition."""
    return np.asarray(0.5 * (1.0 + np.tanh(values / blur_px)))


def within(values: Array, low: Array | float, high: Array | float, blur_px: float = 0.8) -> Array:
    return edge(values - low, blur_px) * edge(high - values, blur_px)


class SmallPicture:
    """A picture (blue, green, red) of a beam 14 px wide and 84 px long.

    along, aside : coordinates of each pixel along and across the beam (px)
    above_px : number of rows above the clamp
    """

    def __init__(
        self,
        bend: float = 0.0,
        ground: tuple[float, ...] = (150.0, 160.0, 130.0),
        slope: float = 0.0,
        length_px: float = 84.0,
        above_px: int = 0,
    ) -> None:
        size = (SIZE[0] + above_px, SIZE[1])
        self.y, self.x = np.mgrid[0 : size[0], 0 : size[1]].astype(float)
        self.along = self.y - CLAMP[1] - above_px
        middle = CLAMP[0] + bend * self.along**2 / length_px
        self.aside = (self.x - middle) / np.sqrt(1.0 + (2.0 * bend * self.along / length_px) ** 2)
        self.length_px = length_px
        self.light = 1.0 + slope * (self.x - 64.0) / 128.0
        self.colours = np.ones((*size, 1)) * np.array(ground)

    def add(self, share: Array, colour: tuple[float, ...]) -> SmallPicture:
        """Paint a colour over the picture with the opacity `share` (0 to 1) of each pixel."""
        self.colours = self.colours + share[..., None] * (np.array(colour) - self.colours)
        return self

    def dim(self, share: Array, by: float) -> SmallPicture:
        """Darken the picture by a factor, with the weight `share` (0 to 1) of each pixel."""
        self.colours = self.colours * (1.0 - (1.0 - by) * share[..., None])
        return self

    def beside(self, low_px: Array | float, high_px: Array | float, blur_px: float = 0.8) -> Array:
        """Return a value for each pixel: 1 between two distances from the centre line of the beam, 0 elsewhere."""
        return within(self.aside, low_px, high_px, blur_px) * within(self.along, 0.0, self.length_px)

    def beam(self, half_px: Array | float = 7.0, colour: tuple[float, ...] = (40.0, 60.0, 200.0)) -> SmallPicture:
        return self.add(self.beside(-half_px, half_px), colour)

    def exposed(self, noise: float = 1.5, seed: int = 1) -> NDArray[np.uint8]:
        """Return the picture with the noise of a camera."""
        light = self.colours * self.light[..., None]
        light = light + np.random.default_rng(seed).normal(0.0, noise, light.shape)
        return np.clip(np.rint(light), 0, 255).astype(np.uint8)
