"""Place and size of the beam in a picture, known from calibration and specimen file before the search."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.centre_line import CentreLine

Array = NDArray[np.float64]

_TILT_DEG = 2.0  # assumed standard uncertainty, of a camera that was set parallel to the plane of the beam by eye


@dataclass(frozen=True)
class StatedBeam:
    """Place and size of the beam in a picture according to calibration and specimen file, in pixels.

    Attributes
    ----------
    clamp_px : ndarray, shape (2,)
        Middle of the clamp line (where the beam leaves its clamp).
    axis_rad : float
        Direction of the beam at its clamp, clockwise from the image's +x.
    width_px, length_px : float
        Mean width and length of the beam.
    line : CentreLine, optional
        Expected centre line of the beam.
    widths : ndarray, shape (k, 2), optional
        Distance from the clamp divided by `length_px`, and width there divided by `width_px`. None for a constant
        width.
    depth_px : float
        Size of the beam along the line of sight, at the scale of the picture; 0 without perspective.
    vanishing_px : ndarray, shape (2,), optional
        Point toward which perspective shifts the far face of the beam; None without perspective.
    recession : float
        This shift of the far face, divided by the distance from `vanishing_px`.
    """

    clamp_px: Array
    axis_rad: float
    width_px: float
    length_px: float
    line: CentreLine | None = None
    widths: Array | None = None
    depth_px: float = 0.0
    vanishing_px: Array | None = None
    recession: float = 0.0

    @property
    def clicked_px(self) -> float:
        """Distance from the clamp, along the beam, of the last point that a person clicked; 0 without such a point."""
        return self.line.clicked_px if self.line else 0.0

    @property
    def ahead(self) -> Array:
        """Unit vector along the beam at its clamp, away from the clamp."""
        return np.array([math.cos(self.axis_rad), math.sin(self.axis_rad)])

    def scaled(self, factor: float, origin_px: Array) -> StatedBeam:
        """Return the same beam in a picture that is cut at `origin_px` and enlarged by `factor`."""
        clamp = (self.clamp_px - origin_px + 0.5) * factor - 0.5
        line = self.line and self.line.scaled(factor, origin_px)
        vanishing = None if self.vanishing_px is None else (self.vanishing_px - origin_px + 0.5) * factor - 0.5
        width, length, depth = self.width_px * factor, self.length_px * factor, self.depth_px * factor
        return replace(
            self,
            clamp_px=clamp,
            width_px=width,
            length_px=length,
            line=line,
            depth_px=depth,
            vanishing_px=vanishing,
        )

    def relative_width(self, along_px: Array | float) -> Array:
        """Return the width of the beam at given distances from the clamp (px), divided by the mean width."""
        share = np.asarray(along_px) / self.length_px
        return np.ones(share.shape) if self.widths is None else np.interp(share, *self.widths.T)

    def side_faces(self, places_px: Array, aside_px: Array) -> tuple[Array, Array]:
        """Return how wide the side faces of the beam appear in perspective, and their standard uncertainties.

        Parameters
        ----------
        places_px : ndarray, shape (n, 2)
            Points on the centre line.
        aside_px : ndarray, shape (n, 2)
            Vector across the beam to the right, as seen from the clamp. Its length is the unit of the result.

        Returns
        -------
        tuple of ndarray, shape (2, n)
            Width of the left and of the right side face, 0 for a hidden face, and its uncertainty.
        """
        if self.vanishing_px is None:
            return np.zeros((2, len(places_px))), np.zeros((2, len(places_px)))
        unit_px = np.linalg.norm(aside_px, axis=1)
        right = self.recession * ((self.vanishing_px - places_px) * aside_px).sum(axis=1) / unit_px**2
        faces = np.maximum([-right, right], 0.0)
        return faces, np.where(faces > 0.0, math.radians(_TILT_DEG) * self.depth_px / unit_px, 0.0)
