"""The coordinates in which the search moves: each between 0 and 1, moduli by their logarithm.

Every law is described by its initial shear modulus and by ratios: what a bending test fixes well is then one
coordinate, and what it fixes badly is the others. The bounds are this project's own choice; the modulus spans every
published value of the usual casting silicones with room to spare.

The bulk modulus is a search coordinate where asked for, as log10 of its ratio to the initial shear modulus. Bending in
plane strain sees E / (1 - nu^2) = 4 mu (3 K + mu) / (3 K + 4 mu) above all: a quarter of that, which is mu for an
incompressible material, is then the first coordinate. Above a ratio of a hundred hardly anything else depends on K: the
interval reaches the upper bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHEAR_MODULUS_PA = (1e3, 1e6)
BULK_NAME, BULK_DECADES = "log10 K/mu", (0.5, 4.0)  # of bulk over shear modulus: 4 is what incompressible means here
STIFFNESS_NAME = "a quarter of E/(1-nu^2)"


@dataclass(frozen=True)
class SearchSpace:
    """Bounds of the physical search coordinates of one law; the first is the initial shear modulus (Pa).

    Where ``with_bulk`` has put the bulk modulus last, the first is a quarter of the plane-strain modulus.
    """

    law: str
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
        mu0 = self._shear_modulus(x)
        if self.law == "neo-hookean":
            return mu0[:, None]
        if self.law == "mooney-rivlin":
            return np.column_stack([0.5 * mu0 * (1 - x[:, 1]), 0.5 * mu0 * x[:, 1]])
        if self.law == "yeoh":
            return 0.5 * mu0[:, None] * np.column_stack([np.ones(len(x)), x[:, 1], x[:, 2]])
        # Ogden: the modulus is shared out among the terms, mu_p alpha_p = 2 mu0 share_p.
        first = x[:, 1]
        shares = np.column_stack([first, (1 - first) * x[:, 2], (1 - first) * (1 - x[:, 2])])
        alpha = x[:, 3:6]
        mu = 2 * mu0[:, None] * shares / alpha
        return np.stack([mu, alpha], axis=-1).reshape(len(x), 6)


SEARCH_SPACES: dict[str, SearchSpace] = {
    "neo-hookean": SearchSpace("neo-hookean", ("mu",), (SHEAR_MODULUS_PA[0],), (SHEAR_MODULUS_PA[1],)),
    "mooney-rivlin": SearchSpace(
        "mooney-rivlin",
        ("2(C10+C01)", "C01/(C10+C01)"),
        (SHEAR_MODULUS_PA[0], -0.5),
        (SHEAR_MODULUS_PA[1], 1.0),
    ),
    "yeoh": SearchSpace(
        "yeoh",
        ("2 C10", "C20/C10", "C30/C10"),
        (SHEAR_MODULUS_PA[0], -1.0, -2.0),
        (SHEAR_MODULUS_PA[1], 2.0, 2.0),
    ),
    # Ranges of the exponents do not overlap: the terms keep their names. Positive mu_p alpha_p in every term is
    # Hill's sufficient condition for stability (Hill 1970, J. Mech. Phys. Solids 18:457).
    "ogden": SearchSpace(
        "ogden",
        ("half sum mu alpha", "share of term 1", "share of term 2 in the rest", "alpha1", "alpha2", "alpha3"),
        (SHEAR_MODULUS_PA[0], 0.0, 0.0, 0.5, 4.0, -6.0),
        (SHEAR_MODULUS_PA[1], 1.0, 1.0, 4.0, 12.0, -0.5),
    ),
}
