"""Correct measured edges for a twist of the beam by its magnet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.twist import torsion_constant_mm4, twist_per_tilt, weight_beyond_kg
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

_ACCURACY_MM = 1e-3


def without_twist(
    experiment: Experiment, simulated: Experiment, law: Law, parameters: Array, angle_deg: float
) -> Experiment:
    """Correct the measured edges of an experiment for a twist of the beam by its magnet."""
    # The twist is computed from the experiment `simulated`. `angle_deg` is the angle between the magnetic moment and
    # the plane of the picture.
    specimen, observed = simulated.model.specimen, experiment.observed
    if not isinstance(observed, EdgeObservation) or not angle_deg:
        return experiment
    twisted = _twisted(simulated, law, parameters)
    if twisted is None:
        return experiment
    middle, per_tilt = twisted
    twist_rad, width, depth = np.radians(angle_deg) * per_tilt, specimen.width_mm, specimen.depth_mm
    # A section that is turned by phi has the width w cos phi + d |sin phi| in the picture. For a negative angle, the
    # increase by d is subtracted, so that the displacement of the edges is nearly proportional to the angle.
    wider_mm = 0.5 * (width * (np.cos(twist_rad) - 1) + np.copysign(depth * np.abs(np.sin(twist_rad)), angle_deg))
    direction = np.gradient(middle, axis=1)
    spacing_mm = np.linalg.norm(direction, axis=-1, keepdims=True)
    direction, slope = direction / spacing_mm, np.gradient(wider_mm, axis=1) / spacing_mm[..., 0]
    # Each measured point moves as its foot on the tangent at the nearest station of the middle line.
    points = observed.points_mm
    nearest = ((points[:, :, :, None] - middle[:, None, None]) ** 2).sum(axis=-1).argmin(axis=-1)
    station = (np.arange(len(points))[:, None, None], nearest)
    tangent = direction[station]
    beyond_mm = ((points - middle[station]) * tangent).sum(axis=-1)
    beyond_mm[(nearest == middle.shape[1] - 1) & (beyond_mm > 0)] = 0.0  # the magnet does not twist
    outward = np.array([1.0, -1.0])[:, None, None] * np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)
    inner = points - (wider_mm[station] + slope[station] * beyond_mm)[..., None] * outward
    return replace(experiment, observed=replace(observed, points_mm=inner))


def tip_twist_per_tilt(simulated: Experiment, law: Law, parameters: Array) -> Array | None:
    """Return the twist of the beam at its magnet divided by the tilt of the magnetic moment, for each load case."""
    twisted = _twisted(simulated, law, parameters)
    return None if twisted is None else twisted[1][:, -1]


def _twisted(simulated: Experiment, law: Law, parameters: Array) -> tuple[Array, Array] | None:
    # Returns S points of the middle line in mm, (K, S, 2), and the twist there for a unit tilt of the magnetic moment
    # out of the plane of the picture, (K, S).
    specimen = simulated.model.specimen
    if specimen.magnet is None:
        return None
    shapes = simulated.model.solve(law, parameters, simulated.loads, tolerance_mm=_ACCURACY_MM)
    if not np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all():
        return None
    mesh, along_mm = simulated.model.mesh, simulated.model.grid.straight_mm[simulated.model.mesh.row(0), 0]
    flexible = along_mm <= specimen.flexible_length_mm + 1e-6
    place = (mesh.nodes + shapes.displacement)[0]
    middle = 0.5 * (place[:, mesh.row(0)] + place[:, mesh.row(-1)])[:, flexible]
    modulus_Pa = float(law.initial_shear_modulus(parameters)[0])
    per_tilt = twist_per_tilt(
        middle,
        *_moments_and_forces(middle, along_mm[flexible], simulated, modulus_Pa),
        specimen.magnet.moment_A_m2
        * np.stack([-simulated.loads.field_T[:, 1], simulated.loads.field_T[:, 0]], axis=-1),
        3e-12 * modulus_Pa * specimen.width_mm * specimen.depth_mm**3 / 12,
        1e-12 * modulus_Pa * torsion_constant_mm4(specimen.width_mm, specimen.depth_mm),
    )
    return middle, per_tilt


def _moments_and_forces(
    middle_mm: Array, along_mm: Array, simulated: Experiment, modulus_Pa: float
) -> tuple[Array, Array]:
    # Returns bending moments in N m and forces in N between the points of the middle line.
    specimen = simulated.model.specimen
    rest = simulated.model.mesh.nodes
    first, last = simulated.model.mesh.row(0), simulated.model.mesh.row(-1)
    at_rest = 0.5 * (rest[first] + rest[last])[: len(along_mm)]

    def angle_rad(line_mm: Array) -> Array:
        step = np.diff(line_mm, axis=-2)
        return np.unwrap(np.arctan2(step[..., 1], step[..., 0]), axis=-1)

    between_mm = 0.5 * (along_mm[1:] + along_mm[:-1])
    curvature_m = 1e3 * np.gradient(angle_rad(middle_mm) - angle_rad(at_rest), between_mm, axis=-1)
    stiffness_N_m2 = 3e-12 * modulus_Pa * specimen.depth_mm * specimen.width_mm**3 / 12
    weight = weight_beyond_kg(specimen, between_mm)[:, None] * simulated.loads.gravity[:, None]
    return stiffness_N_m2 * curvature_m, weight + simulated.loads.tip_force_N[:, None]
