"""The followed edges in the picture itself: the blurred step fitted on their normals, and the points' true scatter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from eimi_lab.vision.edges.curve import SmoothCurve
from eimi_lab.vision.edges.profiles import AVERAGED_PX, Steps, fit_steps, normals_of, read_profiles, stations
from eimi_lab.vision.following.discriminant import ColourProjection
from eimi_lab.vision.following.support import Sides
from eimi_lab.vision.following.unrolled import UnrolledPicture

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_POINTS = 100  # a side
_PIECE = 0.7  # widths: a spline's interval along an edge
_COARSE_HALF = 0.22  # widths: half a profile's length while the seam is known to a twentieth of a width
_LEAST_HALF_PX = 3.0
_FIRST_BLUR_PX = 1.2
_REACH_IN_BLURS = 4.0
_CLEAR_IN_BLURS = 2.5  # of the edge, where the light beside it is read,
_BESIDE_PX = 5.0  # over so many pixels
_DEEPEST = 0.4  # widths: farther in is the other edge's
_NEIGHBOURS = 10  # on each side, whose light is taken for one
_STEEPEST_PER_PX = 0.04  # of the step
_EVEN = 0.03  # of the step: what a line may leave
_HEIGHT = (0.3, 3.0)  # of a step, in whole ones
_FEWEST = 8
_OFF = 4.0  # standard deviations from the smooth line: no point of it
_SHAPE_PIECES = 5  # cubic pieces that a bent beam's edge needs at most; what is left of them is scatter
_LEAST_SIGMA_PX = 0.003
_NORMAL_MEDIAN = 1.4826


@dataclass(frozen=True)
class StripEdges:
    """One edge in pixels, from the clamp outward.

    points: (n, 2). sigma: (n,) standard deviation along the normal. along: (n,) stated widths from the clamp.
    """

    points: Array
    sigma: Array
    along: Array
    blur_px: float


def place_side(
    image: NDArray[Any], unrolled: UnrolledPicture, sides: Sides, side: int, spacing_px: float
) -> StripEdges | None:
    """The left (0) or right (1) edge in an image (height, width, channels); None where there is too little of it."""
    sound = np.flatnonzero(sides.sound[side][: sides.end])
    if len(sound) < _FEWEST:
        return None
    width_px = float(np.linalg.norm(unrolled.aside[0]))
    seam = unrolled.middle + sides.edge[side][:, None] * unrolled.aside
    edge = _Edge(image, sides.projected[side], (-1.0, 1.0)[side], width_px)
    curve = SmoothCurve(seam[sound], max(1, round(len(sound) / unrolled.stations_in_width / _PIECE)))
    blur, half = _FIRST_BLUR_PX, max(_LEAST_HALF_PX, _COARSE_HALF * width_px)
    for final in (False, True):
        count = int(np.clip(round(curve.length / max(spacing_px, AVERAGED_PX)), _FEWEST, MOST_POINTS - 1))
        place = np.linspace(0.0, curve.length, count + 1)
        station = _nearest(curve.at(place)[0], seam)
        trusted = sides.sound[side][station]
        place, station = place[trusted], station[trusted]
        if len(place) < _FEWEST:
            return None
        points, steps, kept = edge.fitted(curve, place, station, half, blur, level=final)
        if kept.sum() < _FEWEST:
            return None
        blur = steps.blur_px
        half = float(np.clip(_REACH_IN_BLURS * blur + 1.0, _LEAST_HALF_PX, half))
        curve = SmoothCurve(points[kept], max(1, round(curve.length / (_PIECE * width_px))))
    points, sigma, near = with_scatter(points[kept], steps.sensitivity[kept])
    return StripEdges(points[near], sigma[near], unrolled.along[station[kept][near]], blur)


def _nearest(points: Array, seam: Array) -> NDArray[np.int64]:
    return np.asarray(cKDTree(seam).query(points)[1])


@dataclass(frozen=True)
class _Edge:
    """What profiles across one edge are read from. outward: +1 where clockwise of the curve's tangent is outside."""

    image: NDArray[Any]
    projected: ColourProjection
    outward: float
    width_px: float

    def fitted(
        self, curve: SmoothCurve, place: Array, station: NDArray[np.int64], half: float, blur: float, level: bool
    ) -> tuple[Array, Steps, Mask]:
        """Places of the edge (n, 2) at arc lengths of a curve, the steps, and which were found.

        level: whether the light beside the edge is made level first, which wants to know where the edge is.
        """
        u = stations(half, half)
        profiles, inside = self._profiles(curve, place, station, u)
        if level:
            profiles -= self._slopes(curve, place, station, u, blur)
        steps = fit_steps(u, profiles, blur, inside)
        centre, tangent = curve.at(place)
        points = centre + steps.offset_px[:, None] * self.outward * normals_of(tangent)
        # The half level of a blurred curved edge lies inward by half the blur squared times the curvature.
        points -= 0.5 * steps.blur_px**2 * curve.curvature(place)
        height = steps.bright - steps.dark
        return points, steps, inside & steps.sound & (height > _HEIGHT[0]) & (height < _HEIGHT[1])

    def _profiles(self, curve: SmoothCurve, place: Array, station: NDArray[np.int64], u: Array) -> tuple[Array, Mask]:
        """(n, m) about 0 inside and 1 outside, along the normals at the places; and which lie in the frame."""
        lines = np.arange(AVERAGED_PX) - 0.5 * (AVERAGED_PX - 1)
        at, tangent = curve.at(place[:, None] + lines)
        normals = self.outward * normals_of(tangent)
        colours, inside = read_profiles(self.image, at, normals, u)
        share = np.einsum("nmc,nc->nm", colours, self.projected.weight[station])
        return 1.0 + self.projected.level[station][:, None] - share, inside

    def _slopes(self, curve: SmoothCurve, place: Array, station: NDArray[np.int64], u: Array, blur: float) -> Array:
        """(n, m) what shading of the beam and light or shadow beside it add to the profiles, 0 at the edge.

        Each side's slope is read clear of the edge, as the median of neighbours, and blurred as the edge is.
        """
        clear = _CLEAR_IN_BLURS * blur
        added = np.zeros((len(place), len(u)))
        for way in (-1.0, 1.0):
            far = clear + _BESIDE_PX
            far = min(far, _DEEPEST * self.width_px) if way < 0.0 else far
            away = way * np.arange(clear, far + 0.25, 0.5)
            if far - clear < 0.5 * _BESIDE_PX:
                continue
            beside, _ = self._profiles(curve, place, station, away)
            slope = _common(*_line_through(beside, away))
            z = way * u / blur
            ramp = way * blur * (np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) + z * ndtr(z))
            added += slope[:, None] * ramp
        return added


