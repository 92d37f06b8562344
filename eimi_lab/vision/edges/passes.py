"""The two passes that place the edges: on normals to the outline, then on normals to the curve found."""

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

MOST_POINTS = 100  # a side
_WIDEST_SPACING = 0.11  # of the beam's width: between points farther apart the scatter is not told from the shape
_FEWEST_POINTS = 8  # a side: below, there is nothing to fit a curve to
_FEWEST_OF_TIP = 3
_TIP_SPACING_PX = 2.0
_TIP_PIECES = 8  # at least, however narrow the tip: those next to its corners are no clean steps
_FIRST_BLUR_PX = 1.2  # where the fit of the blur starts
_COARSE_HALF_PX = 10.0  # half length of a profile while the edge is known to a pixel and its blur is not
_COARSE_MARGIN_PX = 8.0  # left out at the ends of an edge meanwhile
_REACH_IN_BLURS = 4.0  # half length of a profile; also how far clamp and corners reach along an edge
_CLEAN_RESIDUAL = 0.03  # of the step; what is left over of a profile below this is never called dirt
_PIECE_IN_WIDTHS = 0.7  # length of a spline interval
_THIRD_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])
_NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over the median of its absolute values
_LINES_PX = np.arange(AVERAGED_PX) - 0.5 * (AVERAGED_PX - 1)


@dataclass(frozen=True)
class SiliconeMargin:
    """Silicone beside a magnet near the tip: its width on each side, and how far from the tip the magnet begins, px.

    tolerance_px: standard deviation of that width; a magnet is seldom cast right amid the beam.
    """

    width_px: float
    tolerance_px: float
    begins_px: float


@dataclass(frozen=True)
class Side:
    """A stretch of the outline and the n points of it that were looked for, from the clamp to the tip.

    points_px: (n, 2). offset_px: (n,) distance from ``curve``. sigma_px: (n,) standard deviation of the
    offset, up to a factor common to the frame (`scatter_scale`). common_px: (n,) the part of the deviation that
    neighbours share, beside it and up to the same factor. sound: (n,) where a step was found. every: which of the
    points were asked for; those between tell the scatter.
    """

    curve: SmoothCurve
    points_px: Array
    offset_px: Array
    sigma_px: Array
    common_px: Array
    sound: NDArray[np.bool_]
    every: int


