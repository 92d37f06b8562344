"""The depth effect: the difference between a solid and its planar model, as a polynomial in the bending of the beam.

Let u_s be the configuration of the solid and u_p that of its planar model under the same loads. The depth effect
d = u_s - u_p is smooth in a scalar s, the rotation of the planar tip, or the distance along a ray of loads where the
tip does not turn monotonically. From n solved states it is interpolated by Lagrange's polynomial,

    d(s) = b(s) + sum_i w_i(s) (d_i - b(s_i)),    w_i(s) = prod_{j != i} (s - s_j) / (s_i - s_j),

where the base b is the depth effect of a similar candidate, or zero. A base leaves a smaller difference, for which
fewer states are enough.
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

_EXTRAPOLATED = 0.1  # share of the range of its places by which a depth effect may be extrapolated
_SAME_BULK = 1e-3  # relative difference between ratios of bulk to shear modulus that counts as none


@dataclass(frozen=True)
class BentCandidate:
    """The properties of a candidate that determine its depth effect.

    Attributes
    ----------
    law : Law
    bulk_ratio : float
        Bulk modulus over shear modulus.
    planar : ndarray, shape (1, K, N, 2)
        Displacements of the planar model in mm.
    """

    law: Law
    bulk_ratio: float
    planar: Array

    def is_alike(self, other: BentCandidate, within_mm: float) -> bool:
        """Return whether the other candidate has the same law and planar displacements within a distance."""
        same = self.law is other.law and abs(self.bulk_ratio / other.bulk_ratio - 1) < _SAME_BULK
        same = same and self.planar.shape == other.planar.shape
        return same and bool(np.abs(self.planar - other.planar).max() < within_mm)


@dataclass(frozen=True)
class DepthEffect:
    """The difference between a solid and its planar model, interpolated between the states that were solved.

    Attributes
    ----------
    places : tuple of float
        The values s_i of the solved states.
    differences : tuple of Configuration
        The differences d_i in these states.
    by_turn : bool
        Whether s is the rotation of the planar tip in rad; otherwise it is the distance along the ray of loads.
    base : DepthEffect or None
        The depth effect of a similar candidate. Where the tip is not rotated, the two effects are assumed equal.
    candidate : BentCandidate or None
        The candidate for which the states were solved.
    """

    places: tuple[float, ...]
    differences: tuple[Configuration, ...]
    by_turn: bool
    base: DepthEffect | None = None
    candidate: BentCandidate | None = None

    def at(self, place: float) -> Configuration:
        """Return the interpolated difference at one place."""
        weights = self._weights(place)
        if self.base is None:
            return combine(weights, self.differences)
        return combine([1.0, *weights], [self.base.at(place), *self._from_base])

    def displacements(self, places: Array) -> tuple[Array, Array]:
        """Return the interpolated differences at K places, without stresses and pressures.

        Parameters
        ----------
        places : ndarray, shape (K,)

        Returns
        -------
        displacement : ndarray, shape (K, N, 3)
            Displacement of the nodes in mm.
        rigid : ndarray, shape (K, 3)
            Translation of the magnet in mm and its rotation in rad.
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
        """Return Lagrange's weights of the differences at a place."""
        nodes = (*self.places, *self.places_of_base)
        return [prod((place - s) / (t - s) for s in nodes if s != t) for t in self.places]

    @cached_property
    def _from_base(self) -> tuple[Configuration, ...]:
        """The differences d_i - b(s_i) from the base."""
        assert self.base
        pairs = zip(self.places, self.differences, strict=True)
        return tuple(combine([1.0, -1.0], [difference, self.base.at(place)]) for place, difference in pairs)

    @property
    def places_of_base(self) -> tuple[float, ...]:
        """The places at which this effect and its base are assumed equal."""
        return (0.0,) if self.base and self.by_turn else ()

    @cached_property
    def without_base(self) -> DepthEffect:
        """The same effect without a base, tabulated at the places of the base.

        The places are scaled so that the first place equals the first solved place of this effect.
        """
        if self.base is None or not self.places:
            return self.base or self
        scale = self.places[0] / self.base.places[0] if self.by_turn else 1.0
        places = tuple(scale * place for place in self.base.places)
        return DepthEffect(places, tuple(self.at(place) for place in places), self.by_turn)

    def covers(self, places: Array) -> bool:
        """Return whether this effect is valid at all places."""
        return bool(self.without_base.reaches(places).all())

    def reaches(self, places: Array) -> NDArray[np.bool_]:
        """Return whether the polynomial is valid at each place (K,): between the solved states or close to them."""
        solved = (*self.places, *self.places_of_base)
        beyond = _EXTRAPOLATED * np.ptp(solved)
        return np.asarray((min(solved) - beyond <= places) & (places <= max(solved) + beyond))

    def thinned(self, most: int) -> DepthEffect:
        """Return this effect, which has no base, with at most ``most`` states: those that lie farthest apart.

        A polynomial through many places at equal distances is inaccurate between them.
        """
        chosen = [int(np.argmax(np.abs(self.places)))]
        places = np.array(self.places)
        while len(chosen) < min(most, len(places)):
            chosen.append(int(np.argmax(np.abs(places[:, None] - places[chosen]).prod(axis=1))))
        return replace(
            self, places=tuple(places[chosen].tolist()), differences=tuple(self.differences[i] for i in chosen)
        )

    def with_one(self, place: float, difference: Configuration) -> DepthEffect:
        """Return this effect with the difference of one additional solved state."""
        return DepthEffect((*self.places, place), (*self.differences, difference), self.by_turn, self.base)
