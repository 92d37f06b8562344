"""A fit to a tensile test agrees with simulated curves, closed forms and published values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import CannotFit, engineering_stress, fit_tensile

STRAIN = np.linspace(0.05, 1.5, 60)
EXAMPLES = {
    "neo-hookean": [46e3],
    "mooney-rivlin": [20e3, 4e3],
    "yeoh": [19.5e3, 3e3, 400.0],
    "ogden": [20e3, 1.7, 300.0, 5.0, -6e3, -2.0],
}


@settings(max_examples=60)
@given(stretch=st.floats(0.3, 6.0), c=st.tuples(*[st.floats(-1e5, 1e5)] * 3))
def test_the_engineering_stress_agrees_with_closed_forms(stretch: float, c: tuple[float, float, float]) -> None:
    def stress(model: str, *parameters: float) -> float:
        return float(engineering_stress(LAWS[model], np.array(parameters), np.array([stretch - 1]))[0])

    simple = stretch - stretch**-2
    x = stretch**2 + 2 / stretch - 3
    size = 1e-6 + 1e-9 * sum(map(abs, c)) * stretch**6
    assert stress("neo-hookean", c[0]) == pytest.approx(c[0] * simple, rel=1e-9, abs=size)
    mooney = 2 * simple * (c[0] + c[1] / stretch)
    assert stress("mooney-rivlin", c[0], c[1]) == pytest.approx(mooney, rel=1e-9, abs=size / stretch**3 + size)
    yeoh = 2 * simple * (c[0] + 2 * c[1] * x + 3 * c[2] * x**2)
    assert stress("yeoh", *c) == pytest.approx(yeoh, rel=1e-9, abs=size)
    ogden = c[0] * (stretch**0.5 - stretch**-1.75) + c[1] * (stretch**3 - stretch**-3)
    assert stress("ogden", c[0], 1.5, c[1], 4.0, 0.0, -2.0) == pytest.approx(ogden, rel=1e-9, abs=size)


@pytest.mark.parametrize("relative", [False, True])
def test_a_fit_to_a_curve_of_the_law_recovers_its_parameters(row, relative: bool) -> None:
    law, truth = row.law, np.array(row.silicone)
    fit = fit_tensile(law, STRAIN, engineering_stress(law, truth, STRAIN), relative=relative)
    modulus = float(law.initial_shear_modulus(truth))
    if row.recovered is None:
        assert fit.rmse_Pa < 5e-4 * modulus
        assert fit.initial_shear_modulus_Pa == pytest.approx(modulus, rel=0.01)
    else:
        assert fit.parameters == pytest.approx(truth, rel=row.recovered)
    assert fit.stable_to is None
    assert (fit.rows, fit.rows_left_out, fit.max_strain) == (60, 0, 1.5)


@pytest.mark.parametrize("model", ["neo-hookean", "mooney-rivlin", "yeoh"])
@pytest.mark.parametrize("rows_alike", [1, 5])
def test_intervals_contain_the_truth(model: str, rows_alike: int) -> None:
    law, truth = LAWS[model], np.array(EXAMPLES[model])
    strain = np.linspace(0.02, 1.0, 200)
    clean = engineering_stress(law, truth, strain)
    rng = np.random.default_rng(1)
    modulus = float(law.initial_shear_modulus(truth))
    inside = 0
    for _ in range(200):
        noise = np.repeat(rng.normal(0, 1e3, 200 // rows_alike), rows_alike)
        low, high = fit_tensile(LAWS[model], strain, clean + noise).initial_shear_modulus_interval_Pa
        inside += low <= modulus <= high
    print(model, rows_alike, inside / 200)
    assert 0.88 <= inside / 200 <= 0.99


@pytest.mark.parametrize("model", ["mooney-rivlin", "yeoh"])
def test_the_correlation_of_parameters_equals_that_of_repeated_fits(model: str) -> None:
    law, truth = LAWS[model], np.array(EXAMPLES[model])
    clean = engineering_stress(law, truth, STRAIN)
    rng = np.random.default_rng(1)
    fits = [fit_tensile(LAWS[model], STRAIN, clean + rng.normal(0, 1e3, len(STRAIN))) for _ in range(200)]
    repeated = np.corrcoef([fit.parameters for fit in fits], rowvar=False)
    assert fits[0].correlation == pytest.approx(repeated, abs=0.05)


def test_the_correlation_of_an_ogden_fit_is_a_correlation_matrix() -> None:
    correlation = fit_tensile(
        LAWS["ogden"], STRAIN, engineering_stress(LAWS["ogden"], np.array(EXAMPLES["ogden"]), STRAIN)
    ).correlation
    assert correlation == pytest.approx(correlation.T)
    assert np.diag(correlation) == pytest.approx(1.0)
    assert np.linalg.eigvalsh(correlation).min() > -1e-9


def test_the_window_and_relative_residuals_select_the_rows() -> None:
    stress = 46e3 * ((1 + STRAIN) - (1 + STRAIN) ** -2)
    stress[0] = -10.0
    window = STRAIN <= 0.5
    absolute = fit_tensile(LAWS["neo-hookean"], STRAIN, stress, largest_strain=0.5)
    relative = fit_tensile(LAWS["neo-hookean"], STRAIN, stress, largest_strain=0.5, relative=True)
    assert (absolute.rows, absolute.rows_left_out) == (window.sum(), 0)
    assert (relative.rows, relative.rows_left_out) == (window.sum() - 1, 1)
    assert relative.parameters == pytest.approx([46e3])
    assert absolute.parameters[0] < 46e3
    with pytest.raises(CannotFit, match="3 rows can be used, but a fit of the yeoh law needs at least 4 rows"):
        fit_tensile(LAWS["yeoh"], STRAIN[:3], stress[:3])
    with pytest.raises(CannotFit, match="stresses of this sign"):
        fit_tensile(LAWS["ogden"], STRAIN, -stress)


@pytest.mark.parametrize(
    ("model", "strains"),
    [("mooney-rivlin", [0.5]), ("mooney-rivlin", [0.0, 0.5]), ("yeoh", [0.5]), ("yeoh", [0.2, 0.5])],
)
def test_a_curve_with_fewer_strains_than_parameters_is_refused(model: str, strains: list[float]) -> None:
    strain = np.resize(strains, 8)
    stress = 46e3 * ((1 + strain) - (1 + strain) ** -2) + np.random.default_rng(1).normal(0, 50.0, 8)
    with pytest.raises(CannotFit, match=f"strains do not determine the . parameters of the {model} law: give at least"):
        fit_tensile(LAWS[model], strain, stress)
    assert fit_tensile(LAWS["neo-hookean"], strain, stress).parameters == pytest.approx([46e3], rel=0.01)


@pytest.mark.parametrize("model", LAWS)
def test_a_curve_without_strain_or_stress_or_with_a_wrong_sign_is_refused(model: str) -> None:
    with pytest.raises(CannotFit, match="every strain is zero, but a fit needs strains that are not zero"):
        fit_tensile(LAWS[model], np.zeros(8), np.full(8, 1e3))
    with pytest.raises(CannotFit, match="every stress is zero, but a fit needs stresses that are not zero"):
        fit_tensile(LAWS[model], STRAIN, np.zeros(60))
    with pytest.raises(CannotFit, match="check the signs of strain and stress"):
        fit_tensile(LAWS[model], STRAIN, -30e3 * STRAIN)


def test_the_window_of_a_compression_test_selects_the_small_strains() -> None:
    strain = np.linspace(-0.02, -0.6, 30)
    stress = 46e3 * ((1 + strain) - (1 + strain) ** -2)
    window, whole = (fit_tensile(LAWS["neo-hookean"], strain, stress, largest_strain=most) for most in (0.21, np.inf))
    assert (window.rows, window.max_strain) == (10, pytest.approx(-0.2))
    assert (whole.rows, whole.max_strain) == (30, -0.6)
    assert whole.max_stretch == pytest.approx(0.4**-0.5)


# Least-squares fits to the engineering stress of the rows in the window, computed by an independent script. Each line:
# material and window (%): mu [RMSE]; C10, C01 [RMSE]; C10, C20, C30 [RMSE], all in kPa.
REFERENCE = """
dragon_skin_10_medium 20: 40.80 [1.41]; 69.0 -55.5 [0.95]; 13.02 124.9 -594.7 [0.85]
dragon_skin_10_medium 50: 46.39 [1.96]; 40.68 -23.55 [0.70]; 19.53 7.410 -3.117 [0.77]
dragon_skin_10_medium 100: 56.36 [6.54]; 49.08 -35.11 [1.06]; 20.45 4.473 -0.534 [0.62]
dragon_skin_10_medium full: 150.6 [105]; 92.72 -135.67 [16.8]; 48.78 0.3158 -0.001037 [28.7]
ecoflex_00-50 20: 18.35 [1.40]; 55.2 -52.5 [0.99]; 1.77 128.9 -631 [0.85]
ecoflex_00-50 50: 20.88 [1.01]; 16.01 -7.59 [0.79]; 8.737 4.511 -3.313 [0.79]
ecoflex_00-50 100: 22.41 [1.19]; 14.47 -5.54 [0.58]; 9.826 0.9125 -0.1556 [0.63]
ecoflex_00-50 full: 87.18 [223]; 62.40 -220.8 [123]; 13.86 0.1109 -8.76e-5 [4.8]
"""


def as_printed(value: float, printed: str) -> bool:
    # Return whether `value`, rounded to the digits of `printed`, equals `printed`.
    mantissa, _, exponent = printed.partition("e")
    last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return abs(value - float(printed)) <= 0.51 * last


@pytest.mark.parametrize("line", REFERENCE.split("\n")[1:-1], ids=lambda line: line.partition(":")[0])
def test_fits_of_published_curves_have_the_reference_values(measured: Path, line: str) -> None:
    heading, _, laws = line.partition(": ")
    material, window = heading.split()
    table = np.genfromtxt(measured / "tensile" / f"{material}.csv", delimiter=";", skip_header=18)
    strain, stress_Pa = table[:, 3], 1e6 * table[:, 4]
    largest = np.inf if window == "full" else float(window) / 100
    for model, printed in zip(("neo-hookean", "mooney-rivlin", "yeoh"), laws.split(";"), strict=True):
        *values, rmse = printed.split()
        fit = fit_tensile(LAWS[model], strain, stress_Pa, largest_strain=largest)
        assert len(values) == len(fit.parameters)
        for value, digits in zip(1e-3 * fit.parameters, values, strict=True):
            assert as_printed(value, digits), (model, value, digits)
        assert as_printed(1e-3 * fit.rmse_Pa, rmse.strip("[]")), (model, fit.rmse_Pa)
    ogden = fit_tensile(LAWS["ogden"], strain, stress_Pa, largest_strain=largest)
    assert int((ogden.parameters[0::2] != 0).sum()) == (2 if heading == "ecoflex_00-50 full" else 1)
    assert ogden.stable_to is None
