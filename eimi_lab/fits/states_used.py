"""The states of a dataset that a fit used, and the flags of the states that were left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

FEW_POINTS = "too few edge points"  # instead of the name of a flag, for a state without a flag


@dataclass(frozen=True)
class FlaggedState:
    """The index of a state in its dataset, and the names of its flags."""

    state: int
    flags: tuple[str, ...]


@dataclass(frozen=True)
class WidenedState:
    """The index of a state with flags, and the standard deviation (mm) that is added for them to that of its points."""

    state: int
    by_mm: float


@dataclass(frozen=True)
class StatesUsed:
    """The use of the states of a dataset in a fit.

    Attributes
    ----------
    total : int
        Number of states in the dataset.
    left_out : tuple of FlaggedState
        States that were not used.
    flagged : tuple of FlaggedState
        States that were used in spite of their flags.
    widened : tuple of WidenedState
        Used states whose points have a larger standard deviation because of their flags.

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
        """Return the number of used states and, for each flag, the states left out or used despite it."""
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
    for flagged in states:
        for flag in flagged.flags:
            by_flag.setdefault(flag, []).append(str(flagged.state))
    return ", ".join(f"{len(numbers)} {flag} ({', '.join(numbers)})" for flag, numbers in by_flag.items())
