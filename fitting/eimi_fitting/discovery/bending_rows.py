"""Bent beams as rows: their edges about a law that is near, linear in the coefficients of the terms.

The residuals about that law are those of the best model of the specimen: the solid, or the finer mesh of a plane
section. Their derivatives are differences of the planar model on the coarse mesh, as those of stated sources are
(`inference.interval.considered`). All laws that are compared bend the beam much alike, so that what the derivatives
are off by counts for as little as they differ.
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

BENT_STRAIN = 0.1  # about what beams of such tests reach
_STEP = 0.01  # of the stress at that strain
_MODEL = 0.0015 / 1.96  # of the modulus: what mesh and states between leave, see `inference.identification`
_TOLERANCE_MM = 1e-4  # of the last Newton step: its end is far below a tenth of a micrometre
_STIFFER = (1.0, 1.01, 0.99, 1.03)  # laws about which edges are sought, where the one before finds no equilibrium


class NoEquilibrium(Exception):
    """A beam of the law about which its edges were to be linear finds no equilibrium."""


def scale_deviation(lot: float) -> float:
    """Standard deviation of the beams' moduli beside those of other evidence, the model's own error included."""
    return float(np.hypot(lot, _MODEL))


def bending_rows(
    experiments: Sequence[Experiment], terms: Sequence[Term], about: Array, lot: float
) -> tuple[Rows, list[float]]:
    """Rows of all experiments about coefficients (J,), and the noise in mm of each.

    lot: standard deviation by which all moduli of the beams may differ from those of other evidence, as a share. It is
    the first nuisance, in units of `scale_deviation`, and every source whose uncertainty is stated a further one. What
    the best model of the specimen leaves uncertain is noise of its own in each state. Where a beam finds no
    equilibrium, a law that is a little stiffer or softer serves as well. Raises NoEquilibrium where none of them does.
    """
    for factor in _STIFFER:
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
    sources = _changes_by_sources(experiments, law, about)
    parts, noises = [], []
    for index, (experiment, (misfit, left)) in enumerate(zip(experiments, refined, strict=True)):
        residuals = misfit.residuals[0]
        slopes = _slopes(experiment, law, about)
        scaled = scale_deviation(lot) * np.tensordot(about, slopes, axes=1)
        moved = [change if (change := own[index]) is not None else np.zeros_like(residuals) for own in sources]
        rows, noise_mm = _whitened(experiment, misfit, left, slopes, np.stack([scaled, *moved]), about)
        parts.append(rows)
        noises.append(noise_mm)
    return Rows.joined(parts), noises


def _refined(experiment: Experiment, law: SumOfTerms, about: Array) -> tuple[Misfit, Array]:
    """The misfit of the best model, and (K, G, m) mm: one standard deviation of what it leaves uncertain.

    The latter is a share of what it changes (`inference.evidence.corrections`).
    """
    (refinement,) = refinements([experiment])
    plain, better = (_misfit(own, law, about)[0] for own in (polished(experiment), refinement.better(experiment)))
    return better, refinement.remaining_share * (better.residuals[0] - plain.residuals[0])


def _misfit(
    experiment: Experiment, law: SumOfTerms, coefficients: Array, near: Configuration | None = None
) -> tuple[Misfit, Configuration | None]:
    """Of one law (J,), and where the beam then is, for others to begin there; the solid tells no place."""
    model, loads, candidate = experiment.solved, experiment.loads, coefficients[None]
    if isinstance(model, BeamModel):
        shapes = model.solve(law, candidate, loads, tolerance_mm=_TOLERANCE_MM, keep=True, near=near)
    else:
        shapes = model.solve(law, candidate, loads, tolerance_mm=_TOLERANCE_MM)
    if not np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all():
        raise NoEquilibrium
    return experiment.observed.misfit(model, shapes, None, experiment.change), shapes.every


def _slopes(experiment: Experiment, law: SumOfTerms, about: Array) -> Array:
    """(J, K, G, m): of the residuals, for a coefficient of one more."""
    planar = polished(experiment)
    unit = stress_columns(law.terms, np.array([BENT_STRAIN]))[0]
    steps = _STEP * (unit @ about) / unit

    here, every = _misfit(planar, law, about)
    moved = [_misfit(planar, law, about + step, every)[0].residuals[0] for step in np.diag(steps)]
    return np.stack([(own - here.residuals[0]) / size for own, size in zip(moved, steps, strict=True)])


def _changes_by_sources(experiments: Sequence[Experiment], law: SumOfTerms, about: Array) -> list[list[Array | None]]:
    """Of every part of every stated source, what one standard uncertainty does to each experiment, (K, G, m) mm."""
    plain = LAWS["neo-hookean"]  # sources are those of the experiments, whatever the law
    groups = sources_of(Problem(plain, Unknowns(search_space(plain)), tuple(experiments)))
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
    experiment: Experiment, misfit: Misfit, left_by_model: Array, slopes: Array, nuisances: Array, about: Array
) -> tuple[Rows, float]:
    """The rows of one experiment: as few a state as its slopes have directions."""
    residuals, weights = misfit.residuals[0], misfit.weights
    used = weights > 0
    j, flat = len(slopes), residuals[used]
    columns = slopes[:, used].T
    seen = columns @ about - flat
    coefficients = non_negative(columns, seen)
    left = np.zeros_like(residuals)
    left[used] = columns @ coefficients - seen
    points = float(used.sum())
    noise_mm = max(float(np.sqrt((left**2).sum() / max(points - j, 1.0))), 1e-9)
    tau = point_correlation(left, weights, experiment.observed)
    scale = 1 / (noise_mm * np.sqrt(tau))
    parts = []
    for state, own in enumerate(used):
        if not own.any():
            continue
        model = scale * left_by_model[state][own]
        moves = scale * np.column_stack([slopes[:, state][:, own].T, nuisances[:, state][:, own].T])
        target = scale * (slopes[:, state][:, own].T @ about - residuals[state][own])
        directions = np.linalg.qr(np.column_stack([moves, model]))[0]
        whiten = _inverse_root(directions.T @ model) @ directions.T
        reduced = whiten @ moves
        together = np.zeros(len(reduced), np.intp)
        parts.append(Rows(whiten @ target, reduced[:, :j], reduced[:, j:], together))
    rows = Rows.joined(parts)
    return rows.noisier(max(_left_by_all(rows), 1.0)), noise_mm


def _inverse_root(deviation: Array) -> Array:
    """(m, m): of the covariance of unit noise and one normal error of this standard deviation (m,)."""
    square = float(deviation @ deviation)
    if square == 0.0:
        return np.eye(len(deviation))
    return np.asarray(np.eye(len(deviation)) - (1 - 1 / np.sqrt(1 + square)) / square * np.outer(deviation, deviation))


def _left_by_all(rows: Rows) -> float:
    """What all terms and nuisances leave of the rows, in units of the noise: a model's error is smooth, as they are."""
    every = np.column_stack([rows.columns, rows.nuisances])
    size = np.linalg.norm(every, axis=0)
    every = every / np.where(size > 0, size, 1.0)
    best, _, rank, _ = np.linalg.lstsq(every, rows.seen, rcond=1e-9)
    left = every @ best - rows.seen
    return float(np.sqrt(left @ left / max(len(left) - int(rank), 1)))
