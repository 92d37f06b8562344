"""Frequencies and loss factors of a free vibration.

Damped vibrations are fitted to the part of a recording in which the beam vibrates freely at small amplitudes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.time.channels import Signals, TooFewFrames
from eimi_fitting.time.decay_checks import OVER_NOISE, doubts_of, is_better, refusal_of, spoilt_until_s
from eimi_fitting.time.decay_windows import Window, material_windows, scatter_of, windows_of
from eimi_fitting.time.modal_fit import SIGNIFICANT, ModalFit, exponent, with_more_modes
from eimi_fitting.time.swinging_weight import of_beam, with_swing

Array = NDArray[np.float64]

MOST_AMPLITUDE = 0.05
"""Largest amplitude in the part of a ring-down that is fitted, divided by the beam's length."""
_FEWEST_PERIODS = 5.0
_FEWEST_FRAMES = 12
_END = 0.4  # ratio of amplitude and noise at which the decay counts as ended
_SWING_ERROR = 0.005  # relative error of the frequency with a hanging weight, which also swings a little
_MOST_TOUCHED = 2.0  # periods at the start that are left out with a hanging weight, at most
_SWINGS = "; the hanging weight may swing like a pendulum: fix it to the beam, or shorten its thread"
_LASTING = 0.8  # ratio of the powers in the two halves of a recording; a decaying vibration has a smaller one
_RUN, _SPARSE = 11, 3.0  # frame gaps in a run; a run is sparse if its median gap is more than 3 times the usual gap


@dataclass(frozen=True)
class RingMode:
    """One damped vibration, with its frequency and loss factor."""

    # The vibration is exp(s t), s = -delta + i omega, with the decay rate delta and the angular frequency omega.

    # omega / (2 pi).
    frequency_Hz: float
    # Loss factor 2 delta / omega.
    loss: float
    # (2, 2): covariance of ln(frequency) and loss factor.
    covariance: Array

    @property
    def rate(self) -> complex:
        """The complex rate s = -delta + i omega in 1/s, with the decay rate delta and the angular frequency omega."""
        omega = 2 * np.pi * self.frequency_Hz
        return complex(-0.5 * self.loss * omega, omega)


@dataclass(frozen=True)
class Decay:
    """The fitted vibrations in a recording of a free vibration."""

    # n frames of the fitted part.

    # The name of the recording.
    label: str
    # The vibrations at small amplitudes, the dominant vibration first.
    modes: tuple[RingMode, ...]
    # Frequency and loss factor in parts of the recording.
    windows: tuple[Window, ...]
    # `from_s`, `to_s`: start and end of the fitted part.
    from_s: float
    to_s: float
    # Amplitude at ``from_s``, where the beam moves most.
    amplitude_mm: float
    # `frequency_change`, `loss_change`: relative change of the frequency, and change of the loss factor, from small
    # amplitudes to ``amplitude_mm``.
    frequency_change: float
    loss_change: float
    # (n,): times of the frames of the fitted part.
    time_s: Array
    # `displacement_mm`, `envelope_mm`, `modelled_mm` (n,): measured vibration, amplitude, and fitted vibrations, where
    # the beam moves most.
    displacement_mm: Array
    envelope_mm: Array
    modelled_mm: Array
    # Standard deviation of the residuals near the dominant frequency, divided by that of the noise of the recording.
    noise: float
    # Reasons to distrust the result.
    doubts: tuple[str, ...] = ()
    # (n, c): c coordinates of points without the fitted vibrations.
    baseline_mm: Array = field(default_factory=lambda: np.zeros((0, 0)))


class NoVibration(Exception):
    """A recording shows no decaying vibration that can be used."""


