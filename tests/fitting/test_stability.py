"""Drucker's criterion on laws whose limits are known by hand."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.materials import LAWS
from eimi_fitting.stability import stable_stretch, stable_up_to


def test_positive_neo_hookean_is_always_stable():
    assert stable_stretch(LAWS["neo-hookean"], np.array([[4e4]]), np.array([5.0]))[0] == pytest.approx(5.0)
    assert stable_up_to(LAWS["neo-hookean"], np.array([4e4])) is None


def test_negative_modulus_is_never_stable():
    assert stable_stretch(LAWS["neo-hookean"], np.array([[-4e4]]), np.array([1.01]))[0] == 0.0


def test_falling_yeoh_loses_stability_where_planar_tension_does():
    c10, c20 = 1e4, -2e3
    limit = stable_up_to(LAWS["yeoh"], np.array([c10, c20, 0.0]))
    # Sooner or later in planar tension than in the others, but never later than there: the work-conjugate stress
    # t = W'(x) (l^2 - l^-2) with x = l^2 + l^-2 - 2 must rise with ln l.
    stretch = np.linspace(1.001, 3, 20000)
    x = stretch**2 + stretch**-2 - 2
    t = (c10 + 2 * c20 * x) * (stretch**2 - stretch**-2)
    planar = stretch[np.argmax(np.diff(t) < 0)]
    assert limit is not None
    assert 1.0 < limit <= planar * 1.01
    reached = np.array([0.99 * limit, 1.2 * limit])
    stable = stable_stretch(LAWS["yeoh"], np.array([[c10, c20, 0.0]] * 2), reached)
    assert stable[0] == pytest.approx(reached[0])
    assert stable[1] == pytest.approx(limit, rel=0.02)


def test_mooney_rivlin_with_negative_c01_has_a_limit_and_with_positive_none():
    assert stable_up_to(LAWS["mooney-rivlin"], np.array([1e4, 5e3])) is None
    limit = stable_up_to(LAWS["mooney-rivlin"], np.array([4.908e4, -3.511e4]))
    assert limit == pytest.approx(1.1, abs=0.1)


def test_ogden_with_positive_products_is_always_stable():
    assert stable_up_to(LAWS["ogden"], np.array([1e4, 2.0, 50.0, 9.0, -3e3, -3.0])) is None
