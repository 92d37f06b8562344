"""The creep of a Prony series is the inverse of its relaxation."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.laws.prony import Prony


def test_a_standard_linear_solid_creeps_as_its_closed_form() -> None:
    series = Prony(np.array([[0.3], [0.1]]), np.array([[2.0], [0.5]]))
    long_term = series.long_term
    expected = 1 / long_term - (1 / long_term - 1) * np.exp(-1.5 * long_term / series.tau_s[:, 0])
    assert series.creep(1.5) == pytest.approx(expected, rel=1e-12)


def test_the_stress_of_the_creeping_strain_stays_constant() -> None:
    series = Prony(np.array([0.1, 0.15, 0.2]), np.array([0.05, 1.0, 7.0]))
    times = np.linspace(0.0, 3.0, 3001)
    strain = np.array([float(series.creep(t)) for t in times])
    middle = 0.5 * (times[1:] + times[:-1])
    stress = strain[0] * series.ratio(3.0) + np.sum(np.diff(strain) * series.ratio(3.0 - middle))
    assert strain[0] == pytest.approx(1.0)
    assert stress == pytest.approx(1.0, rel=1e-5)
    assert float(series.creep(1e5)) == pytest.approx(1 / float(series.long_term))
