"""Minimise a function of several variables by CMA-ES (a random search with a normal distribution)."""

# Each generation draws P points u = m + sigma N(0, C). The order of their objectives adapts the mean m, the step size
# sigma and the covariance C (Hansen, arXiv:1604.00772). In IPOP, P doubles from run to run (Auger and Hansen 2005, IEEE
# CEC, p. 1769). BIPOP adds runs with a small P and a small first step (Hansen 2009, "Benchmarking a BI-population
# CMA-ES on the BBOB-2009 function testbed", GECCO, section 2).

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.searching._cma import CMAEvolutionStrategy

Array = NDArray[np.float64]

ENOUGH_MM = 0.5  # a run stops if the objectives of a generation differ by less; the polish then continues
_FIRST_STEP = 0.25  # first step size in unit coordinates
_MODULUS = 0.3  # share of that step in the first coordinate, the modulus, which a scan has narrowed already


class Values(Protocol):
    """The objectives of several candidates (sets of unknowns), and whether they are valid."""

    @property
    def objective_mm(self) -> Array:
        """The objective of each candidate; very large if the candidate is not valid."""

    @property
    def unconverged(self) -> NDArray[np.bool_]:
        """For each candidate, whether the beam has no equilibrium in a load case."""

    @property
    def unstable(self) -> NDArray[np.bool_]:
        """For each candidate, whether the material law is unstable in a load case."""


@dataclass(frozen=True)
class Objectives:
    """The objectives of the candidates of one generation of a search."""

    objective_mm: tuple[float, ...]
    # Number of candidates without an equilibrium, and with an unstable law.
    unconverged: int
    unstable: int


@dataclass(frozen=True)
class Generation:
    """The progress of a search by CMA-ES after one generation (one set of random candidates)."""

    # Number of the run, from 1.
    run: int
    # Smallest objective so far.
    best_mm: float
    # Mean objective of the valid candidates.
    mean_mm: float
    # Step size sigma of CMA-ES.
    step_size: float
    # Longest over shortest axis of the normal distribution.
    axis_ratio: float
    # Number of candidates that are not valid.
    discarded: int


@dataclass(frozen=True)
class Run:
    """One run of CMA-ES, a part of a search."""

    # Number of candidates in a generation.
    population: int
    # First step size sigma.
    step_size: float
    # Number of generations.
    generations: int
    # Smallest objective.
    best_mm: float
    # Reason why the run stopped.
    stop: str


@dataclass(frozen=True)
class Discards:
    """The numbers of candidates that a search discarded: without an equilibrium, and with an unstable material law."""

    unconverged: int
    unstable: int


@dataclass(frozen=True)
class SearchResult:
    """The candidate with the smallest objective that a search found, and the history of the search."""

    # (n,): coordinates of the candidate, from 0 to 1, and its objective.
    unit: Array
    objective_mm: float
    history: tuple[Generation, ...]
    # All runs of CMA-ES.
    runs: tuple[Run, ...]
    # Number of candidates in all generations, and number of candidates that are not valid.
    evaluations: int
    discarded: Discards

    @property
    def stop(self) -> str:
        """The reasons why the runs of the search stopped."""
        return "; ".join(run.stop for run in self.runs)


class OtherSearch(Exception):
    """The exception for stored results of an interrupted search that belong to another search."""


def search(
    objective: Callable[[Array], Values],
    n: int,
    *,
    seed: int = 1,
    population: int | None = None,
    most_generations: int = 400,
    restarts: int = 0,
    bipop: bool = False,
    enough_mm: float = ENOUGH_MM,
    replay: Sequence[Objectives] = (),
    progress: Callable[[Generation, Objectives], None] | None = None,
) -> SearchResult:
    """Minimise a function of several variables, each from 0 to 1, by CMA-ES (a random search)."""
    # objective: takes the coordinates of P points, (P, n). population: of the first run; by default 8 for n = 1, else 8
    # + 2 n; it doubles from run to run. bipop: whether runs with small populations follow each restart. enough_mm: a
    # run stops if the objectives of a whole generation differ by less. replay: objectives of the first generations of
    # an interrupted search. progress: called after each generation. Raises OtherSearch.
    rng = np.random.default_rng(seed)
    log = _Log(n, replay, progress)
    for first_step, size, most in _runs(rng, population or (8 if n == 1 else 8 + 2 * n), restarts, bipop, log.runs):
        start = rng.uniform(size=n) if log.runs else np.full(n, 0.5)
        strategy = _strategy(rng, start, first_step, size, min(most, most_generations))
        first_generation = len(log.history)
        values: list[Array] = []
        reasons: list[str] = []
        while not reasons:
            candidates = np.clip(np.array(strategy.ask()), 0.0, 1.0)
            # The seed and the objectives determine the points bit for bit, so that stored generations can be repeated.
            objectives = log.replayed(len(candidates)) or _evaluated(objective, candidates[:, :n])
            values.append(np.array(objectives.objective_mm))
            strategy.tell(list(candidates), values[-1].tolist())
            log.add(strategy, candidates, objectives)
            reasons = [str(reason) for reason in strategy.stop()] + _reason_of_population(values[-1], enough_mm)
        best = float(np.min(values))
        log.runs.append(Run(size, first_step, len(log.history) - first_generation, best, ", ".join(reasons)))
    return log.result()


