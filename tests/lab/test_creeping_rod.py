"""The computed motion of a creeping rod agrees with the solution of its equations of motion in time."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting import Magnet, Specimen
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.channels import signals_of
from eimi_fitting.time.decay import Decay, decay_of
from eimi_fitting.time.measured import Motion
from eimi_lab.virtual.moving_beam import MovingBeam
from eimi_lab.virtual.rod import stiffness_of_solid
from tests.shared.creeping_rod import CreepingRod

AT_REST_PA, SERIES = 46e3, Prony(np.array([0.1, 0.08]), np.array([0.05, 8.0]))
SECONDS = 3.0


def loads(field_mT: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([0.0, 1e-3 * field_mT]), np.array([9.80665, 0.0])


def test_small_vibrations_and_creep_are_those_of_the_motion_in_time() -> None:
    magnet = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)
    specimen = Specimen(30.0, 3.0, 5.0, 1070.0, section="solid", magnet=magnet)
    moving = MovingBeam(
        specimen, stiffness_of_solid(specimen, "neo-hookean", (AT_REST_PA,), (8, 1, 1)), AT_REST_PA, SERIES, loads
    )
    moving.start(0.0, 0.0)
    times_s = np.arange(0.0125, SECONDS, 0.0125)
    expected = moving.advance(SECONDS, lambda _: 0.5, times_s)
    rod = CreepingRod(moving.rod, AT_REST_PA, SERIES, loads)
    found, rate = rod.record(0.5, SECONDS, times_s)
    along = np.linspace(0.3, 1.0, 5)
    of_motion, of_rod = (analysed(moving.rod.places_mm(z, along, 0 * along), times_s) for z in (expected, found))
    assert of_rod.modes[0].frequency_Hz == pytest.approx(of_motion.modes[0].frequency_Hz, rel=1e-3)
    assert of_rod.modes[0].loss == pytest.approx(of_motion.modes[0].loss, rel=0.01)
    assert rate.imag / (2 * np.pi) == pytest.approx(of_motion.modes[0].frequency_Hz, rel=2e-3)
    late_s = np.array([12.0, 25.0])
    of_motion_rad = moving.advance(SECONDS, lambda _: 0.5, late_s) @ moving.rod.end
    slow = CreepingRod(moving.rod, AT_REST_PA, SERIES, loads)
    of_rod_rad = slow.record(0.5, 25.0, late_s)[0] @ moving.rod.end
    assert of_motion_rad[1] > 1.01 * of_motion_rad[0]
    assert of_rod_rad == pytest.approx(of_motion_rad, rel=2e-3)


def analysed(places_mm: np.ndarray, times_s: np.ndarray) -> Decay:
    # Return the decay of the vibrations in noisy positions of points, shape (frames, points, 2) in mm.
    noisy = places_mm + 1e-3 * np.random.default_rng(1).standard_normal(places_mm.shape)
    time_s = np.repeat(times_s[:, None], places_mm.shape[1], axis=1)
    motion = Motion("creep", noisy, 0 * noisy[0], time_s, np.full(time_s.shape, 1e-3))
    return decay_of(signals_of(motion), "rod", 30.0, is_stepped=True)
