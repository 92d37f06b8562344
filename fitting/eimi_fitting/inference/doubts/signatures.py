"""Compute how each systematic error, such as a wrong scale, changes the residuals of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.equilibrium import Configuration, Status
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.beam.outline import outline
from eimi_fitting.beam.strip import ImpossibleShape
from eimi_fitting.inference.doubts.possible_causes import Assumed, PossibleCause
from eimi_fitting.inference.evidence.experiment import TOLERANCE_MM, Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import shared
from eimi_fitting.inference.interval.considered import coarse_model
from eimi_fitting.inference.interval.covariance import linearise
from eimi_fitting.inference.searching.polish import Optimum

Array = NDArray[np.float64]

_STEP = 0.3  # of the finite differences, in prior sizes
_ACCURACY_MM = 1e-3  # the last Newton step is shorter
_SEEN_MM = 1e-4  # a smaller change of the residuals by one prior size counts as no change
# Distances from clamp and tip within which points of an edge are not used, as shares of the length of the beam. A scale
# that is wrong by three usual sizes moves points by 0.03 of the length at the tip; the clamp is misplaced by 0.3 mm.
_CLAMP, _TIP = 0.01, 0.03
_NEAR = 5.0  # multiple of these distances from the end; other points may lie in the same direction in a bent beam
_ALONG, _ACROSS = 13, 1  # elements of the solid beside a planar section


@dataclass(frozen=True)
class Column:
    """The change of the residuals by one component of a systematic error, such as the x of a shift."""

    # Index of the component.
    part: int
    # Indices of the datasets with the error.
    datasets: tuple[int, ...]
    # Prior standard deviation of the component.
    size: float
    # Value of the component in the fit.
    start: float
    # (K, 2, m) for each experiment: change of the residuals in mm per unit of the component, in K load cases, at m
    # points of the two edges.
    changes: tuple[Array | None, ...]


@dataclass(frozen=True)
class Solved:
    """A simulated beam, with its residuals in mm."""

    assumed: Assumed
    # The experiment in which the inputs, such as the width, have the assumed values.
    bent: Experiment
    shapes: Shapes
    residuals: Array

    @staticmethod
    def of(assumed: Assumed, before: Solved | None = None) -> Solved | None:
        """Simulate the beam and compute its residuals, or return None if the simulation fails."""
        # The simulation starts from `before`, the result for similar assumptions. It fails without an equilibrium, and
        # for an impossible specimen.
        try:
            return Solved._of(assumed, before)
        except ValueError:
            return None

    @staticmethod
    def _of(assumed: Assumed, before: Solved | None) -> Solved | None:
        bent, setup = assumed.with_errors, assumed.setup
        if before is not None and _bends_alike(assumed, bent, before):
            shapes = before.shapes
        else:
            has_same_mesh = before is not None and bent.model.mesh.nodes.shape == before.bent.model.mesh.nodes.shape
            near: Configuration | None = before.shapes.every if before and has_same_mesh else None
            shapes = bent.model.solve(
                assumed.law,
                assumed.parameters,
                bent.loads,
                tolerance_mm=_ACCURACY_MM,
                bulk_modulus_Pa=assumed.bulk_modulus_Pa,
                field_factor=setup.field_factor,
                keep=True,
                near=near,
            )
        if not np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all():
            return None
        return Solved(assumed, bent, shapes, bent.observed.misfit(bent.model, shapes, setup).residuals[0])

    def between_ends(self) -> Array:
        """Return weights of the edge points: 0 near the clamp and the tip, and 1 elsewhere."""
        observed = self.bent.observed
        if not isinstance(observed, EdgeObservation):
            return np.ones(())
        curves = outline(self.bent.model, self.shapes, observed.view)[0]
        points = self.assumed.setup.corrected(observed.points_mm)[0]
        is_between = np.ones(points.shape[:-1], bool)
        clamp, tip = curves[..., 0, :, :], curves[..., -1, :, :]
        for inner, end, share in ((clamp[..., 1, :], clamp[..., 0, :], _CLAMP), (tip[..., 1, :], tip[..., 2, :], _TIP)):
            # A small error may place a point near an end beyond it, where the distance from the edge is not smooth.
            margin_mm = share * self.bent.model.specimen.length_mm
            outward = (end - inner) / np.linalg.norm(end - inner, axis=-1, keepdims=True)
            from_end = points - end[..., None, :]
            is_near = np.linalg.norm(from_end, axis=-1) < _NEAR * margin_mm
            is_between &= ~(is_near & ((from_end * outward[..., None, :]).sum(axis=-1) > -margin_mm))
        return is_between.astype(float)


def _bends_alike(assumed: Assumed, bent: Experiment, before: Solved) -> bool:
    earlier = before.assumed
    return (
        bent.model is before.bent.model
        and bent.loads is before.bent.loads
        and assumed.law is earlier.law
        and np.array_equal(assumed.parameters, earlier.parameters)
        and bool((assumed.setup.field_factor == earlier.setup.field_factor).all())
    )


@dataclass(frozen=True)
class LinearisedFit:
    """The optimum of a fit, with the derivatives of its residuals by the unknowns."""

    problem: Problem
    # (n,): the optimum of the n unknowns, scaled to 0..1.
    unit: Array
    # (l,): indices of the l unknowns that are no systematic errors, and (l,): their prior standard deviations.
    kept: NDArray[np.intp]
    law_spread: Array
    # (l, K, 2, m) for each experiment: derivatives of the residuals in mm, in K load cases, at m points of the two
    # edges.
    slopes: tuple[Array, ...]
    # (K, 2, m) for each experiment: residuals at the optimum in mm.
    residuals: tuple[Array, ...]
    # (K, 2, m): weights of the points in the comparison of systematic errors; zero near clamp and tip.
    used: tuple[Array, ...]
    # (K, 2, m): weights of the points in root mean square residuals.
    in_error: tuple[Array, ...]
    # The simulation of each experiment at the optimum.
    solved: tuple[Solved, ...]
    # (l, l): Hessian of minus the log-likelihood of the fit in these unknowns, with tensile curves and all priors.
    hessian: Array
    # (K,) for each experiment: weights of the squared residuals of the load cases in this Hessian, in 1/mm^2.
    weights: tuple[Array, ...]

    @staticmethod
    def of(problem: Problem, optimum: Optimum[Evaluation], causes: Sequence[PossibleCause]) -> LinearisedFit:
        """Simulate the optimum of a fit, and linearise its residuals in the unknowns that are not in `causes`."""
        linear, sources = linearise(problem, optimum), {cause.source for cause in causes}
        freed = problem.unknowns.freed
        is_kept = np.array([*[True] * problem.unknowns.searched, *(n.source not in sources for n in freed)])
        kept = np.flatnonzero(is_kept)
        solved = [
            Solved.of(_assumed(problem, optimum.unit, i, coarse_model(experiment.model.specimen)))
            for i, experiment in enumerate(problem.experiments)
        ]
        complete = tuple(one for one in solved if one is not None)
        return LinearisedFit(
            problem,
            optimum.unit,
            kept,
            1
            / np.sqrt(np.diag(linear.hessian - linear.information + linear.curve_slopes @ linear.curve_slopes.T)[kept]),
            tuple(states.slopes[kept] for states in linear.states),
            tuple(states.residuals for states in linear.states),
            tuple(
                states.used if one is None else states.used * one.between_ends()
                for states, one in zip(linear.states, solved, strict=True)
            ),
            tuple(states.used for states in linear.states),
            complete if len(complete) == len(solved) else (),  # empty if an experiment has no equilibrium
            linear.hessian[np.ix_(kept, kept)],
            tuple(states.weights for states in linear.states),
        )

    @cached_property
    def _on_mesh_of_fit(self) -> list[Solved | None]:
        return [
            Solved.of(_assumed(self.problem, self.unit, i, experiment.model))
            for i, experiment in enumerate(self.problem.experiments)
        ]

    def known_error(self, cause: PossibleCause, part: int, dataset: int) -> float:
        """Return the known error of an input's component: measured error plus fitted correction; 0 if not measured."""
        measured = self.problem.experiments[dataset].measured.get(cause.source, ())
        if not measured:
            return 0.0
        error = float(measured[part]) if part < len(measured) else 0.0
        return error + self.freed_start(cause.source, part, dataset)

    def freed_start(self, source: str, part: int, dataset: int) -> float:
        """Return the correction of an input's component, such as x of the clamp, by the fit; 0 if it was not fitted."""
        return sum(
            float(nuisance.value(self.unit[column]))
            for column, nuisance in enumerate(self.problem.unknowns.freed, self.problem.unknowns.searched)
            if (nuisance.source, nuisance.part) == (source, part) and dataset in nuisance.datasets
        )

    @staticmethod
    def is_seen(changes: Sequence[Array | None], size: float) -> bool:
        """Return whether an error of this size changes at least one residual by more than 0.0001 mm."""
        return any(change is not None and np.abs(size * change).max() > _SEEN_MM for change in changes)

    def simulated(
        self, moved: Array, amplitudes: Mapping[PossibleCause, Sequence[tuple[Column, float]]]
    ) -> list[Array] | None:
        """Simulate the residuals to the measured edges (mm) for changed unknowns and given systematic errors."""
        # moved (l,): changes of the unknowns `kept`. amplitudes: the components of each systematic error, with their
        # values.
        unit = self.unit.copy()
        unit[self.kept] = np.clip(unit[self.kept] + moved, 0.0, 1.0)
        residuals = []
        for i, (here, residual) in enumerate(zip(self._on_mesh_of_fit, self.residuals, strict=True)):
            if here is None:
                return None
            trial = _assumed(self.problem, unit, i, here.assumed.experiment.model)
            more = np.zeros_like(residual)
            for cause, columns in amplitudes.items():
                steps = np.zeros(len(cause.sizes))
                for column, amplitude in columns:
                    if i in column.datasets:
                        # The amplitude counts from the stated value, and the fit already contains the start.
                        steps[column.part] = amplitude - column.start
                        if cause.change is None and (change := column.changes[i]) is not None:
                            more += amplitude * change
                try:
                    trial = cause.change(trial, steps) if cause.change else trial
                except ImpossibleShape:
                    return None
            there = Solved.of(trial, here)
            if there is None:
                return None
            residuals.append(residual + more + there.residuals - here.residuals)
        return residuals


