"""Choose weights that convert colours to grey values, so that the beam differs most from its surroundings.

The weights are a colour channel or Fisher's linear discriminant w = C⁻¹ (m_in - m_out), with the mean colours m_in of
the beam and m_out of its surroundings, and the covariance matrix C of the colours (R. A. Fisher, Annals of Eugenics 7
(1936) 179).
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
_SHRINKAGE = 0.02  # of the mean variance, added to every colour direction: the samples are small
_ROUNDING = 1.0 / 12.0 / 255.0**2  # variance of rounding to 8 bits, of colours scaled to 1
_WORTH = 1.25  # a mixture must separate this much better than a single channel, which is easier to understand
_CAUTIOUS = 20  # percentile of the separations over both sides in all pictures


@dataclass(frozen=True)
class Projection:
    """Weights that convert the three colour values of a pixel to one grey value.

    Attributes
    ----------
    name : str
        Name of a colour channel, or of the method that gave the weights.
    weights : tuple of float
        Weights of blue, green and red, or of L, a and b.
    space : {"camera", "CIELAB"}
        Colour space: blue, green, red of the camera, or L, a, b.
    separation : float
        Difference in grey value between beam and surroundings near the clamp, in standard deviations; 0 if unknown.

    Examples
    --------
    >>> red = Projection("red", (0.0, 0.0, 1.0))
    >>> red.apply(np.array([[[10, 20, 200]]], np.uint8)).tolist()
    [[200.0]]
    """

    name: str
    weights: tuple[float, float, float]
    space: str = CAMERA
    separation: float = 0.0

    def apply(self, image: ArrayLike) -> NDArray[np.float32]:
        """Return the weighted sums of an image's colours, shifted and scaled to values from 0 to full scale.

        Parameters
        ----------
        image : array_like, shape (rows, columns, 3) or (rows, columns)
            Blue, green, red; a grey image keeps its values.

        Returns
        -------
        ndarray of float32, shape (rows, columns)
            The grey values.
        """
        pixels = np.asarray(image)
        if pixels.ndim != 3:
            return np.asarray(grey(pixels), dtype=np.float32)
        largest = full_scale(pixels)
        weights = np.array(self.weights) / np.abs(self.weights).sum()
        least = np.minimum(weights, 0.0).sum()
        share = _in_space(pixels / np.float32(largest), self.space) @ weights.astype(np.float32) - np.float32(least)
        return np.asarray(np.clip(share, 0.0, 1.0) * largest, dtype=np.float32)

    def to_json(self) -> str:
        """Return the projection as JSON text."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Projection:
        """Return the projection that `to_json` has written as text."""
        fields = json.loads(text)
        return cls(**{**fields, "weights": tuple(fields["weights"])})

    def __str__(self) -> str:
        if self.name in _CHANNELS:
            return self.name
        names = ("blue", "green", "red") if self.space == CAMERA else ("L", "a", "b")
        mixture = " ".join(f"{weight:+.2f} {name}" for weight, name in zip(self.weights, names, strict=True))
        return f"{self.name} ({mixture})"


def choose_projection(
    images: Iterable[NDArray[Any]], calibration: Calibration, width_mm: float, length_mm: float
) -> Projection:
    """Choose weights that convert colours to grey values, so that the beam differs most from its surroundings.

    A channel or a colour of the beam that the calibration gives has priority.

    Parameters
    ----------
    images : iterable of ndarray, shape (rows, columns, 3)
        Pictures of one dataset; blue, green, red.
    calibration : Calibration
        Gives the place of the beam at its clamp.
    width_mm, length_mm : float
        Width and length of the specimen.

    Returns
    -------
    Projection
        The weights; usual grey values if no picture shows the beam at its clamp.
    """
    named = calibration.picture or Picture()
    if named.channel is not None:
        return Projection(named.channel, _CHANNELS[named.channel])
    sampler = _RootSampler(BeamFrame(calibration), width_mm, length_mm)
    samples: dict[str, list[_Colours]] = {CAMERA: [], PERCEPTUAL: []}
    for image in images:
        for space, root_colours in samples.items():
            root_colours += sampler.read(image, full_scale(image), space)
    best: Projection | None = None
    for space, root_colours in samples.items():
        for candidate in _candidates(root_colours, space, named.beam_colour) if root_colours else ():
            if best is None or candidate.separation > _advantage(best, candidate) * best.separation:
                best = candidate
    return best or Projection("grey", _CHANNELS["grey"])


def _advantage(best: Projection, candidate: Projection) -> float:
    """Return how many times better `candidate` must separate beam and surroundings to replace `best`."""
    return _WORTH if best.name in _CHANNELS and candidate.name not in _CHANNELS else 1.0


