"""The states (load steps) of a dataset that a fit used and left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

FEW_POINTS = "too few edge points"  # instead of the name of a flag, for a state without a flag


@dataclass(frozen=True)
class FlaggedState:
    """A state with defects: the index of the state in the dataset, and the names of the defects."""

    state: int
    flags: tuple[str, ...]


@dataclass(frozen=True)
class WidenedState:
    """A state with defects, whose points have an additional standard deviation `by_mm` (mm) in a fit."""

    state: int
    by_mm: float


@dataclass(frozen=True)
class StatesUsed:
    """The states (load steps) of a dataset that a fit used and left out.

    Attributes
    ----------
    total : int
        Number of states in the dataset.
    left_out : tuple of FlaggedState
        States that were not used.
    flagged : tuple of FlaggedState
        Used states with defects.
    widened : tuple of WidenedState
        Used states with a larger standard deviation of their points.

    Examples
    --------
    >>> used = StatesUsed(16, (FlaggedState(2, ("DEFOCUS",)), FlaggedState(7, ("DEFOCUS", "SATURATED"))), ())
    >>> used.in_words()
    '14 of 16 states used; left out: DEFOCUS in 2 (states 2, 7), SATURATED in 1 (state 7)'
    """

    total: int
    left_out: tuple[FlaggedState, ...]
    flagged: tuple[FlaggedState, ...]
    widened: tuple[WidenedState, ...] = ()

    def in_words(self) -> str:
        """Return a text with the number of used states, and with the defects of the states."""
        words = f"{self.total - len(self.left_out)} of {self.total} states used"
        if self.left_out:
            words += f"; left out: {_by_flag(self.left_out)}"
        if self.flagged:
            words += f"; used although they have flags: {_by_flag(self.flagged)}"
        if self.widened:
            widest = max(self.widened, key=lambda state: state.by_mm)
            largest = f"the largest increase is {widest.by_mm:.2g} mm in state {widest.state}"
            number = f"{len(self.widened)} state{'s' * (len(self.widened) > 1)}"
            words += f"; the uncertainty of the points was increased in {number} ({largest})"
        return words


def _by_flag(states: Sequence[FlaggedState]) -> str:
    by_flag: dict[str, list[str]] = {}
    for flagged in states:
        for flag in flagged.flags:
            by_flag.setdefault(flag, []).append(str(flagged.state))
    return ", ".join(
        f"{flag} in {len(numbers)} (state{'s' * (len(numbers) > 1)} {', '.join(numbers)})"
        for flag, numbers in by_flag.items()
    )
