"""Log the generations (sets of trial parameters) of a search, so that an interrupted search can be resumed.

A checkpoint consists of JSON lines: first the laws, data and options, then a line for each generation and fit.
"""

from __future__ import annotations

import math
import os
import weakref
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from eimi_fitting.inference.searching.search import Generation, Objectives, OtherSearch
from eimi_lab.config.json_text import parse_json
from eimi_lab.fits.bootstrap_record import ReplicateRecord
from eimi_lab.fits.fits_file import first_fault
from eimi_lab.fits.law_record import Record
from eimi_lab.fits.options import FitOptions
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import refuse_existing
from eimi_lab.process.replacing import patiently
from eimi_lab.process.writer_lock import WriterLock

_SAME = 1e-6  # relative difference up to which a replayed generation is the logged one
_SHOWN = 4  # fits or datasets that a message names
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Head(Record):
    """The first line of a checkpoint (log of a search): laws, data, options and versions."""

    fits: tuple[str, ...]
    datasets: tuple[str, ...]
    options: dict[str, Any]
    versions: dict[str, str]


class GenerationLine(Record):
    """A line of a checkpoint (log of a search): the errors (mm) of all parameter sets that were tried together."""

    fit: int
    generation: int
    objective_mm: tuple[Finite, ...]
    unconverged: int
    unstable: int
    search: Generation


class FinishedLine(Record):
    """A line of a checkpoint (log of a search): a finished fit."""

    fit: int
    finished: FitRecord | ReplicateRecord


class Checkpoint:
    """A new or resumed checkpoint file (log of a search), locked against other programs.

    Parameters
    ----------
    path : Path
        The checkpoint file.
    head : Head
        Laws, data, options and versions of the fits: the first line of the file.
    resume : bool
        Whether to continue an existing file.
    force : bool
        Whether to replace an existing file.

    Raises
    ------
    InputError
        If the file exists and may not be replaced, if its first line differs, or if another program writes to it.
    """

    def __init__(self, path: Path, head: Head, *, resume: bool, force: bool = False) -> None:
        self.path = path
        weakref.finalize(self, WriterLock(path).release)
        if resume and path.exists() and path.stat().st_size:
            _check_same(path, self._head(), Head.model_validate_json(head.model_dump_json()))
            return
        if path.is_file() and not (force or resume):
            raise InputError(
                f"{path}: exists already; give --resume to continue it, --force to replace it, or another name"
            )
        refuse_existing(path, force or resume)
        try:
            _append(path, head, fresh=True)
        except OSError as error:
            raise InputError(f"{path}: cannot be written as a checkpoint ({error.strerror})") from error

    @staticmethod
    def of(path: Path | None, head: Head, *, resume: bool, force: bool) -> Checkpoint:
        """Open the checkpoint (log of a search) that the command line names.

        `resume` continues an existing file, `force` replaces it. Raises InputError if `resume` is given without a path.
        """
        if path is None:
            raise InputError("--resume: give the checkpoint of the interrupted fit, --checkpoint FILE")
        return Checkpoint(path, head, resume=resume, force=force)

    def _lines(self) -> list[Any]:
        """Return the decoded JSON of each complete line."""
        complete = []
        try:
            text = self.path.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read as a checkpoint ({error.strerror})") from error
        for line in text.split("\n"):
            try:
                complete.append(parse_json(line))
            except ValueError:
                continue
        return complete

    def _head(self) -> Head:
        try:
            return Head.model_validate(next(iter(self._lines()), None))
        except ValidationError as error:
            raise InputError(
                f"{self.path}: is not a checkpoint of `eimi fit`: the first line of the file is wrong"
            ) from error

    def _read(self) -> tuple[list[GenerationLine], list[FinishedLine]]:
        generations: list[GenerationLine] = []
        finished: list[FinishedLine] = []
        fits = len(self._head().fits)
        for number, content in enumerate(self._lines()[1:], start=2):
            is_finished = isinstance(content, dict) and "finished" in content
            where = f"{self.path}: complete line {number}"
            try:
                line = (FinishedLine if is_finished else GenerationLine).model_validate(content)
            except ValidationError as error:
                raise InputError(f"{where}: {first_fault(error)}") from error
            if not 0 <= line.fit < fits:
                raise InputError(f"{where}: fit = {line.fit} should be from 0 to {fits - 1}")
            if isinstance(line, FinishedLine):
                finished.append(line)
            else:
                generations.append(line)
        return generations, finished

    def finished(self) -> dict[int, FitRecord | ReplicateRecord]:
        """Return the finished fits, by the index of the fit."""
        return {line.fit: line.finished for line in self._read()[1]}

    def finish(self, fit: int, record: FitRecord | ReplicateRecord) -> None:
        """Append a finished fit to the checkpoint (log of a search)."""
        _append(self.path, FinishedLine(fit=fit, finished=record))

    def log_of(self, fit: int) -> GenerationLog:
        """Return the log of the fit with the index `fit`."""
        by_number: dict[int, GenerationLine] = {}
        for line in self._read()[0]:
            if line.fit == fit:
                by_number.setdefault(line.generation, line)
        logged: list[GenerationLine] = []
        while len(logged) + 1 in by_number:  # generations after a missing line are computed again
            logged.append(by_number[len(logged) + 1])
        return GenerationLog(self.path, fit, tuple(logged))


