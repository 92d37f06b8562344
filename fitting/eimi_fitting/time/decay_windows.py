"""Frequency and loss factor of a ring-down in time windows, which show whether they change with the amplitude."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from eimi_fitting.time.modal_fit import ModalFit, exponent, wave

Array = NDArray[np.float64]

_MOST_WINDOWS = 8


@dataclass(frozen=True)
class Window:
    """Frequency and loss factor in one time window of a ring-down.

    Attributes
    ----------
    from_s, to_s : float
        Start and end of the window.
    amplitude_mm : float
        Amplitude at the middle of the window, in the channel with the largest amplitude. A channel is one coordinate of
        one point.
    frequency_Hz, loss : float
        Frequency and loss factor.
    frequency_sigma_Hz, loss_sigma : float
        Standard uncertainties of frequency and loss factor due to noise.
    is_used : bool
        Whether the window is used to identify the material.
    """

    from_s: float
    to_s: float
    amplitude_mm: float
    frequency_Hz: float
    loss: float
    frequency_sigma_Hz: float
    loss_sigma: float
    is_used: bool = True


def windows_of(fitted: ModalFit) -> tuple[Window, ...]:
    """Return the frequency and loss factor of a ring-down in time windows of equal duration.

    The amplitude falls to about a half from the start to the end of a window. Windows with an uncertain fit are left
    out.
    """
    time, amplitude = fitted.signals.time_s, fitted.amplitude_mm()
    period = 1 / fitted.frequency_Hz
    halvings = np.log2(max(float(amplitude[0] / amplitude[-1]), 1.0))
    longest = (time[-1] - time[0]) / (4 * period)
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

        solved = least_squares(residuals, fitted.modes[0], method="lm", x_scale=[1e-3, 1e-2], diff_step=1e-6)
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


def material_windows(windows: tuple[Window, ...], hangs: bool) -> int:
    """Return the number n of time windows; the first n windows are used to identify the material.

    If the swing of a hanging weight raises the loss, only the windows before the rise are used.
    """
    if not hangs or len(windows) < 2:
        return len(windows)
    first = windows[0]
    for i, window in enumerate(windows[1:], 1):
        rise = window.loss - first.loss
        if rise > 0.2 * first.loss and rise > 3 * np.hypot(window.loss_sigma, first.loss_sigma):
            return i
    return len(windows)
