"""A tensile curve as rows: its engineering stress is linear in the coefficients of the terms."""

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

_FLOOR = 1e-4  # of the largest stress: no tensile test is better than this


def stress_columns(terms: Sequence[Term], strain: Array) -> Array:
    """(m, J): engineering stress for a coefficient of one of each term."""
    return engineering_stress(SumOfTerms(tuple(terms)), np.eye(len(terms)), strain).T


def largest_x(strain: Array) -> float:
    """I1 - 3 at the largest strain of an incompressible uniaxial test."""
    stretch = 1 + float(np.max(strain))
    return stretch**2 + 2 / stretch - 3


def tensile_rows(curve: TensileCurve, terms: Sequence[Term]) -> tuple[Rows, float]:
    """The rows, and the noise in Pa that they are divided by. Raises CannotFit for fewer rows than terms."""
    count = len(curve.strain)
    if count <= len(terms):
        raise CannotFit(f"{count} rows; a library of {len(terms)} terms needs at least {len(terms) + 1}")
    columns = stress_columns(terms, curve.strain)
    coefficients = non_negative(columns, curve.stress_Pa)
    left = columns @ coefficients - curve.stress_Pa
    freedom = max(count - int((coefficients > 0).sum()), 1)
    noise_Pa = max(float(np.sqrt(left @ left / freedom)), _FLOOR * float(np.abs(curve.stress_Pa).max()))
    if noise_Pa == 0.0:
        raise CannotFit("every stress is zero")
    tau = correlation_length(left[None], np.ones((1, count)))
    scale = np.sqrt(curve.weight / tau) / noise_Pa
    block = 1 if tau < 2 else int(np.ceil(2 * tau))  # neighbours that are alike are left out at once
    together = np.arange(count) // block
    return Rows(scale * curve.stress_Pa, scale * columns, np.zeros((count, 0)), together), noise_Pa
