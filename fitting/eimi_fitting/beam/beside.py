"""The solid model of a specimen beside its planar model, which saves most of the solid's cost.

In plane stress a beam bends almost as its solid does: the difference, the depth effect, is some hundredths of the
deflection. From the planar shape Newton's method reaches the solid in a few steps, in any state. The depth effect is
smooth, so that it is solved in a few states and interpolated in the others (`beam.depth_effect`).
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
ACCURACY_MM = 1e-3  # The bulk of the specimen is a tenth of that off, and measured edges are good to 1e-3 mm.

_FEW = 6  # iterations of Newton's method from a start that is near
# Share of the range of places within which two places are the same. States under equal loads differ by the tolerance of
# the planar shapes. The depth effect is a few hundredths of the deflection, and changes by less than 1 µm there.
_SAME = 1e-3
_STRAIGHT = 1e-6  # largest distance of loads from a straight line, as a share of the largest load
_LEAST_TURN = 1e-3  # rad; beams that turn less are ordered by their load


@dataclass(frozen=True)
class SolidOptions:
    """Options for solving a solid from its planar model, with results of earlier solutions.

    Attributes
    ----------
    method : {"either", "interpolate", "follow"}
        "interpolate" interpolates the depth effect; if this fails, all states are marked as diverged. "follow" solves
        the solid in all states, one after another. "either" interpolates, and follows if the interpolation fails.
    accuracy_mm : float
        Stop adding states once the interpolated shape is within this distance of the solved one.
    similar : tuple of DepthEffect
        Depth effects of similar candidates; the difference from one of them is interpolated. If the planar shape of a
        similar candidate is the same within ``accuracy_mm``, its depth effect is used without solving the solid.
    effect : DepthEffect or None
        The depth effect, if it is known already. Only the planar model is then solved.
    earlier : DepthEffect or None
        The depth effect of nearly the same candidate under some of the loads. Only states beyond its range are solved
        and added to it.
    planar_shapes : Shapes or None
        Shapes of the planar model for the same candidate and loads, if they are known already. The planar model is then
        not solved.
    """

    method: Method = "either"
    accuracy_mm: float = ACCURACY_MM
    similar: tuple[DepthEffect, ...] = ()
    effect: DepthEffect | None = None
    earlier: DepthEffect | None = None
    planar_shapes: Shapes | None = None


@dataclass(frozen=True)
class SolidShapes(Shapes):
    """The shapes of a solid; ``effect`` is its depth effect, or None if every state was solved."""

    effect: DepthEffect | None = None


class SolidBeside:
    """A solid model and the planar model on the same lines, for one candidate at a time.

    Parameters
    ----------
    specimen : Specimen
        The specimen; its own entry for the section is ignored.
    along, across, more : int
        Numbers of elements, see `SolidModel`.
    """

    def __init__(self, specimen: Specimen, along: int, across: int, more: int = 0) -> None:
        self.specimen = specimen
        self.solid = SolidModel(specimen, along, across, more)
        self.planar = BeamModel(specimen, along, across, "plane-stress")
        self.mesh = self.solid.mesh
        self._plan, column = np.unique(self.solid.grid.straight_mm[:, :2], axis=0, return_inverse=True)
        self._column = column.reshape(-1)

    def __reduce__(self) -> tuple[type[SolidBeside], tuple[Specimen, int, int, int]]:
        """Pickle only the arguments, as `BeamModel` does."""
        return SolidBeside, (self.specimen, self.planar.along, self.planar.across, self.solid.more)

    def of(self, specimen: Specimen) -> SolidBeside:
        """Return the model of another specimen with the same numbers of elements."""
        return SolidBeside(specimen, self.planar.along, self.planar.across, self.solid.more)

    def has_mesh_of(self, model: BeamModel) -> bool:
        """Return whether shapes of a planar model can be used as ``planar_shapes`` of `SolidOptions`."""
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
        """Find the equilibrium of the solid for one candidate in K states.

        Parameters
        ----------
        law, loads, tolerance_mm, bulk_modulus_Pa, field_factor
            See `BeamModel.solve`.
        parameters : ndarray, shape (1, n)
            Parameters of one candidate, moduli in Pa.
        options : SolidOptions or None
            How the solid is solved.

        Raises
        ------
        ValueError
            More than one candidate is given.
        """
        options = options or SolidOptions()
        parameters = np.atleast_2d(parameters)
        if len(parameters) != 1:
            raise ValueError(f"this model solves one candidate at a time, not {len(parameters)}")
        flat = options.planar_shapes or self.planar.solve(
            law, parameters, loads, tolerance_mm=tolerance_mm, field_factor=field_factor
        )
        chosen = candidates(law, parameters, "solid", bulk_modulus_Pa, field_factor)
        effect = lift = None
        if np.isin(flat.status, (Status.CONVERGED, Status.UNSTABLE)).all():
            lift = self._lift(flat)
            candidate = _bent_candidate(chosen, flat)
            effect = options.effect or _effect_of_equal_candidate(candidate, options)
            if effect is None and options.method != "follow":
                interpolated = self._effect(chosen, lift, flat, loads, tolerance_mm, options)
                effect = replace(interpolated, candidate=candidate) if interpolated else None
        if effect is None and options.method == "interpolate":
            return self._given_up(flat)
        if effect is None or lift is None:
            followed = self.solid.solve(
                law,
                parameters,
                loads,
                tolerance_mm=tolerance_mm,
                bulk_modulus_Pa=bulk_modulus_Pa,
                field_factor=field_factor,
                beside=None if lift is None else self._lifted(lift, flat, np.arange(len(loads))),
            )
            return SolidShapes(**vars(followed))
        return self._shapes(chosen, flat, lift, loads, effect)

    def _given_up(self, flat: Shapes) -> SolidShapes:
        """Return all states at rest, marked as diverged, after a solution was given up."""
        return SolidShapes(
            displacement=np.zeros((*flat.status.shape, *self.mesh.nodes.shape)),
            rigid=np.zeros_like(flat.rigid),
            status=np.full(flat.status.shape, Status.DIVERGED, np.int8),
            iterations=flat.iterations,
            max_stretch=np.ones(flat.status.shape),
            last=self.solid.solid.rest(1),
        )

    def tip_angle_deg(self, shapes: Shapes) -> Array:
        """See `SolidModel.tip_angle_deg`."""
        return self.solid.tip_angle_deg(shapes)

    def element_stretch(self, shapes: Shapes) -> Array:
        """See `SolidModel.element_stretch`."""
        return self.solid.element_stretch(shapes)

    def positions(self, shapes: Shapes, points_mm: Array) -> Array:
        """See `SolidModel.positions`."""
        return self.solid.positions(shapes, points_mm)

    def _turn(self, flat: Shapes) -> Array:
        """Return the rotations (K,) of the planar tip in rad."""
        return np.asarray(np.radians(self.planar.tip_angle_deg(flat)[0]))

    def _effect(
        self,
        chosen: Candidates,
        lift: Array,
        flat: Shapes,
        loads: Loads,
        tolerance_mm: float,
        options: SolidOptions,
    ) -> DepthEffect | None:
        """Interpolate the depth effect through as few solved states as the accuracy needs.

        The next state is the state whose product of distances to the solved states is largest (Leja's order). The
        interpolation ends when a solved state is within ``accuracy_mm`` of its interpolated shape.

        Returns None if the loads do not lie on a straight line, or if Newton's method does not contract at once,
        because the solid is not near its planar model.
        """
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
            effect = DepthEffect((), (), by_turn, _base(places, by_turn, options.similar))
        for place in effect.places_of_base:
            unsolved = unsolved[np.abs(places[unsolved] - place) > same]
        while len(unsolved):
            solved = np.array([*effect.places, *effect.places_of_base])
            distance = np.abs(places[unsolved, None] - solved).prod(axis=1) if len(solved) else np.abs(places[unsolved])
            k = int(unsolved[np.argmax(distance)])
            predicted = effect.at(places[k]) if len(solved) > 1 or effect.base else None
            lifted = self._lifted(lift, flat, np.array([k]))
            difference = self._difference(
                chosen, loads.on(self.solid.loaded), loads.state(k), lifted, predicted, tolerance_mm
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
        lifted: Configuration,
        predicted: Configuration | None,
        tolerance_mm: float,
    ) -> Configuration | None:
        """Solve one state; return the solid minus the planar shape, or None if Newton's method does not contract.

        If the method does not contract from the first start, it begins again at the planar shape. With fields of both
        signs the first two solved states are the outermost ones, and a line through their depth effects is a bad start
        for the states between them.
        """
        batch, factor = chosen.take(np.arange(1))
        for start in ([] if predicted is None else [combine([1.0, 1.0], [lifted, predicted])]) + [lifted]:
            solid, status, _ = self.solid.solid.equilibrium(
                batch, loads_at(load, factor), start, tolerance_mm, _FEW, only_try=True
            )
            if status[0] == Status.CONVERGED:
                return combine([1.0, -1.0], [solid, lifted])
        return None

    def _lift(self, flat: Shapes) -> Array:
        """Return planar displacements (1, K, n, 3) at the solid's nodes, equal at all depths."""
        moved = self.planar.displacements(flat, self._plan)
        return np.concatenate([moved, np.zeros((*moved.shape[:-1], 1))], axis=-1)

    def _lifted(self, lift: Array, flat: Shapes, states: Indices) -> Configuration:
        """Return the planar shapes in some states as configurations of the solid without stress, one row per state."""
        rest = self.solid.solid.rest(len(states))
        return replace(rest, displacement=lift[0, states][:, self._column], rigid=flat.rigid[0, states])

    def _shapes(self, chosen: Candidates, flat: Shapes, lift: Array, loads: Loads, effect: DepthEffect) -> SolidShapes:
        """Add the depth effect to the planar shapes."""
        along = None if effect.by_turn else _along_ray(loads)
        places = self._turn(flat) if along is None else along
        moved, turned = effect.displacements(places)
        displacement = lift[:, :, self._column] + moved
        stretch = self.solid.solid.stretch(displacement[0]).max(axis=(0, 2))
        shapes = SolidShapes(
            displacement=displacement,
            rigid=flat.rigid + turned,
            status=np.full(flat.status.shape, Status.CONVERGED, np.int8),
            iterations=flat.iterations,
            max_stretch=stretch[None],
            last=combine([1.0, 1.0], [self._lifted(lift, flat, np.array([-1])), effect.at(float(places[-1]))]),
            effect=effect,
        )
        mark_unstable(chosen, shapes)
        return shapes


def _bent_candidate(chosen: Candidates, flat: Shapes) -> BentCandidate:
    batch = chosen.batch
    modulus = batch.law.initial_shear_modulus(batch.parameters)
    return BentCandidate(batch.law, float(batch.bulk[0] / modulus[0]), flat.displacement)


def _effect_of_equal_candidate(candidate: BentCandidate, options: SolidOptions) -> DepthEffect | None:
    """Return the depth effect of a candidate with the same law and planar shape; None if there is none."""
    for effect in options.similar:
        if effect.candidate and effect.candidate.is_alike(candidate, options.accuracy_mm):
            return effect
    return None


def _base(places: Array, by_turn: bool, similar: tuple[DepthEffect, ...]) -> DepthEffect | None:
    """Return, among the depth effects that cover the places, the one with the most similar tip rotations."""
    near = [e.without_base for e in similar if e.by_turn == by_turn and e.covers(places)]
    farthest = np.abs(places).max()
    return min(near, key=lambda effect: abs(np.abs(effect.places).max() - farthest), default=None)


def _along_ray(loads: Loads) -> Array | None:
    """Return the distances (K,) of the loads from the first load along a line; None if they are not on one line."""
    numbers = np.array([loads.state(k) for k in range(len(loads))])
    from_first = numbers - numbers[0]
    farthest = from_first[np.argmax((from_first**2).sum(axis=1))]
    size = float(farthest @ farthest)
    if size == 0:
        return np.zeros(len(loads))
    along = from_first @ farthest / size
    off = np.abs(from_first - along[:, None] * farthest).max()
    return along if off <= _STRAIGHT * np.abs(farthest).max() else None
