"""Tensile curves (stress against strain) as data in a fit to measured edges."""

# A fit of the law to the curve alone gives the standard deviation s of the noise. tau neighbouring points count as one
# independent point. Point i with the residual r_i in Pa has the standardised residual
#
#     z_i = sqrt(w / tau) r_i / s
#
# with the weight w of the curve.

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.law import Law
from eimi_fitting.laws.tensile import engineering_stress, fit_tensile

Array = NDArray[np.float64]

_FLOOR = 1e-4  # smallest noise over the largest stress: no tensile test is assumed to be better


@dataclass(frozen=True)
class TensileCurve:
    """The curve of a tensile test.

    Parameters
    ----------
    strain : ndarray, shape (m,)
        Engineering strain, as a ratio.
    stress_Pa : ndarray, shape (m,)
        Engineering stress in Pa.
    weight : float
        Factor on the squared residuals of the curve in a fit; 0.5 halves the weight that follows from its noise.

    Examples
    --------
    A curve with half of the weight that follows from its noise:

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
    """A tensile curve (stress against strain) with the noise of the measured stress."""

    curve: TensileCurve
    # Standard deviation of the noise.
    noise_Pa: float
    # Number of neighbouring points that count as one independent point.
    correlation_rows: float

    @staticmethod
    def of(curve: TensileCurve, model: str) -> TensileEvidence:
        """Estimate the noise of a tensile curve from the fit of a law to this curve."""
        # `model` is the name of the law. Raises CannotFit if the curve has too few points, or if all stresses are zero.
        largest = float(np.abs(curve.stress_Pa).max(initial=0.0))
        alone = fit_tensile(LAWS[model], curve.strain, curve.stress_Pa)
        # The noise is sqrt(Q / (m - n)) for the sum Q of the squared residuals, m points and n parameters. A curve that
        # the law cannot describe has a large noise and therefore little effect.
        freedom = max(alone.rows - len(alone.parameters), 1)
        noise = max(alone.rmse_Pa * np.sqrt(alone.rows / freedom), _FLOOR * largest)
        return TensileEvidence(curve, float(noise), alone.correlation_rows)

    def residuals_Pa(self, law: Law, parameters: Array) -> Array:
        """Return computed minus measured stress in Pa."""
        return engineering_stress(law, parameters, self.curve.strain) - self.curve.stress_Pa

    def standardised(self, law: Law, parameters: Array) -> Array:
        """Return the residuals of the stress in standard deviations."""
        scale = np.sqrt(self.curve.weight / self.correlation_rows) / self.noise_Pa
        return scale * self.residuals_Pa(law, parameters)
