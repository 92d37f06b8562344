"""The rod model of the virtual rig bends and vibrates like the solid model of the same beam."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads, Magnet, Specimen
from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.path import candidates
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.laws.prony import Prony
from eimi_lab.virtual.rod import Rod, Stiffness, stiffness_of_solid
from tests.shared.creeping_rod import CreepingRod

MESH = (12, 2, 1)
MODULUS_PA = 50e3
MAGNET = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, section="solid", magnet=MAGNET)
ELASTIC = Prony(np.array([1e-9]), np.array([1.0]))


def loads(field_mT: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([0.0, 1e-3 * field_mT]), np.array([9.80665, 0.0])


@pytest.fixture(scope="module")
def stiffness() -> Stiffness:
    return stiffness_of_solid(BEAM, "neo-hookean", (MODULUS_PA,), MESH)


@pytest.mark.parametrize("field_mT", [0.0, 7.0])
def test_rotation_and_frequency_are_those_of_the_solid(stiffness: Stiffness, field_mT: float) -> None:
    solid, field, parameters = SolidBeside(BEAM, *MESH), Loads.along([field_mT]), np.array([[MODULUS_PA]])
    law = LAWS["neo-hookean"]
    bent = solid.solve(law, parameters, field, tolerance_mm=1e-4, options=SolidOptions(method="follow"))
    motion = Vibration(solid.solid).near(candidates(law, parameters, "solid", None, None), field, bent.last)
    rod = CreepingRod(Rod(BEAM, stiffness), MODULUS_PA, ELASTIC, loads, field_mT)
    rates, _, _ = rod.rates(rod.coordinates[None], field_mT)
    turned = float(np.degrees(rod.rod.end @ rod.coordinates))
    assert turned == pytest.approx(float(solid.tip_angle_deg(bent)[0, 0]), rel=5e-4, abs=1e-6)
    assert rates[0].imag / (2 * np.pi) == pytest.approx(motion.frequencies_Hz()[0, 0], rel=1e-3)


def test_the_rate_of_the_strain_is_its_derivative(stiffness: Stiffness) -> None:
    rng = np.random.default_rng(1)
    rod = Rod(BEAM, stiffness)
    z, speed = rng.standard_normal((2, rod.size))
    moved = (rod.strain(z + 1e-5 * speed) - rod.strain(z - 1e-5 * speed)) / 2e-5
    assert rod.strain_rate(z, speed) == pytest.approx(moved, rel=1e-7)


def test_points_in_the_clamp_stay_and_points_beyond_the_rod_turn_with_the_magnet(stiffness: Stiffness) -> None:
    rod = Rod(BEAM, stiffness)
    z = np.zeros(rod.size)
    z[0] = 0.5
    straight, bent = (rod.places_mm(one, np.array([0.0, 0.005, 1.0, 1.1]), np.zeros(4)) for one in (0 * z, z))
    assert straight == pytest.approx(np.column_stack([26.0 * np.array([0.0, 0.005, 1.0, 1.1]), np.zeros(4)]))
    assert bent[:2] == pytest.approx(straight[:2], abs=1e-9)
    direction = (bent[3] - bent[2]) / 2.6
    assert direction == pytest.approx([np.cos(0.5), np.sin(0.5)])
