"""Imports go one way: the table below is the order of the rooms, and nothing imports a room above its own."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "eimi_lab": ROOT / "eimi_lab",
    "eimi_drivers": ROOT / "drivers" / "eimi_drivers",
    "eimi_fitting": ROOT / "fitting" / "eimi_fitting",
}

# From the bottom to the top. Rooms of one row may know each other, as long as there is no circle.
ORDER = (
    ("eimi_drivers",),
    ("eimi_fitting.units", "eimi_fitting.correlation"),
    ("eimi_fitting.laws",),
    ("eimi_fitting.beam",),
    ("eimi_fitting.inference.evidence",),
    ("eimi_fitting.inference.searching",),
    ("eimi_fitting.inference.interval",),
    ("eimi_fitting.inference.doubts", "eimi_fitting.inference.planning"),
    ("eimi_fitting.inference",),
    ("eimi_fitting.discovery",),
    ("eimi_fitting",),
    ("eimi_lab.process", "eimi_lab.showing"),
    ("eimi_lab.config",),
    ("eimi_lab.vision",),
    ("eimi_lab.vision.edges", "eimi_lab.vision.following"),
    ("eimi_lab.vision.calibration",),
    ("eimi_lab.dataset.repair",),
    ("eimi_lab.dataset",),
    ("eimi_lab.virtual",),
    ("eimi_lab.acquisition",),
    ("eimi_lab.fits",),
    ("eimi_lab.reporting",),
    ("eimi_lab.page", "eimi_lab.study"),
    ("eimi_lab.demonstration", "eimi_lab.notebook"),
    ("eimi_lab.commands",),
    ("eimi_lab.cli", "eimi_lab.__main__", "eimi_lab"),
)
LEVELS = {room: level for level, rooms in enumerate(ORDER) for room in rooms}
APART = {("eimi_fitting", "eimi_drivers"), ("eimi_drivers", "eimi_fitting")}
FITTING_NEEDS = {"numpy", "scipy", "cma"}


def modules() -> dict[str, Path]:
    """Every module of the three packages by its name; a package by that of its folder."""
    found = {}
    for package, folder in PACKAGES.items():
        for path in folder.rglob("*.py"):
            parts = (package, *path.relative_to(folder).with_suffix("").parts)
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


def imported(path: Path) -> Iterator[str]:
    """What a module imports, wherever in it, for types alone too; of a package the module meant."""
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
    """What every module imports."""
    return {name: set(imported(path)) for name, path in MODULES.items()}


def room_of(module: str) -> str:
    """The room of the table that a module is in: the longest that its name begins with."""
    parts = module.split(".")
    rooms = (".".join(parts[:count]) for count in range(len(parts), 0, -1))
    return next(room for room in rooms if room in LEVELS)


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_imports_a_room_above_its_own(package, imports):
    upward = [
        f"{module} imports {other}"
        for module, others in imports.items()
        for other in others & MODULES.keys()
        if module.split(".")[0] == package and LEVELS[room_of(other)] > LEVELS[room_of(module)]
    ]
    assert upward == []


def test_every_room_of_the_suite_has_its_place():
    rooms = {".".join(module.split(".")[:2]) for module in MODULES if module.startswith(("eimi_lab.", "eimi_fitting."))}
    assert rooms - LEVELS.keys() == set()


def test_there_is_no_circle(imports):
    graph = {module: others & MODULES.keys() for module, others in imports.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        pytest.fail(" imports ".join(reversed(circle.args[1])), pytrace=False)


def test_drivers_and_fitting_do_not_know_each_other(imports):
    across = {(module.split(".")[0], other.split(".")[0]) for module in MODULES for other in imports[module]}
    assert across & APART == set()


def test_fitting_needs_three_packages_alone(imports):
    roots = {
        other.split(".")[0] for module in MODULES if module.startswith("eimi_fitting") for other in imports[module]
    }
    assert roots - sys.stdlib_module_names - {"eimi_fitting"} == FITTING_NEEDS


def test_the_suite_knows_neither_its_tests_nor_its_benchmarks(imports):
    roots = {other.split(".")[0] for others in imports.values() for other in others}
    assert roots & {"tests", "benchmarks"} == set()
