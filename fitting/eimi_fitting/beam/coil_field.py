"""The non-uniform field of a coil, and the loads of this field on a magnet and on magnetised silicone."""

# Fields in the plane of the beam are complex numbers B_x + i B_y. The field at a point is q F, with the field F at the
# magnet at rest and a complex ratio q that depends on the point only. A magnet is replaced by a dipole in its middle.

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import VACUUM_PERMEABILITY

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_NEAR_AXIS = 1e-4  # radii of the loop within which the radial field is that of its series
_DERIVATIVES = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
_SYMMETRIC = np.array([[3, 4], [4, 5]])  # where the second derivatives are in _DERIVATIVES


def loop_field(radial_m: Array, axial_m: Array, radius_m: float) -> tuple[Array, Array]:
    """Return the radial and the axial field of a circular current loop, divided by the current, in T/A."""
    # Evaluated with complete elliptic integrals (Smythe 1989, Static and Dynamic Electricity, section 7.10).
    # ``radial_m``, ``axial_m``: distances from the axis, and along the axis from the plane of the loop.
    rho, z, a = np.abs(radial_m), axial_m, radius_m
    outer, inner = (a + rho) ** 2 + z**2, (a - rho) ** 2 + z**2
    k, e = scipy.special.ellipk(4 * a * rho / outer), scipy.special.ellipe(4 * a * rho / outer)
    factor = VACUUM_PERMEABILITY / (2 * np.pi * np.sqrt(outer))
    axial = factor * (k + (a**2 - rho**2 - z**2) / inner * e)
    near = rho < _NEAR_AXIS * a
    away = np.where(near, a, rho)
    radial = factor * z / away * (-k + (a**2 + rho**2 + z**2) / inner * e)
    series = 0.75 * VACUUM_PERMEABILITY * a**2 * z * rho / (a**2 + z**2) ** 2.5
    return np.sign(radial_m) * np.where(near, series, radial), axial


