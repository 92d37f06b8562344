"""The map from lines of code to the tests that execute them is recorded, extended and read."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from coverage import CoverageData

from benchmarks import tests_by_line
from benchmarks.tests_by_line import TestsByLine, files_that_import, record


@pytest.fixture
def code(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    # The only file of code of a small project, whose tests are not really run.
    # The name of a test file says which lines it executes: `test_2_3.py` executes the lines 2 and 3.
    file = tmp_path / "eimi_lab" / "code.py"
    file.parent.mkdir()
    file.write_text("def act():\n    first = 1\n    second = 2\n    return first + second\n")

    def run(command: list[str], cwd: Path, env: dict[str, str], check: bool) -> Any:
        test = command[-1]
        data = CoverageData(env["COVERAGE_FILE"])
        data.set_context(f"{test}::test_it|run")
        data.add_lines({str(file): {int(line) for line in test.removesuffix(".py").split("_")[1:]}})
        data.write()
        report = next(option for option in command if option.startswith("--junitxml=")).removeprefix("--junitxml=")
        Path(report).write_text(f'<testsuite><testcase file="{test}" name="test_it" time="0.5"/></testsuite>')
        return SimpleNamespace(returncode=0)

    (tmp_path / "tests").mkdir()
    monkeypatch.setattr(tests_by_line, "PROJECT", tmp_path)
    monkeypatch.setattr(tests_by_line, "MAP", tmp_path / ".map")
    monkeypatch.setattr(tests_by_line, "SECONDS", tmp_path / ".map.json")
    monkeypatch.setattr(tests_by_line, "subprocess", SimpleNamespace(run=run))
    return file


def test_added_tests_are_added_to_the_map(code: Path) -> None:
    assert record(["test_2.py"]) == 0
    assert record(["test_2_3.py"], add=True) == 0
    line_map = TestsByLine()
    assert set(line_map.of("eimi_lab/code.py", 2)) == {"test_2.py::test_it", "test_2_3.py::test_it"}
    assert set(line_map.of("eimi_lab/code.py", 3)) == {"test_2_3.py::test_it"}
    assert line_map.seconds(["test_2.py::test_it", "test_2_3.py::test_it", "another"]) == 0.5 + 0.5 + 1.0


def test_a_new_map_replaces_the_old_one(code: Path) -> None:
    record(["test_2.py"])
    record(["test_3.py"])
    line_map = TestsByLine()
    assert set(line_map.of("eimi_lab/code.py", 3)) == {"test_3.py::test_it"}
    assert line_map.of("eimi_lab/code.py", 2) == ()


def test_a_file_that_is_skipped_as_a_whole_is_no_test(tmp_path: Path) -> None:
    # pytest reports a skipped file as a test with the name of the module, which pytest cannot run.
    report = tmp_path / "report.xml"
    report.write_text(
        '<testsuites><testsuite><testcase file="tests/lab/test_a.py" name="tests.lab.test_a" time="0.0"/>'
        '<testcase file="tests/lab/test_b.py" name="test_it[1.5]" time="0.25"/></testsuite></testsuites>'
    )
    assert tests_by_line.seconds_in(report) == {"tests/lab/test_b.py::test_it[1.5]": 0.25}


def test_the_quickest_tests_are_taken_even_if_the_tests_of_other_files_are_slow(
    code: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tests_by_line, "MOST_S", 10.0)
    record(["test_2.py"])
    line_map = TestsByLine()
    quick = [f"test_own.py::test_{number}" for number in range(20)]
    slow = [f"test_{number}.py::test_slow" for number in range(5)]
    line_map._seconds = dict.fromkeys(quick, 0.1) | dict.fromkeys(slow, 3.0)
    monkeypatch.setattr(
        line_map._data, "contexts_by_lineno", lambda file: {2: [f"{test}|run" for test in quick + slow]}
    )
    chosen = line_map.of("eimi_lab/code.py", 2)
    assert set(quick) <= set(chosen)
    assert len(chosen) == 20 + 2  # 2 s of quick tests leave time for two of 3 s
    assert chosen[0] == quick[0]


def test_the_files_that_import_a_module_are_found_by_its_whole_name(tmp_path: Path) -> None:
    texts = {
        "a": "from eimi_lab.page.tabs import Tabs",
        "b": "import eimi_lab.page.tabs",
        "c": "from eimi_lab.page import choices, tabs",
        "d": "from eimi_lab.page.tabs_of_others import Tabs",
        "e": "from eimi_lab.page import tabs_of_others",
        "f": "from eimi_lab.page import choices",
        "g": "from eimi_fitting.beam.brick import Bricks",
        "h": "from eimi_lab.page import (\n    choices,\n    tabs,\n)",
        "i": "from eimi_lab.page import (\n    choices,\n)\ntabs = choices",
    }
    (tmp_path / "tests" / "inner").mkdir(parents=True)
    for name, text in texts.items():
        (tmp_path / "tests" / "inner" / f"test_{name}.py").write_text(text + "\n")
    for file, names in (("eimi_lab/page/tabs.py", "abch"), ("fitting/eimi_fitting/beam/brick.py", "g")):
        assert files_that_import(file, tmp_path) == [f"tests/inner/test_{name}.py" for name in names]
