"""Causes of residuals that concern loads or law (such as a wrong field) change the simulation as expected."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.inference.doubts import causes_in_loads
from eimi_fitting.inference.doubts.causes_in_loads import directions_of_change, strengths
from eimi_fitting.inference.doubts.possible_causes import Assumed
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress

CAUSES = {cause.name: cause for cause in POSSIBLE_CAUSES}
FIELD_MT = np.array([0.0, 5.0, 10.0, 10.0, 5.0, 0.0])
LOADS = Loads.along(FIELD_MT, field_angle_deg=30.0, tip_force_N=0.02, tip_force_angle_deg=90.0)


def changed(name: str, *amplitudes: float, loads: Loads = LOADS) -> Loads:
    assumed: Any = Loaded(SimpleExperiment(loads))
    change = CAUSES[name].change
    assert change is not None
    return change(assumed, np.array(amplitudes)).experiment.loads


class SimpleExperiment:
    # A replacement for an experiment, with the attribute `loads` only.

    def __init__(self, loads: Loads) -> None:
        self.loads = loads


class Loaded:
    # A replacement for the class `Assumed`, with the attribute `experiment` only.

    def __init__(self, experiment: Any) -> None:
        self.experiment = experiment


@pytest.fixture(autouse=True)
def simple(monkeypatch: pytest.MonkeyPatch) -> None:
    # Let the tested module accept the replacements `SimpleExperiment` and `Loaded`.
    def replaced(one: Any, **new: Any) -> Any:
        if isinstance(one, SimpleExperiment | Loaded):
            return type(one)(*new.values())
        return replace(one, **new)

    monkeypatch.setattr(causes_in_loads, "replace", replaced)


def test_strength_and_direction_of_change_follow_field_and_force() -> None:
    np.testing.assert_allclose(strengths(LOADS), FIELD_MT / 10 + 1.0)
    without_force = Loads.along(FIELD_MT, gravity_angle_deg=None)
    np.testing.assert_allclose(strengths(without_force), FIELD_MT / 10)
    np.testing.assert_allclose(strengths(Loads.along([0.0, 0.0], gravity_angle_deg=None)), [0.0, 0.0])
    np.testing.assert_array_equal(directions_of_change(LOADS), [1, 1, 1, 1, -1, -1])
    falling = Loads.along(np.array([10.0, 5.0, 5.0, 7.0]), gravity_angle_deg=None)
    np.testing.assert_array_equal(directions_of_change(falling), [1, -1, -1, 1])
    np.testing.assert_array_equal(directions_of_change(Loads.along([0.0, 0.0], gravity_angle_deg=None)), [1, 1])


@pytest.mark.parametrize(
    ("name", "stiffness"),
    [("creep", 1 - 0.2 * np.arange(6) / 5), ("hysteresis", np.array([1.0, 1.0, 1.0, 1.0, 0.8, 0.8]))],
)
def test_a_softer_beam_is_one_under_larger_loads(name: str, stiffness: np.ndarray) -> None:
    found = changed(name, 0.2)
    for load in ("field_T", "gravity", "tip_force_N"):
        np.testing.assert_allclose(getattr(found, load), getattr(LOADS, load) / stiffness[:, None])


def test_an_uneven_field_adds_gradients_along_and_across_the_coil() -> None:
    coil = changed("field_gradient", 2.0, -1.0, 3.0).coil
    assert coil is not None
    assert coil.gradient_per_m == pytest.approx((2.0, -1.0))
    axis = np.array([np.cos(np.radians(30.0)), np.sin(np.radians(30.0))])
    np.testing.assert_allclose(coil.axis, axis)
    more = changed("field_gradient", 0.5, 0.5, 3.0, loads=replace(LOADS, coil=coil)).coil
    assert more is not None
    assert more.gradient_per_m == pytest.approx((2.5, -0.5))
    assert more.curvature_per_m2 == pytest.approx(2 * coil.curvature_per_m2)
    assert coil.curvature_per_m2 > 0
    still = Loads.along([0.0, 0.0], gravity_angle_deg=None)
    assert changed("field_gradient", 2.0, 1.0, 1.0, loads=still) is still


def assumed_law(name: str, parameters: list[float]) -> Assumed:
    nowhere: Any = SimpleNamespace()
    return Assumed(LAWS[name], np.array([parameters]), None, nowhere)


@pytest.mark.parametrize(
    ("law", "parameters"), [("neo-hookean", [30e3]), ("mooney-rivlin", [10e3, 5e3]), ("yeoh", [15e3, 2e3, 100.0])]
)
def test_another_law_has_the_same_initial_modulus_and_two_more_terms(law: str, parameters: list[float]) -> None:
    given = assumed_law(law, parameters)
    change = CAUSES["law"].change
    assert change is not None
    assert change(given, np.zeros(2)) is given
    stretch = np.array([0.7, 0.9, 1.2, 1.8])
    modulus = float(given.law.initial_shear_modulus(given.parameters)[0])
    invariant = stretch**2 + 2 / stretch

    def added(quadratic: float, second: float) -> np.ndarray:
        # Return the engineering stress 2 (l - l^-2) (dW/dI1 + dW/dI2 / l) of two additional terms of the law.
        # l: stretch; W: energy of both terms; quadratic, second: their factors of (I1 - 3)² and I2.
        by_first = 2 * quadratic * (invariant - 3) - 0.5 * second
        return 2 * modulus * (stretch - stretch**-2) * (by_first + 0.5 * second / stretch)

    for amplitudes in ((1e-12, 0.0), (0.1, 0.0), (0.0, 0.3), (0.1, -0.2)):
        found = change(given, np.array(amplitudes))
        np.testing.assert_allclose(found.law.initial_shear_modulus(found.parameters), [modulus])
        before = engineering_stress(given.law, given.parameters, stretch - 1)[0]
        after = engineering_stress(found.law, found.parameters, stretch - 1)[0]
        np.testing.assert_allclose(after - before, added(*amplitudes), rtol=1e-6, atol=1e-6 * modulus)


def test_a_law_without_these_terms_is_not_changed() -> None:
    given = assumed_law("ogden", [1e3, 2.0])
    change = CAUSES["law"].change
    assert change is not None
    assert change(given, np.array([0.1, 0.3])) is given


def test_a_cause_with_a_source_has_its_unit_and_at_least_its_numbers() -> None:
    for cause in POSSIBLE_CAUSES:
        assert all(size > 0 for size in cause.sizes)
        assert cause.decide_by
        if cause.source:
            assert cause.unit == SOURCES[cause.source].unit
            assert len(cause.sizes) >= len(SOURCES[cause.source].parts)
            assert set(cause.parts_of) <= set(SOURCES)
    assert {cause.name for cause in POSSIBLE_CAUSES if cause.is_common} == {"section", "law"}
    assert [cause.name for cause in POSSIBLE_CAUSES if cause.change is None] == ["section"]
