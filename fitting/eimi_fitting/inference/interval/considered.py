"""Compute the effect of the uncertainties of inputs on the residuals and on the optimum of a fit.

A source is an input with a standard uncertainty that a file specifies. A source that is not freed (determined by the
fit) keeps its stated value in the fit, and an error of this value changes the optimum. Let c_s be the change of the
residuals for one standard uncertainty of source s, J the derivatives of the residuals in the unknowns, W the weights of
the residuals, and H the Hessian (`inference.interval.covariance`). The optimum changes by

    d_s = -inv(H) J' W c_s

and the covariance of the estimate grows by the sum of d_s d_s' over all sources (consider covariance: Schmidt 1966,
Adv. Control Syst. 3:293; Tapley, Schutz and Born 2004, Statistical Orbit Determination, section 6.3).

The changes c_s are finite differences at the optimum, computed with the planar model on the coarse mesh of the search.
One standard uncertainty changes the shapes of the beam only a little. The solver therefore starts from the shapes for
the stated values of the sources.
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
    """An uncertain number, and the change of the residuals for one standard uncertainty of this number.

    Parameters
    ----------
    name : str
        Name of the number in a result.
    shared : SharedUnknowns
        The source of the number, and the datasets that share its error.
    part : int
        Index of the number among the parts of its source.
    changes : tuple of ndarray or None
        For each experiment, the change of the residuals in mm, with the shape (K, G, m) for G groups (edges, or x and
        y) of m points in K states. None if the number does not belong to the experiment or the model finds no
        equilibrium.
    """

    name: str
    shared: SharedUnknowns
    part: int
    changes: tuple[Array | None, ...]

    @property
    def standard_uncertainty(self) -> float:
        """The standard uncertainty of the uncertain number, such as a width, in the unit of the number; above zero."""
        return self.shared.standard_uncertainty or 0.0

    @property
    def freed(self) -> Nuisance:
        """The uncertain number, such as a width, as an unknown that a fit could determine.

        Its standard uncertainty is the standard deviation of its prior.
        """
        return Nuisance(self.name, self.shared.source, self.part, self.shared.datasets, self.standard_uncertainty)


def sources_of(problem: Problem) -> tuple[SharedUnknowns, ...]:
    """Return the uncertain inputs that keep their stated values in a fit, although files state an uncertainty.

    Such inputs widen the intervals. An input that the fit determines together with the law (a freed input) is left out,
    and so is an input with the same effect as a freed input.
    """
    freed = {nuisance.source for nuisance in problem.unknowns.freed}
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
    """Return important sources of uncertainty that no file specifies, with their usual uncertainty.

    An important source (``Source.is_decisive``) is an input whose usual error changes the modulus much, such as the
    direction of magnetisation. A source is returned if the fit does not determine it, if a deviation of it changes the
    model of the specimen, and if a magnetic field acts in at least one state.
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
    """Return whether an error of the uncertain input ``source`` can matter in an experiment with a magnetic field.

    It can matter if it changes the model of the specimen. For example, the direction of magnetisation is not in the
    model of a specimen without a magnet. The result is False if no field acts in any state.
    """
    before = experiment.model.specimen
    changed = specimen_under(before, {source: np.full(len(SOURCES[source].parts), SOURCES[source].usual)})
    return changed != before and bool(experiment.loads.field_T.any())


