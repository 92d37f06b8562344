"""Place and size of the beam in a picture, known from calibration and specimen file before the search."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.centre_line import CentreLine

Array = NDArray[np.float64]


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
        Width and length of the beam.
    line : CentreLine, optional
        The centre line of the beam that is expected before the search.
    widths : ndarray, shape (k, 2), optional
        How the width varies along the beam: distance from the clamp as a share of the length, and width as a share of
        `width_px`, which is then the mean width. None if the width is constant.
    """

    clamp_px: Array
    axis_rad: float
    width_px: float
    length_px: float
    line: CentreLine | None = None
    widths: Array | None = None

    @property
    def clicked_px(self) -> float:
        """Distance from the clamp, along the beam, of the last point that a person clicked; 0 without such a point."""
        return self.line.clicked_px if self.line else 0.0

    @property
    def ahead(self) -> Array:
        """Unit vector (2,) along the beam at its clamp, away from the clamp."""
        return np.array([math.cos(self.axis_rad), math.sin(self.axis_rad)])

    def scaled(self, factor: float, origin_px: Array) -> StatedBeam:
        """Return the same beam in a picture that is cut at `origin_px` and enlarged by `factor`.

        Pixel centres have integer coordinates in both pictures.
        """
        clamp = (self.clamp_px - origin_px + 0.5) * factor - 0.5
        line = self.line and self.line.scaled(factor, origin_px)
        width, length = self.width_px * factor, self.length_px * factor
        return replace(self, clamp_px=clamp, width_px=width, length_px=length, line=line)

    def relative_width(self, along_px: Array | float) -> Array:
        """Return the width of the beam at given distances from the clamp (px), divided by the mean width.

        The specimen file gives the width along the beam. The result is 1 if the width is constant.
        """
        share = np.asarray(along_px) / self.length_px
        return np.ones(share.shape) if self.widths is None else np.interp(share, *self.widths.T)
