"""A rendered bench: a beam of known shape in front of cloth, with objects behind, on and in front of the beam."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.virtual.raster import coverage
from eimi_lab.vision.beam_frame import BeamFrame
from tests.shared.rendered_edges import BentBeam

Array = NDArray[np.float64]
Image = NDArray[Any]
_APART = 70.0  # smallest distance of two colours that an eye distinguishes clearly


@dataclass(frozen=True)
class Scene:
    """A bench with a beam, from which a picture is rendered.

    size : width and height of the picture (px)
    beam : true outline
    calibration, specimen : true values
    own, behind : colours (blue, green, red, 0 to 255) of beam and background
    """

    rng: np.random.Generator
    size: tuple[int, int]
    calibration: Calibration
    specimen: SpecimenFile
    beam: BentBeam
    own: Array
    behind: Array

    @property
    def width_px(self) -> float:
        return self.specimen.specimen.width_mm * self.calibration.pixels_per_mm

    def outline(self, along: tuple[float, float] = (0.0, 1.0), across: tuple[float, float] = (-0.5, 0.5)) -> Array:
        """Return the outline of a part of the beam: n points (x, y) in px, shape (n, 2).

        along : start and end as shares of the length, 0 at the clamp
        across : both sides, in widths of the beam from the centre line
        """
        count = len(self.beam.left)
        first, last = (int(np.clip(round(share * (count - 1)), 0, count - 1)) for share in along)
        left, right = self.beam.left[first : last + 1], self.beam.right[first : last + 1]
        one, other = (left + (place + 0.5) * (right - left) for place in across)
        return BeamFrame(self.calibration).to_px(np.vstack([one, other[::-1]]))

    def paint(self, picture: Array, polygon: Array, colour: Array | float, share: float = 1.0) -> None:
        """Fill a polygon of n corners (x, y) in px, shape (n, 2), with one colour; change `picture` in place.

        share : opacity, from 0 to 1
        """
        picture += share * coverage(polygon, self.size)[..., None] * (np.asarray(colour) - picture)

    def box(self, ahead: tuple[float, float], aside: tuple[float, float]) -> Array:
        """Return the four corners (x, y) of a rectangle at the clamp in px, shape (4, 2).

        ahead, aside : smallest and largest distance along and across the axis, in widths of the beam
        """
        corners = [[a, b] for a, b in zip((*ahead, *ahead[::-1]), np.repeat(aside, 2), strict=True)]
        return BeamFrame(self.calibration).to_px(self.specimen.specimen.width_mm * np.array(corners))

    def other_colour(self) -> Array:
        """Return a random colour that differs clearly from beam and background."""
        return another_colour(self.rng, self.own, self.behind)


def another_colour(rng: np.random.Generator, *others: Array) -> Array:
    """Return a random colour (blue, green, red) that differs clearly from the colours `others`."""
    while True:
        colour = rng.uniform(25.0, 235.0, 3)
        if all(np.linalg.norm(colour - other) > _APART for other in others):
            return colour


def cloth(scene: Scene) -> Array:
    """Return a picture of cloth in uneven light, shape (height, width, 3)."""
    rng = np.random.default_rng(int(1e3 * scene.behind.sum()))  # a scene always gets the same cloth
    lumps = rng.uniform(-10.0, 10.0, (6, 8, 3)).astype(np.float32)
    grain = rng.standard_normal((scene.size[1], scene.size[0])).astype(np.float32)
    picture = cv2.resize(lumps, scene.size, interpolation=cv2.INTER_CUBIC).astype(np.float64)
    return np.asarray(picture + scene.behind + 8.0 * cv2.GaussianBlur(grain, (0, 0), 1.5)[..., None])


def through_jpeg(picture: Array, quality: int) -> Image:
    """Return a picture (height, width, 3), uint8, with the losses of a JPEG file of this quality (0 to 100)."""
    image = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    return cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)
