"""Solve the solid model of a specimen quickly, with the help of a planar model.

The depth effect is the shape of the solid model minus the shape of the planar model. It is a smooth function of the
bending. It is computed in a few load states and interpolated between them (`beam.depth_effect`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.depth_effect import BentCandidate, DepthEffect
from eimi_fitting.beam.equilibrium import Configuration, Status, combine
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.mesh import Indices
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.path import Candidates, LoadsAt, Shapes, candidates, mark_unstable
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

Method = Literal["either", "interpolate", "follow"]
ACCURACY_MM = 1e-3  # In most of the specimen the error is a tenth of this. Measured edges have errors of 1e-3 mm.

_FEW = 6  # iterations of Newton's method from a start that is near
# Two states count as the same if their measures of bending differ by less than this share of the range. (States under
# equal loads differ by the tolerance of the planar shapes.) The depth effect then differs by less than 1 µm.
_SAME = 1e-3
_STRAIGHT = 1e-6  # largest distance of loads from a straight line, as a share of the largest load
_LEAST_TURN = 1e-3  # rad; beams that turn less are ordered by their load


@dataclass(frozen=True)
class SolidOptions:
    """Options for solving a solid model with the help of a planar model.

    The depth effect is the difference between the shapes of the solid and of the planar model.

    Attributes
    ----------
    method : {"either", "interpolate", "follow"}
        "interpolate": solve the solid model in a few load states and interpolate the depth effect. "follow": solve it
        in all states, one after another. "either": follow if the interpolation fails.
    accuracy_mm : float
        Accuracy of the interpolation in mm.
    similar : tuple of DepthEffect
        Depth effects of other candidate laws. The depth effect is computed as a correction of one of them.
    effect : DepthEffect or None
        The known depth effect of this candidate law and these loads.
    earlier : DepthEffect or None
        A depth effect that is valid for some of the loads. Load states are added to it.
    planar_shapes : Shapes or None
        The known shapes of the planar model.
    """

    method: Method = "either"
    accuracy_mm: float = ACCURACY_MM
    similar: tuple[DepthEffect, ...] = ()
    effect: DepthEffect | None = None
    earlier: DepthEffect | None = None
    planar_shapes: Shapes | None = None


@dataclass(frozen=True)
class SolidShapes(Shapes):
    """The shapes of a solid model of the beam in all load states."""

    # The interpolated difference between the solid and the planar shapes; None if no difference was interpolated.
    effect: DepthEffect | None = None


class SolidBeside:
    """The solid model of a specimen, solved quickly with the help of a planar model.

    Parameters
    ----------
    specimen : Specimen
        The specimen. Its entry ``section`` is ignored.
    along, across : int
        Number of elements along the flexible part, and number of elements across the width.
    more : int
        Number of elements across the depth in addition to the usual number.
    """

    def __init__(self, specimen: Specimen, along: int, across: int, more: int = 0) -> None:
        self.specimen = specimen
        self.solid = SolidModel(specimen, along, across, more)
        self.planar = BeamModel(specimen, along, across, "plane-stress")
        self.mesh = self.solid.mesh
        self._plan, column = np.unique(self.solid.grid.straight_mm[:, :2], axis=0, return_inverse=True)
        self._column = column.reshape(-1)

    def __reduce__(self) -> tuple[type[SolidBeside], tuple[Specimen, int, int, int]]:
        """Pickle only the arguments from which the model is built, because its arrays are large."""
        return SolidBeside, (self.specimen, self.planar.along, self.planar.across, self.solid.more)

    def of(self, specimen: Specimen) -> SolidBeside:
        """Return the solid model of another specimen, with the same numbers of elements."""
        return SolidBeside(specimen, self.planar.along, self.planar.across, self.solid.more)

    def has_mesh_of(self, model: BeamModel) -> bool:
        """Return whether a planar model has the same specimen and mesh; the entry ``section`` may differ."""
        planar = self.planar
        same_lines = (planar.along, planar.across, planar.plane) == (model.along, model.across, model.plane)
        return same_lines and replace(planar.specimen, section=model.specimen.section) == model.specimen

    def solve(
        self,
        law: Law,
        parameters: Array,
        loads: Loads,
        *,
        tolerance_mm: float = 1e-2,
        bulk_modulus_Pa: Array | None = None,
        field_factor: Array | None = None,
        options: SolidOptions | None = None,
    ) -> SolidShapes:
        """Find the equilibrium of the solid model for one candidate law (set of parameters) in each load state.

        Parameters
        ----------
        law, loads, tolerance_mm, bulk_modulus_Pa, field_factor
            See `BeamModel.solve`.
        parameters : ndarray, shape (1, n)
            The n parameters of the law; moduli in Pa.
        options : SolidOptions or None
            How to solve the solid model; None for the default options.

        Raises
        ------
        ValueError
            More than one candidate is given.
        """
        options = options or SolidOptions()
        parameters = np.atleast_2d(parameters)
        if len(parameters) != 1:
            raise ValueError(f"parameters: this model solves one candidate at a time, but {len(parameters)} are given")
        flat = options.planar_shapes or self.planar.solve(
            law, parameters, loads, tolerance_mm=tolerance_mm, field_factor=field_factor
        )
        chosen = candidates(law, parameters, "solid", bulk_modulus_Pa, field_factor)
        effect = planar_mm = None
        if np.isin(flat.status, (Status.CONVERGED, Status.UNSTABLE)).all():
            planar_mm = self._in_space(flat)
            candidate = _bent_candidate(chosen, flat)
            effect = options.effect or _effect_of_equal(candidate, options)
            if effect is None and options.method != "follow":
                interpolated = self._effect(chosen, planar_mm, flat, loads, tolerance_mm, options)
                effect = replace(interpolated, candidate=candidate) if interpolated else None
        if effect is None and options.method == "interpolate":
            return self._not_solved(flat)
        if effect is None or planar_mm is None:
            followed = self.solid.solve(
                law,
                parameters,
                loads,
                tolerance_mm=tolerance_mm,
                bulk_modulus_Pa=bulk_modulus_Pa,
                field_factor=field_factor,
                beside=None if planar_mm is None else self._as_solid(planar_mm, flat, np.arange(len(loads))),
            )
            return SolidShapes(**vars(followed))
        return self._shapes(chosen, flat, planar_mm, loads, effect)

    def _not_solved(self, flat: Shapes) -> SolidShapes:
        """Return undeformed shapes with the status DIVERGED in every load state."""
        return SolidShapes(
            displacement=np.zeros((*flat.status.shape, *self.mesh.nodes.shape)),
            rigid=np.zeros_like(flat.rigid),
            status=np.full(flat.status.shape, Status.DIVERGED, np.int8),
            iterations=flat.iterations,
            max_stretch=np.ones(flat.status.shape),
            last=self.solid.solid.rest(1),
        )

    def tip_angle_deg(self, shapes: Shapes) -> Array:
        """Return the rotation of the tip in each load state in degrees."""
        return self.solid.tip_angle_deg(shapes)

    def element_stretch(self, shapes: Shapes) -> Array:
        """Return the largest principal stretch in each element and load state."""
        return self.solid.element_stretch(shapes)

    def positions(self, shapes: Shapes, points_mm: Array) -> Array:
        """Return the positions of points of the beam in each load state in mm."""
        # ``points_mm`` (n, 3): positions (x, y, z) of the points at rest, with z = 0 at mid-depth. The result is (1, K,
        # n, 3).
        return self.solid.positions(shapes, points_mm)

    def _turn(self, flat: Shapes) -> Array:
        """Return the rotation of the planar model's tip in each load state in rad."""
        return np.asarray(np.radians(self.planar.tip_angle_deg(flat)[0]))

    def _effect(
        self,
        chosen: Candidates,
        planar_mm: Array,
        flat: Shapes,
        loads: Loads,
        tolerance_mm: float,
        options: SolidOptions,
    ) -> DepthEffect | None:
        """Compute the difference between the solid and the planar model in a few load states, for interpolation."""
        # None if the differences between the load states are not proportional to each other, or if the solid model has
        # no solution. ``planar_mm``: displacements of the planar model at the nodes of the solid mesh. ``flat``: the
        # planar shapes.
        along = _along_ray(loads)
        if along is None:
            return None
        turn = self._turn(flat)
        step = np.diff(turn[np.argsort(along, kind="stable")])
        least = _SAME * float(np.ptp(turn))
        by_turn = bool(((step >= -least).all() or (step <= least).all()) and np.ptp(turn) > _LEAST_TURN)
        places = turn if by_turn else along
        same = _SAME * max(float(np.ptp(places)), _LEAST_TURN)
        unsolved = np.arange(len(places))
        if options.earlier and options.earlier.by_turn == by_turn:
            effect = options.earlier
            unsolved = unsolved[~effect.reaches(places)]
        else:
            effect = DepthEffect((), (), by_turn, _most_suitable(places, by_turn, options.similar))
        for place in effect.places_of_base:
            unsolved = unsolved[np.abs(places[unsolved] - place) > same]
        while len(unsolved):
            solved = np.array([*effect.places, *effect.places_of_base])
            # Leja's order: the next state has the largest product of its distances from the solved states.
            distance = np.abs(places[unsolved, None] - solved).prod(axis=1) if len(solved) else np.abs(places[unsolved])
            k = int(unsolved[np.argmax(distance)])
            predicted = effect.at(places[k]) if len(solved) > 1 or effect.base else None
            planar_start = self._as_solid(planar_mm, flat, np.array([k]))
            difference = self._difference(
                chosen, loads.on(self.solid.loaded), loads.state(k), planar_start, predicted, tolerance_mm
            )
            if difference is None:
                return None
            effect = effect.with_one(float(places[k]), difference)
            unsolved = unsolved[np.abs(places[unsolved] - places[k]) > same]
            if predicted and len(solved):
                error_mm = np.abs(predicted.displacement - difference.displacement).max()
                if error_mm < options.accuracy_mm:
                    break
        return effect

    def _difference(
        self,
        chosen: Candidates,
        loads_at: LoadsAt,
        load: Array,
        planar_start: Configuration,
        predicted: Configuration | None,
        tolerance_mm: float,
    ) -> Configuration | None:
        """Solve the solid model in one load state, and return its difference to the planar model."""
        # None without a solution. ``planar_start``: the planar configuration on the mesh of the solid. ``predicted``:
        # the expected difference, if known.
        batch, factor = chosen.take(np.arange(1))
        for start in ([] if predicted is None else [combine([1.0, 1.0], [planar_start, predicted])]) + [planar_start]:
            solid, status, _ = self.solid.solid.equilibrium(
                batch, loads_at(load, factor), start, tolerance_mm, _FEW, only_try=True
            )
            if status[0] == Status.CONVERGED:
                return combine([1.0, -1.0], [solid, planar_start])
        return None

    def _in_space(self, flat: Shapes) -> Array:
        """Return the displacements of the planar model at the nodes of the solid mesh."""
        # (1, K, n, 3) in mm for K load states, with zeros for z.
        moved = self.planar.displacements(flat, self._plan)
        return np.concatenate([moved, np.zeros((*moved.shape[:-1], 1))], axis=-1)

    def _as_solid(self, planar_mm: Array, flat: Shapes, states: Indices) -> Configuration:
        """Return the shapes of the planar model as configurations of the solid mesh."""
        # ``planar_mm``: the result of `_in_space`. ``states``: indices of the load states.
        rest = self.solid.solid.rest(len(states))
        return replace(rest, displacement=planar_mm[0, states][:, self._column], rigid=flat.rigid[0, states])

    def _shapes(
        self, chosen: Candidates, flat: Shapes, planar_mm: Array, loads: Loads, effect: DepthEffect
    ) -> SolidShapes:
        """Return the shapes of the solid model: the planar shapes plus the interpolated difference."""
        # ``planar_mm``: the result of `_in_space`.
        along = None if effect.by_turn else _along_ray(loads)
        places = self._turn(flat) if along is None else along
        moved, turned = effect.displacements(places)
        displacement = planar_mm[:, :, self._column] + moved
        stretch = self.solid.solid.stretch(displacement[0]).max(axis=(0, 2))
        shapes = SolidShapes(
            displacement=displacement,
            rigid=flat.rigid + turned,
            status=np.full(flat.status.shape, Status.CONVERGED, np.int8),
            iterations=flat.iterations,
            max_stretch=stretch[None],
            last=combine([1.0, 1.0], [self._as_solid(planar_mm, flat, np.array([-1])), effect.at(float(places[-1]))]),
            effect=effect,
        )
        mark_unstable(chosen, shapes)
        return shapes


