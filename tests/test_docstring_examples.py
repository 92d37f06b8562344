"""Every example in a docstring of the three packages runs and has the printed result."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
from pathlib import Path

import pytest

import eimi_drivers
import eimi_fitting
import eimi_lab

PACKAGES = (eimi_drivers, eimi_fitting, eimi_lab)


def modules_with_examples() -> list[str]:
    # Return the names of the modules whose source contains the prompt ``>>>``.
    names = []
    for package in PACKAGES:
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            spec = module.module_finder.find_spec(module.name, None)  # type: ignore[call-arg]
            if spec and spec.origin and ">>> " in Path(spec.origin).read_text(encoding="utf-8"):
                names.append(module.name)
    return sorted(names)


@pytest.mark.parametrize("name", modules_with_examples())
def test_the_examples_of_a_module_run(name: str) -> None:
    results = doctest.testmod(importlib.import_module(name))
    assert results.attempted > 0
    assert results.failed == 0


def test_examples_are_found_in_every_package() -> None:
    names = modules_with_examples()
    assert {name.split(".")[0] for name in names} >= {"eimi_fitting", "eimi_lab"}
    assert len(names) > 20
