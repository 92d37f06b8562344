"""An elastic rod with a rigid magnet, as stiff as the virtual solid beam: its kinematics, inertia and forces.

The rod follows Simo (1985, Comput. Methods Appl. Mech. Eng. 49:55), in the plane and without shear. The rotation and
the stretch of the rod are sums of Legendre polynomials of the arc length. The soft material around the magnet is
modelled as a hinge between the rod and the magnet. The bending stiffness and the stiffness of the hinge are computed
from two static shapes of the virtual solid, under a small torque and under a small force. The lowest frequency of the
rod then agrees with the lowest frequency of the solid within 0.2 %, at rest and in the strongest field.
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

Array = NDArray[np.float64]

_BENDING, _STRETCHING = 3, 1  # numbers of Legendre polynomials for bending and for stretching
_POINTS = 8  # number of Gauss points along the rod
_SMALL = 1e-3  # approximate rotation (rad) of the tip under the small loads that give the stiffness of the solid
_SHAPE_MM = 1e-8  # tolerance (mm) of the solid's shapes under these small loads


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


class Rod:
    """Kinematics, inertia and forces of the elastic rod that models the moving beam.

    The shape of the rod is described by n coordinates. The first ones are coefficients of Legendre polynomials whose
    sum, along the rod, is the curvature times the length. With a magnet, the angle of the hinge follows. The last ones
    are coefficients of Legendre polynomials whose sum is the strain. The mass of the rod is concentrated at p points:
    the Gauss points and the rigid part at the tip.
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
        """Return the two arrays that give the accelerations of the p mass points of the rod.

        The accelerations are derivatives @ dv/dt + remaining. The vector ``speed`` (n,), here v, contains the rates
        (1/s) of the n coordinates ``z`` (n,).

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
        """Return the mass matrix of the rod for its n coordinates, kg m², shape (n, n).

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
            Accelerations (x and y, m/s²) that the points have at constant rates of the coordinates (`moved`). The
            returned forces contain the inertia forces due to these accelerations.
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
        """Return the positions x (along the straight beam) and y (across) of m points of the moving beam, mm.

        The shape is (..., m, 2).

        Parameters
        ----------
        z : ndarray, shape (..., n)
            The n coordinates of the rod, for one moment or for several moments.
        along : ndarray, shape (m,)
            Arc length of each point at rest, divided by the flexible length. Values above 1 are in the rigid part.
        across_mm : ndarray, shape (m,)
            Distance of each point from the axis of the beam, mm, positive toward +y of the straight beam.
        """
        angle, stretch = z @ self.angle.T, 1 + z @ self.stretch.T
        slopes = np.stack([stretch * np.cos(angle), stretch * np.sin(angle)], axis=-2)
        values = slopes @ np.linalg.inv(legvander(leggauss(_POINTS)[0], _POINTS - 1)).T
        inside = np.minimum(along, 1.0)
        integrals = np.stack([_integral(k, inside) for k in range(_POINTS)])
        turned = z[..., :_BENDING] @ np.stack([_integral(k, inside) for k in range(_BENDING)])
        turned = np.where(along > 1, (z @ self.end)[..., None], turned)
        place = 1e3 * self.length * (values @ integrals).swapaxes(-1, -2)
        beyond = 1e3 * self.length * (along - inside)
        place += beyond[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=-1)
        return np.asarray(place + across_mm[:, None] * np.stack([-np.sin(turned), np.cos(turned)], axis=-1))


def _integral(k: int, place: Array) -> Array:
    """Return the integral of a shifted Legendre polynomial from 0 to each value of ``place``, with the same shape.

    The polynomial has the degree ``k`` and is shifted from [-1, 1] to [0, 1].
    """
    return np.asarray(0.5 * legval(2 * place - 1, legint(np.eye(k + 1)[k], lbnd=-1)))


def _body(specimen: Specimen) -> tuple[float, float, float]:
    """Return the inertia of the rigid part of the beam, which lies beyond the rod and contains the magnet.

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