@dataclass
class GenerationLog:
    """The logged generations of one search; a generation is a group of parameter sets that are tried together."""

    path: Path
    fit: int
    logged: tuple[GenerationLine, ...]
    generation: int = 0

    @property
    def replay(self) -> tuple[Objectives, ...]:
        """Return the logged errors (mm) of all parameter sets that a search has tried."""
        return tuple(Objectives(line.objective_mm, line.unconverged, line.unstable) for line in self.logged)

    def __call__(self, generation: Generation, objectives: Objectives) -> None:
        """Append a new generation (parameter sets that were tried together) to the log.

        Raises OtherSearch if a repeated generation differs from the logged generation.
        """
        self.generation += 1
        if self.generation <= len(self.logged):
            if not _same(generation, self.logged[self.generation - 1].search):
                raise OtherSearch(
                    f"generation {self.generation} of the search differs by more than rounding errors from the "
                    "generation in the checkpoint"
                )
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


def _same(replayed: Generation, logged: Generation) -> bool:
    """Return whether a repeated generation of a search agrees with the logged one, apart from rounding errors."""
    # Processors of different kinds round differently in the last digits.
    pairs = zip(astuple(replayed), astuple(logged), strict=True)
    return all(math.isclose(replayed_number, logged_number, rel_tol=_SAME) for replayed_number, logged_number in pairs)


def _append(path: Path, line: Record, fresh: bool = False) -> None:
    """Append one line to the checkpoint, or replace an existing file if `fresh` is true."""
    # A single write, so that the lines of several processes do not mix. The line break comes first, so that an
    # incomplete last line of the file does not damage the new line.
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | (os.O_TRUNC if fresh else 0)
    descriptor = patiently(lambda: os.open(path, flags, 0o666))
    try:
        os.write(descriptor, ("" if fresh else "\n").encode() + line.model_dump_json().encode())
        os.fsync(descriptor)
    except OSError as error:  # this error does not name the file
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        os.close(descriptor)


def _check_same(path: Path, stored: Head, wanted: Head) -> None:
    """Raise InputError if the checkpoint belongs to other laws, data, options or versions."""
    for what, there, here in (
        ("fits", stored.fits, wanted.fits),
        ("datasets (sha256)", stored.datasets, wanted.datasets),
        *_pairs("", asdict(FitOptions()) | stored.options, wanted.options),  # an older file lacks newer options
        *_pairs("version of ", stored.versions, wanted.versions),
    ):
        if there != here:
            raise InputError(
                f"{path}: to resume, {what} should be the same: {_words(there)} in the checkpoint, {_words(here)} here"
            )


def _pairs(prefix: str, stored: dict[str, Any], wanted: dict[str, Any]) -> list[tuple[str, object, object]]:
    return [(prefix + key, stored.get(key), wanted.get(key)) for key in {**stored, **wanted}]


def _words(value: object) -> str:
    if not isinstance(value, tuple):
        return str(value)
    more = f" and {len(value) - _SHOWN} more" if len(value) > _SHOWN else ""
    return ", ".join(map(str, value[:_SHOWN])) + more
