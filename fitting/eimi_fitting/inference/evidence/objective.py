"""Everything that a fit has to go by, as one number for each candidate.

The metric of the design is the mean over all states of error_k. For normal noise of unknown level the likelihood of N
independent points, with the level at its best value, is proportional to that error to the power -N (Seber and Wild
1989, Nonlinear Regression, section 2.2.1). What is known beside the edges (tensile curves, priors on the law's
parameters and on freed nuisances) comes in standardised residuals z, whose likelihood is exp(-sum z^2 / 2). Their
product is largest where

    objective = mean error * exp(sum z^2 / (2 N))

is smallest: still a length, and the plain metric where there is nothing beside the edges. N counts points that are
independent: neighbours on an edge are not (see `eimi_fitting.inference.interval.covariance`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.path import Shapes
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM, Comparison, Experiment, compare, joined
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.tensile_curves import TensileEvidence
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

_MOST_MM = 0.99 * DISCARDED_MM  # of a candidate that is valid


@dataclass(frozen=True)
class Evaluation:
    """P candidates before all the evidence.

    curves: (P, m), priors: (P, f) and known: (P, q) standardised residuals of tensile curves, of freed nuisances and of
    the priors on the law's parameters; independent_points: N.
    """

    comparison: Comparison
    curves: Array
    priors: Array
    known: Array
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
    def standardised(self) -> Array:
        """(P, m + f + q): all that is known beside the edges."""
        return np.concatenate([self.curves, self.priors, self.known], axis=1)

    @property
    def objective_mm(self) -> Array:
        """(P,): DISCARDED_MM where a candidate is not valid."""
        mean = self.comparison.objective_mm
        x = 0.5 * (self.standardised**2).sum(axis=1) / self.independent_points
        # Far away a straight line continues the exponential, which would overflow.
        far = np.maximum(x - 5, 0.0)
        factor = np.exp(np.minimum(x, 5.0)) * (1 + far)
        return np.where(mean < DISCARDED_MM, np.minimum(mean * factor, _MOST_MM), DISCARDED_MM)

    @property
    def without_known(self) -> Evaluation:
        """The same without the priors on the law's parameters."""
        return replace(self, known=self.known[:, :0])

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """(P,): so far from what is known beside the edges that a search could not tell such candidates apart."""
        return self.objective_mm == _MOST_MM

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """What least squares sees: the states, and everything else as one more state.

        That state's residuals are z times the standard error of a state's mean, its error that of the mean state. Its
        weight among the others is then the one that it has in the objective.
        """
        standardised = self.standardised
        p, m = standardised.shape
        if m == 0:
            return self.comparison.misfits
        states = self.comparison.error_mm.shape[1]
        valid = self.comparison.objective_mm[~(self.unconverged | self.unstable)]
        error = float(np.median(valid)) if len(valid) else 1.0
        residuals = error * np.sqrt(states / self.independent_points) * standardised
        beside = Misfit(
            residuals.reshape(p, 1, 1, m), np.full((1, 1, m), 1 / m), np.full((p, 1), error), np.zeros((p, 1))
        )
        return (*self.comparison.misfits, beside)


@dataclass(frozen=True)
class Problem:
    """A law, what is unknown, and the evidence; priors: on the law's own parameters."""

    law: Law
    unknowns: Unknowns
    experiments: tuple[Experiment, ...]
    curves: tuple[TensileEvidence, ...] = ()
    priors: tuple[Prior, ...] = ()

    @property
    def has_more_than_edges(self) -> bool:
        """Whether there are priors or tensile curves."""
        return bool(self.unknowns.freed or self.curves or self.priors)

    def with_own_changes(self, evaluation: Evaluation, before: Problem) -> Evaluation:
        """What was evaluated of a problem whose experiments differ from these in their changes alone, as this one's."""
        comparison = evaluation.comparison
        misfits = tuple(
            own.with_own_change(misfit, other)
            for own, misfit, other in zip(self.experiments, comparison.misfits, before.experiments, strict=True)
        )
        return replace(evaluation, comparison=replace(comparison, misfits=misfits))

    def nearby(self, independent_points: float) -> Callable[[Array, Evaluation | None], Evaluation]:
        """Evaluates candidates that are near those evaluated before, as a polish does."""
        return lambda units, near: self.evaluate(
            units, independent_points, near=near.comparison.shapes if near else (), keep=True
        )

    def evaluate(
        self,
        unit: Array,
        independent_points: float,
        experiments: Sequence[Experiment] | None = None,
        near: Sequence[Shapes] = (),
        keep: bool = False,
    ) -> Evaluation:
        """Candidates (P, searched) or (P, n) in unit coordinates; ``experiments`` in place of the problem's own.

        near: of an earlier evaluation on the same meshes, made to ``keep`` where its first candidate stands, which is
        near these.
        """
        unit = self.unknowns.whole(unit)
        parameters = self.unknowns.parameters(unit)
        used = self.experiments if experiments is None else experiments
        bulk = self.unknowns.bulk_modulus_Pa(unit)
        comparison = joined(
            [
                (
                    rows,
                    compare(
                        self.law,
                        parameters[rows],
                        [e.under(d) for e, d in zip(used, deviations, strict=True)],
                        bulk_modulus_Pa=None if bulk is None else bulk[rows],
                        setups=self.unknowns.setups(unit[rows], len(used)),
                        near=near,
                        keep=keep,
                    ),
                )
                for rows, deviations in self.unknowns.bent(unit, len(used))
            ]
        )
        none = np.zeros((len(unit), 0))
        curves = [none, *(curve.standardised(self.law, parameters) for curve in self.curves)]
        known = [none, *(prior.standardised(self.law, parameters)[:, None] for prior in self.priors)]
        return Evaluation(
            comparison,
            np.concatenate(curves, axis=1),
            self.unknowns.standardised(unit),
            np.concatenate(known, axis=1),
            independent_points,
        )
