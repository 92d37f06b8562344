"""Likelihood profiles, comparisons of laws, and the coverage of intervals are right."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.interval.identifiability import directions, is_open, statement
from eimi_fitting.inference.interval.profile_likelihood import interval_ends
from eimi_fitting.inference.planning.choice_of_law import Candidate, choose
from tests.shared.virtual_measurements import Case, outcome, row


def valley(bend: float):
    # Return a function with the narrow curved valley v = bend u², and its Hessian at the minimum.
    def rise(unit):
        u, v = (unit - 0.5).T
        across = (v - bend * u**2) / 0.01
        gradient = np.column_stack([u / 0.05**2 - across * 2 * bend * u / 0.01, across / 0.01])
        return (u / 0.05) ** 2 + across**2, gradient

    return rise, np.diag([1 / 0.05**2, 1 / 0.01**2])


def test_the_interval_of_a_quadratic_objective_needs_no_profile():
    rise, curvature = valley(0.0)
    half = 2 * np.array([0.05, 0.01])
    ends = interval_ends(rise, np.array([0.5, 0.5]), np.zeros(2), curvature, half, (0, 1))
    assert ends.profiled == ()
    assert np.column_stack([ends.low, ends.high]) == pytest.approx(np.array([[0.4, 0.6], [0.48, 0.52]]))


def test_a_profile_follows_a_bent_valley():
    rise, curvature = valley(4.0)
    half = 2 * np.array([0.05, 0.01])
    ends = interval_ends(rise, np.array([0.5, 0.5]), np.zeros(2), curvature, half, (0,))
    assert ends.profiled == (0,)
    assert (ends.low[0], ends.high[0]) == pytest.approx((0.4, 0.6), abs=2e-3)


def test_the_ends_of_a_skewed_objective_have_the_same_rise():
    def rise(unit):
        u = unit[:, :1] - 0.5
        z = (np.exp(20 * u) - 1) / (20 * 0.01)
        return z[:, 0] ** 2, z * np.exp(20 * u) / 0.01

    half = np.array([0.02])
    ends = interval_ends(rise, np.array([0.5]), np.zeros(1), np.array([[1 / 0.01**2]]), half, (0,))
    # exp(20 u) = 1 -+ 20 * 0.02
    assert (ends.low[0], ends.high[0]) == pytest.approx((0.5 + np.log(0.6) / 20, 0.5 + np.log(1.4) / 20), abs=3e-4)


def test_the_ends_stay_within_the_bounds_also_if_the_objective_is_flat():
    def rise(unit):
        u = unit[:, :1] - 0.9
        z = np.where(u < 0, u / 0.02, 0.0)  # the data do not distinguish values above the optimum
        return z[:, 0] ** 2, z / 0.02

    ends = interval_ends(rise, np.array([0.9]), np.zeros(1), np.array([[1 / 0.02**2]]), np.array([0.04]), (0,))
    assert ends.low[0] == pytest.approx(0.86, abs=1e-3)
    assert ends.high[0] == 1.0


def test_directions_name_a_determined_sum_or_ratio():
    names, prior = ("a", "b", "c"), np.diag([1.0, 1.0, 1.0])
    slopes = np.array([1.0, -1.0, 0.0]) * 50  # the data depend only on a - b
    best, *others = directions(names, np.outer(slopes, slopes), prior)
    assert best.words in ("a against b", "b against a")
    assert best.remaining == pytest.approx(1 / np.sqrt(5001), rel=1e-6)
    assert [d.remaining for d in others] == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize(
    ("interval", "remaining", "not_fixed", "expected"),
    [
        (
            (49.8e3, 50.2e3),
            (0.001, 0.05),
            (),
            "determine every parameter of this law; the 95 % interval of the initial shear modulus is ±0.4 %.",
        ),
        ((40e3, 65e3), (0.1, 0.05), (), "the 95 % interval of the initial shear modulus is -20 % to +30 %."),
        (
            (49.8e3, 50.2e3),
            (0.001, 0.3),
            (),
            "determine only mu; the 95 % interval of the initial shear modulus is ±0.4 %, and ratio is known only",
        ),
        (
            (49.8e3, 50.2e3),
            (0.001, 0.9),
            ("ratio",),
            "they do not determine ratio, whose intervals are set by the bounds",
        ),
        ((1856.0, 158872.0), (0.4, 0.05), ("mu",), "which may lie anywhere from 1856 to 1.589e+05 Pa."),
    ],
)
def test_the_statement_on_a_parameter_follows_its_interval(interval, remaining, not_fixed, expected):
    modulus = Quantity(50e3, "Pa", interval)
    assert is_open(modulus) == ("mu" in not_fixed)
    words = statement(("mu", "ratio"), 2, not_fixed, np.eye(2), (), (), remaining, modulus)
    assert expected in words
    assert ("determine every" in words) == (max(remaining) < 0.25)


def test_information_criteria_follow_their_definition():
    # -2 log L = 2 N log(error); an additional unknown without effect costs 2 + the small-sample term.
    one, two = choose([Candidate("a", 1, ((30.0, 0.01),)), Candidate("b", 2, ((30.0, 0.01),))])
    assert one.aicc == one.bic == 0.0
    assert two.aicc == pytest.approx(2 + 2 * 3 * 4 / 26 - 2 * 2 * 3 / 27)
    assert two.bic == pytest.approx(np.log(30))
    assert one.weight / two.weight == pytest.approx(np.exp(0.5 * two.aicc))
    # With 30 points, half the error improves the criterion by 60 log 2.
    worse, better = choose([Candidate("a", 1, ((30.0, 0.02),)), Candidate("b", 1, ((30.0, 0.01),))])
    assert worse.aicc == pytest.approx(60 * np.log(2))
    assert better.weight > 0.999
    assert choose([Candidate("a", 6, ((5.0, 0.02),))])[0].aicc is None
    # six unknowns and a noise level need nine points: with fewer points the correction is not defined
    assert choose([Candidate("a", 6, ((8.9, 0.02),))])[0].aicc is None
    assert choose([Candidate("a", 6, ((9.0, 0.02),))])[0].aicc == 0.0
    # A law with too few data has no weight, and a single law has no weight.
    few, *enough = choose([Candidate("a", 6, ((8.0, 0.02),)), *(Candidate(n, 1, ((8.0, 0.02),)) for n in "bc")])
    assert (few.aicc, few.weight) == (None, None)
    assert [choice.weight for choice in enough] == [0.5, 0.5]
    few, alone = choose([Candidate("a", 6, ((8.0, 0.02),)), Candidate("b", 1, ((8.0, 0.02),))])
    assert (few.weight, alone.weight) == (None, None)
    assert choose([]) == ()


@pytest.mark.parametrize(
    ("experiments", "least"), [(8, 75), pytest.param(100, 88, marks=pytest.mark.slow)], ids=["short", "long"]
)
def test_intervals_are_as_wide_as_the_scatter(experiments, least):
    # Correct 95 % intervals fail (fewer than 6 of 8, or 88 of 100) with a probability of 1 in 1000.
    numbers = (0, 4, 8, 12, 16, 20, 24, 36) if experiments == 8 else range(experiments)
    coverage = row("all", [outcome(Case(number, seed=7)) for number in numbers])
    assert coverage.held_percent >= least
    assert coverage.over_needed < 2.0
    assert coverage.fit_alone_percent < 50
