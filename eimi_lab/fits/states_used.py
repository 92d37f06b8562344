"""Which states of a dataset a fit used, and which it left out for which flags: said wherever its result is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

FEW_POINTS = "too few edge points"  # in place of a flag's name, where no flag says why


@dataclass(frozen=True)
class FlaggedState:
    """A state by its number in the dataset, and the names of its flags."""

    state: int
    flags: tuple[str, ...]


@dataclass(frozen=True)
class WidenedState:
    """A state by its number, and the standard deviation that its flags added to that of its points."""

    state: int
    by_mm: float


@dataclass(frozen=True)
class StatesUsed:
    """total: states in the dataset; left_out: those that were not used; flagged: those used in spite of their flags.

    widened: of those the ones whose points count for less.

    Examples
    --------
    >>> used = StatesUsed(16, (FlaggedState(2, ("DEFOCUS",)), FlaggedState(7, ("DEFOCUS", "SATURATED"))), ())
    >>> used.in_words()
    '14 of 16 states used; left out 2 DEFOCUS (2, 7), 1 SATURATED (7)'
    """

    total: int
    left_out: tuple[FlaggedState, ...]
    flagged: tuple[FlaggedState, ...]
    widened: tuple[WidenedState, ...] = ()

    def in_words(self) -> str:
        """How many were used; by flag how many were left out, or used all the same, and which."""
        words = f"{self.total - len(self.left_out)} of {self.total} states used"
        if self.left_out:
            words += f"; left out {_by_flag(self.left_out)}"
        if self.flagged:
            words += f"; used in spite of {_by_flag(self.flagged)}"
        if self.widened:
            widest = max(self.widened, key=lambda state: state.by_mm)
            words += f"; points widened in {len(self.widened)}, by up to {widest.by_mm:.2g} mm ({widest.state})"
        return words


def _by_flag(states: Sequence[FlaggedState]) -> str:
    by_flag: dict[str, list[str]] = {}
    for own in states:
        for flag in own.flags:
            by_flag.setdefault(flag, []).append(str(own.state))
    return ", ".join(f"{len(numbers)} {flag} ({', '.join(numbers)})" for flag, numbers in by_flag.items())
