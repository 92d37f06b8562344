"""Prepare the recorded motion of a beam for a modal fit: fill gaps, replace outliers, and reduce the data.

A channel is one coordinate of one recorded point. The channels are linear combinations of a few signals, which also
fill the gaps (Beckers and Rixen 2003, J. Atmos. Oceanic Technol. 20:1839).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.time.measured import Motion

Array = NDArray[np.float64]

_LEAST_SEEN = 0.4  # share of the frames in which a point has to be seen
_FILLS = 30  # largest number of iterations that fill the gaps
_MOST_SIGNALS = 6
_OUTLIER = 7.0  # robust standard deviations
_NOT_DETERMINED = 1e-9  # mm: smaller stated noise is raised to this


class TooFewFrames(Exception):
    """A recording of a beam's motion has too few frames or points for the analysis."""


@dataclass(frozen=True)
class Signals:
    """The recorded motion of points of a beam, without gaps and outliers."""

    # n frames, c channels (coordinates of points) and r signals, whose linear combinations are the channels.

    # (n,): times of the frames.
    time_s: Array
    # (n, c): each of c channels, minus its median.
    channels_mm: Array
    # (c,): standard deviation of the noise of each channel.
    sigma_mm: Array
    # (c,): index of the point of each channel.
    points: NDArray[np.intp]
    # (c,): coordinate of each channel: 0 for x, 1 for y.
    axis: NDArray[np.intp]
    # (n, r): the r independent signals, with noise of about unit variance.
    reduced: Array
    # (r, c): weights of the signals in each channel, divided by the noise of the channel.
    patterns: Array
    # Fraction of the coordinates that were missing or outliers.
    filled: float

    def between(self, first_s: float, last_s: float) -> Signals:
        """Return the part of the motion between two times."""
        rows = (self.time_s >= first_s) & (self.time_s <= last_s)
        return Signals(
            self.time_s[rows], self.channels_mm[rows], self.sigma_mm, self.points, self.axis, self.reduced[rows],
            self.patterns, self.filled,
        )  # fmt: skip

    def in_mm(self, reduced: Array) -> Array:
        """Convert signals to displacements of points in mm."""
        # ``reduced`` (..., r) gives (..., c).
        return np.asarray(reduced @ self.patterns * self.sigma_mm)


def signals_of(motion: Motion, after_s: float = -np.inf) -> Signals:
    """Fill the gaps in a recorded motion, replace its outliers, and reduce it to a few signals.

    Frames with times before ``after_s`` are not used.

    Raises
    ------
    TooFewFrames
        Fewer than 8 frames can be used, or no point is visible in at least 40 % of the frames.
    """
    frame_s = _frame_times(motion)
    chosen = np.flatnonzero(np.isfinite(frame_s) & (frame_s >= after_s))
    chosen = chosen[np.argsort(frame_s[chosen], kind="stable")]
    chosen = chosen[np.append(True, np.diff(frame_s[chosen]) > 0)] if len(chosen) else chosen
    seen = motion.seen[chosen]
    points = np.flatnonzero(seen.mean(axis=0) >= _LEAST_SEEN) if len(chosen) else np.zeros(0, np.intp)
    enough = len(points) > 0
    if enough:
        rows = seen[:, points].any(axis=1)
        chosen, seen = chosen[rows], seen[rows]
    if not enough or len(chosen) < 8:
        raise TooFewFrames(
            f"{motion.label or 'the recording'}: {len(chosen) if enough else 0} frames can be used, but at least 8 are "
            f"needed; a point is used if at least {_LEAST_SEEN:.0%} of the frames show it, and a frame if it shows "
            "such a point"
        )
    time = frame_s[chosen]
    places = motion.points_mm[np.ix_(chosen, points)]
    late = motion.time_s[np.ix_(chosen, points)] - time[:, None]
    late = late - np.nanmean(np.where(seen[:, points], late, np.nan), axis=0)
    sigma = np.where(seen[:, points], motion.sigma_mm[np.ix_(chosen, points)], np.nan)
    noise = np.maximum(np.nanmedian(sigma, axis=0), _NOT_DETERMINED)
    values = np.where(seen[:, points, None], places, np.nan).reshape(len(chosen), -1)
    of_channel = np.repeat(noise, 2)
    values = values - np.nanmedian(values, axis=0)
    filled, missing = _filled(values / of_channel)
    late_of_channel = np.repeat(np.where(np.isfinite(late), late, 0.0), 2, axis=1)
    # A rolling shutter reads the rows of a frame one after another. A constant delay of a channel only changes its
    # phase. If the delay changes, the position is wrong by the change times the velocity.
    if np.any(late_of_channel):
        rate = np.gradient(filled, time, axis=0)
        filled = filled - rate * late_of_channel
    reduced, patterns = _reduced(filled)
    return Signals(
        time,
        filled * of_channel,
        of_channel,
        np.repeat(points, 2),
        np.tile(np.arange(2), len(points)),
        reduced,
        patterns,
        float(missing.mean()),
    )


