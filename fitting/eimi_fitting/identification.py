"""Evolutionary identification: CMA-ES searches the parameters whose simulated edges lie on the measured ones.

After Di Lecce et al. 2022 (Front. Robot. AI 8:790571); population, bounds and stop rules are this project's own.
The optimiser is Hansen's CMA-ES (arXiv:1604.00772) as implemented in the package cma.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cma
import numpy as np
from numpy.typing import NDArray

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel
from eimi_fitting.materials import LAWS, Law
from eimi_fitting.observation import Misfit, Observation
from eimi_fitting.polish import Polish, polish
from eimi_fitting.search_space import SEARCH_SPACES, SearchSpace
from eimi_fitting.solid import Status
from eimi_fitting.stability import LARGEST_STRETCH_CHECKED, stable_up_to
from eimi_fitting.uncertainty import Uncertainty, estimate_uncertainty

Array = NDArray[np.float64]

# Worse than any simulation can be, and finite: the optimiser would replace a NaN by the generation's median.
DISCARDED_MM = 1e6
# Of the change in the edges from the coarse mesh to the fine one, the share that finer meshes still add (measured in
# the modulus: 13 x 1 is off by 0.20 and 0.41 %, 26 x 3 by 0.02 and 0.07 %).
_LEFT_BY_REFINING = 1 / 6
_TOLERANCE_MM = 1e-2  # of the last Newton step: what is left is below 1e-4, and edges are good to 1e-3


@dataclass(frozen=True)
class Experiment:
    """One specimen in K states: its model, its loads and what was seen of it."""

    model: BeamModel
    loads: Loads
    observed: Observation


@dataclass(frozen=True)
class Comparison:
    """P candidates against every experiment.

    error_mm, deviation_mm: (P, K of all experiments); valid: (P,) converged in all states and stable;
    max_stretch: (P,); misfits: one an experiment.
    """

    error_mm: Array
    deviation_mm: Array
    unconverged: NDArray[np.bool_]
    unstable: NDArray[np.bool_]
    max_stretch: Array
    misfits: tuple[Misfit, ...]

    @property
    def objective_mm(self) -> Array:
        """(P,): mean over the states of the error; DISCARDED_MM where a candidate is not valid."""
        return np.where(self.unconverged | self.unstable, DISCARDED_MM, self.error_mm.mean(axis=1))


def compare(law: Law, parameters: Array, experiments: Sequence[Experiment]) -> Comparison:
    """Simulate P candidates (P, n) in every experiment and measure their distance to what was seen."""
    errors, deviations, misfits = [], [], []
    unconverged, unstable = np.zeros((2, len(parameters)), bool)
    stretch = np.ones(len(parameters))
    for experiment in experiments:
        shapes = experiment.model.solve(law, parameters, experiment.loads, tolerance_mm=_TOLERANCE_MM)
        misfit = experiment.observed.misfit(experiment.model, shapes)
        unconverged |= ((shapes.status == Status.DIVERGED) | (shapes.status == Status.OUT_OF_ITERATIONS)).any(axis=1)
        unstable |= (shapes.status == Status.UNSTABLE).any(axis=1)
        stretch = np.maximum(stretch, shapes.max_stretch.max(axis=1))
        errors.append(misfit.error_mm)
        deviations.append(misfit.deviation_mm)
        misfits.append(misfit)
    return Comparison(
        np.concatenate(errors, axis=1),
        np.concatenate(deviations, axis=1),
        unconverged,
        unstable & ~unconverged,
        stretch,
        tuple(misfits),
    )


@dataclass(frozen=True)
class Generation:
    """One generation of the search; errors in mm, step size in the unit coordinates."""

    best_mm: float
    median_mm: float
    step_size: float
    discarded: int


@dataclass(frozen=True)
class Fit:
    """An identified law.

    parameters: (n,) in the law's own units; error_mm, deviation_mm: (K,) by state; stop: why the search ended;
    at_bound: search coordinates that ended on a bound; stable_to: largest stretch up to which the law is stable
    (None: no limit met).
    """

    law: Law
    parameters: Array
    initial_shear_modulus_Pa: float
    error_mm: Array
    deviation_mm: Array
    max_stretch: float
    uncertainty: Uncertainty
    stable_to: float | None
    stability_checked_to: float
    at_bound: tuple[str, ...]
    history: tuple[Generation, ...]
    polish: Polish
    evaluations: int
    unconverged: int
    unstable: int
    stop: str
    seed: int
    wall_s: float


class NothingConverged(Exception):
    """No candidate could be simulated: loads, geometry or observations do not fit together."""


def identify(
    model: str,
    experiments: Sequence[Experiment],
    *,
    seed: int = 1,
    population: int | None = None,
    most_generations: int = 400,
    progress: Callable[[int, float, float], None] | None = None,
) -> Fit:
    """Identify one law (a key of LAWS) from one or several experiments.

    The search runs on the coarse mesh of `BeamModel`'s defaults; the polish, the errors and the intervals use the
    experiments' own models, which `BeamModel.refined` makes fine enough for the edges of a good camera.
    ``progress(generation, best_mm, step_size)`` is called once a generation. Raises NothingConverged, and
    KeyError for an unknown law.
    """
    begun = time.perf_counter()
    law, space = LAWS[model], SEARCH_SPACES[model]
    n = len(space.names)
    # The library's strategy needs two dimensions at least: a law with one parameter is given an idle coordinate.
    dimensions = max(n, 2)
    options = {
        "bounds": [0, 1],
        "seed": seed if seed > 0 else 1,
        "popsize": population or (8 if n == 1 else 8 + 2 * n),
        # The search need only come near enough for the polish: to 20 nm in the objective.
        "tolx": 1e-4,
        "tolfun": 2e-5,
        "tolfunhist": 2e-5,
        "tolflatfitness": 10,
        "maxiter": most_generations,
        "verbose": -9,
        "CMA_stds": [1.0] * n + [0.1] * (dimensions - n),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search = cma.CMAEvolutionStrategy([0.5] * dimensions, 0.25, options)
    coarse = [replace(experiment, model=BeamModel(experiment.model.specimen)) for experiment in experiments]
    history: list[Generation] = []
    best, best_unit = np.inf, np.full(n, 0.5)
    evaluations = unconverged = unstable = 0
    while not search.stop():
        candidates = np.clip(np.array(search.ask()), 0.0, 1.0)
        result = compare(law, space.parameters(candidates[:, :n]), coarse)
        values = result.objective_mm
        search.tell(list(candidates), values.tolist())
        evaluations += len(values)
        unconverged += int(result.unconverged.sum())
        unstable += int(result.unstable.sum())
        if values.min() < best:
            best, best_unit = float(values.min()), candidates[np.argmin(values), :n]
        valid = values[values < DISCARDED_MM]
        median = float(np.median(valid)) if len(valid) else DISCARDED_MM
        history.append(Generation(best, median, float(search.sigma), len(values) - len(valid)))
        if progress:
            progress(len(history), best, float(search.sigma))
    if best >= DISCARDED_MM:
        raise NothingConverged(
            f"none of {evaluations} {model} candidates could be simulated: check geometry, loads and units"
        )

    def refined(units: Array) -> Comparison:
        return compare(law, space.parameters(units), experiments)

    polished = polish(refined, best_unit)
    best_unit = polished.unit
    parameters = space.parameters(best_unit[None])
    final = compare(law, parameters, experiments)
    uncertainty = estimate_uncertainty(
        space,
        law,
        best_unit,
        lambda units: [(m.residuals, m.weights) for m in refined(units).misfits],
        [e.observed for e in experiments],
        seed,
        [
            _LEFT_BY_REFINING * (rough.residuals[0] - fine.residuals[0])
            for rough, fine in zip(compare(law, parameters, coarse).misfits, final.misfits, strict=True)
        ],
    )
    return Fit(
        law,
        parameters[0],
        float(law.initial_shear_modulus(parameters)[0]),
        final.error_mm[0],
        final.deviation_mm[0],
        float(final.max_stretch[0]),
        uncertainty,
        stable_up_to(law, parameters[0]),
        LARGEST_STRETCH_CHECKED,
        _at_bound(space, best_unit),
        tuple(history),
        polished,
        evaluations,
        unconverged,
        unstable,
        ", ".join(str(reason) for reason in search.stop()),
        seed,
        time.perf_counter() - begun,
    )


def _at_bound(space: SearchSpace, unit: Array) -> tuple[str, ...]:
    edge = 1e-3
    return tuple(name for name, u in zip(space.names, unit, strict=True) if u < edge or u > 1 - edge)
