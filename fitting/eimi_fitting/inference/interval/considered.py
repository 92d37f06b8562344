"""Compute the effect of uncertain inputs, such as the width, on the residuals and on the optimum of a fit."""

# An error of input s of one standard uncertainty changes the residuals by c_s. With the derivatives J of the residuals
# in the unknowns, the weights W of the residuals and the Hessian H, the optimum changes by
#
#     d_s = -inv(H) J' W c_s
#
# (consider covariance: Schmidt 1966, Adv. Control Syst. 3:293).

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Configuration, Status
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import SOURCES, specimen_under
from eimi_fitting.inference.evidence.unknowns import Nuisance, Setup, SharedUnknowns, shared
from eimi_fitting.inference.interval.covariance import Linearisation
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

# Steps of the finite differences, in standard uncertainties. Within one standard uncertainty the response is linear to
# a per cent. The second and third steps are tried if the first is impossible, or if the model finds no equilibrium.
_STEPS = (0.5, -0.5, 0.05)
_TOLERANCE_MM = 1e-3  # the last Newton step is shorter; the remaining error is far below the smallest relevant change


@dataclass(frozen=True)
class ConsideredInput:
    """One component of an uncertain input, such as y of the clamp, and its effect on the residuals."""

    # Name of one component of the input in a result.
    name: str
    shared: SharedUnknowns
    # Index of the component, such as 1 for y.
    part: int
    # (K, 2, m) for each experiment: change of the residuals in mm by the standard uncertainty, in K load cases, for two
    # edges (or x and y) and m points.
    changes: tuple[Array | None, ...]

    @property
    def standard_uncertainty(self) -> float:
        """The standard uncertainty of the input, in the unit of the input."""
        return self.shared.standard_uncertainty or 0.0

    @property
    def freed(self) -> Nuisance:
        """The input as an unknown of a fit, with a normal prior."""
        return Nuisance(self.name, self.shared.source, self.part, self.shared.datasets, self.standard_uncertainty)


def sources_of(problem: Problem) -> tuple[SharedUnknowns, ...]:
    """Return the uncertain inputs, such as the width, that are not fitted with the law."""
    freed = {nuisance.source for nuisance in problem.unknowns.freed}
    # A fitted input also accounts for inputs with the same effect.
    accounted_for = freed.union(*(SOURCES[source].covers for source in freed))
    stated = [experiment.stated for experiment in problem.experiments]
    return tuple(
        group
        for source in SOURCES
        if source not in accounted_for
        for group in shared(source, stated)
        if group.standard_uncertainty
    )


def unstated_of(problem: Problem) -> tuple[SharedUnknowns, ...]:
    """Return important inputs for which no file gives an uncertainty, with their usual uncertainties."""
    freed = {nuisance.source for nuisance in problem.unknowns.freed}
    stated = [experiment.stated for experiment in problem.experiments]
    return tuple(
        replace(group, standard_uncertainty=entry.usual)
        for source, entry in SOURCES.items()
        if entry.is_decisive and source not in freed
        for group in shared(source, stated)
        if group.standard_uncertainty is None and _concerns(source, problem.experiments[group.datasets[0]])
    )


def _concerns(source: str, experiment: Experiment) -> bool:
    # Whether an error of a magnetic input, such as the direction of magnetisation, has an effect.
    # It has none without a field, or without a magnet.
    before = experiment.model.specimen
    changed = specimen_under(before, {source: np.full(len(SOURCES[source].parts), SOURCES[source].usual)})
    return changed != before and bool(experiment.loads.field_T.any())


def considered(
    problem: Problem, unit: Array, groups: Sequence[SharedUnknowns] | None = None
) -> tuple[ConsideredInput, ...]:
    """Return the change of the residuals of a fit by each uncertain input, such as the width."""
    # unit (n,): fitted values, scaled to 0..1 between their bounds. groups: the inputs; by default those of
    # `sources_of`.
    chosen = sources_of(problem) if groups is None else groups
    numbers = [(group, part) for group in chosen for part in range(len(SOURCES[group.source].parts))]
    if not numbers:
        return ()
    changes = changes_of(problem, unit, numbers)
    uncertain_numbers = (
        ConsideredInput(
            group.part_name(part, len(changes)), group, part, tuple(of_experiment[i] for of_experiment in changes)
        )
        for i, (group, part) in enumerate(numbers)
    )
    return tuple(number for number in uncertain_numbers if any(change is not None for change in number.changes))


def changes_of(
    problem: Problem, unit: Array, numbers: Sequence[tuple[SharedUnknowns, int]]
) -> list[list[Array | None]]:
    """Return the changes of the residuals by an error of one standard uncertainty, for each input."""
    # unit (n,): values of the unknowns, scaled to 0..1 between their bounds. numbers: each input and the index of its
    # component, such as 1 for y. The result contains, for each experiment and each input, the change in mm, (K, 2, m).
    return [_changes(problem, unit, index, numbers) for index in range(len(problem.experiments))]


def _changes(
    problem: Problem, unit: Array, index: int, numbers: Sequence[tuple[SharedUnknowns, int]]
) -> list[Array | None]:
    # A fitted input deviates from its fitted value, and any other input from its stated value.
    freed = [
        (n.source, n.part, float(n.value(unit[column])))
        for column, n in enumerate(problem.unknowns.freed, problem.unknowns.searched)
        if index in n.datasets
    ]
    (_, beams), *_ = problem.unknowns.grouped_by_beam(unit[None], len(problem.experiments))
    (_, lenses), *_ = problem.unknowns.grouped_by_lens(unit[None], len(problem.experiments))
    candidate = Candidate(
        problem.law, problem.unknowns.parameters(unit[None]), problem.unknowns.bulk_modulus_Pa(unit[None]), tuple(freed)
    )
    concerned = [(i, number) for i, number in enumerate(numbers) if index in number[0].datasets]
    sizes = [(group.source, part, group.standard_uncertainty or 0.0) for _, (group, part) in concerned]
    # None if the input does not belong to the experiment
    changes: list[Array | None] = [None] * len(numbers)
    concerned_changes = changes_by(candidate, problem.experiments[index].under(beams[index] | lenses[index]), sizes)
    for (i, _), change in zip(concerned, concerned_changes, strict=True):
        changes[i] = change
    return changes


