"""Compute the twist of a bent beam whose magnet has a component of its moment normal to the plane of the picture.

The magnetic field twists the beam about its middle line and bends it out of the plane. Both are small perturbations of
the shape in the plane, computed for a Kirchhoff rod (Antman 2005, Nonlinear Problems of Elasticity, chapter 8).
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import Specimen

Array = NDArray[np.float64]

_CROSS_Z = np.array([[0.0, 1.0], [-1.0, 0.0]])  # v x z of a vector v in the plane


def torsion_constant_mm4(width_mm: float, depth_mm: float) -> float:
    """Return the torsion constant of a rectangular section in mm^4 (Young and Budynas 2002, Roark, table 10.1).

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
    """Return the mass in kg of the part of a specimen beyond each cross-section, toward the tip."""
    # ``along_mm`` (S,): distances of S cross-sections from the clamp, between the clamp and the magnet.
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
    """Return the twist of a beam along its length, divided by the angle between magnetisation and plane."""
    # ``middle_mm`` (K, S, 2): middles (x, y) of S cross-sections of the bent beam in K load states, in mm, from the
    # clamp to the magnet.
    # ``moment_N_m`` (K, S - 1): bending moment in the plane between neighbouring cross-sections in N m, from +x toward
    # +y.
    # ``force_N`` (K, S - 1, 2): force (x, y) in N that the part of the beam toward the tip exerts between neighbouring
    # cross-sections.
    # ``couple_N_m`` (K, 2): components (x, y) of the moment of the field on the magnet, divided by the angle between
    # magnetisation and plane: m_0 z × B with the magnetic moment m_0, the normal z of the plane, and the field B.
    # ``out_of_plane_N_m2``, ``torsion_N_m2``: stiffness against bending out of the plane, and torsional stiffness, in N
    # m².
    # The result (K, S): the twist at each cross-section.
    # A prime is the derivative by the arc length, and × is the vector product. omega is the small rotation of a
    # cross-section about axes in the plane, t the tangent of the middle line, n its normal in the plane, z the normal
    # of the plane, M the bending moment, F the force, A and C the two stiffnesses. The moment m about axes in the plane
    # is
    #     m = M (omega × z) + A (n . omega') n + C (t . omega') t.
    # Its balance is m' = -((omega × t) . z) (z × F). At the clamp, omega is zero. At the magnet,
    #     m = m_0 (gamma - n . omega) (z × B),
    # with the magnetic moment m_0, the field B, and the angle gamma between the magnetic moment and the plane.
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
    # The solutions for two unit moments at the clamp are computed, and then their combination that fulfils the
    # condition at the magnet.
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
    """Interpolate the tangents of the middle line from the intervals between cross-sections to the cross-sections."""
    # (K, S - 1, 2) gives (K, S, 2).
    first = 1.5 * between[:, :1] - 0.5 * between[:, 1:2]
    last = 1.5 * between[:, -1:] - 0.5 * between[:, -2:-1]
    return np.concatenate([first, 0.5 * (between[:, 1:] + between[:, :-1]), last], axis=1)
