"""The inertia of a specimen: consistent mass matrix of the silicone, mass and rotary inertia of the magnet."""

from __future__ import annotations

from math import prod

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam import bricks, mesh
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.solid_model import SolidModel

Array = NDArray[np.float64]

MM_PER_M = 1e3  # 1 kg = 1 N s²/m = 1e-3 N s²/mm: a mass in kg is divided by this number


class Inertia:
    """The masses of a meshed specimen in N s²/mm."""

    # E elements of n nodes each, and N nodes.
    # ``of_elements`` (E, n, n): consistent mass matrix of each element for one direction.
    # ``body_mass``: mass of the magnet and of the silicone that moves rigidly with it.
    # ``body_rotary``: rotary inertia of this body about its centre of mass, in N s² mm.
    # ``body_arm_mm`` (2,): vector (x, y) at rest from the magnet's reference point to the centre of mass.
    # ``point_mass``: a point mass where a tip force acts; zero if it lies on the magnet.
    # ``point_shares`` (N,): weights of the nodes that give the displacement of the point mass.

    def __init__(self, model: BeamModel | SolidModel, tip_mass_kg: float = 0.0) -> None:
        specimen, grid, loaded = model.specimen, model.grid, model.loaded
        self.of_elements = 1e-9 * specimen.density_kg_m3 / MM_PER_M * _squares(model)
        self.body_mass, self.body_rotary, self.body_arm_mm = 0.0, 0.0, np.zeros(2)
        self.point_mass, self.point_shares = 0.0, np.zeros(len(model.mesh.nodes))
        magnet = specimen.magnet
        if magnet is not None:
            length, width, _ = grid.block_mm
            inner = magnet.length_mm * magnet.width_mm * magnet.depth_mm
            of_magnet = 1e-9 * inner * magnet.density_kg_m3
            of_block = 1e-9 * prod(grid.block_mm) * specimen.density_kg_m3
            of_hole = 1e-9 * inner * specimen.density_kg_m3
            rotary = (of_magnet - of_hole) * (magnet.length_mm**2 + magnet.width_mm**2) / 12
            rotary += of_block * (length**2 + width**2) / 12
            self.body_mass = loaded.magnet_mass / MM_PER_M
            self.body_rotary = rotary * loaded.share / MM_PER_M
            self.body_arm_mm = loaded.magnet_centre_mm.copy()
        if tip_mass_kg:
            self._add_point(model, tip_mass_kg * loaded.share / MM_PER_M)

    def _add_point(self, model: BeamModel | SolidModel, mass: float) -> None:
        place = model.loaded.at_rest(np.array(model.specimen.tip_load_mm or (model.specimen.length_mm, 0.0)))
        straight = model.grid.straightened(place)
        if model.grid.on_magnet(straight)[0]:
            arm, before, total = place - np.array(model.grid.face_mm), self.body_mass, self.body_mass + mass
            centre = (before * self.body_arm_mm + mass * arm) / total
            self.body_rotary += before * np.sum((self.body_arm_mm - centre) ** 2) + mass * np.sum((arm - centre) ** 2)
            self.body_mass, self.body_arm_mm = total, centre
        else:
            self.point_mass = mass
            nodes, weights = model.grid.through_depth(straight[0])
            np.add.at(self.point_shares, nodes, weights)

    def of_body(self, angle_rad: Array) -> Array:
        """Return the mass matrices of the magnet for translation and rotation, at several rotations."""
        # ``angle_rad`` (B,) gives (B, 3, 3).
        # The velocity of the centre of mass is the velocity of the reference point plus the angular velocity times the
        # derivative, by the rotation, of the vector from this point to the centre of mass.
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        x, y = self.body_arm_mm
        matrix = np.zeros((len(angle_rad), 3, 3))
        matrix[:, 0, 0] = matrix[:, 1, 1] = self.body_mass
        matrix[:, 0, 2] = matrix[:, 2, 0] = self.body_mass * (-s * x - c * y)
        matrix[:, 1, 2] = matrix[:, 2, 1] = self.body_mass * (c * x - s * y)
        matrix[:, 2, 2] = self.body_mass * (x * x + y * y) + self.body_rotary
        return matrix


def _squares(model: BeamModel | SolidModel) -> Array:
    """Return the integrals of products of two shape functions over each element."""
    # (E, n, n) for E elements with n nodes.
    place, weight = np.polynomial.legendre.leggauss(3)
    d = model.mesh.nodes.shape[1]
    local = [axis.ravel() for axis in np.meshgrid(*[place] * d, indexing="ij")]
    weights = np.ones(1)
    for _ in range(d):
        weights = np.multiply.outer(weights, weight)
    values, slopes = mesh.shape_functions(*local) if d == 2 else bricks.shape_functions(*local)
    nodes = model.mesh.nodes[model.mesh.elements]
    size = np.linalg.det(np.einsum("eai,qar->eqir", nodes, slopes, optimize=True)) * weights.ravel()
    thickness = getattr(model.mesh, "thickness", None)
    if thickness is not None:
        size = size * (thickness[model.mesh.elements] @ values.T)
    return np.asarray(np.einsum("eq,qa,qb->eab", size, values, values, optimize=True))
