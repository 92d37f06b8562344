"""The centre line of the beam that is expected before the search, from clicks of a person or from an earlier picture.

The search for the beam prefers paths near this line. The line does not shift the edges that are found beside a path.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CLICKED_PX = 10.0  # distance from the centre line within which a person clicks
_CLICKED_EVIDENCE = 0.25  # gain of a step on a clicked line: the person has seen the body there
_CLICKED_COST = 2.0  # largest cost of a step beside a clicked line, more than a step gains
_CARRIED_COST = 0.15  # largest cost of a step beside the line of an earlier picture, less than a clear body gains
_CLICK_SIGMA_PX = 0.5 * CLICKED_PX  # of each coordinate of a point in a disc of this radius
_CLAMP_SIGMA_PX = 3.0  # of a clamp that a person pointed at by eye
_AXIS_SIGMA_RAD = 0.1
_TURN_SIGMA_RAD = 1.0  # standard deviation of the turn of a beam between its clamp and its tip
_LIKELY = 2.0  # standard deviations of the clicked line within which a strip has no cost
_CARRIED_SPREAD = 0.25  # of the distance from the clamp: by so much the beam may move between two pictures
_AHEAD = 0.15  # of the line's length: difference of the arc lengths at which a strip and the line are compared
_SAMPLES = 120  # of the line
_APART_PX = 4.0 * CLICKED_PX  # clicks nearer to each other than this give no direction, and count as one place


@dataclass(frozen=True)
class CentreLine:
    """An expected centre line of the beam.

    The search for a beam prefers paths near this line: it adds a score for each piece of a path.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        The n points of the line from the clamp outward, equally spaced, px.
    length_px : float
        Length of the line.
    free_px : ndarray, shape (n,)
        Distance (px) from each point up to which a piece of a path is near the line.
    evidence : float
        Score of a piece near the line; not negative.
    largest_cost : float
        Minus the score of a piece far from the line.
    """

    points: Array
    length_px: float
    free_px: Array
    evidence: float
    largest_cost: float

    @property
    def clicked_px(self) -> float:
        """Distance from the clamp, along the line, up to which a person clicked the beam; 0 if no person did."""
        return self.length_px if self.evidence > 0.0 else 0.0

    def scaled(self, factor: float, origin_px: Array) -> CentreLine:
        """Return this line in px of a part of the picture that begins at `origin_px` and is enlarged by `factor`."""
        points = (self.points - origin_px + 0.5) * factor - 0.5
        return replace(self, points=points, length_px=factor * self.length_px, free_px=factor * self.free_px)

    def gain(self, x: Array, y: Array, along_px: float, width_px: float) -> Array:
        """Return the score that this line adds to each piece of a path: zero or positive near the line, else negative.

        Parameters
        ----------
        x, y : ndarray, shape (...)
            Coordinates of the ends of the pieces, px.
        along_px : float
            Distance of these ends from the clamp, along the path.
        width_px : float
            Width of the beam.

        Returns
        -------
        ndarray, shape (...)
            The scores; 0 beyond the end of the line.
        """
        if along_px > self.length_px:
            return np.zeros(x.shape)
        arc = np.linspace(0.0, self.length_px, len(self.points))
        is_near = np.abs(arc - along_px) <= _AHEAD * self.length_px + width_px
        near = self.points[is_near]
        distance = np.hypot(x[..., None] - near[:, 0], y[..., None] - near[:, 1])
        excess = np.maximum(0.0, (distance - self.free_px[is_near]).min(axis=-1)) / (0.5 * width_px)
        cost = np.minimum(0.5 * excess**2, self.largest_cost)
        return np.asarray(np.where(excess > 0.0, -cost, self.evidence))


def clicked_line(clamp_px: Array, ahead: Array, clicks_px: Array) -> CentreLine:
    """Return the most probable centre line of the beam, from the clamp past the points that a person clicked.

    Parameters
    ----------
    clamp_px : ndarray, shape (2,)
        Middle of the clamp line (where the beam leaves its clamp).
    ahead : ndarray, shape (2,)
        Unit vector of the beam at its clamp.
    clicks_px : ndarray, shape (n, 2)
        The n clicked points, from the clamp outward.
    """
    # The direction of the beam is a random walk, and each click measures a position: a cubic smoothing spline
    # (G. Wahba, J. R. Stat. Soc. B 40 (1978) 364).
    corners = _merged(off_clamp(clamp_px, clicks_px))
    clicked = np.cumsum(np.hypot(*np.diff(corners, axis=0).T))
    length = float(clicked[-1])
    at = np.linspace(0.0, length, 4 * _SAMPLES)
    measured = _covariance(clicked, clicked, length) + _CLICK_SIGMA_PX**2 * np.eye(len(clicked))
    weight = np.linalg.solve(measured, _covariance(clicked, at, length)).T
    straight = corners[1:] - clamp_px - clicked[:, None] * ahead
    line = clamp_px + at[:, None] * ahead + weight @ straight
    before = _CLAMP_SIGMA_PX**2 + (_AXIS_SIGMA_RAD * at) ** 2 + _TURN_SIGMA_RAD**2 * at**3 / (3.0 * length)
    variance = before - (weight * _covariance(at, clicked, length)).sum(axis=1)
    free_px = np.maximum(CLICKED_PX, _LIKELY * np.sqrt(np.maximum(variance, 0.0)))
    return _line(line, free_px, _CLICKED_EVIDENCE, _CLICKED_COST)


def _covariance(one: Array, other: Array, length_px: float) -> Array:
    """Return the prior covariance (px²) of positions of the beam's centre line at given distances from the clamp."""
    nearer, farther = np.minimum(one[:, None], other), np.maximum(one[:, None], other)
    walk = _TURN_SIGMA_RAD**2 / length_px * nearer**2 * (farther / 2.0 - nearer / 6.0)
    return np.asarray(_CLAMP_SIGMA_PX**2 + _AXIS_SIGMA_RAD**2 * one[:, None] * other + walk)


