"""The solid beside its planar model: what depth adds to planar shapes, found in a few states and carried to the others.

In plane stress a beam bends almost as its solid does. The difference is some hundredths of the deflection and smooth in
how far the beam is turned: Newton's method reaches the solid from the planar shape in a few steps in any state, and few
states tell the others. Candidates of one law whose planar shapes are the same, such as fits from other seeds, have the
same solid: one of them is solved for all.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Configuration, Status, combine
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.mesh import Indices
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.path import Candidates, LoadsAt, Shapes, candidates, mark_unstable
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

# A state that was foretold this well by the states before it is the last that is solved. The bulk of the specimen shows
# a tenth of that, and its edges are good to 1e-3 mm.
FORETOLD_MM = 1e-3
Reach = Literal["any", "at once", "followed"]
"""How a solid is sought: at once from its planar shape, followed through all states, or thus where the first fails."""

_FEW = 6  # iterations of Newton's method from a start that is near
_SAME = 1e-6  # of the range of places: nearer than this is the same place
_BEYOND = 0.1  # of its range: so far beyond its places an effect is extrapolated
_SAME_BULK = 1e-3  # of its ratio to the shear modulus
_LEAST_TURN = 1e-3  # rad: a beam that turns less is told apart by its load


@dataclass(frozen=True)
class _Origin:
    """Of which candidate an effect is: its law, its bulk over its shear modulus, its planar displacements."""

    law: Law
    bulk_ratio: float
    planar: Array

    def is_alike(self, other: _Origin, within_mm: float) -> bool:
        """Whether the other has the same law and, so far as it counts, the same planar shapes."""
        same = self.law is other.law and abs(self.bulk_ratio / other.bulk_ratio - 1) < _SAME_BULK
        same = same and self.planar.shape == other.planar.shape
        return same and bool(np.abs(self.planar - other.planar).max() < within_mm)


@dataclass(frozen=True)
class DepthEffect:
    """How a solid differs from its planar model: at places, where a beam may stand, the configurations' differences.

    by_turn: a place is how far the planar tip is turned (rad), else how far along a ray of loads it is; base: an effect
    of a candidate near this one, about which this one is interpolated. Where the tip is not turned the two are alike.
    origin: the candidate that was solved for it.
    """

    places: tuple[float, ...]
    differences: tuple[Configuration, ...]
    by_turn: bool
    base: DepthEffect | None = None
    origin: _Origin | None = None

    def at(self, place: float) -> Configuration:
        """By the polynomial through all of the differences from the base."""
        weights = self._weights(place)
        if self.base is None:
            return combine(weights, self.differences)
        return combine([1.0, *weights], [self.base.at(place), *self._from_base])

    def moves(self, places: Array) -> tuple[Array, Array]:
        """(K, N, 3) mm and (K, 3): `at` of K places, without stresses and pressures."""
        weights = np.array([self._weights(float(place)) for place in places])
        every = self.differences if self.base is None else self._from_base
        nodal, rigid = ([getattr(own, name)[0] for own in every] for name in ("displacement", "rigid"))
        if not every:
            assert self.base
            return self.base.moves(places)
        own = np.tensordot(weights, nodal, 1), weights @ np.array(rigid)
        below = self.base.moves(places) if self.base else None
        return (below[0] + own[0], below[1] + own[1]) if below else own

    def _weights(self, place: float) -> list[float]:
        known = (*self.places, *self.alike)
        return [prod((place - s) / (t - s) for s in known if s != t) for t in self.places]

    @cached_property
    def _from_base(self) -> tuple[Configuration, ...]:
        assert self.base
        pairs = zip(self.places, self.differences, strict=True)
        return tuple(combine([1.0, -1.0], [own, self.base.at(place)]) for place, own in pairs)

    @property
    def alike(self) -> tuple[float, ...]:
        """Places where it is the same as its base."""
        return (0.0,) if self.base and self.by_turn else ()

    @cached_property
    def alone(self) -> DepthEffect:
        """The same without a base, as far as it was solved: at the base's places, drawn together to that."""
        if self.base is None or not self.places:
            return self.base or self
        reach = self.places[0] / self.base.places[0] if self.by_turn else 1.0
        places = tuple(reach * place for place in self.base.places)
        return DepthEffect(places, tuple(self.at(place) for place in places), self.by_turn)

    def covers(self, places: Array) -> bool:
        """Whether it is known that far, or nearly so: beyond its places a polynomial swings."""
        own = self.alone.places
        beyond = _BEYOND * np.ptp(own)
        return bool(min(own) - beyond <= places.min() and places.max() <= max(own) + beyond)

    def with_one(self, place: float, difference: Configuration) -> DepthEffect:
        """Known at one more place."""
        return DepthEffect((*self.places, place), (*self.differences, difference), self.by_turn, self.base)


