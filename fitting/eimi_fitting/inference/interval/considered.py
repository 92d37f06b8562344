"""What stated uncertainties do to the residuals, and through them to the estimate (consider covariance).

A source that is not freed keeps its stated value in the fit, and its error moves the optimum: by the step that a change
of the residuals of one standard uncertainty asks for. With the sensitivities S of the estimate and the uncertainties u,
the covariance of noise and priors grows by S diag(u^2) S' (Schmidt 1966, Adv. Control Syst. 3:293; Tapley, Schutz and
Born 2004, Statistical Orbit Determination, section 6.3). The residuals' derivatives are differences of the planar model
on the coarse mesh at the optimum. A source bends the beam a little only: all states are sought at once from where the
beam stands as stated.
"""

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
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import Nuisance, Setup, SharedUnknowns, shared
from eimi_fitting.inference.interval.covariance import Linearisation
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

# Of the standard uncertainty: within one the beam answers in proportion, to a per cent. The others are for what has no
# equilibrium one way.
_STEPS = (0.5, -0.5, 0.05)
_TOLERANCE_MM = 1e-3  # of the last Newton step: what it leaves is far below the smallest change that counts


@dataclass(frozen=True)
class ConsideredSources:
    """One number that is uncertain: a part of a source, and what one standard uncertainty of it does.

    name: in a result; part: of its source; changes: of the residuals of each experiment, (K, G, m) mm, None where it is
    not concerned.
    """

    name: str
    shared: SharedUnknowns
    part: int
    changes: tuple[Array | None, ...]

    @property
    def standard_uncertainty(self) -> float:
        """In its source's unit; above zero."""
        return self.shared.standard_uncertainty or 0.0

    @property
    def freed(self) -> Nuisance:
        """The same number as an unknown of a fit."""
        return Nuisance(self.name, self.shared.source, self.part, self.shared.datasets, self.standard_uncertainty)


def sources_of(problem: Problem) -> tuple[SharedUnknowns, ...]:
    """What the experiments state as uncertain, is not freed, and is not counted by what is freed."""
    freed = {nuisance.source for nuisance in problem.unknowns.freed}
    counted = freed.union(*(SOURCES[source].covers for source in freed))
    stated = [experiment.stated for experiment in problem.experiments]
    return tuple(
        group
        for source in SOURCES
        if source not in counted
        for group in shared(source, stated)
        if group.standard_uncertainty
    )


def considered(problem: Problem, unit: Array) -> tuple[ConsideredSources, ...]:
    """What each stated source does to the residuals at an optimum ``unit`` (n,).

    A source whose deviations leave no equilibrium is left out; `sources_of` has it all the same.
    """
    numbers = [(group, part) for group in sources_of(problem) for part in range(len(SOURCES[group.source].parts))]
    if not numbers:
        return ()
    changes = changes_of(problem, unit, numbers)
    every = (
        ConsideredSources(group.part_name(part, len(changes)), group, part, tuple(own[i] for own in changes))
        for i, (group, part) in enumerate(numbers)
    )
    return tuple(c for c in every if any(change is not None for change in c.changes))


def changes_of(
    problem: Problem, unit: Array, numbers: Sequence[tuple[SharedUnknowns, int]]
) -> list[list[Array | None]]:
    """Of each experiment for each (source, part) the change of the residuals (K, G, m) mm at ``unit`` (n,).

    For one standard uncertainty more, from where the source is there if it is freed; None where it is not concerned.
    """
    return [_changes(problem, unit, index, numbers) for index in range(len(problem.experiments))]