@dataclass(frozen=True, eq=False)
class FieldTable:
    """A magnetic field on a rectangular grid in the beam frame, interpolated by cubic splines."""

    # `x_mm`, `y_mm`: increasing coordinates of at least four grid lines each.
    x_mm: Array
    y_mm: Array
    # (n, m, 2): components (x, y) of the field at the points of the grid, in any unit.
    field: Array

    @staticmethod
    def of_loops(
        radius_mm: float, gap_mm: float, centre_mm: tuple[float, float], axis: tuple[float, float], reach_mm: float
    ) -> FieldTable:
        """Compute the field of two equal coaxial current loops, divided by the current, in T/A.

        Parameters
        ----------
        radius_mm, gap_mm : float
            Radius of the loops, and distance between them; 0 for a single loop.
        centre_mm : tuple of float
            The middle (x, y) between the loops.
        axis : tuple of float
            Unit vector (x, y) along the axis.
        reach_mm : float
            Length of the table from the clamp toward the tip and to both sides.

        Raises
        ------
        ValueError
            A loop passes through the table.
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
                f"a coil loop of radius {radius_mm:g} mm lies {nearest:.2g} mm from a place that the beam may reach, "
                "where the field of the loop is almost infinite: check the radius, the gap and the centre of the "
                "coil"
            )
        radial, axial = np.sum([loop_field(1e-3 * across, 1e-3 * end, 1e-3 * radius_mm) for end in ends], axis=0)
        field = axial[..., None] * np.array(axis) + radial[..., None] * np.array([-axis[1], axis[0]])
        return FieldTable(toward_tip, places, field)

    @cached_property
    def _splines(self) -> tuple[scipy.interpolate.RectBivariateSpline, scipy.interpolate.RectBivariateSpline]:
        first, second = (
            scipy.interpolate.RectBivariateSpline(self.x_mm, self.y_mm, self.field[..., i], kx=3, ky=3)
            for i in range(2)
        )
        return first, second

    def derivatives(self, points_mm: Array) -> Complex:
        """Return the field B_x + i B_y and its derivatives at points of the beam frame."""
        # ``points_mm`` (n, 2) gives (6, n): the field and its derivatives by x, y, xx, xy and yy.
        real, imaginary = self._splines
        x, y = points_mm.T
        return np.array([real.ev(x, y, i, j) + 1j * imaginary.ev(x, y, i, j) for i, j in _DERIVATIVES])

    def covers(self, points_mm: Array) -> bool:
        """Return whether all points lie inside the grid."""
        x, y = points_mm.T
        inside = (x >= self.x_mm[0]) & (x <= self.x_mm[-1]) & (y >= self.y_mm[0]) & (y <= self.y_mm[-1])
        return bool(inside.all())


@dataclass(frozen=True, eq=False)
class CoilShape:
    """The field of a coil at any point, relative to the field at the magnet at rest."""

    # Unit vector (x, y) along the axis of the coil.
    axis: tuple[float, float]
    # Relative change of the field strength per metre along x and along y, added to the gradient of the table.
    gradient_per_m: tuple[float, float] = (0.0, 0.0)
    # The field at the points of a grid; None: uniform except for gradient and curvature.
    table: FieldTable | None = None
    # Half of the second derivative of the relative field strength along the axis, in 1/m².
    curvature_per_m2: float = 0.0

    def ratio(self, points_mm: Array, rest_mm: Array) -> tuple[Complex, Complex, Complex]:
        """Return q = B(points) / B(rest), where B = B_x + i B_y, and the first and second derivatives of q by x, y."""
        # ``points_mm`` (B, 2), ``rest_mm`` (2,): the points and the reference point (x, y). The result: the ratio (B,),
        # its first derivatives (B, 2) in 1/mm, and its second derivatives (B, 2, 2) in 1/mm².
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
        # Return the part of `ratio` that ``curvature_per_m2`` adds, and its derivatives by x, y, xx, xy and yy.
        # The real part is the component along the axis of the coil, and the imaginary part that across the axis.
        # At s along the axis and t across it, the curvature c adds c (s^2 - t^2 / 2) along the axis and -c s t across
        # it.
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
        # The derivatives by x and y that ``gradient_per_m`` adds to those of `ratio`, in 1/mm.
        along, across = np.array(self.axis), np.array([-self.axis[1], self.axis[0]])
        h, g = 1e-3 * np.array(self.gradient_per_m) @ np.stack([along, across], axis=1)
        # h and g are the derivatives of the field component along the axis of the coil: h in the direction along the
        # axis, g in the direction across the axis. The field has no curl and no divergence. The component across the
        # axis therefore has the derivatives g (along the axis) and -h / 2 (across the axis), if the derivatives in both
        # directions across the axis are equal.
        return np.asarray((h + 1j * g) * along + (g - 0.5j * h) * across)


@dataclass(frozen=True)
class DipoleInField:
    """A magnetic dipole on a rigid body in the field of a coil."""

    # The field at any point, relative to ``field_T``.
    shape: CoilShape
    # (2,): magnetic moment (x, y) at rest in N mm/T.
    dipole: Array
    # (2,): vector (x, y) at rest from the reference point of the body to the dipole.
    arm_mm: Array
    # (2,): the reference point (x, y) at rest.
    reference_mm: Array
    # (B, 2): the field (x, y) at the dipole at rest, for each of B candidate laws.
    field_T: Array

    def load(self, rigid: Array) -> tuple[Array, Array]:
        """Return the magnetic force and torque on the body, and the stiffness that they cause."""
        # ``rigid`` (B, 3): translation of the body in mm and rotation in rad. Force in N and torque in N mm: (B, 3).
        # Stiffness: (B, 3, 3).
        # The load is minus the first derivative of the energy -m . B, and the stiffness is the second derivative. The
        # error of the replacement of a magnet by one dipole is proportional to the second derivatives of B. For a cube,
        # the contributions of these derivatives cancel.
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
    """Magnetised silicone in the field of a coil, with one dipole in the middle of each element."""

    # The field at any point, relative to ``field_T``.
    shape: CoilShape
    # (2,): the fixed point (x, y) at which the field is ``field_T``.
    rest_mm: Array
    # (E, n, 2): positions (x, y) at rest of the n nodes of each of E elements.
    nodes_mm: Array
    # (E, n): weights of the nodes; the dipole is at the weighted mean of their positions.
    shares: Array
    # (E, n): the dipole moment of an element is the sum of these numbers (N/T) times the positions of its nodes.
    dipoles: Array
    # (B, 2): the field (x, y) at ``rest_mm`` for each of B candidate laws.
    field_T: Array

    def load(self, nodal: Array) -> tuple[Array, Array]:
        """Return the magnetic forces on the nodes in N, and the stiffness in N/mm that they cause."""
        # ``nodal`` (E, B, d, n): displacements in mm of the n nodes of E elements in d dimensions. Forces: (E, B, d,
        # n). Stiffness: (E, B, d, n, d, n).
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
    """Convert complex numbers to real and imaginary parts on a new last axis."""
    return np.stack([values.real, values.imag], axis=-1)
