"""Turn a tensile curve into linear equations for the coefficients of the terms of a hyperelastic law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.correlation import correlation_length
from eimi_fitting.discovery.rows import Rows, non_negative
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term
from eimi_fitting.laws.tensile import CannotFit, engineering_stress

Array = NDArray[np.float64]

_FLOOR = 1e-4  # smallest noise, as a share of the largest stress (assumed: no tensile test is better than this)


def stress_columns(terms: Sequence[Term], strain: Array) -> Array:
    """Return the engineering stress (Pa) of each term with the coefficient 1 Pa, at several strains."""
    # (m, J) for m strains and J terms.
    return engineering_stress(SumOfTerms(tuple(terms)), np.eye(len(terms)), strain).T


def largest_x(strain: Array) -> float:
    """Return the largest value of I1 - 3 of an incompressible material in a uniaxial test."""
    # I1 is the first invariant.
    stretch = 1 + strain
    return float(np.max(stretch**2 + 2 / stretch - 3))


def tensile_rows(curve: TensileCurve, terms: Sequence[Term]) -> tuple[Rows, float]:
    """Turn a tensile curve into linear equations for the coefficients of the terms of a law.

    Returns
    -------
    Rows
        One equation for each row of the curve.
    float
        Standard deviation of the noise, Pa.

    Raises
    ------
    CannotFit
        If the curve has too few rows, if every stress is zero, or if no term has stresses of this sign.
    """
    count = len(curve.strain)
    if count <= len(terms):
        raise CannotFit(
            f"the curve has {count} rows; a library of {len(terms)} terms needs at least {len(terms) + 1} rows"
        )
    columns = stress_columns(terms, curve.strain)
    coefficients = non_negative(columns, curve.stress_Pa)
    residuals_Pa = columns @ coefficients - curve.stress_Pa
    freedom = max(count - int((coefficients > 0).sum()), 1)
    floor_Pa = _FLOOR * float(np.abs(curve.stress_Pa).max())
    noise_Pa = max(float(np.sqrt(residuals_Pa @ residuals_Pa / freedom)), floor_Pa)
    if noise_Pa == 0.0:
        raise CannotFit("every stress is zero, but a fit needs stresses that are not zero")
    if not coefficients.any():
        raise CannotFit("no term has stresses of this sign: check the signs of strain and stress")
    tau = correlation_length(residuals_Pa[None], np.ones((1, count)))
    scale = np.sqrt(curve.weight / tau) / noise_Pa
    block = 1 if tau < 2 else int(np.ceil(2 * tau))
    groups = np.arange(count) // block
    return Rows(scale * curve.stress_Pa, scale * columns, np.zeros((count, 0)), groups), noise_Pa
