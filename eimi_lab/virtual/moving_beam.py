"""The motion of the virtual beam in time. The beam is modelled as a viscoelastic rod with a rigid magnet.

The forces on the n coordinates z of the rod are the elastic forces f_e(z) and a decaying force Q_i for each term of a
Prony series with the modulus mu_i and the time constant tau_i; mu_inf is the long-term modulus:

    f = f_e(z) + sum_i Q_i,    dQ_i/dt = h_i df_e/dt - Q_i / tau_i,    h_i = mu_i / mu_inf.

Integration in time: TR-BDF2 (Hosea and Shampine 1996, Appl. Numer. Math. 20:21).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws.prony import Prony
from eimi_lab.virtual.rod import Rod, Stiffness

Array = NDArray[np.float64]

_TOLERANCE = 1e-10  # relative tolerance of the rod's equilibrium
# Coefficients of TR-BDF2 (Hosea and Shampine 1996): the trapezoidal part ends at the fraction _GAMMA of a step. Both
# parts solve an implicit equation with the coefficient _PART. _ERROR contains the weights of three rates in the error
# estimate: at the beginning of the step, at the end of its trapezoidal part, and at its end.
_GAMMA = 2 - np.sqrt(2)
_PART = 0.5 * _GAMMA
_WEIGHT = 0.25 * np.sqrt(2)
_ERROR = (_WEIGHT - (1 - _WEIGHT) / 3, _WEIGHT - (3 * _WEIGHT + 1) / 3, 2 * _PART / 3)
# Permitted error of a step, divided by the distance that the rod moves in this step. At constant steps, the relative
# error of the frequency has the same size.
_ACCURACY = 1.5e-4
_SHORTEST_S, _LONGEST_S = 2e-3, 5.0  # s; steps below 2 ms would only resolve vibrations above 100 Hz
_FAILED_S = 1e-6  # s; the computation fails if even such a short step has no solution
_SLOWEST = 1e-9  # 1/s; slower motions are not resolved
_REMEMBERED = 0.97  # factor by which the largest earlier speed decreases in each step, for the permitted error
_NEWTON_STEPS = 12
_CONVERGED = 1e-5  # rad; the iteration ends at a smaller Newton step, and the error is then below 1e-7 rad
_STIFF_S = 5e-3  # s; if _PART times the step is longer, the Newton matrix also contains the change of the loads


class MovingBeam:
    """The motion of the virtual beam. The beam begins at rest, in equilibrium with the field at the first time.

    Parameters
    ----------
    specimen : Specimen
        The true specimen. Changes of its width and depth along the beam, and a bend without load, are neglected.
    stiffness : Stiffness
        The stiffness of the rod for a shear modulus of 1 Pa.
    modulus_Pa : float
        Long-term shear modulus, Pa.
    series : Prony or None
        The Prony series of the true material; None for a material with `loss_factor`.
    loads : callable
        Takes a field of the coil in mT. Returns the whole field (2,) in T and gravity (2,) in m/s² in the beam frame.
    loss_factor : float
        Loss factor of a material without a series, at the lowest frequency of the beam at rest.
    """

    def __init__(
        self,
        specimen: Specimen,
        stiffness: Stiffness,
        modulus_Pa: float,
        series: Prony | None,
        loads: Callable[[float], tuple[Array, Array]],
        loss_factor: float = 0.0,
    ) -> None:
        self.rod, self._loads = Rod(specimen, stiffness), loads
        self._elastic = modulus_Pa * self.rod.stiffness
        self._shares = series.g / float(series.long_term) if series else np.zeros(0)
        self._rates = 1 / series.tau_s if series else np.zeros(0)
        self._viscosity_s = 0.0
        if loss_factor:
            self._viscosity_s = loss_factor / self._lowest_angular_frequency()
        self.time_s: float | None = None
        # `start` sets these attributes.
        self._state: Array
        self._rate: Array
        self._step_s: float
        self._fastest: float

    def at_rest(self, field_mT: float, start: Array | None = None) -> Array:
        """Return the n coordinates of the rod in equilibrium in a field (mT), shape (n,).

        The search begins at the coordinates ``start``, by default at the straight rod. Raises ArithmeticError if no
        equilibrium is found.
        """
        still = np.zeros(self.rod.size)
        field_T, gravity = self._loads(field_mT)

        def unbalanced(z: Array) -> Array:
            derivatives, remaining = self.rod.moved(z, still)
            return (
                self.rod.loads(z, derivatives, remaining, field_T, gravity) - self._elastic * self.rod.strain(z)
            ) / self._elastic

        solved = scipy.optimize.root(unbalanced, still if start is None else start, tol=_TOLERANCE)
        if np.abs(solved.fun).max() > 1e-6:
            raise ArithmeticError(f"no equilibrium of the moving beam was found at {field_mT:g} mT")
        return np.asarray(solved.x)

    def _lowest_angular_frequency(self) -> float:
        rest, step = self.at_rest(0.0), 1e-5
        field_T, gravity = self._loads(0.0)
        still = np.zeros(self.rod.size)

        def force(z: Array) -> Array:
            return self.rod.loads(z, *self.rod.moved(z, still), field_T, gravity) - self._elastic * self.rod.strain(z)

        tangent = np.stack([(force(rest - e) - force(rest + e)) / (2 * step) for e in step * np.eye(len(rest))], axis=1)
        squares = np.linalg.eigvals(np.linalg.solve(self.rod.mass(self.rod.moved(rest, still)[0]), tangent))
        return float(np.sqrt(squares.real.min()))

    def start(self, time_s: float, field_mT: float) -> None:
        """Set the beam at rest into its equilibrium in the field ``field_mT`` (mT), at the time ``time_s`` (s)."""
        rest = self.at_rest(field_mT)
        self.time_s = time_s
        self._state = np.concatenate([rest, np.zeros(len(rest) * (1 + len(self._rates)))])
        self._rate = np.zeros_like(self._state)
        self._step_s, self._fastest = _SHORTEST_S, 0.0

    def advance(self, time_s: float, field_mT: Callable[[float], float], output_times_s: Array | None = None) -> Array:
        """Move the beam to a later time, and return its coordinates at given times.

        Parameters
        ----------
        time_s : float
            The later time, s; used only without ``output_times_s``.
        field_mT : callable
            Returns the field of the coil (mT) at any time (s) since the last call.
        output_times_s : ndarray, shape (m,), optional
            Increasing times (s), of which the last is the later time. By default the only time is ``time_s``.

        Returns
        -------
        ndarray, shape (m, n)
            The n coordinates of the rod at each of the m times.

        Raises
        ------
        ArithmeticError
            If the equations of a step have no solution.
        """
        if self.time_s is None:
            self.start(time_s, field_mT(time_s))
        assert self.time_s is not None
        n = self.rod.size
        places = []
        for end in [time_s] if output_times_s is None else output_times_s:
            while self.time_s < end - 1e-9:
                self._step(end, field_mT)
            places.append(self._state[:n].copy())
        return np.array(places).reshape(-1, n)

    def _step(self, end_s: float, field_mT: Callable[[float], float]) -> None:
        """Make one step in time, at most to the time ``end_s`` (s), and shorter if its error would be large."""
        n, before, rate = self.rod.size, self._state, self._rate
        assert self.time_s is not None
        while True:
            step = min(self._step_s, end_s - self.time_s)
            part = _PART * step
            loads = self._loads(field_mT(self.time_s + _GAMMA * step)), self._loads(field_mT(self.time_s + step))
            middle = self._solved(before + part * rate, part, loads[0])
            if middle is not None:
                of_middle = (middle - before) / part - rate
                after = self._solved(before + step * _WEIGHT * (rate + of_middle), part, loads[1])
                if after is not None:
                    of_end = (after - before - step * _WEIGHT * (rate + of_middle)) / part
                    # The error is estimated for the first coordinate, the mean curvature of the rod.
                    error = step * (_ERROR[0] * rate[0] + _ERROR[1] * of_middle[0] + _ERROR[2] * of_end[0])
                    fastest = max(abs(float(after[n])), _REMEMBERED * self._fastest, _SLOWEST)
                    ratio = abs(float(error)) / (_ACCURACY * fastest * step)
                    if ratio < 1.5 or step <= _SHORTEST_S:
                        break
                    self._step_s = max(step * max(0.2, 0.8 / np.sqrt(ratio)), _SHORTEST_S)
                    continue
            self._step_s = 0.3 * step
            if step < _FAILED_S:
                raise ArithmeticError(f"the motion of the virtual beam could not be computed at {self.time_s:.6g} s")
        self._state, self._rate, self._fastest = after, of_end, fastest
        self.time_s = self.time_s + step if step < end_s - self.time_s else end_s
        longer = self._step_s if step < self._step_s else step * min(2.0, 0.8 / np.sqrt(max(ratio, 0.1)))
        self._step_s = min(max(longer, _SHORTEST_S), _LONGEST_S)

    def _solved(self, constant: Array, part: float, loads: tuple[Array, Array]) -> Array | None:
        """Solve y = constant + part · dy/dt for y by Newton's method; None without convergence.

        The vector y contains the n coordinates of the rod, their n rates (1/s), and n forces for each term of the Prony
        series. `part` is a fraction of the step, s. `loads` are the field (T) and gravity (m/s²).
        """
        n, terms = self.rod.size, len(self._rates)
        constant_z, constant_speed = constant[:n], constant[n : 2 * n]
        constant_stress = constant[2 * n :].reshape(terms, n)
        kept = 1 / (1 + part * self._rates)
        gain = part + self._viscosity_s + float((part * self._shares * kept).sum())

        def unbalanced(speed: Array) -> tuple[Array, Array]:
            z = constant_z + part * speed
            derivatives, remaining = self.rod.moved(z, speed)
            rate = self.rod.strain_rate(z, speed)
            stress = (kept[:, None] * (constant_stress + part * self._shares[:, None] * rate)).sum(axis=0)
            elastic = self._elastic * (self.rod.strain(z) + self._viscosity_s * speed + stress)
            mass = self.rod.mass(derivatives)
            force = self.rod.loads(z, derivatives, remaining, *loads) - elastic
            return mass @ (speed - constant_speed) - part * force, mass

        speed = (self._state + part * self._rate)[n : 2 * n] if part < _STIFF_S else self._state[n : 2 * n]
        matrix: Array | None = None
        for iteration in range(_NEWTON_STEPS):
            gap, mass = unbalanced(speed)
            if matrix is None:
                matrix = mass + part * gain * np.diag(self._elastic)
                if part > _STIFF_S:  # the loads change notably within a step
                    small = 1e-6 / part
                    columns = [(unbalanced(speed + small * e)[0] - gap) / small for e in np.eye(n)]
                    matrix = np.stack(columns, axis=1)
            change = np.linalg.solve(matrix, gap)
            speed = speed - change
            if not np.isfinite(speed).all():
                return None
            if np.abs(part * change).max() < _CONVERGED:
                z = constant_z + part * speed
                rate = self.rod.strain_rate(z, speed)
                stress = kept[:, None] * (constant_stress + part * self._shares[:, None] * rate)
                return np.concatenate([z, speed, stress.ravel()])
            if iteration == _NEWTON_STEPS // 2:
                matrix = None
        return None
