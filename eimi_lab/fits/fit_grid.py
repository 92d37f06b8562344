"""Fit all combinations of laws, datasets, seeds and bootstrap replicates (random samples of the states)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass, replace
from typing import Any

from eimi_fitting.inference.identification.fit import Fit
from eimi_fitting.inference.identification.whole_fit import identify
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

FEWEST_STATES = 5  # for a bootstrap: with fewer states, many replicates would consist of one state only


@dataclass(frozen=True)
class Task:
    """A fit to compute: law, datasets, seed, and number of the random sample of states (0 for the measured data)."""

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
    """Return a task for each combination of law, datasets, seed and bootstrap replicate.

    Parameters
    ----------
    models : sequence of str
        Names of the laws.
    evidence : sequence of Evidence
        Datasets.
    seeds : sequence of int
        Seeds of the random numbers.
    each : bool
        Whether each dataset is fitted separately.
    bootstrap : int
        Number of bootstrap replicates (random samples of the states).

    Raises
    ------
    InputError
        If a dataset has too few states, or if no material could explain its states.
    """
    check_evidence(evidence)
    groups = [(e,) for e in evidence] if each else [tuple(evidence)]
    for group in groups:
        states = sum(len(e.states) for e in group)
        if bootstrap and states < FEWEST_STATES:
            raise InputError(
                f"{', '.join(str(e.path) for e in group)}: {states} states are too few; --bootstrap needs at "
                f"least {FEWEST_STATES} states"
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
    """Compute the fits, and return a record for each fit of measured data, in the order of the tasks.

    Parameters
    ----------
    tasks : sequence of Task
        Fits to compute, from `grid`.
    options : mapping
        Keyword arguments of `eimi_fitting.identify`.
    executor : callable, optional
        Starts worker processes; by default all fits are computed in this process.
    checkpoint : Checkpoint, optional
        Log of the search, from which an interrupted search is resumed.
    share_checkpoint : bool
        Whether the workers can write to the checkpoint.
    report : callable
        Called with a line of text after each task.
    underway : callable
        Called with a line of text during a search in this process.

    Returns
    -------
    list of FitRecord
        Fits to the measured data, each with the fits to its bootstrap replicates.

    Raises
    ------
    InputError
        If a dataset cannot be fitted, or if the checkpoint belongs to another search.
    ChildProcessError
        If workers are lost and cannot be replaced.
    """
    done = checkpoint.finished() if checkpoint else {}
    for index in sorted(done):
        report(f"{tasks[index]}: from the checkpoint")

    def arguments(index: int) -> dict[str, Any]:
        task = tasks[index]
        experiments = [e.experiment for e in task.evidence]
        if task.replicate:
            experiments = resampled(experiments, task.seed, task.replicate)
        values = {**options, "model": task.model, "experiments": experiments, "seed": task.seed}
        log = checkpoint.log_of(index) if checkpoint and share_checkpoint else None
        if log:
            values |= {"replay": log.replay, "progress": log}
        if executor is None:
            values["progress"] = _Underway(str(task), underway, log)
        return values

    remaining = [index for index in range(len(tasks)) if index not in done]
    try:
        with closing(completed(identify, arguments, remaining, executor, (*REFUSALS, OtherSearch))) as outcomes:
            for index, outcome in outcomes:
                done[index] = _record(tasks[index], outcome)
                if checkpoint:
                    checkpoint.finish(index, done[index])
                report(f"{tasks[index]}, mean error {1e3 * done[index].mean_error_mm:.2f} µm")
    except OtherSearch as error:
        raise InputError(
            f"{checkpoint.path if checkpoint else ''}: the fit cannot be continued from this file: {error}"
        ) from error
    return list(_with_replicates(tasks, done))


@dataclass
class _Underway:
    """The function that logs each generation (set of trial parameters) of a search and shows the progress."""

    task: str
    tell: Callable[[str], None]
    log: Callable[[Generation, Objectives], None] | None
    generations: int = 0

    def __call__(self, generation: Generation, objectives: Objectives) -> None:
        if self.log:
            self.log(generation, objectives)
        self.generations += 1
        best_um = 1e3 * generation.best_mm
        self.tell(f"{self.task}, generation {self.generations}, smallest objective so far {best_um:.2f} µm")


def _record(task: Task, outcome: Callable[[], Fit]) -> FitRecord | ReplicateRecord:
    try:
        fit = outcome()
    except REFUSALS as error:
        raise refused(error, task.evidence) from error
    return ReplicateRecord.of(fit, task.replicate) if task.replicate else FitRecord.of(fit, task.evidence)


def _with_replicates(tasks: Sequence[Task], done: Mapping[int, FitRecord | ReplicateRecord]) -> Iterator[FitRecord]:
    """Yield the fits to the measured data, each with the fits to its bootstrap replicates.

    `done` contains the result of each task by the index of the task.
    """
    fits: list[tuple[FitRecord, list[ReplicateRecord]]] = []
    for index in range(len(tasks)):
        record = done[index]
        if isinstance(record, ReplicateRecord):
            fits[-1][1].append(record)
        else:
            fits.append((record, []))
    for fit, replicates in fits:
        yield replace(fit, bootstrap=BootstrapRecord.of(replicates)) if replicates else fit
