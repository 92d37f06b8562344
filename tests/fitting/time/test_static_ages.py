"""A fit to several runs uses the age of each load step: the time from the change of the load to its measurement."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads, Magnet, Specimen
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.loaded_creep import CreepHistories
from eimi_fitting.time.ringing_beam import RingingBeam
from eimi_fitting.time.slow_evidence import LoadHistory, StaticEvidence

AT_REST_PA = 46e3
SERIES = Prony(np.array([[0.12, 0.1]]), np.array([[0.05, 2.0]]))
INSTANTANEOUS_PA = AT_REST_PA / SERIES.long_term
FIELDS_mT = [0.0, 4.0, 7.0]


@pytest.fixture(scope="module")
def beam() -> RingingBeam:
    magnet = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)
    specimen = Specimen(30.0, 3.0, 5.0, 1070.0, section="plane-stress", magnet=magnet)
    return RingingBeam(specimen, Loads.along([0.0]), LAWS["neo-hookean"], np.ones(1))


def static(beam: RingingBeam, *dwells_s: float) -> StaticEvidence:
    # Return the load steps of several runs.
    # dwells_s : for each run, the time for which each load is held
    loads = Loads.along(FIELDS_mT)
    runs = []
    for number, dwell_s in enumerate(dwells_s):
        begins_s = 1e4 * number + dwell_s * np.arange(len(FIELDS_mT))
        runs.append((LoadHistory.of(beam, AT_REST_PA, loads, list(begins_s)), begins_s + dwell_s))
    every = Loads.along(FIELDS_mT * len(dwells_s))
    return StaticEvidence(beam, tuple(runs), every, AT_REST_PA, 1e-3)


def apparent_Pa(evidence: StaticEvidence) -> float:
    return float(np.exp(evidence.apparent_log(INSTANTANEOUS_PA, SERIES, np.zeros(1))[0]))


def test_a_short_and_a_long_run_count_with_their_own_ages(beam: RingingBeam) -> None:
    early_Pa, late_Pa = apparent_Pa(static(beam, 1.0)), apparent_Pa(static(beam, 100.0))
    assert late_Pa == pytest.approx(AT_REST_PA, rel=2e-3)
    assert early_Pa > 1.03 * late_Pa
    for dwells_s in permutations((1.0, 100.0)):
        both = static(beam, *dwells_s)
        assert apparent_Pa(both) == pytest.approx(np.sqrt(early_Pa * late_Pa), rel=3e-3)
        assert both.age_s == pytest.approx(50.5)


def test_the_uncertain_width_has_the_same_effect_on_one_run_and_on_two_equal_runs(beam: RingingBeam) -> None:
    one, two = (static(beam, *dwells_s).effects({"width": 0.02})["width"] for dwells_s in ((5.0,), (5.0, 5.0)))
    assert two == pytest.approx(one, rel=1e-9)
    assert abs(one).max() > 1.0


@pytest.mark.parametrize("stronger", [0.97, 1.05])
def test_a_factor_on_the_magnetic_loads_leaves_gravity_unchanged(beam: RingingBeam, stronger: float) -> None:
    seen_s, begins_s = np.array([3.0, 30.0, 43.0, 70.0]), [0.0, 40.0]
    histories = [
        LoadHistory.of(beam, AT_REST_PA, Loads.along([factor * 5.0, 0.0]), begins_s).steps for factor in (1.0, stronger)
    ]
    nominal, expected = (CreepHistories([(steps, seen_s)]) for steps in histories)
    (found,) = nominal.rotations(INSTANTANEOUS_PA, SERIES, np.array([stronger]))
    (of_stronger,) = expected.rotations(INSTANTANEOUS_PA, SERIES, np.ones(1))
    assert found == pytest.approx(of_stronger, rel=5e-4)


def test_a_beam_returns_without_a_field_in_the_same_way_whatever_field_acted_first(beam: RingingBeam) -> None:
    curves = []
    for first_mT in (0.0, 7.0):
        in_field = replace(beam, loads=Loads.along([first_mT]))
        steps = LoadHistory.of(in_field, AT_REST_PA, Loads.along([7.0, 0.0]), [0.0, 30.0]).steps
        curves.append(steps[1].curve)
    assert curves[1].moment == pytest.approx(curves[0].moment, rel=1e-9)
    assert curves[0].moment[0] > 0.0 > curves[0].moment[-1]  # gravity turns the hanging beam back
