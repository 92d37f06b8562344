"""The modulus that is estimated during a run, for a beam of known modulus."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting import LAWS, BeamModel, EdgeObservation, Experiment, Loads, Magnet, Specimen
from eimi_fitting.inference.planning.modulus_so_far import modulus_so_far

TRUE_PA = 46e3
NOISE_MM = 0.01
MAGNET = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=3.0, remanence_T=1.2, density_kg_m3=7500.0)
BEAM = Specimen(length_mm=30.0, width_mm=3.0, depth_mm=3.0, density_kg_m3=1070.0, section="plane-stress", magnet=MAGNET)


def seen(fields_mT: list[float]) -> Experiment:
    """Return noisy edges of the beam in some fields."""
    model = BeamModel(BEAM)
    loads = Loads.along(fields_mT, gravity_angle_deg=0.0)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[TRUE_PA]]), loads)
    along = np.linspace(1.0, 29.0, 40)
    sides = [model.positions(shapes, np.column_stack([along, np.full(40, y)]))[0] for y in (-1.5, 1.5)]
    rng = np.random.default_rng(1)
    noisy = [side + rng.normal(0.0, NOISE_MM, side.shape) for side in sides]
    sigma = np.full(40, NOISE_MM)
    return Experiment(
        model,
        loads,
        EdgeObservation.from_edges([(left, sigma, right, sigma) for left, right in zip(*noisy, strict=True)]),
    )


def test_the_modulus_from_few_states_is_right_and_narrows_with_more() -> None:
    experiment = seen([0.0, 1.0, 2.0, 3.0, 4.0])
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
    assert last.value_Pa == pytest.approx(cold.value_Pa, rel=1e-3)  # wherever it begins


def test_the_expected_bias_of_the_planar_section_is_removed() -> None:
    experiment = seen([0.0, 3.0])
    plain, corrected = modulus_so_far(experiment), modulus_so_far(experiment, section_bias=0.25)
    assert corrected.value_Pa == pytest.approx(plain.value_Pa / 1.25)
    assert corrected.interval_95_Pa == pytest.approx(tuple(end / 1.25 for end in plain.interval_95_Pa))
