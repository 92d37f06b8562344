"""Convert set-points to text, and answers of instruments to numbers or lines of text."""

from __future__ import annotations

import re
from decimal import Decimal

_PADDING = b"\0 \t\r\n"
_NUMBER = re.compile(rb"[ \t\r\n]*[+-]?(\d{1,12}\.?\d{0,12}|\.\d{1,12})([eE][+-]?\d{1,2})?[ \t\r\n\0]*")
_NOT_A_MEASUREMENT = 1e30
"""The largest number that counts as a measurement.

SCPI uses 9.91E+37 for "not a number" and 9.9E+37 for infinity (SCPI-99, volume 1, 7.2.1).
"""


def set_point_text(value: float, step: str) -> str:
    """Return a set-point as decimal text, rounded toward zero to a multiple of the step."""
    whole_steps = Decimal(repr(round(float(value), 9))) // Decimal(step)  # the division rounds toward zero
    return f"{whole_steps * Decimal(step) + 0:f}"  # + 0: no minus zero


def number_in(reply: bytes) -> float | None:
    """Return the number in an answer that consists of one number up to 1e30; None for any other answer."""
    if not _NUMBER.fullmatch(reply) or abs(number := float(reply.strip(_PADDING))) > _NOT_A_MEASUREMENT:
        return None
    return number


def line_in(reply: bytes) -> str | None:
    """Return the text of an answer that is one line of printable ASCII text; None for any other answer."""
    text = reply.strip(_PADDING).decode("latin-1")
    return text if text.isascii() and text.isprintable() and text else None
