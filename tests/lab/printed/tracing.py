"""Find the stored number from which each printed number comes, and the ratio of the printed to the stored number.

Each stored number is changed in turn; the printed numbers that change come from the changed number.
"""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

Texts = Mapping[str, str]
"""Printed texts by name."""

_NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)")
_UNIT = re.compile(r"\s*(%|µm|mm|mT|kPa|MPa|GPa|Pa|pixels/mm|pixel|T\b|A\b|kg/m³|s\b|°)?")
_CHANGE = 1.3  # factor by which a number is changed; smaller changes may be lost by rounding
_ROUNDING = 0.06  # largest relative change of a printed number that a different number of digits may cause
_FACTORS = (1.0, 1e3, 1e-3, 1e2, 1e-2, 1e6, 1e-6, -1.0)


@dataclass(frozen=True)
class _Printed:
    text: str
    value: float
    unit: str


def filled(content: Any, start: int = 0) -> Any:
    # Return nested lists and dictionaries with slightly changed floats, so that all floats differ.
    # start: how many floats were changed before.
    count = start

    def fill(value: Any) -> Any:
        nonlocal count
        if isinstance(value, dict):
            return {key: fill(one) for key, one in value.items()}
        if isinstance(value, list):
            return [fill(one) for one in value]
        if isinstance(value, float) and value:
            count += 1
            return value * (1 + 0.0007 * count)
        return value

    return fill(content)


def numbers_of(content: Any, path: str = "") -> dict[str, float]:
    # Return the numbers of nested lists and dictionaries by their paths, such as `budget.0.effect_percent`.
    if isinstance(content, dict):
        parts = content.items()
    elif isinstance(content, list):
        parts = enumerate(content)  # type: ignore[assignment]
    elif isinstance(content, (int, float)) and not isinstance(content, bool):
        return {path: content}
    else:
        return {}
    return {key: one for name, part in parts for key, one in numbers_of(part, f"{path}.{name}".strip(".")).items()}


def changed(content: Any, path: str) -> Any:
    # Return a copy of nested lists and dictionaries, with a larger number at `path`.
    again = copy.deepcopy(content)
    part, *rest = again, *path.split(".")
    keys = [int(key) if key.isdigit() else key for key in rest]
    part = again
    for key in keys[:-1]:
        part = part[key]
    value = part[keys[-1]]
    part[keys[-1]] = value + 7 if isinstance(value, int) else value * _CHANGE if value else 0.1
    return again


def traced(content: Any, printed: Callable[[Any], Texts], skip: tuple[str, ...] = ()) -> dict[str, list[str]]:
    # Find out which stored number each printed number comes from.
    # The result describes, for each printed text, every number: the path of the stored number, the ratio of the printed
    # to the stored number, and the unit. content: nested lists and dictionaries with the stored numbers. printed:
    # function that returns the printed texts by name. skip: beginnings of paths of stored numbers to leave out.
    before = {name: _numbers(text) for name, text in printed(content).items()}
    values = numbers_of(content)
    origins: dict[tuple[str, int], list[str]] = {}
    for path in values:
        if path.startswith(skip):
            continue
        try:
            texts = printed(changed(content, path))
        except ValueError:  # a record with contradictory numbers is refused; the changed number then has no source
            continue
        for name, text in texts.items():
            after = _numbers(text)
            if len(after) == len(before[name]):
                for place, (old, new) in enumerate(zip(before[name], after, strict=True)):
                    if not math.isclose(old.value, new.value, rel_tol=_ROUNDING, abs_tol=1e-12):
                        origins.setdefault((name, place), []).append(path)
    return {
        name: [
            _in_words(number, origins[name, place], values)
            for place, number in enumerate(numbers)
            if (name, place) in origins
        ]
        for name, numbers in before.items()
    }


def _numbers(text: str) -> list[_Printed]:
    plain = re.sub(r"<[^>]*>", " ", text).replace("\N{NO-BREAK SPACE}", " ").replace(r"\%", "%")
    return [
        _Printed(match[0], float(match[0].replace("−", "-")), (_UNIT.match(plain, match.end()) or [""])[0].strip())
        for match in _NUMBER.finditer(plain)
    ]


def _in_words(number: _Printed, paths: list[str], values: Mapping[str, float]) -> str:
    unit = f" {number.unit}" if number.unit else ""
    if len(paths) == 1:
        digits = len(number.text.partition(".")[2])
        for factor in _FACTORS:
            if abs(number.value - factor * values[paths[0]]) <= max(0.6 * 10.0**-digits, 0.004 * abs(number.value)):
                return f"{paths[0]}{'' if factor == 1 else f' × {factor:g}'}{unit}"
    return f"{number.text}{unit} from {', '.join(paths)}"
