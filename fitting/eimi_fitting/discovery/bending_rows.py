"""Turn the edges of bent beams into linear equations for the coefficients of the terms of a strain energy.

The equations are linearised about an estimate of the law. The residuals are those of the most accurate beam model;
their derivatives are finite differences of a coarser planar model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Configuration, Status
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.discovery.rows import Rows, non_negative
from eimi_fitting.discovery.tensile_rows import stress_columns
from eimi_fitting.inference.evidence.corrections import polished, refinements
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.inference.interval.considered import Candidate, changes_by, sources_of
from eimi_fitting.inference.interval.covariance import point_correlation
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term

Array = NDArray[np.float64]

BENT_STRAIN = 0.1  # typical largest strain of a bent beam (assumed)
_STEP = 0.01  # size of a finite difference, as a share of the stress at BENT_STRAIN
# Standard deviation of the modulus by mesh and interpolation, see `inference.interval.corrected_optimum`.
_MODEL = 0.0015 / 1.96
_TOLERANCE_MM = 1e-4  # length of the last Newton step; the equilibrium is then exact to far below 0.1 micrometre
_STIFFNESS_FACTORS = (1.0, 1.01, 0.99, 1.03)  # tried in this order until every beam has an equilibrium


class NoEquilibrium(Exception):
    """The simulation of a bent beam finds no equilibrium."""


def scale_deviation(lot: float) -> float:
    """Return the relative standard deviation of the modulus due to production lots (``lot``) and the beam model."""
    # It is that between the moduli of the beams and of the tensile specimens.
    return float(np.hypot(lot, _MODEL))


def bending_rows(
    experiments: Sequence[Experiment], terms: Sequence[Term], about: Array, lot: float
) -> tuple[Rows, list[float]]:
    """Turn the edges of bent beams into linear equations for the coefficients of the terms of a strain energy.

    Further unknowns are errors of inputs, such as the clamp's position.

    Parameters
    ----------
    experiments : sequence of Experiment
        The bent beams.
    terms : sequence of Term
        The terms of the strain energy.
    about : array
        Estimated coefficient of each term, Pa.
    lot : float
        Relative standard deviation of the modulus between production lots of beams and tensile specimens.

    Returns
    -------
    Rows
        The equations of all beams.
    list of float
        Standard deviation of the noise of each beam, mm.

    Raises
    ------
    NoEquilibrium
        If a beam has no equilibrium with coefficients close to ``about``.
    """
    for factor in _STIFFNESS_FACTORS:
        try:
            return _rows_about(experiments, terms, factor * about, lot)
        except NoEquilibrium:
            continue
    raise NoEquilibrium


def _rows_about(
    experiments: Sequence[Experiment], terms: Sequence[Term], about: Array, lot: float
) -> tuple[Rows, list[float]]:
    law = SumOfTerms(tuple(terms))
    refined = [_refined(experiment, law, about) for experiment in experiments]
    source_changes = _changes_by_sources(experiments, law, about)
    parts, noises = [], []
    for index, (experiment, (misfit, model_error)) in enumerate(zip(experiments, refined, strict=True)):
        residuals = misfit.residuals[0]
        slopes = _slopes(experiment, law, about)
        scaled = scale_deviation(lot) * np.tensordot(about, slopes, axes=1)
        changes = [
            np.zeros_like(residuals) if (change := by_experiment[index]) is None else change
            for by_experiment in source_changes
        ]
        rows, noise_mm = _whitened(experiment, misfit, model_error, slopes, np.stack([scaled, *changes]), about)
        parts.append(rows)
        noises.append(noise_mm)
    return Rows.joined(parts), noises


def _refined(experiment: Experiment, law: SumOfTerms, about: Array) -> tuple[Misfit, Array]:
    """Return the residuals of the most accurate beam model, and the standard deviation of its error in mm."""
    # (K, 2, m): K load states, and two groups of m points (the two edges, or x and y of tracked points).
    (refinement,) = refinements([experiment])
    coarse, best = (_misfit(model, law, about)[0] for model in (polished(experiment), refinement.better(experiment)))
    return best, refinement.remaining_share * (best.residuals[0] - coarse.residuals[0])


def _misfit(
    experiment: Experiment, law: SumOfTerms, coefficients: Array, near: Configuration | None = None
) -> tuple[Misfit, Configuration | None]:
    """Simulate a beam; return its residuals, and its shape (None for a three-dimensional model)."""
    # ``coefficients``: those of the law, Pa. ``near``: a shape from which the solution starts.
    model, loads, candidate = experiment.solved, experiment.loads, coefficients[None]
    if isinstance(model, BeamModel):
        shapes = model.solve(law, candidate, loads, tolerance_mm=_TOLERANCE_MM, keep=True, near=near)
    else:
        shapes = model.solve(law, candidate, loads, tolerance_mm=_TOLERANCE_MM)
    if not np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all():
        raise NoEquilibrium
    return experiment.observed.misfit(model, shapes, None, experiment.change), shapes.every


# The error of these derivatives has little effect, because all compared laws bend the beam by almost the same amount.
def _slopes(experiment: Experiment, law: SumOfTerms, about: Array) -> Array:
    """Return the derivatives of the residuals with respect to the coefficients of the terms, in mm/Pa."""
    # (J, K, 2, m): J terms, K load states, and two groups of m points (the two edges, or x and y of tracked points).
    planar = polished(experiment)
    unit_stress = stress_columns(law.terms, np.array([BENT_STRAIN]))[0]
    steps = _STEP * (unit_stress @ about) / unit_stress

    base, shape = _misfit(planar, law, about)
    stepped = [_misfit(planar, law, about + step, shape)[0].residuals[0] for step in np.diag(steps)]
    return np.stack([(residuals - base.residuals[0]) / size for residuals, size in zip(stepped, steps, strict=True)])


def _changes_by_sources(experiments: Sequence[Experiment], law: SumOfTerms, about: Array) -> list[list[Array | None]]:
    """Return the changes of the residuals if one uncertain input changes by its standard uncertainty."""
    # One row for each part of an input, such as x of the clamp. A row has an array (K, 2, m) in mm, or None, for each
    # beam.
    any_law = LAWS["neo-hookean"]  # the list of sources depends on the experiments, not on the law
    groups = sources_of(Problem(any_law, Unknowns(search_space(any_law)), tuple(experiments)))
    candidate = Candidate(law, about[None])
    return [
        [
            changes_by(candidate, experiment, [(group.source, part, group.standard_uncertainty or 0.0)])[0]
            if index in group.datasets
            else None
            for index, experiment in enumerate(experiments)
        ]
        for group in groups
        for part in range(len(SOURCES[group.source].parts))
    ]


def _whitened(
    experiment: Experiment, misfit: Misfit, model_error: Array, slopes: Array, nuisances: Array, about: Array
) -> tuple[Rows, float]:
    """Return linear equations for the coefficients of the law from one beam, and the noise in mm."""
    # The equations are scaled to independent errors of variance 1.
    # ``model_error`` (K, 2, m): error of the beam model in mm, for K load states and two edges with m points.
    # ``slopes`` (J, K, 2, m): derivatives of the residuals by J coefficients of the law in mm/Pa. ``nuisances`` (q, K,
    # 2, m): changes of the residuals if one of q inputs changes by its standard uncertainty, in mm. ``about``:
    # coefficients of the law for the residuals in Pa.
    residuals, weights = misfit.residuals[0], misfit.weights
    used = weights > 0
    j, used_residuals = len(slopes), residuals[used]
    columns = slopes[:, used].T
    observed = columns @ about - used_residuals
    remaining = np.zeros_like(residuals)
    remaining[used] = columns @ non_negative(columns, observed) - observed
    points = float(used.sum())
    noise_mm = max(float(np.sqrt((remaining**2).sum() / max(points - j, 1.0))), 1e-9)
    tau = point_correlation(remaining, weights, experiment.observed)
    scale = 1 / (noise_mm * np.sqrt(tau))
    parts = []
    for state, points_used in enumerate(used):
        if not points_used.any():
            continue
        model = scale * model_error[state][points_used]
        state_slopes = slopes[:, state][:, points_used].T
        changes = scale * np.column_stack([state_slopes, nuisances[:, state][:, points_used].T])
        target = scale * (state_slopes @ about - residuals[state][points_used])
        directions = np.linalg.qr(np.column_stack([changes, model]))[0]
        whiten = _inverse_root(directions.T @ model) @ directions.T
        reduced = whiten @ changes
        groups = np.zeros(len(reduced), np.intp)
        parts.append(Rows(whiten @ target, reduced[:, :j], reduced[:, j:], groups))
    rows = Rows.joined(parts)
    return rows.with_noise_times(max(_residual_of_all_columns(rows), 1.0)), noise_mm


def _inverse_root(deviation: Array) -> Array:
    """Return the matrix (I + d d^T)^(-1/2) for the vector d = ``deviation``."""
    square = float(deviation @ deviation)
    if square == 0.0:
        return np.eye(len(deviation))
    return np.asarray(np.eye(len(deviation)) - (1 - 1 / np.sqrt(1 + square)) / square * np.outer(deviation, deviation))


def _residual_of_all_columns(rows: Rows) -> float:
    """Return the root mean square residual of a least-squares fit of all terms, in units of the noise."""
    columns = np.column_stack([rows.columns, rows.nuisances])
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 0, size, 1.0)
    solution, _, rank, _ = np.linalg.lstsq(columns, rows.observed, rcond=1e-9)
    residuals = columns @ solution - rows.observed
    return float(np.sqrt(residuals @ residuals / max(len(residuals) - int(rank), 1)))