def _assumed(problem: Problem, unit: Array, dataset: int, model: BeamModel) -> Assumed:
    # `unit` (n,) are the values of the unknowns, scaled to 0..1.
    experiment, unknowns = problem.experiments[dataset], problem.unknowns
    plain = replace(experiment, model=model, solid=None, solid_options=None, change=None)
    freed = tuple(
        (n.source, n.part, float(n.value(unit[column])))
        for column, n in enumerate(unknowns.freed, unknowns.searched)
        if dataset in n.datasets
    )
    return Assumed(problem.law, unknowns.parameters(unit[None]), unknowns.bulk_modulus_Pa(unit[None]), plain, freed)


def columns_of(fit: LinearisedFit, cause: PossibleCause) -> tuple[Column, ...]:
    """Compute how each component of a systematic error, such as the x of a shift, changes the residuals."""
    columns = []
    for datasets, uncertainty in _groups(fit.problem, cause):
        for part, usual in enumerate(cause.sizes):
            size = max(usual, uncertainty)
            changes = tuple(
                signature(fit.solved[i], cause, part, size) if i in datasets else None for i in range(len(fit.solved))
            )
            if fit.is_seen(changes, size):
                columns.append(Column(part, datasets, size, fit.known_error(cause, part, datasets[0]), changes))
    return tuple(columns)


