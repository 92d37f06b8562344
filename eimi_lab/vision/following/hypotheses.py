"""Hypotheses of a strip that is followed: where each is, how it bends, and how well the picture bears it out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.working import WorkingPicture

Array = NDArray[np.float64]

# Places across the strip, in its widths: the inside that a hypothesis remembers, and both sides of each edge. A tenth
# to both sides of an edge is left out, for the picture's blur and for an edge that is not quite there.
INSIDE = np.linspace(-0.4, 0.4, 9)
OUTSIDE = np.array([0.6, 0.7, 0.8])
ACROSS = np.concatenate([-OUTSIDE[::-1], INSIDE, OUTSIDE])
_ACROSS = ACROSS.astype(np.float32)
_INSIDE = slice(3, 12)
# What an edge is seen by: the mean of the three places inside it less that of the three outside; left, right.
_STEPS = np.zeros((2, 15), dtype=np.float32)
_STEPS[0, 0:3], _STEPS[0, 3:6] = -1 / 3, 1 / 3
_STEPS[1, 9:12], _STEPS[1, 12:15] = 1 / 3, -1 / 3

_CERTAIN = 9.0  # (three standard deviations) squared: evidence at which a side counts one half
_LARGEST_MISFIT = 2.0
_ROWS = 30_000  # OpenCV maps no larger picture
_LEARNING = 0.12  # of the inside's colours at each step: light changes slowly along the beam


@dataclass(frozen=True)
class Hypotheses:
    """n strips, each at the end of what was followed so far. Lengths in pixels of the working picture.

    place: (n, 2). angle: (n,) rad. bend: (n,) curvature. width: (n,). template: (n, 9, channels) colours across the
    inside. variance: (n,) of a colour that is still the same, all channels together. score: (n,) sum of the gains.
    """

    place: Array
    angle: Array
    bend: Array
    width: Array
    template: NDArray[np.float32]
    variance: Array
    score: Array

    def __len__(self) -> int:
        return len(self.score)


def read_across(picture: WorkingPicture, x: Array, y: Array, angle: Array, width: Array) -> NDArray[np.float32]:
    """Colours (..., 15, channels) at `ACROSS` of strips at places x, y; beyond the frame the border's."""
    across = width.ravel().astype(np.float32)[:, None] * _ACROSS
    turn = angle.ravel().astype(np.float32)[:, None]
    columns = x.ravel().astype(np.float32)[:, None] - np.sin(turn) * across
    rows = y.ravel().astype(np.float32)[:, None] + np.cos(turn) * across
    return read_colours(picture.pixels, columns, rows).reshape(*x.shape, len(_ACROSS), -1)


def read_colours(pixels: NDArray[np.float32], x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float32]:
    """Colours (n, m, channels) at places (n, m), to a 32nd of a pixel; beyond the frame the border's."""
    x, y = x.astype(np.float32, copy=False), y.astype(np.float32, copy=False)
    parts = [slice(at, at + _ROWS) for at in range(0, len(x), _ROWS)]
    read = [cv2.remap(pixels, x[rows], y[rows], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for rows in parts]
    return np.asarray(np.concatenate(read).reshape(*x.shape, -1), dtype=np.float32)


def least_variance(picture: WorkingPicture) -> float:
    """Of a colour, all channels together: two grey levels, twice the noise or a fortieth of the picture's span."""
    return picture.pixels.shape[2] * max(2.0, 2.0 * picture.noise, 0.025 * picture.span) ** 2


def side_support(colours: NDArray[np.float32], variance: Array) -> Array:
    """(...) 0 to 2: how surely inside and outside differ at both edges together, of colours (..., 15, c)."""
    channels = colours.shape[-1]
    steps = colours.reshape(-1, len(_ACROSS) * channels) @ _steps_of_channels(channels)
    squares = np.square(steps) @ np.kron(np.eye(2, dtype=np.float32), np.ones((channels, 1), dtype=np.float32))
    evidence = squares.reshape(*colours.shape[:-2], 2) / variance[..., None]
    return np.asarray((evidence / (evidence + _CERTAIN)).sum(axis=-1))


@cache
def _steps_of_channels(channels: int) -> NDArray[np.float32]:
    """(15 c, 2 c): `_STEPS` for every channel by itself, so that one product of matrices reads both edges."""
    return np.kron(_STEPS.T, np.eye(channels, dtype=np.float32))


def brightness_step(colours: NDArray[np.float32]) -> Array:
    """(n,) by how much the inside is brighter than what is beside it."""
    return np.asarray((_STEPS @ colours).mean(axis=(1, 2)), dtype=np.float64)


def misfit(colours: NDArray[np.float32], template: NDArray[np.float32], variance: Array) -> Array:
    """(...) 0 to 2: by how much the inside of colours (..., 15, c) is another than the one followed up to here."""
    off = colours[..., _INSIDE, :] - template
    square = np.einsum("...uc,...uc->...", off, off) / off.shape[-2]
    return np.asarray(np.minimum(square / (_CERTAIN * variance), _LARGEST_MISFIT))


def learnt(colours: NDArray[np.float32], template: NDArray[np.float32], variance: Array) -> NDArray[np.float32]:
    """The templates after another step: a little of what is seen now, where it is still the same."""
    seen = colours[:, _INSIDE]
    same = ((seen - template) ** 2).sum(axis=2) < _CERTAIN * variance[:, None]
    return np.asarray(template + np.where(same[..., None], _LEARNING * (seen - template), 0.0), dtype=np.float32)


def inside_of(colours: NDArray[np.float32]) -> NDArray[np.float32]:
    """(n, 9, channels) of (n, 15, channels)."""
    return colours[:, _INSIDE]
