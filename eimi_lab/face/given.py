"""What a caller gives: paths, names of shipped files, or objects that are open or loaded already."""

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

AnyPath: TypeAlias = str | Path
"""A path."""
AnyDataset: TypeAlias = AnyPath | Dataset
"""A dataset's path, or the dataset itself."""
AnyProtocol: TypeAlias = AnyPath | Protocol
AnySpecimen: TypeAlias = AnyPath | SpecimenFile
AnyRig: TypeAlias = AnyPath | Rig
SectionName: TypeAlias = Literal["solid", "plane-strain", "plane-stress"]

P = ParamSpec("P")
T = TypeVar("T")


def named_options(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function such that an option that it does not have is an error with a suggestion."""
    names = tuple(inspect.signature(function).parameters)

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        for name in kwargs:
            if name not in names:
                raise TypeError(f"{function.__name__}() has no option {name!r}; {suggestion(name, names)}")
        return function(*args, **kwargs)

    return called


def several(given: Any) -> list[Any]:
    """Return what was given as a list: one thing, or a sequence of them. A text is one thing."""
    if isinstance(given, list | tuple):
        return list(given)
    return [given]


def path_of(given: AnyDataset) -> Path:
    """Return a dataset's path."""
    return given.path if isinstance(given, Dataset) else Path(given)


@contextmanager
def closed_meanwhile(given: Sequence[AnyDataset]) -> Iterator[list[Path]]:
    """Yield the paths of datasets, and close those that are open meanwhile: their files may have to be written to."""
    opened = [dataset for dataset in given if isinstance(dataset, Dataset)]
    for dataset in opened:
        dataset.close()
    try:
        yield [path_of(dataset) for dataset in given]
    finally:
        for dataset in opened:
            dataset.reopen()


def protocol_of(given: AnyProtocol) -> Protocol:
    """Return a protocol, read from its file if need be. Raises InputError."""
    return given if isinstance(given, Protocol) else load_protocol(Path(given))


def specimen_of(given: AnySpecimen) -> SpecimenFile:
    """Return a specimen, read from its file if need be. Raises InputError."""
    return given if isinstance(given, SpecimenFile) else load_specimen(Path(given))


def rig_of(given: AnyRig) -> Rig:
    """Return a rig, read from its file if need be. Raises InputError."""
    return given if isinstance(given, Rig) else load_rig(Path(given))


def files(*given: object) -> list[Path]:
    """Return those of the arguments that are paths, each once."""
    paths = (one for one in given if isinstance(one, str | Path))
    return list(dict.fromkeys(map(Path, paths)))
