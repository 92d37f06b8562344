"""Frequencies and losses of a ring-down: damped vibrations fitted to its signals.

The reduced signals of a ring-down (`time.channels`) are sums of damped vibrations and a slow baseline,

    z(t) = sum_k Re(a_k exp(psi_k(t))) + slow(t),    psi_1(t) = (i omega - delta) t + (i kappa + kappa') omega E(t),

where E(t) = (1 - exp(-2 delta t)) / (2 delta): kappa and kappa' let frequency and damping of the first mode change with
the square of the amplitude, as geometric nonlinearity does (Nayfeh and Mook 1979, Nonlinear Oscillations, section 2.3).
omega and delta are the values at small amplitudes. A nonlinear beam also moves at two and three times its frequency;
these harmonics are fitted, too. The model is linear in amplitudes and baseline, which are therefore eliminated (Golub
and Pereyra 1973, SIAM J. Numer. Anal. 10:413).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

from eimi_fitting.time.channels import Signals, TooFewFrames

Array = NDArray[np.float64]

MOST_AMPLITUDE = 0.05
"""Largest amplitude of the tip in the fitted part, as a share of the beam's length."""
_LOSSES = (0.01, 0.03, 0.06, 0.12, 0.25, 0.5)  # loss factors from which the fit starts
_FEWEST_PERIODS = 5.0
_KNOT_PERIODS = 4.0  # smallest mean number of periods between knots of the baseline
_MOST_KNOTS = 12
_SIGNIFICANT = 12.0  # an added term must lower chi-square by this many noise variances
_PEAK = 60.0  # a peak is another mode if its power is this many times the median of the residuals
_MOST_MODES = 3
_END = 0.4  # amplitude over noise at which the decay counts as ended
_MOST_WINDOWS = 8
_RUN, _SPARSE = 11, 3.0  # gaps in a run; a run is sparse if its median gap is over 3 times the usual one


@dataclass(frozen=True)
class RingMode:
    """One damped vibration exp(s t), s = -delta + i omega.

    Attributes
    ----------
    frequency_Hz : float
        omega / 2 pi.
    loss : float
        2 delta / omega, the loss factor of the decay.
    covariance : ndarray, shape (2, 2)
        Covariance of ln(frequency) and of the loss.
    """

    frequency_Hz: float
    loss: float
    covariance: Array

    @property
    def rate(self) -> complex:
        """The complex rate s in 1/s."""
        omega = 2 * np.pi * self.frequency_Hz
        return complex(-0.5 * self.loss * omega, omega)


