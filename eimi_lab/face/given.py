"""Convert the arguments of the Python interface, which are paths, names of shipped files, or objects."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeAlias, TypeVar

from eimi_fitting.suggestion import suggestion
from eimi_lab.config.protocol import Protocol, load_protocol
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.dataset.reading import Dataset
from eimi_lab.process.outputs import check_distinct, refuse_existing

AnyPath: TypeAlias = str | Path
"""Path of a file."""
AnyDataset: TypeAlias = AnyPath | Dataset
"""Path of a dataset, or an open dataset."""
AnyProtocol: TypeAlias = AnyPath | Protocol
AnySpecimen: TypeAlias = AnyPath | SpecimenFile
AnyRig: TypeAlias = AnyPath | Rig
SectionName: TypeAlias = Literal["solid", "plane-strain", "plane-stress"]

P = ParamSpec("P")
T = TypeVar("T")


def named_options(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function that calls ``function``, and raises TypeError with a suggestion for an unknown option."""
    names = tuple(inspect.signature(function).parameters)

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        for name in kwargs:
            if name not in names:
                raise TypeError(f"{function.__name__}() has no option {name!r}; {suggestion(name, names)}")
        return function(*args, **kwargs)

    return called


def several(given: Any) -> list[Any]:
    """Return a list or tuple as a list; return a list with one element for any other object."""
    if isinstance(given, list | tuple):
        return list(given)
    return [given]


def path_of(given: AnyDataset) -> Path:
    """Return the path of a dataset that is given as a path or as an open dataset."""
    return given.path if isinstance(given, Dataset) else Path(given)


@contextmanager
def closed_meanwhile(given: Sequence[AnyDataset]) -> Iterator[list[Path]]:
    """Close the open datasets among the given datasets during a ``with`` block, so that their files can be written.

    Yields the paths of all given datasets.
    """
    opened = [dataset for dataset in given if isinstance(dataset, Dataset)]
    for dataset in opened:
        dataset.close()
    try:
        yield [path_of(dataset) for dataset in given]
    finally:
        for dataset in opened:
            dataset.reopen()


def protocol_of(given: AnyProtocol) -> Protocol:
    """Return a protocol that is given as an object, or load it from a path or a shipped file.

    Raises InputError if the file is not a valid protocol.
    """
    return given if isinstance(given, Protocol) else load_protocol(Path(given))


def specimen_of(given: AnySpecimen) -> SpecimenFile:
    """Return a specimen that is given as an object, or load it from a path or a shipped file.

    Raises InputError if the file is not a valid specimen.
    """
    return given if isinstance(given, SpecimenFile) else load_specimen(Path(given))


def rig_of(given: AnyRig) -> Rig:
    """Return a rig that is given as an object, or load it from a path or a shipped file.

    Raises InputError if the file is not a valid rig.
    """
    return given if isinstance(given, Rig) else load_rig(Path(given))


def output_of(output: AnyPath | None, read: Sequence[Path], force: bool) -> Path | None:
    """Return the path of an output file; None if no output is given.

    Raises InputError if the output is one of the files ``read``, or if it exists and ``force`` is False.
    """
    path = None if output is None else Path(output)
    check_distinct(read, [path] if path else [])
    if path:
        refuse_existing(path, force)
    return path


def files(*given: object) -> list[Path]:
    """Return all arguments that are a str or a Path as paths, without duplicates."""
    paths = (argument for argument in given if isinstance(argument, str | Path))
    return list(dict.fromkeys(map(Path, paths)))
