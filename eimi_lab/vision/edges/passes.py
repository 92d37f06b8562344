"""Locate the edges of the beam in two searches: near its outline, then near the edges of the first search."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.edges.curve import SmoothCurve
from eimi_lab.vision.edges.profiles import AVERAGED_PX, Cover, Steps, fit_steps, normals_of, read_profiles, stations
from eimi_lab.vision.edges.silhouette import Silhouette
from eimi_lab.vision.edges.uneven_light import light_along

Array = NDArray[np.float64]

MOST_POINTS = 100  # on each side
_WIDEST_SPACING = 0.11  # of the beam's width: with points farther apart, scatter and shape cannot be separated
_FEWEST_POINTS = 8  # on each side: fewer points do not determine a curve
_FEWEST_OF_TIP = 3
_TIP_SPACING_PX = 2.0
_TIP_PIECES = 8  # least number of intervals on the tip: the profiles next to its corners are not clean steps
_FIRST_BLUR_PX = 1.2  # initial value of the fitted blur
_COARSE_HALF_PX = 10.0  # half length of a profile in the first pass, in which the blur is not known
_COARSE_MARGIN_PX = 8.0  # left out at both ends of an edge in the first pass
_REACH_IN_BLURS = 4.0  # half length of a profile; also the reach of clamp and corners along an edge
_CLEAN_RESIDUAL = 0.03  # of the step; a profile with a smaller residual is never taken for dirt
_PIECE_IN_WIDTHS = 0.7  # length of an interval of the spline
_THIRD_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])
_NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over the median of its absolute values
_LINES_PX = np.arange(AVERAGED_PX) - 0.5 * (AVERAGED_PX - 1)


@dataclass(frozen=True)
class SiliconeMargin:
    """The silicone of the beam beside a magnet near the tip.

    Attributes
    ----------
    width_px : float
        Width of the silicone on each side of the magnet.
    tolerance_px : float
        Standard deviation of this width.
    magnet_end_px : float
        Distance from the tip to the end of the magnet that is nearer to the clamp.
    """

    width_px: float
    tolerance_px: float
    magnet_end_px: float


@dataclass(frozen=True)
class Side:
    """The n points that were located on the left edge, the tip or the right edge."""

    # curve : SmoothCurve
    #     Approximate edge, on whose normals the points were searched.
    # points_px : ndarray, shape (n, 2)
    #     The edge points.
    # offset_px : ndarray, shape (n,)
    #     Distance of each point from the curve.
    # sigma_px : ndarray, shape (n,)
    #     Standard deviation of the offset due to image noise.
    # common_px : ndarray, shape (n,)
    #     Standard deviation of a shift of all offsets together, such as beside a magnet.
    # sound : ndarray of bool, shape (n,)
    #     Whether an edge was detected at each point.
    # stride : int
    #     Every stride-th point is stored as a point of the edge.

    curve: SmoothCurve
    points_px: Array
    offset_px: Array
    sigma_px: Array
    common_px: Array
    sound: NDArray[np.bool_]
    stride: int


@dataclass(frozen=True)
class PassResult:
    """The result of one search for the edges, on n lines across them.

    Attributes
    ----------
    sides : tuple of Side
        The located edges.
    steps : Steps
        The blurred steps that were fitted to the grey values.
    stations_px : ndarray, shape (m,)
        Distances along a line at which grey values were read, positive outward.
    profiles : ndarray, shape (n, m)
        Grey values, corrected for an uneven back-light.
    residual : ndarray, shape (n,)
        RMS residual on each line, as a share of the height of the step.
    """

    sides: tuple[Side, ...]
    steps: Steps
    stations_px: Array
    profiles: Array
    residual: Array

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Whether an edge point was located on each line across the edge."""
        return np.concatenate([side.sound for side in self.sides])

    @property
    def near_clamp(self) -> NDArray[np.bool_]:
        """Whether each line across an edge lies in the half of the beam near the clamp and has an edge point."""
        half = [np.arange(len(side.sound)) < len(side.sound) // 2 for side in self.sides]
        return np.concatenate(half) & self.sound

    def plateau(self, outward: float) -> Array:
        """Return grey values beside the edge, where its blur has no effect.

        Parameters
        ----------
        outward : float
            +1 for values outside the beam, -1 for values inside.

        Returns
        -------
        ndarray, shape (p, s)
            Grey values on p lines with an edge point, at s distances from the edge.
        """
        away = outward * self.stations_px
        return self.profiles[self.sound][:, away >= min(2.0 * self.steps.blur_px, float(away.max()))]


def first_pass(
    image: NDArray[Any],
    silhouette: Silhouette,
    hand: float,
    spacing_px: float,
    width_px: float,
    margin: SiliconeMargin,
) -> PassResult | None:
    """Locate the left edge, the tip and the right edge of the beam near its outline.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey values with a dark beam.
    silhouette : Silhouette
        Outline of the beam and corners of its tip, accurate to about a pixel.
    hand : float
        +1 if y is a quarter turn clockwise of x in the image, else -1.
    spacing_px : float
        Desired distance between points along the long edges.
    width_px : float
        Width of the specimen.
    margin : SiliconeMargin
        Silicone between the magnet in the beam and the edges; its width is 0 without a magnet.

    Returns
    -------
    PassResult or None
        Left edge, tip, right edge. None if the silhouette has no corners, or if an edge is too short.
    """
    if silhouette.corners is None:
        return None
    first, second = silhouette.corners
    outline = silhouette.outline_px
    half = min(_COARSE_HALF_PX, 0.4 * width_px)
    inner = _inner_reach_px(half, margin.width_px, _FIRST_BLUR_PX)
    curves, arc_lengths = [], []
    # The right edge is reversed, so that both edges run from the clamp to the tip.
    for points in (outline[: first + 1], outline[first : second + 1], outline[second:][::-1]):
        middle = points[_clear_of_ends(points, min(_COARSE_MARGIN_PX, 0.25 * width_px))]
        if len(middle) < 4:
            return None
        curve = _smooth(middle, width_px)
        curves.append(curve)
        spacing = min(_TIP_SPACING_PX, curve.length / _TIP_PIECES) if len(curves) == 2 else spacing_px
        arc_lengths.append(_arc_lengths(0.0, curve.length, spacing, _WIDEST_SPACING * width_px))
    return _locate(
        image, curves, arc_lengths, (-hand, -hand, hand), stations(inner, half), _FIRST_BLUR_PX, _FEWEST_OF_TIP
    )


def second_pass(
    image: NDArray[Any],
    first: PassResult,
    corners_px: Array,
    hand: float,
    spacing_px: float,
    width_px: float,
    margin: SiliconeMargin,
) -> PassResult | None:
    """Locate the left and right edges of the beam near the edges from the first search.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey values with a dark beam.
    first : PassResult
        Result of the first search.
    corners_px : ndarray, shape (4, 2)
        Clamp-left, clamp-right, tip-left, tip-right.
    hand, spacing_px, width_px, margin
        Sense of the y axis (±1), distance between points, width of the specimen and silicone beside the magnet in the
        beam, as in `first_pass`.

    Returns
    -------
    PassResult or None
        Left edge, right edge. None if a corner is NaN, or if an edge has fewer than eight points.
    """
    sides = (first.sides[0], first.sides[-1])
    if not np.isfinite(corners_px).all() or min(side.sound.sum() for side in sides) < _FEWEST_POINTS:
        return None
    blur_px = first.steps.blur_px
    reach = _REACH_IN_BLURS * blur_px
    clear = reach + 0.5 * AVERAGED_PX
    half = min(reach + 1.0, 0.4 * width_px)
    covered = 0.0 < margin.width_px < half + 2.0 * blur_px  # the profiles do not reach the magnet behind a wider margin
    curves, arc_lengths, group = [], [], []
    for number, (side, start, end) in enumerate(zip(sides, corners_px[:2], corners_px[2:], strict=True)):
        curve = _smooth(side.points_px[side.sound], width_px)
        dense = np.arange(-width_px, curve.length + width_px, 0.5)
        points = curve.at(dense)[0]
        begin, finish = (float(dense[np.argmin(((points - corner) ** 2).sum(axis=1))]) for corner in (start, end))
        place = _arc_lengths(begin + clear, finish - clear, spacing_px, _WIDEST_SPACING * width_px)
        curves.append(curve)
        arc_lengths.append(place)
        # Where the magnet has not begun yet, the fitted second step has no height.
        group.append(np.where(covered & (place[0] > finish - margin.magnet_end_px - reach), number, -1))
    cover = None
    if covered:
        two = np.ones(2)
        cover = Cover(np.concatenate(group), margin.width_px * two, margin.tolerance_px * two, _transmission(first))
    return _locate(image, curves, arc_lengths, (-hand, hand), stations(half, half), blur_px, _FEWEST_POINTS, cover)


def _transmission(located: PassResult) -> float:
    """Return the share of light that passes through the beam near the clamp; 0 if it was not measured."""
    near, steps = located.near_clamp, located.steps
    share = steps.dark[near] / np.maximum(steps.bright[near], 1e-9)
    return float(np.clip(np.median(share), 0.0, 1.0)) if near.any() else 0.0


def scatter_scale(left: Side, right: Side) -> float:
    """Return the factor that makes the standard deviations of the edge points match their scatter."""
    # A smooth edge hardly contributes to third differences, and the median ignores the magnet and the ends.
    ratios = []
    for side in (left, right):
        offset, variance = side.offset_px[side.sound], side.sigma_px[side.sound] ** 2
        expected = np.convolve(variance, _THIRD_DIFFERENCE**2, mode="valid")
        ratios.append(np.abs(np.convolve(offset, _THIRD_DIFFERENCE, mode="valid")) / np.sqrt(expected))
    return _NORMAL_MEDIAN * float(np.median(np.concatenate(ratios)))


def _locate(
    image: NDArray[Any],
    curves: Sequence[SmoothCurve],
    arc_lengths: Sequence[tuple[Array, int]],
    outward: Sequence[float],
    stations_px: Array,
    blur_px: float,
    fewest: int,
    cover: Cover | None = None,
) -> PassResult | None:
    """Locate edge points on lines across each curve; return None if a curve has fewer points than `fewest`."""
    # `arc_lengths` has, for each curve, the arc lengths of the lines and s: a dataset stores only every s-th point.
    # `outward` is +1 if the bright side is clockwise of the curve's direction, else -1. `stations_px` are the positions
    # along a line at which grey values are read.
    points, normals = [], []
    for curve, (place, _), sign in zip(curves, arc_lengths, outward, strict=True):
        line, tangent = curve.at(place[:, None] + _LINES_PX)
        points.append(line)
        normals.append(sign * normals_of(tangent))
    lines = np.concatenate(points), np.concatenate(normals)
    profiles, inside = read_profiles(image, *lines, stations_px)
    profiles /= light_along(image, *lines, stations_px, [len(place) for place, _ in arc_lengths])
    steps = fit_steps(stations_px, profiles, blur_px, inside, cover)
    sound = inside & steps.sound
    if not sound.any():
        return None
    # Dirt on an edge is not a clean step; its points would have errors larger than any noise.
    sound &= steps.residual <= max(4.0 * float(np.median(steps.residual[sound])), _CLEAN_RESIDUAL)
    # In grey levels: the step is higher beside the magnet than along the silicone, but the noise is the same.
    noise = float(np.sqrt(((steps.residual * (steps.bright - steps.dark))[sound] ** 2).mean()))
    sigma = np.maximum(noise * steps.sensitivity, 1e-6)

    sides: list[Side] = []
    done = 0
    for curve, (place, stride), sign in zip(curves, arc_lengths, outward, strict=True):
        rows = slice(done, done + len(place))
        done += len(place)
        if sound[rows].sum() < fewest:
            return None
        centre, tangent = curve.at(place)
        edge_points = centre + steps.offset_px[rows, None] * sign * normals_of(tangent)
        # The half level of a blurred curved edge lies inward by half the blur squared times the curvature.
        edge_points -= 0.5 * steps.blur_px**2 * curve.curvature(place)
        offset, common = steps.offset_px[rows], steps.common_px[rows]
        sides.append(Side(curve, edge_points, offset, sigma[rows], common, sound[rows], stride))
    return PassResult(tuple(sides), steps, stations_px, profiles, np.where(inside & steps.sound, steps.residual, 1.0))


def _inner_reach_px(half_px: float, cover_px: float, blur_px: float) -> float:
    # Return the distance (px) inside the edge up to which grey values are used; it ends before the magnet.
    return min(half_px, cover_px - 1.5 * blur_px) if cover_px > 3.0 * blur_px else half_px


def _smooth(points: Array, width_px: float) -> SmoothCurve:
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return SmoothCurve(points, max(1, round(length / (_PIECE_IN_WIDTHS * width_px))))


def _clear_of_ends(points: Array, margin: float) -> NDArray[np.bool_]:
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    return (distance >= margin) & (distance <= distance[-1] - margin)


def _arc_lengths(begin: float, end: float, spacing: float, widest: float) -> tuple[Array, int]:
    """Return the arc lengths at which an edge is searched, and a number s: every s-th point is stored."""
    length = max(end - begin, 0.0)
    gaps = min(int(length / spacing), MOST_POINTS - 1)
    gap = length / max(gaps, 1)
    # Between points that are far apart, further points are searched to estimate the scatter.
    stride = max(1, min(math.ceil(gap / widest), int(gap / AVERAGED_PX)))
    return np.linspace(begin, end, gaps * stride + 1), stride
