"""The geometry of a specimen at rest, as a map from a straight reference beam of constant width and depth."""

# With the arc length s from the clamp and the distance t from the centre line, the map is x(s, t) = c(s) + n(s) t w(s)
# / w_0, with the centre line c, its unit normal n, the width w and the width w_0 of the reference beam. The magnet is
# not deformed.

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.rest_shape import RestShape, Rows, table_at
from eimi_fitting.beam.specimen import Specimen

Array = NDArray[np.float64]

_FINE = 512  # intervals of the integration of the centre line; Simpson's error is below 1e-9 of the length
_STEP = 0.1  # length of the ramp that stands for a step, as a share of the change of the width
# Largest length of a ramp, divided by the distance to the next step. A narrow rib thus has two ramps and a flat top.
_ROOM = 0.4
# Largest length of a ramp, divided by the distance to the next row of the table. The rows thus stay in order.
_TO_ROW = 0.9


class ImpossibleShape(ValueError):
    """The error of a rest shape whose width or depth is not positive everywhere, or which is bent too sharply."""


class Strip:
    """The map from a straight reference beam of constant width and depth to the specimen at rest.

    Raises
    ------
    ImpossibleShape
        The width or the depth is not positive everywhere, or a radius of the centre line is at most half the width.
    """

    # ``straight``: the reference beam. ``is_straight``: whether the map is the identity.

    def __init__(self, specimen: Specimen) -> None:
        shape, magnet = specimen.rest_shape, specimen.magnet
        self.is_straight = shape is None or shape == RestShape()
        self._shape = shape or RestShape()
        self._length, self._near = specimen.length_mm, specimen.flexible_length_mm
        self._far = self._near + (magnet.length_mm if magnet else 0.0)
        self._widths, self._depths = (
            _without_steps(rows, self._length, (self._near, self._far))
            for rows in (self._shape.widths, self._shape.depths)
        )
        self._width_mm, self._depth_mm = specimen.width_mm, specimen.depth_mm
        self.straight = specimen
        if self._shape.widths or self._shape.depths:
            along = np.linspace(self._near, self._far, 9) if magnet else np.zeros(0)
            sizes = {"width_mm": specimen.width_mm, "depth_mm": specimen.depth_mm}
            for name, table in (("width_mm", self.width_mm), ("depth_mm", self.depth_mm)):
                smallest = float(table(np.linspace(0, self._length, 257)).min())
                if not smallest > 0:
                    raise ImpossibleShape(f"{name} of the rest shape falls to {smallest:g} mm, but must be above 0 mm")
                # The magnet keeps its size: the reference beam has the smallest width and depth along the magnet.
                if magnet:
                    sizes[name] = float(table(along).min())
            self.straight = replace(specimen, rest_shape=None, width_mm=sizes["width_mm"], depth_mm=sizes["depth_mm"])
        elif not self.is_straight:
            self.straight = replace(specimen, rest_shape=None)
        if self._shape.turns:
            self._check_radius()

    def _check_radius(self) -> None:
        # Where the radius of the centre line is at most half the width, the sides of the beam run backwards.
        along = np.linspace(0, self._length, _FINE + 1)
        curvature = np.abs(np.gradient(self.angle_rad(along), along))
        sharpest = int(np.argmax(curvature * self.width_mm(along)))
        half = 0.5 * float(self.width_mm(along[sharpest]))
        if curvature[sharpest] * half >= 1:
            raise ImpossibleShape(
                f"the centre line has a radius of {1 / curvature[sharpest]:.3g} mm at {along[sharpest]:.3g} mm from "
                f"the clamp, but should have a radius above half the width, {half:.3g} mm: give fewer or smoother "
                "points"
            )

    @property
    def kinks_mm(self) -> Array:
        """The arc lengths in mm at which the slope of the width or depth jumps, in the flexible part."""
        at = self._length * replace(self._shape, widths=self._widths, depths=self._depths).kinks
        return np.asarray(at[(at > 0) & (at < self._near)])

    def width_mm(self, along_mm: Array) -> Array:
        """Return the width of the specimen at rest, at arc lengths from the clamp."""
        return self._width_mm + table_at(self._widths, np.asarray(along_mm) / self._length)

    def depth_mm(self, along_mm: Array) -> Array:
        """Return the depth of the specimen at rest, at arc lengths from the clamp."""
        return self._depth_mm + table_at(self._depths, np.asarray(along_mm) / self._length)

    def angle_rad(self, along_mm: Array) -> Array:
        """Return the angle of the centre line at rest, from +x, at arc lengths from the clamp."""
        s = np.asarray(along_mm, float)
        if not self._shape.turns:
            return np.zeros(s.shape)
        if self._far == self._near:
            return self._shape.angle_rad(s / self._length)
        before = self._shape.angle_rad(np.minimum(s, self._near) / self._length)
        beyond = self._shape.angle_rad(np.array([self._far, *np.maximum(s, self._far).ravel()]) / self._length)
        return np.asarray(before + (beyond[1:] - beyond[0]).reshape(s.shape))

    def tip_rotation_deg(self, ends_mm: Array) -> Array:
        """Return the rotation of the cross-section at the tip from rest, above -180 and at most 180 degrees.

        Parameters
        ----------
        ends_mm : ndarray, shape (..., 2, 2)
            The ends (x, y) of the cross-section at negative and at positive distances from the centre line.

        Returns
        -------
        ndarray, shape (...)
            Rotations.
        """
        across = ends_mm[..., 1, :] - ends_mm[..., 0, :]
        # Rotate the cross-section back by its angle at rest first: arctan2 gives only angles from -180 to 180 degrees.
        at_rest = self.angle_rad(np.array([self._length]))[0]
        c, s = np.cos(at_rest), np.sin(at_rest)
        x, y = across[..., 0], across[..., 1]
        return np.degrees(np.arctan2(-(c * x + s * y), c * y - s * x))

    @cached_property
    def _centre(self) -> scipy.interpolate.CubicHermiteSpline:
        ends = np.linspace(0, self._length, _FINE + 1)
        middle = 0.5 * (ends[1:] + ends[:-1])
        at_ends, at_middle = (np.stack([np.cos(a), np.sin(a)], axis=1) for a in map(self.angle_rad, (ends, middle)))
        steps = (at_ends[:-1] + 4 * at_middle + at_ends[1:]) * (ends[1] / 6)  # Simpson's rule
        return scipy.interpolate.CubicHermiteSpline(
            ends, np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), at_ends
        )

    def at_rest(self, straight_mm: Array) -> Array:
        """Map points (x, y) of the straight reference beam to the unloaded specimen."""
        points = np.asarray(straight_mm, float)
        if self.is_straight:
            return points
        s, t = points.T
        across = _rescaled(t, *self._lines_across(s)) if self._widths else t
        if not self._shape.turns:
            return np.column_stack([s, across])
        angle = self.angle_rad(s)
        return np.asarray(self._centre(s) + across[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1))

    def straightened(self, places_mm: Array) -> Array:
        """Map points (x, y) of the unloaded specimen to the straight reference beam."""
        places = np.asarray(places_mm, float)
        if self.is_straight:
            return places
        s, across = self._along_and_across(places)
        before, after = self._lines_across(s)
        return np.column_stack([s, _rescaled(across, after, before)])

    def nearest(self, places_mm: Array) -> Array:
        """Return the nearest point (x, y) of the unloaded specimen for each given point."""
        # Points far beyond the ends of the specimen have no foot on the centre line.
        places = np.clip(np.asarray(places_mm, float), [0.0, -np.inf], [self._length, np.inf])
        half = 0.5 * self.straight.width_mm
        return self.at_rest(np.clip(self.straightened(places), [0.0, -half], [self._length, half]))

    def _along_and_across(self, places: Array) -> tuple[Array, Array]:
        if not self._shape.turns:
            return places[:, 0], places[:, 1]
        stations = np.linspace(0, self._length, _FINE + 1)
        centres = self._centre(stations)
        s = stations[np.argmin(((places[:, None] - centres) ** 2).sum(axis=2), axis=1)]
        for _ in range(8):  # Newton's method for the foot of the perpendicular on the centre line
            angle, gap = self.angle_rad(s), places - self._centre(s)
            tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            across = gap[:, 1] * tangent[:, 0] - gap[:, 0] * tangent[:, 1]
            h = 1e-6 * self._length
            curvature = (self.angle_rad(s + h) - self.angle_rad(s - h)) / (2 * h)
            s = s + (gap * tangent).sum(axis=1) / np.maximum(1 - across * curvature, 0.1)
            s = np.clip(s, -self._length, 2 * self._length)  # points far from the beam have no foot
        return s, across

    def _lines_across(self, s: Array) -> tuple[Array, Array]:
        """Return the distances of the magnet's side and the beam's side from the centre line, in mm."""
        # First those in the straight reference beam, (2, 1), then those in the specimen at rest, (2, n).
        magnet = self.straight.magnet
        core = 0.5 * magnet.width_mm if magnet else 0.0
        return self._lines(s, self.width_mm, 0.5 * self.straight.width_mm, core)

    def _lines(self, s: Array, size_mm: Callable[[Array], Array], half: float, core: float) -> tuple[Array, Array]:
        ends = 0.5 * size_mm(s)
        if not 0 < core < half:
            core = 0.5 * half  # any line inside: the map is linear
            return np.array([[core], [half]]), np.stack([ends * core / half, ends])
        inner = core * ends / (0.5 * size_mm(np.clip(s, self._near, self._far)))
        return np.array([[core], [half]]), np.stack([inner, ends])

    def z_at_rest_mm(self, along_mm: Array, z_mm: Array) -> Array:
        """Map z from a straight beam of constant depth to the unloaded specimen, whose depth may vary."""
        # ``along_mm`` (n,): arc lengths from the clamp.
        return _rescaled(z_mm, *self._lines_in_depth(along_mm)) if self._depths else z_mm

    def straight_z_mm(self, along_mm: Array, z_mm: Array) -> Array:
        """Map z from the unloaded specimen, whose depth may vary, to a straight beam of constant depth."""
        # ``along_mm`` (n,): arc lengths from the clamp.
        return _rescaled(z_mm, *self._lines_in_depth(along_mm)[::-1]) if self._depths else z_mm

    def _lines_in_depth(self, s: Array) -> tuple[Array, Array]:
        magnet = self.straight.magnet
        core = 0.5 * magnet.depth_mm if magnet else 0.0
        return self._lines(s, self.depth_mm, 0.5 * self.straight.depth_mm, core)

    def thickness(self, along_mm: Array) -> Array | None:
        """Return the depth at arc lengths from the clamp, divided by the depth of the straight reference beam."""
        # None if the depth is constant.
        return self.depth_mm(along_mm) / self.straight.depth_mm if self._depths else None