@dataclass(frozen=True)
class PassResult:
    """What one pass found.

    stations_px: (m,) and profiles (n, m): grey values along the normals, outward. residual: (n,) of all profiles, 1
    where there is no step.
    """

    sides: tuple[Side, ...]
    steps: Steps
    stations_px: Array
    profiles: Array
    residual: Array

    @property
    def sound(self) -> NDArray[np.bool_]:
        """(n,) which profiles gave a point."""
        return np.concatenate([side.sound for side in self.sides])

    @property
    def near_clamp(self) -> NDArray[np.bool_]:
        """(n,) which sound profiles are of the half of their edge that is nearer to the clamp: no magnet is there."""
        half = [np.arange(len(side.sound)) < len(side.sound) // 2 for side in self.sides]
        return np.concatenate(half) & self.sound

    def plateau(self, outward: float) -> Array:
        """Grey values of the sound profiles outside (+1) or inside (-1) the beam, clear of the step or at the ends."""
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
    """Left edge, tip and right edge from a silhouette with corners; None where an edge is too short.

    The silicone beside the magnet gives a second, fainter step, which profiles do not reach here if it is wide. Where
    it is thin, the edge comes out inward by some tenths of a pixel, which the second pass mends.
    """
    if silhouette.corners is None:
        return None
    first, second = silhouette.corners
    outline = silhouette.outline_px
    half = min(_COARSE_HALF_PX, 0.4 * width_px)
    inner = _inner(half, margin.width_px, _FIRST_BLUR_PX)
    curves, places = [], []
    # The right edge is turned round, so that both run from the clamp to the tip.
    for points in (outline[: first + 1], outline[first : second + 1], outline[second:][::-1]):
        middle = points[_within(points, min(_COARSE_MARGIN_PX, 0.25 * width_px))]
        if len(middle) < 4:
            return None
        curve = _smooth(middle, width_px)
        curves.append(curve)
        spacing = min(_TIP_SPACING_PX, curve.length / _TIP_PIECES) if len(curves) == 2 else spacing_px
        places.append(_places(0.0, curve.length, spacing, _WIDEST_SPACING * width_px))
    return _locate(image, curves, places, (-hand, -hand, hand), stations(inner, half), _FIRST_BLUR_PX, _FEWEST_OF_TIP)


def second_pass(
    image: NDArray[Any],
    first: PassResult,
    corners_px: Array,
    hand: float,
    spacing_px: float,
    width_px: float,
    margin: SiliconeMargin,
) -> PassResult | None:
    """Left and right edge again, from corner to corner less what the blur of the corners reaches.

    first: of `first_pass`. corners_px: (4, 2) clamp-left, clamp-right, tip-left, tip-right. None where an edge is too
    short. The width of the silicone beside the magnet is found along with the edges, one on each side.
    """
    sides = (first.sides[0], first.sides[-1])
    if not np.isfinite(corners_px).all() or min(side.sound.sum() for side in sides) < _FEWEST_POINTS:
        return None
    blur_px = first.steps.blur_px
    reach = _REACH_IN_BLURS * blur_px
    clear = reach + 0.5 * AVERAGED_PX
    half = min(reach + 1.0, 0.4 * width_px)
    covered = 0.0 < margin.width_px < half + 2.0 * blur_px  # a wider one no profile sees
    curves, places, group = [], [], []
    for number, (side, start, end) in enumerate(zip(sides, corners_px[:2], corners_px[2:], strict=True)):
        curve = _smooth(side.points_px[side.sound], width_px)
        dense = np.arange(-width_px, curve.length + width_px, 0.5)
        points = curve.at(dense)[0]
        begin, finish = (float(dense[np.argmin(((points - corner) ** 2).sum(axis=1))]) for corner in (start, end))
        place = _places(begin + clear, finish - clear, spacing_px, _WIDEST_SPACING * width_px)
        curves.append(curve)
        places.append(place)
        # Where there is no magnet yet, the fainter step is found to have no height.
        group.append(np.where(covered & (place[0] > finish - margin.begins_px - reach), number, -1))
    cover = None
    if covered:
        two = np.ones(2)
        cover = Cover(np.concatenate(group), margin.width_px * two, margin.tolerance_px * two, _transmission(first))
    return _locate(image, curves, places, (-hand, hand), stations(half, half), blur_px, _FEWEST_POINTS, cover)


def _transmission(located: PassResult) -> float:
    """Silicone's share of the light, where no magnet is behind the edge."""
    near, steps = located.near_clamp, located.steps
    share = steps.dark[near] / np.maximum(steps.bright[near], 1e-9)
    return float(np.clip(np.median(share), 0.0, 1.0)) if near.any() else 0.0


def scatter_scale(left: Side, right: Side) -> float:
    """The factor that makes the points' standard deviations those of their scatter.

    The scatter is read from third differences along the edges: for independent offsets of standard deviations a, b,
    c, d theirs is the root of a² + 9b² + 9c² + d², and a smooth shape does not enter. Where a bent beam meets its stiff
    magnet, or a curve goes on straight beyond its end, the curve from which offsets count has another curvature than
    the edge; the median passes over those few places, where a root mean square would not.
    """
    ratios = []
    for side in (left, right):
        offset, variance = side.offset_px[side.sound], side.sigma_px[side.sound] ** 2
        expected = np.convolve(variance, _THIRD_DIFFERENCE**2, mode="valid")
        ratios.append(np.abs(np.convolve(offset, _THIRD_DIFFERENCE, mode="valid")) / np.sqrt(expected))
    return _NORMAL_MEDIAN * float(np.median(np.concatenate(ratios)))


def _locate(
    image: NDArray[Any],
    curves: Sequence[SmoothCurve],
    places: Sequence[tuple[Array, int]],
    outward: Sequence[float],
    stations_px: Array,
    blur_px: float,
    fewest: int,
    cover: Cover | None = None,
) -> PassResult | None:
    """Edge points at ``places`` (of `_places`) of each curve; outward: +1 where clockwise of the tangent is light."""
    points, normals = [], []
    for curve, (place, _), sign in zip(curves, places, outward, strict=True):
        line, tangent = curve.at(place[:, None] + _LINES_PX)
        points.append(line)
        normals.append(sign * normals_of(tangent))
    lines = np.concatenate(points), np.concatenate(normals)
    profiles, inside = read_profiles(image, *lines, stations_px)
    profiles /= light_along(image, *lines, stations_px, [len(place) for place, _ in places])
    steps = fit_steps(stations_px, profiles, blur_px, inside, cover)
    sound = inside & steps.sound
    if not sound.any():
        return None
    # Dirt on an edge is no clean step; its points would be wrong by more than any noise.
    sound &= steps.residual <= max(4.0 * float(np.median(steps.residual[sound])), _CLEAN_RESIDUAL)
    # In grey levels: beside the magnet the step is higher than along the silicone, and the noise is not.
    noise = float(np.sqrt(((steps.residual * (steps.bright - steps.dark))[sound] ** 2).mean()))
    sigma = np.maximum(noise * steps.sensitivity, 1e-6)

    sides: list[Side] = []
    done = 0
    for curve, (place, every), sign in zip(curves, places, outward, strict=True):
        rows = slice(done, done + len(place))
        done += len(place)
        if sound[rows].sum() < fewest:
            return None
        centre, tangent = curve.at(place)
        found = centre + steps.offset_px[rows, None] * sign * normals_of(tangent)
        # The half level of a blurred curved edge lies inward by half the blur squared times the curvature.
        found -= 0.5 * steps.blur_px**2 * curve.curvature(place)
        offset, common = steps.offset_px[rows], steps.common_px[rows]
        sides.append(Side(curve, found, offset, sigma[rows], common, sound[rows], every))
    return PassResult(tuple(sides), steps, stations_px, profiles, np.where(inside & steps.sound, steps.residual, 1.0))


def _inner(half_px: float, cover_px: float, blur_px: float) -> float:
    """How far a profile may reach into the beam so as not to meet the magnet's own edge."""
    return min(half_px, cover_px - 1.5 * blur_px) if cover_px > 3.0 * blur_px else half_px


def _smooth(points: Array, width_px: float) -> SmoothCurve:
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return SmoothCurve(points, max(1, round(length / (_PIECE_IN_WIDTHS * width_px))))


def _within(points: Array, margin: float) -> NDArray[np.bool_]:
    """Which of ordered points are farther than a margin from both ends, along them."""
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    return (distance >= margin) & (distance <= distance[-1] - margin)


def _places(begin: float, end: float, spacing: float, widest: float) -> tuple[Array, int]:
    """Evenly spaced arc lengths from begin to end, and which of them (every so many-th) are asked for.

    Those are at most `MOST_POINTS`. No two neighbours are farther apart than ``widest``, unless nearer ones would share
    light.
    """
    length = max(end - begin, 0.0)
    gaps = min(int(length / spacing), MOST_POINTS - 1)
    apart = length / max(gaps, 1)
    every = max(1, min(math.ceil(apart / widest), int(apart / AVERAGED_PX)))
    return np.linspace(begin, end, gaps * every + 1), every
