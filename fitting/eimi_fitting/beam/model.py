"""The planar finite-element model of a specimen, solved for many candidates (sets of parameters of a law) at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.actuation import LoadedMesh
from eimi_fitting.beam.equilibrium import Configuration, Solid
from eimi_fitting.beam.grid import Grid
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.mesh import Indices
from eimi_fitting.beam.path import Shapes, at_once, candidates, follow
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip
from eimi_fitting.laws.law import Law, Section

Array = NDArray[np.float64]

__all__ = ["BeamModel", "Shapes"]


class BeamModel:
    """The planar finite-element model of a specimen, for any number of candidate laws at once.

    The magnet is rigid. Loads and stiffnesses are per mm of depth.

    Parameters
    ----------
    specimen : Specimen
        The beam, with its magnet if it has one.
    along : int
        Number of elements along the flexible part (between the clamp and the magnet).
    across : int or None
        Number of elements across the width. None: chosen from the proportions of the beam.
    plane : {"plane-stress", "plane-strain"} or None
        The planar assumption. None: the section of the specimen.

    Raises
    ------
    ValueError
        The magnet leaves no flexible part, or the specimen's section is solid and ``plane`` is None.

    Examples
    --------
    Two laws with shear moduli of 40 kPa and 50 kPa, without a field and in a field of 5 mT. The tip of the stiffer beam
    turns less:

    >>> import numpy as np
    >>> from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen
    >>> magnet = Magnet(
    ...     length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0
    ... )
    >>> beam = Specimen(
    ...     length_mm=30.0, width_mm=3.0, depth_mm=5.0, density_kg_m3=1070.0, section="plane-strain", magnet=magnet
    ... )
    >>> model = BeamModel(beam)
    >>> shapes = model.solve(LAWS["neo-hookean"], np.array([[40e3], [50e3]]), Loads.along([0.0, 5.0]))
    >>> shapes.converged.tolist()
    [True, True]
    >>> soft, stiff = model.tip_angle_deg(shapes)[:, 1]
    >>> bool(soft > stiff > 0)
    True
    """

    def __init__(
        self, specimen: Specimen, along: int = 13, across: int | None = None, plane: Section | None = None
    ) -> None:
        if plane is None:
            if specimen.section == "solid":
                raise ValueError(
                    'the specimen has section = "solid", but this model is planar: use Beam(specimen), or choose a '
                    'planar model of the solid with plane="plane-stress"'
                )
            plane = specimen.section
        self.specimen, self.plane = specimen, plane
        flexible, width = specimen.flexible_length_mm, Strip(specimen).straight.width_mm
        if flexible <= 0:
            raise ValueError(
                f"the magnet and its distance from the tip take {specimen.length_mm - flexible:g} mm of a beam of "
                f"{specimen.length_mm:g} mm: no flexible part is left between the clamp and the magnet"
            )
        if across is None:
            across = max(1, round(0.5 * along * min(width / flexible, 1.0)))
        self.along, self.across = along, across
        self.grid = Grid(specimen, along, across)
        self.mesh = self.grid.mesh
        fixed = np.zeros((len(self.mesh.nodes), 2), bool)
        fixed[self.mesh.column(0)] = True
        self.solid = Solid(self.mesh, fixed, self.grid.magnet_nodes, self.grid.face_mm, self.grid.pressure_face())
        self.loaded = LoadedMesh(self.grid, self.solid)

    def __reduce__(self) -> tuple[type[BeamModel], tuple[Specimen, int, int, Section]]:
        """Pickle only the arguments from which the model is built, because its arrays are large."""
        return BeamModel, (self.specimen, self.along, self.across, self.plane)

    def of(self, specimen: Specimen) -> BeamModel:
        """Return a planar model of another specimen with the same numbers of elements."""
        return BeamModel(specimen, self.along, self.across, self.plane)

    def refined(self) -> BeamModel:
        """Return a model of the same specimen with twice as many elements along and three times as many across."""
        return BeamModel(self.specimen, 2 * self.along, 3 * self.across, self.plane)

    def halved(self) -> BeamModel:
        """Return a model of the same specimen with twice as many elements along and twice as many across."""
        return BeamModel(self.specimen, 2 * self.along, 2 * self.across, self.plane)

    def place(self, points_mm: Array) -> tuple[Indices, Array]:
        """Find the element around each material point; return its nodes and the values of its shape functions.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 2)
            Positions (x, y) of the points at rest.

        Returns
        -------
        nodes, values : ndarray, shape (n, 9)
            Indices of the nine nodes around each point, and their shape functions at the point.

        Raises
        ------
        ValueError
            A point is not on the specimen.
        """
        return self.grid.place(self.grid.straightened(points_mm))

    def positions(self, shapes: Shapes, points_mm: Array) -> Array:
        """Return the positions of material points for all candidate laws and load states.

        Parameters
        ----------
        shapes : Shapes
            The result of `solve`, for P candidate laws in K load states.
        points_mm : ndarray, shape (n, 2)
            Positions (x, y) of the points at rest.

        Returns
        -------
        ndarray, shape (P, K, n, 2)
            Positions (x, y) in mm.

        Raises
        ------
        ValueError
            A point is not on the specimen.
        """
        points = np.atleast_2d(np.asarray(points_mm, float))
        return points + self.displacements(shapes, self.grid.straightened(points))

    def displacements(self, shapes: Shapes, straight_mm: Array) -> Array:
        """Return the displacements of points for all candidate laws and load states.

        Parameters
        ----------
        shapes : Shapes
            The result of `solve`, for P candidate laws in K load states.
        straight_mm : ndarray, shape (n, 2)
            Points (x, y) of the straight reference beam.

        Returns
        -------
        ndarray, shape (P, K, n, 2)
            Displacements (x, y) in mm.

        Raises
        ------
        ValueError
            A point is not on the specimen.
        """
        p, k = shapes.status.shape
        step = np.empty((p, k, len(straight_mm), 2))
        on_magnet = self.grid.on_magnet(straight_mm)
        nodes, weights = self.grid.place(straight_mm[~on_magnet])
        step[:, :, ~on_magnet] = np.einsum("pknai,na->pkni", shapes.displacement[:, :, nodes], weights)
        held = self.grid.strip.at_rest(straight_mm[on_magnet])
        step[:, :, on_magnet] = self.carried(shapes, held) - held
        return step

    def carried(self, shapes: Shapes, points_mm: Array) -> Array:
        """Return the positions of points of the rigid magnet for all candidate laws and load states.

        Parameters
        ----------
        shapes : Shapes
            The result of `solve`, for P candidate laws in K load states.
        points_mm : ndarray, shape (n, 2)
            Positions (x, y) of the points at rest.

        Returns
        -------
        ndarray, shape (P, K, n, 2)
            Positions (x, y) in mm.
        """
        (face_x, face_y), arm = self.grid.face_mm, points_mm - np.array(self.grid.face_mm)
        c, s = np.cos(shapes.rigid[..., 2, None]), np.sin(shapes.rigid[..., 2, None])
        x = face_x + shapes.rigid[..., 0, None] + c * arm[:, 0] - s * arm[:, 1]
        y = face_y + shapes.rigid[..., 1, None] + s * arm[:, 0] + c * arm[:, 1]
        return np.stack([x, y], axis=-1)

    def tip_angle_deg(self, shapes: Shapes) -> Array:
        """Return the rotation of the magnet from rest for all candidate laws and load states, in degrees.

        Without a magnet, return the rotation of the cross-section at the tip.
        """
        if self.specimen.magnet:
            return np.degrees(shapes.rigid[..., 2])
        corners = self.mesh.column(-1)[[0, -1]]
        ends = self.mesh.nodes[corners] + shapes.displacement[:, :, corners]
        return self.grid.strip.tip_rotation_deg(ends)

    def solve(
        self,
        law: Law,
        parameters: Array,
        loads: Loads,
        *,
        tolerance_mm: float = 1e-6,
        start: Configuration | None = None,
        bulk_modulus_Pa: Array | None = None,
        field_factor: Array | None = None,
        keep: bool = False,
        near: Configuration | None = None,
    ) -> Shapes:
        """Find the equilibrium of many candidate laws (sets of parameters) in a sequence of load states.

        Parameters
        ----------
        law : Law
            The hyperelastic law.
        parameters : ndarray, shape (P, n)
            The n parameters of the law for each of P candidates; moduli in Pa.
        loads : Loads
            The loads in K load states, which are solved one after another.
        tolerance_mm : float
            Newton's method ends when every node moves by less than this distance in an iteration.
        start : Configuration or None
            The configuration with which Newton's method begins in the first state, for example ``Shapes.last``. None:
            the configuration at rest.
        bulk_modulus_Pa : ndarray, shape (P,), or None
            Bulk modulus in Pa; None for an incompressible material.
        field_factor : ndarray, shape (P,), or None
            Factor on the magnetic loads of each candidate.
        keep : bool
            Keep the configurations of the first candidate in ``Shapes.every``.
        near : Configuration or None
            ``Shapes.every`` of a similar candidate. All states are then solved at once, starting at these
            configurations.

        Raises
        ------
        ValueError
            A bulk modulus is given in plane stress, or a pressure for a specimen without a pressure face.
        """
        chosen = candidates(law, parameters, self.plane, bulk_modulus_Pa, field_factor)
        # A grid has more nodes if its magnet is narrower than the beam, or ends before it.
        if near is not None and near.displacement.shape[1:] == self.mesh.nodes.shape:
            shapes = at_once(self.solid, self.loaded, chosen, loads, tolerance_mm, near, keep)
            if shapes is not None:
                return shapes
        return follow(self.solid, self.loaded, chosen, loads, tolerance_mm, start, keep)

    def element_stretch(self, shapes: Shapes) -> Array:
        """Return the largest principal stretch in each element, for all candidate laws and load states."""
        p, k = shapes.status.shape
        flat = self.solid.stretch(shapes.displacement.reshape(p * k, -1, 2))
        return flat.max(axis=2).T.reshape(p, k, -1)
