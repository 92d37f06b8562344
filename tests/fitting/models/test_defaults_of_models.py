"""The public functions, classes and constants of the beam models and laws have the accepted defaults and values."""

from __future__ import annotations

import enum
import inspect
import pkgutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import eimi_fitting.beam
import eimi_fitting.laws
from tests.shared.accepted_numbers import check


def of_function(function: Any, name: str) -> Iterator[str]:
    for parameter in inspect.signature(function).parameters.values():
        if isinstance(parameter.default, bool | int | float | str | tuple):
            yield f"{name}: {parameter.name} = {parameter.default!r}"


def of_module(module: ModuleType) -> Iterator[str]:
    for key, value in vars(module).items():
        name = f"{module.__name__.removeprefix('eimi_fitting.')}.{key}"
        if key.startswith("_") or isinstance(value, bool):
            continue
        if isinstance(value, int | float | tuple) and key.isupper():
            yield f"{name} = {value!r}"
        elif getattr(value, "__module__", "") != module.__name__:
            continue
        elif inspect.isfunction(value):
            yield from of_function(value, name)
        elif inspect.isclass(value) and issubclass(value, enum.Enum):
            yield f"{name}: {', '.join(f'{member.name} = {member.value}' for member in value)}"
        elif inspect.isclass(value):
            if "__init__" in vars(value):
                yield from of_function(value, name)
            for part, method in vars(value).items():
                method = getattr(method, "__func__", method)
                if inspect.isfunction(method) and not part.startswith("_"):
                    yield from of_function(method, f"{name}.{part}")


def test_arguments_fields_and_constants_have_the_accepted_values(tmp_path: Path) -> None:
    lines: list[str] = []
    for package in (eimi_fitting.beam, eimi_fitting.laws):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            lines += of_module(import_module(found.name))
    check(lines, Path(__file__).parent / "accepted" / "defaults.txt", tmp_path, relative=0.0, absolute=0.0)
