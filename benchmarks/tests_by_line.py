"""The map from each line of the code to the tests that execute the line; tests are chosen for a mistake with it.

``python -m benchmarks.tests_by_line [TESTS ...]`` runs the tests under coverage with one context for each test, and
writes the map. It takes about twice as long as the tests alone. A process that a test starts is not followed; the tests
that start one are found by the name of its module.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from coverage import CoverageData

PROJECT = Path(__file__).parents[1]
MAP = PROJECT / ".tests_by_line"
DURATIONS = MAP.with_suffix(".xml")
MOST_TESTS = 60
"""Number of tests, the quickest first, that are tried on one mistake."""


def record(tests: Sequence[str]) -> int:
    """Run the tests and write the map; return pytest's exit status."""
    packages = [f"--cov={name}" for name in ("eimi_lab", "eimi_drivers", "eimi_fitting")]
    options = ["--cov-context=test", "--cov-report=", f"--junitxml={DURATIONS}", "-o", "junit_family=xunit1", "-q"]
    status = subprocess.run(
        [sys.executable, "-m", "pytest", *packages, *options, "-n", "2", *tests], cwd=PROJECT, check=False
    ).returncode
    (PROJECT / ".coverage").replace(MAP)
    return status


class TestsByLine:
    """The recorded map from lines to tests."""

    __test__ = False  # it is no test, in spite of its name

    def __init__(self) -> None:
        """Read the map. Raises FileNotFoundError if it was not recorded."""
        if not MAP.exists():
            raise FileNotFoundError(f"{MAP.name}: record it first with `python -m benchmarks.tests_by_line`")
        self._data = CoverageData(str(MAP))
        self._data.read()
        self._seconds = {
            f"{case.get('file')}::{case.get('name')}": float(case.get("time", "0"))
            for case in ElementTree.parse(DURATIONS).iter("testcase")
        }

    def of(self, file: str, line: int) -> tuple[str, ...]:
        """Return the tests that execute a line, the quickest first; without any, the tests that name its module."""
        contexts = self._data.contexts_by_lineno(str(PROJECT / file)).get(line, [])
        nodes = {context.partition("|")[0] for context in contexts if context}
        if nodes:
            return tuple(sorted(nodes, key=lambda node: (self._seconds.get(node, 0.0), node))[:MOST_TESTS])
        return tuple(_naming(Path(file).stem))


def _naming(module: str) -> list[str]:
    """Return the test files that name a module."""
    files = sorted((PROJECT / "tests").rglob("test_*.py"))
    return [path.relative_to(PROJECT).as_posix() for path in files if module in path.read_text(encoding="utf-8")]


if __name__ == "__main__":
    sys.exit(record(sys.argv[1:] or ["tests"]))
