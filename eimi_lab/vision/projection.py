"""Colour projected to one grey value, the same way for every picture of a dataset.

The projection is linear in the camera's colours or in CIELAB, and is chosen where inside and outside of the beam's root
differ most over all pictures: by Fisher's discriminant (R. A. Fisher, Annals of Eugenics 7 (1936) 179), or by one
channel alone where that is as good; or it is named by a person.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.calibration import Calibration, Picture
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.intensity import full_scale, grey

Array = NDArray[np.float64]

CAMERA, PERCEPTUAL = "camera", "CIELAB"
_CHANNELS = {"blue": (1.0, 0.0, 0.0), "green": (0.0, 1.0, 0.0), "red": (0.0, 0.0, 1.0), "grey": (0.114, 0.587, 0.299)}
_SHRINKAGE = 0.02  # of the mean variance, in every direction of colour: what samples so small cannot know
_ROUNDING = 1.0 / 12.0 / 255.0**2
_WORTH = 1.25  # by which a mixture has to be better than a plain channel, which a person understands at once
_CAUTIOUS = 20  # percentile of the separations, over both sides in all pictures


@dataclass(frozen=True)
class Projection:
    """A weight for each of three numbers of a pixel: blue, green, red, or L, a, b. name: how it was chosen.

    separation: of inside and outside, in standard deviations of either; 0 where nobody measured it.
    """

    name: str
    weights: tuple[float, float, float]
    space: str = CAMERA
    separation: float = 0.0

    def apply(self, image: ArrayLike) -> NDArray[np.float32]:
        """(H, W) of an image (H, W, 3), on the camera's own scale: 0 and full scale stay the ends. (H, W) stays."""
        pixels = np.asarray(image)
        if pixels.ndim != 3:
            return np.asarray(grey(pixels), dtype=np.float32)
        largest = full_scale(pixels)
        weights = np.array(self.weights) / np.abs(self.weights).sum()
        least = np.minimum(weights, 0.0).sum()
        share = _in_space(pixels / np.float32(largest), self.space) @ weights.astype(np.float32) - np.float32(least)
        return np.asarray(np.clip(share, 0.0, 1.0) * largest, dtype=np.float32)

    def to_json(self) -> str:
        """As a dataset keeps it."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Projection:
        """The inverse of `to_json`."""
        fields = json.loads(text)
        return cls(**{**fields, "weights": tuple(fields["weights"])})

    def __str__(self) -> str:
        if self.name in _CHANNELS:
            return self.name
        names = ("blue", "green", "red") if self.space == CAMERA else ("L", "a", "b")
        told = " ".join(f"{weight:+.2f} {name}" for weight, name in zip(self.weights, names, strict=True))
        return f"{self.name} ({told})"


def choose_projection(
    images: Iterable[NDArray[Any]], calibration: Calibration, width_mm: float, length_mm: float
) -> Projection:
    """The projection in which the beam's root and what is beside it differ most, over images (H, W, 3) of one dataset.

    What `calibration.picture` names goes before that.
    """
    named = calibration.picture or Picture()
    if named.channel is not None:
        return Projection(named.channel, _CHANNELS[named.channel])
    places = _Places(BeamFrame(calibration), width_mm, length_mm)
    samples: dict[str, list[_Sample]] = {CAMERA: [], PERCEPTUAL: []}
    for image in images:
        for space, known in samples.items():
            known += places.read(image, full_scale(image), space)
    best: Projection | None = None
    for space, known in samples.items():
        for candidate in _candidates(known, space, named.beam_colour) if known else ():
            if best is None or candidate.separation > _advantage(best, candidate) * best.separation:
                best = candidate
    return best or Projection("grey", _CHANNELS["grey"])


def _advantage(best: Projection, candidate: Projection) -> float:
    return _WORTH if best.name in _CHANNELS and candidate.name not in _CHANNELS else 1.0


@dataclass(frozen=True)
class _Sample:
    """Colours of one picture's root, scaled to 1: (n, 3) inside the beam and on either side of it."""

    inside: Array
    sides: tuple[Array, ...]


