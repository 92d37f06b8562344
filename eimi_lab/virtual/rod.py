"""An elastic rod with a rigid magnet, as stiff as the virtual solid beam: its kinematics, inertia and forces.

The rod follows Simo (1985, Comput. Methods Appl. Mech. Eng. 49:55), in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import prod

import numpy as np
from numpy.polynomial.legendre import leggauss, legint, legval, legvander
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.law import Law
from eimi_fitting.laws.tensile import engineering_stress

Array = NDArray[np.float64]

_BENDING, _STRETCHING = 3, 2  # numbers of Legendre polynomials for bending and for stretching; shear has one
_POINTS = 8  # number of Gauss points along the rod
_SMALL = 1e-3  # approximate rotation (rad) of the tip under the small loads that give the stiffness of the solid
_LARGE = 1.0  # the same under the large torque, as computed without the decrease of the torque by the rotation
_SHAPE_MM = 1e-8  # tolerance (mm) of the solid's shapes under these loads
_STRAIN = 1e-3  # of the finite differences of the tensile stress
_SHEAR = 5 / 6  # Timoshenko's factor for a rectangular section


@dataclass(frozen=True)
class Stiffness:
    """The stiffness of the rod, divided by the shear modulus (Pa) of its material.

    With the curvature k (1/m) and the tensile strain e, the bending moment is the bending stiffness times k (1 -
    softening_m2 k² + by_strain e).

    Attributes
    ----------
    length_m : float
        Length of the rod, m.
    hinge_m3 : float
        Stiffness of the hinge between rod and magnet, N m per Pa; infinite without a magnet.
    softening_m2 : float
        Coefficient of k² in the bending moment.
    by_strain : float
        Coefficient of e in the bending moment.
    """

    length_m: float
    hinge_m3: float
    softening_m2: float = 0.0
    by_strain: float = 0.0


def stiffness_of_solid(
    specimen: Specimen, law: str, values: tuple[float, ...], mesh: tuple[int, int, int]
) -> Stiffness:
    """Return the stiffness of a rod whose tip rotates like the tip of the solid beam under loads at the tip.

    Parameters
    ----------
    specimen : Specimen
        The specimen.
    law : str
        Name of the hyperelastic law.
    values : tuple of float
        Parameters of the law, moduli in Pa.
    mesh : tuple of int
        Numbers of elements of the solid along and across the beam, and number of elements in each part of the depth in
        addition to the usual number.

    Raises
    ------
    ArithmeticError
        If the solid has no equilibrium under a small load.
    """
    modulus = float(LAWS[law].initial_shear_modulus(np.array(values)))
    flexible, whole = 1e-3 * specimen.flexible_length_mm, 1e-3 * specimen.length_mm
    bending, by_strain = modulus * _bending_m4(specimen), _by_strain(LAWS[law], np.array(values))
    model = SolidBeside(specimen, *mesh)

    def turn(loads: Loads) -> float | None:
        shapes = model.solve(LAWS[law], np.array([values]), loads, tolerance_mm=_SHAPE_MM)
        return float(np.radians(model.tip_angle_deg(shapes)[0, 0])) if shapes.converged[0] else None

    # The rod begins at a short distance from the clamp, because the clamp keeps the section from changing its shape;
    # the hinge models the soft material around the magnet. Length, hinge and softening follow from a small force, a
    # small torque and a large torque. The lowest frequency then agrees with that of a fine mesh of the solid within
    # 0.06 %.
    force_N = _SMALL * bending / (flexible * (whole - 0.5 * flexible))
    unloaded = Loads.along([0.0], gravity_angle_deg=None)
    turned = turn(replace(unloaded, tip_force_N=np.array([[0.0, force_N]])))
    magnet = specimen.magnet
    if magnet is None:
        if turned is None:
            raise ArithmeticError(_NO_SHAPE)
        return Stiffness(float(np.sqrt(2 * bending * turned / force_N)), np.inf, 0.0, by_strain)
    across, torque_Nm = 90.0 + magnet.magnetisation_angle_deg, bending / flexible
    # The field turns with neither the beam nor the magnet: its torque decreases with the cosine of the rotation.
    by_small, by_large = (
        turn(Loads.along([1e3 * size * torque_Nm / magnet.moment_A_m2], across, None)) for size in (_SMALL, _LARGE)
    )
    if turned is None or by_small is None:
        raise ArithmeticError(_NO_SHAPE)
    # Rotations per load of a rod with length L, bending stiffness B and hinge stiffness k. The force acts at the
    # distance e beyond the flexible part:
    # by_torque = L / B + 1 / k, by_force = L (L/2 + e) / B + e / k.
    arm, by_torque, by_force = whole - flexible, by_small / (_SMALL * torque_Nm * np.cos(by_small)), turned / force_N
    length = float(np.sqrt(2 * bending * (by_force - arm * by_torque)))
    softening = 0.0
    if by_large is not None:
        moment = _LARGE * torque_Nm * np.cos(by_large)
        of_hinge = moment * (by_torque - length / bending)
        excess = by_large - by_torque * moment
        softening = float(excess * length**2 / (by_large - of_hinge) ** 3)
        # A part of the softening is due to the change of length of the bent rod; by_strain already contains this part.
        softening -= 0.5 * by_strain**2 * _bending_m4(specimen) / (3 * _section_m2(specimen))
    return Stiffness(length, 1 / max(by_torque - length / bending, 1e-9) / modulus, softening, by_strain)


def _by_strain(law: Law, parameters: Array) -> float:
    """Return the relative change of a beam's bending stiffness for a small tensile strain, divided by the strain."""
    # the tangent modulus changes, and the cross-section becomes thinner; -3 for a neo-Hookean material
    pulled, pushed = engineering_stress(law, parameters, np.array([_STRAIN, -_STRAIN]))
    return float(2 * (pulled + pushed) / (pulled - pushed) / _STRAIN - 1)


