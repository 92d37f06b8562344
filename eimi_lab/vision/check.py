"""A quality check of a picture, and the flag that records its failure."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """Effect of a failed quality check on the fit.

    UNUSABLE: the fit leaves out the load step. DOUBTFUL: the fit uses larger standard deviations. NOTE: no effect.
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
        The limit of the check.
    remedy : str
        Advice for a person.
    severity : Severity
        Effect on the fit.
    widens : float
        Standard deviation that is added to the edge points (as variance).
    widens_in : {"px", "mm", "width", "depth"}
        Unit of `widens`: "px", "mm", or "width" or "depth" for multiples of that dimension of the specimen.
    """

    name: str
    value: float
    limit: float
    remedy: str
    severity: Severity = Severity.UNUSABLE
    widens: float = 0.0
    widens_in: str = "px"

    def widens_mm(self, pixels_per_mm: float, width_mm: float, depth_mm: float) -> float:
        """Return the standard deviation (mm) that this flag adds to the edge points.

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
    """One quality check of a state (load step).

    Attributes
    ----------
    name : str
        Name of the flag that records a failure.
    finding : str
        Unique key of the measured value.
    quantity : str
        Measured quantity and unit, in words.
    limit : float
        Limit of the measured value.
    remedy : str
        Advice for a person, with placeholders in braces.
    picture : str
        What the example picture in the documentation shows.
    below : bool
        True if values below `limit` fail, False if values above `limit` fail.
    severity : Severity
        Effect of a failure on the fit.
    unusable_beyond : float, optional
        Second limit, beyond which the state is unusable.
    widens : callable, optional
        Function from the measured value to a standard deviation that is added to the edge points.
    widens_in : {"px", "mm", "width", "depth"}
        Unit of this standard deviation.

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
        """Return the flag for a measured value that is beyond the limit.

        Parameters
        ----------
        value : float
            The measured value.
        limit : float, optional
            Limit to report; by default the limit of the check.
        **words : str
            Texts for the placeholders in the advice.
        """
        severity, second_limit = self.severity, self.unusable_beyond
        if second_limit is not None and (value < second_limit if self.below else value > second_limit):
            severity = Severity.UNUSABLE
        widens = self.widens(value) if self.widens is not None and severity is Severity.DOUBTFUL else 0.0
        limit, remedy = self.limit if limit is None else limit, self.remedy.format_map(words)
        return Flag(self.name, float(value), limit, remedy, severity, float(widens), self.widens_in)


def leaves_out(flags: Iterable[Flag]) -> bool:
    """Return whether a fit leaves out a state (load step) with these flags (failed quality checks)."""
    return any(flag.severity is Severity.UNUSABLE for flag in flags)