def decay_of(signals: Signals, label: str, length_mm: float, *, is_stepped: bool, hangs: bool = False) -> Decay:
    """Find the frequencies and loss factors in a recording of a free vibration.

    Parameters
    ----------
    signals : Signals
        The recorded motion.
    label : str
        The name of the recording, for messages.
    length_mm : float
        Length of the beam.
    is_stepped : bool
        Whether the motion begins with a step of the load at the time 0.
    hangs : bool
        Whether a weight hangs from the beam.

    Raises
    ------
    NoVibration
        No vibration is larger than the noise, or the vibration does not decay, is too large, or is too short.
    """
    if is_stepped:
        signals = signals.between(0.0, np.inf)
    signals = _dense(signals)
    frequency = _first_frequency(signals, label)
    first, last, doubts = _segment(signals, frequency, length_mm, label, is_stepped)
    part = signals.between(first, last)
    if len(part.time_s) < _FEWEST_FRAMES or (last - first) * frequency < _FEWEST_PERIODS:
        doubts_in_words = "".join(f" ({doubt.removeprefix(f'{label}: ')})" for doubt in doubts)
        raise NoVibration(
            f"{label}: at least {_FEWEST_PERIODS:g} periods in {_FEWEST_FRAMES} frames with an amplitude below "
            f"{MOST_AMPLITUDE:.0%} of the beam's length are needed; the vibration at {frequency:.3g} Hz has "
            f"{(last - first) * frequency:.1f} such periods in {len(part.time_s)} frames{doubts_in_words}"
        )
    fitted, windows, used = _fitted(part, frequency, hangs)
    swinging = with_swing(ModalFit.first_of(part, frequency), windows) if hangs else None
    if swinging is not None and refusal_of(swinging, label) is None:
        doubts.append(_swing_in_words(swinging, label))
        return _result(swinging, windows, label, doubts + doubts_of(swinging, label, hangs), hangs)
    spoilt_s = spoilt_until_s(fitted)
    if hangs and spoilt_s is not None and (spoilt_s - first) * frequency > _MOST_TOUCHED:
        spoilt_s = None  # the start is about the beam, and the later motion about the weight
    if spoilt_s is not None and (last - spoilt_s) * frequency > _FEWEST_PERIODS:
        later = _fitted(part.between(spoilt_s, np.inf), frequency, hangs)
        if is_better(later[0], fitted):
            doubts.append(
                f"{label}: the first {spoilt_s - first:.2g} s are no free vibration, as when the hand still touches "
                "the beam; these frames are not used"
            )
            fitted, windows, used = later
    if used != slice(0, len(windows)):
        doubts.append(_change_in_words(windows, used, label, hangs))
        windows = tuple(replace(w, is_used=used.start <= i < used.stop) for i, w in enumerate(windows))
    refusal = refusal_of(fitted, label)
    if refusal:
        raise NoVibration(refusal + (_SWINGS if hangs else ""))
    doubts += doubts_of(fitted, label, hangs)
    return _result(fitted, windows, label, doubts, hangs)


def _fitted(part: Signals, frequency: float, hangs: bool) -> tuple[ModalFit, tuple[Window, ...], slice]:
    """Fit damped vibrations to a recording, and their frequency and loss factor in time windows."""
    # The slice contains the windows that are used to identify the material.
    fitted = ModalFit.first_of(part, frequency)
    part = _without_end(part, fitted)
    fitted = ModalFit.of(part, fitted.modes, False)
    windows = windows_of(fitted)
    used, every = material_windows(windows, hangs), slice(0, len(windows))
    if not hangs:
        whole = with_more_modes(fitted)
        bent = ModalFit.of(whole.signals, whole.modes, True)
        if whole.chi2 - bent.chi2 > SIGNIFICANT * bent.noise**2 and len(windows) > 2 and bent.changes_little:
            whole = bent
        if used == every or whole.noise < OVER_NOISE:
            return whole, windows, every
    if used != every:
        chosen = windows[used]
        fitted = ModalFit.first_of(part.between(chosen[0].from_s, chosen[-1].to_s), chosen[0].frequency_Hz)
    if hangs:
        fitted = fitted.widened(np.hypot([_SWING_ERROR, 0.0], scatter_of(windows, used.stop, fitted.modes[0])))
    return fitted, windows, used


