"""Check whether fitted vibrations describe a recording, and whether its start is disturbed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.time.modal_fit import ModalFit, design_matrix, exponent

Array = NDArray[np.float64]

# The hand that flicks a beam may touch it again after the release. A weak clamp, a lost point and a moving support also
# cause motions that are no damped vibrations.
_SPOILT = 0.06  # share of the amplitude: a larger residual at the start is no free vibration
_OVER_LATER = 4.0  # such a residual is also this many times that of the later frames
_MOST_SPOILT = 0.4  # share of the frames that are left out at the start, at most
_BETTER = 0.6  # ratio of the unexplained shares
_DOUBTED, _REFUSED = 0.1, 0.6  # residuals divided by the fitted vibration
OVER_NOISE = 4.0  # noise near the frequency, divided by the stated noise
_FEWEST_FRAMES = 4.0  # in one period
_OTHER = 0.1  # share of the amplitude; a weaker vibration near the first one is not mentioned
_FIRST_OVERTONE = 2.5  # no second mode of a beam has a frequency below this many times the first


def spoilt_until_s(fitted: ModalFit) -> float | None:
    """Return the time in s at which a disturbance at the start of a free vibration ends, or None."""
    time = fitted.signals.time_s
    period = 1 / fitted.frequency_Hz
    window = max(3, round(period * (len(time) - 1) / (time[-1] - time[0])))
    if len(time) < 6 * window:
        return None
    kernel = np.ones(window)
    square = (fitted.residuals**2).sum(axis=1)
    residual = np.sqrt(np.convolve(square, kernel, "same") / np.convolve(np.ones(len(time)), kernel, "same"))
    size = np.sqrt(0.5 * (fitted.linear[:2] ** 2).sum())
    size = size * np.exp(exponent(time - time[0], fitted.modes[0], fitted.bend).real)
    later = float(np.median(residual[len(time) // 2 :]))
    bad = (residual > _SPOILT * size) & (residual > _OVER_LATER * later)
    if not bad[: 2 * window].any():
        return None
    # The start ends where two periods without such a residual follow.
    soon = np.array([bad[k : k + 2 * window].any() for k in range(len(bad))])
    end = int(np.argmax(~soon)) + window // 2 if not soon.all() else len(time)
    return float(time[end]) if end <= _MOST_SPOILT * len(time) else None


def unexplained_share(fitted: ModalFit) -> float:
    """Return the root mean square of the residuals, divided by the root mean square of the fitted vibrations."""
    design = design_matrix(fitted.signals.time_s, fitted.modes, fitted.bend)[:, : 2 * len(fitted.modes) + 4]
    vibration = design @ fitted.linear[: design.shape[1]]
    vibration = vibration - vibration.mean(axis=0)
    return float(np.sqrt((fitted.residuals**2).sum() / max((vibration**2).sum(), 1e-30)))


def is_better(later: ModalFit, whole: ModalFit) -> bool:
    """Return whether a fit without the disturbed start describes its frames much better than a fit to all frames."""
    return unexplained_share(later) < _BETTER * unexplained_share(whole)


def refusal_of(fitted: ModalFit, label: str) -> str | None:
    """Return the reason why fitted vibrations must not be used, or None."""
    share = unexplained_share(fitted)
    if share < _REFUSED or fitted.noise < OVER_NOISE:
        return None
    return (
        f"{label}: the motion is no damped vibration of the beam: {share:.0%} of it differs from the best fit, at "
        f"{fitted.frequency_Hz:.3g} Hz; check in a plot of the points whether the beam was followed"
    )


def doubts_of(fitted: ModalFit, label: str, hangs: bool = False) -> list[str]:
    """Return warnings about fitted vibrations, such as too few frames; `hangs`: whether a weight hangs at the tip."""
    doubts = []
    share, signals = unexplained_share(fitted), fitted.signals
    if share > _DOUBTED and fitted.noise > OVER_NOISE:
        doubts.append(
            f"{label}: {share:.0%} of the motion differs from damped vibrations, as when the support moves or a hand "
            "touches the beam; the frequency and the loss factor may be wrong by more than their intervals"
        )
    per_period = 1 / (fitted.frequency_Hz * float(np.median(np.diff(signals.time_s))))
    if per_period < _FEWEST_FRAMES:
        rate = per_period * fitted.frequency_Hz
        doubts.append(
            f"{label}: only {per_period:.2g} frames show one period of {fitted.frequency_Hz:.3g} Hz; a vibration of "
            f"{rate - fitted.frequency_Hz:.3g} Hz would look the same at {rate:.3g} frames per second, so record with "
            "more frames per second"
        )
    sizes = [float(np.abs(signals.in_mm(fitted.linear[2 * k : 2 * k + 2])).max()) for k in range(len(fitted.modes))]
    for mode, size in zip(fitted.modes[1:], sizes[1:], strict=True):
        ratio = float(np.exp(mode[0] - fitted.modes[0, 0]))
        if not hangs and ratio < _FIRST_OVERTONE and size > _OTHER * sizes[0]:
            doubts.append(
                f"{label}: the beam also vibrates at {ratio * fitted.frequency_Hz:.4g} Hz, with {size / sizes[0]:.0%} "
                f"of the amplitude of the vibration at {fitted.frequency_Hz:.4g} Hz, as when it also swings out of the "
                "plane of the picture or its support vibrates; the stronger vibration is used"
            )
    return doubts
