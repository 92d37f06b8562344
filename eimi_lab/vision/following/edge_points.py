"""Locate points of the beam's edges in the original image by fitted steps of grey values, and estimate their scatter.

The edges are known to about a pixel before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_lab.vision.edges.curve import SmoothCurve
from eimi_lab.vision.edges.profiles import AVERAGED_PX, Steps, fit_steps, normals_of, read_profiles, stations
from eimi_lab.vision.following.discriminant import ColourProjection
from eimi_lab.vision.following.support import Sides
from eimi_lab.vision.following.unrolled import UnrolledPicture

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_POINTS = 100  # on each side
_PIECE = 0.7  # widths: interval of the spline along an edge
_COARSE_HALF = 0.22  # widths: half length of a profile in the first pass; the seam is known to a twentieth of a width
_LEAST_HALF_PX = 3.0
_FIRST_BLUR_PX = 1.2
_REACH_IN_BLURS = 4.0
_CLEAR_IN_BLURS = 2.5  # distance from the edge at which the light beside it is read
_BESIDE_PX = 5.0  # length of the stretch over which it is read
_DEEPEST = 0.4  # widths: the stretch inside the beam ends before the other edge's blur
_NEIGHBOURS = 10  # on each side, that share one slope of the light
_STEEPEST_PER_PX = 0.04  # of the step; a larger slope is another body
_EVEN = 0.03  # of the step: largest RMS residual of a line
_HEIGHT = (0.3, 3.0)  # least and largest height of a fitted step; a full step is 1
_FEWEST = 8  # points of an edge
_OFF = 4.0  # standard deviations from the smooth line: an outlier
_SHAPE_PIECES = 5  # cubic pieces that the edge of a bent beam needs at most; their residuals are scatter
_LEAST_SIGMA_PX = 0.003
_NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over its median absolute value


@dataclass(frozen=True)
class StripEdges:
    """The n located points of one edge of a beam, in pixels of the image, from the clamp outward.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        The points.
    sigma : ndarray, shape (n,)
        Standard deviation of each point along the normal of the edge.
    along : ndarray, shape (n,)
        Distance from the clamp, in widths of the beam.
    blur_px : float
        Standard deviation of the blur of the edge.
    """

    points: Array
    sigma: Array
    along: Array
    blur_px: float


def locate_edge(
    image: NDArray[Any], unrolled: UnrolledPicture, sides: Sides, side: int, spacing_px: float
) -> StripEdges | None:
    """Locate the points of one edge in the original image, after the beam was followed from its clamp.

    Parameters
    ----------
    image : ndarray, shape (H, W, channels)
        Grey values from 0 to 255; H rows, W columns.
    unrolled : UnrolledPicture
        The straightened picture of the beam.
    sides : Sides
        Both edges in the straightened picture.
    side : int
        0 for the left edge, 1 for the right edge.
    spacing_px : float
        Desired distance between the points.

    Returns
    -------
    StripEdges or None
        None if the edge has fewer than eight points.
    """
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
        sure = sides.sound[side][station]
        place, station = place[sure], station[sure]
        if len(place) < _FEWEST:
            return None
        points, steps, kept = edge.fitted(curve, place, station, half, blur, level=final)
        if kept.sum() < _FEWEST:
            return None
        blur = steps.blur_px
        half = float(np.clip(_REACH_IN_BLURS * blur + 1.0, _LEAST_HALF_PX, half))
        curve = SmoothCurve(points[kept], max(1, round(curve.length / (_PIECE * width_px))))
    points, sigma, inliers = estimate_scatter(points[kept], steps.sensitivity[kept])
    return StripEdges(points[inliers], sigma[inliers], unrolled.along[station[kept][inliers]], blur)


def _nearest(points: Array, seam: Array) -> NDArray[np.int64]:
    return np.asarray(scipy.spatial.cKDTree(seam).query(points)[1])


@dataclass(frozen=True)
class _Edge:
    """One edge of the beam in an image, and the weights with which the colours are added to a grey value.

    `outward`: +1 if the outside of the beam lies clockwise of the tangent of the edge, else -1.
    """

    image: NDArray[Any]
    projected: ColourProjection
    outward: float
    width_px: float

    def fitted(
        self, curve: SmoothCurve, place: Array, station: NDArray[np.int64], half: float, blur: float, level: bool
    ) -> tuple[Array, Steps, Mask]:
        # Fit a step of the grey value across a curve at each of n places, to locate the points of an edge. The result
        # is the points in px, the fitted steps, and whether each step is clear.
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
        """Return the weighted sums of the colours on lines across a curve, and whether each line is in the image."""
        lines = np.arange(AVERAGED_PX) - 0.5 * (AVERAGED_PX - 1)
        at, tangent = curve.at(place[:, None] + lines)
        normals = self.outward * normals_of(tangent)
        colours, inside = read_profiles(self.image, at, normals, u)
        share = np.einsum("nmc,nc->nm", colours, self.projected.weight[station])
        return 1.0 + self.projected.level[station][:, None] - share, inside

    def _slopes(self, curve: SmoothCurve, place: Array, station: NDArray[np.int64], u: Array, blur: float) -> Array:
        """Return the contribution of uneven light to the grey values on n lines across an edge, shape (n, m).

        `u`: distances from the edge at which each line is read, px, shape (m,).
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
            slope = _common(*_slopes_of_lines(beside, away))
            z = way * u / blur
            ramp = way * blur * (np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) + z * scipy.special.ndtr(z))
            added += slope[:, None] * ramp
        return added


