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
    """The properties of a candidate law that decide whether it has the same depth effect as another candidate.

    The depth effect is the difference between the displacements of the solid and of the planar model. It is not
    computed again for a candidate that agrees with an earlier one in these properties.

    Attributes
    ----------
    law : Law
        The hyperelastic law.
    bulk_ratio : float
        Bulk modulus divided by initial shear modulus.
    planar : ndarray, shape (1, K, N, 2)
        Displacements of the N nodes of the planar model in K load states, in mm.
    """

    law: Law
    bulk_ratio: float
    planar: Array

    def is_alike(self, other: BentCandidate, within_mm: float) -> bool:
        """Return whether another candidate has the same law, bulk ratio and planar displacements.

        within_mm: two displacements count as the same if they differ by at most this length.
        """
        same = self.law is other.law and abs(self.bulk_ratio / other.bulk_ratio - 1) < _SAME_BULK
        same = same and self.planar.shape == other.planar.shape
        return same and bool(np.abs(self.planar - other.planar).max() < within_mm)


@dataclass(frozen=True)
class DepthEffect:
    """The difference d(s) between the shapes of the solid and of the planar model, for an amount of bending s.

    The solid model is solved in a few load states only. Between these states, d is interpolated by a polynomial in s.
    The amount of bending s is the rotation of the tip or the relative load, see ``by_turn``.

    Attributes
    ----------
    places : tuple of float
        The values of s in the load states in which the solid model was solved.
    differences : tuple of Configuration
        The configuration of the solid model minus that of the planar model in each of these states.
    by_turn : bool
        True: s is the rotation of the tip of the planar model in rad. False: s is the position of the load on the
        straight line through the loads of all states, 0 at the first load and 1 at the farthest load from it.
    base : DepthEffect or None
        The depth effect of a similar candidate law. Only the small difference from ``base`` is interpolated; if
        ``by_turn``, this difference is taken as zero at s = 0. None: d itself is interpolated.
    candidate : BentCandidate or None
        The candidate law for which d was computed.
    """

    places: tuple[float, ...]
    differences: tuple[Configuration, ...]
    by_turn: bool
    base: DepthEffect | None = None
    candidate: BentCandidate | None = None

    def at(self, place: float) -> Configuration:
        """Return the solid minus the planar configuration for one amount of bending, by interpolation.

        place: the amount of bending: the rotation of the tip in rad, or the relative load; see ``by_turn``.
        """
        weights = self._weights(place)
        if self.base is None:
            return combine(weights, self.differences)
        return combine([1.0, *weights], [self.base.at(place), *self._from_base])

    def displacements(self, places: Array) -> tuple[Array, Array]:
        """Return the displacements of the solid model minus those of the planar model, interpolated in K load states.

        Parameters
        ----------
        places : ndarray, shape (K,)
            The amount of bending in each state: the rotation of the tip in rad, or the relative load; see ``by_turn``.

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
        """Return the weights of Lagrange's interpolation between the load states in which the solid model was solved.

        place: the amount of bending at which the result is interpolated: the rotation of the tip in rad, or the
        relative load.
        """
        nodes = (*self.places, *self.places_of_base)
        return [prod((place - s) / (t - s) for s in nodes if s != t) for t in self.places]

    @cached_property
    def _from_base(self) -> tuple[Configuration, ...]:
        """The solid minus the planar configuration, less that of a similar candidate law (``base``).

        There is one difference for each load state in which the solid model was solved.
        """
        assert self.base
        pairs = zip(self.places, self.differences, strict=True)
        return tuple(combine([1.0, -1.0], [difference, self.base.at(place)]) for place, difference in pairs)

    @property
    def places_of_base(self) -> tuple[float, ...]:
        """The amount of bending at which the difference from a similar candidate law is taken as zero: (0,) or none.

        The amount of bending is the rotation of the tip. The solid minus the planar configuration is interpolated
        through this value and through the load states in which the solid model was solved.
        """
        return (0.0,) if self.base and self.by_turn else ()

    @cached_property
    def without_base(self) -> DepthEffect:
        """The difference of the solid from the planar model as one polynomial in the amount of bending.

        The result makes no reference to the difference that was computed for a similar candidate law (``base``).
        """
        if self.base is None or not self.places:
            return self.base or self
        scale = self.places[0] / self.base.places[0] if self.by_turn else 1.0
        places = tuple(scale * place for place in self.base.places)
        return DepthEffect(places, tuple(self.at(place) for place in places), self.by_turn)

    def covers(self, places: Array) -> bool:
        """Return whether the difference of solid and planar shapes may be used for another candidate law.

        places: the amount of bending of the other candidate in each of K load states (the rotation of the tip in rad,
        or the relative load), shape (K,).
        """
        return bool(self.without_base.reaches(places).all())

    def reaches(self, places: Array) -> NDArray[np.bool_]:
        """Return whether the interpolation is valid for each of K amounts of bending, shape (K,).

        It is valid between the smallest and the largest bending through which it was computed, and outside by at most
        10 % of this range. places: the amounts of bending (the rotation of the tip in rad, or the relative load), shape
        (K,).
        """
        solved = (*self.places, *self.places_of_base)
        beyond = _EXTRAPOLATED * np.ptp(solved)
        return np.asarray((min(solved) - beyond <= places) & (places <= max(solved) + beyond))

    def thinned(self, most: int) -> DepthEffect:
        """Return an interpolation through at most ``most`` of the load states in which the solid model was solved.

        The interpolated quantity is the solid minus the planar configuration. It must not be stored as a difference
        from that of a similar candidate law (``base``).
        """
        chosen = [int(np.argmax(np.abs(self.places)))]
        places = np.array(self.places)
        while len(chosen) < min(most, len(places)):
            chosen.append(int(np.argmax(np.abs(places[:, None] - places[chosen]).prod(axis=1))))
        return replace(
            self, places=tuple(places[chosen].tolist()), differences=tuple(self.differences[i] for i in chosen)
        )

    def with_one(self, place: float, difference: Configuration) -> DepthEffect:
        """Return the interpolation with one more load state in which the solid model was solved.

        place: the amount of bending in this state (the rotation of the tip in rad, or the relative load). difference:
        the solid minus the planar configuration.
        """
        return DepthEffect((*self.places, place), (*self.differences, difference), self.by_turn, self.base)
