"""Format a quantity and its interval, with a suitable unit and a suitable number of digits."""

from __future__ import annotations

import math

from eimi_fitting.inference.evidence.quantity import Quantity

NO_BREAK = "\N{NO-BREAK SPACE}"


def format_quantity(quantity: Quantity) -> str:
    """Return a value with its 95 % interval as text; a pressure is given in kPa, MPa or GPa.

    Examples
    --------
    >>> format_quantity(Quantity(46390.0, "Pa", (46310.0, 46500.0)))
    '46.390 kPa [46.310, 46.500]'
    """
    scale, unit = _unit(quantity)
    places = _places(scale, quantity)
    value, low, high = (f"{scale * number + 0.0:z.{places}f}" for number in (quantity.value, *quantity.interval_95))
    return f"{value}{unit and ' '}{unit} [{low}, {high}]"


def value_and_interval(quantity: Quantity) -> tuple[str, str]:
    """Return a value and its 95 % interval, which is also given in per cent, as two texts.

    Examples
    --------
    >>> [text.replace(NO_BREAK, "_") for text in value_and_interval(Quantity(46375.0, "Pa", (46256.0, 46497.0)))]
    ['46.38_kPa', '46.26 to 46.50_kPa, ±0.26_%']
    """
    scale, unit = _unit(quantity)
    low, high = (scale * bound for bound in quantity.interval_95)
    value, places = scale * quantity.value, _places(scale, quantity)
    ends = f"{low:.{places}f} to {high:.{places}f}{NO_BREAK}{unit}".strip()
    below, above = (100 * (end / value - 1) for end in (low, high))
    share = f"±{0.5 * (above - below):.2g}{NO_BREAK}%"
    if abs(above + below) > 0.1 * (above - below):
        share = f"{below:+.2g}{NO_BREAK}% to {above:+.2g}{NO_BREAK}%"
    return f"{value:.{places}f}{NO_BREAK}{unit}".strip(), f"{ends}, {share}".replace("-", "−")


def _places(scale: float, quantity: Quantity) -> int:
    """Return the number of decimals for a quantity that is multiplied by `scale`."""
    low, high = quantity.interval_95
    half = 0.5 * scale * (high - low)
    return min(max(1 - math.floor(math.log10(half)), 0), 6) if half > 0 else 4


def _unit(quantity: Quantity) -> tuple[float, str]:
    """Return the factor on a value for printing, and its unit: kPa, MPa or GPa; 1 and no unit if it is no pressure."""
    if quantity.unit != "Pa":
        return 1.0, ""
    size = max(map(abs, quantity.interval_95))
    return (1e-9, "GPa") if size >= 1e9 else (1e-6, "MPa") if size >= 1e7 else (1e-3, "kPa")
