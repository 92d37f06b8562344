"""The field of a coil that is not uniform, with a magnet or magnetised silicone in it.

The field in the plane of the beam is B(x) = q(x) F with the field F at the magnet's place at rest. As complex numbers,
B_x + i B_y, the factor q is one scalar for all currents and directions of F, with q = 1 at that place. A rigid dipole m
at the place x has the energy -m . B(x). The torque on it is m x B, and the components of the force on it are
m_j dB_j/dx_i. A magnet that is small beside the coil has the energy of a dipole in its middle. The next terms of the
expansion contain the second derivatives of B, and they add up to zero over a cube.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.interpolate import RectBivariateSpline

from eimi_fitting.beam.specimen import VACUUM_PERMEABILITY

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_NEAR_AXIS = 1e-4  # radii of the loop within which the radial field is that of its series
_DERIVATIVES = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
_SYMMETRIC = np.array([[3, 4], [4, 5]])  # where the second derivatives are in _DERIVATIVES


def loop_field(radial_m: Array, axial_m: Array, radius_m: float) -> tuple[Array, Array]:
    """Return the radial and the axial field of a circular loop per current.

    Parameters
    ----------
    radial_m, axial_m : ndarray
        Distances from the axis and, along the axis, from the plane of the loop, in m.
    radius_m : float
        Radius of the loop in m.

    Returns
    -------
    radial, axial : ndarray
        Flux density in T/A, of the shape of the distances.

    Notes
    -----
    By Biot and Savart's law with the complete elliptic integrals K and E (Smythe 1989, Static and Dynamic Electricity,
    section 7.10).
    """
    rho, z, a = np.abs(radial_m), axial_m, radius_m
    outer, inner = (a + rho) ** 2 + z**2, (a - rho) ** 2 + z**2
    k, e = special.ellipk(4 * a * rho / outer), special.ellipe(4 * a * rho / outer)
    factor = VACUUM_PERMEABILITY / (2 * np.pi * np.sqrt(outer))
    axial = factor * (k + (a**2 - rho**2 - z**2) / inner * e)
    near = rho < _NEAR_AXIS * a
    away = np.where(near, a, rho)
    radial = factor * z / away * (-k + (a**2 + rho**2 + z**2) / inner * e)
    series = 0.75 * VACUUM_PERMEABILITY * a**2 * z * rho / (a**2 + z**2) ** 2.5
    return np.sign(radial_m) * np.where(near, series, radial), axial


@dataclass(frozen=True, eq=False)
class FieldTable:
    """A field on a rectangular grid in the beam frame, interpolated by cubic splines.

    Parameters
    ----------
    x_mm, y_mm : ndarray, shape (n,) and (m,)
        Increasing places, at least four of each.
    field : ndarray, shape (n, m, 2)
        Components of the field, in any unit.
    """

    x_mm: Array
    y_mm: Array
    field: Array

    @staticmethod
    def of_loops(
        radius_mm: float, gap_mm: float, centre_mm: tuple[float, float], axis: tuple[float, float], reach_mm: float
    ) -> FieldTable:
        """Return the field of two equal coaxial loops.

        Parameters
        ----------
        radius_mm, gap_mm : float
            Radius of the loops, and distance between their planes; 0 for a single loop.
        centre_mm : tuple of float
            The point on the axis half-way between the loops, in the plane of the beam.
        axis : tuple of float
            Unit vector along the axis.
        reach_mm : float
            The table covers this distance from the clamp, and a quarter of it behind the clamp.

        Raises
        ------
        ValueError
            A loop passes through the table, where its field is infinite.
        """
        steps = int(np.ceil(np.clip(reach_mm, 20.0, 100.0)))
        places = np.linspace(-reach_mm, reach_mm, 2 * steps + 1)
        toward_tip = places[3 * steps // 4 :]  # the magnet of a clamped beam does not reach far behind the clamp
        from_centre = np.stack(np.meshgrid(toward_tip, places, indexing="ij"), axis=-1) - np.array(centre_mm)
        along, across = from_centre @ np.array(axis), from_centre @ np.array([-axis[1], axis[0]])
        ends = [along - end * 0.5 * gap_mm for end in (-1.0, 1.0)]
        nearest = min(float(np.hypot(np.abs(across) - radius_mm, end).min()) for end in ends)
        if nearest < 3 * (places[1] - places[0]):
            raise ValueError(
                f"a loop of radius {radius_mm:g} mm passes within {nearest:.2g} mm of a place that the beam may reach"
            )
        radial, axial = np.sum([loop_field(1e-3 * across, 1e-3 * end, 1e-3 * radius_mm) for end in ends], axis=0)
        field = axial[..., None] * np.array(axis) + radial[..., None] * np.array([-axis[1], axis[0]])
        return FieldTable(toward_tip, places, field)

    @cached_property
    def _splines(self) -> tuple[RectBivariateSpline, RectBivariateSpline]:
        first, second = (RectBivariateSpline(self.x_mm, self.y_mm, self.field[..., i], kx=3, ky=3) for i in range(2))
        return first, second

    def derivatives(self, points_mm: Array) -> Complex:
        """Return the complex field and its derivatives (6, B) at points (B, 2), or at the nearest edge of the table."""
        real, imaginary = self._splines
        x, y = points_mm.T
        return np.array([real.ev(x, y, i, j) + 1j * imaginary.ev(x, y, i, j) for i, j in _DERIVATIVES])

    def covers(self, points_mm: Array) -> bool:
        """Return whether all points (n, 2) lie in the table."""
        x, y = points_mm.T
        inside = (x >= self.x_mm[0]) & (x <= self.x_mm[-1]) & (y >= self.y_mm[0]) & (y <= self.y_mm[-1])
        return bool(inside.all())


@dataclass(frozen=True, eq=False)
class CoilShape:
    """The field of a coil as a function of the place, relative to the field at the magnet's place at rest.

    Parameters
    ----------
    axis : tuple of float
        Unit vector along the axis of the coil, in the beam frame. A gradient has the field of a coil with this axis.
    gradient_per_m : tuple of float
        Change of the strength per metre along x and along y, as a share of the strength. The gradient adds to that of
        the table.
    table : FieldTable or None
        The field. If it is None, the field is uniform except for the gradient.
    curvature_per_m2 : float
        Half of the second derivative of the strength along the axis, as a share of the strength. It is negative about
        the middle of a coil, whose strength decreases along the axis and increases across it by half of this amount.
    """

    axis: tuple[float, float]
    gradient_per_m: tuple[float, float] = (0.0, 0.0)
    table: FieldTable | None = None
    curvature_per_m2: float = 0.0

    def ratio(self, points_mm: Array, rest_mm: Array) -> tuple[Complex, Complex, Complex]:
        """Return the factor q at points (B, 2) and its derivatives.

        Parameters
        ----------
        points_mm : ndarray, shape (B, 2)
        rest_mm : ndarray, shape (2,)
            The place where the factor is 1.

        Returns
        -------
        q, first, second : ndarray, shapes (B,), (B, 2) and (B, 2, 2)
            The factor, its derivatives in 1/mm, and its second derivatives in 1/mm².
        """
        values = np.zeros((6, len(points_mm)), complex)
        values[0] = 1.0
        if self.table:
            values = self.table.derivatives(points_mm) / self.table.derivatives(rest_mm[None])[0]
        slope = self._slope
        values[0] += (points_mm - rest_mm) @ slope
        values[1:3] += slope[:, None]
        if self.curvature_per_m2:
            values += self._curved(points_mm - rest_mm)
        return values[0], values[1:3].T, np.moveaxis(values[_SYMMETRIC], -1, 0)

    def _curved(self, from_rest_mm: Array) -> Complex:
        """Return the part (6, B) of q and its derivatives due to the curvature c.

        With s along the axis and t across it: B_s = c (s^2 - t^2 / 2) and B_t = -c s t.
        """
        (a, b), c = self.axis, 1e-6 * self.curvature_per_m2
        s, t = from_rest_mm @ np.array([a, b]), from_rest_mm @ np.array([-b, a])
        by_s, by_t = 2 * s - 1j * t, -t - 1j * s
        first = by_s * a - by_t * b, by_s * b + by_t * a
        second = (
            2 * a * a + 2j * a * b - b * b,
            3 * a * b - 1j * (a * a - b * b),
            2 * b * b - 2j * a * b - a * a,
        )
        return np.asarray(
            c * np.array([s**2 - 0.5 * t**2 - 1j * s * t, *first, *(np.full(len(s), value) for value in second)])
        )

    @property
    def _slope(self) -> Complex:
        """Return the derivatives (2,) of the factor q due to a gradient of the strength.

        The field has neither curl nor divergence. With s along the axis and t across it: dB_s/ds = h, dB_s/dt = dB_t/ds
        = g, and dB_t/dt = -h/2.
        """
        along, across = np.array(self.axis), np.array([-self.axis[1], self.axis[0]])
        h, g = 1e-3 * np.array(self.gradient_per_m) @ np.stack([along, across], axis=1)
        return np.asarray((h + 1j * g) * along + (g - 0.5j * h) * across)


@dataclass(frozen=True)
class DipoleInField:
    """A dipole on a rigid body in the field of a coil.

    Parameters
    ----------
    shape : CoilShape
    dipole : ndarray, shape (2,)
        The moment at rest in N mm/T.
    arm_mm : ndarray, shape (2,)
        Place of the dipole from the reference point of the body, at rest.
    reference_mm : ndarray, shape (2,)
        The reference point at rest.
    field_T : ndarray, shape (B, 2)
        The field at the place of the dipole at rest; one row for each candidate, or one for all.
    """

    shape: CoilShape
    dipole: Array
    arm_mm: Array
    reference_mm: Array
    field_T: Array

    def load(self, rigid: Array) -> tuple[Array, Array]:
        """Return the load on the body and its stiffness.

        Parameters
        ----------
        rigid : ndarray, shape (B, 3)
            Translation in mm and rotation in rad of the body.

        Returns
        -------
        load : ndarray, shape (B, 3)
            Force in N and moment in N mm: minus the derivatives of the energy -m . B.
        stiffness : ndarray, shape (B, 3, 3)
            Second derivatives of the energy.
        """
        turn = np.exp(1j * rigid[:, 2])
        arm = turn * (self.arm_mm @ [1, 1j])
        place = self.reference_mm + rigid[:, :2] + np.stack([arm.real, arm.imag], axis=1)
        q, first, second = self.shape.ratio(place, self.reference_mm + self.arm_mm)
        # m . B is the real part of conj(m) B; a turn multiplies conj(m) by -i and the arm by i.
        pull = np.conj(turn * (self.dipole @ [1, 1j])) * (self.field_T @ [1, 1j])
        velocity = np.stack([-arm.imag, arm.real], axis=1)  # of the dipole, by the rotation
        towards = np.stack([-arm.real, -arm.imag], axis=1)  # derivative of the velocity
        along, bent = np.einsum("bi,bi->b", first, velocity), np.einsum("bij,bj->bi", second, velocity)
        load = np.empty((len(rigid), 3))
        load[:, :2] = (pull[:, None] * first).real
        load[:, 2] = (pull * (along - 1j * q)).real
        stiffness = np.empty((len(rigid), 3, 3))
        stiffness[:, :2, :2] = -(pull[:, None, None] * second).real
        stiffness[:, :2, 2] = stiffness[:, 2, :2] = -(pull[:, None] * (bent - 1j * first)).real
        curved = np.einsum("bi,bi->b", bent, velocity) + np.einsum("bi,bi->b", first, towards)
        stiffness[:, 2, 2] = -(pull * (curved - 2j * along - q)).real
        return load, stiffness


@dataclass(frozen=True)
class SiliconeInField:
    """Magnetised silicone in the field of a coil: one dipole in the middle of each element.

    The dipole of an element is the integral of F M: the sum of the nodes' places with the weights `dipoles`. It lies at
    the mean of the nodes' places with the weights `shares`.

    Parameters
    ----------
    shape : CoilShape
    rest_mm : ndarray, shape (2,)
        The place where the strength of the field is stated.
    nodes_mm : ndarray, shape (E, n, 2)
        Nodes of the elements at rest.
    shares, dipoles : ndarray, shape (E, n)
        Weights of the nodes in the place, and in the dipole in N/T.
    field_T : ndarray, shape (B, 2)
        The strength of the field; one row for each candidate, or one for all.
    """

    shape: CoilShape
    rest_mm: Array
    nodes_mm: Array
    shares: Array
    dipoles: Array
    field_T: Array

    def load(self, nodal: Array) -> tuple[Array, Array]:
        """Return the forces on the nodes and their stiffness.

        Parameters
        ----------
        nodal : ndarray, shape (E, B, d, n)
            Displacements of the nodes in mm.

        Returns
        -------
        force : ndarray, shape (E, B, d, n)
            Minus the derivatives of the energy in N. The energy is the sum of -m . B over the elements.
        stiffness : ndarray, shape (E, B, d, n, d, n)
            Second derivatives of the energy.
        """
        e, b, d, n = nodal.shape
        moved = nodal[:, :, :2] + self.nodes_mm.swapaxes(1, 2)[:, None]  # (E, B, 2, n)
        places, dipoles = (np.einsum("ebin,en->ebi", moved, w) for w in (self.shares, self.dipoles))
        ratios = self.shape.ratio(places.reshape(-1, 2), self.rest_mm)
        q, first, second = (r.reshape(e, b, *r.shape[1:]) for r in ratios)
        field = np.broadcast_to(self.field_T @ [1, 1j], b)[None]
        slope, bent = field[..., None] * first, field[..., None, None] * second
        pull = np.conj(dipoles @ [1, 1j])  # m . B is the real part of conj(m) B
        along_dipole, along_place = _components(field * q), (pull[..., None] * slope).real
        force = np.zeros(nodal.shape)
        force[:, :, :2] = np.einsum("ebi,en->ebin", along_dipole, self.dipoles)
        force[:, :, :2] += np.einsum("ebi,en->ebin", along_place, self.shares)
        mixed = _components(slope)  # (E, B, k, i): the derivative of B_i along x_k
        stiffness = np.zeros((e, b, d, n, d, n))
        crossed = np.einsum("ebki,en,em->ebinkm", mixed, self.dipoles, self.shares)
        curved = np.einsum("ebik,en,em->ebinkm", (pull[..., None, None] * bent).real, self.shares, self.shares)
        stiffness[:, :, :2, :, :2] = -(crossed + crossed.transpose(0, 1, 4, 5, 2, 3) + curved)
        return force, stiffness


def _components(values: Complex) -> Array:
    """Return the real and the imaginary part of complex numbers (...) as vectors (..., 2)."""
    return np.stack([values.real, values.imag], axis=-1)
