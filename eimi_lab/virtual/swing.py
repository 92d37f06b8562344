"""Simulate how the virtual beam swings between its equilibria, for a camera that is fast enough to see it.

The shape is that of the equilibrium in an effective field b, which follows the field B of the coil like an oscillator
of one degree of freedom:

    d²b/dt² + η ω db/dt + ω² (b - B) = 0.

Its angular frequency ω is Rayleigh's quotient of the deflection u under a small force F across the tip,

    ω² = F · u(tip) / ∫ |u|² dm,

about the equilibrium without a current, with gravity and with the mass of the magnet (Lord Rayleigh, The Theory of
Sound, 1877, section 88). For a uniform cantilever, ω is 1.5 % too high; with a heavy tip the error is smaller. The
loss factor η does not depend on the frequency. Creep of the silicone is not simulated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from eimi_fitting.beam.specimen import STANDARD_GRAVITY, Specimen

Array = NDArray[np.float64]
Outlines = tuple[Array, Array | None]

LOSS_FACTOR = 0.1
_GRID = 17  # number of fields in which the shape is solved; between them it is interpolated
_SMALL = 0.02  # the force for Rayleigh's quotient, as a fraction of the weight


class Swing:
    """The effective field of a swinging beam.

    Parameters
    ----------
    angular_frequency : float
        Angular frequency of the swing, rad/s.
    loss_factor : float
        Loss factor.
    """

    def __init__(self, angular_frequency: float, loss_factor: float = LOSS_FACTOR) -> None:
        self._decay = 0.5 * loss_factor * angular_frequency
        self._ringing = angular_frequency * np.sqrt(1.0 - 0.25 * loss_factor**2)
        self._time_s: float | None = None
        self._field_mT = self._place_mT = self._speed_mT = 0.0

    def effective_field_mT(self, time_s: float, field_mT: float) -> float:
        """Return the effective field at a time, if the coil's field has changed linearly since the previous call.

        The time must not be earlier than the time of the previous call.
        """
        if self._time_s is None:
            self._time_s, self._field_mT, self._place_mT = time_s, field_mT, field_mT
        elapsed_s = time_s - self._time_s
        if elapsed_s <= 0.0:
            return self._place_mT
        # If the field changes linearly: b = B + slope · t + lag + a free oscillation that decays.
        slope = (field_mT - self._field_mT) / elapsed_s
        square = self._decay**2 + self._ringing**2
        lag = -2.0 * self._decay * slope / square
        place, speed = self._place_mT - self._field_mT - lag, self._speed_mT - slope
        cosine, sine = np.cos(self._ringing * elapsed_s), np.sin(self._ringing * elapsed_s)
        faded = np.exp(-self._decay * elapsed_s)
        other = (speed + self._decay * place) / self._ringing
        self._place_mT = field_mT + lag + faded * (place * cosine + other * sine)
        self._speed_mT = slope + faded * (
            speed * cosine - (square * place + self._decay * speed) / self._ringing * sine
        )
        self._time_s, self._field_mT = time_s, field_mT
        return float(self._place_mT)


class OutlineTable:
    """Outlines of the beam and the magnet, interpolated between solved fields.

    Parameters
    ----------
    outlines_mm : callable
        Returns the outlines (mm) in a field (mT).
    strongest_mT : float
        Largest field of the coil.
    """

    def __init__(self, outlines_mm: Callable[[float], Outlines], strongest_mT: float) -> None:
        fields = np.linspace(-strongest_mT, strongest_mT, _GRID)
        solved = [outlines_mm(float(field)) for field in fields]
        self._beam = CubicSpline(fields, np.stack([beam for beam, _ in solved]))
        magnets = [magnet for _, magnet in solved if magnet is not None]
        self._magnet = CubicSpline(fields, np.stack(magnets)) if len(magnets) == len(fields) else None

    def at(self, field_mT: float) -> Outlines:
        """Return the outlines in a field."""
        return self._beam(field_mT), None if self._magnet is None else self._magnet(field_mT)


def angular_frequency(middle_mm: Callable[[float], Array], specimen: Specimen) -> float:
    """Return the angular frequency of a beam's swing, rad/s.

    Parameters
    ----------
    middle_mm : callable
        Returns the centre line, shape (n, 2), mm, under a force across the tip, N.
    specimen : Specimen
        The beam.
    """
    magnet = specimen.magnet
    section_m2 = 1e-6 * float(np.mean(specimen.width_mm * specimen.depth_mm))
    extra_kg = 0.0
    if magnet is not None:
        volume_m3 = 1e-9 * magnet.length_mm * magnet.width_mm * magnet.depth_mm
        extra_kg = (magnet.density_kg_m3 - specimen.density_kg_m3) * volume_m3
    weight_N = STANDARD_GRAVITY * (specimen.density_kg_m3 * section_m2 * 1e-3 * specimen.length_mm + extra_kg)
    force_N = _SMALL * weight_N
    after, before = middle_mm(force_N), middle_mm(-force_N)
    moved_m = 1e-3 * (after - before)
    along_m = 1e-3 * np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(after, axis=0).T))])
    square_m2 = (moved_m**2).sum(axis=1)
    inertia = specimen.density_kg_m3 * section_m2 * np.trapezoid(square_m2, along_m)
    if magnet is not None:
        at_m = along_m[-1] - 1e-3 * (magnet.tip_offset_mm + 0.5 * magnet.length_mm)
        inertia += extra_kg * np.interp(at_m, along_m, square_m2)
    return float(np.sqrt(2.0 * force_N * moved_m[-1, 1] / inertia))
