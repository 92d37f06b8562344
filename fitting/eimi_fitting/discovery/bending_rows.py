"""Turn the edges of bent beams into linear equations for the coefficients of the terms of a strain energy.

The edges are linearised about a law that is close to the solution. The residuals for this law are computed with the
most accurate model of the specimen: the three-dimensional model for a solid section, and a planar model with a finer
mesh for other sections. The derivatives of the residuals are finite differences, computed with the coarser planar
model. The error of the derivatives has little effect, because all compared laws bend the beam by almost the same
amount.
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
_MODEL = 0.0015 / 1.96  # standard deviation of the modulus by mesh and interpolation, see `inference.corrected_optimum`
_TOLERANCE_MM = 1e-4  # length of the last Newton step; the equilibrium is then exact to far below 0.1 micrometre
_STIFFNESS_FACTORS = (1.0, 1.01, 0.99, 1.03)  # tried in this order until every beam has an equilibrium


class NoEquilibrium(Exception):
    """A bent beam has no equilibrium for a law near the solution."""


def scale_deviation(lot: float) -> float:
    """Return the relative standard deviation of the ratio (modulus of the beams) / (modulus of the tensile specimens).

    The ratio differs from 1 because beams and tensile specimens come from different production lots, and because of
    errors of the beam model.

    Parameters
    ----------
    lot : float
        Relative standard deviation of the ratio due to the different lots alone.

    Returns
    -------
    float
        sqrt(lot^2 + model^2). Here ``model`` is the relative standard deviation due to errors of the beam model alone,
        0.15 % / 1.96; 0.15 % is half the width of the 95 % interval.
    """
    return float(np.hypot(lot, _MODEL))


def bending_rows(
    experiments: Sequence[Experiment], terms: Sequence[Term], about: Array, lot: float
) -> tuple[Rows, list[float]]:
    """Return linear equations for the coefficients of J terms of a law from the edges of bent beams.

    The equations are exact to first order near the coefficients ``about``. Further unknowns of the equations are errors
    of inputs, such as the clamp's position.

    Parameters
    ----------
    experiments : sequence of Experiment
        The bent beams.
    terms : sequence of Term
        The J terms of the library.
    about : array, shape (J,)
        Coefficients in Pa of the law about which the edges are linearised.
    lot : float
        Relative standard deviation of the ratio of the modulus of the beams to that of the tensile specimens, which may
        come from another production lot.

    Returns
    -------
    Rows
        The equations of all beams.
    list of float
        Standard deviation of the noise of each experiment in mm.

    Raises
    ------
    NoEquilibrium
        If, for each of the four factors 1, 1.01, 0.99 and 1.03, a beam has no equilibrium with the coefficients
        ``about`` times this factor.
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
    """Return the residuals of the most accurate beam model, and the standard deviation of the error of this model.

    Both are in mm. The deviation has the shape (K, G, m) for K states and G = 2 groups of m points (the two edges, or x
    and y of tracked points).
    """
    (refinement,) = refinements([experiment])
    coarse, best = (_misfit(model, law, about)[0] for model in (polished(experiment), refinement.better(experiment)))
    return best, refinement.remaining_share * (best.residuals[0] - coarse.residuals[0])


def _misfit(
    experiment: Experiment, law: SumOfTerms, coefficients: Array, near: Configuration | None = None
) -> tuple[Misfit, Configuration | None]:
    """Simulate a beam; return its residuals, and its simulated shape (None for a three-dimensional model).

    coefficients: those of the J terms of the law in Pa, (J,). near: a shape from which the solution starts.
    """
    model, loads, candidate = experiment.solved, experiment.loads, coefficients[None]
    if isinstance(model, BeamModel):
        shapes = model.solve(law, candidate, loads, tolerance_mm=_TOLERANCE_MM, keep=True, near=near)
    else:
        shapes = model.solve(law, candidate, loads, tolerance_mm=_TOLERANCE_MM)
    if not np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all():
        raise NoEquilibrium
    return experiment.observed.misfit(model, shapes, None, experiment.change), shapes.every


def _slopes(experiment: Experiment, law: SumOfTerms, about: Array) -> Array:
    """Return the derivatives of the residuals by the J coefficients of the law, in mm/Pa, (J, K, G, m).

    They are computed at the coefficients ``about``, (J,). There are K states, and G = 2 groups of m points (the two
    edges, or x and y of tracked points).
    """
    planar = polished(experiment)
    unit_stress = stress_columns(law.terms, np.array([BENT_STRAIN]))[0]
    steps = _STEP * (unit_stress @ about) / unit_stress

    base, shape = _misfit(planar, law, about)
    stepped = [_misfit(planar, law, about + step, shape)[0].residuals[0] for step in np.diag(steps)]
    return np.stack([(residuals - base.residuals[0]) / size for residuals, size in zip(stepped, steps, strict=True)])


def _changes_by_sources(experiments: Sequence[Experiment], law: SumOfTerms, about: Array) -> list[list[Array | None]]:
    """Return how much the residuals change, in mm, if one uncertain input changes by its standard uncertainty.

    The outer list has one row for each part of an input, such as x of the clamp. A row has one array (K, G, m) for each
    experiment, or None for an experiment without this input. There are K states and G = 2 groups of m points (the two
    edges, or x and y of tracked points). about: the coefficients of the law in Pa.
    """
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
    """Return the equations of one experiment, transformed so that their errors are independent, and the noise in mm.

    The errors of the equations have the variance 1. The unknowns are the coefficients of the law and the nuisances
    (errors of inputs).

    Parameters
    ----------
    experiment : Experiment
        The bent beam.
    misfit : Misfit
        The residuals that the most accurate beam model has with the coefficients ``about``.
    model_error : ndarray, shape (K, G, m)
        Error of the beam model in mm, in K states: G = 2 groups (left and right edge, or x and y of tracked points) of
        m points.
    slopes : ndarray, shape (J, K, G, m)
        Derivatives of the residuals by the J coefficients in mm/Pa.
    nuisances : ndarray, shape (q, K, G, m)
        Changes of the residuals in mm, if one of the q nuisances has the size of its standard uncertainty.
    about : ndarray, shape (J,)
        Coefficients in Pa of the law about which the edges are linearised.
    """
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
    """Return the matrix (I + d d^T)^(-1/2), (m, m), with the identity I and d = ``deviation``, (m,).

    The product of this matrix and errors with the covariance I + d d^T is a vector of independent errors.
    """
    square = float(deviation @ deviation)
    if square == 0.0:
        return np.eye(len(deviation))
    return np.asarray(np.eye(len(deviation)) - (1 - 1 / np.sqrt(1 + square)) / square * np.outer(deviation, deviation))


def _residual_of_all_columns(rows: Rows) -> float:
    """Return the root mean square residual of the least-squares fit of all terms to one beam, in units of the noise.

    A value well above 1 shows that the beam model is wrong.
    """
    columns = np.column_stack([rows.columns, rows.nuisances])
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 0, size, 1.0)
    solution, _, rank, _ = np.linalg.lstsq(columns, rows.observed, rcond=1e-9)
    residuals = columns @ solution - rows.observed
    return float(np.sqrt(residuals @ residuals / max(len(residuals) - int(rank), 1)))
