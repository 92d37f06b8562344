"""Record which tests execute which line of the code, for `benchmarks.mutants`.

``python -m benchmarks.tests_by_line [TESTS ...] [--add] [--jobs N]`` takes twice as long as the tests alone. ``--add``
adds tests to an earlier result. Lines that only another process executes are not recorded.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

from coverage import CoverageData

PROJECT = Path(__file__).parents[1]
MAP = PROJECT / ".tests_by_line"
SECONDS = MAP.with_suffix(".json")
PACKAGES = ("eimi_lab", "eimi_drivers", "eimi_fitting")
MOST_TESTS, MOST_S = 3000, 60.0
"""Largest number of tests for one mistake, and largest sum of their recorded durations (s)."""

_SETTINGS = f"[run]\nbranch = false\nparallel = false\nsource_pkgs = {', '.join(PACKAGES)}\n"


def record(tests: Sequence[str], add: bool = False, jobs: int = 2) -> int:
    """Run tests, and record which lines of the code each test executes; return pytest's exit status.

    If `add` is true, the tests are added to the earlier result. `jobs` is the number of processes.
    """
    with tempfile.TemporaryDirectory() as folder:
        new, settings, report = Path(folder) / "new", Path(folder) / "settings.ini", Path(folder) / "report.xml"
        settings.write_text(_SETTINGS, encoding="utf-8")
        options = [*(f"--cov={name}" for name in PACKAGES), f"--cov-config={settings}", "--cov-context=test"]
        options += ["--cov-report=", f"--junitxml={report}", "-o", "junit_family=xunit1", "-q", "-n", str(jobs)]
        options += [] if jobs else ["--dist", "no"]  # otherwise coverage waits for the data of other processes
        command = [sys.executable, "-m", "pytest", *options, *tests]
        environment = {**os.environ, "COVERAGE_FILE": str(new)}
        status = subprocess.run(command, cwd=PROJECT, env=environment, check=False).returncode
        seconds = json.loads(SECONDS.read_text(encoding="utf-8")) if add else {}
        seconds |= seconds_in(report)
        whole = CoverageData(str(MAP))
        if add:
            whole.read()  # without this call, coverage would erase the file
        else:
            whole.erase()
        read = CoverageData(str(new))
        read.read()
        whole.update(read)
        whole.write()
    SECONDS.write_text(json.dumps(seconds), encoding="utf-8")
    return status


def seconds_in(report: Path) -> dict[str, float]:
    """Return the duration (s) of each test from pytest's JUnit XML report."""
    # A file that is skipped as a whole is reported as one case whose name is the dotted path of the file.
    cases = [
        case
        for case in ElementTree.parse(report).iter("testcase")
        if f"{case.get('name', '').replace('.', '/')}.py" != case.get("file")
    ]
    return {f"{case.get('file')}::{case.get('name')}": float(case.get("time", "0")) for case in cases}


