"""Divide a recording in which the beam was pushed briefly several times into parts, one for each push."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LEAST = 0.15  # share of the amplitude of the largest flick; smaller motions are not flicks
_RISE = 3.0  # factor by which the amplitude rises at a flick
_OVER_NOISE = 8.0  # smallest ratio of the amplitude of a flick to the amplitude of the noise
FEWEST_PERIODS = 6.0  # smallest number of periods for which a part has to show the swinging beam


def parts_of(frame_s: Array, points_mm: Array) -> list[tuple[int, int]]:
    """Divide a recording into parts, each with one free oscillation after a brief push of the beam.

    Parameters
    ----------
    frame_s : ndarray, shape (n,)
        Times of the n frames, s.
    points_mm : ndarray, shape (n, p, 2)
        Positions of p points (x along the straight beam from the clamp, y across), mm; NaN for a missing point.

    Returns
    -------
    list of (int, int)
        For each part, the number of the first frame, and the number of the last frame plus 1; (0, n) if the recording
        cannot be divided.
    """
    whole = [(0, len(frame_s))]
    moved = _deflection(points_mm)
    if moved is None:
        return whole
    rate_Hz = 1.0 / float(np.median(np.diff(frame_s)))
    frames = _period(moved, rate_Hz)
    if not 2 < frames < len(moved) / (2 * FEWEST_PERIODS):
        return whole
    slow = scipy.ndimage.median_filter(moved, size=min(len(moved), 4 * frames) | 1, mode="nearest")
    size = scipy.ndimage.maximum_filter1d(np.abs(moved - slow), size=frames | 1)
    floor = float(np.quantile(size, 0.1))
    noise = _white_noise(moved, frames)
    least = max(
        _LEAST * float(size.max()), _OVER_NOISE * floor if floor < 0.05 * size.max() else 0.0, _OVER_NOISE * noise
    )
    ending = np.append(np.maximum(size, 1e-9), 1e-9)  # with an end at rest, only the rise of the last flick counts
    highest, _ = scipy.signal.find_peaks(
        np.log(ending), height=np.log(least), prominence=np.log(_RISE), distance=3 * frames
    )
    peaks = [int(peak) for peak in highest if _is_abrupt(size, int(peak), frames)]
    if len(peaks) < 2:
        return whole
    calm = size + np.abs(slow)  # large also for a beam that is held away from its position at rest
    valleys = [int(first + np.argmin(calm[first:last])) for first, last in pairwise(peaks)]
    ends = [0, *(max(valley - frames // 2, 1) for valley in valleys), len(frame_s)]
    parts = list(pairwise(ends))
    long = [
        (first, last)
        for (first, last), peak in zip(parts, peaks, strict=True)
        if last - peak >= FEWEST_PERIODS * frames
    ]
    return long or whole


def _is_abrupt(size: Array, peak: int, frames: int) -> bool:
    """Return whether a maximum of the amplitude is the start of a free oscillation; False for a beat of two vibrations.

    ``size`` is the amplitude in n frames (n,), ``peak`` the frame of the maximum, ``frames`` the period in frames.
    """
    low = size[peak] / _RISE
    before, after = np.flatnonzero(size[:peak] < low), np.flatnonzero(size[peak:] < low)
    rise = peak - (int(before[-1]) if len(before) else 0)
    fall = int(after[0]) if len(after) else len(size) - peak
    return rise <= max(1.5 * frames, 0.75 * fall)


def _deflection(points_mm: Array) -> Array | None:
    """Return the deflection of the point that moves most, in each of n frames, mm, shape (n,).

    `points_mm` has the shape (n, p, 2). Missing values are interpolated. The result is None if too many are missing.
    """
    is_seen = np.isfinite(points_mm[..., 1])
    often = is_seen.mean(axis=0) > 0.5
    if not often.any():
        return None
    spread = np.zeros(len(often))
    spread[often] = np.nanstd(np.where(is_seen, points_mm[..., 1], np.nan)[:, often], axis=0)
    place = points_mm[:, int(np.argmax(spread)), 1]
    good = np.flatnonzero(np.isfinite(place))
    filled = np.interp(np.arange(len(place)), good, place[good])
    return np.asarray(filled - np.median(filled))


def _white_noise(moved: Array, frames: int) -> float:
    """Return the standard deviation of white noise in the deflection ``moved`` of a vibrating point, mm, shape (n,).

    The spectrum above 1.5 times the vibration frequency is used. ``frames`` is the period in frames.
    """
    power = np.abs(np.fft.rfft(moved - moved.mean())) ** 2
    first = min(round(1.5 * len(moved) / frames), len(power) - 2)
    return float(np.sqrt(np.median(power[first:]) / (np.log(2.0) * len(moved))))


def _period(moved: Array, rate_Hz: float) -> int:
    """Return the period of the strongest vibration, in frames, in the deflection ``moved``, shape (n,)."""
    n = len(moved)
    power = np.abs(np.fft.rfft(np.diff(moved) * np.hanning(n - 1), 2 * n)) ** 2  # a difference suppresses slow motion
    frequency = np.fft.rfftfreq(2 * n, 1.0 / rate_Hz)
    power[frequency < 3.0 * rate_Hz / n] = 0.0
    power[frequency > 0.3 * rate_Hz] = 0.0
    best = float(frequency[int(np.argmax(power))])
    return round(rate_Hz / best) if best > 0 else n
