"""Conversion from the unit cube, in which the search moves, to the parameters of a law.

The search varies coordinates between 0 and 1. These unit coordinates are mapped to the physical coordinates of the law
(`Law.coordinates`): the initial shear modulus on a logarithmic scale, and dimensionless ratios on a linear scale. A
bending test determines the initial shear modulus well and the ratios poorly. Therefore the initial shear modulus is a
coordinate of its own.

The bulk modulus K can be added as a last coordinate, log10(K/mu), with the initial shear modulus mu. The first
coordinate is then no longer mu, but a quarter of

    E / (1 - nu^2) = 4 mu (3 K + mu) / (3 K + 4 mu),

because a bending test in plane strain determines this stiffness and not mu. E is Young's modulus and nu Poisson's
ratio. The quarter equals mu if the material is incompressible. Above K/mu = 100 the shapes of the beam hardly depend on
K. The upper end of the 95 % interval of K/mu is then the upper bound of the search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

BULK_NAME, BULK_DECADES = "log10 K/mu", (0.5, 4.0)  # a ratio of 10^4 counts as incompressible
STIFFNESS_NAME = "a quarter of E/(1-nu^2)"


@dataclass(frozen=True)
class SearchSpace:
    """The coordinates of the search for the parameters of one law, and their bounds; created by `search_space`.

    Parameters
    ----------
    law
        The hyperelastic law.
    names
        Names of the m physical coordinates, the quantities that the search varies. The first is the initial shear
        modulus (Pa). If the last is the bulk modulus, the first is a quarter of E / (1 - nu^2) (Pa), with Young's
        modulus E and Poisson's ratio nu.
    lower, upper
        Bounds of the physical coordinates.
    """

    law: Law
    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @property
    def has_bulk(self) -> bool:
        """Whether the bulk modulus is one of the coordinates, the quantities that the search varies."""
        return self.names[-1] == BULK_NAME

    def with_bulk(self) -> SearchSpace:
        """Return the same search space with the bulk modulus as an additional last coordinate."""
        low, high = BULK_DECADES
        names = (STIFFNESS_NAME, *self.names[1:], BULK_NAME)
        return replace(self, names=names, lower=(*self.lower, low), upper=(*self.upper, high))

    def bulk_modulus_Pa(self, unit: Array) -> Array | None:
        """Return the bulk modulus in Pa at each of P points of the unit cube, (P,); None if it is not a coordinate.

        ``unit`` has the m coordinates of each point, from 0 to 1, (P, m).
        """
        if not self.has_bulk:
            return None
        x = self.physical(unit)
        return np.asarray(self._shear_modulus(x) * 10.0 ** x[:, -1])

    def _shear_modulus(self, x: Array) -> Array:
        """Return the initial shear modulus mu in Pa of each of P candidate laws, (P,).

        ``x`` has the m physical coordinates of each candidate, (P, m): mu first or, if the bulk modulus K is a
        coordinate, a quarter of E / (1 - nu^2) first and log10(K/mu) last. E is Young's modulus and nu Poisson's ratio.
        """
        if not self.has_bulk:
            return x[:, 0]
        three = 3 * 10.0 ** x[:, -1]  # 3 K / mu
        return np.asarray(x[:, 0] * (three + 4) / (three + 1))

    def physical(self, unit: Array) -> Array:
        """Convert the unit coordinates of P points, (P, m) from 0 to 1, to physical coordinates, (P, m).

        The m physical coordinates are the quantities in ``names``: a modulus in Pa, then dimensionless numbers.
        """
        unit = np.atleast_2d(unit)
        lower, upper = np.array(self.lower), np.array(self.upper)
        x = lower + unit * (upper - lower)
        x[:, 0] = lower[0] * (upper[0] / lower[0]) ** unit[:, 0]
        return x

    def parameters(self, unit: Array) -> Array:
        """Return the parameters of the law at P points of the unit cube, (P, n).

        ``unit`` has the m coordinates of each point, from 0 to 1, (P, m). The law has n parameters.
        """
        x = self.physical(unit)
        coordinates_of_law = len(self.law.coordinates)
        return self.law.from_coordinates(np.column_stack([self._shear_modulus(x), x[:, 1:coordinates_of_law]]))


def search_space(law: Law) -> SearchSpace:
    """Return the search space of a law, without the bulk modulus.

    Parameters
    ----------
    law
        One of `LAWS`, or any other law.

    Returns
    -------
    SearchSpace
        The coordinates of the law with their bounds. `SearchSpace.with_bulk` adds the bulk modulus.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> search_space(LAWS["mooney-rivlin"]).parameters(np.array([0.5, 1 / 3])).round(3)
    array([[15811.388,     0.   ]])
    """
    names, lower, upper = zip(*((c.name, c.lower, c.upper) for c in law.coordinates), strict=True)
    return SearchSpace(law, names, lower, upper)
