"""Conversion from the unit cube, in which the search moves, to the parameters of a law.

The modulus has a logarithmic scale, and dimensionless ratios have a linear scale. With the bulk modulus K, the
coordinates also contain log10(K/mu), and the first coordinate is not the shear modulus mu, but a quarter of

    E / (1 - nu^2) = 4 mu (3 K + mu) / (3 K + 4 mu),

where E is Young's modulus and nu is Poisson's ratio.
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
    """The quantities (coordinates) that the search for the parameters of one law varies, and their bounds.

    Parameters
    ----------
    law
        Hyperelastic law.
    names
        Names of the m coordinates.
    lower, upper
        Bounds of the coordinates.
    """

    law: Law
    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @property
    def has_bulk(self) -> bool:
        """Whether the search varies the bulk modulus."""
        return self.names[-1] == BULK_NAME

    def with_bulk(self) -> SearchSpace:
        """Return the same search space with the bulk modulus as an additional last coordinate."""
        # A bending test in plane strain determines E / (1 - nu^2), and not the shear modulus.
        low, high = BULK_DECADES
        names = (STIFFNESS_NAME, *self.names[1:], BULK_NAME)
        return replace(self, names=names, lower=(*self.lower, low), upper=(*self.upper, high))

    def bulk_modulus_Pa(self, unit: Array) -> Array | None:
        """Return the bulk modulus (Pa) at P points of the unit cube, (P,); None if the search does not vary it.

        ``unit`` has the m coordinates of the points, from 0 to 1, (P, m).
        """
        if not self.has_bulk:
            return None
        x = self.physical(unit)
        return np.asarray(self._shear_modulus(x) * 10.0 ** x[:, -1])

    def _shear_modulus(self, x: Array) -> Array:
        """Return the initial shear modulus of P candidates, (P,) in Pa, from their coordinates `x`, (P, m)."""
        if not self.has_bulk:
            return x[:, 0]
        three = 3 * 10.0 ** x[:, -1]  # 3 K / mu
        return np.asarray(x[:, 0] * (three + 4) / (three + 1))

    def physical(self, unit: Array) -> Array:
        """Convert coordinates from 0 to 1 into the physical quantities ``names``, both (P, m) for P points."""
        unit = np.atleast_2d(unit)
        lower, upper = np.array(self.lower), np.array(self.upper)
        x = lower + unit * (upper - lower)
        x[:, 0] = lower[0] * (upper[0] / lower[0]) ** unit[:, 0]
        return x

    def parameters(self, unit: Array) -> Array:
        """Return the n parameters of the law at P points of the unit cube, (P, n).

        ``unit`` has the m coordinates of the points, from 0 to 1, (P, m).
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
        Coordinates of the law with their bounds.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> search_space(LAWS["mooney-rivlin"]).parameters(np.array([0.5, 1 / 3])).round(3)
    array([[15811.388,     0.   ]])
    """
    names, lower, upper = zip(*((c.name, c.lower, c.upper) for c in law.coordinates), strict=True)
    return SearchSpace(law, names, lower, upper)