def _changes(
    problem: Problem, unit: Array, index: int, numbers: Sequence[tuple[SharedUnknowns, int]]
) -> list[Array | None]:
    """Of one experiment."""
    freed = [
        (n.source, n.part, float(n.value(unit[column])))
        for column, n in enumerate(problem.unknowns.freed, problem.unknowns.searched)
        if index in n.datasets
    ]
    (_, deviations), *_ = problem.unknowns.bent(unit[None], len(problem.experiments))
    candidate = Candidate(
        problem.law, problem.unknowns.parameters(unit[None]), problem.unknowns.bulk_modulus_Pa(unit[None]), tuple(freed)
    )
    own = [(i, number) for i, number in enumerate(numbers) if index in number[0].datasets]
    sizes = [(group.source, part, group.standard_uncertainty or 0.0) for _, (group, part) in own]
    found: list[Array | None] = [None] * len(numbers)
    changes = changes_by(candidate, problem.experiments[index].under(deviations[index]), sizes)
    for (i, _), change in zip(own, changes, strict=True):
        found[i] = change
    return found


@dataclass(frozen=True)
class Candidate:
    """One candidate: a law with parameters (1, n), perhaps a bulk modulus (1,), and (source, part, deviation) freed."""

    law: Law
    parameters: Array
    bulk_modulus_Pa: Array | None = None
    freed: tuple[tuple[str, int, float], ...] = ()


@lru_cache(maxsize=8)
def coarse_model(specimen: Specimen) -> BeamModel:
    """On which differences between candidates are computed."""
    return BeamModel(specimen, plane=specimen.planar_section)


def changes_by(
    candidate: Candidate,
    experiment: Experiment,
    numbers: Sequence[tuple[str, int, float]],
    near: Configuration | None = None,
) -> list[Array | None]:
    """(K, G, m) mm: what deviations of (source, part, size) change in a candidate's residuals.

    By differences of the planar model on the coarse mesh; None where that finds no equilibrium. near: where the beam
    stands there, or nearly so, a row a state.
    """
    experiment = replace(experiment, model=coarse_model(experiment.model.specimen), solid=None, change=None)
    as_stated = Setup.of(candidate.freed, 1)
    here = _bent(candidate, experiment, as_stated, near)
    if not _in_equilibrium(here):
        return [None] * len(numbers)
    residuals = experiment.observed.misfit(experiment.model, here, as_stated).residuals[0]

    def change(key: str, part: int, size: float) -> Array | None:
        source = SOURCES[key]
        for step in _STEPS:
            deviation = step * size * np.eye(len(source.parts))[part]
            other = experiment.under({key: deviation}) if source.bends else experiment
            setup = Setup.of([*candidate.freed, (key, part, step * size)], 1)
            there = _bent(candidate, other, setup, here.every) if source.bends or source.field else here
            if _in_equilibrium(there):
                return np.asarray(other.observed.misfit(other.model, there, setup).residuals[0] - residuals) / step
        return None

    return [change(*number) for number in numbers]


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
    """How sources move an optimum: sizes (S, n) for one standard uncertainty more; held (n,): from a bound to where the
    optimum would be without it.
    """

    sizes: Array
    held: Array


# Standard deviations of noise and sources: an optimum that would be farther beyond a bound is so for the law's sake.
_FARTHEST = 2.0


def steps_of(about: Linearisation, sources: Sequence[ConsideredSources], covariance: Array) -> Steps:
    """What each source does to an optimum with the covariance (n, n) of its noise.

    As if the law had no bounds: where one holds the optimum, the sources may have brought it there from inside, and the
    steps that it lets them take from there are not those that they took. Least squares without bounds is free of bias
    and normal; so the optimum without them is what intervals are about, as far as noise and sources can have moved it.
    """
    sizes, n = np.zeros((len(sources), len(about.unit))), len(about.unit)
    for i, source in enumerate(sources):
        score = np.zeros(n)
        for own, change in zip(about.states, source.changes, strict=True):
            if change is not None:
                score += own.score(change)
        sizes[i] = -np.linalg.solve(about.hessian, score)
    outward = ((about.unit <= 0.0) & (about.score > 0)) | ((about.unit >= 1.0) & (about.score < 0))
    held = -np.linalg.solve(about.hessian, np.where(outward, about.score, 0.0))
    far = (np.abs(held) / np.sqrt(np.diag(covariance) + (sizes**2).sum(axis=0)))[outward].max(initial=_FARTHEST)
    share = _FARTHEST / far if sources else 0.0
    return Steps(sizes, np.asarray(share * held))
