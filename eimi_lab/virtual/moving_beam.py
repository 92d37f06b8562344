"""The motion of the virtual beam in time: an elastic rod with a rigid magnet, as stiff as the solid beam.

The rod follows Simo (1985, Comput. Methods Appl. Mech. Eng. 49:55), in the plane and without shear. The rotation and
the stretch of the rod are sums of Legendre polynomials of the arc length. The soft material around the magnet is
modelled as a hinge between the rod and the magnet. The bending stiffness and the stiffness of the hinge are computed
from two static shapes of the virtual solid, under a small torque and under a small force. The lowest frequency of the
rod then agrees with the lowest frequency of the solid within 0.2 %, at rest and in the strongest field.

The true material, which a fit does not know, is quasi-linear viscoelastic, with a Prony series. The elastic forces
f_e(z) of the rod, as a function of its coordinates z, are replaced by

    f = f_e(z) + sum_i Q_i,    dQ_i/dt = h_i df_e/dt - Q_i / tau_i,    h_i = mu_i / mu_inf,

where mu_i and tau_i are the moduli and the time constants of the series and mu_inf is the long-term modulus.

Each step of the integration in time is a trapezoidal step followed by a step of the second backward difference formula
(TR-BDF2; Hosea and Shampine 1996, Appl. Numer. Math. 20:21). A fit uses neither this rod nor this method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import prod

import numpy as np
from numpy.polynomial.legendre import leggauss, legint, legval, legvander
from numpy.typing import NDArray
from scipy.optimize import root

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.prony import Prony

Array = NDArray[np.float64]

_BENDING, _STRETCHING = 3, 1  # numbers of Legendre polynomials for bending and for stretching
_POINTS = 8  # number of Gauss points along the rod
_SMALL = 1e-3  # approximate rotation (rad) of the tip under the small loads that give the stiffness of the solid
_SHAPE_MM = 1e-8  # tolerance (mm) of the solid's shapes under these small loads
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


@dataclass(frozen=True)
class Stiffness:
    """The stiffness of the rod, divided by the shear modulus (Pa) of its material.

    Attributes
    ----------
    bending_m4 : float
        Bending stiffness of the flexible part, N m² per Pa.
    hinge_m3 : float
        Stiffness of the hinge, the soft material around the magnet that lets the magnet rotate against the rod, N m per
        Pa; infinite without a magnet.
    """

    bending_m4: float
    hinge_m3: float


def stiffness_of_solid(
    specimen: Specimen, law: str, values: tuple[float, ...], mesh: tuple[int, int, int]
) -> Stiffness:
    """Return the stiffness of a rod whose tip rotates like the tip of the solid beam under a torque and under a force.

    The torque and the force act at the tip. Without a magnet only the force is used.

    Parameters
    ----------
    specimen : Specimen
        The specimen.
    law : str
        Name of the hyperelastic law.
    values : tuple of float
        Parameters of the law, moduli in Pa.
    mesh : tuple of int
        Numbers of elements of the solid along and across the beam, and the refinement factor in depth.

    Raises
    ------
    ArithmeticError
        If the solid has no equilibrium under a small load.
    """
    modulus = float(LAWS[law].initial_shear_modulus(np.array(values)))
    length, whole = 1e-3 * specimen.flexible_length_mm, 1e-3 * specimen.length_mm
    rod = modulus * 3 * _section_m2(specimen) * (1e-3 * float(np.mean(specimen.width_mm))) ** 2 / 12
    model = SolidBeside(specimen, *mesh)

    def turn(loads: Loads) -> float:
        shapes = model.solve(LAWS[law], np.array([values]), loads, tolerance_mm=_SHAPE_MM)
        if not shapes.converged[0]:
            raise ArithmeticError("no equilibrium of the virtual beam was found under a small load")
        return float(np.radians(model.tip_angle_deg(shapes)[0, 0]))

    force_N = _SMALL * rod / (length * (whole - 0.5 * length))
    unloaded = Loads.along([0.0], gravity_angle_deg=None)
    by_force = turn(replace(unloaded, tip_force_N=np.array([[0.0, force_N]]))) / force_N
    magnet = specimen.magnet
    if magnet is None:
        return Stiffness(length * (whole - 0.5 * length) / by_force / modulus, np.inf)
    across = 90.0 + magnet.magnetisation_angle_deg
    torque_Nm = _SMALL * rod / length
    by_torque = turn(Loads.along([1e3 * torque_Nm / magnet.moment_A_m2], across, None)) / torque_Nm
    # Compliances of a rod with length L, bending stiffness B and hinge stiffness k. The force acts at the distance e
    # beyond the flexible part:
    # by_torque = L / B + 1 / k, by_force = L (L/2 + e) / B + e / k.
    arm = whole - length
    bending = 0.5 * length**2 / (by_force - arm * by_torque)
    return Stiffness(bending / modulus, 1 / max(by_torque - length / bending, 1e-9) / modulus)


def _section_m2(specimen: Specimen) -> float:
    return 1e-6 * float(np.mean(specimen.width_mm * specimen.depth_mm))


class _Rod:
    """Kinematics, inertia and forces of the rod.

    The n coordinates of the rod are amplitudes of bending, the angle of the hinge (only with a magnet), and amplitudes
    of stretching. The mass of the rod is concentrated at p points: the Gauss points and the rigid part at the tip.
    """

    def __init__(self, specimen: Specimen, stiffness: Stiffness) -> None:
        x, weights = leggauss(_POINTS)
        place = 0.5 * (x + 1)
        magnet = specimen.magnet
        hinges = 1 if magnet else 0
        self.size = _BENDING + hinges + _STRETCHING
        self.length = 1e-3 * specimen.flexible_length_mm
        section, density = _section_m2(specimen), specimen.density_kg_m3
        values, ends = np.linalg.inv(legvander(x, _POINTS - 1)), np.append(place, 1.0)
        # Integrals of functions given at the Gauss points, up to each of these points and to the end.
        self._up_to = np.stack([_integral(k, ends) for k in range(_POINTS)], axis=1) @ values
        self.angle = np.zeros((_POINTS, self.size))
        self.stretch = np.zeros((_POINTS, self.size))
        self.end = np.zeros(self.size)
        for k in range(_BENDING):
            self.angle[:, k], self.end[k] = _integral(k, place), _integral(k, np.ones(1))[0]
        for k in range(_STRETCHING):
            self.stretch[:, _BENDING + hinges + k] = legvander(x, k)[:, k]
        norms = 1 / (2 * np.arange(max(_BENDING, _STRETCHING)) + 1)
        self.stiffness = np.concatenate(
            [
                stiffness.bending_m4 / self.length * norms[:_BENDING],
                [stiffness.hinge_m3] * hinges,
                3 * section * self.length * norms[:_STRETCHING],
            ]
        )
        line = density * section * self.length * 0.5 * weights
        width = 1e-3 * float(np.mean(specimen.width_mm))
        self._rotary = np.einsum("g,gk,gl->kl", line * width**2 / 12, self.angle, self.angle)
        mass, self._arm, of_body, self._moment, self._off = 0.0, 0.0, 0.0, 0.0, 0.0
        self.torques = section * self.length * 0.5 * weights, np.array(specimen.magnetisation_A_per_m)
        if magnet:
            self.end[_BENDING] = 1.0
            mass, self._arm, of_body = _body(specimen)
            self._moment, self._off = magnet.moment_A_m2, np.radians(magnet.magnetisation_angle_deg)
        self._masses = np.append(line, mass)
        self._rotary += of_body * np.outer(self.end, self.end)
        self._angles, self._scaled = np.vstack([self.angle, self.end]), self.length * self._up_to
        self._twice = np.tile(self._masses, 2)[:, None]

    def moved(self, z: Array, speed: Array) -> tuple[Array, Array]:
        """Return the kinematics of the p mass points for the coordinates ``z`` (n,) and their rates ``speed`` (n,).

        The rod has n coordinates. Their rates have the unit 1/s.

        Returns
        -------
        derivatives : ndarray, shape (2, p, n)
            Derivatives of the positions (x and y, m) of the points with respect to the n coordinates.
        remaining : ndarray, shape (2, p)
            Accelerations (x and y, m/s²) that the points have if the rates of the coordinates are constant.
        """
        angle, stretch = self._angles @ z, 1 + self.stretch @ z
        turning, stretching = self._angles @ speed, self.stretch @ speed
        c, s = np.cos(angle), np.sin(angle)
        inner_c, inner_s, square = c[:-1], s[:-1], turning**2
        tx, ty, twice = stretch * inner_c, stretch * inner_s, 2 * turning[:-1] * stretching
        slopes = np.empty((2, _POINTS, self.size))
        slopes[0] = inner_c[:, None] * self.stretch - ty[:, None] * self.angle
        slopes[1] = inner_s[:, None] * self.stretch + tx[:, None] * self.angle
        bent = np.empty((2, _POINTS))
        bent[0] = -tx * square[:-1] - inner_s * twice
        bent[1] = -ty * square[:-1] + inner_c * twice
        derivatives, remaining = self._scaled @ slopes, bent @ self._scaled.T
        derivatives[0, -1] -= self._arm * s[-1] * self.end
        derivatives[1, -1] += self._arm * c[-1] * self.end
        remaining[0, -1] -= self._arm * c[-1] * square[-1]
        remaining[1, -1] -= self._arm * s[-1] * square[-1]
        return derivatives, remaining

    def mass(self, derivatives: Array) -> Array:
        """Return the mass matrix (n, n) of the rod, kg m².

        ``derivatives`` (2, p, n) are the derivatives of the positions of the p mass points, as `moved` returns them.
        """
        flat = derivatives.reshape(-1, self.size)
        return np.asarray(flat.T @ (self._twice * flat) + self._rotary)

    def loads(self, z: Array, derivatives: Array, remaining: Array, field_T: Array, gravity: Array) -> Array:
        """Return the generalised forces on the n coordinates of the rod in N m, shape (n,), without elastic forces.

        Parameters
        ----------
        z : ndarray, shape (n,)
            The n coordinates of the rod.
        derivatives : ndarray, shape (2, p, n)
            Derivatives of the positions (x and y, m) of the p mass points with respect to the n coordinates.
        remaining : ndarray, shape (2, p)
            Accelerations (x and y, m/s²) of the points at constant rates of the coordinates, which cause inertia
            forces.
        field_T : ndarray, shape (2,)
            The magnetic field, T.
        gravity : ndarray, shape (2,)
            The acceleration of gravity, m/s².
        """
        pull = self._masses * (gravity[:, None] - remaining)
        force = pull.reshape(-1) @ derivatives.reshape(-1, self.size)
        angle = self.end @ z + self._off
        force += self._moment * (np.cos(angle) * field_T[1] - np.sin(angle) * field_T[0]) * self.end
        weights, (along, across) = self.torques
        if along or across:
            c, s = np.cos(self.angle @ z), np.sin(self.angle @ z)
            torque = (along * c - across * s) * field_T[1] - (along * s + across * c) * field_T[0]
            force += (weights * torque) @ self.angle
        return np.asarray(force)

    def places_mm(self, z: Array, along: Array, across_mm: Array) -> Array:
        """Return the positions (x and y in the beam frame, mm) of m points of the moving beam, shape (m, 2).

        Parameters
        ----------
        z : ndarray, shape (n,)
            The n coordinates of the rod.
        along : ndarray, shape (m,)
            Arc length of each point at rest, divided by the flexible length. Values above 1 are in the rigid part.
        across_mm : ndarray, shape (m,)
            Distance of each point from the axis of the beam, mm, positive toward +y of the straight beam.
        """
        angle, stretch = self.angle @ z, 1 + self.stretch @ z
        slopes = np.stack([stretch * np.cos(angle), stretch * np.sin(angle)])
        values = slopes @ np.linalg.inv(legvander(leggauss(_POINTS)[0], _POINTS - 1)).T
        inside = np.minimum(along, 1.0)
        integrals = np.stack([_integral(k, inside) for k in range(_POINTS)])
        turned = np.stack([_integral(k, inside) for k in range(_BENDING)], axis=1) @ z[:_BENDING]
        turned = np.where(along > 1, self.end @ z, turned)
        place = 1e3 * self.length * (values @ integrals).T
        beyond = 1e3 * self.length * (along - inside)
        place += beyond[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
        return np.asarray(place + across_mm[:, None] * np.stack([-np.sin(turned), np.cos(turned)], axis=1))


def _integral(k: int, place: Array) -> Array:
    """Return the integral of a shifted Legendre polynomial from 0 to each value of ``place``, with the same shape.

    The polynomial has the degree ``k`` and is shifted from [-1, 1] to [0, 1].
    """
    return np.asarray(0.5 * legval(2 * place - 1, legint(np.eye(k + 1)[k], lbnd=-1)))


def _body(specimen: Specimen) -> tuple[float, float, float]:
    """Return the inertia of the rigid part beyond the rod, which contains the magnet.

    Returns
    -------
    mass, arm, rotary : float
        The mass (kg), the distance of the centre of mass from the end of the rod (m), and the moment of inertia about
        the centre of mass (kg m²).
    """
    magnet = specimen.magnet
    assert magnet is not None
    width = float(np.mean(specimen.width_mm))
    block = np.array([specimen.length_mm - specimen.flexible_length_mm, width, float(np.mean(specimen.depth_mm))])
    size = np.array([magnet.length_mm, magnet.width_mm, magnet.depth_mm])
    of_block = 1e-9 * prod(block) * specimen.density_kg_m3
    extra = 1e-9 * prod(size) * (magnet.density_kg_m3 - specimen.density_kg_m3)
    middle, of_magnet = 0.5 * block[0], 0.5 * size[0]
    arm = (of_block * middle + extra * of_magnet) / (of_block + extra)
    rotary = of_block * ((block[:2] ** 2).sum() / 12 + (middle - arm) ** 2)
    rotary += extra * ((size[:2] ** 2).sum() / 12 + (of_magnet - arm) ** 2)
    return of_block + extra, 1e-3 * arm, 1e-6 * rotary


class MovingBeam:
    """The motion of the virtual beam. The beam begins at rest, in equilibrium with the field at the first time.

    Parameters
    ----------
    specimen : Specimen
        The true specimen. The motion neglects that a beam can be bent without load, and that its width and depth can
        change along the beam.
    stiffness : Stiffness
        The stiffness of the rod for a shear modulus of 1 Pa, as `stiffness_of_solid` returns it.
    modulus_Pa : float
        Long-term shear modulus, Pa.
    series : Prony or None
        The Prony series of the true material; None for a material whose losses `loss_factor` describes.
    loads : callable
        Takes a field of the coil in mT. Returns the whole field (2,) in T and gravity (2,) in m/s², both in the beam
        frame.
    loss_factor : float
        Loss factor of a material without a series, at the lowest frequency of the beam at rest. 0 for no losses.
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
        self.rod, self._loads = _Rod(specimen, stiffness), loads
        self._elastic = modulus_Pa * self.rod.stiffness
        self._shares = series.g / float(series.long_term) if series else np.zeros(0)
        self._rates = 1 / series.tau_s if series else np.zeros(0)
        self._viscosity_s = 0.0
        if loss_factor:
            self._viscosity_s = loss_factor / self._lowest_angular_frequency()
        self.time_s: float | None = None
        self._state = self._rate = np.zeros(0)
        self._step_s, self._fastest = _SHORTEST_S, 0.0

    @property
    def coordinates(self) -> Array:
        """The present n coordinates of the rod, shape (n,).

        The coordinates are amplitudes of bending, the angle of the hinge if there is a magnet, and the amplitude of
        stretching.
        """
        return self._state[: self.rod.size]

    def at_rest(self, field_mT: float, start: Array | None = None) -> Array:
        """Return the n coordinates of the rod in equilibrium in a field (mT), shape (n,).

        The search begins at the coordinates ``start``, by default at the straight rod. Raises ArithmeticError if no
        equilibrium is found.
        """
        still = np.zeros(self.rod.size)
        field_T, gravity = self._loads(field_mT)

        def unbalanced(z: Array) -> Array:
            derivatives, remaining = self.rod.moved(z, still)
            return (self.rod.loads(z, derivatives, remaining, field_T, gravity) - self._elastic * z) / self._elastic

        solved = root(unbalanced, still if start is None else start, tol=_TOLERANCE)
        if np.abs(solved.fun).max() > 1e-6:
            raise ArithmeticError(f"no equilibrium of the moving beam was found at {field_mT:g} mT")
        return np.asarray(solved.x)

    def _lowest_angular_frequency(self) -> float:
        rest, step = self.at_rest(0.0), 1e-5
        field_T, gravity = self._loads(0.0)
        still = np.zeros(self.rod.size)

        def force(z: Array) -> Array:
            return self.rod.loads(z, *self.rod.moved(z, still), field_T, gravity) - self._elastic * z

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
            The later time, s.
        field_mT : callable
            Returns the field of the coil (mT) at any time (s) since the last call.
        output_times_s : ndarray, shape (m,), optional
            Increasing times (s) at which the coordinates are returned. The beam then moves to the last of these times.
            By default the beam moves to ``time_s``, and only the coordinates at this time are returned.

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
        """Make one step in time, at most to the time ``end_s`` (s). The step ends earlier if its error would be large.

        ``field_mT`` returns the field of the coil (mT) at a time (s).
        """
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
        """Return the vector y that solves y = constant + part dy/dt(y), by Newton's method.

        The vector y contains the n coordinates of the rod, the n rates of the coordinates (1/s), and n internal
        stresses for each term of the Prony series.

        Parameters
        ----------
        constant : ndarray
            The part of the equation that does not depend on y, in the order of y.
        part : float
            The coefficient of the rate, s.
        loads : tuple of ndarray
            The field (2,) in T and gravity (2,) in m/s² at the new time, both in the beam frame.

        Returns
        -------
        ndarray or None
            None if Newton's method does not converge.
        """
        n, terms = self.rod.size, len(self._rates)
        constant_z, constant_speed = constant[:n], constant[n : 2 * n]
        constant_stress = constant[2 * n :].reshape(terms, n)
        kept = 1 / (1 + part * self._rates)
        gain = part + self._viscosity_s + float((part * self._shares * kept).sum())

        def unbalanced(speed: Array) -> tuple[Array, Array]:
            z = constant_z + part * speed
            derivatives, remaining = self.rod.moved(z, speed)
            stress = (kept[:, None] * (constant_stress + part * self._shares[:, None] * speed)).sum(axis=0)
            elastic = self._elastic * (z + self._viscosity_s * speed + stress)
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
                stress = kept[:, None] * (constant_stress + part * self._shares[:, None] * speed)
                return np.concatenate([constant_z + part * speed, speed, stress.ravel()])
            if iteration == _NEWTON_STEPS // 2:
                matrix = None
        return None
