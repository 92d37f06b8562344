"""Compute the objective of a fit: the quantity in mm that the fit minimises."""

#     objective = e * exp(sum_j z_j^2 / (2 N))
#
# e is the mean error of the load cases in mm (`inference.evidence.measurements`), and N the number of independent
# points of the edges. The z_j are residuals of tensile curves, uncertain inputs and priors, in standard deviations.

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

_MOST_MM = 0.99 * DISCARDED_MM  # largest objective of a valid candidate


@dataclass(frozen=True)
class Evaluation:
    """The residuals of all data and priors of a fit, for several candidate sets of parameters."""

    # There are P candidates.

    comparison: Comparison
    # (P, m): residuals of m points of the tensile curves, in standard deviations.
    curves: Array
    # (P, f): deviations of f fitted inputs, such as the width, in standard deviations of their priors.
    priors: Array
    # (P, q): residuals of q priors on the parameters of the law, in standard deviations.
    law_priors: Array
    # Number of independent points of the edges.
    independent_points: float

    @property
    def unconverged(self) -> NDArray[np.bool_]:
        """For each candidate, whether a load case has no equilibrium."""
        return self.comparison.unconverged

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """For each candidate, whether the material is unstable in a load case."""
        return self.comparison.unstable

    @property
    def standardised(self) -> Array:
        """The residuals of tensile curves and priors, in standard deviations."""
        return np.concatenate([self.curves, self.priors, self.law_priors], axis=1)

    @property
    def objective_mm(self) -> Array:
        """The quantity in mm that a fit minimises, for each candidate."""
        # The likelihood of N independent points with normal noise, maximised over the noise level, is proportional to
        # e^-N (Seber and Wild 1989, Nonlinear Regression, section 2.2.1). The likelihood of tensile curves and priors
        # is exp(-sum_j z_j^2 / 2). The objective is the product of the two likelihoods to the power -1/N.
        mean = self.comparison.objective_mm
        x = 0.5 * (self.standardised**2).sum(axis=1) / self.independent_points
        # Beyond x = 5 a straight line continues the exponential, which would overflow.
        far = np.maximum(x - 5, 0.0)
        factor = np.exp(np.minimum(x, 5.0)) * (1 + far)
        return np.where(mean < DISCARDED_MM, np.minimum(mean * factor, _MOST_MM), DISCARDED_MM)

    @property
    def without_law_priors(self) -> Evaluation:
        """The evaluation without the residuals of the priors on the parameters of the law."""
        return replace(self, law_priors=self.law_priors[:, :0])

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """For each candidate, whether tensile curves and priors contradict it very strongly."""
        # The objective of such a set has its largest value.
        return self.objective_mm == _MOST_MM

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """The residuals of each experiment in mm, then those of tensile curves and priors, for least squares."""
        standardised = self.standardised
        p, m = standardised.shape
        if m == 0:
            return self.comparison.misfits
        states = self.comparison.error_mm.shape[1]
        valid = self.comparison.objective_mm[~(self.unconverged | self.unstable)]
        error = float(np.median(valid)) if len(valid) else 1.0
        # in mm, with about the same weight in least squares as in the objective near the optimum
        residuals = error * np.sqrt(states / self.independent_points) * standardised
        additional = Misfit(
            residuals.reshape(p, 1, 1, m), np.full((1, 1, m), 1 / m), np.full((p, 1), error), np.zeros((p, 1))
        )
        return (*self.comparison.misfits, additional)


@dataclass(frozen=True)
class Problem:
    """Everything that defines a fit: a hyperelastic law, the unknowns, the data and the priors."""

    law: Law
    unknowns: Unknowns
    experiments: tuple[Experiment, ...]
    curves: tuple[TensileEvidence, ...] = ()
    priors: tuple[Prior, ...] = ()

    @property
    def has_more_than_edges(self) -> bool:
        """Whether the fit uses tensile curves, priors or uncertain inputs."""
        return bool(self.unknowns.freed or self.curves or self.priors)

    def recorrected(self, evaluation: Evaluation, before: Problem) -> Evaluation:
        """Return residuals with the beam-model corrections of this problem in place of those of `before`."""
        # No simulation is needed.
        comparison = evaluation.comparison
        misfits = tuple(
            experiment.recorrected(misfit, earlier)
            for experiment, misfit, earlier in zip(
                self.experiments, comparison.misfits, before.experiments, strict=True
            )
        )
        return replace(evaluation, comparison=replace(comparison, misfits=misfits))

    def nearby(self, independent_points: float) -> Callable[[Array, Evaluation | None], Evaluation]:
        """Return a function that computes the residuals of candidate laws, starting from an earlier result."""
        # Candidates have the shape (P, n). `independent_points` determines the weight of the edges.
        return lambda units, near: self.evaluate(
            units, independent_points, near=near.comparison.near if near else (), keep=True
        )

    def evaluate(
        self,
        unit: Array,
        independent_points: float,
        experiments: Sequence[Experiment] | None = None,
        near: Sequence[Shapes] = (),
        keep: bool = False,
    ) -> Evaluation:
        """Return the residuals of all data and priors for several candidate sets of parameters."""
        # unit: (P, n), or (P, s) for the s unknowns of the law; scaled to 0..1 between their bounds. experiments:
        # replace those of the problem. near: for each experiment, shapes from which the solver starts. keep: keep the
        # solution of the first candidate, for `near` in another call.
        # Uncertain inputs that ``unit`` does not contain have their specified values.
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
                        by_lens=self.unknowns.grouped_by_lens(unit[rows], len(used)),
                    ),
                )
                for rows, deviations in self.unknowns.grouped_by_beam(unit, len(used))
            ]
        )
        none = np.zeros((len(unit), 0))
        curves = [none, *(curve.standardised(self.law, parameters) for curve in self.curves)]
        law_priors = [none, *(prior.standardised(self.law, parameters)[:, None] for prior in self.priors)]
        return Evaluation(
            comparison,
            np.concatenate(curves, axis=1),
            self.unknowns.standardised(unit),
            np.concatenate(law_priors, axis=1),
            independent_points,
        )
