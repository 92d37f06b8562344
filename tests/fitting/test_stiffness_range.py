"""The range of moduli that a fit searches follows from the data, for materials from gel to steel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.doubts.checks import NotExplained, deflection_mm
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import PointObservation
from eimi_fitting.inference.evidence.unknowns import NuisancePrior
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.searching.modulus_range import NothingActs
from eimi_fitting.laws import LAWS

YOUNG_PA = 104e9
ROD = Specimen(300.0, 5.0, 5.0, 7850.0, "plane-stress")
GEL = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))


def rod(forces_N: list[float], offset_mm: float = 0.0) -> Experiment:
    # Return an experiment: a dial gauge at the tip of a steel rod, reading F L^3 / (3 E I) plus `offset_mm`.
    second_moment_mm4 = ROD.depth_mm * ROD.width_mm**3 / 12
    sag_mm = np.array(forces_N) * ROD.length_mm**3 / (3 * 1e-6 * YOUNG_PA * second_moment_mm4)
    rest = np.tile([[[ROD.length_mm, 0.0]]], (len(forces_N), 1, 1))
    moved = rest + np.stack([0 * sag_mm, sag_mm + offset_mm], axis=-1)[:, None]
    loads = Loads.along([0.0] * len(forces_N), gravity_angle_deg=None, tip_force_N=forces_N, tip_force_angle_deg=90.0)
    return Experiment(
        BeamModel(ROD).refined(), loads, PointObservation(rest, moved, np.full((len(forces_N), 1), 0.005))
    )


def gel(modulus_Pa: float) -> Experiment:
    # Return an experiment with a beam of this modulus (Pa), in fields proportional to the modulus.
    loads = Loads.along(np.array([0.0, 4.0, 7.0]) * modulus_Pa / 46e3, gravity_angle_deg=None)
    model = BeamModel(GEL).refined()
    rest = np.column_stack([np.linspace(3, 24, 8), np.zeros(8)])
    places = model.positions(model.solve(LAWS["neo-hookean"], np.array([[modulus_Pa]]), loads), rest)[0]
    noise = np.random.default_rng(0).normal(0, 0.005, places.shape)
    return Experiment(model, loads, PointObservation(np.tile(rest, (3, 1, 1)), places + noise, np.full((3, 8), 0.005)))


def test_the_modulus_of_a_steel_rod_is_identified_from_a_dial_gauge():
    fit = identify("neo-hookean", [rod([1.0, 2.0, 4.0])])
    # The rod is incompressible (E = 3 mu); beam theory neglects shear, whose effect is about (h/L)^2.
    assert fit.initial_shear_modulus.value == pytest.approx(YOUNG_PA / 3, rel=5e-3)
    low, high = fit.initial_shear_modulus.interval_95
    assert low < YOUNG_PA / 3 < high < 1.2 * low


@pytest.mark.parametrize("modulus_Pa", [100.0, 3e9])
def test_moduli_of_gel_and_plastic_are_identified(modulus_Pa):
    fit = identify("neo-hookean", [gel(modulus_Pa)])
    assert fit.initial_shear_modulus.value == pytest.approx(modulus_Pa, rel=0.02)
    assert not fit.identifiability.at_bound


def test_a_fit_without_any_load_is_refused():
    still = replace(gel(46e3), loads=Loads.along([0.0, 0.0, 0.0], gravity_angle_deg=None))
    with pytest.raises(NothingActs, match="no load acts on the specimen in any state"):
        identify("neo-hookean", [still])


def test_the_largest_deflection_is_that_of_the_most_displaced_point():
    bent = gel(46e3)
    moved = np.linalg.norm(bent.observed.moved_mm - bent.observed.rest_mm, axis=-1)
    assert deflection_mm(bent) == pytest.approx(moved.max(), rel=1e-3)


def test_a_dial_gauge_with_an_offset_is_a_doubt_and_not_refused():
    fit = identify("neo-hookean", [rod([1.0, 2.0, 4.0], offset_mm=0.5)])
    (doubt,) = [doubt for doubt in fit.doubts if "clamp" in doubt.words]
    assert "place of the clamp (+0.47 mm" in doubt.words
    assert doubt.words.endswith("or free this quantity (--free clamp=0.5)")


def test_a_displaced_clamp_is_a_doubt_with_its_remedy():
    good = gel(46e3)
    shift = np.array([0.1, -0.9])
    off = replace(good, observed=replace(good.observed, moved_mm=good.observed.moved_mm + shift))
    fit = identify("neo-hookean", [off])
    (clamp_doubt,) = [doubt for doubt in fit.doubts if "clamp" in doubt.words]
    assert (clamp_doubt.dataset, clamp_doubt.state) == (0, None)
    assert "place of the clamp (-0.9 mm, probability 1.00" in clamp_doubt.words
    assert "clamp_midpoint_px" in clamp_doubt.words
    assert "or free this quantity (--free clamp=0.9)" in clamp_doubt.words
    assert fit.causes[0].name == "clamp_offset"
    freed = identify("neo-hookean", [off], free=[NuisancePrior("clamp", 0.9)])
    assert [doubt for doubt in freed.doubts if "clamp" in doubt.words] == []
    assert freed.initial_shear_modulus.value == pytest.approx(46e3, rel=0.02)
    # A displacement in a single state is not a displaced clamp.
    moved = good.observed.moved_mm.copy()
    moved[2] += 3 * shift
    with pytest.raises(NotExplained):
        identify("neo-hookean", [replace(good, observed=replace(good.observed, moved_mm=moved))])
