"""The generator of deliberate mistakes changes one place of valid code; equal seeds give equal mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.generated_mistakes import asked_room, changed, changes, compiles, room_of, sampled, unique_fragments
from benchmarks.mutants import CAUGHT, EQUIVALENT, SURVIVED, Mutant, equivalent_keys, sample_table, wilson_95

CODE = """
def area(width: float, height: float = 2.0) -> float:
    if width < 0 and height > 0:
        raise ValueError(f"{width - 1} is negative")
    total = width * height
    report(total, "mm")
    return -total
"""


def test_each_kind_of_mistake_is_made_and_no_text_or_annotation_is_changed() -> None:
    made = {changed(CODE, change).splitlines()[change.line - 1].strip() for change in changes(CODE)}
    assert made >= {
        "if width <= 0 and height > 0:",
        "if width < 0 or height > 0:",
        "if not (width < 0 and height > 0):",
        "if width < 1 and height > 0:",
        "total = width / height",
        "report('mm', total)",
        "pass",
        "return (total)",
        "return None",
        "def area(width: float, height: float = 4.0) -> float:",
    }
    assert all("float) -> float" in line or "= 4.0" in line for line in made if line.startswith("def"))
    assert not any("width + 1" in line for line in made)


@pytest.mark.parametrize(
    ("file", "rooms", "room"),
    [
        ("drivers/eimi_drivers/supplies/scpi.py", ["drivers"], "drivers"),
        ("drivers/eimi_drivers/supplies/scpi.py", ["cameras", "supplies"], "supplies"),
        ("drivers/eimi_drivers/clock.py", ["supplies"], None),
        ("fitting/eimi_fitting/inference/interval/draws.py", ["interval"], "interval"),
        ("fitting/eimi_fitting/inference/identification/fit.py", ["interval"], None),
        ("eimi_lab/acquisition/run.py", ["acquisition"], "acquisition"),
    ],
)
def test_a_room_is_a_package_or_a_folder(file: str, rooms: list[str], room: str | None) -> None:
    assert asked_room(file, rooms) == room


def test_functions_for_type_checkers_are_not_changed() -> None:
    code = "def f(a=1):\n    return a\n"
    assert changes(code)
    assert not changes("@overload\n" + code)


def test_assertions_are_not_changed() -> None:
    code = "def f(a, b):\n    assert a > 1\n    return zip(a, b, strict=True)\n"
    assert {changed(code, change).splitlines()[change.line - 1].strip() for change in changes(code)} == {
        "return zip(b, a, strict=True)",
        "return zip(b, b, strict=True)",
        "return zip(a, a, strict=True)",
        "return None",
    }


def test_the_arguments_of_a_symmetric_function_are_not_swapped() -> None:
    swaps = [change.new for change in changes("a = max(b, c) - atan2(b, c)\n") if change.says.endswith("swapped")]
    assert swaps == ["c, b"]


def test_a_change_is_a_unique_fragment_of_whole_lines() -> None:
    text = "def f(a):\n    a = a + 1\n    a = a + 1\n    return a\n"
    (change,) = [c for c in changes(text) if c.line == 3 and c.says == "+ becomes -"]
    right, wrong = unique_fragments(text, changed(text, change), change)
    assert text.count(right) == 1
    assert text.replace(right, wrong) == "def f(a):\n    a = a + 1\n    a = a - 1\n    return a\n"


def test_the_same_seed_draws_the_same_lines_of_the_selected_folders() -> None:
    project = Path(__file__).parents[1]
    first = sampled(project, 15, 3, ["process"])
    assert first == sampled(project, 15, 3, ["process"])
    assert first != sampled(project, 15, 4, ["process"])
    assert {room_of(file) for file, _ in first} == {"process"}
    assert len({(file, change.line) for file, change in first}) == 15
    for file, change in first:
        text = (project / file).read_text(encoding="utf-8")
        assert compiles(changed(text, change))
        assert changed(text, change) != text


def test_shares_have_intervals_and_only_listed_mistakes_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    mutants = [Mutant(n, "room", "says", "file", f"right {n}", "wrong", ()) for n in range(10)]
    outcomes = {mutant.key: CAUGHT if mutant.number < 8 else SURVIVED for mutant in mutants}
    assert sample_table(mutants, outcomes)[-2:] == [
        "| all | 10 | 8 | 80 % | 49 to 94 % |",
        "0 of 10 change no behaviour, each listed with its reason",
    ]
    monkeypatch.setattr("benchmarks.mutants.equivalent_keys", lambda: {mutants[9].key: "the order does not matter"})
    assert sample_table(mutants, outcomes)[-1] == "1 of 10 change no behaviour, each listed with its reason"
    # Brown, Cai and DasGupta, Statistical Science 16 (2001) 101: 10 of 20 give 0.299 to 0.701.
    assert wilson_95(10, 20) == pytest.approx((0.299, 0.701), abs=5e-4)
    assert wilson_95(0, 5)[0] == pytest.approx(0.0, abs=1e-12)


def test_each_equivalent_mistake_has_a_reason() -> None:
    assert EQUIVALENT.exists()
    assert all(reason.strip() for reason in equivalent_keys().values())
