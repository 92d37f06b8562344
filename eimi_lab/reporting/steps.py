"""The simulations of a report in steps, which workers share.

Each dataset with the fits that tell something of each other; each fit that has to be simulated by itself; and last the
intervals of errors, one by one: they take a fifth of the time, and hardly a figure waits for them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.predicted_error import error_interval_mm
from eimi_lab.process.errors import InputError
from eimi_lab.process.progress import silent
from eimi_lab.process.workers import completed
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.reporting.simulated import FitsOnDataset, simulate_alone, simulate_fits


def simulate_on_each(
    paths: Sequence[Path],
    every: Sequence[ShownFit],
    flagged: bool,
    told: Callable[[str], None] = silent,
    executor: Callable[[], AbstractContextManager[Executor]] | None = None,
    meanwhile: Callable[[], None] | None = None,
) -> Iterator[tuple[int, FitsOnDataset]]:
    """Each dataset with its place among the paths twice: as soon as all fits are simulated, and with their intervals.

    told: hears of each dataset, each fit on it and each interval. Shared out to the workers of an executor where there
    is one; meanwhile: see `completed`. Raises InputError.
    """
    work = _Work(paths, every, flagged, told, executor is not None)
    for step, result in completed(
        _called, work.arguments, work.first(), executor, (InputError,), meanwhile, work.further
    ):
        result()
        if step.kind != "interval" and None not in work.known[step.place].found:
            yield step.place, work.known[step.place]
    yield from sorted(work.known.items())


class _Step(NamedTuple):
    """All fits on a dataset, one that has to be simulated by itself, or the interval of its error."""

    kind: Literal["fits", "alone", "interval"]
    place: int
    fit: int = 0


def _called(call: Callable[[], Any]) -> Any:
    return call()


class _Work:
    """What is to be done, and what is known so far. shared: by workers, who tell nothing themselves."""

    def __init__(
        self, paths: Sequence[Path], every: Sequence[ShownFit], flagged: bool, told: Callable[[str], None], shared: bool
    ) -> None:
        self._paths, self._every, self._flagged, self._told, self._shared = paths, every, flagged, told, shared
        self.known: dict[int, FitsOnDataset] = {}
        self._asked = set[_Step]()

    def first(self) -> list[_Step]:
        """The steps that begin; for workers the longest first, lest it be waited for in the end. Raises InputError."""
        places = range(len(self._paths))
        order = sorted(places, key=lambda place: -_size(self._paths[place])) if self._shared else places
        return [_Step("fits", place) for place in order]

    def arguments(self, step: _Step) -> dict[str, Callable[[], Any]]:
        """Of `_called`."""
        if step.kind == "fits":
            told = {} if self._shared else {"told": self._told}
            return {"call": partial(simulate_fits, self._paths[step.place], self._every, self._flagged, **told)}
        known, shown = self.known[step.place], self._every[step.fit]
        found = known.found[step.fit]
        if found is None:
            return {"call": partial(simulate_alone, known.on[step.fit], shown)}
        return {"call": partial(error_interval_mm, shown.fit, known.on[step.fit], found.residuals_mm)}

    def further(self, step: _Step, result: Any) -> list[_Step]:
        """Keep what a step has found; the steps that follow from it."""
        new = []
        if step.kind == "fits":
            # A worker sends copies of the fits; whoever looks for those of one fit looks for this one.
            self.known[step.place] = replace(result, every=tuple(self._every))
            new = [_Step("alone", step.place, i) for i, found in enumerate(result.found) if found is None]
            for _ in range(1 + len(self._every) - len(new) if self._shared else 0):
                self._told(self._paths[step.place].name)
        else:
            every = self.known[step.place].found
            found = every[step.fit]
            every[step.fit] = found.with_interval(result) if found else result
            self._tell(step)
        return new + self._intervals()

    def _intervals(self) -> list[_Step]:
        """Of what is simulated, once nothing is left to begin that figures wait for."""
        if len(self.known) < len(self._paths):
            return []
        new = []
        for place, known in self.known.items():
            for i, found in enumerate(known.found):
                step = _Step("interval", place, i)
                if found and step not in self._asked:
                    self._asked.add(step)
                    if found.validation.status == "ok":
                        new.append(step)
                    else:
                        self._tell(step)
        return new

    def _tell(self, step: _Step) -> None:
        words = ", its interval" if step.kind == "interval" else ""
        self._told(f"{self._paths[step.place].name}, {self._every[step.fit].label}{words}")


def _size(path: Path) -> float:
    """What a dataset's simulation takes, beside that of others: more states, and a wider beam has more elements."""
    with open_dataset(path) as dataset:
        beam = dataset.specimen.specimen
        return len(dataset.states) * beam.width_mm / beam.length_mm
