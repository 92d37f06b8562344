"""Compare hyperelastic laws that were fitted to the same data, by the information criteria AICc and BIC."""

# A fit has N independent points on the edges with the root mean square residual E, and n_i independent rows of each
# tensile curve with the residual E_i. Let M = N + sum n_i, S the sum of squared deviations from priors and stated
# values in standard uncertainties, and k the number of unknowns and noise levels. Then
#
#     -2 log L = 2 N log(E) + 2 sum n_i log(E_i) + S + constant
#     AICc = -2 log L + 2 k + 2 k (k + 1) / (M - k - 1),    BIC = -2 log L + k log(M)
#
# (Burnham and Anderson 2002, Model Selection and Multimodel Inference; Schwarz 1978, Ann. Statist. 6:461).

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# Smallest value of M - k - 1 for which AICc is computed. M = k + 2 is the smallest whole number for which AICc is
# finite.
_LEAST_ROOM = 1.0


@dataclass(frozen=True)
class Candidate:
    """A fitted hyperelastic law in a comparison of laws."""

    # Name of the law, and number of its unknowns.
    model: str
    unknowns: int
    # Number of independent points and root mean square residual: of the edges (mm), and of each tensile curve (Pa).
    errors: tuple[tuple[float, float], ...]
    # Mean error of load cases that were omitted from the fit.
    held_out_error_mm: float | None = None
    # The inputs are fitted with the law. If they were fixed, a wrong width would favour a law that imitates its effect.
    # Sum of the squared deviations from priors and stated values, in standard uncertainties.
    stated_squares: float = 0.0


@dataclass(frozen=True)
class Choice:
    """The result for one hyperelastic law in a comparison of laws."""

    # Name of the law, and number of its unknowns.
    model: str
    unknowns: int
    # Of the edges and tensile curves.
    independent_points: float
    # AICc minus the smallest AICc; None with too few data.
    aicc: float | None
    # BIC minus the smallest BIC.
    bic: float
    # Akaike weight (Burnham and Anderson 2002, Eq. 2.9).
    weight: float | None
    # Mean error of load cases that were omitted from the fit.
    held_out_error_mm: float | None


def choose(candidates: Sequence[Candidate]) -> tuple[Choice, ...]:
    """Return AICc, BIC and Akaike weight of each fitted law."""
    if not candidates:
        return ()
    # All laws have the counts of the best fit. A wrong law correlates the residuals of neighbouring points, so that its
    # own counts would be too small (Burnham and Anderson 2002, section 2.5).
    best = min(candidates, key=lambda c: c.errors[0][1])
    counts = np.array([count for count, _ in best.errors])
    total = float(counts.sum())
    aicc, bic = [], []
    for candidate in candidates:
        errors = np.maximum([error for _, error in candidate.errors], 1e-12)
        deviance = float(2 * counts @ np.log(errors)) + candidate.stated_squares
        k = candidate.unknowns + len(counts)  # each noise level is an unknown too
        room = total - k - 1
        aicc.append(deviance + 2 * k + 2 * k * (k + 1) / room if room >= _LEAST_ROOM else np.inf)
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
