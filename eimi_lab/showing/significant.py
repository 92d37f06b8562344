"""Write a number with its significant digits, including zeros at the end."""

from __future__ import annotations

import math

_MOST_DECIMALS = 6  # a number that needs more decimals is written with an exponent
_LARGEST = 1e7  # a number from this size on is written with an exponent


def significant(value: float, digits: int, sign: str = "") -> str:
    """Return a number as text with a given number of significant digits, including zeros at the end.

    All digits before the decimal point are written.

    Parameters
    ----------
    value : float
    digits : int
        The number of significant digits.
    sign : str
        `+` to write the sign of positive numbers too.

    Examples
    --------
    >>> significant(46.5, 4), significant(1.0, 2, "+"), significant(123.0, 2), significant(9.9996, 4)
    ('46.50', '+1.0', '123', '10.00')
    >>> significant(0.0, 4), significant(0.1003, 4), significant(1.5e-7, 4), significant(-3.2e9, 2)
    ('0', '0.1003', '1.500e-07', '-3.2e+09')
    """
    if value == 0 or not math.isfinite(value):
        return f"{value + 0.0:{sign}g}"
    rounded = float(f"{value:.{digits}g}")
    decimals = max(digits - 1 - math.floor(math.log10(abs(rounded))), 0)
    if decimals > _MOST_DECIMALS or abs(value) >= _LARGEST:
        return f"{value:{sign}.{digits - 1}e}"
    return f"{value:{sign}.{decimals}f}"
