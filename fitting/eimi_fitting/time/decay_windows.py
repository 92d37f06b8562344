"""Frequency and loss factor of a free vibration in time windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.time.modal_fit import ModalFit, exponent, wave

Array = NDArray[np.float64]

_MOST_WINDOWS = 8
_SHORTEST_PERIODS = 2.5  # duration of a window
_CHANGED_FREQUENCY = 0.03  # relative change of the frequency that no amplitude below 5 % of the length explains
_CHANGED_LOSS = 1.0  # relative change of the loss factor that no amplitude below 5 % of the length explains
_SMALL = 0.2  # share of the amplitude in the first window
_CERTAIN = 5.0  # standard deviations of such a change


@dataclass(frozen=True)
class Window:
    """Frequency and loss factor of a free vibration in one time window."""

    # `from_s`, `to_s`: start and end.
    from_s: float
    to_s: float
    # Amplitude at the middle, where the beam moves most.
    amplitude_mm: float
    # `frequency_Hz`, `loss`: frequency and loss factor.
    frequency_Hz: float
    loss: float
    # `frequency_sigma_Hz`, `loss_sigma`: their standard uncertainties due to noise.
    frequency_sigma_Hz: float
    loss_sigma: float
    # Whether the window is used to identify the material.
    is_used: bool = True


def windows_of(fitted: ModalFit) -> tuple[Window, ...]:
    """Fit frequency and loss factor of a free vibration in time windows of equal duration."""
    time, amplitude = fitted.signals.time_s, fitted.amplitude_mm()
    period = 1 / fitted.frequency_Hz
    halvings = np.log2(max(float(amplitude[0] / amplitude[-1]), 1.0))
    longest = (time[-1] - time[0]) / (_SHORTEST_PERIODS * period)
    count = int(np.clip(min(max(round(halvings), 2), longest), 1, _MOST_WINDOWS))
    frames = len(time) / count
    if frames < 12:
        count = max(1, len(time) // 12)
    ends = np.linspace(time[0], time[-1], count + 1)
    signals = fitted.signals.reduced
    windows = []
    for first, last in pairwise(ends):
        rows = (time >= first) & (time <= last)
        t, z = time[rows] - first, signals[rows]
        if len(t) < 10:
            continue
        slow = np.vander(t / max(float(t[-1]), 1e-9), 3)

        def residuals(x: Array, t: Array = t, z: Array = z, slow: Array = slow) -> Array:
            psi = exponent(t, x, np.zeros(0))
            orthogonal, _ = np.linalg.qr(np.column_stack([*wave(psi), *wave(2 * psi), slow]))
            return np.asarray((z - orthogonal @ (orthogonal.T @ z)).ravel())

        solved = scipy.optimize.least_squares(
            residuals, fitted.modes[0], method="lm", x_scale=[1e-3, 1e-2], diff_step=1e-6
        )
        spread = np.sqrt((solved.fun**2).sum() / max(solved.fun.size - 2 - 4 * z.shape[1], 1))
        sigma = spread * np.sqrt(np.diag(np.linalg.pinv(solved.jac.T @ solved.jac)))
        frequency = float(np.exp(solved.x[0]) / (2 * np.pi))
        if not 0.5 < frequency * period < 2 or sigma[0] > 0.1 or sigma[1] > 0.5 * fitted.modes[0, 1]:
            continue
        windows.append(
            Window(
                float(first),
                float(last),
                float(np.interp(0.5 * (first + last), time, amplitude)),
                frequency,
                float(solved.x[1]),
                frequency * float(sigma[0]),
                float(sigma[1]),
            )
        )
    return tuple(windows)


def material_windows(windows: tuple[Window, ...], hangs: bool) -> slice:
    """Select the time windows that identify the material; `hangs`: whether a weight hangs at the tip."""
    if len(windows) < 2:
        return slice(0, len(windows))
    starts = [0]
    for i, window in enumerate(windows[1:], 1):
        first = windows[starts[-1]]
        rise, sigma = window.loss - first.loss, np.hypot(window.loss_sigma, first.loss_sigma)
        # A hanging weight may swing after the loss factor has risen.
        if hangs and rise > 0.2 * first.loss and rise > 3 * sigma:
            return slice(0, i)
        change = abs(window.frequency_Hz / first.frequency_Hz - 1)
        of_frequency = np.hypot(window.frequency_sigma_Hz, first.frequency_sigma_Hz) / first.frequency_Hz
        if not hangs and (
            (change > _CHANGED_FREQUENCY and change > _CERTAIN * of_frequency)
            or (abs(rise) > _CHANGED_LOSS * min(abs(window.loss), abs(first.loss)) and abs(rise) > _CERTAIN * sigma)
        ):
            starts.append(i)
    runs = [slice(first, last) for first, last in pairwise([*starts, len(windows)])]
    # A touch adds loss, so that the group of windows with the smallest loss is used.
    losses = [_largest_loss(windows[run]) for run in runs]
    return runs[int(np.argmin(losses))]


def _largest_loss(windows: Sequence[Window]) -> float:
    """Return an upper limit of the loss factor: its mean plus two standard uncertainties."""
    weights = np.array([window.loss_sigma for window in windows]) ** -2.0
    mean = float(np.array([window.loss for window in windows]) @ weights / weights.sum())
    return mean + 2 / float(np.sqrt(weights.sum()))


def scatter_of(windows: tuple[Window, ...], used: int, mode: Array) -> Array:
    """Estimate the errors of ln(frequency) and loss factor from their changes between time windows."""
    # They change because a swinging weight exchanges energy with the beam. ``used``: number of windows from the first
    # to the last one that is fitted. ``mode`` (2,): ln(angular frequency) and loss factor of the fit.
    values = np.array([[np.log(2 * np.pi * w.frequency_Hz), w.loss] for w in windows]).reshape(-1, 2)
    sigmas = np.array([[w.frequency_sigma_Hz / w.frequency_Hz, w.loss_sigma] for w in windows]).reshape(-1, 2)
    is_large = np.array([w.amplitude_mm > _SMALL * windows[0].amplitude_mm for w in windows], bool)[:used]
    # Each error is the larger of two: the largest deviation of a used window from the fit, and half of the change to
    # the first window that is not used.
    beyond = np.maximum(np.abs(values - mode) - 2 * sigmas, 0.0)[:used][is_large].max(axis=0, initial=0.0)
    if 0 < used < len(windows):
        beyond = np.maximum(beyond, 0.5 * np.abs(values[used] - values[used - 1]))
    return np.asarray(beyond)
