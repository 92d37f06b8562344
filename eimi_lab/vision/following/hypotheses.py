"""Strips of the picture that may show the beam: position and curvature, and how well the image supports each strip."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.working import WorkingPicture

Array = NDArray[np.float64]

# Places across the strip, in its widths: the inside that a hypothesis remembers, and the outside on both sides. A tenth
# of a width on each side of an edge is left out, for the blur and for the error of the edge's place.
INSIDE = np.linspace(-0.4, 0.4, 9)
OUTSIDE = np.array([0.6, 0.7, 0.8])
ACROSS = np.concatenate([-OUTSIDE[::-1], INSIDE, OUTSIDE])
_ACROSS = ACROSS.astype(np.float32)
_INSIDE = slice(3, 12)
# The step at the left and at the right edge: the mean of the three places inside less that of the three outside.
_STEPS = np.zeros((2, 15), dtype=np.float32)
_STEPS[0, 0:3], _STEPS[0, 3:6] = -1 / 3, 1 / 3
_STEPS[1, 9:12], _STEPS[1, 12:15] = 1 / 3, -1 / 3

_CERTAIN = 9.0  # three standard deviations, squared: evidence at which the support of an edge is one half
_LARGEST_MISFIT = 2.0
_ROWS = 30_000  # cv2.remap accepts no larger array
_LEARNING = 0.12  # share by which the remembered colours change in a step: light changes slowly along the beam
_LATERAL = 0.15  # share of the variance across the strip: a round beam is shaded, and this is not noise


@dataclass(frozen=True)
class Hypotheses:
    """The n strips of the picture that may show the beam, during the search from the clamp outward.

    The attributes describe the outer end of each strip. Lengths are in px.

    Attributes
    ----------
    place : ndarray, shape (n, 2)
        Point on the centre line.
    angle : ndarray, shape (n,)
        Direction, rad, clockwise from +x.
    bend : ndarray, shape (n,)
        Curvature, 1/px.
    width : ndarray, shape (n,)
        Width of the strip.
    template : ndarray, shape (n, 9, channels)
        Colours at nine points across the inside of the strip, remembered from earlier steps of the search.
    tolerance : ndarray, shape (n,)
        Variance of the colours inside the strip near the clamp, summed over the colour channels.
    variance : ndarray, shape (n,)
        Present variance of the colours inside the strip, at most `tolerance`.
    score : ndarray, shape (n,)
        Clarity of both edges, summed over all steps of the search, less the costs of bends.
    """

    place: Array
    angle: Array
    bend: Array
    width: Array
    template: NDArray[np.float32]
    tolerance: Array
    variance: Array
    score: Array

    def __len__(self) -> int:
        return len(self.score)


def read_across(picture: WorkingPicture, x: Array, y: Array, angle: Array, width: Array) -> NDArray[np.float32]:
    """Return the colours at 15 points across each possible beam, shape (..., 15, channels).

    Three points are outside, nine inside, three outside. `x`, `y`, `angle` (rad) and `width` give the middle, the
    direction and the width of each possible beam.
    """
    across = width.ravel().astype(np.float32)[:, None] * _ACROSS
    turn = angle.ravel().astype(np.float32)[:, None]
    columns = x.ravel().astype(np.float32)[:, None] - np.sin(turn) * across
    rows = y.ravel().astype(np.float32)[:, None] + np.cos(turn) * across
    return read_colours(picture.pixels, columns, rows).reshape(*x.shape, len(_ACROSS), -1)


def read_colours(pixels: NDArray[np.float32], x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float32]:
    """Return the colours of a picture at given points, by bilinear interpolation on a grid of 1/32 px."""
    x, y = x.astype(np.float32, copy=False), y.astype(np.float32, copy=False)
    parts = [slice(at, at + _ROWS) for at in range(0, len(x), _ROWS)]
    read = [cv2.remap(pixels, x[rows], y[rows], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for rows in parts]
    return np.asarray(np.concatenate(read).reshape(*x.shape, -1), dtype=np.float32)


def least_variance(picture: WorkingPicture) -> float:
    """Return the smallest variance that is assumed for a colour, summed over the colour channels."""
    return picture.pixels.shape[2] * max(2.0, 2.0 * picture.noise, 0.025 * picture.span) ** 2


def side_support(colours: NDArray[np.float32], variance: Array) -> Array:
    """Return how clearly the colour changes at the edges of each possible beam: the sum of 0 to 1 for each edge.

    Parameters
    ----------
    colours : ndarray, shape (..., 15, channels)
        Colours at 15 points across each possible beam: three outside, nine inside, three outside.
    variance : ndarray, shape (...)
        Variance of a colour, summed over the colour channels.
    """
    channels = colours.shape[-1]
    steps = colours.reshape(-1, len(_ACROSS) * channels) @ _steps_of_channels(channels)
    squares = np.square(steps) @ np.kron(np.eye(2, dtype=np.float32), np.ones((channels, 1), dtype=np.float32))
    evidence = squares.reshape(*colours.shape[:-2], 2) / variance[..., None]
    return np.asarray((evidence / (evidence + _CERTAIN)).sum(axis=-1))


@cache
def _steps_of_channels(channels: int) -> NDArray[np.float32]:
    return np.kron(_STEPS.T, np.eye(channels, dtype=np.float32))


def brightness_step(colours: NDArray[np.float32]) -> Array:
    """Return, for each possible beam, the brightness inside it minus that of its surroundings."""
    return np.asarray((_STEPS @ colours).mean(axis=(1, 2)), dtype=np.float64)


def misfit(colours: NDArray[np.float32], template: NDArray[np.float32], variance: Array) -> Array:
    """Return how much the colours inside each possible beam differ from `template`: from 0 (equal) to 2."""
    difference = colours[..., _INSIDE, :] - template
    square = np.einsum("...uc,...uc->...", difference, difference) / difference.shape[-2]
    return np.asarray(np.minimum(square / (_CERTAIN * variance), _LARGEST_MISFIT))


def updated_templates(
    colours: NDArray[np.float32], template: NDArray[np.float32], tolerance: Array, variance: Array, least: float
) -> tuple[NDArray[np.float32], Array]:
    """Return the remembered colours and variances of n strips (possible beams) after a further step along the beam."""
    # colours : ndarray, shape (n, 15, channels)
    #     Present colours at 15 points across each strip: three outside, nine inside, three outside.
    # template : ndarray, shape (n, 9, channels)
    #     Remembered colours at the nine points inside.
    # tolerance : ndarray, shape (n,)
    #     Variance of the colours of each strip near the clamp, summed over the channels.
    # variance : ndarray, shape (n,)
    #     The variance that this function returned after the previous step.
    # least : float
    #     Smallest variance that is assumed for a colour.
    present = colours[:, _INSIDE]
    squares = ((present - template) ** 2).sum(axis=2)
    same = squares < _CERTAIN * tolerance[:, None]
    moved = template + np.where(same[..., None], _LEARNING * (present - template), 0.0)
    scatter = (same * squares).sum(axis=1) / np.maximum(same.sum(axis=1), 1)
    # The variance never rises, so that a body which crosses the beam does not hide the edges beyond this body.
    fall = variance - assumed_variance(least, scatter, present)
    return np.asarray(moved, dtype=np.float32), variance - _LEARNING * np.maximum(fall, 0.0)


def assumed_variance(least: float, scatter: Array, inside: NDArray[np.float32]) -> Array:
    """Return the variance of colours that is assumed to be noise, for each strip, summed over the channels.

    It is the sum of `least`, `scatter` (variance along the strip) and a part of the variance of the colours `inside`,
    which were read across the strip.
    """
    # only a part of the variance across the strip, because a round beam is shaded, and shading is no noise
    return np.asarray(least + scatter + _LATERAL * inside.var(axis=1).sum(axis=1))


def inside_of(colours: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the colours at the middle nine of 15 points across each possible beam; the others lie outside it."""
    return colours[:, _INSIDE]
