"""The depth effect: the difference between the solid and the planar model of a beam, as a polynomial in the bending.

Let u_s be the configuration of the solid model and u_p the configuration of the planar model under the same loads. The
depth effect d = u_s - u_p is a smooth function of a scalar s. If the rotation of the tip changes monotonically along
the loads, s is the rotation of the tip of the planar model in rad. Otherwise s is the position of the load on a
straight line: the load of a state is a vector of numbers, such as the components of the field, and the loads of all
states must lie on one line. s is 0 at the first load and 1 at the farthest load from it (`beam.beside`). The solid
model is solved in n states, at the values s_i of s. The depth effect d_i in these states is interpolated by Lagrange's
polynomial,

    d(s) = b(s) + sum_i w_i(s) (d_i - b(s_i)),    w_i(s) = prod_{j != i} (s - s_j) / (s_i - s_j).

The base b is the depth effect of a similar candidate law, or zero. The difference from a base is small, and therefore
fewer solved states are needed.
"""

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
    """A candidate (set of parameters of a law) with its planar shape.

    Solid and planar model differ by the same amount for two candidates if the properties below agree.

    Attributes
    ----------
    law : Law
        The hyperelastic law.
    bulk_ratio : float
        Bulk modulus divided by initial shear modulus.
    planar : ndarray, shape (1, K, N, 2)
        Displacements of the N nodes of the planar model in K states, in mm.
    """

    law: Law
    bulk_ratio: float
    planar: Array

    def is_alike(self, other: BentCandidate, within_mm: float) -> bool:
        """Return whether another candidate has the same law, ratio of bulk to shear modulus, and planar displacements.

        within_mm: two displacements count as the same if they differ by at most this length.
        """
        same = self.law is other.law and abs(self.bulk_ratio / other.bulk_ratio - 1) < _SAME_BULK
        same = same and self.planar.shape == other.planar.shape
        return same and bool(np.abs(self.planar - other.planar).max() < within_mm)


@dataclass(frozen=True)
class DepthEffect:
    """The difference between the solid and the planar model of a beam, interpolated between the solved states.

    A number s measures the bending, and d(s) is the difference of the displacements.

    Attributes
    ----------
    places : tuple of float
        The values s_i of the states in which the solid model was solved.
    differences : tuple of Configuration
        The differences d_i between the two models in these states.
    by_turn : bool
        Whether s is the rotation of the tip of the planar model in rad. Otherwise s is the position of the load on a
        straight line through the loads of all states.
    base : DepthEffect or None
        The depth effect b(s) of a similar candidate law; only the difference d - b is interpolated. None: d is
        interpolated. If ``by_turn``, d(0) = b(0) is assumed.
    candidate : BentCandidate or None
        The candidate for which the states were solved.
    """

    places: tuple[float, ...]
    differences: tuple[Configuration, ...]
    by_turn: bool
    base: DepthEffect | None = None
    candidate: BentCandidate | None = None

    def at(self, place: float) -> Configuration:
        """Return the difference of the solid from the planar model at one value of the bending s (``place``)."""
        weights = self._weights(place)
        if self.base is None:
            return combine(weights, self.differences)
        return combine([1.0, *weights], [self.base.at(place), *self._from_base])

    def displacements(self, places: Array) -> tuple[Array, Array]:
        """Return the interpolated difference of the displacements of the solid and of the planar model.

        Parameters
        ----------
        places : ndarray, shape (K,)
            The K values s, which measure the bending.

        Returns
        -------
        displacement : ndarray, shape (K, N, 3)
            Difference of the displacements of the N nodes in mm.
        rigid : ndarray, shape (K, 3)
            Difference of the magnet's translation in mm and of its rotation in rad.
        """
        configurations = self.differences if self.base is None else self._from_base
        if not configurations:
            assert self.base
            return self.base.displacements(places)
        weights = np.array([self._weights(float(place)) for place in places])
        nodal, rigid = ([getattr(c, name)[0] for c in configurations] for name in ("displacement", "rigid"))
        displacement, turned = np.tensordot(weights, nodal, 1), weights @ np.array(rigid)
        if self.base is None:
            return displacement, turned
        base_displacement, base_rigid = self.base.displacements(places)
        return base_displacement + displacement, base_rigid + turned

    def _weights(self, place: float) -> list[float]:
        """Return the weight of each solved state in the interpolation at the bending ``place``."""
        nodes = (*self.places, *self.places_of_base)
        return [prod((place - s) / (t - s) for s in nodes if s != t) for t in self.places]

    @cached_property
    def _from_base(self) -> tuple[Configuration, ...]:
        """The differences between this depth effect and its base (that of a similar law) in the solved states."""
        assert self.base
        pairs = zip(self.places, self.differences, strict=True)
        return tuple(combine([1.0, -1.0], [difference, self.base.at(place)]) for place, difference in pairs)

    @property
    def places_of_base(self) -> tuple[float, ...]:
        """The values of the bending at which this depth effect equals that of a similar law, its base: (0,) or none."""
        return (0.0,) if self.base and self.by_turn else ()

    @cached_property
    def without_base(self) -> DepthEffect:
        """The same depth effect, stored without reference to the depth effect of a similar law (its base)."""
        if self.base is None or not self.places:
            return self.base or self
        scale = self.places[0] / self.base.places[0] if self.by_turn else 1.0
        places = tuple(scale * place for place in self.base.places)
        return DepthEffect(places, tuple(self.at(place) for place in places), self.by_turn)

    def covers(self, places: Array) -> bool:
        """Return whether this depth effect is valid for all states of another candidate law.

        places: the values of the bending s in these states.
        """
        return bool(self.without_base.reaches(places).all())

    def reaches(self, places: Array) -> NDArray[np.bool_]:
        """Return whether this depth effect is valid at each of K values of the bending (``places``), shape (K,)."""
        solved = (*self.places, *self.places_of_base)
        beyond = _EXTRAPOLATED * np.ptp(solved)
        return np.asarray((min(solved) - beyond <= places) & (places <= max(solved) + beyond))

    def thinned(self, most: int) -> DepthEffect:
        """Return this depth effect, interpolated through at most ``most`` of its solved states.

        It must have no base.
        """
        chosen = [int(np.argmax(np.abs(self.places)))]
        places = np.array(self.places)
        while len(chosen) < min(most, len(places)):
            chosen.append(int(np.argmax(np.abs(places[:, None] - places[chosen]).prod(axis=1))))
        return replace(
            self, places=tuple(places[chosen].tolist()), differences=tuple(self.differences[i] for i in chosen)
        )

    def with_one(self, place: float, difference: Configuration) -> DepthEffect:
        """Return this depth effect with one more solved state.

        place: the bending s of the state. difference: solid minus planar shape.
        """
        return DepthEffect((*self.places, place), (*self.differences, difference), self.by_turn, self.base)
