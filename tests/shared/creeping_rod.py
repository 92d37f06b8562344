"""Small vibrations and slow creep of the rod of the virtual rig, without an integration of the vibrations in time.

The class `MovingBeam` of the virtual rig integrates the whole motion in time, in steps of milliseconds. Here the creep
is integrated without inertia, in steps that grow with the time since the last change of the field. The lowest vibration
is computed from the derivatives of the forces with respect to the shape of the rod, and is added. The sum is exact for
small vibrations only. It takes a hundredth of the time, so that hundreds of hidden materials can be recorded.
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
    """A viscoelastic rod that begins at rest, in equilibrium with a field.

    The n coordinates of the rod describe its shape, for example amplitudes of bending (see `Rod`).

    Parameters
    ----------
    rod : Rod
        The elastic model of the rod.
    at_rest_Pa : float
        Long-term shear modulus.
    series : Prony
        The Prony series of the material.
    loads : callable
        Takes a field of the coil in mT. Returns the whole field (2,) in T and gravity (2,) in m/s².
    field_mT : float
        The field in which the rod begins at rest.
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
        """Return the derivatives of the loads on the rod with respect to the n coordinates of its shape, (n, n)."""
        ends = [self._force(z + e, field_mT) - self._force(z - e, field_mT) for e in _STEP * np.eye(len(z))]
        return np.stack(ends, axis=1) / (2 * _STEP)

    def _strain_derivatives(self, z: Array) -> Array:
        """Return the derivatives of the n strains (`Rod.strain`) with respect to the n coordinates of the shape.

        The result has the shape (n, n).
        """
        return np.stack([self.rod.strain_rate(z, e) for e in np.eye(len(z))], axis=1)

    def _balanced(self, z: Array, faded: Array, gains: Array, field_mT: float) -> Array:
        """Return the n coordinates of the rod after a step in time, at which its internal forces balance the loads.

        Each term of the Prony series remembers earlier changes of the strains, and forgets them with its time constant.

        z: coordinates before the step, (n,). faded: for each term, the changes before this step that it still remembers
        after the step, (terms, n). gains: for each term, the share of the change in this step that it remembers after
        the step, (terms,).
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
        """Change the field at once, keep it for `seconds`, and return the creep: times, and coordinates at these times.

        The m times (s) have the shape (m,), and the n coordinates (m, n). The first time is 0; its coordinates are
        those after the elastic response to the change.
        """
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
        """Return the complex rates (1/s) of the lowest vibration of the rod about B bent shapes, shape (B,).

        The real part of a rate is the negative decay rate, and the imaginary part is the angular frequency. Also
        return, for the first shape, the mode of this vibration, (n,), and the mass matrix, (n, n). coordinates: the n
        coordinates of each shape, (B, n).
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
        """Change the field at once, keep it for `seconds`, and return the motion and the rate of its vibration.

        The motion is the n coordinates at the m times `times_s` after the change, (m, n). If `vibrates` is false, it
        contains the creep alone. The complex rate (1/s) of the vibration changes while the rod creeps; the returned
        rate is that at the time at which the vibration has become 15 times smaller.
        """
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
