"""CMA-ES over the unit cube: asks for candidates, is told how good they are, says when and why it stopped.

Hansen's CMA-ES (arXiv:1604.00772) as implemented in the package cma; population, bounds and stop rules are this
project's own.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import cma
import numpy as np
from numpy.typing import NDArray

from eimi_fitting.experiment import DISCARDED_MM

Array = NDArray[np.float64]


class Scored(Protocol):
    """What an objective says of P candidates."""

    @property
    def objective_mm(self) -> Array:
        """(P,), DISCARDED_MM where a candidate does not count."""

    @property
    def unconverged(self) -> NDArray[np.bool_]:
        """(P,)."""

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """(P,)."""


@dataclass(frozen=True)
class Generation:
    """One generation of the search; errors in mm, step size in the unit coordinates."""

    best_mm: float
    median_mm: float
    step_size: float
    discarded: int


@dataclass(frozen=True)
class SearchResult:
    """The best candidate (n,) in unit coordinates with its objective, and how it was come by.

    unconverged, unstable: how many candidates were discarded for this; stop: why the search ended.
    """

    unit: Array
    objective_mm: float
    history: tuple[Generation, ...]
    evaluations: int
    unconverged: int
    unstable: int
    stop: str


def search(
    objective: Callable[[Array], Scored],
    n: int,
    *,
    seed: int = 1,
    population: int | None = None,
    most_generations: int = 400,
    progress: Callable[[int, float, float], None] | None = None,
) -> SearchResult:
    """Minimise over n unit coordinates; ``objective`` takes a population (P, n) at once.

    ``progress(generation, best_mm, step_size)`` is called once a generation.
    """
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
        strategy = cma.CMAEvolutionStrategy([0.5] * dimensions, 0.25, options)
    history: list[Generation] = []
    best, best_unit = np.inf, np.full(n, 0.5)
    evaluations = unconverged = unstable = 0
    while not strategy.stop():
        candidates = np.clip(np.array(strategy.ask()), 0.0, 1.0)
        scored = objective(candidates[:, :n])
        values = scored.objective_mm
        strategy.tell(list(candidates), values.tolist())
        evaluations += len(values)
        unconverged += int(scored.unconverged.sum())
        unstable += int(scored.unstable.sum())
        if values.min() < best:
            best, best_unit = float(values.min()), candidates[np.argmin(values), :n]
        valid = values[values < DISCARDED_MM]
        median = float(np.median(valid)) if len(valid) else DISCARDED_MM
        history.append(Generation(best, median, float(strategy.sigma), len(values) - len(valid)))
        if progress:
            progress(len(history), best, float(strategy.sigma))
    reasons = ", ".join(str(reason) for reason in strategy.stop())
    return SearchResult(best_unit, best, tuple(history), evaluations, unconverged, unstable, reasons)
