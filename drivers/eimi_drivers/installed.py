"""Look up a driver by its name: a driver of this package, of another installed package or of the running program."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, MutableMapping
from difflib import get_close_matches
from importlib.metadata import entry_points
from typing import Generic, TypeVar, cast

from eimi_drivers.interfaces import UnknownDriver, UnusableDriver, raised

Driver = TypeVar("Driver")


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return a suggestion such as "; did you mean 'korad'?"; empty if no name in `names` is similar to `name`."""
    nearest = get_close_matches(name, list(names), n=1)
    return f"; did you mean {nearest[0]!r}?" if nearest else ""


class Drivers(MutableMapping[str, Driver], Generic[Driver]):
    """Mapping from names to the drivers of one kind of instrument.

    A program adds a driver with ``SUPPLIES["mine"] = driver``.

    Parameters
    ----------
    kind : str
        Kind of instrument for messages: "supply", "camera" or "sensor".
    group : str
        Group of entry points (`importlib.metadata`) with which other packages announce their drivers.
    own : Mapping
        Drivers of this package by name.
    reserved : Collection of str
        Further names that a program cannot use for a driver.
    """

    def __init__(self, kind: str, group: str, own: Mapping[str, Driver], reserved: Collection[str] = ()) -> None:
        self._kind = kind
        self._group = group
        self._own = dict(own)
        self._added: dict[str, Driver] = {}
        self._reserved = frozenset(reserved) | self._own.keys()

    def __getitem__(self, name: str) -> Driver:
        """Return the driver with this name.

        Raises
        ------
        UnknownDriver
            No driver has this name (also a KeyError).
        UnusableDriver
            The driver of another package cannot be imported.
        """
        if name in self._own:
            return self._own[name]
        if name in self._added:
            return self._added[name]
        try:
            announced = entry_points(group=self._group)[name]
        except KeyError:
            raise self._unknown(name) from None
        try:
            return cast(Driver, announced.load())
        except Exception as error:  # the module of another package can raise any exception
            raise UnusableDriver(
                f"the {self._kind} driver {name!r} is announced as {announced.value} but cannot be imported: "
                f"{raised(error)}"
            ) from error

    def __setitem__(self, name: str, driver: Driver) -> None:
        """Add a driver until this process ends.

        Raises
        ------
        ValueError
            The name belongs to a driver of this package or is reserved.
        TypeError
            The name is not a text, or the driver is not callable.
        """
        if not isinstance(name, str) or not name:
            raise TypeError(f"the name of a {self._kind} driver should be a text such as 'mine', not {name!r}")
        if name in self._reserved:
            raise ValueError(f"the {self._kind} driver {name!r} belongs to eimi; give your driver another name")
        if not callable(driver):
            raise TypeError(f"the {self._kind} driver {name!r} should be a class or a function, not {driver!r}")
        self._added[name] = driver

    def __delitem__(self, name: str) -> None:
        """Remove a driver that this process added.

        Raises
        ------
        ValueError
            The driver comes from this package or from another package.
        UnknownDriver
            No driver has this name.
        """
        if name in self._added:
            del self._added[name]
        elif name in self:
            raise ValueError(f"the {self._kind} driver {name!r} was not added by this program and cannot be removed")
        else:
            raise self._unknown(name)

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from self.added()
        yield from (name for name in self.announced() if name not in self._added)

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        return name in list(iter(self))

    def added(self) -> tuple[str, ...]:
        """Return the names of the drivers that this process has added, sorted."""
        return tuple(sorted(self._added))

    def announced(self) -> tuple[str, ...]:
        """Return the names of the drivers that other packages announce, sorted."""
        return tuple(sorted(entry_points(group=self._group).names - self._reserved))

    def _unknown(self, name: str) -> UnknownDriver:
        return UnknownDriver(
            f"there is no {self._kind} driver {name!r}; the names are: {', '.join(sorted(self))}"
            f"{did_you_mean(str(name), self)}"
        )