def _swing_in_words(swinging: ModalFit, label: str) -> str:
    first_Hz, other_Hz = np.exp(swinging.modes[:, 0]) / (2 * np.pi)
    return (
        f"{label}: the beam vibrates at {first_Hz:.4g} and at {other_Hz:.4g} Hz, as when the hanging weight swings "
        "like a pendulum at about the frequency of the beam or at half of it; the frequency without the swing is "
        "computed from both: fix the weight to the beam, or change the length of its thread"
    )


def _change_in_words(windows: tuple[Window, ...], used: slice, label: str, hangs: bool) -> str:
    """Return a warning that only a part of a free vibration is used, because frequency or loss factor change."""
    first, last = windows[used.start], windows[used.stop - 1]
    if hangs:
        return (
            f"{label}: the loss rises from {first.loss:.3g} to {max(w.loss for w in windows):.3g} while the "
            f"amplitude falls, as when the hanging weight swings like a pendulum; only the first "
            f"{last.to_s - first.from_s:.2g} s were used"
        )
    other = windows[used.stop] if used.stop < len(windows) else windows[used.start - 1]
    return (
        f"{label}: from {first.from_s:.3g} to {last.to_s:.3g} s the beam vibrates at {first.frequency_Hz:.4g} Hz with "
        f"a loss factor of {first.loss:.3g}, but next to this part at {other.frequency_Hz:.4g} Hz with "
        f"{other.loss:.3g}, as when a hand touches the beam; only this part, with the smaller loss, is used"
    )


