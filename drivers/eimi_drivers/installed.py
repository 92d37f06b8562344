"""Drivers by name: those of this package, and those that other installed packages announce."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from typing import Generic, TypeVar, cast

from eimi_drivers.interfaces import InstrumentError

Driver = TypeVar("Driver")


class Drivers(Mapping[str, Driver], Generic[Driver]):
    """The drivers of one kind, "supply" or "camera".

    own: those of this package. group: the group of entry points (`importlib.metadata`) in which another
    package announces its own; one is imported when it is asked for. A name of this package cannot be taken
    over.
    """

    def __init__(self, kind: str, group: str, own: Mapping[str, Driver]) -> None:
        self._kind = kind
        self._group = group
        self._own = dict(own)

    def __getitem__(self, name: str) -> Driver:
        """The driver of that name. Raises KeyError, or InstrumentError when it cannot be imported."""
        if name in self._own:
            return self._own[name]
        try:
            announced = entry_points(group=self._group)[name]
        except KeyError:
            raise KeyError(name) from None
        try:
            return cast(Driver, announced.load())
        except (ImportError, AttributeError) as error:
            raise InstrumentError(
                f"the {self._kind} driver {name!r} is announced as {announced.value} but cannot be imported: {error}"
            ) from error

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from self.announced()

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        return name in list(iter(self))

    def announced(self) -> tuple[str, ...]:
        """The names that other packages announce."""
        return tuple(sorted(entry_points(group=self._group).names - set(self._own)))

    def find(self, name: str) -> Driver:
        """The driver of that name. Raises InstrumentError naming those that exist."""
        try:
            return self[name]
        except KeyError:
            raise InstrumentError(
                f"there is no {self._kind} driver {name!r}; those that exist: {', '.join(sorted(self))}"
            ) from None
