"""Compute the effect of uncertain inputs on the residuals and on the optimum of a fit.

An uncertain input, such as the width, has a standard uncertainty that a file specifies. An input that is not fitted
together with the law keeps its specified value in the fit, and an error of this value changes the optimum. Let c_s be
the change of the residuals for an error of input s of one standard uncertainty, J the derivatives of the residuals in
the unknowns, W the weights of the residuals, and H the Hessian (`inference.interval.covariance`). The optimum changes
by

    d_s = -inv(H) J' W c_s

and the covariance of the estimate grows by the sum of d_s d_s' over all these inputs (consider covariance: Schmidt
1966, Adv. Control Syst. 3:293; Tapley, Schutz and Born 2004, Statistical Orbit Determination, section 6.3).

The changes c_s are finite differences at the optimum, computed with the planar model on the coarse mesh of the search.
Because one standard uncertainty changes the shapes of the beam only a little, the solver starts from the shapes for the
specified values of the inputs.
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
from eimi_fitting.inference.evidence.sources import SOURCES, specimen_under
from eimi_fitting.inference.evidence.unknowns import Nuisance, Setup, SharedUnknowns, shared
from eimi_fitting.inference.interval.covariance import Linearisation
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

# Steps of the finite differences, in standard uncertainties. Within one standard uncertainty the response is linear to
# a per cent. The second and third steps are tried if the model finds no equilibrium for the first.
_STEPS = (0.5, -0.5, 0.05)
_TOLERANCE_MM = 1e-3  # the last Newton step is shorter; the remaining error is far below the smallest relevant change


@dataclass(frozen=True)
class ConsideredSources:
    """One component of an uncertain input, such as x of the clamp, and the change of the residuals by an error of it.

    Parameters
    ----------
    name : str
        Name of the component in a result.
    shared : SharedUnknowns
        The input, its standard uncertainty, and the datasets with the same error of the input.
    part : int
        Index of the component, such as 1 for y; 0 if the input has only one.
    changes : tuple of ndarray or None
        For each experiment, the change of the residuals in mm for one standard uncertainty, shape (K, G, m): m points
        on each of G edges (or in x and y) in K load cases. None if the input does not belong to the experiment, or if
        the solver finds no equilibrium.
    """

    name: str
    shared: SharedUnknowns
    part: int
    changes: tuple[Array | None, ...]

    @property
    def standard_uncertainty(self) -> float:
        """The standard uncertainty of the input, in the unit of the input."""
        return self.shared.standard_uncertainty or 0.0

    @property
    def freed(self) -> Nuisance:
        """The component as an unknown of a fit, with its standard uncertainty as standard deviation of the prior."""
        return Nuisance(self.name, self.shared.source, self.part, self.shared.datasets, self.standard_uncertainty)


def sources_of(problem: Problem) -> tuple[SharedUnknowns, ...]:
    """Return the inputs with a specified uncertainty that are not fitted together with the law.

    Their uncertainties widen the intervals of the result. An input with the same effect as a fitted input is omitted.
    """
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
    """Return important inputs for which no file specifies an uncertainty, each with its usual uncertainty.

    The intervals of the result do not contain the effect of these inputs; it is reported separately.
    """
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
    """Return whether an error of the input can have an effect: it changes the specimen, and a magnetic field acts."""
    before = experiment.model.specimen
    changed = specimen_under(before, {source: np.full(len(SOURCES[source].parts), SOURCES[source].usual)})
    return changed != before and bool(experiment.loads.field_T.any())


def considered(
    problem: Problem, unit: Array, groups: Sequence[SharedUnknowns] | None = None
) -> tuple[ConsideredSources, ...]:
    """Return the change of the residuals of a fit by the uncertainty of each input, such as the width.

    Parameters
    ----------
    problem : Problem
        The law, the unknowns and the measurements of the fit.
    unit : ndarray, shape (n,)
        Fitted values of the n unknowns, scaled so that the bounds of the search are 0 and 1.
    groups : sequence of SharedUnknowns, optional
        The uncertain inputs; by default all with a specified uncertainty that are not fitted together with the law.

    Returns
    -------
    tuple of ConsideredSources
        One for each component of an input whose effect could be computed in at least one experiment.
    """
    chosen = sources_of(problem) if groups is None else groups
    numbers = [(group, part) for group in chosen for part in range(len(SOURCES[group.source].parts))]
    if not numbers:
        return ()
    changes = changes_of(problem, unit, numbers)
    uncertain_numbers = (
        ConsideredSources(
            group.part_name(part, len(changes)), group, part, tuple(of_experiment[i] for of_experiment in changes)
        )
        for i, (group, part) in enumerate(numbers)
    )
    return tuple(number for number in uncertain_numbers if any(change is not None for change in number.changes))


def changes_of(
    problem: Problem, unit: Array, numbers: Sequence[tuple[SharedUnknowns, int]]
) -> list[list[Array | None]]:
    """Return the changes of the residuals if one input at a time deviates by its standard uncertainty.

    Parameters
    ----------
    problem : Problem
        The law, the unknowns and the measurements of the fit.
    unit : ndarray, shape (n,)
        Values of the n unknowns, scaled so that the bounds of the search are 0 and 1.
    numbers : sequence of (SharedUnknowns, int)
        For each deviation, an uncertain input and the index of the component that deviates, such as 1 for y.

    Returns
    -------
    list of list
        One list for each experiment, with one element for each deviation: the change of the residuals in mm, shape (K,
        G, m), for m points on each of G edges (or in x and y) in K load cases. None if the input does not belong to the
        experiment, or if the solver finds no equilibrium.
    """
    return [_changes(problem, unit, index, numbers) for index in range(len(problem.experiments))]


def _changes(
    problem: Problem, unit: Array, index: int, numbers: Sequence[tuple[SharedUnknowns, int]]
) -> list[Array | None]:
    """Return the changes of the residuals of one experiment if one input at a time deviates by its uncertainty."""
    # A fitted input deviates from its fitted value, and any other input from its stated value.
    freed = [
        (n.source, n.part, float(n.value(unit[column])))
        for column, n in enumerate(problem.unknowns.freed, problem.unknowns.searched)
        if index in n.datasets
    ]
    (_, reshaped), *_ = problem.unknowns.bent(unit[None], len(problem.experiments))
    (_, seen), *_ = problem.unknowns.seen(unit[None], len(problem.experiments))
    candidate = Candidate(
        problem.law, problem.unknowns.parameters(unit[None]), problem.unknowns.bulk_modulus_Pa(unit[None]), tuple(freed)
    )
    concerned = [(i, number) for i, number in enumerate(numbers) if index in number[0].datasets]
    sizes = [(group.source, part, group.standard_uncertainty or 0.0) for _, (group, part) in concerned]
    changes: list[Array | None] = [None] * len(numbers)
    concerned_changes = changes_by(candidate, problem.experiments[index].under(reshaped[index] | seen[index]), sizes)
    for (i, _), change in zip(concerned, concerned_changes, strict=True):
        changes[i] = change
    return changes


@dataclass(frozen=True)
class Candidate:
    """Values of the parameters of a law and of the inputs that are fitted with it, for one simulation.

    Parameters
    ----------
    law : Law
        The hyperelastic law.
    parameters : ndarray, shape (1, n)
        The n parameters of the law.
    bulk_modulus_Pa : ndarray, shape (1,), or None
        The bulk modulus in Pa; None for an incompressible material.
    freed : tuple of (str, int, float)
        For each fitted input: its name, the index of a component (such as 1 for y), and the deviation of this component
        from the specified value in the unit of the input.
    """

    law: Law
    parameters: Array
    bulk_modulus_Pa: Array | None = None
    freed: tuple[tuple[str, int, float], ...] = ()


@lru_cache(maxsize=8)
def coarse_model(specimen: Specimen) -> BeamModel:
    """Return a planar beam model of a specimen with few elements, for fast simulation."""
    return BeamModel(specimen, plane=specimen.planar_section)


def changes_by(
    candidate: Candidate,
    experiment: Experiment,
    numbers: Sequence[tuple[str, int, float]],
    near: Configuration | None = None,
) -> list[Array | None]:
    """Return the change of the residuals for each of several errors of inputs.

    Parameters
    ----------
    candidate : Candidate
        The values of the law's parameters and of the inputs fitted with the law.
    experiment : Experiment
        The experiment. Its beam is simulated with a planar model of few elements.
    numbers : sequence of (str, int, float)
        For each error: the name of the input, the index of the component (such as 1 for y), and the error in the unit
        of the input.
    near : Configuration, optional
        Shapes of the beam from which the solver starts, one for each load case.

    Returns
    -------
    list of ndarray or None
        For each error, the change of the residuals in mm, shape (K, G, m), for m points on each of G edges (or in x and
        y) in K load cases. None if the solver finds no equilibrium.
    """
    experiment = replace(experiment, model=coarse_model(experiment.model.specimen), solid=None, change=None)
    as_stated = Setup.of(candidate.freed, 1)
    stated_shapes = _bent(candidate, experiment, as_stated, near)
    if not _in_equilibrium(stated_shapes):
        return [None] * len(numbers)
    residuals = experiment.observed.misfit(experiment.model, stated_shapes, as_stated).residuals[0]

    def change(key: str, part: int, size: float) -> Array | None:
        source = SOURCES[key]
        for step in _STEPS:
            deviation = step * size * np.eye(len(source.parts))[part]
            deviated = experiment.under({key: deviation}) if source.bends else experiment
            setup = Setup.of([*candidate.freed, (key, part, step * size)], 1)
            shapes = _bent(candidate, deviated, setup, stated_shapes.every) if source.changes_shapes else stated_shapes
            if _in_equilibrium(shapes):
                misfit = deviated.observed.misfit(deviated.model, shapes, setup)
                return np.asarray(misfit.residuals[0] - residuals) / step
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
    """Changes of the fitted values of n unknowns: by errors of S inputs, and by removing the bounds of the search.

    Parameters
    ----------
    sizes : ndarray, shape (S, n)
        Change of the fitted values for an error of each input of one standard uncertainty. The values are scaled so
        that the bounds of the search are 0 and 1.
    held : ndarray, shape (n,)
        Change of the fitted values if the bounds of the search were removed, scaled in the same way. It is reduced so
        that no unknown moves by more than two standard deviations beyond its bound. Zero if no unknown lies on a bound,
        or if S = 0.
    """

    sizes: Array
    held: Array


# Largest distance of the optimum without bounds from a bound, in standard deviations of noise and sources. A longer
# distance is due to the law and not to noise or sources, and is reduced to this distance.
_FARTHEST = 2.0


def steps_of(about: Linearisation, sources: Sequence[ConsideredSources], covariance: Array) -> Steps:
    """Return changes of the fitted values of the unknowns: by errors of inputs, and by removing the search's bounds.

    Parameters
    ----------
    about : Linearisation
        The residuals as linear functions of the n unknowns.
    sources : sequence of ConsideredSources
        S uncertain inputs, or components of inputs such as x and y of the clamp.
    covariance : ndarray, shape (n, n)
        Covariance of the unknowns due to noise and priors.

    Returns
    -------
    Steps
        The changes.
    """
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
    held = -np.linalg.solve(about.hessian, np.where(outward, about.score, 0.0))
    spread = np.sqrt(np.diag(covariance) + (sizes**2).sum(axis=0))
    farthest = (np.abs(held) / spread)[outward].max(initial=_FARTHEST)
    share = _FARTHEST / farthest if sources else 0.0
    return Steps(sizes, np.asarray(share * held))
