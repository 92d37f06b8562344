"""The widths of the intervals of a tensile fit agree with calculations by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from eimi_fitting.correlation import correlation_length
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress, fit_tensile

LAW, MU = LAWS["neo-hookean"], np.array([46e3])


@pytest.mark.parametrize("rows", [4, 8, 40])
@pytest.mark.parametrize("alike", [1, 4], ids=["white", "alike"])
def test_the_half_width_is_that_of_linear_least_squares(rows: int, alike: int) -> None:
    # Half-width of the modulus: t sigma sqrt(tau) / |s|. n: rows of the curve; s: n derivatives of the stress with
    # respect to the modulus; tau: correlated rows that count as one; t: Student's factor for n/tau - 1 degrees of
    # freedom; sigma²: sum of squared residuals / (n - 1).
    strain = np.linspace(0.1, 0.8, rows)
    slope = engineering_stress(LAW, np.ones(1), strain)
    noise = np.random.default_rng(rows).normal(0, 500, rows)
    if alike > 1:
        noise = np.convolve(np.concatenate([noise, noise]), np.ones(alike) / alike, "same")[:rows]
    fit = fit_tensile(LAW, strain, MU[0] * slope + noise)
    residual = fit.parameters[0] * slope - (MU[0] * slope + noise)
    tau = correlation_length(residual[None], np.ones((1, rows)))
    assert fit.correlation_rows == pytest.approx(tau)
    sigma = np.sqrt(residual @ residual / (rows - 1))
    t = stats.t.ppf(0.975, max(rows / tau - 1, 1.0))
    half = t * sigma * np.sqrt(tau) / np.linalg.norm(slope)
    low, high = fit.intervals[0]
    assert 0.5 * (high - low) == pytest.approx(half, rel=1e-6)
    assert 0.5 * (low + high) == pytest.approx(fit.parameters[0])
    assert fit.initial_shear_modulus_interval_Pa == pytest.approx((low, high))  # mu is the initial shear modulus
    assert fit.rmse_Pa == pytest.approx(np.sqrt(np.mean(residual**2)))


def test_an_absent_ogden_term_has_a_modulus_interval_of_finite_width() -> None:
    # The true curve has one of the three terms; the noise could hide small moduli of the other two.
    law = LAWS["ogden"]
    strain = np.linspace(0.02, 0.5, 25)
    truth = np.array([30e3, 2.0, 0.0, 6.0, 0.0, -2.0])
    stress = engineering_stress(law, truth, strain) + np.random.default_rng(4).normal(0, 100, 25)
    fit = fit_tensile(law, strain, stress)
    shares = fit.parameters[0::2] * fit.parameters[1::2]
    absent = np.flatnonzero(shares == 0)
    assert len(absent) > 0
    for term in absent:
        low, high = fit.intervals[2 * term]
        assert low <= 0 <= high
        assert high - low > 1.0
        assert law.parameter_names[2 * term] in fit.not_fixed
    # A parameter whose interval contains zero is reported as not fixed by the data.
    for name, (low, high) in zip(law.parameter_names, fit.intervals, strict=True):
        if low <= 0 <= high:
            assert name in fit.not_fixed


def test_exponents_that_the_data_do_not_determine_are_limited_by_their_range() -> None:
    # Small strains determine only the initial modulus, so that the moduli depend on the permitted exponents.
    law = LAWS["ogden"]
    strain = np.linspace(0.005, 0.06, 30)
    noise = np.random.default_rng(6).normal(0, 40, 30)
    fit = fit_tensile(law, strain, engineering_stress(LAWS["neo-hookean"], MU, strain) + noise)
    for place, name in enumerate(law.parameter_names):
        if not name.startswith("mu"):
            continue
        low, high = fit.intervals[place]
        assert high - low < 4e5, name  # the range of an exponent changes a modulus by a factor below ten
    low, high = fit.initial_shear_modulus_interval_Pa
    assert 0.001 * MU[0] < high - low < 0.2 * MU[0]
