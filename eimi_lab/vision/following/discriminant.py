"""Colour projected to one number, 1 inside the beam and 0 outside, by what is on both sides of an edge there.

Fisher's linear discriminant (R. A. Fisher, Annals of Eugenics 7 (1936) 179) of the colours in a window along the edge,
so that nobody has to say which side is the darker one, and a background may change along the beam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter1d

from eimi_lab.vision.following.unrolled import ColourBins, UnrolledPicture

Array = NDArray[np.float64]

INSIDE_BAND = (0.08, 0.30)  # widths from the edge: clear of the blur, and not across a beam that is lit from one side
OUTSIDE_BAND = (0.08, 0.55)
_WINDOW = 1.5  # widths along the beam
_SHRINKAGE = 0.02  # of the mean variance, in every direction of colour: what a window is too short to know
_LIMITS = (-0.5, 1.5)  # of the projection: a reflection counts no more than that


@dataclass(frozen=True)
class ColourProjection:
    """share: (n, m) about 1 inside and 0 outside. separation: (n,) distance of the two in standard deviations.

    weight: (n, channels) and level: (n,): colour times weight, less the level, is 0 outside and 1 inside. step: (n,
    channels) by how much the inside is brighter.
    """

    share: Array
    separation: Array
    weight: Array
    level: Array
    step: Array


def project(
    unrolled: UnrolledPicture, edge: Array, outward: float, noise: float, shadowless: bool = False
) -> ColourProjection:
    """One side's projection. edge: (n,) place across, widths. outward: -1 for the left edge, +1 for the right.

    shadowless: one in which any share of the outside's colour is the same; of one channel there is none.
    """
    colours = unrolled.colours.astype(np.float64)
    distance = outward * (unrolled.across - edge[:, None])
    inside = (distance <= -INSIDE_BAND[0]) & (distance >= -INSIDE_BAND[1]) & unrolled.inside
    outside = (distance >= OUTSIDE_BAND[0]) & (distance <= OUTSIDE_BAND[1]) & unrolled.inside
    window = max(3, round(_WINDOW * unrolled.stations_in_width))
    mean_in, spread_in = _moments(colours, inside, window)
    mean_out, spread_out = _moments(colours, outside, window)
    spread = 0.5 * (spread_in + spread_out)
    channels = colours.shape[2]
    least = noise**2 + 1.0 + _SHRINKAGE * np.trace(spread, axis1=1, axis2=2) / channels
    spread = spread + least[:, None, None] * np.eye(channels)
    step = mean_in - mean_out
    weight = np.linalg.solve(spread, step[..., None])[..., 0]
    if shadowless:
        across = np.linalg.solve(spread, mean_out[..., None])[..., 0]
        share = (weight * mean_out).sum(axis=1) / np.maximum((across * mean_out).sum(axis=1), 1e-9)
        weight -= share[:, None] * across
    height = np.maximum((weight * step).sum(axis=1), 1e-9)
    weight /= height[:, None]
    level = (mean_out * weight).sum(axis=1)
    linear = np.clip(np.einsum("nmc,nc->nm", colours, weight) - level[:, None], *_LIMITS)
    if not shadowless:  # the histogram knows the shadow's colours by themselves
        linear = 0.5 * (linear + _histogram_ratio(unrolled.bins, inside, outside))
    return ColourProjection(linear, np.sqrt(height), weight, level, step)


def _moments(colours: Array, mask: NDArray[np.bool_], window: int) -> tuple[Array, Array]:
    """Mean (n, c) and covariance (n, c, c) of the masked colours within a window along the beam."""
    share = mask.astype(np.float64)
    count = share.sum(axis=1)
    weighted = share[..., None] * colours
    total = weighted.sum(axis=1)
    square = np.swapaxes(weighted, 1, 2) @ colours
    count, total, square = (uniform_filter1d(part, window, axis=0, mode="nearest") for part in (count, total, square))
    count = np.maximum(count, 1e-3)
    mean = total / count[:, None]
    return mean, square / count[:, None, None] - mean[:, :, None] * mean[:, None, :]


def _histogram_ratio(bins: ColourBins, inside: NDArray[np.bool_], outside: NDArray[np.bool_]) -> Array:
    """(n, m) probability that a colour is of the inside, by histograms of the whole trace."""
    counts = []
    for mask in (inside, outside):
        count = np.bincount(bins.index[mask], minlength=bins.total).reshape(bins.shape).astype(np.float64)
        count = gaussian_filter(count, 0.7, mode="constant")
        counts.append(count.ravel() / max(count.sum(), 1e-9))
    rare = 0.05 / bins.total  # a colour never seen speaks for neither
    return np.asarray((counts[0] + rare) / (counts[0] + counts[1] + 2.0 * rare))[bins.index]
