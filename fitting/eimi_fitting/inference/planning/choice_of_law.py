"""Which of several laws the same data support: AICc and BIC.

With N independent points and normal noise of unknown level, -2 log L = 2 N log(error) up to what is common to all laws
(Burnham and Anderson 2002, Model Selection and Multimodel Inference, section 2.2 and, for the correction for small
samples, Eq. 2.4; Schwarz 1978, Ann. Statist. 6:461, for BIC). A tensile curve in the fit adds 2 n log(RMSE) for its n
independent rows. What is stated with an uncertainty, and is off, adds the squares of its standardised deviations: a law
is compared where it and the stated sources together explain most, or a wrong width would speak for the law that bends
like it. N and n are those of the law that fits best, for all laws alike: residuals of a law that does not fit
hang together because it does not (ibid., section 2.5, on taking the variance from the global model).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Candidate:
    """What one law left: unknowns fitted; errors, (independent points, error) of the edges and of each curve.

    held_out_error_mm: mean error of states left out of the fit, where that is known; stated_squares: of what priors and
    stated sources are off by for these errors, in standard uncertainties, the sum of squares.
    """

    model: str
    unknowns: int
    errors: tuple[tuple[float, float], ...]
    held_out_error_mm: float | None = None
    stated_squares: float = 0.0


@dataclass(frozen=True)
class Choice:
    """One law among those compared: AICc and BIC above the best one's.

    aicc: None where the data are too few for the law; weight: the Akaike weight among the laws that have an AICc
    (Burnham and Anderson 2002, Eq. 2.9), None where there are not two such laws.
    """

    model: str
    unknowns: int
    independent_points: float
    aicc: float | None
    bic: float
    weight: float | None
    held_out_error_mm: float | None


def choose(candidates: Sequence[Candidate]) -> tuple[Choice, ...]:
    """AICc and BIC above the smallest of all, in the order given."""
    if not candidates:
        return ()
    best = min(candidates, key=lambda c: c.errors[0][1])
    counts = np.array([count for count, _ in best.errors])
    total = float(counts.sum())
    aicc, bic = [], []
    for candidate in candidates:
        errors = np.maximum([error for _, error in candidate.errors], 1e-12)
        deviance = float(2 * counts @ np.log(errors)) + candidate.stated_squares
        k = candidate.unknowns + len(counts)  # each noise level is an unknown too
        room = total - k - 1
        aicc.append(deviance + 2 * k + 2 * k * (k + 1) / room if room > 0 else np.inf)
        bic.append(deviance + k * np.log(total))
    above = np.array(aicc) - min(aicc) if np.isfinite(min(aicc)) else np.array(aicc)
    support = np.exp(-0.5 * above)
    weighed = np.isfinite(above) & (np.isfinite(above).sum() > 1)
    weights = support / max(support.sum(), np.finfo(float).tiny)
    return tuple(
        Choice(
            model=c.model,
            unknowns=c.unknowns,
            independent_points=total,
            aicc=float(a) if np.isfinite(a) else None,
            bic=float(b - min(bic)),
            weight=float(w) if has_weight else None,
            held_out_error_mm=c.held_out_error_mm,
        )
        for c, a, b, w, has_weight in zip(candidates, above, bic, weights, weighed, strict=True)
    )