def considered(
    problem: Problem, unit: Array, groups: Sequence[SharedUnknowns] | None = None
) -> tuple[ConsideredSources, ...]:
    """Return the effect of each source of uncertainty on the residuals at an optimum.

    Parameters
    ----------
    problem : Problem
        The law, the unknowns and the measurements of the fit.
    unit : ndarray, shape (n,)
        The optimum in unit coordinates (0 to 1).
    groups : sequence of SharedUnknowns, optional
        The sources of uncertainty (uncertain inputs) whose effect is computed; by default the result of `sources_of`.

    Returns
    -------
    tuple of ConsideredSources
        One for each uncertain number for which the model finds an equilibrium in at least one experiment.
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
    """Return the changes of the residuals when one uncertain number at a time deviates by its standard uncertainty.

    A source is an uncertain input, such as the position of the clamp. Its uncertain numbers are its parts, such as x
    and y.

    Parameters
    ----------
    problem : Problem
        The law, the unknowns and the measurements of the fit.
    unit : ndarray, shape (n,)
        The values of the n unknowns at which the residuals are computed, in unit coordinates (0 to 1). If the fit
        determines a number, its deviation is added to its value in ``unit``; otherwise it is added to the stated
        value.
    numbers : sequence of (SharedUnknowns, int)
        Each uncertain number, as a source and the index of a part of this source.

    Returns
    -------
    list of list
        One list for each experiment, with one entry for each number: the change of the residuals in mm, with the shape
        (K, G, m) for G groups (edges, or x and y) of m points in K states. None if the number does not belong to the
        experiment or the model finds no equilibrium.
    """
    return [_changes(problem, unit, index, numbers) for index in range(len(problem.experiments))]


def _changes(
    problem: Problem, unit: Array, index: int, numbers: Sequence[tuple[SharedUnknowns, int]]
) -> list[Array | None]:
    """Return the changes of the residuals of one experiment in mm if one uncertain number deviates by its uncertainty.

    ``index`` is the index of the experiment. ``numbers`` has the uncertain numbers: each belongs to an uncertain input,
    such as the position of the clamp, and has an index among the parts of this input, such as x and y. The result has
    one change for each number. It is None if the number does not belong to the experiment or the model finds no
    equilibrium.
    """
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
    """One candidate of a fit: a hyperelastic law with n parameters, and the deviations of the freed nuisances.

    A freed nuisance is an uncertain input that the fit determines together with the law.

    Parameters
    ----------
    law : Law
        The hyperelastic law.
    parameters : ndarray, shape (1, n)
        The n parameters of the law.
    bulk_modulus_Pa : ndarray, shape (1,), or None
        The bulk modulus in Pa; None for an incompressible material.
    freed : tuple of (str, int, float)
        For each freed number: the name of its input (a key of `SOURCES`), its index among the parts of the input, such
        as x and y, and its deviation in the unit of the input.
    """

    law: Law
    parameters: Array
    bulk_modulus_Pa: Array | None = None
    freed: tuple[tuple[str, int, float], ...] = ()


@lru_cache(maxsize=8)
def coarse_model(specimen: Specimen) -> BeamModel:
    """Return the planar model of a specimen on the coarse mesh (few elements), for fast finite differences."""
    return BeamModel(specimen, plane=specimen.planar_section)


def changes_by(
    candidate: Candidate,
    experiment: Experiment,
    numbers: Sequence[tuple[str, int, float]],
    near: Configuration | None = None,
) -> list[Array | None]:
    """Return the change of the residuals of a candidate for each deviation of an input, by finite differences.

    Parameters
    ----------
    candidate : Candidate
        The law and the inputs for which the beam is simulated.
    experiment : Experiment
        The experiment. Its model is replaced by the planar model on the coarse mesh of the search.
    numbers : sequence of (str, int, float)
        For each deviation, its source, its index among the parts of the source, and its size in the unit of the source.
    near : Configuration, optional
        Shapes of the beam near the solution, one for each state, from which the solver starts.

    Returns
    -------
    list of ndarray or None
        For each deviation, the change of the residuals in mm, with the shape (K, G, m) for G groups (edges, or x and y)
        of m points in K states. None if the model finds no equilibrium.
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
    """The changes of an optimum of n unknowns by S sources of uncertainty (uncertain inputs).

    Parameters
    ----------
    sizes : ndarray, shape (S, n)
        Change for one standard uncertainty of each source, in unit coordinates (the bounds of the search are 0 and 1).
    held : ndarray, shape (n,)
        The change of the optimum if the search had no bounds, in unit coordinates, but at most two standard deviations
        of an unknown that lies on a bound. Zero if no unknown lies on a bound, or if there is no source.
    """

    sizes: Array
    held: Array


# Largest distance of the optimum without bounds from a bound, in standard deviations of noise and sources. A longer
# distance is due to the law and not to noise or sources, and is reduced to this distance.
_FARTHEST = 2.0


def steps_of(about: Linearisation, sources: Sequence[ConsideredSources], covariance: Array) -> Steps:
    """Return the change of the optimum for one standard uncertainty of each uncertain input (source).

    Let c_s be the change of the residuals for one standard uncertainty of source s, J the derivatives of the residuals
    in the unknowns, W the weights of the residuals, and H the Hessian (``Linearisation.hessian``). Without bounds on
    the unknowns, the optimum changes by

        d_s = -inv(H) J' W c_s.

    Parameters
    ----------
    about : Linearisation
        The evidence (edges, tensile curves, priors) linearised about the optimum.
    sources : sequence of ConsideredSources
        The S uncertain numbers.
    covariance : ndarray, shape (n, n)
        Covariance of the optimum due to noise and priors.

    Returns
    -------
    Steps
        The changes d_s, and the distance to the optimum without bounds.

    Notes
    -----
    An error of an input may move an unknown to a bound of the search. The optimum without bounds is then the better
    centre of the intervals, because its distribution is normal about the true value. ``Steps.held`` leads to this
    centre, but at most two standard deviations beyond the bound.
    """
    sizes, n = np.zeros((len(sources), len(about.unit))), len(about.unit)
    for i, source in enumerate(sources):
        score = np.zeros(n)
        for states, change in zip(about.states, source.changes, strict=True):
            if change is not None:
                score += states.score(change)
        sizes[i] = -np.linalg.solve(about.hessian, score)
    outward = ((about.unit <= 0.0) & (about.score > 0)) | ((about.unit >= 1.0) & (about.score < 0))
    held = -np.linalg.solve(about.hessian, np.where(outward, about.score, 0.0))
    spread = np.sqrt(np.diag(covariance) + (sizes**2).sum(axis=0))
    farthest = (np.abs(held) / spread)[outward].max(initial=_FARTHEST)
    share = _FARTHEST / farthest if sources else 0.0
    return Steps(sizes, np.asarray(share * held))
