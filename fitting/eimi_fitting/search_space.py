"""The coordinates in which the search moves: each between 0 and 1, moduli by their logarithm.

Every law is described by its initial shear modulus and by ratios: what a bending test fixes well is then one
coordinate, and what it fixes badly is the others. The bounds are this project's own choice; the modulus spans every
published value of the usual casting silicones with room to spare.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHEAR_MODULUS_PA = (1e3, 1e6)


@dataclass(frozen=True)
class SearchSpace:
    """Bounds of the physical search coordinates of one law; the first is always the initial shear modulus (Pa)."""

    law: str
    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

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
        mu0 = x[:, 0]
        if self.law == "neo-hookean":
            return x
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
