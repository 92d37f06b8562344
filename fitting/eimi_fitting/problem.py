"""Everything that a fit has to go by, as one number for each candidate.

The metric of the design is the mean over all states of error_k. For normal noise of unknown level the likelihood of N
independent points, with the level at its best value, is proportional to that error to the power -N (Seber and Wild
1989, Nonlinear Regression, section 2.2.1). What is known beside the edges (tensile curves, priors of freed nuisances)
comes in standardised residuals z, whose likelihood is exp(-sum z^2 / 2). Their product is largest where

    objective = mean error * exp(sum z^2 / (2 N))

is smallest: still a length, and the plain metric where there is nothing beside the edges. N counts points that are
independent: neighbours on an edge are not (see `eimi_fitting.uncertainty`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.experiment import DISCARDED_MM, Comparison, Experiment, compare
from eimi_fitting.materials import Law
from eimi_fitting.nuisance import RANGE, Nuisance, settings
from eimi_fitting.observation import Misfit
from eimi_fitting.search_space import SearchSpace
from eimi_fitting.tensile_evidence import TensileEvidence

Array = NDArray[np.float64]

INDEPENDENT_A_STATE = 20.0  # points: a guess for the search alone, which only the polish needs better


@dataclass(frozen=True)
class Judged:
    """P candidates before all the evidence.

    standardised: (P, m) residuals of tensile curves and priors; independent_points: N.
    """

    comparison: Comparison
    standardised: Array
    independent_points: float

    @property
    def unconverged(self) -> NDArray[np.bool_]:
        """(P,)."""
        return self.comparison.unconverged

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """(P,)."""
        return self.comparison.unstable

    @property
    def objective_mm(self) -> Array:
        """(P,): DISCARDED_MM where a candidate is not valid."""
        mean = self.comparison.objective_mm
        x = 0.5 * (self.standardised**2).sum(axis=1) / self.independent_points
        # Far away a straight line continues the exponential, which would overflow.
        far = np.maximum(x - 5, 0.0)
        factor = np.exp(np.minimum(x, 5.0)) * (1 + far)
        return np.where(mean < DISCARDED_MM, np.minimum(mean * factor, 0.99 * DISCARDED_MM), DISCARDED_MM)

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """What least squares sees: the states, and everything else as one more state.

        That state's residuals are z times the standard error of a state's mean, its error that of the mean state. Its
        weight among the others is then the one that it has in the objective.
        """
        if self.standardised.shape[1] == 0:
            return self.comparison.misfits
        p, m = self.standardised.shape
        states = self.comparison.error_mm.shape[1]
        valid = self.comparison.objective_mm[~(self.unconverged | self.unstable)]
        error = float(np.median(valid)) if len(valid) else 1.0
        residuals = error * np.sqrt(states / self.independent_points) * self.standardised
        beside = Misfit(
            residuals.reshape(p, 1, 1, m), np.full((1, 1, m), 1 / m), np.full((p, 1), error), np.zeros((p, 1))
        )
        return (*self.comparison.misfits, beside)


@dataclass(frozen=True)
class Problem:
    """A law, its unknowns and the evidence. Unit coordinates: the search space's first, then the freed nuisances."""

    law: Law
    space: SearchSpace
    experiments: tuple[Experiment, ...]
    freed: tuple[Nuisance, ...] = ()
    curves: tuple[TensileEvidence, ...] = ()

    @property
    def searched(self) -> int:
        """How many coordinates the search moves: nuisances stay at what was stated until the polish."""
        return len(self.space.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Of all unit coordinates."""
        return (*self.space.names, *(nuisance.name for nuisance in self.freed))

    @property
    def has_more_than_edges(self) -> bool:
        """Whether there are priors or tensile curves."""
        return bool(self.freed or self.curves)

    def whole(self, searched: Array) -> Array:
        """(P, searched) or (P, all) coordinates -> (P, all)."""
        searched = np.atleast_2d(searched)
        missing = len(self.names) - searched.shape[1]
        return np.concatenate([searched, np.full((len(searched), missing), 0.5)], axis=1)

    def judge(self, unit: Array, independent_points: float, experiments: Sequence[Experiment] | None = None) -> Judged:
        """Candidates (P, searched) or (P, all) in unit coordinates; ``experiments`` in place of the problem's own."""
        unit = self.whole(unit)
        searched, rest = unit[:, : self.searched], unit[:, self.searched :]
        parameters = self.space.parameters(searched)
        seen = self.experiments if experiments is None else experiments
        comparison = compare(
            self.law,
            parameters,
            seen,
            bulk_modulus_Pa=self.space.bulk_modulus_Pa(searched),
            settings=settings(self.freed, rest, len(seen)) if self.freed else None,
        )
        z = [curve.standardised(self.law, parameters) for curve in self.curves]
        z.append(2 * RANGE * (rest - 0.5))
        return Judged(comparison, np.concatenate(z, axis=1), independent_points)