@dataclass(frozen=True)
class Window:
    """Frequency and loss in one time window of a decay.

    Attributes
    ----------
    from_s, to_s : float
        Begin and end of the window.
    amplitude_mm : float
        Amplitude of the channel that moves most, at the middle of the window.
    frequency_Hz, loss : float
    frequency_sigma_Hz, loss_sigma : float
        Standard uncertainties from the noise.
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


@dataclass(frozen=True)
class Decay:
    """The vibrations in a ring-down.

    Attributes
    ----------
    label : str
    modes : tuple of RingMode
        The modes at small amplitude, the dominant vibration first.
    windows : tuple of Window
    from_s, to_s : float
        The part of the recording that was fitted.
    amplitude_mm : float
        Amplitude at the time ``from_s``, of the channel that moves most.
    frequency_change, loss_change : float
        Relative change of frequency, and change of loss, from small amplitude to ``amplitude_mm``; 0 if it is not
        significant.
    time_s, displacement_mm, envelope_mm, modelled_mm : ndarray, shape (n,)
        The channel that moves most: displacement without the baseline, envelope, and fitted vibrations.
    noise : float
        Standard deviation of the residuals near the frequency, divided by the stated noise.
    doubts : tuple of str
    baseline_mm : ndarray, shape (n, c)
        The channels without the fitted vibrations.
    """

    label: str
    modes: tuple[RingMode, ...]
    windows: tuple[Window, ...]
    from_s: float
    to_s: float
    amplitude_mm: float
    frequency_change: float
    loss_change: float
    time_s: Array
    displacement_mm: Array
    envelope_mm: Array
    modelled_mm: Array
    noise: float
    doubts: tuple[str, ...] = ()
    baseline_mm: Array = field(default_factory=lambda: np.zeros((0, 0)))


class NoVibration(Exception):
    """A recording shows no decaying vibration."""


def decay_of(signals: Signals, label: str, length_mm: float, *, is_stepped: bool, hangs: bool = False) -> Decay:
    """Return the vibrations in a ring-down.

    Parameters
    ----------
    signals : Signals
    label : str
        Where the recording comes from, for messages.
    length_mm : float
        Length of the beam; it limits the amplitude that is fitted.
    is_stepped : bool
        Whether a known step of the load begins the motion at the time 0. Otherwise it begins at the largest amplitude.
    hangs : bool
        Whether a weight hangs from the beam. It can swing like a pendulum below the tip.

    Raises
    ------
    NoVibration
        No vibration stands out from the noise, or the amplitude of the vibration is too large, or its duration too
        short.
    TooFewFrames
        Fewer than 8 frames are left.
    """
    if is_stepped:
        signals = signals.between(0.0, np.inf)
    signals = _dense(signals)
    frequency = _first_frequency(signals, label)
    first, last, doubts = _segment(signals, frequency, length_mm, label, is_stepped)
    part = signals.between(first, last)
    if len(part.time_s) < 12 or (last - first) * frequency < _FEWEST_PERIODS:
        raise NoVibration(
            f"{label}: {(last - first) * frequency:.1f} periods have an amplitude below {MOST_AMPLITUDE:.0%} of the "
            f"length; at least {_FEWEST_PERIODS:g} are needed"
        )
    fitted = _Fitted.first_of(part, frequency)
    part = _without_end(part, fitted)
    fitted = _Fitted.of(part, fitted.modes, False)
    windows = _windows(fitted)
    used = _material_windows(windows, hangs)
    if used < len(windows):
        end = windows[used - 1].to_s
        doubts.append(
            f"{label}: the loss rises from {windows[0].loss:.3g} to {max(w.loss for w in windows):.3g} while the "
            f"amplitude falls, as it does when the hanging weight swings like a pendulum; only the first "
            f"{end - first:.2g} s were used"
        )
        windows = tuple(replace(w, is_used=i < used) for i, w in enumerate(windows))
        fitted = _Fitted.of(part.between(-np.inf, end), fitted.modes[:1], False)
    else:
        fitted = _with_more_modes(fitted)
    bent = _Fitted.of(fitted.signals, fitted.modes, True)
    if used == len(windows) and fitted.chi2 - bent.chi2 > _SIGNIFICANT * bent.noise**2 and len(windows) > 2:
        fitted = bent
    return _result(fitted, windows, label, doubts, hangs)


def _dense(signals: Signals) -> Signals:
    """Return the frames before the first run of much longer gaps; in a record of creep the gaps grow with time."""
    gaps = np.diff(signals.time_s)
    if len(gaps) < 2 * _RUN:
        return signals
    usual = float(np.quantile(gaps, 0.1))
    typical = np.median(np.lib.stride_tricks.sliding_window_view(gaps, _RUN), axis=1)
    sparse = np.flatnonzero(typical > _SPARSE * usual)
    return signals.between(-np.inf, float(signals.time_s[sparse[0] + _RUN // 2])) if len(sparse) else signals


def _first_frequency(signals: Signals, label: str) -> float:
    """Return the frequency in Hz of the largest peak in the spectrum."""
    uniform, values = _uniform(signals)
    step = uniform[1] - uniform[0]
    span = uniform[-1] - uniform[0]
    slow = np.polynomial.polynomial.polyfit(uniform, values, 3)
    rest = values - np.polynomial.polynomial.polyval(uniform, slow).T
    size = 4 * len(uniform)
    power = (np.abs(np.fft.rfft(rest * np.hanning(len(uniform))[:, None], size, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(size, step)
    allowed = frequency >= 2.5 / span
    if not allowed.any():
        raise NoVibration(f"{label}: the recording is too short for a vibration ({span:.3g} s)")
    background = float(np.median(power[allowed]))
    # The power of creep falls with the square of the frequency. Multiplied by this square, a vibration is a peak.
    weighted = np.where(allowed, np.maximum(power - 30 * background, 0.0) * frequency**2, 0.0)
    weighted[frequency > 0.8 * frequency[-1]] = 0.0
    best = int(np.argmax(weighted))
    peak = float(frequency[best])
    around = (np.abs(frequency / max(peak, 1e-9) - 1) < 0.15) & allowed
    if not weighted.any() or power[around].max() < 8 * background:
        raise NoVibration(f"{label}: no vibration stands out from the noise")
    return float(frequency[np.argmax(np.where(around, power, 0.0))])


def _uniform(signals: Signals) -> tuple[Array, Array]:
    """Return evenly spaced times and the reduced signals interpolated at them."""
    time = signals.time_s
    uniform = np.linspace(time[0], time[-1], len(time))
    values = np.stack([np.interp(uniform, time, z) for z in signals.reduced.T], axis=1)
    return uniform, values


def _envelope(signals: Signals, frequency: float) -> tuple[Array, Array]:
    """Return times and the largest amplitude over the channels, in mm, in a band around a frequency."""
    uniform, values = _uniform(signals)
    values = values - np.polynomial.polynomial.polyval(uniform, np.polynomial.polynomial.polyfit(uniform, values, 1)).T
    n = len(uniform)
    mirrored = np.concatenate([values[::-1], values, values[::-1]])
    spectrum = np.fft.fft(mirrored, axis=0)
    f = np.fft.fftfreq(3 * n, uniform[1] - uniform[0])
    window = np.exp(-0.5 * ((f - frequency) / (0.25 * frequency)) ** 2) * (f > 0)
    analytic = 2 * np.fft.ifft(spectrum * window[:, None], axis=0)[n : 2 * n]
    in_mm = np.abs(analytic @ signals.patterns) * signals.sigma_mm
    return uniform, np.asarray(in_mm.max(axis=1))


def _segment(
    signals: Signals, frequency: float, length_mm: float, label: str, is_stepped: bool
) -> tuple[float, float, list[str]]:
    """Return begin and end (s) of the free decay with amplitudes below the limit, and the doubts about it."""
    time, size = _envelope(signals, frequency)
    doubts: list[str] = []
    start = 0 if is_stepped else int(np.argmax(size))
    falling = np.minimum.accumulate(size[start:])
    floor = np.quantile(size, 0.05)
    again = np.flatnonzero((size[start:] > 2.0 * falling) & (size[start:] > max(10 * floor, 0.1 * size[start:].max())))
    again = again[again * (time[1] - time[0]) * frequency > 2.0]
    stop = start + int(again[0]) - round(1.5 / frequency / (time[1] - time[0])) if len(again) else len(size)
    if len(again):
        doubts.append(
            f"{label}: the beam is moved again at {time[min(stop, len(time) - 1)]:.3g} s; the later frames are left out"
        )
    limit = MOST_AMPLITUDE * length_mm
    below = np.flatnonzero(size[start:stop] < limit)
    if not len(below):
        raise NoVibration(
            f"{label}: the amplitude stays above {limit:.3g} mm, {MOST_AMPLITUDE:.0%} of the beam's length"
        )
    if size[start] > limit:
        doubts.append(
            f"{label}: the first amplitudes of up to {size[start:stop].max():.2g} mm are above {MOST_AMPLITUDE:.0%} of "
            f"the length and are left out (the first {time[start + below[0]] - time[start]:.2g} s)"
        )
    first = start + int(below[0])
    if not is_stepped and first == start:
        first += round(0.5 / frequency / (time[1] - time[0]))  # the hand may still touch the beam
    first = min(first, len(time) - 1)
    return float(time[first]), float(time[min(stop, len(time)) - 1]), doubts


def _baseline(time: Array, frequency: float) -> Array:
    """Return the functions (n, b) of a slow baseline: a cubic spline with a knot every 4 periods or more."""
    span = time[-1] - time[0]
    inner = int(np.clip(span * frequency / _KNOT_PERIODS - 1, 0, _MOST_KNOTS))
    x = (time - time[0]) / span
    # The material recovers fastest at the start, so the knots are denser there.
    ends = np.linspace(0, 1, inner + 2) ** 1.5
    degree = 3 if inner else 1
    knots = np.concatenate([np.zeros(degree), ends, np.ones(degree)])
    return np.asarray(BSpline.design_matrix(np.minimum(x, 1.0), knots, degree).toarray())


@dataclass(frozen=True)
class _Fitted:
    """A fit of modes to signals.

    `modes` (m, 2) holds ln omega and the loss of each mode, `bend` (2,) the change of both with amplitude.
    """

    signals: Signals
    modes: Array
    bend: Array
    has_bend: bool
    chi2: float
    noise: float
    covariance: Array
    residuals: Array
    linear: Array

    @staticmethod
    def first_of(signals: Signals, frequency: float) -> _Fitted:
        """Return the fit of one mode near a frequency, from several guesses of its loss."""
        start = np.array([np.log(2 * np.pi * frequency), 0.0])
        values = [_misfit(signals, np.array([start[0], loss])) for loss in _LOSSES]
        start[1] = _LOSSES[int(np.argmin(values))]
        return _Fitted.of(signals, start[None], False)

    @staticmethod
    def of(signals: Signals, modes: Array, has_bend: bool) -> _Fitted:
        """Return the fit that starts from given modes; `has_bend` also fits the modes' change with amplitude."""
        count = len(modes)

        def residuals(x: Array) -> Array:
            design = _design(signals.time_s, x[: 2 * count].reshape(-1, 2), x[2 * count :])
            orthogonal, _ = np.linalg.qr(design)
            return np.asarray((signals.reduced - orthogonal @ (orthogonal.T @ signals.reduced)).ravel())

        start = np.concatenate([modes.ravel(), np.zeros(2 if has_bend else 0)])
        scale = np.tile([1e-3, 1e-2], len(start) // 2)
        solved = least_squares(residuals, start, method="lm", x_scale=scale, diff_step=1e-6, max_nfev=60 * len(start))
        rest = solved.fun.reshape(signals.reduced.shape)
        fitted = solved.x[: 2 * count].reshape(-1, 2)
        freedom = max(rest.size - solved.x.size - rest.shape[1] * 20, 1)
        white = float(np.sqrt((rest**2).sum() / freedom))
        noise = max(_band_noise(signals, rest, np.exp(fitted[0, 0]) / (2 * np.pi)), white)
        covariance = noise**2 * np.linalg.pinv(solved.jac.T @ solved.jac)
        bend = solved.x[2 * count :] if has_bend else np.zeros(2)
        design = _design(signals.time_s, fitted, bend)
        linear = np.asarray(np.linalg.lstsq(design, signals.reduced, rcond=None)[0], float)
        return _Fitted(signals, fitted, bend, has_bend, float((rest**2).sum()), noise, covariance, rest, linear)

    @property
    def frequency_Hz(self) -> float:
        return float(np.exp(self.modes[0, 0]) / (2 * np.pi))

    def vibration_mm(self, which: int | None = None) -> Array:
        """Return the fitted vibrations of all modes, or of one, in all channels (n, c), in mm."""
        design = _design(self.signals.time_s, self.modes, self.bend)
        rows = np.arange(2 * len(self.modes) + 4) if which is None else np.arange(2 * which, 2 * which + 2)
        return self.signals.in_mm(design[:, rows] @ self.linear[rows])

    def amplitude_mm(self) -> Array:
        """Return the amplitude (n,) of the first mode, at all times, in the channel where it is largest."""
        complex_amplitude = self.signals.in_mm(self.linear[0]) - 1j * self.signals.in_mm(self.linear[1])
        time = self.signals.time_s - self.signals.time_s[0]
        return float(np.abs(complex_amplitude).max()) * np.exp(_exponent(time, self.modes[0], self.bend).real)


def _exponent(time: Array, mode: Array, bend: Array) -> NDArray[np.complex128]:
    """Return the exponent psi (n,) of a mode; times are counted from the first frame."""
    omega, loss = np.exp(mode[0]), mode[1]
    delta = 0.5 * loss * omega
    psi = (1j * omega - delta) * time
    if len(bend) and np.any(bend):
        shrunk = -np.expm1(-2 * delta * time) / (2 * delta) if abs(delta) > 1e-9 else time
        psi = psi + (1j * bend[0] - bend[1]) * omega * shrunk
    return np.asarray(psi)


def _design(time: Array, modes: Array, bend: Array) -> Array:
    """Return the functions of time as columns: cosine and sine of each mode, harmonics of the first mode, baseline."""
    t = time - time[0]
    first = _exponent(t, modes[0], bend)
    waves = [first, *(_exponent(t, mode, np.zeros(0)) for mode in modes[1:])]
    harmonics = [2 * first, 3 * first]
    columns = [part for psi in (*waves, *harmonics) for part in _wave(psi)]
    columns.append(np.exp(2 * np.minimum(first.real, 30.0)))
    frequency = float(np.exp(modes[0, 0]) / (2 * np.pi))
    return np.column_stack([*columns, _baseline(time, frequency)])


def _wave(psi: NDArray[np.complex128]) -> tuple[Array, Array]:
    """Return the real and the imaginary part of exp(psi), where psi is the exponent of a mode."""
    size = np.exp(np.minimum(psi.real, 30.0))
    return size * np.cos(psi.imag), size * np.sin(psi.imag)


def _misfit(signals: Signals, mode: Array) -> float:
    """Return the sum of the squared residuals of a fit with one mode."""
    orthogonal, _ = np.linalg.qr(_design(signals.time_s, mode[None], np.zeros(0)))
    inner = orthogonal.T @ signals.reduced
    return float((signals.reduced**2).sum() - (inner**2).sum())


def _band_noise(signals: Signals, residuals: Array, frequency: float) -> float:
    """Return the standard deviation of white noise whose power equals that of the residuals near a frequency."""
    n = len(residuals)
    step = (signals.time_s[-1] - signals.time_s[0]) / (n - 1)
    power = (np.abs(np.fft.rfft(residuals, axis=0)) ** 2).mean(axis=1) / n
    f = np.fft.rfftfreq(n, step)
    near = (f > 0.6 * frequency) & (f < 1.6 * frequency)
    # The fit removes noise near the fitted frequency, too: about two lines of the spectrum for each mode.
    return float(np.sqrt(power[near].mean() * near.sum() / max(near.sum() - 2, 1))) if near.sum() > 3 else 0.0


def _without_end(signals: Signals, fitted: _Fitted) -> Signals:
    """Leave out the frames at the end, where the amplitude is below the noise."""
    at_most = np.abs(fitted.linear[0]).max() + np.abs(fitted.linear[1]).max()
    time = signals.time_s - signals.time_s[0]
    size = at_most * np.exp(_exponent(time, fitted.modes[0], fitted.bend).real)
    level = _END * np.sqrt((fitted.residuals**2).mean())
    over = np.flatnonzero(size < level)
    fewest = 3 * _FEWEST_PERIODS / fitted.frequency_Hz
    last = max(signals.time_s[over[0]] if len(over) else np.inf, signals.time_s[0] + fewest)
    return signals.between(-np.inf, float(last))


def _with_more_modes(fitted: _Fitted) -> _Fitted:
    """Add modes while a peak stands out from the residuals' spectrum."""
    while len(fitted.modes) < _MOST_MODES:
        signals, n = fitted.signals, len(fitted.residuals)
        step = (signals.time_s[-1] - signals.time_s[0]) / (n - 1)
        taper = np.exp(
            -0.5 * 0.5 * fitted.modes[0, 1] * np.exp(fitted.modes[0, 0]) * (signals.time_s - signals.time_s[0])
        )
        power = (np.abs(np.fft.rfft(fitted.residuals * taper[:, None], 2 * n, axis=0)) ** 2).sum(axis=1)
        f = np.fft.rfftfreq(2 * n, step)
        others = np.exp(fitted.modes[:, 0]) / (2 * np.pi)
        free = (f > 1.2 * others[0]) & (f < 0.45 / step)
        for frequency in (*others, 2 * others[0], 3 * others[0]):
            free &= np.abs(f / frequency - 1) > 0.12
        if free.sum() < 10:
            break
        best = int(np.argmax(np.where(free, power, 0.0)))
        if power[best] < _PEAK * np.median(power[free]):
            break
        mode = np.array([np.log(2 * np.pi * f[best]), max(fitted.modes[0, 1], 0.01)])
        more = _Fitted.of(signals, np.concatenate([fitted.modes, mode[None]]), False)
        frequencies = np.exp(more.modes[:, 0]) / (2 * np.pi)
        is_sound = 0 < more.modes[-1, 1] < 1 and abs(frequencies[-1] / f[best] - 1) < 0.2
        if not is_sound or fitted.chi2 - more.chi2 < 3 * _SIGNIFICANT * more.noise**2:
            break
        fitted = more
    return fitted


def _windows(fitted: _Fitted) -> tuple[Window, ...]:
    """Fit frequency and loss in windows of equal duration; the amplitude about halves over each window."""
    time, amplitude = fitted.signals.time_s, fitted.amplitude_mm()
    period = 1 / fitted.frequency_Hz
    shares = np.log2(max(float(amplitude[0] / amplitude[-1]), 1.0))
    longest = (time[-1] - time[0]) / (4 * period)
    count = int(np.clip(min(max(round(shares), 2), longest), 1, _MOST_WINDOWS))
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
            psi = _exponent(t, x, np.zeros(0))
            orthogonal, _ = np.linalg.qr(np.column_stack([*_wave(psi), *_wave(2 * psi), slow]))
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


def _material_windows(windows: tuple[Window, ...], hangs: bool) -> int:
    """Return the number of first windows to use: those before the swing of a hanging weight raises the loss."""
    if not hangs or len(windows) < 2:
        return len(windows)
    first = windows[0]
    for i, window in enumerate(windows[1:], 1):
        rise = window.loss - first.loss
        if rise > 0.2 * first.loss and rise > 3 * np.hypot(window.loss_sigma, first.loss_sigma):
            return i
    return len(windows)


def _result(fitted: _Fitted, windows: tuple[Window, ...], label: str, doubts: list[str], hangs: bool) -> Decay:
    signals, count = fitted.signals, len(fitted.modes)
    covariance = fitted.covariance[: 2 * count, : 2 * count]
    modes = tuple(
        RingMode(
            float(np.exp(mode[0]) / (2 * np.pi)),
            float(mode[1]),
            covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2],
        )
        for k, mode in enumerate(fitted.modes)
    )
    if not 0 < modes[0].loss < 1.5 or not np.isfinite(modes[0].covariance).all():
        raise NoVibration(f"{label}: the vibration at {modes[0].frequency_Hz:.3g} Hz does not decay")
    vibration = fitted.vibration_mm()
    main = int(np.argmax(np.abs(fitted.vibration_mm(0)).max(axis=0)))
    design = _design(signals.time_s, fitted.modes, fitted.bend)
    # The shift with the square of the amplitude is nearly a part of the baseline; only their sum is determined.
    slow = signals.in_mm(design[:, 2 * count + 4 :] @ fitted.linear[2 * count + 4 :])
    level = signals.in_mm(signals.reduced) - slow
    frequency_change = float(fitted.bend[0]) if fitted.has_bend else 0.0
    loss_change = float(2 * fitted.bend[1]) if fitted.has_bend else 0.0
    amplitude = fitted.amplitude_mm()
    if abs(frequency_change) > 0.01 or abs(loss_change) > 0.1 * modes[0].loss:
        doubts.append(
            f"{label}: at {amplitude[0]:.2g} mm the frequency differs by {100 * frequency_change:+.2g} % and the loss "
            f"by {loss_change:+.2g} from those of small amplitudes, which are reported"
        )
    if hangs and len(windows) < 2:
        doubts.append(f"{label}: the recording is too short to see whether the hanging weight swings like a pendulum")
    return Decay(
        label,
        modes,
        windows,
        float(signals.time_s[0]),
        float(signals.time_s[-1]),
        float(amplitude[0]),
        frequency_change,
        loss_change,
        signals.time_s,
        level[:, main],
        amplitude,
        vibration[:, main],
        fitted.noise,
        tuple(doubts),
        signals.channels_mm - vibration,
    )


__all__ = ["Decay", "NoVibration", "RingMode", "TooFewFrames", "Window", "decay_of"]
