"""The vibration of a beam with a hanging weight that swings like a pendulum.

A weight on a thread exchanges energy with the beam, most of all if it swings at about the frequency of the beam or at
half of this frequency. There are then two vibrations of almost equal frequency, and neither of them has the frequency
that the beam would have if the weight did not swing. This module computes this frequency from the two vibrations. Let y
be the deflection of the tip, c y the sideways displacement of the upper end of the thread, and x that of the weight.
Let m be the mass of the weight, M the mass of the moving beam with the weight, and g the acceleration of gravity. Then

    M y'' + k y + m w c (c y - x) = 0,    x'' + w (x - c y) = 0,    w = g / length of the thread,

where k is the complex stiffness of the beam. The squares lambda_1 and lambda_2 of the complex angular frequencies are
the eigenvalues of a symmetric matrix with the determinant w k / M. Only the beam loses energy, the weight does not. The
share of the beam in the kinetic energy of vibration i is therefore p_i = Im lambda_i / (Im lambda_1 + Im lambda_2). The
eigenvalues thus give the squared angular frequencies of the pendulum, w, and of the beam without a swing, k / M:

    w = p_2 Re lambda_1 + p_1 Re lambda_2,    k / M = lambda_1 lambda_2 / w.

If the weight swings at half of the frequency, the equations are not linear, and the result holds approximately. If the
two frequencies are far apart, the vibration with the larger loss is that of the beam alone.
"""

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
    """Return a fit of the two vibrations that a swinging weight causes, or None if the weight does not swing.

    fitted: the fit of one vibration to the same frames; windows: its frequency and loss factor in parts of the
    recording.
    """
    if fitted.noise < _NOISE:
        return None
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
    """Return the vibration that the beam would have if its hanging weight did not swing, and its covariance.

    two: the fit of two vibrations to the motion of the beam with the swinging weight.

    Returns
    -------
    mode : ndarray, shape (2,)
        ln(angular frequency in rad/s), and loss factor.
    covariance : ndarray, shape (2, 2)
        Covariance matrix of these two quantities.
    """
    at = two.modes.ravel()
    mode = _alone(at)
    ends = [_alone(at + _STEP * e) - _alone(at - _STEP * e) for e in np.eye(len(at))]
    slopes = np.stack(ends, axis=1) / (2 * _STEP)
    shares = _shares(at)
    distance = abs(two.modes[1, 0] - two.modes[0, 0]) * min(4 * shares.min(), 1.0)
    errors = np.array([np.hypot(_SWING_ERROR[0], _PER_DISTANCE * distance), _SWING_ERROR[1] * mode[1]])
    return mode, slopes @ two.covariance[: len(at), : len(at)] @ slopes.T + np.diag(errors**2)


def _squares(modes: Array) -> NDArray[np.complex128]:
    """Return the squares of the complex angular frequencies of two vibrations, (2,).

    modes: ln(angular frequency) and loss factor of the first vibration, then of the second one, (4,).
    """
    log_omega, loss = modes.reshape(2, 2).T
    return np.asarray(np.exp(2 * log_omega) * (1 + 1j * np.maximum(loss, 0.0)))


def _shares(modes: Array) -> Array:
    """Return the fraction of the kinetic energy that is in the beam, not in the weight, for two vibrations, (2,).

    modes: ln(angular frequency) and loss factor of the first vibration, then of the second one, (4,).
    """
    lost = _squares(modes).imag
    return np.asarray(lost / lost.sum())


def _alone(modes: Array) -> Array:
    """Return ln(angular frequency) and the loss factor of the beam with a weight that does not swing, (2,).

    modes: ln(angular frequency) and loss factor of the first vibration with the swinging weight, then of the second
    one, (4,).
    """
    squares, shares = _squares(modes), _shares(modes)
    if abs(modes[2] - modes[0]) > np.log(_APART):
        alone = squares[int(np.argmax(shares))]
    else:
        alone = squares.prod() / float(shares[::-1] @ squares.real)
    return np.array([0.5 * np.log(alone.real), alone.imag / alone.real])
