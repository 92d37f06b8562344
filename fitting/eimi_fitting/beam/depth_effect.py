"""The difference between the solid and the planar model of a beam, interpolated between load states."""

# This difference is called the depth effect d. It is a polynomial in s. For some beams s is the rotation of the tip,
# for the others the share of the full load. With the depth effects d_i at n values s_i,
#
#     d(s) = b(s) + sum_i w_i(s) (d_i - b(s_i)),    w_i(s) = prod_{j != i} (s - s_j) / (s_i - s_j).
#
# The base b is the depth effect of a similar candidate law, or zero.

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Configuration, combine
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

_EXTRAPOLATED = 0.1  # a depth effect may be extrapolated by this share of the range of its solved places
_SAME_BULK = 1e-3  # relative difference between ratios of bulk to shear modulus that counts as none


@dataclass(frozen=True)
class BentCandidate:
    """A candidate law with the shapes of its planar beam model."""

    # The hyperelastic law.
    law: Law
    # Bulk modulus divided by initial shear modulus.
    bulk_ratio: float
    # (1, K, N, 2): displacements of N nodes of the planar model in K load states, in mm.
    planar: Array

    def is_alike(self, other: BentCandidate, within_mm: float) -> bool:
        """Return whether two candidates have the same law, the same compressibility and nearly the same shapes."""
        same = self.law is other.law and abs(self.bulk_ratio / other.bulk_ratio - 1) < _SAME_BULK
        same = same and self.planar.shape == other.planar.shape
        return same and bool(np.abs(self.planar - other.planar).max() < within_mm)


@dataclass(frozen=True)
class DepthEffect:
    """The difference between the solid and the planar model of a beam, interpolated between load states."""

    # The polynomial d(s) of the module.

    # The values of s at which the solid model was solved.
    places: tuple[float, ...]
    # The values of d: solid minus planar configuration.
    differences: tuple[Configuration, ...]
    # True: s is the rotation of the tip in rad. False: s is the load, 0 for the first and 1 for the farthest load.
    by_turn: bool
    # The depth effect of a similar candidate law, to which the polynomial is added.
    base: DepthEffect | None = None
    # The candidate law.
    candidate: BentCandidate | None = None

    def at(self, load_or_rotation: float) -> Configuration:
        """Interpolate the difference between solid and planar model at a given load or rotation of the tip."""
        # ``load_or_rotation``: s, the rotation of the tip in rad if ``by_turn``, else the load from 0 to 1.
        weights = self._weights(load_or_rotation)
        if self.base is None:
            return combine(weights, self.differences)
        return combine([1.0, *weights], [self.base.at(load_or_rotation), *self._from_base])

    def displacements(self, loads_or_rotations: Array) -> tuple[Array, Array]:
        """Interpolate the difference between solid and planar displacements at several loads or tip rotations."""
        # ``loads_or_rotations`` (K,): values of s. The results: (K, N, 3) for N nodes in mm, and (K, 3) for the
        # magnet's translation in mm and rotation in rad.
        configurations = self.differences if self.base is None else self._from_base
        if not configurations:
            assert self.base
            return self.base.displacements(loads_or_rotations)
        weights = np.array([self._weights(float(s)) for s in loads_or_rotations])
        nodal, rigid = ([getattr(c, name)[0] for c in configurations] for name in ("displacement", "rigid"))
        displacement, turned = np.tensordot(weights, nodal, 1), weights @ np.array(rigid)
        if self.base is None:
            return displacement, turned
        base_displacement, base_rigid = self.base.displacements(loads_or_rotations)
        return base_displacement + displacement, base_rigid + turned

    def _weights(self, load_or_rotation: float) -> list[float]:
        # The weights w_i(s) of Lagrange's interpolation.
        nodes = (*self.places, *self.places_of_base)
        return [prod((load_or_rotation - s) / (t - s) for s in nodes if s != t) for t in self.places]

    @cached_property
    def _from_base(self) -> tuple[Configuration, ...]:
        # The values d_i - b(s_i) that are interpolated.
        assert self.base
        pairs = zip(self.places, self.differences, strict=True)
        return tuple(combine([1.0, -1.0], [difference, self.base.at(place)]) for place, difference in pairs)

    @property
    def places_of_base(self) -> tuple[float, ...]:
        """The tip rotation 0, at which the difference is that of a similar law; empty if there is no similar law."""
        return (0.0,) if self.base and self.by_turn else ()

    @cached_property
    def without_base(self) -> DepthEffect:
        """An approximation of this interpolation by a single polynomial, which needs no similar law."""
        if self.base is None or not self.places:
            return self.base or self
        scale = self.places[0] / self.base.places[0] if self.by_turn else 1.0
        places = tuple(scale * place for place in self.base.places)
        return DepthEffect(places, tuple(self.at(place) for place in places), self.by_turn)

    def covers(self, loads_or_rotations: Array) -> bool:
        """Return whether all given loads or tip rotations lie in the solved range, or at most 10 % outside."""
        return bool(self.without_base.reaches(loads_or_rotations).all())

    def reaches(self, loads_or_rotations: Array) -> NDArray[np.bool_]:
        """Return whether each load or tip rotation lies in the solved range, or at most 10 % outside."""
        solved = (*self.places, *self.places_of_base)
        beyond = _EXTRAPOLATED * np.ptp(solved)
        return np.asarray((min(solved) - beyond <= loads_or_rotations) & (loads_or_rotations <= max(solved) + beyond))

    def thinned(self, most: int) -> DepthEffect:
        """Return a copy with at most ``most`` data points of the interpolation between load states."""
        chosen = [int(np.argmax(np.abs(self.places)))]
        places = np.array(self.places)
        while len(chosen) < min(most, len(places)):
            chosen.append(int(np.argmax(np.abs(places[:, None] - places[chosen]).prod(axis=1))))
        return replace(
            self, places=tuple(places[chosen].tolist()), differences=tuple(self.differences[i] for i in chosen)
        )

    def with_one(self, load_or_rotation: float, difference: Configuration) -> DepthEffect:
        """Return a copy with one more data point for the interpolation: the difference at a load or tip rotation."""
        # ``load_or_rotation``: s. ``difference``: solid minus planar configuration at s.
        return DepthEffect((*self.places, load_or_rotation), (*self.differences, difference), self.by_turn, self.base)
