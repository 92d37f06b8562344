"""The modulus that is estimated during a run is right, and its interval becomes narrower."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting import LAWS, BeamModel, EdgeObservation, Experiment, Loads, Magnet, Specimen, identify
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.planning.modulus_so_far import modulus_so_far

TRUE_PA = 46e3
NOISE_MM = 0.01
MAGNET = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=3.0, remanence_T=1.2, density_kg_m3=7500.0)
BEAM = Specimen(length_mm=30.0, width_mm=3.0, depth_mm=3.0, density_kg_m3=1070.0, section="plane-stress", magnet=MAGNET)


def experiment_in(fields_mT: list[float], specimen: Specimen = BEAM, noise_mm: float = NOISE_MM) -> Experiment:
    # Return a simulated experiment: noisy edges of a beam in these fields (mT).
    is_solid = specimen.section == "solid"
    model = SolidBeside(specimen, 24, 2) if is_solid else BeamModel(specimen)
    loads = Loads.along(fields_mT, gravity_angle_deg=0.0)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[TRUE_PA]]), loads)
    edges = points_on(outline(model, shapes)[0], 2)[:, :, 4:-2]
    noisy = edges + np.random.default_rng(2).normal(0.0, noise_mm, edges.shape)
    observed = EdgeObservation(noisy, np.full(noisy.shape[:3], noise_mm))
    return Experiment(BeamModel(specimen, plane=specimen.planar_section), loads, observed)


def test_the_modulus_from_few_states_is_right_and_its_interval_narrows_with_more_states() -> None:
    experiment = experiment_in([0.0, 1.0, 2.0, 3.0, 4.0])
    first = modulus_so_far(experiment.of_states(np.arange(2)))
    last = modulus_so_far(experiment, before=first)
    cold = modulus_so_far(experiment)
    for estimate in (first, last):
        low, high = estimate.interval_95_Pa
        assert low < TRUE_PA < high
        assert low < estimate.value_Pa < high
    assert (first.states, last.states) == (2, 5)
    assert np.ptp(last.interval_95_Pa) < np.ptp(first.interval_95_Pa) < 0.1 * TRUE_PA
    assert last.value_Pa == pytest.approx(TRUE_PA, rel=0.01)
    assert last.value_Pa == pytest.approx(cold.value_Pa, rel=1e-3)  # at any start


def test_the_modulus_of_a_solid_is_that_of_the_whole_fit_and_its_interval_does_not_grow() -> None:
    experiment = experiment_in([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], replace(BEAM, section="solid"), noise_mm=0.002)
    estimates = [modulus_so_far(experiment.of_states(np.arange(2)))]
    for count in range(3, 7):
        estimates.append(modulus_so_far(experiment.of_states(np.arange(count)), estimates[-1]))
    low, high = identify("neo-hookean", [experiment]).initial_shear_modulus.interval_95
    assert low < estimates[-1].value_Pa < high
    assert estimates[-1].error_mm == pytest.approx(
        0.002, rel=0.1
    )  # the noise; the residuals of the planar model are larger
    widths = [float(np.ptp(estimate.interval_95_Pa)) for estimate in estimates]
    assert all(later < 1.06 * min(widths[:k]) for k, later in enumerate(widths) if k)
    assert widths[-1] < 0.01 * TRUE_PA


def test_the_depth_effect_is_computed_again_only_in_a_state_with_larger_bending(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    experiment = experiment_in([0.0, 2.0, 4.0, 3.0, 1.0], replace(BEAM, section="solid"), noise_mm=0.002)
    first = modulus_so_far(experiment.of_states(np.arange(3)))
    monkeypatch.setattr(SolidBeside, "_difference", lambda *_: pytest.fail("the solid was solved"))
    assert modulus_so_far(experiment, first).value_Pa == pytest.approx(TRUE_PA, rel=0.005)


def test_an_estimate_with_a_narrower_interval_is_kept_while_the_residuals_are_noise() -> None:
    experiment = experiment_in([0.0, 1.0, 2.0])
    tilt = StatedSource(
        "magnetisation-angle", 3.0, "specimen"
    )  # the effect of the tilt is larger in the third state than in the second
    uncertain = replace(experiment, stated=(tilt,))
    first = modulus_so_far(uncertain.of_states(np.arange(2)))
    alone, after = modulus_so_far(uncertain), modulus_so_far(uncertain, first)
    assert np.ptp(alone.interval_95_Pa) > 1.2 * np.ptp(first.interval_95_Pa)
    assert (after.value_Pa, after.interval_95_Pa, after.states) == (first.value_Pa, first.interval_95_Pa, 2)
    assert after.error_mm == pytest.approx(alone.error_mm, rel=0.02)  # the error of all states
    quiet = replace(first, error_mm=0.5 * first.error_mm)  # more noise in one state says nothing about the interval
    assert modulus_so_far(uncertain, quiet).states == 2
    wrong = replace(uncertain, loads=replace(uncertain.loads, field_T=uncertain.loads.field_T * [[1], [1], [1.1]]))
    assert modulus_so_far(wrong, first).states == 3


def test_the_remaining_error_of_the_solid_is_in_the_interval_however_exact_the_edges_are() -> None:
    experiment = experiment_in([1.0, 3.0, 5.0], replace(BEAM, section="solid"), noise_mm=1e-5)
    half_width = 0.5 * float(np.ptp(modulus_so_far(experiment).interval_95_Pa))
    assert 0.0014 * TRUE_PA < half_width < 0.006 * TRUE_PA