def _slopes_of_lines(profiles: Array, places: Array) -> tuple[Array, Array]:
    away = places - places.mean()
    slope = (profiles @ away) / (away @ away)
    residuals = profiles - profiles.mean(axis=1, keepdims=True) - slope[:, None] * away
    return slope, np.sqrt((residuals**2).mean(axis=1))


def _common(slope: Array, residual_rms: Array) -> Array:
    # the median slope of the neighbouring profiles; 0 where a straight line fits few of these profiles
    even = (np.abs(slope) < _STEEPEST_PER_PX) & (residual_rms < max(_EVEN, 2.0 * float(np.median(residual_rms))))
    padded = np.pad(np.where(even, slope, np.nan), _NEIGHBOURS, constant_values=np.nan)
    neighbours = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1)
    measured = np.isfinite(neighbours).mean(axis=1) > 0.3
    common = np.zeros(len(slope))
    common[measured] = np.nanmedian(neighbours[measured], axis=1)
    return common


def estimate_scatter(points: Array, sensitivity: Array) -> tuple[Array, Array, Mask]:
    """Estimate the standard deviations of edge points from their scatter about a smooth line, and detect outliers.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        The n points of one edge, in order.
    sensitivity : ndarray, shape (n,)
        Standard deviation of each point, up to a factor that all points share.

    Returns
    -------
    points : ndarray, shape (n, 2)
        The points, unchanged.
    sigma : ndarray, shape (n,)
        Standard deviation of each point along the normal of the edge.
    kept : ndarray of bool, shape (n,)
        False for an outlier: more than four standard deviations from the smooth line.
    """
    # Differences of neighbouring points would give too small a scatter: texture displaces neighbours alike.
    kept = np.ones(len(points), dtype=bool)
    offset, freedom = _off_smooth_line(points, kept)
    for _ in range(3):
        scale = _NORMAL_MEDIAN * float(np.median(np.abs(offset[kept])))
        inliers = np.abs(offset) < _OFF * max(scale, _LEAST_SIGMA_PX)
        if (inliers == kept).all() or inliers.sum() < _FEWEST:
            break
        kept = inliers
        offset, freedom = _off_smooth_line(points, kept)
    relative = np.clip(sensitivity / np.median(sensitivity[kept]), 0.5, 3.0)
    relative /= np.sqrt((relative[kept] ** 2).mean())  # the scatter of texture does not grow with the sensitivity
    scatter = float(np.sqrt((offset[kept] ** 2).sum() / freedom))
    return points, np.maximum(scatter * relative, _LEAST_SIGMA_PX), kept


def _off_smooth_line(points: Array, kept: Mask) -> tuple[Array, float]:
    """Return the signed distances of edge points from a fitted spline, and the degrees of freedom of the fit."""
    # pieces with equally many points would be too long where points are few
    curve = SmoothCurve(points[kept], int(np.clip(kept.sum() // 6, 1, _SHAPE_PIECES)), equal=True)
    at, tangent = curve.at(np.linspace(0.0, curve.length, 8 * len(points)))
    nearest = _nearest(points, at)
    offset = ((points - at[nearest]) * normals_of(tangent[nearest])).sum(axis=1)
    return np.asarray(offset), max(1.0, float(kept.sum() - curve.pieces - 3))