class TestsByLine:
    """The recorded tests that execute each line of the code."""

    __test__ = False  # pytest must not collect this class as a test

    def __init__(self) -> None:
        # Read from files which tests execute which line. Raises FileNotFoundError if this was not recorded.
        if not MAP.exists():
            raise FileNotFoundError(f"{MAP.name}: record it first with `python -m benchmarks.tests_by_line`")
        self._data = CoverageData(str(MAP))
        self._data.read()
        self._seconds: dict[str, float] = json.loads(SECONDS.read_text(encoding="utf-8"))

    def of(self, file: str, line: int) -> tuple[str, ...]:
        """Return the tests that may detect a mistake in a line of code, in the order in which they should run."""
        # The tests are chosen as follows:
        #
        # - If the line is in a function: the tests that execute the line. If a test executes it in a fixture (a setup
        #   of tests), then also the other tests in the same file, because these may use the fixture.
        # - If the line is outside all functions, so that only the first import of the module executes it: first the
        #   tests in files that import the module or every module of the project, then the tests that execute any line
        #   of the module, then the tests in files that import its package.
        # - If no test was found in this way: the tests in the files that contain the name of the module.
        #
        # Tests in files that contain the name of the module are tried first. At most `MOST_TESTS` tests are returned,
        # which together take at most `MOST_S` seconds. One half of this time is reserved for the quickest tests,
        # because the tests of a module itself are usually quick. The other half is filled with the first of the
        # remaining tests.
        by_line = self._data.contexts_by_lineno(str(PROJECT / file))
        if line in _lines_of_functions(PROJECT / file):
            contexts = set(by_line.get(line, [])) - {""}
            nodes = {context.partition("|")[0] for context in contexts}
            sharing = {c.partition("::")[0] for c in contexts if c.endswith("|setup")}
            chosen = [*self._in_order(nodes), *self._in_order(self._of_files(sharing) - nodes)]
        else:
            module = ".".join(Path(file).with_suffix("").parts[0 if file.startswith("eimi_lab") else 1 :])
            every = _files_with("pkgutil.walk_packages")  # these tests import all modules
            named_or_imported = {*_files_with(module.removesuffix(".__init__")), *files_that_import(file, PROJECT)}
            importing = self._of_files([*named_or_imported, *every])
            nodes = {context.partition("|")[0] for contexts in by_line.values() for context in contexts if context}
            package = self._of_files(_files_with(module.rpartition(".")[0]))
            chosen = [*self._in_order(importing), *self._in_order(nodes), *self._in_order(package)]
        named = _files_with(Path(file).stem)
        chosen = list(dict.fromkeys(chosen or self._in_order(self._of_files(named))))
        chosen.sort(key=lambda test: test.partition("::")[0] not in named)
        quick = self._quickest(chosen, MOST_S / 2)
        within: list[str] = []
        left_s = MOST_S - self.seconds(quick)
        for test in chosen:
            if test in quick:
                within.append(test)
            elif (seconds := self.seconds([test])) <= left_s:
                left_s -= seconds
                within.append(test)
        return tuple(within[:MOST_TESTS] or chosen[:1])

    def seconds(self, tests: Iterable[str]) -> float:
        return sum(self._seconds.get(test, 1.0) for test in tests)

    def _quickest(self, tests: Iterable[str], seconds: float) -> set[str]:
        """Return the quickest tests, which together take at most `seconds` (s)."""
        within: set[str] = set()
        for test in sorted(tests, key=lambda test: self.seconds([test])):
            seconds -= self.seconds([test])
            if seconds < 0:
                break
            within.add(test)
        return within

    @cached_property
    def _by_file(self) -> dict[str, list[str]]:
        files: dict[str, list[str]] = {}
        for node in self._seconds:
            files.setdefault(node.partition("::")[0], []).append(node)
        return files

    def _of_files(self, files: Iterable[str]) -> set[str]:
        return {node for file in files for node in self._by_file.get(file, [])}

    def _in_order(self, nodes: Iterable[str]) -> list[str]:
        """Return the quickest test of each file first, then the second quickest, and so on."""
        quickest = sorted(nodes, key=lambda node: (self._seconds.get(node, 0.0), node))
        before: dict[str, int] = {}
        ranks: dict[str, int] = {}
        for node in quickest:
            file = node.partition("::")[0]
            ranks[node] = before[file] = before.get(file, -1) + 1
        return sorted(quickest, key=lambda node: ranks[node])


def _lines_of_functions(path: Path) -> set[int]:
    """Return the numbers of the lines in the bodies of all functions."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, functions)]
    return {line for node in nodes for line in range(node.body[0].lineno, (node.end_lineno or 0) + 1)}


def _files_with(word: str) -> list[str]:
    """Return the files of tests that contain a word."""
    files = sorted((PROJECT / "tests").rglob("test_*.py"))
    return [path.relative_to(PROJECT).as_posix() for path in files if word in path.read_text(encoding="utf-8")]


def files_that_import(file: str, project: Path) -> list[str]:
    """Return the files of tests in `project` that import the module in the source file `file`."""
    *package, module = Path(file).with_suffix("").parts[0 if file.startswith("eimi_lab") else 1 :]
    dotted = re.escape(".".join(package))
    imports = re.compile(
        rf"from {dotted}\.{module} import|import {dotted}\.{module}\b"
        rf"|from {dotted} import (?:[^(\n]*|\([^)]*)\b{module}\b"
    )
    files = sorted((project / "tests").rglob("test_*.py"))
    return [path.relative_to(project).as_posix() for path in files if imports.search(path.read_text(encoding="utf-8"))]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--add", action="store_true", help="add the tests to the map of the unchanged code")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes that run tests; 0 for this process")
    parser.add_argument("tests", nargs="*", default=["tests"])
    given = parser.parse_args()
    sys.exit(record(given.tests, given.add, given.jobs))
