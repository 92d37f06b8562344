"""Simulate creep and small vibrations of the rod of the virtual rig, a hundred times faster than `MovingBeam`.

The creep is integrated without inertia, and the lowest vibration (from the linearised forces) is added. The sum is
exact for small vibrations only.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from eimi_fitting.beam.modal_motion import complex_roots
from eimi_fitting.laws.prony import Prony
from eimi_lab.virtual.rod import Rod

Array = NDArray[np.float64]

_FIRST_S, _STEPS_PER_DECADE = 2e-3, 10  # of the integration after a change of the field
_CHORDS = 3  # Newton steps with one tangent
_STEP = 1e-6  # of the finite differences
_TANGENTS_S = np.geomspace(0.02, 20.0, 7)  # times after a change of the field at which the vibration is computed


class CreepingRod:
    """A viscoelastic rod that begins at rest in a field. Its shape has n coordinates, as in `Rod`.

    Parameters
    ----------
    rod : Rod
        The elastic model.
    at_rest_Pa : float
        Long-term shear modulus.
    series : Prony
        The Prony series of the material.
    loads : callable
        Function from the field of the coil (mT) to the whole field (2,) in T and gravity (2,) in m/s².
    field_mT : float
        The field at the beginning.
    """

    def __init__(
        self,
        rod: Rod,
        at_rest_Pa: float,
        series: Prony,
        loads: Callable[[float], tuple[Array, Array]],
        field_mT: float = 0.0,
    ) -> None:
        self.rod, self._loads, self._field_mT = rod, loads, field_mT
        self._elastic = at_rest_Pa * rod.stiffness
        self._series = series
        self._shares, self._rates = series.g / float(series.long_term), 1 / series.tau_s
        self._memory = np.zeros((len(self._shares), rod.size))
        self.coordinates = np.zeros(rod.size)
        for _ in range(40):  # from the straight rod into the field in small changes of the loads
            self.coordinates = self._balanced(self.coordinates, self._memory, np.zeros(len(self._shares)), field_mT)

    def _force(self, z: Array, field_mT: float) -> Array:
        derivatives, remaining = self.rod.moved(z, np.zeros_like(z))
        return self.rod.loads(z, derivatives, remaining, *self._loads(field_mT))

    def _tangent(self, z: Array, field_mT: float) -> Array:
        """Return the derivatives of the loads with respect to the n coordinates of the shape, (n, n)."""
        ends = [self._force(z + e, field_mT) - self._force(z - e, field_mT) for e in _STEP * np.eye(len(z))]
        return np.stack(ends, axis=1) / (2 * _STEP)

    def _strain_derivatives(self, z: Array) -> Array:
        """Return the derivatives of the n strains with respect to the n coordinates of the shape, (n, n)."""
        return np.stack([self.rod.strain_rate(z, e) for e in np.eye(len(z))], axis=1)

    def _balanced(self, z: Array, faded: Array, gains: Array, field_mT: float) -> Array:
        """Return the n coordinates after a step in time, at which internal forces and loads balance.

        z : coordinates before the step, (n,)
        faded : strains that each term of the Prony series still remembers from before the step, (terms, n)
        gains : share of the change of strain in this step that each term remembers, (terms,)
        """
        gain = float(gains.sum())
        # One-sided differences are exact enough for Newton's method, and half as expensive as `_tangent`.
        force = self._force(z, field_mT)
        tangent = np.stack([self._force(z + e, field_mT) - force for e in _STEP * np.eye(len(z))], axis=1) / _STEP
        matrix = (1 + gain) * self._strain_derivatives(z) - tangent / self._elastic[:, None]
        new, strain = z, self.rod.strain(z)
        for _ in range(_CHORDS):
            moved = self.rod.strain(new)
            gap = moved + faded.sum(axis=0) + gain * (moved - strain) - self._force(new, field_mT) / self._elastic
            new = new - np.linalg.solve(matrix, gap)
        return new

    def hold(self, field_mT: float, seconds: float) -> tuple[Array, Array]:
        """Change the field at once, and return the creep: m times (s), (m,), and n coordinates, (m, n)."""
        decades = np.log10(seconds / _FIRST_S)
        times = np.append(0.0, np.geomspace(_FIRST_S, seconds, int(np.ceil(_STEPS_PER_DECADE * decades)) + 1))
        slow = []
        parts = 8  # of a change of the field, so that Newton's method follows a large one
        for part in range(1, parts + 1):
            field = self._field_mT + (field_mT - self._field_mT) * part / parts
            self._advance(1e-7, field)
        slow.append(self.coordinates)
        for span in np.diff(times):
            self._advance(float(span), field_mT)
            slow.append(self.coordinates)
        self._field_mT = field_mT
        return times, np.array(slow)

    def _advance(self, span_s: float, field_mT: float) -> None:
        kept = np.exp(-span_s * self._rates)
        gains = self._shares * (1 - kept) / (span_s * self._rates)
        faded = kept[:, None] * self._memory
        new = self._balanced(self.coordinates, faded, gains, field_mT)
        self._memory = faded + gains[:, None] * (self.rod.strain(new) - self.rod.strain(self.coordinates))
        self.coordinates = new

    def rates(self, coordinates: Array, field_mT: float) -> tuple[NDArray[np.complex128], Array, Array]:
        """Return the complex rates (1/s) of the lowest vibration about several bent shapes, (shapes,).

        A rate is minus the decay rate plus i times the angular frequency. Also returned, for the first shape: the mode
        of vibration, (n,), and the mass matrix, (n, n).
        coordinates : (shapes, n)
        """
        still = np.zeros(self.rod.size)
        masses = np.stack([self.rod.mass(self.rod.moved(z, still)[0]) for z in coordinates])
        rest = -np.stack([self._tangent(z, field_mT) for z in coordinates])
        rest = 0.5 * (rest + rest.swapaxes(1, 2))
        material = np.stack([self._elastic[:, None] * self._strain_derivatives(z) for z in coordinates])
        long_term = float(self._series.long_term)
        roots = complex_roots(material, rest, masses, lambda s: self._series.complex_ratio(s) / long_term, 1)[:, 0]
        stiffening = float(np.real(self._series.complex_ratio(1j * roots[0].imag)) / long_term)
        values, vectors = np.linalg.eig(np.linalg.solve(masses[0], stiffening * material[0] + rest[0]))
        return roots, np.real(vectors[:, int(np.argmin(values.real))]), masses[0]

    def record(self, field_mT: float, seconds: float, times_s: Array, vibrates: bool = True) -> tuple[Array, complex]:
        # Change the field at once; return the n coordinates of the rod at m times after it, and a complex rate (1/s).
        # The rate (decay and angular frequency) of the vibration changes with the creep. It is returned for the time at
        # which the amplitude has fallen to a fifteenth. vibrates : False for creep alone
        before = self.coordinates
        times, slow = self.hold(field_mT, seconds)
        motion = CubicSpline(np.log(times[1:]), slow[1:])(np.log(times_s))
        near = CubicSpline(np.log(times[1:]), slow[1:])(np.log(_TANGENTS_S[seconds > _TANGENTS_S]))
        roots, mode, mass = self.rates(near, field_mT)
        logs = np.log(_TANGENTS_S[: len(roots)])
        at = np.log(min(-2.7 / roots[0].real, seconds))
        chosen = complex(np.interp(at, logs, roots.real), np.interp(at, logs, roots.imag))
        if not vibrates:
            return motion, chosen
        amplitude = mode @ mass @ (before - slow[0]) / (mode @ mass @ mode)
        fine = np.append(0.0, np.geomspace(1e-3, seconds, 400))
        at = np.log(np.maximum(fine, 1e-3))
        rate = np.interp(at, logs, roots.real) + 1j * np.interp(at, logs, roots.imag)
        phase = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(fine)))
        smooth = CubicSpline(fine, np.stack([phase.real, phase.imag], axis=1))(times_s)
        vibration = amplitude * np.exp(np.maximum(smooth[:, 0], -60.0)) * np.cos(smooth[:, 1])
        return motion + vibration[:, None] * mode, chosen
