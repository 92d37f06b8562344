"""A grid of fits: laws x datasets x seeds x bootstrap replicates, each fit a task of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass
from typing import Any

from eimi_fitting.inference.identification import Fit, identify
from eimi_fitting.inference.interval.bootstrap import resampled
from eimi_fitting.inference.searching.search import Generation, Objectives, OtherSearch
from eimi_lab.fits.bootstrap_record import BootstrapRecord, ReplicateRecord
from eimi_lab.fits.checkpoint import Checkpoint
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.fitting import REFUSALS, check_evidence, refused
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.progress import silent
from eimi_lab.process.workers import completed

FEWEST_STATES = 5  # to draw from: of fewer, many replicates would hold one state alone


@dataclass(frozen=True)
class Task:
    """One fit: a law, the evidence it is fitted to together, the seed, and the replicate (0: data as measured)."""

    model: str
    evidence: tuple[Evidence, ...]
    seed: int
    replicate: int = 0

    def __str__(self) -> str:
        words = [self.model, *(str(e.path) for e in self.evidence), f"seed {self.seed}"]
        return " ".join([*words, f"replicate {self.replicate}"] if self.replicate else words)


def grid(
    models: Sequence[str], evidence: Sequence[Evidence], seeds: Sequence[int], *, each: bool = False, bootstrap: int = 0
) -> list[Task]:
    """Every law with every seed on all the evidence together, or on ``each`` dataset apart, with so many replicates.

    Raises InputError where there are too few states to draw replicates from, or where no material could explain them.
    """
    check_evidence(evidence)
    groups = [(e,) for e in evidence] if each else [tuple(evidence)]
    for group in groups:
        states = sum(len(e.states) for e in group)
        if bootstrap and states < FEWEST_STATES:
            raise InputError(
                f"{', '.join(str(e.path) for e in group)}: {states} states; --bootstrap draws states and needs at "
                f"least {FEWEST_STATES}"
            )
    return [
        Task(model, group, seed, replicate)
        for group in groups
        for model in dict.fromkeys(models)
        for seed in dict.fromkeys(seeds)
        for replicate in range(bootstrap + 1)
    ]


def fit_grid(
    tasks: Sequence[Task],
    options: Mapping[str, Any],
    *,
    executor: Callable[[], AbstractContextManager[Executor]] | None = None,
    checkpoint: Checkpoint | None = None,
    share_checkpoint: bool = True,
    report: Callable[[str], None] = silent,
    underway: Callable[[str], None] = silent,
) -> list[FitRecord]:
    """Do the fits of a grid; ``options`` are those of `identify`. Replicates come back within the fit that they repeat.

    share_checkpoint: workers write each generation into the checkpoint, which takes that they see the file; else only
    finished fits are written. ``report`` is called once a task, ``underway`` once a generation of what is
    searched in this process. Raises InputError where nothing can be simulated or
    the checkpoint does not fit, ChildProcessError when workers are lost for good.
    """
    done = checkpoint.finished() if checkpoint else {}
    for index in sorted(done):
        report(f"{tasks[index]}: from the checkpoint")

    def arguments(index: int) -> dict[str, Any]:
        task = tasks[index]
        experiments = [e.experiment for e in task.evidence]
        if task.replicate:
            experiments = resampled(experiments, task.seed, task.replicate)
        given = {**options, "model": task.model, "experiments": experiments, "seed": task.seed}
        log = checkpoint.log_of(index) if checkpoint and share_checkpoint else None
        if log:
            given |= {"replay": log.replay, "progress": log}
        if executor is None:
            given["progress"] = _Underway(str(task), underway, log)
        return given

    left = [index for index in range(len(tasks)) if index not in done]
    try:
        with closing(completed(identify, arguments, left, executor, (*REFUSALS, OtherSearch))) as outcomes:
            for index, outcome in outcomes:
                done[index] = _record(tasks[index], outcome)
                if checkpoint:
                    checkpoint.finish(index, done[index])
                report(f"{tasks[index]}, mean error {1e3 * done[index].mean_error_mm:.2f} µm")
    except OtherSearch as error:
        raise InputError(
            f"{checkpoint.path if checkpoint else ''}: cannot be resumed here: {error}; was it written on another "
            "kind of processor?"
        ) from error
    return list(_with_replicates(tasks, done))


@dataclass
class _Underway:
    """Tells each generation of a fit's search, and has it logged."""

    task: str
    tell: Callable[[str], None]
    log: Callable[[Generation, Objectives], None] | None
    generations: int = 0

    def __call__(self, generation: Generation, objectives: Objectives) -> None:
        if self.log:
            self.log(generation, objectives)
        self.generations += 1
        self.tell(f"{self.task}, generation {self.generations}, {1e3 * generation.best_mm:.2f} µm")


def _record(task: Task, outcome: Callable[[], Fit]) -> FitRecord | ReplicateRecord:
    try:
        fit = outcome()
    except REFUSALS as error:
        raise refused(error, task.evidence) from error
    return ReplicateRecord.of(fit, task.replicate) if task.replicate else FitRecord.of(fit, task.evidence)


def _with_replicates(tasks: Sequence[Task], done: Mapping[int, FitRecord | ReplicateRecord]) -> Iterator[FitRecord]:
    """The fits of the data as measured, in order, each with its replicates, which follow it in the grid."""
    of_each: dict[int, list[ReplicateRecord]] = {}
    for index in range(len(tasks)):
        found = done[index]
        if isinstance(found, ReplicateRecord):
            of_each[next(reversed(of_each))].append(found)
        else:
            of_each[index] = []
    for index, replicates in of_each.items():
        fit = done[index]
        assert isinstance(fit, FitRecord)
        yield fit.model_copy(update={"bootstrap": BootstrapRecord.of(replicates)}) if replicates else fit
