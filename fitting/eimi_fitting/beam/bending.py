"""The public model of a bent beam: compute its shapes from a specimen, a hyperelastic law and loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.path import Shapes
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

_ALONG = 26  # elements of the flexible part, twice as many as the search of a fit uses


@dataclass(frozen=True)
class BentBeam:
    """The bent shapes of a beam for one or several candidate laws (sets of parameters), in each load state.

    Results have the axes (candidate law, load state, ...). The first axis is missing if the parameters of one candidate
    were given.

    Attributes
    ----------
    model : BeamModel or SolidModel
        The finite-element model that was solved.
    shapes : Shapes
        The solution for all candidates.
    is_one : bool
        Whether the parameters of one candidate were given, as shape (n,).
    """

    model: BeamModel | SolidModel
    shapes: Shapes
    is_one: bool

    @property
    def status(self) -> NDArray[np.int8]:
        """The outcome of the solution (`Status`) in each load state."""
        return self._rows(self.shapes.status)

    @property
    def converged(self) -> bool | NDArray[np.bool_]:
        """Whether every load state has the status CONVERGED."""
        return bool(self.shapes.converged[0]) if self.is_one else self.shapes.converged

    @property
    def max_stretch(self) -> Array:
        """Largest principal stretch in the silicone in each load state; NaN without a solution."""
        return self._rows(self._where_reached(self.shapes.max_stretch))

    @property
    def tip_angle_deg(self) -> Array:
        """Rotation of the tip from rest in degrees in each load state; NaN without a solution."""
        return self._rows(self._where_reached(self.model.tip_angle_deg(self.shapes)))

    def positions(self, points_mm: ArrayLike) -> Array:
        """Return the positions of material points of the beam in each load state.

        Parameters
        ----------
        points_mm : array_like, shape (n, 2) or (n, 3)
            Positions (x, y) or (x, y, z) of the points at rest, in mm, in the beam frame. A point without z lies at
            mid-depth.

        Returns
        -------
        ndarray, shape (K, n, 2 or 3), or (P, K, n, 2 or 3)
            Positions in mm, in K load states, for P candidate laws. NaN in a state whose status is neither CONVERGED
            nor UNSTABLE.

        Raises
        ------
        ValueError
            A point is not on the specimen, or three coordinates are given although the section is planar.
        """
        points = np.atleast_2d(np.asarray(points_mm, float))
        dimensions = points.shape[1]
        if isinstance(self.model, SolidModel):
            points = np.column_stack([points, np.zeros(len(points))]) if dimensions == 2 else points
        elif dimensions != 2:
            raise ValueError(
                f"points_mm: the shape is {points.shape}, but a {self.model.plane} model needs points of shape (n, 2)"
            )
        places = self.model.positions(self.shapes, points)[..., :dimensions]
        return self._rows(self._where_reached(places))

    def outline(self, view: View | None = None) -> Array:
        """Return the left and the right outline of the beam as a camera sees them.

        Parameters
        ----------
        view : View or None
            The perspective of the camera; None for a telecentric lens.

        Returns
        -------
        ndarray, shape (K, 2, S, 3, 2), or (P, K, 2, S, 3, 2)
            In K load states, for P candidate laws: the left outline (y < 0 at rest), then the right outline, each as S
            quadratic segments from clamp to tip. A segment is given by three points (x, y) in mm. NaN in a state whose
            status is neither CONVERGED nor UNSTABLE.
        """
        return self._rows(self._where_reached(outline(self.model, self.shapes, view)))

    def edges(self, per_segment: int = 4, view: View | None = None) -> Array:
        """Return the left and the right outline of the beam as polylines.

        Parameters
        ----------
        per_segment : int
            Number of straight lines that replace each quadratic segment.
        view : View or None
            The perspective of the camera; None for a telecentric lens.

        Returns
        -------
        ndarray, shape (K, 2, m, 2), or (P, K, 2, m, 2)
            In K load states, for P candidate laws: m points (x, y) in mm of the left polyline (y < 0 at rest), then of
            the right polyline, from clamp to tip.
        """
        return points_on(self.outline(view), per_segment)

    def _where_reached(self, values: Array) -> Array:
        """Replace the values in load states without a solution by NaN."""
        is_reached = np.isin(self.shapes.status, (Status.CONVERGED, Status.UNSTABLE))
        return np.where(is_reached.reshape(*is_reached.shape, *[1] * (values.ndim - 2)), values, np.nan)

    def _rows(self, values: NDArray[Any]) -> NDArray[Any]:
        """Remove the first axis if only one candidate was given."""
        return values[0] if self.is_one else values


class Beam:
    """The finite-element model of a specimen, planar or solid as its ``section`` says.

    Parameters
    ----------
    specimen : Specimen
        The beam, with its magnet if it has one.
    along : int
        Number of elements along the flexible part, between the clamp and the magnet.
    across : int or None
        Number of elements across the width. None: chosen from the proportions of the beam.

    Raises
    ------
    ValueError
        The magnet leaves no flexible part, or the specimen has a solid section and a pressure face.

    Examples
    --------
    Two laws, with shear moduli of 40 kPa and 50 kPa, and two load states, without a field and in a field of 5 mT:

    >>> from eimi_fitting import Beam, Loads, Magnet, Specimen
    >>> magnet = Magnet(
    ...     length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0
    ... )
    >>> specimen = Specimen(
    ...     length_mm=30.0, width_mm=3.0, depth_mm=5.0, density_kg_m3=1070.0, section="plane-strain", magnet=magnet
    ... )
    >>> bent = Beam(specimen).solve("neo-hookean", [[40e3], [50e3]], Loads.along([0.0, 5.0]))
    >>> bent.converged.tolist()
    [True, True]
    >>> bent.tip_angle_deg.shape
    (2, 2)
    """

    def __init__(self, specimen: Specimen, along: int = _ALONG, across: int | None = None) -> None:
        self.specimen = specimen
        self.model: BeamModel | SolidModel
        if specimen.section == "solid":
            self.model = SolidModel(specimen, along, *([] if across is None else [across]))
        elif across is None:
            coarse = BeamModel(specimen, max(1, along // 2))
            self.model = BeamModel(specimen, along, 3 * coarse.across)
        else:
            self.model = BeamModel(specimen, along, across)

    def solve(
        self,
        law: Law | str,
        parameters: ArrayLike,
        loads: Loads,
        *,
        bulk_modulus_Pa: ArrayLike | None = None,
        field_factor: ArrayLike | None = None,
    ) -> BentBeam:
        """Find the equilibrium of one or several candidate laws (sets of parameters) in each load state.

        Parameters
        ----------
        law : Law or str
            A hyperelastic law, or its name in `LAWS`.
        parameters : array_like, shape (n,) or (P, n)
            The n parameters of one candidate or of P candidates; moduli in Pa.
        loads : Loads
            The loads in a sequence of load states, which are solved one after another.
        bulk_modulus_Pa : array_like, shape () or (P,), or None
            Bulk modulus in Pa; None for an incompressible material.
        field_factor : array_like, shape () or (P,), or None
            Factor on the magnetic loads of each candidate, for example because the magnetic moment is uncertain.

        Returns
        -------
        BentBeam
            The bent shapes, with the outcome of the solution in each state.

        Raises
        ------
        UnknownLaw
            No law has this name. The message suggests the most similar name.
        ValueError
            The number of parameters is wrong, a pressure is given but the specimen has no face for it, or a bulk
            modulus is given in plane stress.
        """
        chosen_law = LAWS[law] if isinstance(law, str) else law
        candidates = np.asarray(parameters, float)
        names = chosen_law.parameter_names
        if candidates.ndim not in (1, 2) or candidates.shape[-1] != len(names):
            raise ValueError(
                f"parameters: the shape is {candidates.shape}, but the law {chosen_law.name} needs the shape "
                f"({len(names)},) or (P, {len(names)}) for P candidates ({', '.join(names)})"
            )
        shapes = self.model.solve(
            chosen_law,
            np.atleast_2d(candidates),
            loads,
            bulk_modulus_Pa=None if bulk_modulus_Pa is None else np.asarray(bulk_modulus_Pa, float),
            field_factor=None if field_factor is None else np.asarray(field_factor, float),
        )
        return BentBeam(self.model, shapes, is_one=candidates.ndim == 1)
