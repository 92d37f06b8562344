"""The coordinates in which the search moves: each between 0 and 1, moduli by their logarithm.

Every law is described by its initial shear modulus and by ratios, `Law.coordinates`: what a bending test fixes well is
then one coordinate, and what it fixes badly is the others.

The bulk modulus is a search coordinate where asked for, as log10 of its ratio to the initial shear modulus. Bending in
plane strain sees E / (1 - nu^2) = 4 mu (3 K + mu) / (3 K + 4 mu) above all: a quarter of that, which is mu for an
incompressible material, is then the first coordinate. Above a ratio of a hundred hardly anything else depends on K: the
interval reaches the upper bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

BULK_NAME, BULK_DECADES = "log10 K/mu", (0.5, 4.0)  # of bulk over shear modulus: 4 is what incompressible means here
STIFFNESS_NAME = "a quarter of E/(1-nu^2)"


@dataclass(frozen=True)
class SearchSpace:
    """Bounds of the physical search coordinates of one law; the first is the initial shear modulus (Pa).

    Where ``with_bulk`` has put the bulk modulus last, the first is a quarter of the plane-strain modulus.
    `search_space` makes one.
    """

    law: Law
    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @property
    def has_bulk(self) -> bool:
        """Whether the bulk modulus is one of the coordinates."""
        return self.names[-1] == BULK_NAME

    def with_bulk(self) -> SearchSpace:
        """The same space with the bulk modulus as its last coordinate."""
        low, high = BULK_DECADES
        names = (STIFFNESS_NAME, *self.names[1:], BULK_NAME)
        return replace(self, names=names, lower=(*self.lower, low), upper=(*self.upper, high))

    def bulk_modulus_Pa(self, unit: Array) -> Array | None:
        """(P, n) in 0..1 -> (P,); None where it is not a coordinate."""
        if not self.has_bulk:
            return None
        x = self.physical(unit)
        return np.asarray(self._shear_modulus(x) * 10.0 ** x[:, -1])

    def _shear_modulus(self, x: Array) -> Array:
        """(P,) of physical coordinates (P, n)."""
        if not self.has_bulk:
            return x[:, 0]
        three = 3 * 10.0 ** x[:, -1]  # 3 K / mu
        return np.asarray(x[:, 0] * (three + 4) / (three + 1))

    def physical(self, unit: Array) -> Array:
        """(P, n) in 0..1 -> (P, n) physical coordinates."""
        unit = np.atleast_2d(unit)
        lower, upper = np.array(self.lower), np.array(self.upper)
        x = lower + unit * (upper - lower)
        x[:, 0] = lower[0] * (upper[0] / lower[0]) ** unit[:, 0]
        return x

    def parameters(self, unit: Array) -> Array:
        """(P, n) in 0..1 -> the law's own parameters (P, n_parameters)."""
        x = self.physical(unit)
        own = len(self.law.coordinates)
        return self.law.from_coordinates(np.column_stack([self._shear_modulus(x), x[:, 1:own]]))


def search_space(law: Law) -> SearchSpace:
    """The space in which a law is searched.

    Parameters
    ----------
    law
        One of `LAWS`, or any other.

    Returns
    -------
    Its coordinates with their bounds; `SearchSpace.with_bulk` adds the bulk modulus.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> search_space(LAWS["mooney-rivlin"]).parameters(np.array([0.5, 1 / 3])).round(3)
    array([[15811.388,     0.   ]])
    """
    names, lower, upper = zip(*((c.name, c.lower, c.upper) for c in law.coordinates), strict=True)
    return SearchSpace(law, names, lower, upper)
