"""Drucker's stability criterion agrees with derivations by hand and with a search on a grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_fitting.laws import LAWS, Law
from eimi_fitting.laws.stability import LARGEST_STRETCH_CHECKED, scanned_limit, stable_stretch, stable_up_to

GRID, SHARES = 240, 181
BASIS = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]) / np.sqrt([[2.0], [6.0]])


def definite(law: Law, parameters: np.ndarray, log_stretches: np.ndarray) -> np.ndarray:
    # Return whether a law is stable (Drucker) at three log principal stretches, shape (..., 3) to (...).
    _, _, hessian = law.principal(parameters, np.exp(log_stretches))
    projected = np.einsum("ai,...ij,bj->...ab", BASIS, hessian, BASIS)
    return np.linalg.eigvalsh(projected)[..., 0] > 0


def grid_limit(law: Law, parameters: np.ndarray, most: float) -> tuple[float, float]:
    # Return the last stable stretch and the first unstable stretch on a grid; (`most`, inf) if all are stable.
    largest = np.linspace(0, np.log(most), GRID)[:, None]
    share = np.linspace(-0.5, 1, SHARES)
    states = np.stack(np.broadcast_arrays(largest, largest * share, -largest * (1 + share)), axis=-1)
    stable = definite(law, parameters, states).all(axis=1)
    if stable.all():
        return most, np.inf
    first = int(np.argmin(stable))
    return float(np.exp(largest[max(first - 1, 0), 0])), float(np.exp(largest[first, 0]))


@settings(max_examples=40)
@given(data=st.data())
def test_the_limit_agrees_with_a_dense_grid(row, data):
    law, parameters = row.law, np.array(data.draw(row.candidates))
    most = 4.0
    limit = stable_stretch(law, parameters, np.array([most]))[0]
    if not law.initial_shear_modulus(parameters) > 0:
        assert limit == 0.0
        return
    last_stable, first_unstable = grid_limit(law, parameters, most)
    # No unstable state lies below the limit. The limit may be below that of the grid only if the grid overlooks a
    # narrow unstable range. The smallest eigenvalue is then nearly zero.
    assert limit <= first_unstable * (1 + 1e-9)
    if limit < last_stable * (1 - 1e-5):
        assert smallest_stiffness_near(law, parameters, limit) < 1e-3


def smallest_stiffness_near(law: Law, parameters: np.ndarray, limit: float) -> float:
    # Return the relative stiffness just above the stretch `limit`; it is about 0 at the limit of stability.
    largest = np.log(max(limit, 1.0)) + np.linspace(0, 0.01, 40)[:, None]
    share = np.linspace(-0.5, 1, 4001)
    states = np.stack(np.broadcast_arrays(largest, largest * share, -largest * (1 + share)), axis=-1)
    _, _, hessian = law.principal(parameters, np.exp(states))
    values = np.linalg.eigvalsh(np.einsum("ai,...ij,bj->...ab", BASIS, hessian, BASIS))
    return float((values[..., 0] / np.abs(values).max(axis=-1)).min())


@settings(max_examples=100)
@given(ratio=st.floats(0.02, 0.98))
def test_mooney_rivlin_with_negative_c01_is_stable_up_to_the_maximum_equibiaxial_stress(ratio):
    # At the limit C10 (q^3 + 2) = -C01 (2 q^4 + q) with the squared stretch q.
    limit = stable_stretch(LAWS["mooney-rivlin"], np.array([1e4, -ratio * 1e4]), np.array([50.0]))[0]
    q = limit**2
    assert (q**3 + 2) / (2 * q**4 + q) == pytest.approx(ratio, rel=1e-9)


@settings(max_examples=100)
@given(ratio=st.floats(0.02, 0.98))
def test_mooney_rivlin_with_negative_c10_is_stable_up_to_the_bifurcation_of_equal_stretches(ratio):
    # A square sheet under equal forces stays square until C10 + C01 / stretch^4 = 0.
    limit = stable_stretch(LAWS["mooney-rivlin"], np.array([-ratio * 1e4, 1e4]), np.array([50.0]))[0]
    assert limit == pytest.approx(ratio**-0.25, rel=1e-12)


def test_yeoh_with_negative_c20_is_stable_up_to_the_maximum_equibiaxial_stress():
    c10, c20 = 1e4, -2e3
    limit = stable_up_to(LAWS["yeoh"], np.array([c10, c20, 0.0]))

    def stress(l):
        return (c10 + 2 * c20 * (2 * l**2 + l**-4 - 3)) * (l**2 - l**-4)

    assert limit is not None
    h = 1e-3
    assert stress(limit) > stress(limit - h)
    assert stress(limit) > stress(limit + h)
    assert (stress(limit + h) - stress(limit - h)) / (2 * h) == pytest.approx(0, abs=1e-4 * stress(limit) / h)
    reached = np.array([0.99 * limit, 1.2 * limit])
    stable = stable_stretch(LAWS["yeoh"], np.array([[c10, c20, 0.0]] * 2), reached)
    assert stable == pytest.approx([reached[0], limit], rel=1e-12)


def narrow_pocket() -> tuple[np.ndarray, float]:
    # Return Yeoh parameters that are unstable only in a narrow range of stretches, and the start of this range.
    law, c20 = LAWS["yeoh"], -0.1
    stiff, soft = 0.1, 0.001  # values of C30 with which the law is stable everywhere, and not stable everywhere
    for _ in range(40):
        c30 = 0.5 * (stiff + soft)
        if stable_up_to(law, np.array([1.0, c20, c30])) is None:
            stiff = c30
        else:
            soft = c30
    parameters = np.array([1.0, c20, soft * (1 - 1e-5)])
    limit = stable_up_to(law, parameters)
    assert limit is not None
    return parameters, limit


def test_an_unstable_range_between_the_points_of_a_grid_is_found():
    parameters, limit = narrow_pocket()
    law = LAWS["yeoh"]

    def equibiaxial(log_stretch):
        return np.asarray(log_stretch)[..., None] * np.array([1.0, 1.0, -2.0])

    twenty_five = equibiaxial(np.log(LARGEST_STRETCH_CHECKED) * np.linspace(0, 1, 25))
    assert definite(law, parameters, twenty_five).all()
    inside = equibiaxial(np.log(limit) + np.linspace(0, 0.01, 2001))
    unstable = ~definite(law, parameters, inside)
    assert unstable.any()
    assert not unstable[-1]
    assert np.log(limit) == pytest.approx(np.log(limit) + np.linspace(0, 0.01, 2001)[np.argmax(unstable)], abs=1e-5)


def test_a_narrow_unstable_range_of_ogden_is_found_and_every_state_below_the_limit_is_stable():
    # f(e) = exp(2 e) + exp(-2 e) - c exp(e): above a critical c, a range of states is unstable; it grows with c.
    law, most = LAWS["ogden"], np.array([3.0])

    def parameters(c):
        return np.array([0.5, 2.0, -0.5, -2.0, -c, 1.0])

    harmless, harmful = 0.0, 1.99
    for _ in range(30):
        c = 0.5 * (harmless + harmful)
        if stable_stretch(law, parameters(c), most)[0] < 3.0:
            harmful = c
        else:
            harmless = c
    for excess in (1e-1, 1e-3, 1e-5):
        unstable_law = parameters(harmful * (1 + excess))
        limit = stable_stretch(law, unstable_law, most)[0]
        assert 1.0 < limit < 3.0
        rng = np.random.default_rng(0)
        largest, share = np.log(limit) * rng.uniform(0, 1, 20000), rng.uniform(-0.5, 1, 20000)
        assert definite(law, unstable_law, np.stack([largest, largest * share, -largest * (1 + share)], axis=-1)).all()
        beyond, share = np.log(limit) + 1e-4, np.linspace(-0.5, 1, 40001)
        states = np.stack([beyond + 0 * share, beyond * share, -beyond * (1 + share)], axis=-1)
        assert not definite(law, unstable_law, states).all()


def test_positive_moduli_are_stable_everywhere():
    for name, parameters in (
        ("neo-hookean", [4e4]),
        ("mooney-rivlin", [1e4, 5e3]),
        ("yeoh", [1e4, 1e3, 10.0]),
        ("ogden", [1e4, 2.0, 50.0, 9.0, -3e3, -3.0]),
    ):
        assert stable_up_to(LAWS[name], np.array(parameters)) is None
        assert stable_stretch(LAWS[name], np.array([parameters]), np.array([5.0])) == pytest.approx([5.0])


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("neo-hookean", [-4e4]),
        ("mooney-rivlin", [1e4, -1e4]),
        ("yeoh", [-1.0, 1e4, 1e4]),
        ("yeoh", [0.0, 1e4, -1.0]),
        ("ogden", [-1e4, 2.0, 10.0, 3.0, 10.0, -1.0]),
    ],
)
def test_a_law_that_is_unstable_at_rest_is_stable_nowhere(name, parameters):
    assert stable_stretch(LAWS[name], np.array([parameters]), np.array([1.01])) == pytest.approx([0.0])
    assert stable_up_to(LAWS[name], np.array(parameters)) == 1.0


def test_the_limit_of_a_candidate_does_not_depend_on_the_other_candidates():
    rng = np.random.default_rng(3)
    reached = rng.uniform(1.0, 3.0, 30)
    for name in ("mooney-rivlin", "yeoh", "ogden"):
        law = LAWS[name]
        exponents = [3.0 if unit == "1" else 0.3 for unit in law.units]
        parameters = rng.normal(0, exponents, (30, len(exponents))) + np.eye(len(exponents))[0]
        together = stable_stretch(law, parameters, reached)
        alone = [stable_stretch(law, p, np.array([r]))[0] for p, r in zip(parameters, reached, strict=True)]
        assert together == pytest.approx(alone, rel=1e-12)
        assert np.ptp(together) > 0.1


def test_parameters_that_overflow_are_stable_nowhere_beyond_rest():
    for name, parameters in (("yeoh", [1e-320, -1e300, 1.0]), ("ogden", [1.0, 2.0, -1e-3, 900.0, 1.0, -2.0])):
        assert stable_stretch(LAWS[name], np.array([parameters]), np.array([2.0]))[0] <= 1.0 + 1e-6


@pytest.mark.parametrize("name", ["neo-hookean", "mooney-rivlin", "yeoh", "ogden"])
def test_a_scan_agrees_with_the_exact_limit(name):
    law, rng = LAWS[name], np.random.default_rng(0)
    size = np.array([3.0 if unit == "1" else 0.3 for unit in law.units])
    parameters = rng.normal(0, size, (60, len(size))) + np.eye(len(size))[0]
    most = rng.uniform(1.0, 4.0, 60)
    exact = np.minimum(law.drucker_limit(parameters, most), most)
    with np.errstate(all="ignore"):
        scanned = np.minimum(scanned_limit(law, parameters, most), most)
    assert (scanned == 0).tolist() == (exact == 0).tolist()
    # A scan may overlook unstable states between its points, so that its limit is never below the exact limit.
    assert np.all(scanned >= exact * (1 - 1e-4))
    assert np.mean(np.abs(scanned / np.maximum(exact, 1e-9) - 1)[exact > 0] < 1e-3) > 0.9
    assert name == "neo-hookean" or ((exact > 1) & (exact < most)).sum() > 5
