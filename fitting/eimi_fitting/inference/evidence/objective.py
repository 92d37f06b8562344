"""Compute the objective of a fit: one number for each candidate law, from the evidence (edges, tensile curves, priors).

Let e_k be the error of state k in mm (`inference.evidence.measurements`), and e the mean of e_k over all states. If
edges or tracked points are the only evidence, the objective is e. Further evidence increases it:

    objective = e * exp(sum_j z_j^2 / (2 N)).

The z_j are the standardised residuals of tensile curves, of freed nuisances (uncertain inputs that the fit determines)
and of priors on the law's parameters. N is the number of independent points of the edges. It is smaller than the number
of points, because neighbours on an edge are correlated (`inference.interval.covariance`). The objective has the unit
mm.

The formula follows from the likelihood. The likelihood of N independent points with normal noise, maximised over the
noise level, is proportional to e^-N (Seber and Wild 1989, Nonlinear Regression, section 2.2.1). The likelihood of the
other evidence is exp(-sum_j z_j^2 / 2). The objective is the product of both to the power -1/N, and is smallest where
the product is largest.
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

_MOST_MM = 0.99 * DISCARDED_MM  # largest objective of a valid candidate


@dataclass(frozen=True)
class Evaluation:
    """Comparison of P sets of unknowns (candidates) of a fit with the edges, the tensile curves and the priors.

    Parameters
    ----------
    comparison : Comparison
        Comparison with the measured edges and points.
    curves : ndarray, shape (P, m)
        Residuals of the m rows of all tensile curves, each divided by its standard deviation.
    priors : ndarray, shape (P, f)
        Deviations of the f inputs that are fitted too, such as the width, divided by their prior standard deviations.
    law_priors : ndarray, shape (P, q)
        Residuals of the q priors on the law's parameters, each divided by its standard deviation.
    independent_points : float
        Number of independent points of the edges.
    """

    comparison: Comparison
    curves: Array
    priors: Array
    law_priors: Array
    independent_points: float

    @property
    def unconverged(self) -> NDArray[np.bool_]:
        """Whether the beam has no equilibrium in at least one load case, for each set of unknowns."""
        return self.comparison.unconverged

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """Whether the law is unstable in at least one load case, for each set of unknowns."""
        return self.comparison.unstable

    @property
    def standardised(self) -> Array:
        """The residuals of the tensile curves and of all priors, each divided by its standard deviation."""
        return np.concatenate([self.curves, self.priors, self.law_priors], axis=1)

    @property
    def objective_mm(self) -> Array:
        """The number that a fit minimises, in mm, for each set of unknowns.

        It is the mean error of the edges or tracked points, increased by the residuals of tensile curves and priors.
        """
        mean = self.comparison.objective_mm
        x = 0.5 * (self.standardised**2).sum(axis=1) / self.independent_points
        # Beyond x = 5 a straight line continues the exponential, which would overflow.
        far = np.maximum(x - 5, 0.0)
        factor = np.exp(np.minimum(x, 5.0)) * (1 + far)
        return np.where(mean < DISCARDED_MM, np.minimum(mean * factor, _MOST_MM), DISCARDED_MM)

    @property
    def without_law_priors(self) -> Evaluation:
        """The same comparison with the data, without the priors on the law's parameters."""
        return replace(self, law_priors=self.law_priors[:, :0])

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Whether tensile curves and priors contradict a set of unknowns so strongly that its objective is cut off.

        The objective is the number that a fit minimises.
        """
        return self.objective_mm == _MOST_MM

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """The residuals for least squares, in mm: of each experiment, and of the tensile curves and priors together."""
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
    """The problem of a fit: a hyperelastic law, the unknowns, and the data with the priors.

    Parameters
    ----------
    law : Law
        The hyperelastic law.
    unknowns : Unknowns
        The quantities that the fit determines, with their bounds.
    experiments : tuple of Experiment
        The specimens with their loads and measured edges or points.
    curves : tuple of TensileEvidence
        Tensile curves that are fitted together with the experiments.
    priors : tuple of Prior
        Priors on the law's parameters.
    """

    law: Law
    unknowns: Unknowns
    experiments: tuple[Experiment, ...]
    curves: tuple[TensileEvidence, ...] = ()
    priors: tuple[Prior, ...] = ()

    @property
    def has_more_than_edges(self) -> bool:
        """Whether the fit uses anything besides edges: fitted inputs (such as the width), tensile curves or priors."""
        return bool(self.unknowns.freed or self.curves or self.priors)

    def with_own_changes(self, evaluation: Evaluation, before: Problem) -> Evaluation:
        """Replace the corrections of the problem ``before`` in its residuals by the corrections of this problem.

        A correction is the change of the residuals (in mm) by a better beam model.
        """
        comparison = evaluation.comparison
        misfits = tuple(
            experiment.with_own_change(misfit, earlier)
            for experiment, misfit, earlier in zip(
                self.experiments, comparison.misfits, before.experiments, strict=True
            )
        )
        return replace(evaluation, comparison=replace(comparison, misfits=misfits))

    def nearby(self, independent_points: float) -> Callable[[Array, Evaluation | None], Evaluation]:
        """Return the function that compares unknowns with the data in the final (Gauss-Newton) steps of a fit."""
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
        """Compare P sets of values of the unknowns (candidates) with the edges, the tensile curves and the priors.

        Parameters
        ----------
        unit : ndarray, shape (P, s) or (P, n)
            The unknowns of the P candidates, scaled to 0 to 1 within their bounds: all n of them, or only the s
            unknowns of the first search. In the second case uncertain inputs, such as the width, have their specified
            values.
        independent_points : float
            Number of independent edge points.
        experiments : sequence of Experiment, optional
            Experiments that replace the experiments of the problem.
        near : sequence of Shapes
            Shapes of an earlier evaluation on the same meshes with ``keep``, from which the solver starts.
        keep : bool
            Keep the full solution of the first candidate as a start for later evaluations.

        Returns
        -------
        Evaluation
            The comparison of the P candidates with all the data.
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
                        seen=self.unknowns.seen(unit[rows], len(used)),
                    ),
                )
                for rows, deviations in self.unknowns.bent(unit, len(used))
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
