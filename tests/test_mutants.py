"""The lists of deliberate mistakes agree with the code, and a report says whether tests detect each mistake."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import mutants
from benchmarks.mutants import BROKEN, CAUGHT, LEAST, LISTS, SURVIVED, Mutant, copied, every_mutant, table, tried

PROJECT = Path(__file__).parents[1]


@pytest.mark.parametrize("room", sorted(path.stem for path in LISTS.glob("*.toml")))
def test_every_mistake_applies_to_the_code_and_names_existing_tests(room: str) -> None:
    # If this test fails, the code has changed: update the fragment of the mistake, or replace the mistake.
    for mutant in every_mutant():
        if mutant.room != room:
            continue
        assert mutant.applied((PROJECT / mutant.file).read_text(encoding="utf-8"))
        assert mutant.right != mutant.wrong
        for test in mutant.tests:
            path, _, name = test.partition("::")
            text = (PROJECT / path).read_text(encoding="utf-8")
            assert not name or re.search(rf"^def {name}\(", text, re.MULTILINE), test


def test_there_are_enough_mistakes_and_none_occurs_twice() -> None:
    every = every_mutant()
    assert len(every) >= LEAST
    assert len({(mutant.file, mutant.right, mutant.wrong) for mutant in every}) == len(every)
    assert [mutant.number for mutant in every] == list(range(1, len(every) + 1))


def test_a_caught_mistake_is_reported_and_the_copy_is_restored(tmp_path: Path) -> None:
    project = tmp_path / "small"
    project.mkdir()
    (project / "pyproject.toml").write_text('[tool.pytest.ini_options]\nfilterwarnings = ["error"]\n')
    (project / "sums.py").write_text("def add(a, b):\n    return a + b\n")
    (project / "test_sums.py").write_text(
        "import pytest\nfrom sums import add\n\n"
        "@pytest.mark.parametrize('four', [add(3, 1)])\ndef test_add(four):\n    assert add(2, 2) == 4\n"
    )
    copy = copied(project, tmp_path / "copies")
    minus = Mutant(1, "small", "minus", "sums.py", "a + b", "a - b", ("test_sums.py",))
    product = replace(minus, number=2, wrong="a * b")
    nowhere = replace(minus, number=3, wrong="b + a", tests=("test_nothing.py",))
    outcomes = {mutant.key: tried(mutant, copy)[0] for mutant in (minus, product, nowhere)}
    assert list(outcomes.values()) == [CAUGHT, SURVIVED, BROKEN]
    recorded = replace(minus, tests=("test_sums.py::test_add[4]",))
    assert tried(replace(recorded, wrong="undefined"), copy)[0] == CAUGHT  # the file of the test cannot be imported
    assert tried(replace(recorded, wrong="2 * max(a, b)"), copy)[0] == SURVIVED  # the test is test_add[6] then
    assert (copy / "sums.py").read_text() == (project / "sums.py").read_text()
    assert table([minus, product, nowhere], outcomes)[-1] == "| all | 3 | 1 | 33 % |"
    with pytest.raises(ValueError, match="'a / b' 0 times"):
        replace(minus, right="a / b").applied((copy / "sums.py").read_text())


def test_a_generated_mistake_that_the_map_misses_is_tried_with_the_tests_of_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The test in the map does not notice that a sum has become a product; the test of the folder does.
    project = tmp_path / "small"
    (project / "inner").mkdir(parents=True)
    (project / "pyproject.toml").write_text('[tool.pytest.ini_options]\nfilterwarnings = ["error"]\n')
    (project / "inner" / "sums.py").write_text("def add(a, b):\n    return a + b\n")
    for name, sum_ in (("map", "2, 2) == 4"), ("folder", "1, 2) == 3")):
        (project / f"test_{name}.py").write_text(f"from inner.sums import add\n\ndef test():\n    assert add({sum_}\n")
    with (project / "test_map.py").open("a") as tests:
        tests.write("\ndef test_that_fails_without_the_mistake():\n    assert add(2, 2) == 5\n")
    copy = copied(project, tmp_path / "copies")
    listed = tmp_path / "room_tests.toml"
    monkeypatch.setattr(mutants, "ROOM_TESTS", listed)
    product = Mutant(1, "inner", "", "inner/sums.py", "a + b", "a * b", ("test_map.py",), is_generated=True)
    for folder, tests, outcome in (
        ("inner/", '["test_folder.py", "test_that_does_not_exist.py"]', CAUGHT),
        ("", '["test_folder.py"]', CAUGHT),
        ("outer/", '["test_folder.py"]', SURVIVED),
    ):
        listed.write_text(f'"{folder}" = {tests}\n')
        assert tried(product, copy)[0] == outcome
    assert replace(product, is_generated=False).room_tests(copy) == []


def test_the_tests_of_the_folders_exist() -> None:
    by_folder = tomllib.loads(mutants.ROOM_TESTS.read_text(encoding="utf-8"))
    assert all((mutants.PROJECT / folder).is_dir() for folder in by_folder)
    missing = [test for tests in by_folder.values() for test in tests if not (mutants.PROJECT / test).exists()]
    assert missing == []
