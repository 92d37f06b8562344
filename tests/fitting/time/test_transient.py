"""The computed motion of a viscoelastic beam agrees with the theory of small vibrations."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen
from eimi_fitting.beam.transient import Transient
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.channels import signals_of
from eimi_fitting.time.decay import decay_of
from eimi_fitting.time.loaded_creep import LoadCurve, LoadStep, creep
from eimi_fitting.time.measured import Motion

MAGNET = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, section="plane-stress", magnet=MAGNET)
NEO = LAWS["neo-hookean"]
INSTANTANEOUS_PA = 60e3
SERIES = Prony(np.array([0.12, 0.10]), np.array([0.05, 2.0]))


@pytest.mark.parametrize("field_mT", [0.0, 7.0])
def test_after_a_small_release_the_beam_vibrates_with_its_complex_frequency(field_mT: float) -> None:
    model, step_s = BeamModel(BEAM, 10, 1), 0.003
    motion = Transient(model, NEO, np.array([INSTANTANEOUS_PA]), SERIES, Loads.along([field_mT + 0.1]))
    after = Loads.along([field_mT])
    places = []
    for _ in range(420):
        motion.advance(step_s, after)
        places.append(motion.rigid[:2].copy())
    time = step_s * (1 + np.arange(len(places)))[:, None]
    recorded = Motion("ring_down", np.array(places)[:, None], np.array([[26.0, 0.0]]), time, np.full_like(time, 1e-4))
    (mode, *_) = decay_of(signals_of(recorded, 0.0), "release", BEAM.length_mm, is_stepped=True).modes
    at_rest_Pa = INSTANTANEOUS_PA * float(SERIES.long_term)
    reduced, _ = Vibration(model).about(NEO, np.array([[at_rest_Pa]]), after, stiffenings=(1.0, 2.0))
    root = reduced.roots(lambda s: INSTANTANEOUS_PA / at_rest_Pa * SERIES.complex_ratio(s))[0, 0]
    assert mode.frequency_Hz == pytest.approx(root.imag / (2 * np.pi), rel=2e-3)
    assert mode.loss == pytest.approx(
        -2 * root.real / root.imag, rel=1e-2
    )  # the frequency is 2 % too high if all shapes are modes at rest


def test_creep_of_the_tip_follows_the_internal_variables_of_the_finite_elements() -> None:
    model, field = BeamModel(BEAM, 10, 1), Loads.along([5.0])
    motion = Transient(model, NEO, np.array([INSTANTANEOUS_PA]), SERIES, Loads.along([0.0]))
    times, rotation = np.geomspace(0.02, 20.0, 25), []
    for part in range(1, 11):  # the field rises within a millisecond
        motion.advance(1e-4, Loads.along([0.5 * part]), with_inertia=False)
    for before, time in zip([1e-3, *times[:-1]], times, strict=True):
        motion.advance(time - before, field, with_inertia=False)
        rotation.append(motion.rigid[2])
    moduli = INSTANTANEOUS_PA * np.geomspace(0.6, 1.1, 7)
    static = model.solve(NEO, moduli[:, None], field)
    theta = np.radians(model.tip_angle_deg(static))[::-1, 0]
    curve = LoadCurve(theta, moduli[::-1] * theta, 0 * theta)
    of_beam = creep(
        np.array([INSTANTANEOUS_PA]),
        Prony(SERIES.g[None], SERIES.tau_s[None]),
        (LoadStep(0.0, curve),),
        times,
        np.ones(1),
    )[0]
    crept = rotation[-1] - rotation[0]
    assert crept > 0.05
    assert of_beam == pytest.approx(rotation, abs=0.03 * crept)
