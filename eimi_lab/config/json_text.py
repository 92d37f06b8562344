"""Parse JSON text."""

from __future__ import annotations

import json
import math
from typing import Any

_MOST_DIGITS = 300  # largest number of digits; a longer integer does not fit into a float


def parse_json(text: str | bytes) -> Any:
    """Parse JSON text.

    Raises
    ------
    ValueError
        If the text is not JSON, is nested too deeply, or contains NaN, an infinite number or an integer with
        more than 300 digits.
    """
    try:
        return json.loads(text, parse_constant=_no_number, parse_float=_finite, parse_int=_short)
    except RecursionError as error:
        raise ValueError("is not usable JSON: it is nested too deeply") from error
    except json.JSONDecodeError as error:
        raise ValueError(f"line {error.lineno}: is not JSON ({error.msg})") from error


def _no_number(word: str) -> float:
    raise ValueError(f"{word} should be a finite number")


def _finite(word: str) -> float:
    value = float(word)
    return value if math.isfinite(value) else _no_number(word[:40])


def _short(word: str) -> int:
    if len(word) > _MOST_DIGITS:
        raise ValueError(f"{word[:20]}... of {len(word)} digits should be a number of at most {_MOST_DIGITS} digits")
    return int(word)
