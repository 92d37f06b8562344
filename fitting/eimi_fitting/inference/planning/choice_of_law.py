"""Compare several hyperelastic laws that were fitted to the same data, by the information criteria AICc and BIC.

A fit has N independent points on the edges of the beam. Let E be the root mean square of its residuals. For normal
noise of unknown level, the deviance is

    -2 log L = 2 N log(E) + constant.

The constant is the same for all laws (Burnham and Anderson 2002, Model Selection and Multimodel Inference, section
2.2). Each tensile curve in the fit adds 2 n log(RMSE), for n independent rows and the root mean square residual RMSE of
the curve. Each input with a stated uncertainty, such as the width, and each parameter with a prior adds the square of
its deviation in standard uncertainties. A law is therefore compared at the optimum at which its parameters and these
inputs were fitted together. If the inputs were fixed, a wrong width would favour a law that imitates the effect of this
width.

Let k be the number of unknowns, with one noise level for the edges and one for each curve. Let M be the sum of N and
all n. The criteria are

    AICc = -2 log L + 2 k + 2 k (k + 1) / (M - k - 1),    BIC = -2 log L + k log(M)

(ibid., Eq. 2.4; Schwarz 1978, Ann. Statist. 6:461).

All laws are compared with the same N and n: those that were estimated in the fit with the smallest error of the edges.
In a fit with a wrong law, the residuals of neighbouring points are correlated because the law is wrong. An N from this
fit would be too small (ibid., section 2.5). A law has no AICc if M - k - 1 is below 1, because M is not known so
exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_LEAST_ROOM = 1.0  # independent points beyond the number of unknowns and one, as N = k + 2 for whole numbers


@dataclass(frozen=True)
class Candidate:
    """A fitted hyperelastic law that is compared with other laws.

    Attributes
    ----------
    model : str
        Name of the law.
    unknowns : int
        Number of fitted unknowns.
    errors : tuple of tuple
        Pairs of a number of independent points and a root mean square residual: first for the edges (in mm), then for
        each tensile curve (in Pa).
    held_out_error_mm : float or None
        Mean error in mm of states that were omitted from the fit; None if no state was omitted.
    stated_squares : float
        Sum of the squared deviations of parameters from their priors and of uncertain inputs from their stated values,
        in standard uncertainties.
    """

    model: str
    unknowns: int
    errors: tuple[tuple[float, float], ...]
    held_out_error_mm: float | None = None
    stated_squares: float = 0.0


@dataclass(frozen=True)
class Choice:
    """The result for one hyperelastic law in a comparison of laws.

    Attributes
    ----------
    model : str
        Name of the law.
    unknowns : int
        Number of fitted unknowns.
    independent_points : float
        Number of independent points of the edges and all tensile curves.
    aicc : float or None
        AICc minus the smallest AICc of all laws; None if the data are too few for the number of unknowns.
    bic : float
        BIC minus the smallest BIC of all laws.
    weight : float or None
        Akaike weight among the laws that have an AICc (Burnham and Anderson 2002, Eq. 2.9). None if the law has no AICc
        or if fewer than two laws have an AICc.
    held_out_error_mm : float or None
        Mean error in mm of states that were omitted from the fit; None if no state was omitted.
    """

    model: str
    unknowns: int
    independent_points: float
    aicc: float | None
    bic: float
    weight: float | None
    held_out_error_mm: float | None


def choose(candidates: Sequence[Candidate]) -> tuple[Choice, ...]:
    """Return AICc, BIC and Akaike weight of each fitted law, in the order of ``candidates``."""
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
