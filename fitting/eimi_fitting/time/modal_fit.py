"""Modal fit: damped vibrations of a beam, fitted to its recorded motion."""

# Each signal of the recording is a sum of damped vibrations and a slow baseline,
#
#     z(t) = sum_k Re(a_k exp(psi_k(t))) + baseline(t),
#
# with the time t since the first frame, complex amplitudes a_k, and psi_k = (i omega - delta) t with the angular
# frequency omega and the decay rate delta. The first mode changes with the square of its amplitude,
#
#     psi_1(t) = (i omega - delta) t + (i kappa_1 - kappa_2) omega E(t),    E(t) = (1 - exp(-2 delta t)) / (2 delta).
#
# At t = 0 its frequency is higher by the fraction kappa_1, and its loss factor 2 delta / omega by 2 kappa_2. The a_k
# and the baseline are eliminated (Golub and Pereyra 1973, SIAM J. Numer. Anal. 10:413).

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.time.channels import Signals

Array = NDArray[np.float64]

_LOSSES = (0.01, 0.03, 0.06, 0.12, 0.25, 0.5)  # loss factors from which the fit starts
_KNOT_PERIODS = 4.0  # smallest mean number of periods between knots of the baseline
_MOST_KNOTS = 12
SIGNIFICANT = 12.0  # an added term must lower chi-square by this many noise variances
_PEAK = 60.0  # a peak is another mode if its power is this many times the median of the residuals
_MOST_MODES = 3
_MOST_BEND = np.array([0.05, 0.5])  # largest kappa_1, and largest kappa_2 divided by the loss factor
_CLOSE, _CANCELLING = 1.5, 1.5  # ratio of close frequencies; sum of their amplitudes over the measured amplitude


