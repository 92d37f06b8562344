"""CSV tables with random text are read, or refused with an error of one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eimi_lab.config.csv_tables import read_table
from eimi_lab.process.errors import InputError

cells = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=8)


@given(rows=st.lists(st.lists(cells, min_size=1, max_size=4), max_size=5))
def test_any_table_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[str]]
) -> None:
    path = tmp_path_factory.mktemp("tables") / "states.csv"
    path.write_text("\n".join(["frame,current_A", *(",".join(row) for row in rows)]), encoding="utf-8", newline="")
    message = ""
    try:
        numbers = [row.number("current_A") for row in read_table(path, ["frame"], ["current_A"])]
    except InputError as error:
        numbers, message = [], str(error)
    assert np.isfinite(numbers).all()
    assert message.startswith(str(path)) or numbers


def test_a_cell_that_is_too_long_is_refused_with_its_row(tmp_path: Path) -> None:
    path = tmp_path / "states.csv"
    path.write_text("current_A\n1\n" + "2" * 131_073 + "\n")
    with pytest.raises(
        InputError, match=r"states\.csv: row 3: is not CSV \(field larger than field limit \(131072\)\)$"
    ):
        read_table(path, ["current_A"])


@given(numbers=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_numbers_are_read_back_exactly_from_a_table(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float]
) -> None:
    path = tmp_path_factory.mktemp("tables") / "states.csv"
    path.write_text("current_A\n" + "\n".join(map(repr, numbers)))
    assert [row.number("current_A") for row in read_table(path, ["current_A"])] == numbers