@dataclass(frozen=True)
class _Places:
    frame: BeamFrame
    width_mm: float
    length_mm: float

    def read(self, image: NDArray[Any], largest: float, space: str) -> list[_Sample]:
        """The colours at the root; nothing where that is not in the picture."""
        ahead = np.linspace(0.3, max(1.5, 0.2 * self.length_mm / self.width_mm), 15)
        inside = self._colours(image, largest, space, ahead, np.linspace(-0.25, 0.25, 7))
        sides = [self._colours(image, largest, space, ahead, aside * np.linspace(0.75, 1.25, 7)) for aside in (-1, 1)]
        there = tuple(side for side in sides if len(side) > 1)
        return [_Sample(inside, there)] if len(inside) > 1 and there else []

    def _colours(self, image: NDArray[Any], largest: float, space: str, ahead: Array, aside: Array) -> Array:
        along, across = np.meshgrid(ahead, aside)
        places = self.frame.to_px(self.width_mm * np.column_stack([along.ravel(), across.ravel()]))
        column, row = np.rint(places).astype(int).T
        seen = (column >= 0) & (row >= 0) & (column < image.shape[1]) & (row < image.shape[0])
        colours = image[row[seen], column[seen]][None] / np.float32(largest)
        return np.asarray(_in_space(colours, space)[0], dtype=np.float64) if seen.any() else np.zeros((0, 3))


def _candidates(samples: Sequence[_Sample], space: str, beam_colour: Sequence[float] | None) -> Iterable[Projection]:
    inside = [np.median(sample.inside, axis=0) for sample in samples]
    if beam_colour is not None:
        stated = np.array(beam_colour[::-1], dtype=np.float32)[None, None] / np.float32(255.0)
        inside = [_in_space(stated, space)[0, 0].astype(np.float64)] * len(samples)
    elif space == CAMERA:
        yield from (_measured(name, np.array(weights), space, samples) for name, weights in _CHANNELS.items())
    within = np.mean([np.cov(part.T) for sample in samples for part in (sample.inside, *sample.sides)], axis=0)
    within += (_SHRINKAGE * np.trace(within) / 3.0 + _ROUNDING) * np.eye(3)
    most = max(len(sample.sides) for sample in samples)
    for chosen in (
        [0],
        [most - 1],
        range(most),
    ):  # a frame on one side, a wall on the other: one may tell more than both
        outside = [
            np.mean([np.median(sample.sides[min(k, len(sample.sides) - 1)], axis=0) for k in chosen], axis=0)
            for sample in samples
        ]
        between = np.mean([a - b for a, b in zip(inside, outside, strict=True)], axis=0)
        weights = np.linalg.solve(within, between)
        if np.abs(weights).sum() > 0.0:
            name = "beam's colour" if beam_colour is not None else "discriminant"
            yield _measured(f"{name} in {space} colours", weights / np.abs(weights).sum(), space, samples)


def _measured(name: str, weights: Array, space: str, samples: Sequence[_Sample]) -> Projection:
    """The projection, and how far apart it puts inside and outside where that is least, nearly."""
    apart = []
    for sample in samples:
        inside = sample.inside @ weights
        for side in sample.sides:
            outside = side @ weights
            spread = np.hypot(inside.std(), outside.std()) + np.sqrt(_ROUNDING)
            apart.append(abs(np.median(inside) - np.median(outside)) / spread)
    first, second, third = weights.tolist()
    return Projection(name, (first, second, third), space, float(np.percentile(apart, _CAUTIOUS)))


def _in_space(colours: NDArray[Any], space: str) -> NDArray[np.float32]:
    """Colours (h, w, 3: blue, green, red) scaled to 1, as they are or as L, a and b, each about 0 to 1 too."""
    pixels = np.ascontiguousarray(colours, dtype=np.float32)
    if space == CAMERA:
        return pixels
    import cv2  # slow to load, and a fit of stored edges does without

    lab = cv2.cvtColor(pixels, cv2.COLOR_BGR2Lab)
    return np.asarray(lab / np.array([100.0, 255.0, 255.0]) + np.array([0.0, 0.5, 0.5]), dtype=np.float32)
