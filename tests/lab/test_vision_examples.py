"""The examples in the docstrings of `eimi_lab.vision` run."""

import doctest
import importlib
import pkgutil

import pytest

from eimi_lab import vision

MODULES = sorted(module.name for module in pkgutil.walk_packages(vision.__path__, "eimi_lab.vision."))


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_run(name: str) -> None:
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_there_are_examples() -> None:
    assert sum(doctest.testmod(importlib.import_module(name)).attempted for name in MODULES) > 20
