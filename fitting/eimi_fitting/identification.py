"""Evolutionary identification: CMA-ES searches the parameters whose simulated edges lie on the measured ones.

After Di Lecce et al. 2022 (Front. Robot. AI 8:790571): a search on a coarse mesh, a polish on a finer one, and what
the numbers are worth.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.experiment import DISCARDED_MM, Comparison, Experiment, compare
from eimi_fitting.forward import BeamModel
from eimi_fitting.materials import LAWS, Law
from eimi_fitting.polish import Polish, polish
from eimi_fitting.search import Generation, search
from eimi_fitting.search_space import SEARCH_SPACES, SearchSpace
from eimi_fitting.stability import LARGEST_STRETCH_CHECKED, stable_up_to
from eimi_fitting.uncertainty import Uncertainty, estimate_uncertainty

Array = NDArray[np.float64]

# Of the change in the edges from the coarse mesh to the fine one, the share that finer meshes still add (measured in
# the modulus: 13 x 1 is off by 0.20 and 0.41 %, 26 x 3 by 0.02 and 0.07 %).
_LEFT_BY_REFINING = 1 / 6


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
    coarse = [replace(experiment, model=BeamModel(experiment.model.specimen)) for experiment in experiments]
    found = search(
        lambda units: compare(law, space.parameters(units), coarse),
        len(space.names),
        seed=seed,
        population=population,
        most_generations=most_generations,
        progress=progress,
    )
    if found.objective_mm >= DISCARDED_MM:
        raise NothingConverged(
            f"none of {found.evaluations} {model} candidates could be simulated: check geometry, loads and units"
        )

    def refined(units: Array) -> Comparison:
        return compare(law, space.parameters(units), experiments)

    polished = polish(refined, found.unit)
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
        found.history,
        polished,
        found.evaluations,
        found.unconverged,
        found.unstable,
        found.stop,
        seed,
        time.perf_counter() - begun,
    )


def _at_bound(space: SearchSpace, unit: Array) -> tuple[str, ...]:
    edge = 1e-3
    return tuple(name for name, u in zip(space.names, unit, strict=True) if u < edge or u > 1 - edge)
