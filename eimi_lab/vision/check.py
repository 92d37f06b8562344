"""A quality check of a state (load step), the flag that the check raises, and the severity of the flag.

The table of all checks is in `flags`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """The consequence of a flag (failed quality check) for the state (load step) that has the flag.

    UNUSABLE: a fit leaves out the state. DOUBTFUL: a fit uses the state, with a larger standard deviation of the points
    of the edges. NOTE: the fit is not affected, but a person should read the remedy (advice).
    """

    UNUSABLE = "unusable"
    DOUBTFUL = "doubtful"
    NOTE = "note"


@dataclass(frozen=True)
class Flag:
    """The record of a quality check that a state (load step) did not pass.

    Attributes
    ----------
    name : str
        Name of the flag, for example ``"SATURATED"``.
    value : float
        The measured value.
    limit : float
        Limit of the check. The value is above the limit or, for some checks, below the limit.
    remedy : str
        A sentence that tells a person what to do.
    severity : Severity
        The consequence of the flag for the state.
    widens : float
        Standard deviation that the flag adds to the edge points of the state (the variances are added).
    widens_in : {"px", "mm", "width", "depth"}
        Unit of `widens`: a pixel, a millimetre, the specimen's width, or the specimen's depth.
    """

    name: str
    value: float
    limit: float
    remedy: str
    severity: Severity = Severity.UNUSABLE
    widens: float = 0.0
    widens_in: str = "px"

    def widens_mm(self, pixels_per_mm: float, width_mm: float, depth_mm: float) -> float:
        """Convert `widens` to mm: the standard deviation that this flag adds to the edge points of a load step.

        A flag is a failed quality check. `widens` is in the unit `widens_in`.

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
    """One quality check of a state (load step): a row of the table of flags, which lists all checks.

    Attributes
    ----------
    name : str
        Name of the flag that the check raises. Several checks may raise a flag of the same name.
    finding : str
        Key of the measured value; unique in the table.
    quantity : str
        The measured quantity and its unit, as the documentation names them.
    limit : float
        Limit of the measured value. The check raises its flag for values above the limit; see `below`.
    remedy : str
        A sentence that tells a person what to do. The method `flag` replaces the words in braces.
    picture : str
        What the example picture in the documentation shows. Of several checks with the same name, only one has a
        picture.
    below : bool
        True if the flag is raised for values below `limit` (and `unusable_beyond`), not for values above.
    severity : Severity
        Severity of a value beyond the limit.
    unusable_beyond : float, optional
        Second limit: a value beyond this limit makes the state unusable.
    widens : callable, optional
        Function from a doubtful measured value to a standard deviation, by which the edge points of the state become
        more uncertain.
    widens_in : {"px", "mm", "width", "depth"}
        Unit of the standard deviation that `widens` returns; see `Flag`.

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
        """Return the flag (record of the failed check) for a value that is beyond the limit of the check.

        Parameters
        ----------
        value : float
            The measured value.
        limit : float, optional
            Limit that the flag reports in place of the limit in the table.
        **words : str
            For each word in braces in the remedy (advice), the text that replaces this word.
        """
        severity, second_limit = self.severity, self.unusable_beyond
        if second_limit is not None and (value < second_limit if self.below else value > second_limit):
            severity = Severity.UNUSABLE
        widens = self.widens(value) if self.widens is not None and severity is Severity.DOUBTFUL else 0.0
        limit, remedy = self.limit if limit is None else limit, self.remedy.format_map(words)
        return Flag(self.name, float(value), limit, remedy, severity, float(widens), self.widens_in)


def leaves_out(flags: Iterable[Flag]) -> bool:
    """Return whether a fit leaves out a state (load step) with the given flags.

    A flag is the record of a quality check that the state did not pass. A fit leaves the state out if a flag has the
    severity `Severity.UNUSABLE`.
    """
    return any(flag.severity is Severity.UNUSABLE for flag in flags)
