"""The public names of `eimi_fitting` have examples, and an import loads only the necessary modules."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

import eimi_fitting


def home_of(name: str) -> str:
    return getattr(eimi_fitting, name).__module__


NAMES = [name for name in eimi_fitting.__all__ if name != "LAWS"]  # a dictionary has no docstring of its own
ROOMS = sorted({home_of(name) for name in NAMES if not home_of(name).startswith("eimi_fitting.laws")})


@pytest.mark.parametrize("name", [name for name in NAMES if home_of(name) in ROOMS])
def test_every_name_is_documented_by_an_example(name: str) -> None:
    written = inspect.getdoc(getattr(eimi_fitting, name)) or ""
    assert "Examples\n--------" in written
    assert ">>> " in written


def test_public_names_are_those_of_the_modules() -> None:
    assert set(eimi_fitting.__all__) <= set(dir(eimi_fitting))
    for name in eimi_fitting.__all__:
        assert getattr(eimi_fitting, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        eimi_fitting.nothing  # noqa: B018


def loaded_by(statement: str) -> set[str]:
    # Return the names of the modules that a new interpreter has loaded after a statement.
    words = f"import sys\n{statement}\nprint(*sys.modules)"
    process = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    return set(process.stdout.split())


def test_an_import_loads_only_the_requested_modules() -> None:
    assert not {"numpy", "scipy", "cma"} & loaded_by("import eimi_fitting")
    assert "cma" not in loaded_by("from eimi_fitting import BeamModel, Loads, Specimen, LAWS")


def test_a_search_loads_neither_matplotlib_nor_scipy_stats() -> None:
    loaded = loaded_by("from eimi_fitting import identify")
    assert "cma" in loaded
    assert not {"matplotlib", "scipy.stats"} & loaded
    after = loaded_by("from eimi_fitting import identify\nimport scipy.stats")
    assert "scipy.stats" in after