def _line_through(profiles: Array, places: Array) -> tuple[Array, Array]:
    """Slopes (n,) of profiles (n, m), and the root mean squares (n,) of what a line leaves of each."""
    away = places - places.mean()
    slope = (profiles @ away) / (away @ away)
    left_over = profiles - profiles.mean(axis=1, keepdims=True) - slope[:, None] * away
    return slope, np.sqrt((left_over**2).mean(axis=1))


def _common(slope: Array, left_over: Array) -> Array:
    """(n,) the median of neighbours' slopes; 0 where most of them are too steep or no lines: that is another body."""
    even = (np.abs(slope) < _STEEPEST_PER_PX) & (left_over < max(_EVEN, 2.0 * float(np.median(left_over))))
    padded = np.pad(np.where(even, slope, np.nan), _NEIGHBOURS, constant_values=np.nan)
    near = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1)
    known = np.isfinite(near).mean(axis=1) > 0.3
    common = np.zeros(len(slope))
    common[known] = np.nanmedian(near[known], axis=1)
    return common


def with_scatter(points: Array, sensitivity: Array) -> tuple[Array, Array, Mask]:
    """Points, their standard deviations, and which are near a smooth line; the scatter is what that line leaves.

    Neighbours err alike on a real picture, by texture and uneven light; that is in the residuals of a line of few
    pieces, and in no difference of neighbours. sensitivity: (n,) to noise, of any unit.
    """
    kept = np.ones(len(points), dtype=bool)
    offset, freedom = _off_smooth_line(points, kept)
    for _ in range(3):
        scale = _NORMAL_MEDIAN * float(np.median(np.abs(offset[kept])))
        now = np.abs(offset) < _OFF * max(scale, _LEAST_SIGMA_PX)
        if (now == kept).all() or now.sum() < _FEWEST:
            break
        kept = now
        offset, freedom = _off_smooth_line(points, kept)
    relative = np.clip(sensitivity / np.median(sensitivity[kept]), 0.5, 3.0)
    scatter = float(np.sqrt(((offset[kept] / relative[kept]) ** 2).sum() / freedom))
    return points, np.maximum(scatter * relative, _LEAST_SIGMA_PX), kept


def _off_smooth_line(points: Array, kept: Mask) -> tuple[Array, float]:
    """Signed distances (n,) from a spline of few pieces through the kept points, and its degrees of freedom.

    The pieces are equally long: where points are few, a piece that has to hold as many as the others would be too long
    for the edge's shape, and what it leaves of that is no scatter.
    """
    curve = SmoothCurve(points[kept], int(np.clip(kept.sum() // 6, 1, _SHAPE_PIECES)), equal=True)
    at, tangent = curve.at(np.linspace(0.0, curve.length, 8 * len(points)))
    nearest = _nearest(points, at)
    offset = ((points - at[nearest]) * normals_of(tangent[nearest])).sum(axis=1)
    return np.asarray(offset), max(1.0, float(kept.sum() - curve.pieces - 3))
