"""The stress-free shape of a beam that is not a straight strip: tables of its bend, width and depth along the beam."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = tuple[tuple[float, float], ...]

_FEWEST_TURNS = 17  # rows of the table of a measured centre line


@dataclass(frozen=True)
class RestShape:
    """The stress-free shape of a specimen, as tables of its bend, width and depth.

    An empty table means that the beam is straight, or that its width or depth is constant.

    Parameters
    ----------
    turns : tuple of (float, float)
        Fraction of the beam's length, and angle of the centre line there in rad. The first row is (0, 0). The rows are
        connected by a cubic spline.
    widths, depths : tuple of (float, float)
        Fraction of the beam's length, and addition to the specimen's width or depth there in mm. The rows are connected
        by straight lines. Two rows with equal fractions are a step.

    Examples
    --------
    A strip of 30 mm that was cast with a radius of 100 mm, and becomes 1 mm narrower from the clamp to the tip:

    >>> import numpy as np
    >>> from eimi_fitting.beam.rest_shape import RestShape
    >>> shares = np.linspace(0, 1, 5)
    >>> bent = RestShape(
    ...     turns=tuple((s, 30.0 * s / 100.0) for s in shares), widths=((0.0, 0.5), (1.0, -0.5))
    ... )
    >>> bent.angle_rad(np.array([0.0, 0.5, 1.0])).round(3).tolist()
    [0.0, 0.15, 0.3]
    """

    turns: Rows = ()
    widths: Rows = ()
    depths: Rows = ()

    def angle_rad(self, shares: Array) -> Array:
        """Return the angle of the centre line in rad at fractions of the beam's length."""
        if not self.turns:
            return np.zeros(np.shape(shares))
        at, angles = np.array(self.turns).T
        if len(at) < 4:  # too few rows for a cubic: straight lines between them
            return np.asarray(np.interp(shares, at, angles))
        return np.asarray(self._cubic(np.clip(shares, at[0], at[-1])))

    @cached_property
    def _cubic(self) -> scipy.interpolate.CubicSpline:
        return scipy.interpolate.CubicSpline(*np.array(self.turns).T)

    @property
    def kinks(self) -> Array:
        """The fractions of the length at which the slope of the width or of the depth jumps."""
        shares = [s for rows in (self.widths, self.depths) for s in _kinks(rows)]
        return np.unique(np.asarray(shares, float))


def table_at(rows: Rows, shares: Array) -> Array:
    """Interpolate a table (rows of fraction and value) at fractions of the beam's length; 0 without rows."""
    if not rows:
        return np.zeros(np.shape(shares))
    at, values = np.array(rows).T
    return np.asarray(np.interp(shares, at, values))


def _kinks(rows: Rows) -> list[float]:
    slopes = [(b[1] - a[1]) / max(b[0] - a[0], 1e-9) for a, b in pairwise(rows)]
    largest = max((abs(slope) for slope in slopes), default=0.0)
    # The many rows of a smooth table change their slope a little at each of them.
    return [
        rows[i + 1][0]
        for i, (before, after) in enumerate(pairwise(slopes))
        if abs(after - before) > 0.5 * largest and 0 < rows[i + 1][0] < 1
    ]


def centre_line(points_mm: Array, length_mm: float) -> Rows:
    """Return the table of the angle of a measured centre line along the beam, for ``RestShape.turns``.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 2)
        Points (x, y) of the centre line, from the clamp (0, 0) to the tip.
    length_mm : float
        Length of the beam.

    Raises
    ------
    ValueError
        There are fewer than four points, two neighbouring points are equal, the first point is not at the clamp, or the
        curve is more than 2 % longer or shorter than the beam.
    """
    points = np.asarray(points_mm, float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 4:
        raise ValueError(f"a centre line needs at least 4 points x, y: the shape is {points.shape}, not (4 or more, 2)")
    if np.hypot(*points[0]) > 0.02 * length_mm:
        raise ValueError(
            f"the centre line begins at ({points[0, 0]:g}, {points[0, 1]:g}) mm, but should begin at the clamp, (0, 0)"
        )
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if np.any(steps <= 0):
        first = int(np.argmin(steps)) + 1
        raise ValueError(f"points {first} and {first + 1} of the centre line are the same: remove one of them")
    chord = np.concatenate([[0.0], np.cumsum(steps)])
    spline = scipy.interpolate.CubicSpline(chord, points, bc_type=((1, np.array([1.0, 0.0])), "not-a-knot"))
    fine = np.linspace(0, chord[-1], 20 * len(points))
    slope = spline(fine, 1)
    speed = np.linalg.norm(slope, axis=1)
    arc = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine))])
    if abs(arc[-1] / length_mm - 1) > 0.02:
        raise ValueError(
            f"the centre line is {arc[-1]:.4g} mm long, but the beam has length_mm = {length_mm:g}: the two lengths "
            "should differ by at most 2 %"
        )
    angle = np.unwrap(np.arctan2(slope[:, 1], slope[:, 0]))
    shares = np.linspace(0, 1, max(_FEWEST_TURNS, 2 * len(points)))
    at = np.interp(shares, arc / arc[-1], angle)
    return tuple(zip(shares.tolist(), (at - at[0]).tolist(), strict=True))
