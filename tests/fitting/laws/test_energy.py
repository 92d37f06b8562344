"""Strain energies have the right derivatives and limits."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_fitting.laws import LAWS, Section

OGDEN = np.array([0.03, 1.7, 0.001, 8.0, -0.01, -2.5])
SECTIONS = get_args(Section)


def random_parameters(row, seed: int) -> np.ndarray:
    # Return the example parameters (MPa) of a law, each times a random factor between 0.5 and 1.5.
    example = np.array(row.energy)
    return example * np.random.default_rng(seed).uniform(0.5, 1.5, example.shape)


@pytest.mark.parametrize("section", SECTIONS)
@settings(max_examples=40)
@given(stretch=st.floats(0.6, 2.0), J=st.floats(0.8, 1.25), seed=st.integers(0, 10**6))
def test_derivatives_match_central_differences(row, section, stretch, J, seed):
    law, parameters = row.law, random_parameters(row, seed)
    a = np.array(stretch**2 + (J / stretch) ** 2)
    J = np.array(J)
    a = np.maximum(a, 2 * J * (1 + 1e-3))  # the stretches are real only if a >= 2 J, also in the central differences
    h = 1e-5

    def energy(da, dJ):
        return law.planar(parameters, a + da, J + dJ, section)

    here = energy(0, 0)
    size = law.initial_shear_modulus(parameters)
    for derivative, plus, minus in (
        (here.a, energy(h, 0).value, energy(-h, 0).value),
        (here.J, energy(0, h).value, energy(0, -h).value),
        (here.aa, energy(h, 0).a, energy(-h, 0).a),
        (here.aJ, energy(0, h).a, energy(0, -h).a),
        (here.JJ, energy(0, h).J, energy(0, -h).J),
    ):
        assert derivative == pytest.approx((plus - minus) / (2 * h), rel=1e-6, abs=1e-6 * size)


@pytest.mark.parametrize("section", SECTIONS)
def test_energy_and_stress_vanish_at_rest(row, section):
    law, parameters = row.law, np.array(row.energy)
    e = law.planar(parameters, np.array(2.0), np.array(1.0), section)
    assert e.value == pytest.approx(0, abs=1e-15)
    # In-plane stress 2 psi_a F + psi_J cof F vanishes at F = 1.
    assert 2 * e.a + e.J == pytest.approx(0, abs=1e-15)


def test_small_simple_shear_has_the_initial_shear_modulus(row):
    law, parameters = row.law, np.array(row.energy)
    gamma = 1e-4
    e = law.planar(parameters, np.array(2 + gamma**2), np.array(1.0), "plane-strain")
    assert 2 * e.value / gamma**2 == pytest.approx(law.initial_shear_modulus(parameters), rel=1e-5)


@settings(max_examples=60)
@given(
    stretch=st.floats(0.5, 3.0),
    J=st.floats(0.8, 1.25),
    mu=st.floats(0.001, 1.0),
    share=st.floats(0.0, 1.0),
    section=st.sampled_from(SECTIONS),
)
def test_ogden_with_exponents_two_is_neo_hookean_and_mooney_rivlin(stretch, J, mu, share, section):
    a, J = np.array(stretch**2 + (J / stretch) ** 2), np.array(J)
    # Ogden mu1 = 2 C10 at alpha 2 and mu2 = -2 C01 at alpha -2 is Mooney-Rivlin; share 0 is Neo-Hookean.
    c10, c01 = 0.5 * mu * (1 - share), 0.5 * mu * share
    ogden = LAWS["ogden"].planar(np.array([2 * c10, 2.0, -2 * c01, -2.0, 0.0, 1.0]), a, J, section)
    mooney = LAWS["mooney-rivlin"].planar(np.array([c10, c01]), a, J, section)
    for computed, expected in zip(ogden, mooney, strict=True):
        assert computed == pytest.approx(expected, rel=1e-8, abs=1e-9 * mu)
    if share == 0.0:
        neo = LAWS["neo-hookean"].planar(np.array([mu]), a, J, section)
        assert ogden.value == pytest.approx(neo.value, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("excess", [0.0, 1e-15, 1e-12, 1e-8, 1e-4, 0.0999, 0.1001, 3.0])
def test_ogden_is_smooth_through_equal_stretches(excess):
    law = LAWS["ogden"]
    parameters = OGDEN
    e = law.planar(parameters, np.array(2 * (1 + excess)), np.array(1.0), "plane-strain")
    assert all(np.isfinite(x).all() for x in e)
    # The reference is the energy as a function of the stretches.
    c = 1 + excess
    l1 = np.sqrt(c + np.sqrt(c * c - 1))
    direct = sum(m / al * (l1**al + l1**-al + 1 - 3) for m, al in zip(parameters[0::2], parameters[1::2], strict=True))
    assert e.value == pytest.approx(direct, rel=1e-7, abs=1e-15)


@settings(max_examples=30)
@given(log_stretch=st.floats(-0.6, 0.6), seed=st.integers(0, 10**6))
def test_principal_form_agrees_with_the_planar_one(row, log_stretch, seed):
    law, parameters = row.law, random_parameters(row, seed)
    logs = log_stretch * np.array([1.0, -1.0, 0.0])
    energy, _, _ = law.principal(parameters, np.exp(logs))
    planar = law.planar(parameters, np.array(2 * np.cosh(2 * log_stretch)), np.array(1.0), "plane-strain")
    assert energy == pytest.approx(planar.value, rel=1e-9, abs=1e-12)


@settings(max_examples=30)
@given(logs=st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6)), seed=st.integers(0, 10**6))
def test_principal_derivatives_match_central_differences_and_are_symmetric_in_the_stretches(row, logs, seed):
    law, parameters = row.law, random_parameters(row, seed)
    logs = np.array([*logs, -sum(logs)])
    energy, gradient, hessian = law.principal(parameters, np.exp(logs))
    h = 1e-5
    size = np.abs(hessian).max()
    for i in range(3):
        step = np.eye(3)[i] * h
        up, down = (law.principal(parameters, np.exp(logs + s * step)) for s in (1, -1))
        assert gradient[i] == pytest.approx((up[0] - down[0]) / (2 * h), rel=1e-6, abs=1e-6 * size)
        assert hessian[i] == pytest.approx((up[1] - down[1]) / (2 * h), rel=1e-6, abs=1e-6 * size)
    assert hessian == pytest.approx(hessian.T, abs=1e-12 * size)
    order = [2, 0, 1]
    turned = law.principal(parameters, np.exp(logs[order]))
    assert turned[0] == pytest.approx(energy, rel=1e-12, abs=1e-14)
    assert turned[1] == pytest.approx(gradient[order], rel=1e-12, abs=1e-12 * size)
    assert turned[2] == pytest.approx(hessian[np.ix_(order, order)], rel=1e-12, abs=1e-12 * size)
