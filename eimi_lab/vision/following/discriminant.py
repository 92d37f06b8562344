"""Convert the colours at an edge to one number, which is 1 inside the beam and 0 outside, by Fisher's discriminant.

    number = w · (colour - m_out),    w = C⁻¹ (m_in - m_out) / ((m_in - m_out) · C⁻¹ (m_in - m_out)).

Here m_in and m_out are the mean colours inside and outside near the edge, and C is the mean of the two covariances of
these colours (R. A. Fisher, Annals of Eugenics 7 (1936) 179).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_lab.vision.following.unrolled import ColourBins, UnrolledPicture

Array = NDArray[np.float64]

INSIDE_BAND = (0.08, 0.30)  # widths from the edge: clear of its blur, and not far into a beam that is lit from one side
OUTSIDE_BAND = (0.08, 0.55)
BODY_BAND = (0.3, 0.7)  # from the border of a possible shadow: the middle of the beam, also behind a shadow
_WINDOW = 1.5  # widths along the beam
_SHRINKAGE = 0.02  # of the mean variance, added to every colour direction: a window has few samples
_LIMITS = (-0.5, 1.5)  # of the projection, to limit the effect of a reflection


@dataclass(frozen=True)
class ColourProjection:
    """A weighted sum of the colour channels that is about 1 inside the beam and 0 outside, for one edge of the beam.

    The straightened picture of the beam has n rows, which cross the beam, and m columns.

    Attributes
    ----------
    share : ndarray, shape (n, m)
        The weighted sum at each point.
    separation : ndarray, shape (n,)
        Difference between the mean colours inside and outside, in standard deviations of the weighted sum.
    weight : ndarray, shape (n, channels)
        Weight of each colour channel.
    level : ndarray, shape (n,)
        Number that is subtracted from the weighted sum, so that it is 0 outside.
    step : ndarray, shape (n, channels)
        Mean colour inside minus mean colour outside.
    """

    share: Array
    separation: Array
    weight: Array
    level: Array
    step: Array


def project(
    unrolled: UnrolledPicture,
    edge: Array,
    outward: float,
    noise: float,
    shadowless: bool = False,
    inside_band: tuple[float, float] = INSIDE_BAND,
) -> ColourProjection:
    """Compute the weighted sum of the colour channels that is about 1 inside the beam and 0 outside, near one edge.

    Parameters
    ----------
    unrolled : UnrolledPicture
        The straightened picture of the beam, with n rows across the beam.
    edge : ndarray, shape (n,)
        Position of the edge across the beam, in widths of the beam.
    outward : float
        -1 for the left edge, +1 for the right edge.
    noise : float
        Standard deviation of the noise of a colour channel, in grey levels from 0 to 255.
    shadowless : bool
        Whether to use only weighted sums in which a shadow on the surroundings is invisible. A picture with one channel
        has no such sum.
    inside_band : tuple of float
        Least and largest distance from the edge of the colours that count as inside, in widths of the beam.

    Returns
    -------
    ColourProjection
        The weights, and the weighted sum at each point.
    """
    colours = unrolled.colours.astype(np.float64)
    distance = outward * (unrolled.across - edge[:, None])
    inside = (distance <= -inside_band[0]) & (distance >= -inside_band[1]) & unrolled.inside
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
        # the outside colour and all its multiples, the colours of a shadow, then have the same value
        across = np.linalg.solve(spread, mean_out[..., None])[..., 0]
        share = (weight * mean_out).sum(axis=1) / np.maximum((across * mean_out).sum(axis=1), 1e-9)
        weight -= share[:, None] * across
    height = np.maximum((weight * step).sum(axis=1), 1e-9)
    weight /= height[:, None]
    level = (mean_out * weight).sum(axis=1)
    linear = np.clip(np.einsum("nmc,nc->nm", colours, weight) - level[:, None], *_LIMITS)
    if not shadowless:  # a histogram would separate the colours of the shadow
        linear = 0.5 * (linear + _beam_probability(unrolled.bins, inside, outside))
    if unrolled.covered is not None:
        linear[unrolled.covered] = 0.5  # neither inside nor outside
    return ColourProjection(linear, np.sqrt(height), weight, level, step)


def _moments(colours: Array, mask: NDArray[np.bool_], window: int) -> tuple[Array, Array]:
    share = mask.astype(np.float64)
    count = share.sum(axis=1)
    weighted = share[..., None] * colours
    total = weighted.sum(axis=1)
    square = np.swapaxes(weighted, 1, 2) @ colours
    count, total, square = (
        scipy.ndimage.uniform_filter1d(part, window, axis=0, mode="nearest") for part in (count, total, square)
    )
    count = np.maximum(count, 1e-3)
    mean = total / count[:, None]
    return mean, square / count[:, None, None] - mean[:, :, None] * mean[:, None, :]


def _beam_probability(bins: ColourBins, inside: NDArray[np.bool_], outside: NDArray[np.bool_]) -> Array:
    counts = []
    for mask in (inside, outside):
        count = np.bincount(bins.index[mask], minlength=bins.total).reshape(bins.shape).astype(np.float64)
        count = scipy.ndimage.gaussian_filter(count, 0.7, mode="constant")
        counts.append(count.ravel() / max(count.sum(), 1e-9))
    rare = 0.05 / bins.total  # a colour that does not occur is evidence for neither side
    return np.asarray((counts[0] + rare) / (counts[0] + counts[1] + 2.0 * rare))[bins.index]
