"""Fit every small set of terms of a law, and find the sets that the data cannot distinguish from the best set."""

# 1. Every set of up to ``most_terms`` terms is fitted. A set is dropped if one of its coefficients is not positive.
# 2. Each set gets a sum S of squared prediction errors by cross-validation: every equation is predicted by a fit
#    without its group (the equations with correlated errors), in at most 20 folds (Hastie, Tibshirani, Friedman 2009,
#    The Elements of Statistical Learning, section 7.10). The best set has the smallest sum, S_best.
# 3. A set is compatible with the data if noise can explain that S is larger than S_best. Noise of unit variance changes
#    S - S_best with the standard error 2 |delta|, where the vector delta is the difference between the predictions of
#    the two sets. A set is compatible if
#
#        S - S_best <= 1.5 * 2 |delta|.
#
#    This rule resembles the one-standard-error rule of the same section, with 1.5 in place of 1. It rarely rejects the
#    true set, which has the terms of the material's law. If the best set contains the true set, its superfluous terms
#    fit noise, which reduces S by at most |delta|^2. The true set is then rejected only if |delta| exceeds three
#    standard deviations of the noise.
# 4. The result is the compatible sets that contain no smaller compatible set. If there is only one such set, every
#    compatible set contains it. An upper limit is then computed for the coefficient of each further term.

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.discovery.rows import Rows

Array = NDArray[np.float64]

_FOLDS = 20
_STANDARD_ERRORS = 1.5


@dataclass(frozen=True)
class Support:
    """A set of terms of a hyperelastic law, fitted by least squares."""

    # k terms, fitted to N equations.

    # Indices of the terms in the library.
    terms: tuple[int, ...]
    # `coefficients`, `standard_errors` (k,): coefficients and their standard errors, Pa, if the law has exactly these
    # terms.
    coefficients: Array
    standard_errors: Array
    # (q,): errors of q inputs, such as a width, in standard uncertainties.
    amplitudes: Array
    # (N,): error of each equation in the cross-validation, in units of the noise.
    prediction_errors: Array
    # Sum of the squared prediction errors, minus the smallest such sum of all sets.
    excess: float = 0.0
    # Standard error of ``excess``.
    excess_error: float = 0.0

    @property
    def held_out_error(self) -> float:
        """Root mean square prediction error of the cross-validation, in units of the noise."""
        return float(np.sqrt(np.mean(self.prediction_errors**2)))

    @property
    def is_compatible(self) -> bool:
        """Whether noise can explain that this set of terms predicts worse than the best set."""
        return self.excess <= _STANDARD_ERRORS * self.excess_error


def supports(rows: Rows, has_modulus: NDArray[np.bool_], most_terms: int) -> tuple[Support, ...]:
    """Fit every set of up to ``most_terms`` terms of a law, and return the sets whose coefficients are all positive."""
    # ``rows``: equations for the coefficients of all terms.
    # ``has_modulus``: whether each term contributes to the initial shear modulus.
    # ``most_terms``: largest number of terms in a set.
    # The result: sets with a positive initial shear modulus; the set with the smallest prediction error comes first.
    fitted = [
        support
        for terms in _sets(len(has_modulus), most_terms)
        if has_modulus[list(terms)].any() and (support := _fitted(rows, terms)) and (support.coefficients > 0).all()
    ]
    if not fitted:
        return ()
    best = min(fitted, key=lambda support: float(support.prediction_errors @ support.prediction_errors))
    return tuple(sorted((_compared(support, best) for support in fitted), key=lambda support: support.excess))


def minimal(candidates: tuple[Support, ...]) -> tuple[Support, ...]:
    """Return the sets of terms that agree with the data and do not contain a smaller set that agrees."""
    compatible = [support for support in candidates if support.is_compatible]
    smallest = [
        support for support in compatible if not any(set(other.terms) < set(support.terms) for other in compatible)
    ]
    return tuple(sorted(smallest, key=lambda support: (len(support.terms), support.excess)))


def upper_coefficients(rows: Rows, terms: tuple[int, ...]) -> Array:
    """Return the upper end of the 95 % interval of each term's coefficient if the term is added to a set."""
    # (J,) in Pa; 0 for terms of the set, infinity for terms whose effect the set can imitate.
    upper = np.zeros(rows.columns.shape[1])
    for further in set(range(len(upper))) - set(terms):
        added = _fitted(rows, (*terms, further))
        upper[further] = max(added.coefficients[-1], 0.0) + 1.96 * added.standard_errors[-1] if added else np.inf
    return upper


def _sets(count: int, most: int) -> Iterator[tuple[int, ...]]:
    for size in range(1, most + 1):
        yield from combinations(range(count), size)


def _fitted(rows: Rows, terms: tuple[int, ...]) -> Support | None:
    """Fit a set of terms by least squares; return None if their effects are linearly dependent."""
    k, q = len(terms), rows.nuisances.shape[1]
    columns = np.column_stack([rows.columns[:, terms], rows.nuisances])
    prior = np.column_stack([np.zeros((q, k)), np.eye(q)])
    columns_and_prior = np.vstack([columns, prior])
    size = np.linalg.norm(columns_and_prior, axis=0)
    directions, triangle = np.linalg.qr(columns_and_prior / np.where(size > 0, size, 1.0))
    if np.abs(np.diag(triangle)).min() < 1e-10:
        return None
    inverse = np.linalg.inv(triangle)
    solution = inverse @ (directions[: len(columns)].T @ rows.observed) / size
    residuals = columns @ solution - rows.observed
    prediction_errors = np.empty(len(residuals))
    folds = rows.groups % _FOLDS
    for fold in np.unique(folds):
        inside = folds == fold
        # With H = Q Q' for the rows of the fold, the prediction error of a fit without these rows is inv(I - H) r.
        fold_directions = directions[: len(columns)][inside]
        identity = np.eye(inside.sum())
        prediction_errors[inside] = np.linalg.solve(
            identity - fold_directions @ fold_directions.T + 1e-12 * identity, residuals[inside]
        )
    errors = np.sqrt(np.sum(inverse**2, axis=1)) / size
    return Support(terms, solution[:k], errors[:k], solution[k:], prediction_errors)


def _compared(support: Support, best: Support) -> Support:
    """Compare the prediction errors of a set of terms with those of the best set."""
    errors, best_errors = support.prediction_errors, best.prediction_errors
    excess = float(errors @ errors - best_errors @ best_errors)
    return replace(support, excess=excess, excess_error=2 * float(np.linalg.norm(errors - best_errors)))