_NO_SHAPE = "no equilibrium of the virtual beam was found under a small load"


def _bending_m4(specimen: Specimen) -> float:
    """Return the bending stiffness of a long incompressible beam with a shear modulus of 1 Pa, N m² per Pa."""
    width, depth = np.broadcast_arrays(1e-3 * np.asarray(specimen.width_mm), 1e-3 * np.asarray(specimen.depth_mm))
    return float(3 / np.mean(12 / (width**3 * depth)))


def _section_m2(specimen: Specimen) -> float:
    return 1e-6 * float(np.mean(specimen.width_mm * specimen.depth_mm))


class Rod:
    """Kinematics, inertia and forces of the elastic rod that models the moving beam.

    The n coordinates of the rod are coefficients of Legendre polynomials for the curvature, the angle of the hinge at
    the magnet (if any), coefficients for the strain, and the shear. The mass is concentrated at p points.
    """

    def __init__(self, specimen: Specimen, stiffness: Stiffness) -> None:
        # The mass points are the Gauss points and the rigid part at the tip.
        x, weights = leggauss(_POINTS)
        place = 0.5 * (x + 1)
        magnet = specimen.magnet
        hinges = 1 if magnet else 0
        self.size = _BENDING + hinges + _STRETCHING + 1
        self.length, self._flexible = stiffness.length_m, 1e-3 * specimen.flexible_length_mm
        section, density = _section_m2(specimen), specimen.density_kg_m3
        values, ends = np.linalg.inv(legvander(x, _POINTS - 1)), np.append(place, 1.0)
        # Integrals of functions given at the Gauss points, up to each of these points and to the end.
        self._up_to = np.stack([_integral(k, ends) for k in range(_POINTS)], axis=1) @ values
        self.angle = np.zeros((_POINTS, self.size))
        self.stretch = np.zeros((_POINTS, self.size))
        self.shear = np.zeros(self.size)
        self.shear[-1] = 1.0
        self.end = np.zeros(self.size)
        for k in range(_BENDING):
            self.angle[:, k], self.end[k] = _integral(k, place), _integral(k, np.ones(1))[0]
        for k in range(_STRETCHING):
            self.stretch[:, _BENDING + hinges + k] = legvander(x, k)[:, k]
        norms = 1 / (2 * np.arange(max(_BENDING, _STRETCHING)) + 1)
        self.stiffness = np.concatenate(
            [
                _bending_m4(specimen) / self.length * norms[:_BENDING],
                [stiffness.hinge_m3] * hinges,
                3 * section * self.length * norms[:_STRETCHING],
                [_SHEAR * section * self.length],
            ]
        )
        self._bends = legvander(x, _BENDING - 1)
        self._softens = stiffness.softening_m2 / self.length**2 * 0.5 * weights[:, None] * self._bends
        self._softens /= norms[:_BENDING]
        self._first_stretch = _BENDING + hinges
        stretches = legvander(x, _STRETCHING - 1)
        self._stretches = stretches
        self._bends_stretched = stiffness.by_strain * 0.5 * weights[:, None] * self._bends / norms[:_BENDING]
        ratio = _bending_m4(specimen) / (3 * section * self.length**2)
        self._stretches_bent = 0.5 * ratio * stiffness.by_strain * 0.5 * weights[:, None] * stretches
        self._stretches_bent /= norms[:_STRETCHING]
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
        """Return two arrays that give the accelerations of the p mass points of the rod.

        The accelerations are derivatives @ dv/dt + remaining, with the rates v = ``speed`` (1/s) of the n coordinates
        ``z``.

        Returns
        -------
        derivatives : ndarray, shape (2, p, n)
            Derivatives of the positions (x and y, m) with respect to the coordinates.
        remaining : ndarray, shape (2, p)
            Accelerations (x and y, m/s²) at constant rates of the coordinates.
        """
        angle, stretch, sheared = self._angles @ z, 1 + self.stretch @ z, float(z[-1])
        turning, stretching, shearing = self._angles @ speed, self.stretch @ speed, float(speed[-1])
        c, s = np.cos(angle), np.sin(angle)
        inner_c, inner_s, square, twice = c[:-1, None], s[:-1, None], turning[:-1] ** 2, 2 * turning[:-1]
        # The derivative of the place along the rod is the stretched tangent and the sheared normal of the section.
        tx, ty = stretch * c[:-1] - sheared * s[:-1], stretch * s[:-1] + sheared * c[:-1]
        slopes = np.empty((2, _POINTS, self.size))
        slopes[0] = inner_c * self.stretch - inner_s * self.shear - ty[:, None] * self.angle
        slopes[1] = inner_s * self.stretch + inner_c * self.shear + tx[:, None] * self.angle
        bent = np.empty((2, _POINTS))
        bent[0] = -tx * square - twice * (s[:-1] * stretching + c[:-1] * shearing)
        bent[1] = -ty * square + twice * (c[:-1] * stretching - s[:-1] * shearing)
        derivatives, remaining = self._scaled @ slopes, bent @ self._scaled.T
        derivatives[0, -1] -= self._arm * s[-1] * self.end
        derivatives[1, -1] += self._arm * c[-1] * self.end
        remaining[0, -1] -= self._arm * c[-1] * turning[-1] ** 2
        remaining[1, -1] -= self._arm * s[-1] * turning[-1] ** 2
        return derivatives, remaining

    def strain(self, z: Array) -> Array:
        """Return the n generalised elastic forces at the coordinates z, each divided by its linear stiffness."""
        strain, stretch = z.copy(), slice(self._first_stretch, self._first_stretch + _STRETCHING)
        bent, stretched = self._bends @ z[:_BENDING], self._stretches @ z[stretch]
        strain[:_BENDING] += (bent * stretched) @ self._bends_stretched - bent**3 @ self._softens
        strain[stretch] += bent**2 @ self._stretches_bent
        return strain

    def strain_rate(self, z: Array, speed: Array) -> Array:
        """Return the time derivative of `strain`."""
        # The result is in 1/s, shape (n,). `z` are the generalised coordinates, `speed` their rates in 1/s, both (n,).
        rate, stretch = speed.copy(), slice(self._first_stretch, self._first_stretch + _STRETCHING)
        bent, bending = self._bends @ z[:_BENDING], self._bends @ speed[:_BENDING]
        stretched, stretching = self._stretches @ z[stretch], self._stretches @ speed[stretch]
        rate[:_BENDING] += (bending * stretched + bent * stretching) @ self._bends_stretched
        rate[:_BENDING] -= 3 * bent**2 * bending @ self._softens
        rate[stretch] += 2 * bent * bending @ self._stretches_bent
        return rate

    def mass(self, derivatives: Array) -> Array:
        """Return the mass matrix of the rod for its n coordinates, kg m², shape (n, n).

        ``derivatives`` (2, p, n): derivatives of the positions of the p mass points.
        """
        flat = derivatives.reshape(-1, self.size)
        return np.asarray(flat.T @ (self._twice * flat) + self._rotary)

    def loads(self, z: Array, derivatives: Array, remaining: Array, field_T: Array, gravity: Array) -> Array:
        """Return the generalised forces on the n coordinates of the rod without elastic forces, N m, shape (n,).

        Parameters
        ----------
        z : ndarray, shape (n,)
            The coordinates of the rod.
        derivatives : ndarray, shape (2, p, n)
            Derivatives of the positions (x and y, m) of the p mass points with respect to the coordinates.
        remaining : ndarray, shape (2, p)
            Accelerations (x and y, m/s²) of the mass points at constant rates of the coordinates.
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
        """Return the positions of m points of the moving beam, mm, shape (..., m, 2).

        x runs along the straight beam, y across.

        Parameters
        ----------
        z : ndarray, shape (..., n)
            The n coordinates of the rod.
        along : ndarray, shape (m,)
            Arc length of each point at rest, divided by the flexible length; above 1 in the rigid part.
        across_mm : ndarray, shape (m,)
            Distance of each point from the axis of the beam, mm, positive toward +y.
        """
        angle, stretch, sheared = z @ self.angle.T, 1 + z @ self.stretch.T, z[..., -1:]
        c, s = np.cos(angle), np.sin(angle)
        slopes = np.stack([stretch * c - sheared * s, stretch * s + sheared * c], axis=-2)
        values = slopes @ np.linalg.inv(legvander(leggauss(_POINTS)[0], _POINTS - 1)).T
        before = self._flexible - self.length  # the part at the clamp that does not move
        inside = np.clip((np.minimum(along, 1.0) * self._flexible - before) / self.length, 0.0, 1.0)
        integrals = np.stack([_integral(k, inside) for k in range(_POINTS)])
        turned = z[..., :_BENDING] @ np.stack([_integral(k, inside) for k in range(_BENDING)])
        turned = np.where(along > 1, (z @ self.end)[..., None], turned)
        place = 1e3 * self.length * (values @ integrals).swapaxes(-1, -2)
        place[..., 0] += 1e3 * np.minimum(along * self._flexible, before)
        beyond = 1e3 * self._flexible * (along - np.minimum(along, 1.0))
        place += beyond[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=-1)
        return np.asarray(place + across_mm[:, None] * np.stack([-np.sin(turned), np.cos(turned)], axis=-1))


def _integral(k: int, place: Array) -> Array:
    """Return the integral of the Legendre polynomial of degree ``k``, shifted to [0, 1], from 0 to each ``place``."""
    return np.asarray(0.5 * legval(2 * place - 1, legint(np.eye(k + 1)[k], lbnd=-1)))


def _body(specimen: Specimen) -> tuple[float, float, float]:
    """Return mass (kg), centre of mass (m from the rod) and moment of inertia (kg m²) of the rigid part at the tip."""
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
