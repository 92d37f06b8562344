"""The search for the terms of a material law computes and reports the same values as a calculation by hand."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.discovery import bending_rows, terms_of_a_law
from eimi_fitting.discovery.rows import Rows, non_negative
from eimi_fitting.discovery.supports import Support, minimal, supports, upper_coefficients
from eimi_fitting.discovery.tensile_rows import largest_x, stress_columns, tensile_rows
from eimi_fitting.discovery.terms_of_a_law import LIBRARY, LOT, MOST_TERMS, Alternative, Discovery, discover
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.laws import CannotFit, engineering_stress
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term

I1, I2, CUBE = Term.of("i1"), Term.of("i2"), Term.of("i1^3")


def equations(columns, observed, nuisances=None, groups=None):
    columns = np.array(columns, float)
    nuisances = np.zeros((len(columns), 0)) if nuisances is None else np.array(nuisances, float)
    groups = np.arange(len(columns)) if groups is None else np.array(groups)
    return Rows(np.array(observed, float), columns, nuisances, groups)


# Equations


def test_joined_equations_keep_their_rows_and_number_their_groups_on():
    first = equations([[1, 2], [3, 4], [5, 6]], [1, 2, 3], groups=[0, 0, 1])
    second = equations([[7, 8], [9, 10]], [4, 5], nuisances=[[11, 12], [13, 14]], groups=[0, 1])
    none = equations(np.zeros((0, 2)), [], groups=np.zeros(0, int))
    joined = Rows.joined([first, none, second])
    assert joined.observed.tolist() == [1, 2, 3, 4, 5]
    assert joined.columns.tolist() == [[1, 2], [3, 4], [5, 6], [7, 8], [9, 10]]
    assert joined.nuisances.tolist() == [[0, 0], [0, 0], [0, 0], [11, 12], [13, 14]]
    assert joined.groups.tolist() == [0, 0, 1, 2, 3]


def test_equations_for_twice_the_noise_are_halved():
    rows = equations([[2, 4]], [6], nuisances=[[8]], groups=[3]).with_noise_times(2)
    assert (rows.columns.tolist(), rows.observed.tolist()) == ([[1, 2]], [3])
    assert (rows.nuisances.tolist(), rows.groups.tolist()) == ([[4]], [3])


def test_non_negative_coefficients_are_those_of_the_best_feasible_fit():
    assert non_negative(np.array([[1.0, 0.0], [0.0, 1000.0]]), np.array([3.0, 2000.0])) == pytest.approx([3.0, 2.0])
    # the second coefficient would be negative: without it the first is the projection (1, 1) . (2, 1) / 2
    assert non_negative(np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([2.0, 1.0])) == pytest.approx([1.5, 0.0])
    assert non_negative(np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([2.0, 2.0])) == pytest.approx([2.0, 0.0])


@pytest.mark.parametrize("sign", [1, -1])
def test_the_fit_of_all_terms_shares_a_residual_between_coefficient_and_uncertain_input(sign):
    # Two equations c + s n = 4 and c - s n = 2 with the prior n = 0 +- 1: c = 3, 2 (n - s)^2 + n^2 -> n = 2 s / 3.
    rows = equations([[1], [1]], [3 + sign, 3 - sign], nuisances=[[1], [-1]])
    coefficients, inputs = rows.fit_all_terms()
    assert coefficients == pytest.approx([3])
    assert inputs == pytest.approx([sign * 2 / 3])


# Sets of terms


def refitted(rows, terms, kept):
    # Return the least-squares solution of the rows in which ``kept`` is True, and its covariance.
    q = rows.nuisances.shape[1]
    design = np.hstack([rows.columns[:, terms], rows.nuisances])[kept]
    information = design.T @ design + np.diag([0.0] * len(terms) + [1.0] * q)
    return np.linalg.solve(information, design.T @ rows.observed[kept]), np.linalg.inv(information)


@pytest.fixture(name="noisy")
def noisy_rows():
    rng = np.random.default_rng(7)
    columns, nuisances = rng.uniform(0.5, 1.5, (66, 3)), rng.normal(size=(66, 2))
    observed = columns @ [1.0, 2.0, 0.0] + nuisances @ [0.3, -0.2] + rng.normal(0, 0.3, 66)
    return Rows(observed, columns, nuisances, np.arange(66) // 3)  # 22 groups in 20 folds


def test_the_fit_of_a_set_equals_its_normal_equations(noisy):
    (pair,) = (s for s in supports(noisy, np.array([True, True, True]), 2) if s.terms == (0, 1))
    solution, covariance = refitted(noisy, [0, 1], np.ones(66, bool))
    assert pair.coefficients == pytest.approx(solution[:2], rel=1e-9)
    assert pair.amplitudes == pytest.approx(solution[2:], rel=1e-9)
    assert pair.standard_errors == pytest.approx(np.sqrt(np.diag(covariance))[:2], rel=1e-9)


def test_the_groups_beyond_twenty_join_the_first_folds(noisy):
    (pair,) = (s for s in supports(noisy, np.array([True, True, True]), 2) if s.terms == (0, 1))
    design = np.hstack([noisy.columns[:, :2], noisy.nuisances])
    for groups in ([0, 20], [1, 21], [2], [19]):
        left_out = np.isin(noisy.groups, groups)
        solution = refitted(noisy, [0, 1], ~left_out)[0]
        assert pair.prediction_errors[left_out] == pytest.approx(
            noisy.observed[left_out] * -1 + design[left_out] @ solution, abs=1e-8
        )
    assert pair.held_out_error == pytest.approx(np.sqrt(np.mean(pair.prediction_errors**2)))


def test_the_excess_of_a_set_compares_its_prediction_errors_with_those_of_the_best_set(noisy):
    found = supports(noisy, np.array([True, True, True]), 3)
    best = found[0]
    assert (best.excess, best.excess_error) == (0.0, 0.0)
    assert best.is_compatible
    assert len(found) > 2
    assert [s.excess for s in found] == sorted(s.excess for s in found)
    for support in found[1:]:
        assert support.excess == pytest.approx(sum(support.prediction_errors**2) - sum(best.prediction_errors**2))
        difference = support.prediction_errors - best.prediction_errors
        assert support.excess_error == pytest.approx(2 * np.sqrt(sum(difference**2)))


@pytest.mark.parametrize(("excess", "compatible"), [(2.99, True), (3.0, True), (3.01, False)])
def test_a_set_is_compatible_up_to_an_excess_of_one_and_a_half_standard_errors(excess, compatible):
    support = Support((0,), np.ones(1), np.ones(1), np.ones(0), np.ones(1), excess=excess, excess_error=2.0)
    assert support.is_compatible is compatible


def test_only_sets_with_a_modulus_positive_coefficients_and_independent_columns_are_kept():
    columns = np.array([[1.0, 0.0, 1.0, -0.5], [0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 1.0, -1.0]])
    rows = equations(columns, [2.0, 1.0, 2.1])
    names = {s.terms for s in supports(rows, np.array([True, False, True, True]), 2)}
    # term 1 has no modulus; 0 and 2 have the same columns; the coefficient of 3 is negative
    assert names == {(0,), (2,), (0, 1), (1, 2)}
    assert {s.terms for s in supports(rows, np.array([True, False, True, True]), 1)} == {(0,), (2,)}
    assert supports(rows, np.zeros(4, bool), 2) == ()


def test_minimal_sets_contain_no_smaller_compatible_set():
    def support(terms, excess):
        return Support(terms, *(np.ones(1) for _ in range(4)), excess=excess, excess_error=1.0)

    sets = (support((0, 1), 0.0), support((2, 3), 0.5), support((0,), 1.6), support((1,), 1.4), support((2, 4), 0.2))
    assert [s.terms for s in minimal(sets)] == [(1,), (2, 4), (2, 3)]
    assert [s.terms for s in minimal((support((0, 1), 0.0), support((0,), 1.5)))] == [(0,)]


def test_upper_coefficients_are_the_ends_of_the_intervals_of_the_added_terms():
    columns = np.array([[1.0, 0.0, 0.0, 1.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0], [1.0, 0.0, 0.0, 1.0]])
    upper = upper_coefficients(equations(columns, [1.0, 6.0, -2.0, 1.0]), (0,))
    # term 1: 3 +- 1/2; term 2: negative, thus 0 +- 1/4; term 3: cannot be told from term 0
    assert upper == pytest.approx([0.0, 3 + 1.96 / 2, 1.96 / 4, np.inf])


# Tensile curves


def test_a_column_of_a_tensile_curve_is_the_stress_of_one_term():
    strain = np.array([0.5, 1.0])
    stretch = 1 + strain
    columns = stress_columns([I1, I2], strain)
    assert columns[:, 0] == pytest.approx(stretch - stretch**-2)
    assert columns[:, 1] == pytest.approx(1 - stretch**-3)


def test_the_largest_x_of_a_curve_is_that_of_its_largest_extension_or_compression():
    assert largest_x(np.array([0.5, 1.0, 0.2])) == pytest.approx(4 + 1 - 3)
    assert largest_x(np.array([-0.02, -0.8, 0.2])) == pytest.approx(0.04 + 10 - 3)


def test_an_exact_curve_gets_a_noise_of_a_ten_thousandth_of_its_largest_stress():
    strain = np.linspace(0.1, 1.0, 10)
    curve = TensileCurve(strain, engineering_stress(SumOfTerms((I1,)), np.array([40e3]), strain))
    rows, noise_Pa = tensile_rows(curve, [I1])
    assert noise_Pa == pytest.approx(1e-4 * curve.stress_Pa[-1])
    assert rows.nuisances.shape == (10, 0)


def test_the_noise_of_a_curve_counts_the_coefficients_and_correlated_rows():
    strain = np.linspace(0.1, 1.0, 12)
    pattern = np.array([1.0, -1.0] * 6) * 500
    smooth = TensileCurve(strain, 40e3 * stress_columns([I1], strain)[:, 0] + pattern)
    residuals = smooth.stress_Pa - stress_columns([I1], strain)[:, 0] * (
        stress_columns([I1], strain)[:, 0] @ smooth.stress_Pa / np.sum(stress_columns([I1], strain)[:, 0] ** 2)
    )
    rows, noise_Pa = tensile_rows(replace(smooth, weight=0.25), [I1])
    assert noise_Pa == pytest.approx(np.sqrt(np.sum(residuals**2) / 11))
    assert rows.observed == pytest.approx(0.5 * smooth.stress_Pa / noise_Pa)
    assert rows.columns[:, 0] == pytest.approx(0.5 * stress_columns([I1], strain)[:, 0] / noise_Pa)
    assert rows.groups.tolist() == list(range(12))


@pytest.mark.parametrize(("tau", "block"), [(1.0, 1), (1.99, 1), (2.0, 4), (2.4, 5), (3.0, 6)])
def test_rows_of_a_curve_are_predicted_in_blocks_of_twice_the_correlation_length(monkeypatch, tau, block):
    monkeypatch.setattr(
        "eimi_fitting.discovery.tensile_rows.correlation_length", lambda _, weights: tau * weights[0, 0]
    )
    strain = np.linspace(0.1, 1.0, 12)
    curve = TensileCurve(strain, 40e3 * stress_columns([I1], strain)[:, 0] + 100 * np.cos(9 * strain))
    rows, noise_Pa = tensile_rows(curve, [I1])
    assert rows.groups.tolist() == [i // block for i in range(12)]
    assert rows.observed == pytest.approx(curve.stress_Pa / noise_Pa / np.sqrt(tau))


def test_a_curve_needs_one_row_more_than_terms_and_a_stress_of_the_right_sign():
    strain = np.array([0.1, 0.2])
    with pytest.raises(CannotFit, match="has 2 rows; a library of 2 terms needs at least 3 rows"):
        tensile_rows(TensileCurve(strain, strain), [I1, I2])
    assert len(tensile_rows(TensileCurve(strain, 3e3 * strain), [I1])[0].observed) == 2
    with pytest.raises(CannotFit, match="every stress is zero"):
        tensile_rows(TensileCurve(strain, 0 * strain), [I1])
    with pytest.raises(CannotFit, match="no term has stresses of this sign: check the signs of strain and stress"):
        tensile_rows(TensileCurve(strain, -3e3 * strain), [I1])


# Bent beams


def test_the_modulus_of_the_beams_deviates_by_the_lot_and_by_the_model():
    assert bending_rows.scale_deviation(0.0) == pytest.approx(0.0015 / 1.96)
    assert bending_rows.scale_deviation(0.02) == pytest.approx(np.sqrt(0.02**2 + (0.0015 / 1.96) ** 2))


@pytest.mark.parametrize("fails", [0, 1, 3])
def test_other_stiffnesses_are_tried_until_every_beam_has_an_equilibrium(monkeypatch, fails):
    tried = []

    def rows_about(experiments, terms, about, lot):
        tried.append(about.tolist())
        if len(tried) <= fails:
            raise bending_rows.NoEquilibrium
        return "rows", lot

    monkeypatch.setattr(bending_rows, "_rows_about", rows_about)
    assert bending_rows.bending_rows([], [I1], np.array([100.0]), 0.02) == ("rows", 0.02)
    assert tried == [[100.0], [101.0], [99.0], [103.0]][: fails + 1]


def test_no_equilibrium_at_any_stiffness_is_reported(monkeypatch):
    def rows_about(*_):
        raise bending_rows.NoEquilibrium

    monkeypatch.setattr(bending_rows, "_rows_about", rows_about)
    with pytest.raises(bending_rows.NoEquilibrium):
        bending_rows.bending_rows([], [I1], np.array([100.0]), 0.02)


@pytest.mark.parametrize("deviation", [[0.0, 0.0], [0.3, -2.0], [1e-3, 5.0]])
def test_the_whitening_matrix_is_the_inverse_root_of_the_covariance(deviation):
    d = np.array(deviation)
    expected = scipy.linalg.inv(scipy.linalg.sqrtm(np.eye(2) + np.outer(d, d)))
    assert bending_rows._inverse_root(d) == pytest.approx(expected, abs=1e-9)


def test_the_residual_of_all_columns_counts_independent_columns():
    columns = [[1, 1, 0], [1, 1, 0], [1, 1, 0], [1, 1, 0]]  # two equal columns and an empty one: rank 1
    rows = equations(columns, [0, 2, 0, 2], nuisances=np.zeros((4, 1)))
    assert bending_rows._residual_of_all_columns(rows) == pytest.approx(np.sqrt(4 / 3))
    exact = equations([[2]], [6], nuisances=np.zeros((1, 0)))
    assert bending_rows._residual_of_all_columns(exact) == pytest.approx(0)


# The search


def alternative(terms, error=1.0):
    k = len(terms)
    return Alternative(tuple(terms), np.ones(k), np.ones((k, 2)), 1.0, error, None)


def discovery(*alternatives, open_terms=None):
    return Discovery(alternatives, open_terms or {}, 0.8, LIBRARY, (), (), (), (), 1)


def test_the_library_and_its_defaults():
    names = ["i1", "i2", "i1^2", "i1^3", "gent=20", "fung=0.2", "ogden=-4", "ogden=8"]
    assert [term.name for term in LIBRARY] == names
    assert (LOT, MOST_TERMS) == (0.02, 3)


@pytest.mark.parametrize(("error", "explained"), [(1.49, True), (1.5, False), (1.51, False)])
def test_a_prediction_error_from_one_and_a_half_times_the_noise_is_not_explained(error, explained):
    found = discovery(alternative([I1, I2], error))
    assert found.explained is explained
    assert found.identified is explained
    expected = (
        "identified among the terms of this library: i1 + i2"
        if explained
        else "not identifiable: the best set of terms, i1 + i2, has a prediction error of 1.5 times the noise; "
        "the law is not in the library"
    )
    assert found.statement == expected


def test_a_term_that_could_carry_stress_is_named_with_its_share():
    found = discovery(alternative([I1]), open_terms={I2: 0.256, CUBE: 1.3})
    assert not found.identified
    assert found.statement == (
        "not identifiable: i1 agrees with the data, but at a strain of 80 % further terms could carry these shares of "
        "the stress: i2 26 %, i1^3 100 %"
    )


def test_sets_that_agree_equally_well_are_counted_with_their_common_terms():
    with_common = discovery(alternative([I1, I2]), alternative([CUBE, I1]))
    assert with_common.in_all == (I1,)
    assert with_common.statement == (
        "not identifiable: 2 sets of terms agree equally well with the data, such as i1 + i2; all of them contain i1"
    )
    without = discovery(alternative([I1]), alternative([I2]))
    assert without.statement.endswith("such as i1; no term is in all of them")
    assert not without.identified


@pytest.mark.parametrize(("factor", "kept"), [(1.01, False), (1.03, True)])
def test_a_gent_term_needs_two_percent_of_room_above_the_curves(factor, kept):
    curves = [TensileCurve(np.array([largest]), np.ones(1)) for largest in (1.0, 0.5)]  # I1 - 3 = 2 at the strain 1
    gent = Term("gent", 2.0 * factor)
    terms, left_out = terms_of_a_law._usable([I1, gent], curves)
    assert (terms, left_out) == (((I1, gent), ()) if kept else ((I1,), (gent,)))


def test_without_a_curve_every_gent_term_is_used():
    gent = Term("gent", 0.5)
    assert terms_of_a_law._usable([gent, I1], []) == ((gent, I1), ())


def test_noise_that_explains_too_little_is_increased_to_the_prediction_errors():
    columns = np.ones((4, 1))
    rows = equations(columns, [8.0, 12.0, 8.0, 12.0])
    rescaled, fitted, factor = terms_of_a_law._supports(rows, np.array([True]), 1)
    assert factor == pytest.approx(2 * 4 / 3)  # each row is 2 off the mean of all, 8/3 off that of the other three
    assert rescaled.observed == pytest.approx(rows.observed / factor)
    assert fitted[0].held_out_error == pytest.approx(1)
    small = rows.with_noise_times(10)
    same, fitted, factor = terms_of_a_law._supports(small, np.array([True]), 1)
    assert (same, factor) == (small, 1.0)
    assert fitted[0].held_out_error == pytest.approx(0.8 / 3)


@pytest.mark.parametrize(("error", "named"), [(8.8, False), (9.2, True)])
def test_a_further_term_is_open_if_it_could_carry_more_than_15_percent_of_the_stress(error, named):
    # i2 carries at most 1.96 times its standard error; the term i1 carries 100 Pa of stress
    strain = 1.0
    stress = stress_columns([I1, I2], np.array([strain]))[0]
    rows = equations([[1.0, 0.0], [0.0, 1.96 / error * stress[1]]], [100 / stress[0], 0.0])
    (support,) = (s for s in supports(rows, np.array([True, True]), 1) if s.terms == (0,))
    found = terms_of_a_law._open_terms(rows, support, [I1, I2], strain)
    share = 2 * error / (2 * error + 100)
    twice = equations([[1.0, 0.0], [0.0, 1.96 / (2 * error) * stress[1]]], [100 / stress[0], 0.0])
    found = terms_of_a_law._open_terms(twice, support, [I1, I2], strain)
    assert found == ({I2: pytest.approx(share)} if named else {})


def test_the_linearisation_starts_at_the_modulus_of_the_beams():
    terms = [CUBE, I1, I2]
    target = 30e3 * (1.1 - 1.1**-2)
    start = terms_of_a_law._near(30e3, [], terms)
    assert start == pytest.approx([0.0, 30e3, 0.0])
    curve_rows = equations(np.eye(3), [0.0, 2.0, 1.0])
    start = terms_of_a_law._near(30e3, [curve_rows], terms)
    assert start[1] == pytest.approx(2 * start[2])
    assert stress_columns(terms, np.array([0.1]))[0] @ start == pytest.approx(target)


def test_a_given_modulus_needs_no_fit(monkeypatch):
    monkeypatch.setattr(terms_of_a_law, "identify", None)
    assert terms_of_a_law._modulus_Pa([], 27e3, 1) == 27e3


@dataclass
class Passes:
    # Replaces `bending_rows`: returns prepared linear equations, and records the coefficients that it was given.

    targets: list[float]
    noises: list[float]
    abouts: list[float] = field(default_factory=list)

    def __call__(self, experiments, terms, about, lot):
        assert (experiments, terms, lot) == (["beam"], [I1], 0.02)
        self.abouts.append(float(about[0]))
        count = len(self.abouts) - 1
        target = self.targets[min(count, len(self.targets) - 1)]
        noise = self.noises[min(count, len(self.noises) - 1)]
        return equations([[1.0]], [target], nuisances=[[0.0]]), [noise]


@pytest.mark.parametrize(
    ("targets", "noises", "abouts"),
    [
        ([10.0], [1.0], [0.0, 10.0]),  # the second pass neither moves nor changes the noise
        ([0.1], [1.0], [0.0, 0.1]),  # the noise of the first pass has nothing to be compared with
        ([10.0, 10.49], [1.0], [0.0, 10.0]),
        ([10.0, 10.51], [1.0], [0.0, 10.0, 10.51]),
        ([10.0], [1.0, 1.03], [0.0, 10.0, 10.0]),
        ([10.0], [1.0, 1.015], [0.0, 10.0]),
        ([float(n) for n in range(1, 20)], [1.0], [float(n) for n in range(9)]),
    ],
)
def test_the_linearisation_is_repeated_until_edges_and_noise_stand(monkeypatch, targets, noises, abouts):
    passes = Passes(targets, noises)
    monkeypatch.setattr(terms_of_a_law, "bending_rows", passes)
    rows, noise_mm = terms_of_a_law._linearised(["beam"], [I1], np.zeros(1), 0.02, [])
    assert passes.abouts == pytest.approx(abouts)
    assert noise_mm == [noises[min(len(abouts), len(noises)) - 1]]
    assert rows.observed[0] == targets[min(len(abouts), len(targets)) - 1]


def test_an_alternative_reports_intervals_of_1_96_standard_errors():
    support = Support((0, 2), np.array([20e3, 50.0]), np.array([1e3, 10.0]), np.zeros(0), np.array([0.5, -0.5]))
    found = terms_of_a_law._alternative(support, [I1, I2, CUBE], 3.0)
    assert found.terms == (I1, CUBE)
    assert found.intervals == pytest.approx(np.array([[18040, 21960], [30.4, 69.6]]))
    assert found.initial_shear_modulus_Pa == pytest.approx(20e3)
    assert found.held_out_error == pytest.approx(1.5)
    assert found.stable_to is None


def test_a_discovery_from_a_curve_reports_its_noise_and_its_sets():
    strain = np.linspace(0.02, 0.5, 25)
    stress = 40e3 * stress_columns([I1], strain)[:, 0] + 50 * np.random.default_rng(3).normal(size=25)
    curves = [TensileCurve(strain, stress), TensileCurve(strain[:20], stress[:20])]
    found = discover([], curves, library=[I1, CUBE, Term.of("gent=0.1")])
    assert found.strain == 0.5
    assert (found.library, found.left_out) == ((I1, CUBE), (Term.of("gent=0.1"),))
    assert found.noise_mm == ()
    assert found.noise_Pa == pytest.approx([tensile_rows(curve, found.library)[1] for curve in curves])
    assert (I1,) in found.compatible_sets
    assert found.sets in {1, 2}
    assert [a.terms for a in found.alternatives] == [(I1,)]


def test_beams_count_the_lot_only_beside_a_curve(monkeypatch):
    lots = []

    def rows_of_beams(experiments, terms, about, lot):
        lots.append((lot, about.tolist()))
        return equations([[1e-4], [1e-4]], [3.0, 3.0], nuisances=np.zeros((2, 1))), [0.01]

    monkeypatch.setattr(terms_of_a_law, "bending_rows", rows_of_beams)
    monkeypatch.setattr(terms_of_a_law, "_measured_values", lambda beam: 2)
    alone = discover(["a beam"], [], library=[I1], modulus_Pa=30e3)
    assert alone.strain == 1.0
    assert alone.noise_mm == (0.01,)
    assert lots[0] == (0.0, [pytest.approx(30e3)])
    lots.clear()
    strain = np.linspace(0.1, 0.5, 9)
    discover(
        ["a beam"], [TensileCurve(strain, 30e3 * stress_columns([I1], strain)[:, 0])], library=[I1], modulus_Pa=3e4
    )
    assert lots[0] == (0.02, [pytest.approx(30e3)])


# The equations of one beam


def test_slopes_are_differences_of_residuals_for_a_percent_of_the_stress(monkeypatch):
    terms, about = (I1, CUBE), np.array([2.0, 300.0])
    unit = stress_columns(terms, np.array([0.1]))[0]
    called = []

    def misfit(model, law, coefficients, near=None):
        called.append((model, law, near))
        first, second = coefficients
        return SimpleNamespace(residuals=np.array([[[first**2, first * second, 7.0 * second]]])), "the shape"

    monkeypatch.setattr(bending_rows, "_misfit", misfit)
    monkeypatch.setattr(bending_rows, "polished", lambda experiment: f"polished {experiment}")
    slopes = bending_rows._slopes("beam", SumOfTerms(terms), about)
    first = 0.01 * (unit @ about) / unit[0]
    # forward differences: (a + s)^2 - a^2 over s is 2 a + s
    assert slopes == pytest.approx(np.array([[[4 + first, 300.0, 0.0]], [[0.0, 2.0, 7.0]]]), rel=1e-8)
    assert [near for _, _, near in called] == [None, "the shape", "the shape"]
    assert {(model, law) for model, law, _ in called} == {("polished beam", SumOfTerms(terms))}


def test_the_model_error_is_the_remaining_share_of_the_refinement(monkeypatch):
    residuals = {"polished beam": np.array([1.0, 2.0]), "better beam": np.array([1.5, 1.0])}
    refinement = SimpleNamespace(better=lambda experiment: f"better {experiment}", remaining_share=0.2)
    monkeypatch.setattr(bending_rows, "polished", lambda experiment: f"polished {experiment}")
    monkeypatch.setattr(bending_rows, "refinements", lambda experiments: [refinement])
    monkeypatch.setattr(
        bending_rows, "_misfit", lambda model, *_: (SimpleNamespace(residuals=[residuals[model]]), None)
    )
    best, error = bending_rows._refined("beam", SumOfTerms((I1,)), np.ones(1))
    assert best.residuals[0] is residuals["better beam"]
    assert error == pytest.approx([0.1, -0.2])


def whitened(monkeypatch, tau, rng_seed=5, noise=0.1):
    rng = np.random.default_rng(rng_seed)
    weights = np.ones((3, 2, 4))
    weights[1] = 0.0  # a state without a used point
    weights[0, 1, 2] = 0.0
    slopes, nuisances = rng.normal(size=(2, 3, 2, 4)), rng.normal(size=(1, 3, 2, 4))
    model_error, about = rng.normal(size=(3, 2, 4)), np.array([3.0, 2.0])
    residuals = noise * rng.normal(size=(3, 2, 4)) * weights
    misfit = SimpleNamespace(residuals=residuals[None], weights=weights)
    seen = []
    monkeypatch.setattr(bending_rows, "point_correlation", lambda *given: seen.append(given) or tau)
    experiment = SimpleNamespace(observed="edges")
    rows, noise_mm = bending_rows._whitened(experiment, misfit, model_error, slopes, nuisances, about)
    return rows, noise_mm, misfit, model_error, slopes, nuisances, about, seen


def test_the_equations_of_a_beam_carry_the_covariance_of_noise_and_model_error(monkeypatch):
    rows, noise_mm, misfit, model_error, slopes, nuisances, about, seen = whitened(monkeypatch, tau=2.5)
    residuals, weights = misfit.residuals[0], misfit.weights
    used = weights > 0
    design = slopes[:, used].T
    target = design @ about - residuals[used]
    best = np.linalg.lstsq(design, target, rcond=None)[0]
    assert (best > 0).all()
    remaining = design @ best - target
    assert noise_mm == pytest.approx(np.sqrt(remaining @ remaining / (15 - 2)))
    ((given, given_weights, observed),) = seen
    assert given[used] == pytest.approx(remaining)
    assert not given[~used].any()
    assert (given_weights is weights, observed) == (True, "edges")

    scale = 1 / (noise_mm * np.sqrt(2.5))
    information, right = np.zeros((3, 3)), np.zeros(3)
    for state in (0, 2):
        of = used[state]
        columns = scale * np.column_stack([slopes[0, state][of], slopes[1, state][of], nuisances[0, state][of]])
        wanted = scale * (columns[:, :2] @ about / scale - residuals[state][of])
        deviation = scale * model_error[state][of]
        inverse = np.linalg.inv(np.eye(of.sum()) + np.outer(deviation, deviation))
        information += columns.T @ inverse @ columns
        right += columns.T @ inverse @ wanted
    found = np.hstack([rows.columns, rows.nuisances])
    factor = np.sqrt(np.trace(information) / np.trace(found.T @ found))
    assert found.T @ found * factor**2 == pytest.approx(information, rel=1e-7)
    assert found.T @ rows.observed * factor**2 == pytest.approx(right, rel=1e-7)
    assert factor == pytest.approx(max(1.0, bending_rows._residual_of_all_columns(rows) * factor), rel=1e-7)
    assert rows.groups.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]  # a group for each used state, of as many rows as changes


def test_the_noise_of_a_beam_is_at_least_a_nanometre_part(monkeypatch):
    _, noise_mm, *_ = whitened(monkeypatch, tau=1.0, noise=0.0)
    assert noise_mm == 1e-9


@dataclass
class AnyModel:
    # Replaces a beam model: it finds an equilibrium in the first state, and returns `status` for the second.

    status: Status
    calls: list[tuple[object, ...]] = field(default_factory=list)

    def solve(self, law, candidates, loads, **options):
        self.calls.append((law, candidates.tolist(), loads, options))
        return SimpleNamespace(status=np.array([Status.CONVERGED, self.status]), every="shapes")


def simulated(model, near=None):
    observed = SimpleNamespace(misfit=lambda *given: given)
    experiment = SimpleNamespace(solved=model, loads="loads", observed=observed, change="change")
    return bending_rows._misfit(experiment, "law", np.array([1.0, 2.0]), near)


@pytest.mark.parametrize("status", Status)
def test_a_beam_is_used_if_its_equilibrium_is_found(status):
    model = AnyModel(status)
    if status not in (Status.CONVERGED, Status.UNSTABLE):
        with pytest.raises(bending_rows.NoEquilibrium):
            simulated(model)
        return
    (used_model, shapes, corrections, change), every = simulated(model)
    assert (used_model, shapes.every, corrections, change, every) == (model, "shapes", None, "change", "shapes")
    assert model.calls == [("law", [[1.0, 2.0]], "loads", {"tolerance_mm": 1e-4})]


def test_a_planar_beam_starts_at_the_shape_of_a_similar_law(monkeypatch):
    monkeypatch.setattr(bending_rows, "BeamModel", AnyModel)
    model = AnyModel(Status.CONVERGED)
    simulated(model, "near")
    assert model.calls == [("law", [[1.0, 2.0]], "loads", {"tolerance_mm": 1e-4, "keep": True, "near": "near"})]
