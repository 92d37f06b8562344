"""Noise passes the tests for random residuals, and systematic residuals fail them."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.randomness import randomness_of


def test_noise_is_not_rejected_more_often_than_the_significance_level() -> None:
    draws = np.random.default_rng(1).normal(0, 0.4, (400, 8, 2, 40))
    rejected = sum(not randomness_of(residuals).is_noise for residuals in draws)
    assert rejected <= 20  # two tests at 1 %: 8 rejections are expected, and 20 have a probability below 1e-3


def test_a_bow_of_one_micrometre_in_noise_is_detected_and_measured() -> None:
    along = np.linspace(0, np.pi, 90)
    residuals = np.random.default_rng(2).normal(0, 0.35, (16, 2, 90)) + np.sin(along)
    tests = randomness_of(residuals)
    assert not tests.is_noise
    assert tests.noise == pytest.approx(0.35, rel=0.05)
    assert tests.systematic == pytest.approx(np.sqrt(0.5), rel=0.05)


def test_the_statistics_follow_their_definitions_and_skip_unmeasured_points() -> None:
    residuals = np.array([[1.0, 2.0, -1.0, np.nan, -3.0], [2.0, np.nan, np.nan, np.nan, np.nan]])
    tests = randomness_of(residuals)
    assert (tests.pairs, tests.sign_changes) == (3, 1)
    assert tests.runs_probability == pytest.approx(0.5)  # probability of 0 or 1 change of sign in 3: (1 + 3) / 8
    assert tests.autocorrelation == pytest.approx((2 - 2 + 3) / 3 / ((1 + 4 + 1 + 9 + 4) / 5))
    assert not tests.decided


def test_residuals_of_alternating_sign_count_as_noise_of_their_size() -> None:
    tests = randomness_of(np.tile([1.0, -1.0], 30)[None])
    assert tests.is_noise
    assert tests.systematic == 0.0


def test_no_measured_point_gives_no_verdict() -> None:
    assert not randomness_of(np.full((3, 2, 5), np.nan)).decided
