"""Intervals of a tensile fit, roots of polynomials and the terms of laws agree with calculations by hand."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.laws import LAWS, engineering_stress, stable_up_to
from eimi_fitting.laws.ogden import _cosh_of_scaled_angle, _with_intervals
from eimi_fitting.laws.stability import smallest_positive_root
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term
from eimi_fitting.laws.tensile import correlation_of, covariance_of

OGDEN = LAWS["ogden"]
STRAIN = np.linspace(0.02, 1.5, 60)
RANGES = np.array([[0.5, 4.0], [4.0, 12.0], [-6.0, -0.5]])


def sloped(parameters: np.ndarray, weight: np.ndarray, unknowns: list[int]) -> np.ndarray:
    # Return derivatives of the weighted stress by mu·alpha/2 and alpha of the k Ogden terms `unknowns`, (m, 2 k).
    def stress(shares: np.ndarray, exponents: np.ndarray) -> np.ndarray:
        values = np.column_stack([2 * shares / exponents, exponents]).ravel()
        return np.asarray(weight * engineering_stress(OGDEN, values, STRAIN))

    exponents = parameters[1::2]
    shares = 0.5 * parameters[0::2] * exponents
    columns = []
    for which in ("shares", "exponents"):
        for p in unknowns:
            step = np.zeros(3)
            step[p] = 1e-3 * (shares[p] if which == "shares" else 1.0)
            if which == "shares":
                change = stress(shares + step, exponents) - stress(shares - step, exponents)
            else:
                change = stress(shares, exponents + step) - stress(shares, exponents - step)
            columns.append(change / (2 * step[p]))
    return np.stack(columns, axis=1)


def test_the_intervals_of_an_ogden_fit_are_those_of_a_linear_fit_in_its_shares_and_exponents() -> None:
    rng = np.random.default_rng(2)
    parameters = np.array([20e3, 1.5, 30.0, 6.0, 0.0, -2.0])
    weight = np.where(STRAIN < 0.5, 1.0, 2.0)
    residual = 200.0 * rng.standard_normal(60)
    found = _with_intervals(OGDEN, parameters, STRAIN, residual, weight, RANGES)
    slopes = sloped(parameters, weight, [0, 1])
    prior = np.diag([0.0, 0.0, 12 / 3.5**2, 12 / 8.0**2])
    covariance, t, tau = covariance_of(slopes, residual, prior)
    shares, exponents = np.array([15e3, 90.0]), np.array([1.5, 6.0])
    for p in range(2):
        half = t * np.sqrt(covariance[2 + p, 2 + p])
        expected = np.clip([exponents[p] - half, exponents[p] + half], *RANGES[p])
        assert found.intervals[2 * p + 1] == pytest.approx(expected, rel=1e-3)
        slope = np.zeros(4)
        slope[p], slope[2 + p] = 2 / exponents[p], -2 * shares[p] / exponents[p] ** 2
        half = t * np.sqrt(slope @ covariance @ slope)
        assert found.intervals[2 * p] == pytest.approx(parameters[2 * p] + half * np.array([-1.0, 1.0]), rel=1e-3)
    total = np.array([1.0, 1.0, 0.0, 0.0])
    assert found.modulus_half_width == pytest.approx(t * np.sqrt(total @ covariance @ total), rel=1e-3)
    assert found.correlation_rows == pytest.approx(tau)
    # The third term is absent: its exponent may have any value, and its modulus is limited by the noise.
    assert found.intervals[5].tolist() == RANGES[2].tolist()
    unit = weight * engineering_stress(OGDEN, np.array([0.0, 1.0, 0.0, 1.0, 2 / -2.0, -2.0]), STRAIN)
    undetected = t * np.sqrt(tau * (residual @ residual) / (60 - 4) / (unit @ unit))
    assert found.intervals[4] == pytest.approx([2 * undetected / -2.0, 0.0], rel=1e-3)
    assert list(found.held_by_bounds[4:]) == [True, True]
    assert list(found.held_by_bounds[:4:2]) == [False, False]
    jacobian = np.zeros((6, 4))
    for p in range(2):
        jacobian[2 * p, p], jacobian[2 * p, 2 + p] = 2 / exponents[p], -2 * shares[p] / exponents[p] ** 2
        jacobian[2 * p + 1, 2 + p] = 1.0
    assert found.correlation == pytest.approx(correlation_of(jacobian @ covariance @ jacobian.T), abs=1e-3)


def test_an_exponent_is_held_by_its_bounds_if_its_interval_contains_both() -> None:
    residual = 100.0 * np.where(np.arange(60) % 2, 1.0, -1.0)
    loose = _with_intervals(OGDEN, np.array([20e3, 1.5, 1e-9, 8.0, 0.0, -2.0]), STRAIN, residual, np.ones(60), RANGES)
    assert loose.held_by_bounds[3]
    assert loose.intervals[3].tolist() == RANGES[1].tolist()


def test_the_hyperbolic_cosine_of_a_scaled_angle_is_exact_near_and_far_from_rest() -> None:
    for nu in (-3.0, 0.25, 1.0, 2.0, 6.0):
        angle = np.array([0.0, 1e-9, 1e-4, 0.01, 0.2, 0.44, 0.46, 1.0, 3.0])
        c = np.cosh(angle)
        # c - 1 without cancellation
        g, g1, g2 = _cosh_of_scaled_angle(np.array(nu), 1.0 + 2 * np.sinh(0.5 * angle) ** 2)
        assert g == pytest.approx(np.cosh(nu * angle), rel=1e-12)
        away = angle > 0.005
        first = nu * np.sinh(nu * angle[away]) / np.sinh(angle[away])
        second = (nu**2 * np.cosh(nu * angle[away]) - c[away] * first) / np.sinh(angle[away]) ** 2
        assert g1[away] == pytest.approx(first, rel=1e-10)
        assert g2[away] == pytest.approx(second, rel=1e-6, abs=1e-9)
        assert g1[0] == pytest.approx(nu**2)
        assert g2[0] == pytest.approx(nu**2 * (nu**2 - 1) / 3)


@pytest.mark.parametrize(
    ("coefficients", "root"),
    [
        ([2.0, -3.0, 1.0], 1.0),  # (x - 1) (x - 2)
        ([1.0, 3.0, 2.0], np.inf),  # both roots are negative
        ([4.0, -4.0, 1.0], 2.0),  # a double root
        ([1.0, -1.0, 1.0], np.inf),  # a complex pair
        ([-1.0, 1.0, 0.0], 0.0),  # not positive at zero
        ([0.0, 1.0, 0.0], 0.0),
        ([1.0, 0.0, 0.0], np.inf),
        ([np.nan, 1.0, 0.0], 0.0),
        ([6.0, -5.0, 1.0], 2.0),
    ],
)
def test_the_smallest_positive_root_of_a_polynomial(coefficients: list[float], root: float) -> None:
    assert smallest_positive_root(np.array([coefficients]))[0] == pytest.approx(root, rel=1e-6)


def test_a_complex_pair_that_almost_touches_the_axis_is_a_double_root() -> None:
    for part, is_root in ((0.8e-6, True), (1.2e-6, False)):
        pair = np.array([[4.0 * (1 + part**2), -4.0, 1.0]])  # the roots are 2 (1 ± i part)
        assert bool(np.isfinite(smallest_positive_root(pair)[0])) is is_root


def test_a_law_is_checked_up_to_a_stretch_of_six() -> None:
    assert stable_up_to(LAWS["neo-hookean"], np.array([1.0])) is None
    assert stable_up_to(LAWS["neo-hookean"], np.array([-1.0])) == 1.0
    # Mooney-Rivlin with a negative C10 is stable up to the fourth root of the ratio of its parameters.
    for limit, found in ((5.9, 5.9), (6.1, None)):
        assert stable_up_to(LAWS["mooney-rivlin"], np.array([-1.0, limit**4])) == (
            None if found is None else pytest.approx(found)
        )


def test_terms_have_names_numbers_and_formulas() -> None:
    names = ["i1", "i2", "i1^2", "i1^3", "gent=20", "fung=0.5", "ogden=-2"]
    terms = [Term.of(f" {name.upper()} ") for name in names]
    assert [term.name for term in terms] == names
    assert [term.has_modulus for term in terms] == [True, True, False, False, True, True, True]
    assert [term.largest_x for term in terms] == [np.inf] * 4 + [20.0, np.inf, np.inf]
    for wrong in ("i3", "i1=2", "gent", "gent=0", "gent=-1", "fung=-1", "ogden=0", "fung=inf", "gent=much", ""):
        with pytest.raises(ValueError, match=r"should be one of i1, i2, .* with Jm > 0, b > 0 and alpha not 0"):
            Term.of(wrong)


@pytest.mark.parametrize(
    ("name", "energy", "slope"),
    [
        ("i1", lambda x: 0.5 * x, lambda x: 0.5 + 0 * x),
        ("i1^2", lambda x: x**2, lambda x: 2 * x),
        ("i1^3", lambda x: x**3, lambda x: 3 * x**2),
        ("gent=20", lambda x: -10 * np.log(1 - x / 20), lambda x: 10 / (20 - x)),
        ("fung=0.5", lambda x: np.expm1(0.5 * x), lambda x: 0.5 * np.exp(0.5 * x)),
    ],
)
def test_a_term_has_its_energy_and_its_derivatives(name: str, energy, slope) -> None:  # type: ignore[no-untyped-def]
    law, x = SumOfTerms.of(name), np.array([0.0, 0.5, 3.0])
    stretch = np.array([1.0, 1.3, 2.0])
    x = stretch**2 + 2 / stretch - 3
    stress = engineering_stress(law, np.array([3.0]), stretch - 1)
    assert stress == pytest.approx(3.0 * 2 * (stretch - stretch**-2) * slope(x), abs=1e-12)
    principal = np.stack([stretch, stretch**-0.5, stretch**-0.5], axis=-1)
    assert law.principal(np.array([3.0]), principal)[0] == pytest.approx(3.0 * energy(x), abs=1e-12)


def test_a_sum_of_terms_with_a_negative_coefficient_is_as_stable_as_the_same_yeoh_law() -> None:
    law, yeoh = SumOfTerms.of("i1", "i1^2", "i1^3"), LAWS["yeoh"]
    parameters = np.array(
        [[40e3, -3e3, 0.0], [40e3, 3e3, 100.0], [40e3, -3e3, 400.0], [0.0, 3e3, 0.0], [-1.0, 3e3, 0.0]]
    )
    reached = np.full(5, 6.0)
    found = law.drucker_limit(parameters, reached)
    expected = yeoh.drucker_limit(parameters * [0.5, 1.0, 1.0], reached)
    assert np.minimum(found, 6.0) == pytest.approx(np.minimum(expected, 6.0), rel=1e-4)
    assert 1.0 < found[0] < 6.0
    assert found[1] == np.inf
    assert reached.tolist() == [6.0] * 5


def test_coordinates_of_an_ogden_law_share_the_modulus_between_its_terms():
    x = np.array([[30e3, 0.2, 0.7, 1.5, 6.0, -2.0], [10e3, 0.5, 0.1, 2.0, 8.0, -4.0]])
    parameters = LAWS["ogden"].from_coordinates(x)
    shares = parameters[:, 0::2] * parameters[:, 1::2] / (2 * x[:, :1])
    assert shares == pytest.approx(np.array([[0.2, 0.8 * 0.7, 0.8 * 0.3], [0.5, 0.5 * 0.1, 0.5 * 0.9]]))
    assert parameters[:, 1::2] == pytest.approx(x[:, 3:])
    assert LAWS["ogden"].initial_shear_modulus(parameters) == pytest.approx(x[:, 0])


def test_coordinates_of_other_laws_share_the_modulus_between_their_parameters():
    rivlin = LAWS["mooney-rivlin"].from_coordinates(np.array([[40e3, 0.3]]))
    assert rivlin == pytest.approx(np.array([[20e3 * 0.7, 20e3 * 0.3]]))
    law = SumOfTerms.of("i1^2", "i2", "i1", "fung=0.2")
    found = law.from_coordinates(np.array([[40e3, 0.05, 0.2, 0.3], [10e3, 0.5, 0.0, 0.4]]))
    assert found == pytest.approx(np.array([[2e3, 20e3, 8e3, 12e3], [5e3, 6e3, 0.0, 4e3]]))
    assert law.initial_shear_modulus(found) == pytest.approx([40e3, 10e3])


@pytest.mark.parametrize(
    ("name", "formula"),
    [
        ("i1", "mu/2 (I1 - 3)"),
        ("i2", "mu/2 (I2 - 3)"),
        ("i1^2", "C (I1 - 3)^2"),
        ("i1^3", "C (I1 - 3)^3"),
        ("gent=20", "-mu 20/2 ln(1 - (I1 - 3)/20)"),
        ("fung=0.2", "mu/(2*0.2) (exp(0.2 (I1 - 3)) - 1)"),
        ("ogden=-4", "2 mu/(-4)^2 (sum of l^-4 - 3)"),
    ],
)
def test_the_energy_of_a_term_is_written_as_a_formula(name: str, formula: str):
    assert Term.of(name).formula == formula
    assert SumOfTerms.of(name, "i1").formula == f"W = {formula} + mu/2 (I1 - 3)"
    assert Term.of(name).largest_x == (20.0 if name == "gent=20" else np.inf)


@pytest.mark.parametrize("law", [*LAWS.values(), SumOfTerms.of("i1^2", "i1")], ids=lambda law: law.name)
def test_the_modulus_of_a_law_is_searched_from_one_kilopascal_to_one_megapascal(law):
    first = law.coordinates[0]
    assert (first.lower, first.upper) == (1e3, 1e6)