def _evaluated(objective: Callable[[Array], Values], candidates: Array) -> Objectives:
    values = objective(candidates)
    return Objectives(tuple(values.objective_mm.tolist()), int(values.unconverged.sum()), int(values.unstable.sum()))


def _reason_of_population(values: Array, enough_mm: float) -> list[str]:
    is_close = bool((values < DISCARDED_MM).all()) and np.ptp(values) < enough_mm
    return ["population"] if is_close else []


class _Log:
    def __init__(
        self,
        n: int,
        replay: Sequence[Objectives],
        progress: Callable[[Generation, Objectives], None] | None,
    ) -> None:
        self._n, self._replay, self._progress = n, replay, progress
        self.history: list[Generation] = []
        self.runs: list[Run] = []
        self._best, self._best_unit = np.inf, np.full(n, 0.5)
        self._objectives: list[Objectives] = []

    def replayed(self, candidates: int) -> Objectives | None:
        # The stored objectives of the next generation.
        if len(self.history) >= len(self._replay):
            return None
        objectives = self._replay[len(self.history)]
        if len(objectives.objective_mm) != candidates:
            raise OtherSearch(
                f"generation {len(self.history) + 1} has {candidates} candidates, but the stored generation has "
                f"{len(objectives.objective_mm)}"
            )
        return objectives

    def add(self, strategy: CMAEvolutionStrategy, candidates: Array, objectives: Objectives) -> None:
        values = np.array(objectives.objective_mm)
        if values.min() < self._best:
            self._best, self._best_unit = float(values.min()), candidates[np.argmin(values), : self._n]
        valid = values[values < DISCARDED_MM]
        self._objectives.append(objectives)
        self.history.append(
            Generation(
                run=len(self.runs) + 1,
                best_mm=self._best,
                mean_mm=float(valid.mean()) if len(valid) else DISCARDED_MM,
                step_size=float(strategy.sigma),
                axis_ratio=float(strategy.D.max() / strategy.D.min()) if self._n > 1 else 1.0,
                discarded=len(values) - len(valid),
            )
        )
        if self._progress:
            self._progress(self.history[-1], objectives)

    def result(self) -> SearchResult:
        return SearchResult(
            unit=self._best_unit,
            objective_mm=self._best,
            history=tuple(self.history),
            runs=tuple(self.runs),
            evaluations=sum(len(generation.objective_mm) for generation in self._objectives),
            discarded=Discards(
                sum(generation.unconverged for generation in self._objectives),
                sum(generation.unstable for generation in self._objectives),
            ),
        )


def _strategy(
    rng: np.random.Generator, start: Array, step: float, population: int, most_generations: int
) -> CMAEvolutionStrategy:
    # The package needs at least two dimensions: a law with one parameter gets an idle second coordinate.
    idle = max(2 - len(start), 0)
    options = {
        "bounds": [0, 1],
        "seed": np.nan,
        "randn": lambda *shape: rng.standard_normal(shape),
        "popsize": population,
        # These criteria stop a run whose objectives never come close, for example because some candidates always fail.
        "tolx": 1e-4,
        "tolfun": 2e-5,
        "tolfunhist": 2e-5,
        "tolflatfitness": 10,
        "maxiter": most_generations,
        "verbose": -9,
        "CMA_stds": [_MODULUS] + [1.0] * (len(start) - 1) + [0.1] * idle,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return CMAEvolutionStrategy([*start, *[0.5] * idle], step, options)


def _runs(
    rng: np.random.Generator, population: int, restarts: int, bipop: bool, done: Sequence[Run]
) -> Iterator[tuple[float, int, int]]:
    # For each run of CMA-ES: initial step size, population size, and largest number of generations.
    unlimited = sys.maxsize
    yield _FIRST_STEP, population, unlimited
    large = 0  # evaluations of runs with a large population; the first run counts as a small one
    for k in range(1, restarts + 1):
        # The caller appends each finished run to ``done``.
        before = _evaluations(done)
        yield _FIRST_STEP, population * 2**k, unlimited
        last_large = _evaluations(done) - before
        large += last_large
        # All runs with small populations cost about as many evaluations as the restarts.
        while bipop and _evaluations(done) - large < large:
            few = int(population * (0.5 * 2**k) ** (rng.uniform() ** 2))
            yield _FIRST_STEP * 10 ** (-2 * rng.uniform()), few, max(last_large // 2 // few, 1)


def _evaluations(runs: Sequence[Run]) -> int:
    return sum(run.population * run.generations for run in runs)
