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
    """The comparison of P candidates of a fit with all the evidence: edges, tensile curves and priors.

    A candidate is one set of values of the unknowns of the fit.

    Parameters
    ----------
    comparison : Comparison
        Comparison with the measured edges and points.
    curves : ndarray, shape (P, m)
        Standardised residuals of the tensile curves, which have m rows (pairs of strain and stress) together.
    priors : ndarray, shape (P, f)
        Deviations of the f freed nuisances (inputs that the fit determines) from their stated values, in standard
        deviations of their priors.
    law_priors : ndarray, shape (P, q)
        Standardised residuals of the q priors on the law's parameters.
    independent_points : float
        Number N of independent points of the edges.
    """

    comparison: Comparison
    curves: Array
    priors: Array
    law_priors: Array
    independent_points: float

    @property
    def unconverged(self) -> NDArray[np.bool_]:
        """Whether each of P candidates (values of the unknowns) has no equilibrium in at least one state, (P,)."""
        return self.comparison.unconverged

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """Whether the law of each of P candidates (values of the unknowns) is unstable in at least one state, (P,).

        False for a candidate without an equilibrium in one of the states.
        """
        return self.comparison.unstable

    @property
    def standardised(self) -> Array:
        """The residuals of all evidence except the edges, each divided by its standard deviation.

        The shape is (P, m + f + q) for P candidates (sets of values of the unknowns): m rows of tensile curves, f freed
        inputs (which the fit determines together with the law), and q priors on the law's parameters.
        """
        return np.concatenate([self.curves, self.priors, self.law_priors], axis=1)

    @property
    def objective_mm(self) -> Array:
        """The objective in mm, which the search makes as small as possible, for P candidates, shape (P,).

        A candidate is one set of values of the unknowns. Its objective is the mean error of edges or tracked points,
        increased by the residuals of tensile curves and priors. A candidate without an equilibrium or with an unstable
        law in a state gets a very large number (`DISCARDED_MM`).
        """
        mean = self.comparison.objective_mm
        x = 0.5 * (self.standardised**2).sum(axis=1) / self.independent_points
        # Beyond x = 5 a straight line continues the exponential, which would overflow.
        far = np.maximum(x - 5, 0.0)
        factor = np.exp(np.minimum(x, 5.0)) * (1 + far)
        return np.where(mean < DISCARDED_MM, np.minimum(mean * factor, _MOST_MM), DISCARDED_MM)

    @property
    def without_law_priors(self) -> Evaluation:
        """The same evaluation of the candidates, without the priors on the law's parameters."""
        return replace(self, law_priors=self.law_priors[:, :0])

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Whether tensile curves and priors contradict a candidate so strongly that its objective is cut off, (P,).

        A candidate is one set of values of the unknowns. The objective of a valid candidate is cut off at 0.99 of the
        objective of an invalid candidate (`DISCARDED_MM`).
        """
        return self.objective_mm == _MOST_MM

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """Residuals in mm for least squares: one `Misfit` for each experiment, and one for the other evidence.

        The other evidence is the tensile curves, the priors of freed inputs (which the fit determines) and the priors
        of the law. Its standardised residuals z have no unit. They are converted to residuals in mm,

            r = e sqrt(K / N) z,

        with the number K of states and the number N of independent points of the edges. e is the mean error of the
        states in mm, as the median over all valid candidates. The last `Misfit` has these residuals r and the error e,
        as if they belonged to one more state. Near the optimum, z then has the same weight in least squares as in the
        objective.
        """
        standardised = self.standardised
        p, m = standardised.shape
        if m == 0:
            return self.comparison.misfits
        states = self.comparison.error_mm.shape[1]
        valid = self.comparison.objective_mm[~(self.unconverged | self.unstable)]
        error = float(np.median(valid)) if len(valid) else 1.0
        residuals = error * np.sqrt(states / self.independent_points) * standardised
        additional = Misfit(
            residuals.reshape(p, 1, 1, m), np.full((1, 1, m), 1 / m), np.full((p, 1), error), np.zeros((p, 1))
        )
        return (*self.comparison.misfits, additional)


@dataclass(frozen=True)
class Problem:
    """The problem of a fit: a hyperelastic law, the unknowns and the evidence (edges, tensile curves, priors).

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
        """Whether a fit has freed nuisances (inputs that it determines), tensile curves or priors on the law."""
        return bool(self.unknowns.freed or self.curves or self.priors)

    def with_own_changes(self, evaluation: Evaluation, before: Problem) -> Evaluation:
        """Return the evaluation of this problem, from the evaluation of a problem that differs only in its corrections.

        ``evaluation`` was computed for the problem ``before``. Corrections by better beam models are added to the
        residuals: those of ``before`` are subtracted, and those of this problem are added. No beam is simulated.
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
        """Return the function that the Gauss-Newton method (`polish`) calls to evaluate candidates.

        The function takes candidates (sets of values of the unknowns) in unit coordinates (0 to 1), and an earlier
        evaluation from whose shapes the solver starts, or None. ``independent_points`` is the number of independent
        edge points.
        """
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
        """Compare P candidates (sets of values of the unknowns) with the evidence: edges, tensile curves and priors.

        Parameters
        ----------
        unit : ndarray, shape (P, searched) or (P, n)
            P candidates in unit coordinates, from 0 to 1 within the bounds of the search: either the unknowns that the
            search varies (``Unknowns.searched``), or all n unknowns. By default nuisances (uncertain inputs) have their
            stated values.
        independent_points : float
            Number of independent edge points.
        experiments : sequence of Experiment, optional
            Experiments that replace the experiments of the problem.
        near : sequence of Shapes
            Shapes of an earlier evaluation on the same meshes that was made with ``keep``. The solver starts from the
            shapes of the first candidate of that evaluation.
        keep : bool
            Keep the full solution of the first candidate as a start for later evaluations.

        Returns
        -------
        Evaluation
            The comparison of the P candidates with all the evidence.
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