@dataclass(frozen=True)
class ModalFit:
    """A fit of damped vibrations to the recorded motion of a beam."""

    # m modes of vibration; r signals in n frames.

    # The recorded motion, of which the signals are linear combinations.
    signals: Signals
    # (m, 2): ln(angular frequency in rad/s) and loss factor of each mode.
    modes: Array
    # (2,): changes of the first mode from small amplitudes to the amplitude in the first frame: relative change of
    # its frequency (kappa_1), and half of the change of its loss factor (kappa_2).
    bend: Array
    # Whether ``bend`` was fitted.
    has_bend: bool
    # Sum of the squared residuals.
    chi2: float
    # Standard deviation of ``residuals`` (near the first frequency, if it is larger there).
    noise: float
    # Covariance of ``modes`` and ``bend``.
    covariance: Array
    # (n, r): residuals of the r signals.
    residuals: Array
    # (f, r): coefficients of f functions of time, which are fitted to the signals.
    linear: Array

    @staticmethod
    def first_of(signals: Signals, frequency: float) -> ModalFit:
        """Fit one damped vibration with a given approximate frequency in Hz."""
        start = np.array([np.log(2 * np.pi * frequency), 0.0])
        values = [_misfit(signals, np.array([start[0], loss])) for loss in _LOSSES]
        start[1] = _LOSSES[int(np.argmin(values))]
        return ModalFit.of(signals, start[None], False)

    @staticmethod
    def of(signals: Signals, modes: Array, has_bend: bool) -> ModalFit:
        """Fit several damped vibrations, from given starting values."""
        # ``modes`` (m, 2): ln(angular frequency in rad/s) and loss factor of each mode. ``has_bend``: whether to fit
        # the change of the first mode with the amplitude.
        count = len(modes)

        def residuals(x: Array) -> Array:
            design = design_matrix(signals.time_s, x[: 2 * count].reshape(-1, 2), x[2 * count :])
            orthogonal, _ = np.linalg.qr(design)
            return np.asarray((signals.reduced - orthogonal @ (orthogonal.T @ signals.reduced)).ravel())

        start = np.concatenate([modes.ravel(), np.zeros(2 if has_bend else 0)])
        scale = np.tile([1e-3, 1e-2], len(start) // 2)
        solved = scipy.optimize.least_squares(
            residuals, start, method="lm", x_scale=scale, diff_step=1e-6, max_nfev=60 * len(start)
        )
        residual = solved.fun.reshape(signals.reduced.shape)
        fitted = solved.x[: 2 * count].reshape(-1, 2)
        freedom = max(residual.size - solved.x.size - residual.shape[1] * 20, 1)
        white = float(np.sqrt((residual**2).sum() / freedom))
        noise = max(_band_noise(signals, residual, np.exp(fitted[0, 0]) / (2 * np.pi)), white)
        covariance = noise**2 * np.linalg.pinv(solved.jac.T @ solved.jac)
        bend = solved.x[2 * count :] if has_bend else np.zeros(2)
        design = design_matrix(signals.time_s, fitted, bend)
        linear = np.asarray(np.linalg.lstsq(design, signals.reduced, rcond=None)[0], float)
        chi2 = float((residual**2).sum())
        return ModalFit(signals, fitted, bend, has_bend, chi2, noise, covariance, residual, linear)

    def widened(self, sigma: Array) -> ModalFit:
        """Add ``sigma`` (2,) in quadrature to the uncertainties of the first mode's ln(frequency) and loss factor."""
        covariance = self.covariance.copy()
        covariance[:2, :2] += np.diag(sigma**2)
        return replace(self, covariance=covariance)

    @property
    def frequency_Hz(self) -> float:
        """Frequency of the first mode at small amplitudes."""
        return float(np.exp(self.modes[0, 0]) / (2 * np.pi))

    def vibration_mm(self, which: int | None = None) -> Array:
        """Return the displacement of each point over time in one mode, or in the sum of all modes."""
        # The result is (n, c) for c coordinates of points. The sum contains the harmonics.
        design = design_matrix(self.signals.time_s, self.modes, self.bend)
        rows = np.arange(2 * len(self.modes) + 4) if which is None else np.arange(2 * which, 2 * which + 2)
        return self.signals.in_mm(design[:, rows] @ self.linear[rows])

    @property
    def cancels(self) -> bool:
        """Whether the fit contains vibrations of almost equal frequency that nearly cancel each other."""
        close = np.abs(self.modes[:, 0] - self.modes[0, 0]) < np.log(_CLOSE)
        parts = [self.vibration_mm(int(k)) for k in np.flatnonzero(close)]
        sizes = [float(np.abs(part).max()) for part in parts]
        return sum(sizes) > _CANCELLING * float(np.abs(sum(parts)).max())

    @property
    def changes_little(self) -> bool:
        """Whether frequency and loss factor of the first mode change little with the amplitude."""
        return bool((np.abs(self.bend) <= _MOST_BEND * [1.0, self.modes[0, 1]]).all())

    def strongest_first(self) -> ModalFit:
        """Put the strongest mode first; only modes with nearly the frequency of ``modes[0]`` are compared."""
        sizes = [float(np.abs(self.vibration_mm(k)).max()) for k in range(len(self.modes))]
        close = np.abs(self.modes[:, 0] - self.modes[0, 0]) < np.log(_CLOSE)
        strongest = int(np.argmax(np.where(close, sizes, 0.0)))
        if not strongest:
            return self
        order = [strongest, *(k for k in range(len(self.modes)) if k != strongest)]
        return ModalFit.of(self.signals, self.modes[order], False)

    def slow_mm(self) -> Array:
        """Return the fitted slow motion of each point over time."""
        # The shift with the square of the amplitude is nearly a part of the baseline; only their sum is determined.
        first = 2 * len(self.modes) + 4
        design = design_matrix(self.signals.time_s, self.modes, self.bend)
        return self.signals.in_mm(design[:, first:] @ self.linear[first:])

    def amplitude_mm(self) -> Array:
        """Return the amplitude of the first mode over time, at the point that moves most."""
        complex_amplitude = self.signals.in_mm(self.linear[0]) - 1j * self.signals.in_mm(self.linear[1])
        time = self.signals.time_s - self.signals.time_s[0]
        return float(np.abs(complex_amplitude).max()) * np.exp(exponent(time, self.modes[0], self.bend).real)


def with_more_modes(fitted: ModalFit) -> ModalFit:
    """Add one vibration to the fit for each clear peak in the spectrum of the residuals."""
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
        more = ModalFit.of(signals, np.concatenate([fitted.modes, mode[None]]), False)
        frequencies = np.exp(more.modes[:, 0]) / (2 * np.pi)
        is_sound = 0 < more.modes[-1, 1] < 1 and abs(frequencies[-1] / f[best] - 1) < 0.2 and not more.cancels
        if not is_sound or fitted.chi2 - more.chi2 < 3 * SIGNIFICANT * more.noise**2:
            break
        fitted = more
    return fitted.strongest_first()


def exponent(time: Array, mode: Array, bend: Array) -> NDArray[np.complex128]:
    """Return the exponent psi of a vibration Re(a exp(psi)); ``bend`` changes frequency and loss with the amplitude."""
    # ``mode`` (2,): ln(angular frequency in rad/s) and loss factor. ``bend`` (2,), or empty: relative change of the
    # frequency, and half of the change of the loss factor, due to the amplitude at time 0.
    omega, loss = np.exp(mode[0]), mode[1]
    delta = 0.5 * loss * omega
    psi = (1j * omega - delta) * time
    if len(bend) and np.any(bend):
        shrunk = -np.expm1(-2 * delta * time) / (2 * delta) if abs(delta) > 1e-9 else time
        psi = psi + (1j * bend[0] - bend[1]) * omega * shrunk
    return np.asarray(psi)


def design_matrix(time: Array, modes: Array, bend: Array) -> Array:
    """Return the functions of time that are fitted to a recording, one in each column."""
    # ``modes`` (m, 2): ln(angular frequency in rad/s) and loss factor of each mode. ``bend``: as in `exponent`, for the
    # first mode.
    t = time - time[0]
    first = exponent(t, modes[0], bend)
    waves = [first, *(exponent(t, mode, np.zeros(0)) for mode in modes[1:])]
    # A nonlinear beam also vibrates at two and three times its frequency (Nayfeh and Mook 1979, Nonlinear Oscillations,
    # section 2.3).
    harmonics = [2 * first, 3 * first]
    columns = [part for psi in (*waves, *harmonics) for part in wave(psi)]
    columns.append(np.exp(2 * np.minimum(first.real, 30.0)))
    frequency = float(np.exp(modes[0, 0]) / (2 * np.pi))
    return np.column_stack([*columns, _baseline(time, frequency)])


def wave(psi: NDArray[np.complex128]) -> tuple[Array, Array]:
    """Return the real and the imaginary part of exp(psi)."""
    size = np.exp(np.minimum(psi.real, 30.0))
    return size * np.cos(psi.imag), size * np.sin(psi.imag)


def _baseline(time: Array, frequency: float) -> Array:
    """Return the functions of time that describe the slow motion of the beam, one in each column."""
    span = time[-1] - time[0]
    # The functions are so slow that they cannot follow the vibration.
    inner = int(np.clip(span * frequency / _KNOT_PERIODS - 1, 0, _MOST_KNOTS))
    x = (time - time[0]) / span
    # The material recovers fastest at the start, so the knots are denser there.
    ends = np.linspace(0, 1, inner + 2) ** 1.5
    degree = 3 if inner else 1
    knots = np.concatenate([np.zeros(degree), ends, np.ones(degree)])
    return np.asarray(scipy.interpolate.BSpline.design_matrix(np.minimum(x, 1.0), knots, degree).toarray())


def _misfit(signals: Signals, mode: Array) -> float:
    """Return the sum of squared residuals of a fit with one vibration of known frequency and loss factor."""
    orthogonal, _ = np.linalg.qr(design_matrix(signals.time_s, mode[None], np.zeros(0)))
    inner = orthogonal.T @ signals.reduced
    return float((signals.reduced**2).sum() - (inner**2).sum())


def _band_noise(signals: Signals, residuals: Array, frequency: float) -> float:
    """Return the standard deviation of white noise with the power of the residuals at a frequency in Hz."""
    n = len(residuals)
    step = (signals.time_s[-1] - signals.time_s[0]) / (n - 1)
    power = (np.abs(np.fft.rfft(residuals, axis=0)) ** 2).mean(axis=1) / n
    f = np.fft.rfftfreq(n, step)
    near = (f > 0.6 * frequency) & (f < 1.6 * frequency)
    # The fit removes noise near the fitted frequency, too: about two lines of the spectrum for each mode.
    return float(np.sqrt(power[near].mean() * near.sum() / max(near.sum() - 2, 1))) if near.sum() > 3 else 0.0