def _dense(signals: Signals) -> Signals:
    """Return the recording up to the frame after which the frames become much rarer."""
    gaps = np.diff(signals.time_s)
    if len(gaps) < 2 * _RUN:
        return signals
    usual = float(np.quantile(gaps, 0.1))
    typical = np.median(np.lib.stride_tricks.sliding_window_view(gaps, _RUN), axis=1)
    sparse = np.flatnonzero(typical > _SPARSE * usual)
    return signals.between(-np.inf, float(signals.time_s[sparse[0] + _RUN // 2])) if len(sparse) else signals


def _first_frequency(signals: Signals, label: str) -> float:
    """Return the frequency of the largest peak in the spectrum in Hz."""
    # Without a clear peak it raises `NoVibration`.
    uniform, values = _uniform(signals)
    step = uniform[1] - uniform[0]
    span = uniform[-1] - uniform[0]
    slow = np.polynomial.polynomial.polyfit(uniform, values, 3)
    fast = values - np.polynomial.polynomial.polyval(uniform, slow).T
    size = 4 * len(uniform)
    power = (np.abs(np.fft.rfft(fast * np.hanning(len(uniform))[:, None], size, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(size, step)
    allowed = frequency >= 2.5 / span
    if not allowed.any():
        raise NoVibration(f"{label}: the recording of {span:.3g} s is too short to show a vibration")
    background = float(np.median(power[allowed]))
    # The power of creep falls with the square of the frequency. Multiplied by this square, a vibration is a peak.
    weighted = np.where(allowed, np.maximum(power - 30 * background, 0.0) * frequency**2, 0.0)
    weighted[frequency > 0.8 * frequency[-1]] = 0.0
    lasting = weighted * _lasting(fast, size)
    weighted = weighted - lasting if (weighted - lasting).any() else weighted
    best = int(np.argmax(weighted))
    peak = float(frequency[best])
    around = (np.abs(frequency / max(peak, 1e-9) - 1) < 0.15) & allowed
    if not weighted.any() or power[around].max() < 8 * background:
        raise NoVibration(
            f"{label}: no vibration from {2.5 / span:.2g} to {0.8 * frequency[-1]:.3g} Hz is clearly larger than the "
            "noise; record a larger amplitude, move the camera nearer to the beam, or record more frames per second"
        )
    return float(frequency[np.argmax(np.where(around, power, 0.0))])


def _lasting(values: Array, size: int) -> Array:
    """Return 1 for each frequency whose vibration hardly decays during the recording, else 0."""
    # ``values`` (n, r): r signals in n frames. ``size``: length of the Fourier transform.
    half = len(values) // 2
    taper = np.hanning(half)[:, None]
    early, late = (
        (np.abs(np.fft.rfft(part * taper, size, axis=0)) ** 2).sum(axis=1) for part in (values[:half], values[-half:])
    )
    # Power that does not decrease comes from a motor or a lamp, not from a free vibration.
    return np.where(late > _LASTING * early, 1.0, 0.0)


def _uniform(signals: Signals) -> tuple[Array, Array]:
    """Interpolate a recording at evenly spaced times; return the times in s and the signals."""
    time = signals.time_s
    uniform = np.linspace(time[0], time[-1], len(time))
    values = np.stack([np.interp(uniform, time, z) for z in signals.reduced.T], axis=1)
    return uniform, values


def _envelope(signals: Signals, frequency: float) -> tuple[Array, Array]:
    """Return times in s, and the amplitude of a vibration in mm at the point that moves most."""
    uniform, values = _uniform(signals)
    values = values - np.polynomial.polynomial.polyval(uniform, np.polynomial.polynomial.polyfit(uniform, values, 1)).T
    n = len(uniform)
    mirrored = np.concatenate([values[::-1], values, values[::-1]])
    spectrum = np.fft.fft(mirrored, axis=0)
    f = np.fft.fftfreq(3 * n, uniform[1] - uniform[0])
    window = np.exp(-0.5 * ((f - frequency) / (0.25 * frequency)) ** 2) * (f > 0)
    analytic = 2 * np.fft.ifft(spectrum * window[:, None], axis=0)[n : 2 * n]
    size = np.asarray((np.abs(analytic @ signals.patterns) * signals.sigma_mm).max(axis=1))
    # The straight lines in long gaps contain no vibration. There, and within one period of a gap, the result is the
    # amplitude before the gap.
    period_s = 1 / frequency
    for k in np.flatnonzero(np.diff(signals.time_s) > period_s):
        ends_s = signals.time_s[[k, k, k + 1]] + [-period_s, 0.0, period_s]
        first, gap, last = np.searchsorted(uniform, ends_s)
        size[first:last] = size[first : gap + 1].max()
    return uniform, size


def _segment(
    signals: Signals, frequency: float, length_mm: float, label: str, is_stepped: bool
) -> tuple[float, float, list[str]]:
    """Choose the part of a free vibration for the fit; return its start and end in s, and warnings."""
    time, size = _envelope(signals, frequency)
    doubts: list[str] = []
    # Without a step of the load, the ring-down is assumed to begin at the largest amplitude.
    start = 0 if is_stepped else int(np.argmax(size))
    falling = np.minimum.accumulate(size[start:])
    floor = np.quantile(size, 0.05)
    again = np.flatnonzero((size[start:] > 2.0 * falling) & (size[start:] > max(10 * floor, 0.1 * size[start:].max())))
    period = 1 / (frequency * (time[1] - time[0]))  # in frames
    again = again[again > 2.0 * period]
    again = np.array([k for k in again if _rises_abruptly(size[start:], int(k), period)], np.intp)
    stop = start + int(again[0]) - round(1.5 * period) if len(again) else len(size)
    if len(again):
        doubts.append(
            f"{label}: something moves the beam again at {time[min(stop, len(time) - 1)]:.3g} s; later frames are not "
            "used"
        )
    limit = MOST_AMPLITUDE * length_mm
    below = np.flatnonzero(size[start:stop] < limit)
    if not len(below):
        raise NoVibration(
            f"{label}: the amplitude stays above {limit:.3g} mm, which is {MOST_AMPLITUDE:.0%} of the beam's length: "
            "record for a longer time, or start with a smaller amplitude"
        )
    if size[start] > limit:
        doubts.append(
            f"{label}: in the first {time[start + below[0]] - time[start]:.2g} s the amplitude is up to "
            f"{size[start:stop].max():.2g} mm, above {MOST_AMPLITUDE:.0%} of the length; these frames are not used"
        )
    first = start + int(below[0])
    if not is_stepped and first == start:
        first += round(0.5 / frequency / (time[1] - time[0]))  # the hand may still touch the beam
    first = min(first, len(time) - 1)
    return float(time[first]), float(time[min(stop, len(time)) - 1]), doubts


def _rises_abruptly(size: Array, at: int, period: float) -> bool:
    """Return whether an amplitude rises so fast that something pushed the beam."""
    # ``size`` (n,): the amplitude in n frames. ``at``: index of the frame. ``period``: the period in frames.
    peak = at + int(np.argmax(size[at : at + round(3 * period) + 1]))
    low = np.flatnonzero(size[:peak] < size[peak] / 3)
    return bool(len(low)) and peak - int(low[-1]) <= 1.5 * period


def _without_end(signals: Signals, fitted: ModalFit) -> Signals:
    """Remove the last frames, in which the fitted vibration is smaller than the noise."""
    at_most = np.abs(fitted.linear[0]).max() + np.abs(fitted.linear[1]).max()
    time = signals.time_s - signals.time_s[0]
    size = at_most * np.exp(exponent(time, fitted.modes[0], fitted.bend).real)
    level = _END * np.sqrt((fitted.residuals**2).mean())
    over = np.flatnonzero(size < level)
    fewest = 3 * _FEWEST_PERIODS / fitted.frequency_Hz
    last = max(signals.time_s[over[0]] if len(over) else np.inf, signals.time_s[0] + fewest)
    return signals.between(-np.inf, float(last))


def _result(fitted: ModalFit, windows: tuple[Window, ...], label: str, doubts: list[str], hangs: bool) -> Decay:
    signals, count = fitted.signals, len(fitted.modes)
    covariance = fitted.covariance[: 2 * count, : 2 * count]
    is_swinging = hangs and count > 1
    modes = tuple(
        RingMode(
            float(np.exp(mode[0]) / (2 * np.pi)),
            float(mode[1]),
            covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2],
        )
        for k, mode in enumerate(fitted.modes)
    )
    if is_swinging:
        mode, of_mode = of_beam(fitted)
        modes = (RingMode(float(np.exp(mode[0]) / (2 * np.pi)), float(mode[1]), of_mode),)
    if not 0 < modes[0].loss < 1.5 or not np.isfinite(modes[0].covariance).all():
        raise NoVibration(
            f"{label}: the vibration at {modes[0].frequency_Hz:.3g} Hz does not decay{_SWINGS if hangs else ''}"
        )
    vibration = fitted.vibration_mm()
    main = int(np.argmax(np.abs(fitted.vibration_mm(0)).max(axis=0)))
    level = signals.in_mm(signals.reduced) - fitted.slow_mm()
    frequency_change = float(fitted.bend[0]) if fitted.has_bend else 0.0
    loss_change = float(2 * fitted.bend[1]) if fitted.has_bend else 0.0
    amplitude = fitted.amplitude_mm()
    if abs(frequency_change) > 0.01 or abs(loss_change) > 0.1 * modes[0].loss:
        doubts.append(
            f"{label}: at an amplitude of {amplitude[0]:.2g} mm the frequency differs by "
            f"{100 * frequency_change:+.2g} % and the loss factor by {loss_change:+.2g} from the reported values, "
            "which hold at small amplitudes"
        )
    if hangs and len(windows) < 2:
        doubts.append(f"{label}: the recording is too short to show whether the hanging weight swings like a pendulum")
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
