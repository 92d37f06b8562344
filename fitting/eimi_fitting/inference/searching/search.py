"""CMA-ES over the unit cube: asks for candidates, hears how good they are, says when and why it stopped.

Hansen's CMA-ES (arXiv:1604.00772) as implemented in the package cma. A search may be several runs: with a population
that doubles from run to run (IPOP; Auger and Hansen 2005, IEEE CEC, p. 1769) and, between those, runs with a small
population and a small first step that together may cost as much (BIPOP; Hansen 2009, "Benchmarking a BI-population
CMA-ES on the BBOB-2009 function testbed", GECCO, section 2). Population, bounds and stop rules are this project's own.

The search draws its random numbers from a generator of its own, and nothing else decides what it asks: given the same
values it asks the same candidates, bit for bit. That is what `replay` rests on.
"""

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

ENOUGH_MM = 0.5  # that the objectives of a whole population lie from each other where the polish takes over
_FIRST_STEP = 0.25  # in unit coordinates
_MODULUS = 0.3  # of that step, in the first coordinate: a modulus that a scan has found already


class Values(Protocol):
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
class Objectives:
    """What the strategy learns of one generation: objectives (P,) in mm, and how many were discarded for what."""

    objective_mm: tuple[float, ...]
    unconverged: int
    unstable: int


@dataclass(frozen=True)
class Generation:
    """One generation of the search, after its objectives are known.

    run: counted from 1; best_mm: best objective of all so far; mean_mm: of this generation's valid candidates;
    step_size: in the unit coordinates; axis_ratio: longest over shortest axis of the distribution; discarded:
    candidates that did not count.
    """

    run: int
    best_mm: float
    mean_mm: float
    step_size: float
    axis_ratio: float
    discarded: int


@dataclass(frozen=True)
class Run:
    """One run of CMA-ES: its population, first step and length, the best objective it found and why it stopped."""

    population: int
    step_size: float
    generations: int
    best_mm: float
    stop: str


@dataclass(frozen=True)
class Discards:
    """Candidates that counted as worst: no convergence, or not stable over the stretches reached."""

    unconverged: int
    unstable: int


@dataclass(frozen=True)
class SearchResult:
    """The best candidate (n,) in unit coordinates with its objective, and how it was come by."""

    unit: Array
    objective_mm: float
    history: tuple[Generation, ...]
    runs: tuple[Run, ...]
    evaluations: int
    discarded: Discards

    @property
    def stop(self) -> str:
        """Why each run stopped, in order."""
        return "; ".join(run.stop for run in self.runs)


class OtherSearch(Exception):
    """What is to be replayed is not of this search."""


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
    """Minimise over n unit coordinates; ``objective`` takes a population (P, n) at once.

    restarts: further runs with a doubled population each, from a random place; bipop: with runs of small populations
    between them; most_generations: of one run; enough_mm: a run ends where the objectives of a whole population lie
    within it; replay: the objectives of the first generations of an earlier search
    with the same arguments, which are not evaluated again. ``progress`` is called after each generation, replayed
    ones included. Raises OtherSearch when ``replay`` does not fit.
    """
    rng = np.random.default_rng(seed)
    log = _Log(n, replay, progress)
    for first_step, size, most in _runs(rng, population or (8 if n == 1 else 8 + 2 * n), restarts, bipop, log.runs):
        start = rng.uniform(size=n) if log.runs else np.full(n, 0.5)
        strategy = _strategy(rng, start, first_step, size, min(most, most_generations))
        begun = len(log.history)
        values: list[Array] = []
        reasons: list[str] = []
        while not reasons:
            candidates = np.clip(np.array(strategy.ask()), 0.0, 1.0)
            objectives = log.replayed(len(candidates)) or _evaluated(objective, candidates[:, :n])
            values.append(np.array(objectives.objective_mm))
            strategy.tell(list(candidates), values[-1].tolist())
            log.add(strategy, candidates, objectives)
            reasons = [str(reason) for reason in strategy.stop()] + _together(values[-1], enough_mm)
        best = float(np.min(values))
        log.runs.append(Run(size, first_step, len(log.history) - begun, best, ", ".join(reasons)))
    return log.result()


def _evaluated(objective: Callable[[Array], Values], candidates: Array) -> Objectives:
    found = objective(candidates)
    return Objectives(tuple(found.objective_mm.tolist()), int(found.unconverged.sum()), int(found.unstable.sum()))


def _together(values: Array, enough_mm: float) -> list[str]:
    """A reason to stop where a generation's values are near enough to each other."""
    near = bool((values < DISCARDED_MM).all()) and np.ptp(values) < enough_mm
    return ["population"] if near else []


class _Log:
    """What a search has seen so far, and the first generations of an earlier one."""

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
        """What the next generation is known to be. Raises OtherSearch where it has another number of candidates."""
        if len(self.history) >= len(self._replay):
            return None
        known = self._replay[len(self.history)]
        if len(known.objective_mm) != candidates:
            raise OtherSearch(
                f"generation {len(self.history) + 1} has {candidates} candidates, "
                f"that to be replayed {len(known.objective_mm)}"
            )
        return known

    def add(self, strategy: CMAEvolutionStrategy, candidates: Array, objectives: Objectives) -> None:
        """One more generation."""
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
        """At the end."""
        return SearchResult(
            unit=self._best_unit,
            objective_mm=self._best,
            history=tuple(self.history),
            runs=tuple(self.runs),
            evaluations=sum(len(own.objective_mm) for own in self._objectives),
            discarded=Discards(
                sum(own.unconverged for own in self._objectives), sum(own.unstable for own in self._objectives)
            ),
        )


def _strategy(
    rng: np.random.Generator, start: Array, step: float, population: int, most_generations: int
) -> CMAEvolutionStrategy:
    # The library's strategy needs two dimensions at least: a law with one parameter is given an idle coordinate.
    idle = max(2 - len(start), 0)
    options = {
        "bounds": [0, 1],
        "seed": np.nan,
        "randn": lambda *shape: rng.standard_normal(shape),
        "popsize": population,
        # For a search whose population cannot come together, such as one with candidates that fail to the end.
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
    """First step, population and most generations of each run; ``done`` grows while the runs are made."""
    unlimited = sys.maxsize
    yield _FIRST_STEP, population, unlimited
    large = 0  # evaluations; the first run counts as one with a small population
    for k in range(1, restarts + 1):
        before = _evaluations(done)
        yield _FIRST_STEP, population * 2**k, unlimited
        last_large = _evaluations(done) - before
        large += last_large
        while bipop and _evaluations(done) - large < large:
            few = int(population * (0.5 * 2**k) ** (rng.uniform() ** 2))
            yield _FIRST_STEP * 10 ** (-2 * rng.uniform()), few, max(last_large // 2 // few, 1)


def _evaluations(runs: Sequence[Run]) -> int:
    return sum(run.population * run.generations for run in runs)