def carried_line(middle_px: Array) -> CentreLine:
    """Return the expected centre line of the beam, from the points of its centre line in another picture."""
    from_clamp = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(middle_px, axis=0).T))])
    return _line(middle_px, CLICKED_PX + _CARRIED_SPREAD * from_clamp, 0.0, _CARRIED_COST)


def line_between(first_px: Array, second_px: Array) -> CentreLine:
    """Return the expected centre line of the beam, as the mean of its centre lines in two other pictures.

    Parameters
    ----------
    first_px, second_px : ndarray, shape (n, 2) and (m, 2)
        Points of the two centre lines from the clamp outward, px.
    """
    lines = [_line(points, np.zeros(len(points)), 0.0, 0.0) for points in (first_px, second_px)]
    length = min(line.length_px for line in lines)
    even = np.linspace(0.0, length, _SAMPLES)
    first, second = (
        np.column_stack([np.interp(even, np.linspace(0.0, line.length_px, _SAMPLES), axis) for axis in line.points.T])
        for line in lines
    )
    free_px = CLICKED_PX + 0.5 * np.linalg.norm(second - first, axis=1)
    return _line(0.5 * (first + second), free_px, _CLICKED_EVIDENCE, _CLICKED_COST)


def off_clamp(clamp_px: Array, clicks_px: Array) -> Array:
    """Return the clamp and the clicked points, without the first points that are within 20 px of the clamp.

    The last point is always kept.
    """
    far = np.linalg.norm(clicks_px - clamp_px, axis=1) > 2.0 * CLICKED_PX
    first = int(far.argmax()) if far.any() else len(clicks_px) - 1
    return np.vstack([clamp_px, clicks_px[first:]])


def _merged(corners: Array) -> Array:
    """Replace each group of clicked points that are close together by the mean of the group."""
    groups: list[list[Array]] = []
    for place in corners[1:]:
        if groups and np.linalg.norm(place - np.mean(groups[-1], axis=0)) < _APART_PX:
            groups[-1].append(place)
        else:
            groups.append([place])
    return np.vstack([corners[:1], [np.mean(group, axis=0) for group in groups]])


def _line(places: Array, free_px: Array, evidence: float, largest_cost: float) -> CentreLine:
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))])
    even = np.linspace(0.0, arc[-1], _SAMPLES)
    points = np.column_stack([np.interp(even, arc, places[:, axis]) for axis in (0, 1)])
    return CentreLine(points, float(arc[-1]), np.interp(even, arc, free_px), evidence, largest_cost)
