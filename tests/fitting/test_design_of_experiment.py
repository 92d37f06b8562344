"""The load steps chosen for the next run give the narrowest interval, which is as wide as predicted."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.corrections import FINER_MESH
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.planning.design_of_experiment import (
    Candidates,
    EdgeNoise,
    KnownLaw,
    candidates,
)
from eimi_fitting.inference.planning.exchange import equally_spaced, exchange
from eimi_fitting.inference.planning.rival_laws import rivals
from eimi_fitting.laws import LAWS
from tests.shared.planned_states import Bench, Setting, fitted, half_percent, measured, planned
from tests.shared.virtual_measurements import stated

BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
NEO_HOOKEAN = KnownLaw(LAWS["neo-hookean"], np.array([46e3]))
NOISE = EdgeNoise(residual_mm=0.005, points=200, alike=10.0)


def of_fields(count: int, *sources: StatedSource, gravity_angle_deg: float | None = 0.0) -> Candidates:
    # Return `count` load steps at equally spaced fields, from which a plan chooses.
    # sources : uncertain inputs with their standard uncertainties
    loads = Loads.along(np.linspace(0.0, 7.05, count), gravity_angle_deg=gravity_angle_deg)
    return candidates(NEO_HOOKEAN, BEAM, loads, sources, NOISE)


def test_the_exchange_finds_the_best_of_all_choices() -> None:
    # All 120 choices of three states out of ten; the exchange algorithm replaces one chosen state at a time.
    plan = of_fields(10, StatedSource("clamp", 0.1, "here"), StatedSource("gravity", 1.0, "here"))
    every = np.array(list(combinations(range(10), 3)))
    assert plan.variance(exchange(plan, 3)[None])[0] == pytest.approx(plan.variance(every).min())
    assert plan.variance(equally_spaced(10, 3)[None])[0] > 1.1 * plan.variance(every).min()
    assert plan.least_percent(3) ** 2 < 1e4 * 1.96**2 * plan.variance(every).min()


def test_no_choice_of_fields_reduces_an_error_that_scales_the_field() -> None:
    # Without gravity, the edges depend only on the ratio of field and modulus.
    plan = of_fields(8, StatedSource("coil", 0.01, "coil"), gravity_angle_deg=None)
    assert plan.least_percent(1000) == pytest.approx(1.96, rel=1e-2)
    assert plan.effects_percent(exchange(plan, 3))["coil constant"] == pytest.approx(1.0, rel=5e-3)
    # If the weight also bends the beam, the coil constant matters less.
    level = of_fields(8, StatedSource("coil", 0.01, "coil"), gravity_angle_deg=90.0)
    assert level.least_percent(1000) < 0.5 * plan.least_percent(1000)


@pytest.mark.parametrize(
    ("bench", "gravity_angle_deg"), [(Bench((), 0.02), 0.0), (Bench(stated(), 0.005), 90.0)], ids=["noise", "bench"]
)
def test_the_interval_is_as_wide_as_predicted(bench: Bench, gravity_angle_deg: float) -> None:
    rng = np.random.default_rng(3)
    before, after = Setting("hanging", BEAM), Setting("next", BEAM, gravity_angle_deg)
    spaced = before.loads().take(equally_spaced(31, 5))
    plan = planned(after, fitted(measured(before, spaced, bench, rng)), bench, 5)
    choice = exchange(plan, 5)
    resulting = half_percent(fitted(measured(after, plan.loads.take(choice), bench, rng)))
    assert plan.half_width_percent(choice) == pytest.approx(resulting, rel=0.2)
    assert plan.least_percent(5) <= plan.half_width_percent(choice)


def test_the_chosen_states_distinguish_two_laws() -> None:
    fields = Loads.along(np.linspace(0.0, 7.05, 10))
    yeoh = KnownLaw(LAWS["yeoh"], np.array([23e3, 60e3, 0.0]))
    apart = rivals(yeoh, NEO_HOOKEAN, BEAM, fields, (), NOISE)
    choice = exchange(apart, 3)
    assert apart.apart(choice) > apart.apart(equally_spaced(10, 3)) > 1.0
    same = rivals(NEO_HOOKEAN, replace(NEO_HOOKEAN, parameters=np.array([45e3])), BEAM, fields, (), NOISE)
    assert same.apart(exchange(same, 3)) < 1e-2 * apart.apart(choice)


def test_a_goal_that_the_law_does_not_have_is_refused() -> None:
    with pytest.raises(KeyError):
        candidates(NEO_HOOKEAN, BEAM, Loads.along([1.0, 2.0]), (), NOISE, "C10")
    with pytest.raises(ValueError, match="choose 3 states: only 2 states"):
        exchange(of_fields(2), 3)


def test_the_remaining_error_of_the_solid_is_added_to_every_plan() -> None:
    loads = Loads.along(np.linspace(0.0, 7.05, 6))
    without, with_error = (
        candidates(NEO_HOOKEAN, replace(BEAM, section="solid"), loads, (), replace(NOISE, left_percent=left))
        for left in (0.0, 1.5)
    )
    for choice in (np.array([4, 5]), np.arange(6)):
        expected = np.hypot(without.half_width_percent(choice), 1.5)
        assert with_error.half_width_percent(choice) == pytest.approx(expected, rel=1e-9)
    assert with_error.least_percent(3) == pytest.approx(np.hypot(without.least_percent(3), 1.5), rel=1e-9)


def test_only_a_planar_specimen_has_the_error_of_a_mesh() -> None:
    loads = Loads.along([2.0, 4.0])
    sources = (StatedSource("width", 0.02, "here"),)
    of_section = {
        section: candidates(NEO_HOOKEAN, replace(BEAM, section=section), loads, sources, NOISE).sources
        for section in ("plane-stress", "plane-strain", "solid")
    }
    assert of_section["solid"] == ("width",)
    for section in ("plane-stress", "plane-strain"):
        assert of_section[section] == ("width", FINER_MESH.name)


@pytest.mark.parametrize(("states", "count"), [(41, 5), (10, 3), (7, 2), (4, 4)])
def test_equally_spaced_states_include_both_ends(states: int, count: int) -> None:
    chosen = equally_spaced(states, count)
    assert (len(chosen), chosen[0], chosen[-1]) == (count, 0, states - 1)
    assert np.ptp(np.diff(chosen)) <= 1


def test_the_noise_of_a_plan_follows_the_points_of_the_earlier_fit() -> None:
    # Student's factor for the four states of the plan is 2.2; four times the points halve the half-width from noise.
    few, many = (
        candidates(NEO_HOOKEAN, BEAM, Loads.along([2.0, 4.0, 5.0, 6.0]), (), replace(NOISE, points=points))
        for points in (200, 800)
    )
    every = np.arange(4)
    mesh = few.effects_percent(every)[FINER_MESH.name]
    noise = [np.sqrt(plan.half_width_percent(every) ** 2 - (1.959964 * mesh) ** 2) for plan in (few, many)]
    assert noise[0] == pytest.approx(2 * noise[1], rel=1e-3)
