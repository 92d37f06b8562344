"""Prony series: the relaxation of a quasi-linear viscoelastic material (Fung 1993, Biomechanics, section 7.6).

A time t after a sudden strain, and for a motion proportional to exp(s t) with a complex rate s, the shear modulus is

    mu(t) = mu_0 (1 - sum_i g_i (1 - exp(-t / tau_i))),    mu*(s) = mu_0 (1 - sum_i g_i / (1 + s tau_i)).

Here mu_0 is the instantaneous shear modulus, g_i the relative modulus and tau_i the relaxation time of term i. At
s = i omega, mu* is the complex dynamic modulus (Ferry 1980, Viscoelastic Properties of Polymers, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prony:
    """A Prony series with n terms, or several such series along the leading axes.

    Parameters
    ----------
    g : ndarray, shape (..., n)
        Relative moduli: the fraction of the instantaneous modulus that each term loses.
    tau_s : ndarray, shape (..., n)
        Relaxation times in s.

    Examples
    --------
    A material that loses 10 % of its modulus with a relaxation time of 1 s, and another 10 % with 10 s:

    >>> import numpy as np
    >>> series = Prony(np.array([0.1, 0.1]), np.array([1.0, 10.0]))
    >>> series.ratio([0.0, 1e4]).round(3).tolist()
    [1.0, 0.8]
    >>> float(series.loss_factor(2 * np.pi * 1.0).round(4))
    0.0172
    """

    g: Array
    tau_s: Array

    @property
    def long_term(self) -> Array:
        """The long-term modulus divided by the instantaneous modulus, shape (...)."""
        return np.asarray(1 - np.sum(self.g, axis=-1))

    def ratio(self, time_s: ArrayLike) -> Array:
        """Return the modulus mu(t) divided by mu(0), at m times (..., m) or at one time (...)."""
        time = np.asarray(time_s, float)
        gone = -np.expm1(-time[..., None] / _with_axes(self.tau_s, time.ndim))
        return np.asarray(1 - np.sum(_with_axes(self.g, time.ndim) * gone, axis=-1))

    def creep(self, time_s: float) -> Array:
        """Return the strain at a time after a sudden constant stress, divided by the immediate strain, shape (...)."""
        u = np.sqrt(self.g / self.tau_s)
        matrix = u[..., :, None] * u[..., None, :] - np.eye(u.shape[-1]) / self.tau_s[..., None]
        rates, modes = np.linalg.eigh(matrix)
        shares = np.einsum("...i,...ik->...k", u, modes) ** 2
        return np.asarray(1 + np.sum(shares * np.expm1(rates * time_s) / rates, axis=-1))

    def complex_ratio(self, s: NDArray[Any]) -> NDArray[np.complex128]:
        """Return the complex modulus for motions proportional to exp(s t), divided by the instantaneous modulus.

        s: complex rates in 1/s, (..., m).
        """
        axes = min(np.ndim(s), 1)
        rate = np.asarray(s, complex)[..., None]
        g, tau = _with_axes(self.g, axes), _with_axes(self.tau_s, axes)
        return np.asarray(1 - np.sum(g / (1 + rate * tau), axis=-1))

    def loss_factor(self, omega: ArrayLike) -> Array:
        """Return the loss factor Im mu* / Re mu* at angular frequencies (m,) or () in rad/s."""
        value = self.complex_ratio(1j * np.asarray(omega))
        return np.asarray(value.imag / value.real)


def _with_axes(values: Array, axes: int) -> Array:
    """Return an array (..., n) with ``axes`` additional axes of length 1 before its last axis."""
    return values if axes == 0 else values.reshape(*values.shape[:-1], *[1] * axes, values.shape[-1])
