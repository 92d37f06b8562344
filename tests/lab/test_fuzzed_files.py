"""Files that were changed at random are read or refused, without a traceback, an endless wait or a dead process."""

from __future__ import annotations

import pytest

from tests.shared.mutated_files import fuzz


@pytest.mark.parametrize("files", [400, pytest.param(20_000, marks=pytest.mark.slow)])
def test_mutated_files_are_read_or_refused_in_one_line(files: int) -> None:
    counts = fuzz(files, seed=files)
    assert set(counts) == {"read", "refused"}, counts


@pytest.mark.parametrize("files", [12, pytest.param(2_000, marks=pytest.mark.slow)])
def test_mutated_datasets_are_recovered_or_refused_in_one_line(files: int) -> None:
    counts = fuzz(files, seed=files, recover=True)
    assert set(counts) <= {"read", "refused", "died", "hang"}, (
        counts
    )  # `eimi recover` reads in a separate process, which may die or hang
    assert counts["read"] > files / 10
