"""A tensile curve beside the edges: what it says of a law, in units of its own noise.

Alone, the law fits the curve with a root mean square RMSE, whose residuals hang together over tau rows
(`eimi_fitting.laws.tensile`). In a joint fit each row's residual counts in units of RMSE sqrt(tau): m rows are m / tau
independent ones, and a curve that the law cannot follow counts for little. A stated weight multiplies the sum of
squares; it is 1 unless a person knows better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.law import Law
from eimi_fitting.laws.tensile import CannotFit, engineering_stress, fit_tensile

Array = NDArray[np.float64]

_FLOOR = 1e-4  # of the largest stress: no tensile test is better than this


@dataclass(frozen=True)
class TensileCurve:
    """Engineering strain (m,) and engineering stress (m,) of a tensile test, and its weight in a joint fit.

    Examples
    --------
    A curve that counts half of what its own noise makes it count:

    >>> import numpy as np
    >>> curve = TensileCurve(np.array([0.1, 0.2, 0.3]), np.array([12.6e3, 23.5e3, 32.9e3]), weight=0.5)
    >>> curve.stress_Pa.max().item()
    32900.0
    """

    strain: Array
    stress_Pa: Array
    weight: float = 1.0


@dataclass(frozen=True)
class TensileEvidence:
    """A curve, and how well a law fits it alone: noise_Pa and correlation_rows."""

    curve: TensileCurve
    noise_Pa: float
    correlation_rows: float

    @staticmethod
    def of(curve: TensileCurve, model: str) -> TensileEvidence:
        """Fit the law to the curve alone. Raises CannotFit for too few rows, or stresses that are all zero."""
        largest = float(np.abs(curve.stress_Pa).max(initial=0.0))
        if largest == 0.0:
            raise CannotFit("every stress is zero")
        alone = fit_tensile(LAWS[model], curve.strain, curve.stress_Pa)
        freedom = max(alone.rows - len(alone.parameters), 1)
        noise = max(alone.rmse_Pa * np.sqrt(alone.rows / freedom), _FLOOR * largest)
        return TensileEvidence(curve, float(noise), alone.correlation_rows)

    def residuals_Pa(self, law: Law, parameters: Array) -> Array:
        """(P, m) of P candidates (P, n)."""
        return engineering_stress(law, parameters, self.curve.strain) - self.curve.stress_Pa

    def standardised(self, law: Law, parameters: Array) -> Array:
        """(P, m): residuals whose sum of squares counts in the fit, the weight included."""
        scale = np.sqrt(self.curve.weight / self.correlation_rows) / self.noise_Pa
        return scale * self.residuals_Pa(law, parameters)