def _rescaled(value: Array, before: Array, after: Array) -> Array:
    # Map distances from the middle of one beam to those in another beam, linearly inside the magnet and beside it.
    # ``before``, ``after``: distances of the side of the magnet and of the side of the beam from the middle, in the one
    # beam and in the other beam.
    size = np.abs(value)
    (inner, outer), (new_inner, new_outer) = before, after
    beyond = new_inner + (size - inner) * (new_outer - new_inner) / (outer - inner)
    return np.copysign(np.where(size <= inner, size * new_inner / inner, beyond), value)


def _without_steps(rows: Rows, length_mm: float, magnet_mm: tuple[float, float]) -> Rows:
    """Replace every step in a table of the width or depth by a ramp."""
    # ``rows``: fractions of the length and values. ``magnet_mm``: distances of the magnet's faces from the clamp.
    ramped = list(rows)
    for i, ((share, before), (other, after)) in enumerate(pairwise(rows)):
        if other > share:
            continue
        ramp = _STEP * abs(after - before) / length_mm
        steps = [at for (at, _), (end, _) in pairwise(rows) if end <= at]
        at_magnet = min(abs(share * length_mm - face) for face in magnet_mm) <= ramp * length_mm
        if (after > before) != at_magnet:
            room = min((_ROOM * (at - share) for at in steps if at > share), default=np.inf)
            to_row = rows[i + 2][0] - share if i + 2 < len(rows) else np.inf
            ramped[i + 1] = (share + min(ramp, room, _TO_ROW * to_row), after)
        else:
            room = min((_ROOM * (share - at) for at in steps if at < share), default=np.inf)
            to_row = share - rows[i - 1][0] if i > 0 else np.inf
            ramped[i] = (share - min(ramp, room, _TO_ROW * to_row), before)
    return tuple(ramped)
