"""What `import eimi_fitting` offers: every name, what its documentation shows, and how little an import loads."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

import eimi_fitting


def home_of(name: str) -> str:
    return getattr(eimi_fitting, name).__module__


NAMES = [name for name in eimi_fitting.__all__ if name != "LAWS"]  # a dictionary has no documentation of its own
ROOMS = sorted({home_of(name) for name in NAMES if not home_of(name).startswith("eimi_fitting.laws")})


@pytest.mark.parametrize("name", [name for name in NAMES if home_of(name) in ROOMS])
def test_every_name_is_documented_by_an_example(name: str) -> None:
    written = inspect.getdoc(getattr(eimi_fitting, name)) or ""
    assert "Examples\n--------" in written
    assert ">>> " in written


def test_names_are_those_of_the_modules_and_no_others() -> None:
    assert set(eimi_fitting.__all__) <= set(dir(eimi_fitting))
    for name in eimi_fitting.__all__:
        assert getattr(eimi_fitting, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        eimi_fitting.nothing  # noqa: B018


def loaded_by(statement: str) -> set[str]:
    """The modules that a fresh interpreter has loaded after a statement."""
    words = f"import sys\n{statement}\nprint(*sys.modules)"
    told = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    return set(told.stdout.split())


def test_an_import_loads_nothing_that_is_not_asked_for() -> None:
    assert not {"numpy", "scipy", "cma"} & loaded_by("import eimi_fitting")
    assert "cma" not in loaded_by("from eimi_fitting import BeamModel, Loads, Specimen, LAWS")


def test_a_search_does_not_load_what_draws_and_leaves_it_to_others() -> None:
    loaded = loaded_by("from eimi_fitting import identify")
    assert "cma" in loaded
    assert not {"matplotlib", "scipy.stats"} & loaded
    after = loaded_by("from eimi_fitting import identify\nimport scipy.stats")
    assert "scipy.stats" in after
