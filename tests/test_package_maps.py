"""The docstring of every package lists each module of its folder once, and no name that does not exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = (ROOT / "eimi_lab", ROOT / "drivers" / "eimi_drivers", ROOT / "fitting" / "eimi_fitting", ROOT / "benchmarks")
PACKAGES = sorted(path.parent for source in SOURCES for path in source.rglob("__init__.py"))

_ROW = re.compile(r"^(\w+(?:, \w+)*) {2,}\S", re.MULTILINE)


def modules_of(folder: Path) -> set[str]:
    # Return the names of the modules and packages directly in a folder.
    modules = {path.stem for path in folder.glob("*.py") if not path.stem.startswith("__")}
    return modules | {path.parent.name for path in folder.glob("*/__init__.py")}


def mapped_names(folder: Path) -> list[str]:
    # Return the module names at the beginnings of lines in the docstring of a package.
    docstring = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    return [name for row in _ROW.findall(docstring) for name in row.split(", ")]


@pytest.mark.parametrize("folder", PACKAGES, ids=lambda folder: str(folder.relative_to(ROOT)))
def test_a_package_lists_its_modules_once_each(folder: Path) -> None:
    names = mapped_names(folder)
    assert set(names) - modules_of(folder) == set(), "these names do not exist"
    assert modules_of(folder) - set(names) == set(), "these modules are not listed"
    assert len(names) == len(set(names))


def test_a_wrong_name_and_a_missing_module_are_detected(tmp_path: Path) -> None:
    (tmp_path / "__init__.py").write_text('"""A room.\n\nsearch   find it\npolish, refine   improve it\n"""\n')
    for name in ("search", "polish", "interval"):
        (tmp_path / f"{name}.py").touch()
    assert set(mapped_names(tmp_path)) - modules_of(tmp_path) == {"refine"}
    assert modules_of(tmp_path) - set(mapped_names(tmp_path)) == {"interval"}
