"""A quality check of a state, the flag that it raises, and how severe the flag is.

The table of all checks is in `flags`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """The consequence of a flag for its state.

    UNUSABLE: a fit leaves the state out. DOUBTFUL: a fit uses the state, and gives its points a larger standard
    deviation. NOTE: the fit is not affected; a person should read the remedy.
    """

    UNUSABLE = "unusable"
    DOUBTFUL = "doubtful"
    NOTE = "note"


@dataclass(frozen=True)
class Flag:
    """A quality check that a state did not pass.

    Attributes
    ----------
    name : str
        Name of the flag, for example ``"SATURATED"``.
    value : float
        The measured value.
    limit : float
        The limit that the value exceeds, or falls below.
    remedy : str
        One sentence that says what to do about the flag.
    severity : Severity
        What the flag means for the state.
    widens : float
        Standard deviation that is added, as a root sum of squares, to that of the state's points.
    widens_in : {"px", "mm", "width", "depth"}
        Unit of `widens`: pixels, millimetres, or shares of the specimen's width or depth.
    """

    name: str
    value: float
    limit: float
    remedy: str
    severity: Severity = Severity.UNUSABLE
    widens: float = 0.0
    widens_in: str = "px"

    def widens_mm(self, pixels_per_mm: float, width_mm: float, depth_mm: float) -> float:
        """Return the added standard deviation of the points in mm.

        Parameters
        ----------
        pixels_per_mm : float
            Scale of the calibration.
        width_mm, depth_mm : float
            Width and depth of the specimen.
        """
        return (
            self.widens * {"px": 1.0 / pixels_per_mm, "mm": 1.0, "width": width_mm, "depth": depth_mm}[self.widens_in]
        )


@dataclass(frozen=True, kw_only=True)
class Check:
    """One row of the table of flags.

    Attributes
    ----------
    name : str
        Name of the flag. Two checks may raise a flag of the same name.
    finding : str
        Name under which the value is measured; unique in the table.
    quantity : str
        The quantity and its unit, in the words of the documentation.
    limit : float
        Values above the limit are flagged.
    remedy : str
        One sentence that says what to do. `flag` replaces the words in braces.
    picture : str
        The content of the rendered example picture; stated once for each name.
    below : bool
        Flag values below the limit in place of those above it.
    severity : Severity
        Severity of a value beyond the limit.
    unusable_beyond : float, optional
        Beyond this second limit the state is unusable.
    widens : callable, optional
        Map a doubtful value to the standard deviation that it adds to the state's points.
    widens_in : {"px", "mm", "width", "depth"}
        Unit of the value that `widens` returns; see `Flag`.

    Examples
    --------
    >>> blur = Check(
    ...     name="DEFOCUS", finding="blur_px", quantity="blur, px", limit=2.5, remedy="Focus the {lens}.",
    ...     severity=Severity.NOTE, unusable_beyond=8.0,
    ... )
    >>> flag = blur.flag(9.0, lens="telecentric lens")
    >>> flag.remedy, str(flag.severity)
    ('Focus the telecentric lens.', 'unusable')
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
        """Return the flag for a value that is beyond the limit.

        Parameters
        ----------
        value : float
            The measured value.
        limit : float, optional
            Limit to report in place of the table's.
        **words : str
            Replacements for the words in braces in the remedy.
        """
        severity, second_limit = self.severity, self.unusable_beyond
        if second_limit is not None and (value < second_limit if self.below else value > second_limit):
            severity = Severity.UNUSABLE
        widens = self.widens(value) if self.widens is not None and severity is Severity.DOUBTFUL else 0.0
        limit, remedy = self.limit if limit is None else limit, self.remedy.format_map(words)
        return Flag(self.name, float(value), limit, remedy, severity, float(widens), self.widens_in)


def leaves_out(flags: Iterable[Flag]) -> bool:
    """Return whether a fit leaves out a state that has these flags."""
    return any(flag.severity is Severity.UNUSABLE for flag in flags)