@dataclass(frozen=True)
class Candidate:
    """A set of parameters of a law and of fitted inputs, for one simulation."""

    law: Law
    # (1, n)
    parameters: Array
    # (1,), or None for an incompressible material.
    bulk_modulus_Pa: Array | None = None
    # Name of each fitted input, index of its component (1 for y), and its error in the unit of the input.
    freed: tuple[tuple[str, int, float], ...] = ()


@lru_cache(maxsize=8)
def coarse_model(specimen: Specimen) -> BeamModel:
    """Return a planar beam model of a specimen with few elements."""
    return BeamModel(specimen, plane=specimen.planar_section)


def changes_by(
    candidate: Candidate,
    experiment: Experiment,
    errors: Sequence[tuple[str, int, float]],
    initial: Configuration | None = None,
) -> list[Array | None]:
    """Return the change of the residuals by each error (input, component, size); None without an equilibrium."""
    # errors: 1 is the index of y, and the size is in the unit of the input. initial: shapes of the beam from which the
    # solver starts. The result contains, for each error, the change in mm, (K, 2, m): K load cases, two edges (or x and
    # y) and m points.
    # The changes are finite differences. One standard uncertainty changes the shapes of the beam only a little, so that
    # the solver starts from the shapes for the specified values of the inputs. A change is None if every step is
    # impossible, such as one to a negative width, or has no equilibrium.
    experiment = replace(experiment, model=coarse_model(experiment.model.specimen), solid=None, change=None)
    as_stated = Setup.of(candidate.freed, 1)
    stated_shapes = _bent(candidate, experiment, as_stated, initial)
    if not _in_equilibrium(stated_shapes):
        return [None] * len(errors)
    residuals = experiment.observed.misfit(experiment.model, stated_shapes, as_stated).residuals[0]

    def change(key: str, part: int, size: float) -> Array | None:
        source = SOURCES[key]
        for step in _STEPS:
            deviation = step * size * np.eye(len(source.parts))[part]
            try:
                deviated = experiment.under({key: deviation}) if source.changes_experiment else experiment
            except ValueError:  # no specimen has this error
                continue
            setup = Setup.of([*candidate.freed, (key, part, step * size)], 1)
            shapes = _bent(candidate, deviated, setup, stated_shapes.every) if source.changes_shapes else stated_shapes
            if _in_equilibrium(shapes):
                misfit = deviated.observed.misfit(deviated.model, shapes, setup)
                return np.asarray(misfit.residuals[0] - residuals) / step
        return None

    return [change(*error) for error in errors]


def _bent(candidate: Candidate, experiment: Experiment, setup: Setup, near: Configuration | None = None) -> Shapes:
    return experiment.model.solve(
        candidate.law,
        candidate.parameters,
        experiment.loads,
        tolerance_mm=_TOLERANCE_MM,
        bulk_modulus_Pa=candidate.bulk_modulus_Pa,
        field_factor=setup.field_factor,
        keep=True,
        near=near,
    )


def _in_equilibrium(shapes: Shapes) -> bool:
    return bool(np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all())


@dataclass(frozen=True)
class Steps:
    """Changes of the fitted values by errors of uncertain inputs."""

    # There are n unknowns, scaled to 0..1 between their bounds, and S inputs.

    # (S, n): change for one standard uncertainty of each input.
    sizes: Array
    # (n,): change from the optimum between the bounds to the optimum without bounds, reduced if it is large.
    without_bounds: Array


# Largest distance of the optimum without bounds from a bound, in standard deviations of noise and sources. A longer
# distance is due to the law and not to noise or sources, and is reduced to this distance.
_FARTHEST = 2.0


def steps_of(about: Linearisation, sources: Sequence[ConsideredInput], covariance: Array) -> Steps:
    """Compute how errors of uncertain inputs change the fitted values."""
    # covariance (n, n): of the unknowns, due to noise and priors.
    # The covariance of the estimate grows by the sum of the products of the changes (Tapley, Schutz and Born 2004,
    # Statistical Orbit Determination, section 6.3).
    sizes, n = np.zeros((len(sources), len(about.unit))), len(about.unit)
    for i, source in enumerate(sources):
        score = np.zeros(n)
        for states, change in zip(about.states, source.changes, strict=True):
            if change is not None:
                score += states.score(change)
        sizes[i] = -np.linalg.solve(about.hessian, score)
    outward = ((about.unit <= 0.0) & (about.score > 0)) | ((about.unit >= 1.0) & (about.score < 0))
    # The optimum without bounds is the better centre of the intervals, because its distribution is normal about the
    # true value.
    without_bounds = -np.linalg.solve(about.hessian, np.where(outward, about.score, 0.0))
    spread = np.sqrt(np.diag(covariance) + (sizes**2).sum(axis=0))
    farthest = (np.abs(without_bounds) / spread)[outward].max(initial=_FARTHEST)
    share = _FARTHEST / farthest if sources else 0.0
    return Steps(sizes, np.asarray(share * without_bounds))
