"""A value with its unit and 95 % intervals."""

from __future__ import annotations

from dataclasses import dataclass

# Half-width of the 95 % interval of a normal distribution, in standard deviations.
NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Quantity:
    """A value with its unit and 95 % intervals.

    Parameters
    ----------
    value : float
        The value.
    unit : str
        Unit of the value, ``"1"`` for a quantity without a unit.
    interval_95 : tuple of float
        Lower and upper end of the 95 % interval, in the same unit. It contains noise, mesh and all given uncertainties.
    interval_95_fit : tuple of float, optional
        Lower and upper end of a 95 % interval that contains only noise and mesh.

    Examples
    --------
    >>> Quantity(46390.0, "Pa", (45310.0, 47480.0), (46310.0, 46480.0)).interval_95
    (45310.0, 47480.0)
    """

    value: float
    unit: str
    interval_95: tuple[float, float]
    interval_95_fit: tuple[float, float] | None = None