def _bent_candidate(chosen: Candidates, flat: Shapes) -> BentCandidate:
    batch = chosen.batch
    modulus = batch.law.initial_shear_modulus(batch.parameters)
    return BentCandidate(batch.law, float(batch.bulk[0] / modulus[0]), flat.displacement)


def _effect_of_equal(candidate: BentCandidate, options: SolidOptions) -> DepthEffect | None:
    # Return the known depth effect of a candidate that `is_alike`, or None.
    for effect in options.similar:
        if effect.candidate and effect.candidate.is_alike(candidate, options.accuracy_mm):
            return effect
    return None


def _most_suitable(places: Array, by_turn: bool, similar: tuple[DepthEffect, ...]) -> DepthEffect | None:
    # Of the depth effects that reach all load states, return the one whose largest rotation (or load) is nearest.
    # ``places`` (K,): rotation of the tip in rad if ``by_turn``, else load from 0 to 1, in each load state.
    near = [e.without_base for e in similar if e.by_turn == by_turn and e.covers(places)]
    farthest = np.abs(places).max()
    return min(near, key=lambda effect: abs(np.abs(effect.places).max() - farthest), default=None)


def _along_ray(loads: Loads) -> Array | None:
    """Return the load states as multiples of the farthest one, or None if they are not proportional."""
    # (K,), measured from the first load state.
    numbers = np.array([loads.state(k) for k in range(len(loads))])
    from_first = numbers - numbers[0]
    farthest = from_first[np.argmax((from_first**2).sum(axis=1))]
    size = float(farthest @ farthest)
    if size == 0:
        return np.zeros(len(loads))
    along = from_first @ farthest / size
    off = np.abs(from_first - along[:, None] * farthest).max()
    return along if off <= _STRAIGHT * np.abs(farthest).max() else None
