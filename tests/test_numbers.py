"""The comparison of results before and after a change of the code reports all differences."""

from __future__ import annotations

import copy

import pytest

from benchmarks.numbers import compare

FIT = {"modulus": {"value": 46e3, "interval_95": [45e3, 47e3]}, "stop": "population", "wall_s": 2.0}
BEFORE = {"case": {"edges": [{"left": [[0.0, 1.0]]}], "fits": {"yeoh": FIT}}}


@pytest.mark.parametrize(
    ("change", "same", "expected"),
    [
        ({"wall_s": 3.0}, True, "0.0e+00  fits.modulus.value"),
        ({"modulus": {"value": 46e3 * (1 + 1e-12), "interval_95": [45e3, 47e3]}}, True, "e-12  fits.modulus.value"),
        ({"modulus": {"value": 46e3, "interval_95": [45e3, 47.047e3]}}, False, "1.0e-03  fits.modulus.interval_95"),
        ({"modulus": {"value": None, "interval_95": [45e3, 47e3]}}, False, "inf  fits.modulus.value"),
        ({"stop": "flat"}, False, "inf  fits.stop"),
        ({"restarts": 2}, True, "new  fits.restarts"),
    ],
)
def test_a_changed_number_is_reported(
    capsys: pytest.CaptureFixture[str], change: dict, same: bool, expected: str
) -> None:
    after = copy.deepcopy(BEFORE)
    after["case"]["fits"]["yeoh"].update(change)
    assert compare(BEFORE, after, 1e-9) is same
    assert expected in capsys.readouterr().out


def test_a_missing_number_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    after = copy.deepcopy(BEFORE)
    del after["case"]["fits"]["yeoh"]["modulus"]
    assert not compare(BEFORE, after, 1e-9)
    assert "gone  fits.modulus.value" in capsys.readouterr().out