def _groups(problem: Problem, cause: PossibleCause) -> list[tuple[tuple[int, ...], float]]:
    # The datasets with the same error, such as one wrong width, and its stated uncertainty or 0.
    every = tuple(range(len(problem.experiments)))
    if cause.is_common:
        return [(every, 0.0)]
    if cause.source not in SOURCES:
        return [((dataset,), 0.0) for dataset in every]
    groups = shared(cause.source, [experiment.stated for experiment in problem.experiments])
    return [(group.datasets, group.standard_uncertainty or 0.0) for group in groups]


def signature(here: Solved, cause: PossibleCause, part: int, size: float) -> Array | None:
    """Compute the derivative of the residuals (mm) by one component of a systematic error, by finite differences."""
    # `part` is the index of the component, such as 1 for the y of a shift, and `size` is its usual size.
    if cause.change is None:
        return _as_solid(here)
    sides = []
    for step in (_STEP, -_STEP):
        amplitudes = np.zeros(len(cause.sizes))
        amplitudes[part] = step * size
        there = Solved.of(cause.change(here.assumed, amplitudes), here)
        if there is not None:
            sides.append((there.residuals - here.residuals) / (step * size))
    return np.asarray(np.mean(sides, axis=0)) if sides else None


def _as_solid(here: Solved) -> Array | None:
    # The change of the residuals if a three-dimensional model replaces the planar one.
    specimen = here.bent.model.specimen
    if specimen.section == "solid":
        return None
    setup = here.assumed.setup
    try:
        beside = SolidBeside(replace(specimen, section="solid"), _ALONG, _ACROSS)
        shapes = beside.solve(
            here.assumed.law,
            here.assumed.parameters,
            here.bent.loads,
            tolerance_mm=TOLERANCE_MM,
            field_factor=setup.field_factor,
        )
    except ValueError:  # the solid does not support this specimen
        return None
    if not np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all():
        return None
    return np.asarray(here.bent.observed.misfit(beside, shapes, setup).residuals[0] - here.residuals)
