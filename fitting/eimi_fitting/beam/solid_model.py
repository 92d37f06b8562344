"""The finite-element model of a specimen in three dimensions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.actuation import LoadedMesh
from eimi_fitting.beam.equilibrium import Configuration, Solid
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.path import Shapes, candidates, follow
from eimi_fitting.beam.solid_grid import SolidGrid
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]


class SolidModel:
    """The finite-element model of a specimen in three dimensions.

    Parameters
    ----------
    specimen : Specimen
        The beam, with its magnet if it has one.
    along, across : int
        Numbers of elements along the flexible part and across the width.
    more : int
        Number of elements across the depth in addition to the usual number.

    Raises
    ------
    ValueError
        The magnet leaves no flexible part, or the specimen has a pressure face.
    """

    def __init__(self, specimen: Specimen, along: int = 26, across: int = 3, more: int = 0) -> None:
        flexible = specimen.flexible_length_mm
        if flexible <= 0:
            raise ValueError(
                f"the magnet and its distance from the tip take {specimen.length_mm - flexible:g} mm of a beam of "
                f"{specimen.length_mm:g} mm: no flexible part is left between the clamp and the magnet"
            )
        if specimen.pressure_face is not None:
            raise ValueError(
                'pressure_face is not possible with section = "solid": choose section = "plane-stress" or '
                '"plane-strain"'
            )
        self.specimen, self.along, self.across, self.more = specimen, along, across, more
        self.grid = SolidGrid(specimen, along, across, more)
        self.mesh = self.grid.mesh
        numbers = self.mesh.numbers
        fixed = np.zeros((len(self.mesh.nodes), 3), bool)
        fixed[numbers[0].ravel()] = True
        fixed[numbers[:, :, 0].ravel(), 2] = True
        self.solid = Solid(self.mesh, fixed, self.grid.magnet_nodes, self.grid.face_mm)
        self.loaded = LoadedMesh(self.grid, self.solid)

    def __reduce__(self) -> tuple[type[SolidModel], tuple[Specimen, int, int, int]]:
        """Pickle only the arguments from which the model is built, because its arrays are large."""
        return SolidModel, (self.specimen, self.along, self.across, self.more)

    def solve(
        self,
        law: Law,
        parameters: Array,
        loads: Loads,
        *,
        tolerance_mm: float = 1e-5,
        start: Configuration | None = None,
        bulk_modulus_Pa: Array | None = None,
        field_factor: Array | None = None,
        beside: Configuration | None = None,
    ) -> Shapes:
        """Find the equilibrium of many candidate laws (sets of parameters) in a sequence of load states.

        Parameters
        ----------
        law, parameters, loads, tolerance_mm, start, bulk_modulus_Pa, field_factor
            See `BeamModel.solve`.
        beside : Configuration or None
            For one candidate: the configurations of the planar model, near which Newton's method begins.

        Raises
        ------
        ValueError
            ``loads`` contains a pressure.
        """
        chosen = candidates(law, parameters, "solid", bulk_modulus_Pa, field_factor)
        return follow(self.solid, self.loaded, chosen, loads, tolerance_mm, start, beside=beside)

    def tip_angle_deg(self, shapes: Shapes) -> Array:
        """Return the rotation of the magnet from rest for all candidate laws and load states, in degrees.

        Without a magnet, return the rotation of the cross-section at the tip, at mid-depth.
        """
        if self.specimen.magnet:
            return np.degrees(shapes.rigid[..., 2])
        corners = self.mesh.numbers[-1, [0, -1], 0]
        ends = (self.mesh.nodes[corners] + shapes.displacement[:, :, corners])[..., :2]
        return self.grid.strip.tip_rotation_deg(ends)

    def element_stretch(self, shapes: Shapes) -> Array:
        """Return the largest principal stretch in each element, for all candidate laws and load states."""
        p, k = shapes.status.shape
        flat = self.solid.stretch(shapes.displacement.reshape(p * k, -1, 3))
        return flat.max(axis=2).T.reshape(p, k, -1)

    def positions(self, shapes: Shapes, points_mm: Array) -> Array:
        """Return the positions of material points for all candidate laws and load states, in mm.

        Raises
        ------
        ValueError
            A point is not on the specimen.
        """
        # ``points_mm`` (n, 3): positions (x, y, z) of the points at rest, with z = 0 at mid-depth. The result is (P, K,
        # n, 3).
        points = np.atleast_2d(np.asarray(points_mm, float))
        moved = np.empty((*shapes.status.shape, len(points), 3))
        straight = self.grid.straightened(points)
        on_magnet = self.grid.on_magnet(straight)
        nodes, weights = self.grid.place(straight[~on_magnet])
        step = np.einsum("pknai,na->pkni", shapes.displacement[:, :, nodes], weights)
        step[..., 2] *= np.where(points[~on_magnet, 2] < 0, -1, 1)
        moved[:, :, ~on_magnet] = points[~on_magnet] + step
        arm = points[on_magnet, :2] - np.array(self.grid.face_mm)
        x, y, turn = np.moveaxis(shapes.rigid[..., None], -2, 0)
        moved[:, :, on_magnet, 0] = points[on_magnet, 0] + x + (np.cos(turn) - 1) * arm[:, 0] - np.sin(turn) * arm[:, 1]
        moved[:, :, on_magnet, 1] = points[on_magnet, 1] + y + np.sin(turn) * arm[:, 0] + (np.cos(turn) - 1) * arm[:, 1]
        moved[:, :, on_magnet, 2] = points[on_magnet, 2]
        return moved
