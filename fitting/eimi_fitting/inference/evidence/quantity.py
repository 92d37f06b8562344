"""A number with its unit and its intervals."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """A value and the two ends of its 95 % interval, all in one unit; the unit is "1" for a plain number.

    interval_95 holds all that is stated as uncertain; interval_95_fit noise and mesh alone, where that is known.

    Examples
    --------
    >>> Quantity(46390.0, "Pa", (45310.0, 47480.0), (46310.0, 46480.0)).interval_95
    (45310.0, 47480.0)
    """

    value: float
    unit: str
    interval_95: tuple[float, float]
    interval_95_fit: tuple[float, float] | None = None
