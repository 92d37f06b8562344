"""Statistics of residuals agree with sums by hand, moduli have suitable units, and misspelt names get a suggestion."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from eimi_fitting.correlation import correlation_length
from eimi_fitting.randomness import Randomness, randomness_of
from eimi_fitting.suggestion import suggestion
from eimi_fitting.units import MPA_PER_PA, PA_PER_MPA, in_words, moduli_in_MPa


def test_the_correlation_length_sums_the_positive_autocorrelations() -> None:
    one = np.ones(5)
    residuals = np.array([3.0, 2.0, 1.0, 1.0, -1.0])
    variance = 16.0 / 5
    first = (6 + 2 + 1 - 1) / 4 / variance
    second = (3 + 2 - 1) / 3 / variance
    third = (3 - 2) / 2 / variance  # and the product of the ends is negative
    expected = 1 + 2 * (first + second + third)
    assert correlation_length(residuals, one) == pytest.approx(expected)
    assert correlation_length(residuals, 0.25 * one) == pytest.approx(expected)
    assert correlation_length(np.stack([residuals, -residuals]), np.ones((2, 5))) == pytest.approx(expected)
    assert correlation_length(np.array([2.0, 2.0, 2.0]), np.ones(3)) == pytest.approx(1 + 2 * (1 + 1))
    assert correlation_length(np.array([1.0, 0.0, -1.0, 5.0]), np.ones(4)) == 1.0  # the first product sum is negative
    assert correlation_length(np.zeros(4), np.ones(4)) == 1.0
    assert correlation_length(np.zeros(4), np.zeros(4)) == 1.0


def test_unused_points_are_no_neighbours_of_used_ones() -> None:
    residuals = np.array([2.0, 0.0, 3.0, 1.0])
    weights = np.array([1.0, 0.0, 2.0, 1.0])
    variance = 14.0 / 3
    expected = 1 + 2 * (3.0 / 1 / variance + 6.0 / 1 / variance + 2.0 / 1 / variance)
    assert correlation_length(residuals, weights) == pytest.approx(expected)
    apart = np.array([1.0, 0.0, 1.0])  # no two used points at a distance of one
    assert correlation_length(apart, apart) == 1.0


def test_the_statistics_of_residuals_by_hand() -> None:
    residuals = np.array([[1.0, 2.0, -1.0, np.nan, -3.0, 0.5], [2.0, 2.5, np.nan, np.nan, np.nan, np.nan]])
    pairs = [(1.0, 2.0), (2.0, -1.0), (-1.0, -3.0), (-3.0, 0.5), (2.0, 2.5)]
    square = (1 + 4 + 1 + 9 + 0.25 + 4 + 6.25) / 7
    correlation = sum(a * b for a, b in pairs) / 5 / square
    noise = 0.5 * sum((b - a) ** 2 for a, b in pairs) / 5
    tests = randomness_of(residuals)
    assert (tests.pairs, tests.sign_changes) == (5, 2)
    assert tests.runs_probability == pytest.approx((1 + 5 + 10) / 32)
    assert tests.autocorrelation == pytest.approx(correlation)
    z = correlation * np.sqrt(5)
    assert tests.autocorrelation_probability == pytest.approx(0.5 * scipy.special.erfc(z / np.sqrt(2)))
    assert tests.noise == pytest.approx(np.sqrt(min(noise, square)))
    assert tests.systematic == pytest.approx(np.sqrt(max(square - noise, 0.0)))
    smooth = randomness_of(np.array([[1.0, 1.5, 2.0, 2.5]]))
    of_steps = 0.5 * 0.25
    assert smooth.noise == pytest.approx(np.sqrt(of_steps))
    assert smooth.systematic == pytest.approx(np.sqrt((1 + 2.25 + 4 + 6.25) / 4 - of_steps))


def test_residuals_without_pairs_or_of_size_zero_have_no_statistics() -> None:
    assert randomness_of(np.array([[np.nan, 1.0], [2.0, np.nan]])) == Randomness(0, 0, 1.0, 0.0, 1.0, 0.0, 0.0)
    assert randomness_of(np.zeros((2, 4))) == Randomness(6, 0, 1.0, 0.0, 1.0, 0.0, 0.0)
    assert randomness_of(np.full((2, 4), np.nan)).pairs == 0


@pytest.mark.parametrize(
    ("pairs", "runs", "correlation", "decided", "is_noise"),
    [
        (10, 0.01, 0.01, True, True),
        (9, 0.5, 0.5, False, True),
        (11, 0.0099, 0.5, True, False),
        (11, 0.5, 0.0099, True, False),
    ],
)
def test_both_probabilities_are_at_least_one_per_cent_for_noise(
    pairs: int, runs: float, correlation: float, decided: bool, is_noise: bool
) -> None:
    tests = Randomness(pairs, 3, runs, 0.1, correlation, 1.0, 0.0)
    assert (tests.decided, tests.is_noise) == (decided, is_noise)


def test_moduli_have_a_unit_that_suits_their_size() -> None:
    assert (MPA_PER_PA, PA_PER_MPA) == (1e-6, 1e6)
    parameters = np.array([[46e3, 1.5], [52e3, -2.0]])
    assert moduli_in_MPa(parameters, ["Pa", "1"]) == pytest.approx(np.array([[0.046, 1.5], [0.052, -2.0]]))
    interval = (1.0, 3.0)
    for modulus_Pa, words in (
        (9.9999e6, "9999900 Pa"),
        (1e7, "10.000 MPa"),
        (9.9999e8, "999.99 MPa"),
        (1e9, "1.0000 GPa"),
        (-2e7, "-20.000 MPa"),
        (1.0, "1.0000 Pa"),
        (0.01, "0.01000 Pa"),
        (0.0, "0.0000 Pa"),
    ):
        assert in_words(modulus_Pa, interval).split(" [")[0] == words
    assert in_words(2.0, (1.25, 3.0), 3) == "2.00 Pa [1.25, 3.00]"
    assert in_words(12345.678, (12000.0, 13000.0), 3) == "12346 Pa [12000, 13000]"


def test_a_similar_name_is_suggested_and_otherwise_all_names() -> None:
    assert suggestion("yeoo", ["ogden", "yeoh"]) == "did you mean 'yeoh'?"
    assert "ogden" in suggestion("zzzzzz", ["ogden", "yeoh"])
    assert "yeoh" in suggestion("zzzzzz", ["ogden", "yeoh"])
