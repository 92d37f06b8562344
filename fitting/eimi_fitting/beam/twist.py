"""Compute the twist of a bent beam whose magnet has a component of its moment normal to the plane of the picture.

A beam model of this package has no displacements normal to the plane. The torque of the field on a moment normal to the
plane twists the beam about its middle line and bends it out of the plane. Both are small, and they are computed as a
linear perturbation of a rod (Kirchhoff rod; Antman 2005, Nonlinear Problems of Elasticity, chapter 8) in the bent shape
that the beam has in the plane.

Let s be the arc length, t(s) the tangent of the middle line, n(s) its normal in the plane, z the normal of the plane,
M(s) the bending moment in the plane, F(s) the force on the part beyond s, and omega(s) the small rotation of a
cross-section about axes in the plane. A prime is the derivative by s, and x is the vector product. With the stiffness A
against bending out of the plane and the torsional stiffness C, the moment m(s) about axes in the plane and its balance
are

    m = M omega x z + A (n . omega') n + C (t . omega') t,      m' = -((omega x t) . z) z x F

The clamp holds the beam: omega = 0 at s = 0. The magnetic moment of the magnet is m_0 (t + gamma z), with the small
angle gamma between this moment and the plane. After the rotation of the tip, its component normal to the plane is
m_0 (gamma - n . omega). The field B in the plane therefore acts on the tip with the moment

    m = m_0 (gamma - n . omega) z x B.

The twist is t . omega. For a straight beam across a field of strength B it is -gamma m_0 B s / C.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import Specimen

Array = NDArray[np.float64]

_CROSS_Z = np.array([[0.0, 1.0], [-1.0, 0.0]])  # v x z of a vector v in the plane


def torsion_constant_mm4(width_mm: float, depth_mm: float) -> float:
    """Return the torsion constant J of a rectangular section in mm^4 (Young and Budynas 2002, Roark, table 10.1).

    The torsional stiffness is the shear modulus times J.

    Examples
    --------
    For a square of side a, J is 0.1406 a^4:

    >>> round(torsion_constant_mm4(1.0, 1.0), 3)
    0.141
    """
    long, short = max(width_mm, depth_mm), min(width_mm, depth_mm)
    ratio = short / long
    return long * short**3 * (1 / 3 - 0.21 * ratio * (1 - ratio**4 / 12))


def weight_beyond_kg(specimen: Specimen, along_mm: Array) -> Array:
    """Return the mass in kg of the part of a specimen that lies beyond each of S cross-sections, toward the tip, (S,).

    along_mm: distances of the S cross-sections from the clamp in mm, along the beam. They lie between the clamp and the
    magnet.
    """
    area_mm2, density = specimen.width_mm * specimen.depth_mm, 1e-9 * specimen.density_kg_m3
    mass = density * area_mm2 * np.maximum(specimen.length_mm - along_mm, 0.0)
    if magnet := specimen.magnet:
        volume_mm3 = magnet.length_mm * magnet.width_mm * magnet.depth_mm
        mass = mass + volume_mm3 * (1e-9 * magnet.density_kg_m3 - density)
    return np.asarray(mass)


def twist_per_tilt(
    middle_mm: Array,
    moment_N_m: Array,
    force_N: Array,
    couple_N_m: Array,
    out_of_plane_N_m2: float,
    torsion_N_m2: float,
) -> Array:
    """Return the twist of a beam at S cross-sections in K load states, divided by the angle gamma of the magnetisation.

    The angle gamma lies between the magnetisation and the plane of the picture.

    Parameters
    ----------
    middle_mm : ndarray, shape (K, S, 2)
        Positions (x, y) of the middles of the S cross-sections of the bent beam in mm, from the clamp to the magnet.
    moment_N_m : ndarray, shape (K, S - 1)
        Bending moment in the plane between neighbouring cross-sections in N m, from +x toward +y.
    force_N : ndarray, shape (K, S - 1, 2)
        Sum of the loads (x, y) in N on a part of the beam: from the middle between two cross-sections to the tip.
    couple_N_m : ndarray, shape (K, 2)
        The vector product m_0 z x B in N m: magnetic moment m_0, unit normal z of the plane, field B.
    out_of_plane_N_m2, torsion_N_m2 : float
        Stiffness A against bending out of the plane, and torsional stiffness C, in N m².

    Returns
    -------
    ndarray, shape (K, S)
        Rotation of the cross-section about the middle line, divided by gamma. The rotation is positive from y toward z.
    """
    step = 1e-3 * np.diff(middle_mm, axis=1)
    spacing = np.linalg.norm(step, axis=-1)
    tangent = step / spacing[..., None]
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    flexible = (
        np.einsum("ksi,ksj->ksij", normal, normal) / out_of_plane_N_m2
        + np.einsum("ksi,ksj->ksij", tangent, tangent) / torsion_N_m2
    )
    around = np.stack([-force_N[..., 1], force_N[..., 0]], axis=-1)  # z x F
    system = np.zeros((*spacing.shape, 4, 4))
    system[..., :2, :2] = -moment_N_m[..., None, None] * flexible @ _CROSS_Z
    system[..., :2, 2:] = flexible
    system[..., 2:, :2] = np.einsum("ksi,ksj->ksij", around, normal)  # (omega x t) . z = -omega . n
    transfer = scipy.linalg.expm(spacing[..., None, None] * system)
    # Unit moments at the clamp, then the combination that fulfils the condition at the magnet.
    states = [np.broadcast_to(np.eye(4)[:, 2:], (len(middle_mm), 4, 2))]
    for index in range(transfer.shape[1]):
        states.append(transfer[:, index] @ states[-1])
    every = np.stack(states, axis=1)
    along = _at_stations(tangent)
    at_tip, last = every[:, -1], along[:, -1] @ _CROSS_Z  # the normal: the product is from the right
    condition = at_tip[:, 2:] + np.einsum("ki,kj,kjc->kic", couple_N_m, last, at_tip[:, :2])
    at_clamp = np.linalg.solve(condition, couple_N_m[..., None])
    rotation = (every[:, :, :2] @ at_clamp[:, None])[..., 0]
    return np.asarray(np.einsum("ksi,ksi->ks", along, rotation))


def _at_stations(between: Array) -> Array:
    """Return the unit tangents of the middle line at S cross-sections in K load states, (K, S, 2).

    between: the tangents in the middle between neighbouring cross-sections, (K, S - 1, 2).
    """
    first = 1.5 * between[:, :1] - 0.5 * between[:, 1:2]
    last = 1.5 * between[:, -1:] - 0.5 * between[:, -2:-1]
    return np.concatenate([first, 0.5 * (between[:, 1:] + between[:, :-1]), last], axis=1)