@dataclass(frozen=True)
class SolidShapes(Shapes):
    """Shapes of a solid; effect: what it differs by from its planar model, None where each state was solved."""

    effect: DepthEffect | None = None


class SolidBeside:
    """A solid model and the planar model of the same lines, for one candidate at a time; see `SolidModel`."""

    def __init__(self, specimen: Specimen, along: int, across: int, more: int = 0) -> None:
        self.specimen = specimen
        self.solid = SolidModel(specimen, along, across, more)
        self.planar = BeamModel(specimen, along, across, "plane-stress")
        self.mesh = self.solid.mesh
        self._plan, column = np.unique(self.mesh.nodes[:, :2], axis=0, return_inverse=True)
        self._column = column.reshape(-1)
        self._starts: tuple[DepthEffect, ...] = ()
        self._foretold_mm = FORETOLD_MM
        self._reach: Reach = "any"
        self._flat: Shapes | None = None
        self._known: DepthEffect | None = None

    def __reduce__(self) -> tuple[type[SolidBeside], tuple[Specimen, int, int, int], dict[str, object]]:
        """As `BeamModel` is sent."""
        arguments = (self.specimen, self.planar.along, self.planar.across, self.solid.more)
        chosen = ("_starts", "_foretold_mm", "_reach", "_known")
        return SolidBeside, arguments, {name: vars(self)[name] for name in chosen}

    def knowing(self, effect: DepthEffect | None) -> SolidBeside:
        """The same model with the effect of depth known, by the tip's turn: planar shapes alone are solved; or not."""
        own = copy(self)
        own._known = effect
        return own

    def __copy__(self) -> SolidBeside:
        own = object.__new__(SolidBeside)
        vars(own).update(vars(self))
        return own

    def of(self, specimen: Specimen) -> SolidBeside:
        """Another specimen on as many elements."""
        return SolidBeside(specimen, self.planar.along, self.planar.across, self.solid.more)

    def is_beside(self, model: BeamModel) -> bool:
        """Whether a planar model's lines are those of this solid, so that its shapes are the planar ones here."""
        planar = self.planar
        same_lines = (planar.along, planar.across, planar.plane) == (model.along, model.across, model.plane)
        return same_lines and replace(planar.specimen, section=model.specimen.section) == model.specimen

    def lifting(self, flat: Shapes | None) -> SolidBeside:
        """The same model, for the one candidate whose planar shapes are given: they are not sought again."""
        own = copy(self)
        own._flat = flat
        return own

    def starting(
        self, *effects: DepthEffect | None, foretold_mm: float = FORETOLD_MM, reach: Reach = "any"
    ) -> SolidBeside:
        """The same model, for candidates near those whose effects of depth are given.

        foretold_mm: how well a state has to be foretold to be the last that is solved; reach: what is not reached thus
        has diverged.
        """
        own = copy(self)
        own._starts = tuple(effect for effect in effects if effect)
        own._foretold_mm, own._reach = foretold_mm, reach
        return own

    def solve(
        self,
        law: Law,
        parameters: Array,
        loads: Loads,
        *,
        tolerance_mm: float = 1e-2,
        bulk_modulus_Pa: Array | None = None,
        field_factor: Array | None = None,
    ) -> SolidShapes:
        """As `SolidModel.solve`, of one candidate (1, n). Raises ValueError for more."""
        parameters = np.atleast_2d(parameters)
        if len(parameters) != 1:
            raise ValueError(f"one candidate at a time, not {len(parameters)}")
        flat = self._flat or self.planar.solve(
            law, parameters, loads, tolerance_mm=tolerance_mm, field_factor=field_factor
        )
        chosen = candidates(law, parameters, "solid", bulk_modulus_Pa, field_factor)
        effect = lift = None
        if np.isin(flat.status, (Status.CONVERGED, Status.UNSTABLE)).all():
            lift = self._lift(flat)
            origin = _origin(chosen, flat)
            effect = self._known or self._of_one_alike(origin)
            if effect is None and self._reach != "followed":
                found = self._effect(chosen, lift, flat, loads, tolerance_mm)
                effect = replace(found, origin=origin) if found else None
        if effect is None and self._reach == "at once":
            return self._given_up(flat)
        if effect is None or lift is None:
            every = self.solid.solve(
                law,
                parameters,
                loads,
                tolerance_mm=tolerance_mm,
                bulk_modulus_Pa=bulk_modulus_Pa,
                field_factor=field_factor,
                beside=None if lift is None else self._lifted(lift, flat, np.arange(len(loads))),
            )
            return SolidShapes(**vars(every))
        return self._shapes(chosen, flat, lift, loads, effect)

    def _given_up(self, flat: Shapes) -> SolidShapes:
        """All states as they would be without loads, and diverged."""
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
        return np.asarray(np.radians(self.planar.tip_angle_deg(flat)[0]))

    def _effect(
        self, chosen: Candidates, lift: Array, flat: Shapes, loads: Loads, tolerance_mm: float
    ) -> DepthEffect | None:
        """State after state as far as possible from those before (Leja's order), until one is foretold well enough.

        None where the loads lie on no ray, or Newton's method does not contract at once: the solid is then not near.
        """
        along = _along_ray(loads)
        if along is None:
            return None
        turn = self._turn(flat)
        step = np.diff(turn[np.argsort(along, kind="stable")])
        by_turn = bool(((step >= 0).all() or (step <= 0).all()) and np.ptp(turn) > _LEAST_TURN)
        places = turn if by_turn else along
        effect = DepthEffect((), (), by_turn, self._base(places, by_turn))
        apart = _SAME * max(float(np.ptp(places)), _LEAST_TURN)
        left = np.arange(len(places))
        for own in effect.alike:
            left = left[np.abs(places[left] - own) > apart]
        while len(left):
            known = np.array([*effect.places, *effect.alike])
            distance = np.abs(places[left, None] - known).prod(axis=1) if len(known) else np.abs(places[left])
            k = int(left[np.argmax(distance)])
            foretold = effect.at(places[k]) if len(known) > 1 or effect.base else None
            lifted = self._lifted(lift, flat, np.array([k]))
            found = self._solved(chosen, loads.on(self.solid.loaded), loads.state(k), lifted, foretold, tolerance_mm)
            if found is None:
                return None
            effect = effect.with_one(float(places[k]), found)
            left = left[np.abs(places[left] - places[k]) > apart]
            if foretold and len(known) and np.abs(foretold.displacement - found.displacement).max() < self._foretold_mm:
                break
        return effect

    def _of_one_alike(self, origin: _Origin) -> DepthEffect | None:
        """Of the effects given, one of a candidate that is as near as a state has to be foretold."""
        alike = (e for e in self._starts if e.origin and e.origin.is_alike(origin, self._foretold_mm))
        return next(alike, None)

    def _base(self, places: Array, by_turn: bool) -> DepthEffect | None:
        """Of the effects given that are known far enough, that of the candidate which the loads turn most alike."""
        near = [own.alone for own in self._starts if own.by_turn == by_turn and own.covers(places)]
        farthest = np.abs(places).max()
        return min(near, key=lambda own: abs(np.abs(own.places).max() - farthest), default=None)

    def _solved(
        self,
        chosen: Candidates,
        loads_at: LoadsAt,
        load: Array,
        lifted: Configuration,
        foretold: Configuration | None,
        tolerance_mm: float,
    ) -> Configuration | None:
        """The solid under a load, less the planar shape; None where Newton's method does not reach it at once."""
        guess = lifted if foretold is None else combine([1.0, 1.0], [lifted, foretold])
        batch, factor = chosen.take(np.arange(1))
        found, status, _ = self.solid.solid.equilibrium(
            batch, loads_at(load, factor), guess, tolerance_mm, _FEW, only_try=True
        )
        return combine([1.0, -1.0], [found, lifted]) if status[0] == Status.CONVERGED else None

    def _lift(self, flat: Shapes) -> Array:
        """(1, K, n, 3): planar displacements where the solid has nodes, at one depth: all others move alike."""
        moved = self.planar.positions(flat, self._plan) - self._plan
        return np.concatenate([moved, np.zeros((*moved.shape[:-1], 1))], axis=-1)

    def _lifted(self, lift: Array, flat: Shapes, states: Indices) -> Configuration:
        """The planar shapes in some states, a row a state, without stress."""
        rest = self.solid.solid.rest(len(states))
        return replace(rest, displacement=lift[0, states][:, self._column], rigid=flat.rigid[0, states])

    def _shapes(self, chosen: Candidates, flat: Shapes, lift: Array, loads: Loads, effect: DepthEffect) -> SolidShapes:
        along = None if effect.by_turn else _along_ray(loads)
        places = self._turn(flat) if along is None else along
        moved, turned = effect.moves(places)
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


def _origin(chosen: Candidates, flat: Shapes) -> _Origin:
    batch = chosen.batch
    modulus = batch.law.initial_shear_modulus(batch.parameters)
    return _Origin(batch.law, float(batch.bulk[0] / modulus[0]), flat.displacement)


def _along_ray(loads: Loads) -> Array | None:
    """(K,): how far along a straight line the loads are, 0 for the first; None where they lie on none."""
    every = np.array([loads.state(k) for k in range(len(loads))])
    from_first = every - every[0]
    farthest = from_first[np.argmax((from_first**2).sum(axis=1))]
    size = float(farthest @ farthest)
    if size == 0:
        return np.zeros(len(loads))
    along = from_first @ farthest / size
    off = np.abs(from_first - along[:, None] * farthest).max()
    return along if off <= _SAME * np.abs(farthest).max() else None