def _frame_times(motion: Motion) -> Array:
    """Return the time of each frame in s, NaN if it is not known."""
    times = np.where(np.isfinite(motion.time_s), motion.time_s, np.nan)
    if not times.size:
        return np.zeros(len(times))
    some = np.isfinite(times).any(axis=1)
    middle = np.full(len(times), np.nan)
    if not some.any():
        return middle
    middle[some] = np.nanmedian(times[some], axis=1)
    # The time of a frame is the mean over its points, without the median delay of each point.
    lag = np.nanmedian(times[some] - middle[some, None], axis=0)
    middle[some] = np.nanmean(times[some] - lag, axis=1)
    return middle


def _filled(values: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Fill the gaps (NaN) and replace the outliers; return the result, and a mask of the replaced values."""
    # ``values`` (n, c): n frames of c channels.
    missing = ~np.isfinite(values)
    time = np.arange(len(values))
    start = values.copy()
    whole = ~missing.any(axis=0)
    base = np.ones((len(values), 1))
    if whole.any():  # the first values in a gap follow from the channels without gaps
        u, size, _ = np.linalg.svd(values[:, whole] - values[:, whole].mean(axis=0), full_matrices=False)
        base = np.hstack([base, (u * size)[:, : min(4, int(whole.sum()))]])
    for column in np.flatnonzero(~whole):
        gap = missing[:, column]
        if whole.any() and (~gap).sum() > 3 * base.shape[1]:
            start[gap, column] = base[gap] @ np.linalg.lstsq(base[~gap], values[~gap, column], rcond=None)[0]
        else:  # or they lie on the straight line between its ends
            start[gap, column] = np.interp(time[gap], time[~gap], values[~gap, column])
    if len(values) < 3 * values.shape[1] and not missing.any():
        return start, missing
    for attempt in range(2):
        if missing.any():
            rank = min(4, values.shape[1] - 1)
            for _ in range(_FILLS if rank > 0 else 0):
                level = start.mean(axis=0)
                u, s, v = np.linalg.svd(start - level, full_matrices=False)
                modelled = (u[:, :rank] * s[:rank]) @ v[:rank] + level
                change = np.abs(modelled - start)[missing].max()
                start[missing] = modelled[missing]
                if change < 0.1:
                    break
        if attempt or len(values) < 20 or values.shape[1] < 5:
            break
        level = start.mean(axis=0)
        u, s, v = np.linalg.svd(start - level, full_matrices=False)
        residual = start - level - (u[:, :4] * s[:4]) @ v[:4]
        scale = 1.4826 * np.median(np.abs(residual), axis=0) + 1e-12
        outliers = np.abs(residual) > _OUTLIER * np.maximum(scale, np.median(scale))
        if not outliers.any() or outliers.mean() > 0.05:
            break
        missing = missing | outliers
    return start, missing


def _reduced(values: Array) -> tuple[Array, Array]:
    """Reduce channels to a few signals by a singular value decomposition; return the signals and their weights."""
    # ``values`` (n, c) gives n frames of r signals (n, r) and the weights of the signals in each channel (r, c).
    level = values.mean(axis=0)
    _, s, v = np.linalg.svd(values - level, full_matrices=False)
    noise = np.sqrt(len(values))  # singular value of white noise of unit variance, nearly
    rank = int(np.clip(np.sum(s > 3 * noise), 1, _MOST_SIGNALS))
    patterns = v[:rank]
    # The product of signals and patterns is nearly ``values`` without the mean.
    return (values - level) @ patterns.T, patterns
