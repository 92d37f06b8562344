"""A check of a state, the flag that it raises, and how grave that is. `flags` has the table of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """What a flag means for the state: it is left out of a fit, its points are in doubt, or somebody should know."""

    UNUSABLE = "unusable"
    DOUBTFUL = "doubtful"
    NOTE = "note"


@dataclass(frozen=True)
class Flag:
    """A quality check that a state did not pass: the value found, the limit, what to do about it, how grave it is.

    widens: a standard deviation that the state's points get in addition, in pixels, millimetres or in shares of the
    specimen's width or depth, as `widens_in` says.
    """

    name: str
    value: float
    limit: float
    remedy: str
    severity: Severity = Severity.UNUSABLE
    widens: float = 0.0
    widens_in: str = "px"

    def widens_mm(self, pixels_per_mm: float, width_mm: float, depth_mm: float) -> float:
        """What the points' standard deviation gets in addition, mm."""
        return (
            self.widens * {"px": 1.0 / pixels_per_mm, "mm": 1.0, "width": width_mm, "depth": depth_mm}[self.widens_in]
        )


@dataclass(frozen=True, kw_only=True)
class Check:
    """One row of the table.

    name: of the flag; two checks may raise the same one. finding: the name under which the value is measured.
    quantity: what the value is. below: whether values below the limit are flagged, and not those above. remedy: one
    sentence; a word in braces is filled in by whoever raises the flag. picture: what the rendered example shows, once
    for each name. severity: of a value beyond the limit; beyond `unusable_beyond` the state is unusable. widens: what a
    doubtful value adds to the standard deviation of the state's points, in the unit `widens_in`.
    """

    name: str
    finding: str
    quantity: str
    limit: float
    remedy: str
    picture: str = ""
    below: bool = False
    severity: Severity = Severity.UNUSABLE
    unusable_beyond: float | None = None
    widens: Callable[[float], float] | None = None
    widens_in: str = "px"

    def flag(self, value: float, limit: float | None = None, **words: str) -> Flag:
        """The flag for a value that is beyond the limit, which may be another than the table's."""
        severity, least = self.severity, self.unusable_beyond
        if least is not None and (value < least if self.below else value > least):
            severity = Severity.UNUSABLE
        widens = self.widens(value) if self.widens is not None and severity is Severity.DOUBTFUL else 0.0
        limit, remedy = self.limit if limit is None else limit, self.remedy.format_map(words)
        return Flag(self.name, float(value), limit, remedy, severity, float(widens), self.widens_in)


def leaves_out(flags: Iterable[Flag]) -> bool:
    """Whether a fit leaves a state with these flags out."""
    return any(flag.severity is Severity.UNUSABLE for flag in flags)
