"""The examples in the docstrings of the laws give the results that they show."""

from __future__ import annotations

import doctest
import importlib

import pytest


@pytest.mark.parametrize("module", ["law", "invariants", "stability", "tensile", "cards", "search_space"])
def test_docstrings(module: str) -> None:
    result = doctest.testmod(importlib.import_module(f"eimi_fitting.laws.{module}"))
    assert result.attempted > 0
    assert result.failed == 0
