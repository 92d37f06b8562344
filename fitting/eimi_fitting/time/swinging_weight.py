"""The vibration of a beam with a hanging weight that swings like a pendulum."""

# With the deflection y of the tip and the sideways displacement x of the weight,
#
#     M y'' + k y + m w c (c y - x) = 0,    x'' + w (x - c y) = 0,
#
# where k is the complex stiffness of the beam, M its mass with the weight, m the mass of the weight, w the squared
# angular frequency of the pendulum, and c y the displacement of the upper end of the thread. The squared complex
# angular frequencies lambda_1 and lambda_2 of the two vibrations give that of the beam without a swing, k / M:
#
#     p_i = Im lambda_i / (Im lambda_1 + Im lambda_2),    w = p_2 Re lambda_1 + p_1 Re lambda_2,
#     k / M = lambda_1 lambda_2 / w.

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.time.decay_windows import Window
from eimi_fitting.time.modal_fit import ModalFit

Array = NDArray[np.float64]

_RATIOS, _LOSSES = (0.8, 0.9, 0.95, 1.05, 1.1, 1.25), (0.01, 0.05)  # of the second vibration, from which a fit starts
_FARTHEST = 1.7  # ratio of the frequencies
_APART = 1.35  # ratio of the frequencies above which the vibrations do not change each other
_NOISE = 2.0  # noise near the frequency with one vibration, divided by the stated noise, below which there is no swing
_BETTER = 0.25  # ratio of the chi-squares with two vibrations and with one
_MOST_LOSS = 0.6
_STEADY, _NEAR = 0.01, 0.1  # relative changes of the frequency: from window to window, and between the vibrations
_RISING = (0.2, 0.5)  # loss in the first window, as a share of the loss of both vibrations, see `with_swing`
_LEAST_LOSS = -0.02  # a weight that still gains energy gives a small negative loss
_SWING_ERROR = (0.005, 0.1)  # errors of ln(frequency), and of the loss factor as a share of it
_STEP = 1e-6  # of the finite differences
_PER_DISTANCE = 0.05  # further error of ln(frequency), as a share of the distance between the two vibrations


def with_swing(fitted: ModalFit, windows: Sequence[Window]) -> ModalFit | None:
    """Fit the two vibrations that a swinging weight causes; return None if the weight does not swing."""
    if fitted.noise < _NOISE:
        return None
    # The weight may also swing at half of the frequency. The equations of this module then hold approximately.
    best: ModalFit | None = None
    for ratio in _RATIOS:
        for loss in _LOSSES:
            second = np.array([[fitted.modes[0, 0] + np.log(ratio), loss]])
            two = ModalFit.of(fitted.signals, np.concatenate([fitted.modes[:1], second]), False)
            if _is_sound(two) and (best is None or two.chi2 < best.chi2):
                best = two
    if best is None or best.chi2 > _BETTER * fitted.chi2:
        return None
    if len(windows) > 1:
        is_steady = abs(windows[1].frequency_Hz / windows[0].frequency_Hz - 1) < _STEADY
        share = windows[0].loss / float(_alone(best.modes.ravel())[1])
        distance = abs(best.modes[1, 0] - best.modes[0, 0])
        if is_steady and distance < _NEAR and _RISING[0] < share < _RISING[1]:
            return None
    return best.strongest_first()


def _is_sound(two: ModalFit) -> bool:
    losses = two.modes[:, 1]
    is_close = abs(two.modes[1, 0] - two.modes[0, 0]) < np.log(_FARTHEST)
    return bool(is_close and (losses > _LEAST_LOSS).all() and (losses < _MOST_LOSS).all() and losses.max() > 0)


def of_beam(two: ModalFit) -> tuple[Array, Array]:
    """Return the vibration of the beam that would be measured if its weight did not swing."""
    # ``two``: the fit of two vibrations to the motion with the swing. The result is ln(angular frequency in rad/s) and
    # loss factor, (2,), with their covariance, (2, 2).
    at = two.modes.ravel()
    mode = _alone(at)
    ends = [_alone(at + _STEP * e) - _alone(at - _STEP * e) for e in np.eye(len(at))]
    slopes = np.stack(ends, axis=1) / (2 * _STEP)
    shares = _shares(at)
    distance = abs(two.modes[1, 0] - two.modes[0, 0]) * min(4 * shares.min(), 1.0)
    errors = np.array([np.hypot(_SWING_ERROR[0], _PER_DISTANCE * distance), _SWING_ERROR[1] * mode[1]])
    return mode, slopes @ two.covariance[: len(at), : len(at)] @ slopes.T + np.diag(errors**2)


def _squares(modes: Array) -> NDArray[np.complex128]:
    """Return the squares of the complex angular frequencies of two vibrations."""
    # ``modes`` (4,): ln(angular frequency) and loss factor of each vibration.
    log_omega, loss = modes.reshape(2, 2).T
    return np.asarray(np.exp(2 * log_omega) * (1 + 1j * np.maximum(loss, 0.0)))


def _shares(modes: Array) -> Array:
    """Return the fraction of the kinetic energy that is in the beam, not in the weight, for each of two vibrations."""
    # Only the beam loses energy, so the losses of the vibrations give these fractions.
    lost = _squares(modes).imag
    return np.asarray(lost / lost.sum())


def _alone(modes: Array) -> Array:
    """Return ln(angular frequency) and loss factor of the beam with a weight that does not swing."""
    # ``modes`` (4,): ln(angular frequency) and loss factor of each vibration with the swing.
    squares, shares = _squares(modes), _shares(modes)
    # Far apart, the vibration with the larger loss is that of the beam alone.
    if abs(modes[2] - modes[0]) > np.log(_APART):
        alone = squares[int(np.argmax(shares))]
    else:
        alone = squares.prod() / float(shares[::-1] @ squares.real)
    return np.array([0.5 * np.log(alone.real), alone.imag / alone.real])
