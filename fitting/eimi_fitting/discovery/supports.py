"""All small sets of terms by the error of what was left out of their fit, and which of them the data tell apart.

Every set of at most so many terms is fitted; one that asks for a negative coefficient is no law of its own. Each row is
predicted from the others (Hastie, Tibshirani, Friedman 2009, The Elements of Statistical Learning, section 7.10), those
that hang together at once, in up to twenty folds. Of two sets whose predictions differ by delta, the sums of squared
errors differ by sum delta^2 on average and by 2 |delta| of standard error, if one is right and the noise has unit
variance: a set stays in play while its sum is within one and a half standard errors of the smallest (after the
one-standard-error rule of the same section, for paired errors). A term that is added has to gain nine then, three
standard deviations: one of seven seldom does by chance.

The answer are the sets in play that hold no other one: terms that can be spared are. Where that is a single set, every
set in play holds it. What a further term could carry is then asked of each.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.discovery.rows import Rows

Array = NDArray[np.float64]

_FOLDS = 20
_STANDARD_ERRORS = 1.5


@dataclass(frozen=True)
class Support:
    """A set of terms: their indices, coefficients (k,) and standard errors (k,), given that the terms are these.

    sizes: (q,) of the nuisances; left_out: (N,) errors of the predictions; excess: of their sum of squares over the
    smallest one, and what its standard error is.
    """

    terms: tuple[int, ...]
    coefficients: Array
    standard_errors: Array
    sizes: Array
    left_out: Array
    excess: float = 0.0
    excess_error: float = 0.0

    @property
    def held_out_error(self) -> float:
        """Root mean square of the predictions' errors: one is noise alone."""
        return float(np.sqrt(np.mean(self.left_out**2)))

    @property
    def in_play(self) -> bool:
        """Whether noise may be why it is worse than the best."""
        return self.excess <= _STANDARD_ERRORS * self.excess_error


def supports(rows: Rows, has_modulus: NDArray[np.bool_], most_terms: int) -> tuple[Support, ...]:
    """Every set with positive coefficients and stiffness at rest, the smallest error of what was left out first."""
    found = [
        support
        for terms in _sets(len(has_modulus), most_terms)
        if has_modulus[list(terms)].any() and (support := _fitted(rows, terms)) and (support.coefficients > 0).all()
    ]
    if not found:
        return ()
    best = min(found, key=lambda own: float(own.left_out @ own.left_out))
    return tuple(sorted((_beside(own, best) for own in found), key=lambda own: own.excess))


def minimal(found: tuple[Support, ...]) -> tuple[Support, ...]:
    """Those in play that hold no other one in play; fewest terms first, then the best."""
    playing = [own for own in found if own.in_play]
    least = [own for own in playing if not any(set(other.terms) < set(own.terms) for other in playing)]
    return tuple(sorted(least, key=lambda own: (len(own.terms), own.excess)))


def could_be_added(rows: Rows, terms: tuple[int, ...]) -> Array:
    """(J,): the upper end of the 95 % interval of the coefficient that each further term could have; 0 of ``terms``."""
    most = np.zeros(rows.columns.shape[1])
    for further in set(range(len(most))) - set(terms):
        added = _fitted(rows, (*terms, further))
        most[further] = max(added.coefficients[-1], 0.0) + 1.96 * added.standard_errors[-1] if added else np.inf
    return most


def _sets(count: int, most: int) -> Iterator[tuple[int, ...]]:
    for size in range(1, most + 1):
        yield from combinations(range(count), size)


def _fitted(rows: Rows, terms: tuple[int, ...]) -> Support | None:
    """None where the terms are one and the same here."""
    k, q = len(terms), rows.nuisances.shape[1]
    columns = np.column_stack([rows.columns[:, terms], rows.nuisances])
    known = np.column_stack([np.zeros((q, k)), np.eye(q)])  # what is known of the nuisances
    every = np.vstack([columns, known])
    size = np.linalg.norm(every, axis=0)
    directions, triangle = np.linalg.qr(every / np.where(size > 0, size, 1.0))
    if np.abs(np.diag(triangle)).min() < 1e-10:
        return None
    inverse = np.linalg.inv(triangle)
    best = inverse @ (directions[: len(columns)].T @ rows.seen) / size
    left = columns @ best - rows.seen
    left_out = np.empty(len(left))
    fold = rows.together % _FOLDS
    for one in np.unique(fold):
        own = fold == one
        shared = directions[: len(columns)][own]
        # Of least squares: the error of rows that were left out, from those of a fit that had them.
        left_out[own] = np.linalg.solve(np.eye(own.sum()) - shared @ shared.T + 1e-12 * np.eye(own.sum()), left[own])
    errors = np.sqrt(np.sum(inverse**2, axis=1)) / size
    return Support(terms, best[:k], errors[:k], best[k:], left_out)


def _beside(own: Support, best: Support) -> Support:
    excess = float(own.left_out @ own.left_out - best.left_out @ best.left_out)
    apart = 2 * float(np.linalg.norm(own.left_out - best.left_out))
    return Support(own.terms, own.coefficients, own.standard_errors, own.sizes, own.left_out, excess, apart)
