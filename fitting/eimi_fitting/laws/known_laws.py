"""The dictionary of the hyperelastic laws by name."""

from __future__ import annotations

from typing import NoReturn

from eimi_fitting.laws.law import Law
from eimi_fitting.suggestion import suggestion


class UnknownLaw(KeyError):
    """No law has this name. The message suggests the most similar name."""

    def __str__(self) -> str:
        return str(self.args[0])


class KnownLaws(dict[str, Law]):
    """A dictionary of hyperelastic laws by name. ``LAWS[law.name] = law`` adds a law.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> LAWS["yeo"]
    Traceback (most recent call last):
    eimi_fitting.laws.known_laws.UnknownLaw: there is no law 'yeo'; did you mean 'yeoh'?
    """

    def __missing__(self, name: str) -> NoReturn:
        raise UnknownLaw(f"there is no law {name!r}; {suggestion(name, self)}")
