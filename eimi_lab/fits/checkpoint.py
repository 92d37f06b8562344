"""The log of the generations of a fit, or of a grid of fits, which is also what a killed one is resumed from.

JSON lines. The first says what is fitted; then each generation has one, with the objectives that the search was told,
and each finished fit one. A search asks the same candidates when it is told the same values, so that a resumed one is
told what is written here, in milliseconds, and goes on bit for bit: numbers are written so that they are read back
exactly. A line that a kill cut short is passed over, and what it held is computed again.
"""

from __future__ import annotations

import json
import os
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from eimi_fitting.inference.searching.search import Generation, Objectives, OtherSearch
from eimi_lab.fits.bootstrap_record import ReplicateRecord
from eimi_lab.fits.fits_file import first_fault
from eimi_lab.fits.law_record import Record
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import refuse_existing
from eimi_lab.process.writer_lock import WriterLock

_SHOWN = 4  # fits or datasets, in a message
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Head(Record):
    """What must be the same for a fit to be resumed: the fits, the data by their content, options and versions."""

    fits: tuple[str, ...]
    datasets: tuple[str, ...]
    options: dict[str, Any]
    versions: dict[str, str]


class GenerationLine(Record):
    """One generation of the fit with that number in the head: what the search was told and where that led it."""

    fit: int
    generation: int
    objective_mm: tuple[Finite, ...]
    unconverged: int
    unstable: int
    search: Generation


class FinishedLine(Record):
    """A finished fit."""

    fit: int
    finished: FitRecord | ReplicateRecord


class Checkpoint:
    """A checkpoint file, new or resumed. Lines are added by whoever computes: this process or several.

    Others cannot write to it as long as this object lives.
    """

    def __init__(self, path: Path, head: Head, *, resume: bool, force: bool = False) -> None:
        """Begin a checkpoint; with ``resume`` go on with the one that is there, if there is one.

        Raises InputError when there is one that may not be replaced, or may not be resumed because its head differs,
        or when another program writes to it.
        """
        self.path = path
        weakref.finalize(self, WriterLock(path).release)
        if resume and path.exists() and path.stat().st_size:
            _check_same(path, self._head(), Head.model_validate_json(head.model_dump_json()))
            return
        if path.is_file() and not (force or resume):
            raise InputError(
                f"{path}: exists already; --resume goes on with it, --force replaces it, or give another name"
            )
        refuse_existing(path, force or resume)
        try:
            _append(path, head, fresh=True)
        except OSError as error:
            raise InputError(f"{path}: cannot be written as a checkpoint ({error.strerror})") from error

    @staticmethod
    def of(path: Path | None, head: Head, *, resume: bool, force: bool) -> Checkpoint:
        """As the command line asks for it. Raises InputError where `--resume` has no `--checkpoint`."""
        if path is None:
            raise InputError("--resume: from which file? give --checkpoint too")
        return Checkpoint(path, head, resume=resume, force=force)

    def _lines(self) -> list[Any]:
        """The lines that are whole."""
        whole = []
        try:
            text = self.path.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read as a checkpoint ({error.strerror})") from error
        for line in text.split("\n"):
            try:
                whole.append(json.loads(line))
            except json.JSONDecodeError:
                continue
        return whole

    def _head(self) -> Head:
        try:
            return Head.model_validate(next(iter(self._lines()), None))
        except ValidationError as error:
            raise InputError(f"{self.path}: does not begin as a checkpoint of `eimi fit` does") from error

    def _read(self) -> tuple[list[GenerationLine], list[FinishedLine]]:
        generations: list[GenerationLine] = []
        finished: list[FinishedLine] = []
        fits = len(self._head().fits)
        for number, line in enumerate(self._lines()[1:], start=2):
            is_finished = isinstance(line, dict) and "finished" in line
            try:
                whole = (FinishedLine if is_finished else GenerationLine).model_validate(line)
            except ValidationError as error:
                raise InputError(f"{self.path}: whole line {number}: {first_fault(error)}") from error
            if not 0 <= whole.fit < fits:
                raise InputError(f"{self.path}: whole line {number}: fit: {whole.fit} should be from 0 to {fits - 1}")
            if isinstance(whole, FinishedLine):
                finished.append(whole)
            else:
                generations.append(whole)
        return generations, finished

    def finished(self) -> dict[int, FitRecord | ReplicateRecord]:
        """The fits that need not be done again, by their number in the head."""
        return {line.fit: line.finished for line in self._read()[1]}

    def finish(self, fit: int, record: FitRecord | ReplicateRecord) -> None:
        """Write down that a fit is finished."""
        _append(self.path, FinishedLine(fit=fit, finished=record))

    def log_of(self, fit: int) -> GenerationLog:
        """What is known of the search of one fit, and where its next generations are written."""
        own: dict[int, GenerationLine] = {}
        for line in self._read()[0]:
            if line.fit == fit:
                own.setdefault(line.generation, line)
        known: list[GenerationLine] = []
        while len(known) + 1 in own:  # what follows a lost line is computed again
            known.append(own[len(known) + 1])
        return GenerationLog(self.path, fit, tuple(known))


@dataclass
class GenerationLog:
    """Is called after each generation of one fit, replayed ones included, and writes down the others."""

    path: Path
    fit: int
    known: tuple[GenerationLine, ...]
    generation: int = 0

    @property
    def replay(self) -> tuple[Objectives, ...]:
        """What the search is told again."""
        return tuple(Objectives(line.objective_mm, line.unconverged, line.unstable) for line in self.known)

    def __call__(self, generation: Generation, objectives: Objectives) -> None:
        """Raises OtherSearch when a replayed generation does not lead where it led before."""
        self.generation += 1
        if self.generation <= len(self.known):
            if generation != self.known[self.generation - 1].search:
                raise OtherSearch(f"generation {self.generation} does not lead where it led when it was written")
            return
        _append(
            self.path,
            GenerationLine(
                fit=self.fit,
                generation=self.generation,
                objective_mm=objectives.objective_mm,
                unconverged=objectives.unconverged,
                unstable=objectives.unstable,
                search=generation,
            ),
        )


def _append(path: Path, line: Record, fresh: bool = False) -> None:
    """One line, on the disk before this returns, in one write: lines of several processes do not mix.

    Each begins with its line break, so that one that was cut short does not spoil the next.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | (os.O_TRUNC if fresh else 0)
    descriptor = os.open(path, flags, 0o666)
    try:
        os.write(descriptor, ("" if fresh else "\n").encode() + line.model_dump_json().encode())
        os.fsync(descriptor)
    except OSError as error:  # which names no file
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        os.close(descriptor)


def _check_same(path: Path, found: Head, asked: Head) -> None:
    for what, there, here in (
        ("fits", found.fits, asked.fits),
        ("datasets (sha256)", found.datasets, asked.datasets),
        *_pairs("", found.options, asked.options),
        *_pairs("version of ", found.versions, asked.versions),
    ):
        if there != here:
            raise InputError(
                f"{path}: its {what} should be the same to resume, is {_words(there)} there and {_words(here)} here"
            )


def _pairs(prefix: str, found: dict[str, Any], asked: dict[str, Any]) -> list[tuple[str, object, object]]:
    return [(prefix + key, found.get(key), asked.get(key)) for key in {**found, **asked}]


def _words(value: object) -> str:
    if not isinstance(value, tuple):
        return str(value)
    more = f" and {len(value) - _SHOWN} more" if len(value) > _SHOWN else ""
    return ", ".join(map(str, value[:_SHOWN])) + more