@dataclass(frozen=True)
class _Colours:
    """Colours (shares of full scale) on the beam near its clamp, and on each side of it, shape (n, 3)."""

    inside: Array
    sides: tuple[Array, ...]


@dataclass(frozen=True)
class _RootSampler:
    frame: BeamFrame
    width_mm: float
    length_mm: float

    def read(self, image: NDArray[Any], largest: float, space: str) -> list[_Colours]:
        """Return a list with the colours on and beside the beam near its clamp; empty if they are not in the image.

        `largest`: grey value of full scale. `space`: name of the colour space.
        """
        ahead = np.linspace(0.3, max(1.5, 0.2 * self.length_mm / self.width_mm), 15)
        inside = self._colours(image, largest, space, ahead, np.linspace(-0.25, 0.25, 7))
        sides = [self._colours(image, largest, space, ahead, aside * np.linspace(0.75, 1.25, 7)) for aside in (-1, 1)]
        sides_in_image = tuple(side for side in sides if len(side) > 1)
        return [_Colours(inside, sides_in_image)] if len(inside) > 1 and sides_in_image else []

    def _colours(self, image: NDArray[Any], largest: float, space: str, ahead: Array, aside: Array) -> Array:
        along, across = np.meshgrid(ahead, aside)
        places = self.frame.to_px(self.width_mm * np.column_stack([along.ravel(), across.ravel()]))
        column, row = np.rint(places).astype(int).T
        in_image = (column >= 0) & (row >= 0) & (column < image.shape[1]) & (row < image.shape[0])
        colours = image[row[in_image], column[in_image]][None] / np.float32(largest)
        return np.asarray(_in_space(colours, space)[0], dtype=np.float64) if in_image.any() else np.zeros((0, 3))


def _candidates(samples: Sequence[_Colours], space: str, beam_colour: Sequence[float] | None) -> Iterable[Projection]:
    """Yield possible weights of the colours: those that best separate beam and surroundings, and single channels."""
    inside = [np.median(sample.inside, axis=0) for sample in samples]
    if beam_colour is not None:
        stated = np.array(beam_colour[::-1], dtype=np.float32)[None, None] / np.float32(255.0)
        inside = [_in_space(stated, space)[0, 0].astype(np.float64)] * len(samples)
    elif space == CAMERA:
        yield from (_measured(name, np.array(weights), space, samples) for name, weights in _CHANNELS.items())
    covariance = np.mean([np.cov(part.T) for sample in samples for part in (sample.inside, *sample.sides)], axis=0)
    covariance += (_SHRINKAGE * np.trace(covariance) / 3.0 + _ROUNDING) * np.eye(3)
    side_count = max(len(sample.sides) for sample in samples)
    # One side alone may differ more from the beam than both sides together, for example beside a wall.
    for chosen_sides in ([0], [side_count - 1], range(side_count)):
        outside = [
            np.mean([np.median(sample.sides[min(k, len(sample.sides) - 1)], axis=0) for k in chosen_sides], axis=0)
            for sample in samples
        ]
        mean_difference = np.mean([a - b for a, b in zip(inside, outside, strict=True)], axis=0)
        weights = np.linalg.solve(covariance, mean_difference)
        if np.abs(weights).sum() > 0.0:
            name = "beam's colour" if beam_colour is not None else "discriminant"
            yield _measured(f"{name} in {space} colours", weights / np.abs(weights).sum(), space, samples)


def _measured(name: str, weights: Array, space: str, samples: Sequence[_Colours]) -> Projection:
    """Measure how well the colour weights separate beam and surroundings; return them with this `separation`."""
    separations = []
    for sample in samples:
        inside = sample.inside @ weights
        for side in sample.sides:
            outside = side @ weights
            spread = np.hypot(inside.std(), outside.std()) + np.sqrt(_ROUNDING)
            separations.append(abs(np.median(inside) - np.median(outside)) / spread)
    first, second, third = weights.tolist()
    return Projection(name, (first, second, third), space, float(np.percentile(separations, _CAUTIOUS)))


def _in_space(colours: NDArray[Any], space: str) -> NDArray[np.float32]:
    """Convert blue, green, red (0 to 1) of a picture to a colour space; L, a, b are scaled to about 0 to 1."""
    pixels = np.ascontiguousarray(colours, dtype=np.float32)
    if space == CAMERA:
        return pixels
    import cv2  # slow to import, and not needed for a fit of stored edges

    lab = cv2.cvtColor(pixels, cv2.COLOR_BGR2Lab)
    return np.asarray(lab / np.array([100.0, 255.0, 255.0]) + np.array([0.0, 0.5, 0.5]), dtype=np.float32)
