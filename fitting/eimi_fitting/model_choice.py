"""Which of several laws the same data support: AICc and BIC.

With N independent points and normal noise of unknown level, -2 log L = 2 N log(error) up to what is common to all laws
(Burnham and Anderson 2002, Model Selection and Multimodel Inference, section 2.2 and, for the correction for small
samples, Eq. 2.4; Schwarz 1978, Ann. Statist. 6:461, for BIC). A tensile curve in the fit adds 2 n log(RMSE) for its n
independent rows. N and n are those of the law that fits best, for all laws alike: residuals of a law that does not fit
hang together because it does not (ibid., section 2.5, on taking the variance from the global model).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Candidate:
    """What one law left: unknowns fitted; errors, (independent points, error) of the edges and of each curve."""

    model: str
    unknowns: int
    errors: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Choice:
    """One law among those compared; weight: the Akaike weight (Burnham and Anderson 2002, Eq. 2.9)."""

    model: str
    unknowns: int
    independent_points: float
    aicc: float
    bic: float
    weight: float


def choose(candidates: Sequence[Candidate]) -> tuple[Choice, ...]:
    """AICc and BIC above the smallest of all, in the order given; AICc is infinite where the data are too few."""
    if not candidates:
        return ()
    best = min(candidates, key=lambda c: c.errors[0][1])
    counts = np.array([count for count, _ in best.errors])
    total = float(counts.sum())
    aicc, bic = [], []
    for candidate in candidates:
        errors = np.maximum([error for _, error in candidate.errors], 1e-12)
        deviance = float(2 * counts @ np.log(errors))
        k = candidate.unknowns + len(counts)  # each noise level is an unknown too
        room = total - k - 1
        aicc.append(deviance + 2 * k + 2 * k * (k + 1) / room if room > 0 else np.inf)
        bic.append(deviance + k * np.log(total))
    above = np.array(aicc) - min(aicc) if np.isfinite(min(aicc)) else np.array(aicc)
    support = np.exp(-0.5 * above)
    weights = support / support.sum() if support.sum() > 0 else support
    return tuple(
        Choice(c.model, c.unknowns, total, float(a), float(b - min(bic)), float(w))
        for c, a, b, w in zip(candidates, above, bic, weights, strict=True)
    )
