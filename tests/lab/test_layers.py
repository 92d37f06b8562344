"""Imports between the layers of packages go in one direction only, and never in a circle."""

# The table [tool.importlinter] of pyproject.toml lists the layers.

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "eimi_lab": ROOT / "eimi_lab",
    "eimi_drivers": ROOT / "drivers" / "eimi_drivers",
    "eimi_fitting": ROOT / "fitting" / "eimi_fitting",
}

FITTING_NEEDS = {"numpy", "scipy", "cma"}


def modules() -> dict[str, Path]:
    # Return the file of every module of the three packages, by module name.
    files = {}
    for package, folder in PACKAGES.items():
        for path in folder.rglob("*.py"):
            parts = (package, *path.relative_to(folder).with_suffix("").parts)
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return files


MODULES = modules()


def imported(path: Path) -> Iterator[str]:
    # Yield the names of the modules that a module imports, also for type checking only.
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import does not say which room it reaches for"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in MODULES else str(node.module)


@pytest.fixture(scope="module")
def imports() -> dict[str, set[str]]:
    # The names of the modules that each module imports, by module name.
    return {name: set(imported(path)) for name, path in MODULES.items()}


def test_nothing_imports_a_layer_above_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    status = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    assert status == EXIT_STATUS_SUCCESS, capsys.readouterr().out


def test_no_modules_import_each_other_in_a_circle(imports):
    graph = {module: others & MODULES.keys() for module, others in imports.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        pytest.fail(" imports ".join(reversed(circle.args[1])), pytrace=False)


def test_eimi_fitting_imports_only_three_other_packages(imports):
    roots = {
        other.split(".")[0] for module in MODULES if module.startswith("eimi_fitting") for other in imports[module]
    }
    assert roots - sys.stdlib_module_names - {"eimi_fitting"} == FITTING_NEEDS


def test_the_suite_imports_neither_tests_nor_benchmarks(imports):
    roots = {other.split(".")[0] for others in imports.values() for other in others}
    assert roots & {"tests", "benchmarks"} == set()


def test_tests_import_no_benchmark_that_they_do_not_test():
    names = ("mutants", "numbers", "benchmarks", "docs", "generated_mistakes", "tests_by_line", "phone_photographs")
    names += ("repeated_trials", "printed_report")  # the latter prints with `benchmarks.report_pictures`
    tested_there = {f"test_{name}.py" for name in names}
    importing = {
        path.name
        for path in (ROOT / "tests").rglob("*.py")
        if any(name.split(".")[0] == "benchmarks" for name in imported(path))
    }
    assert importing <= tested_there
