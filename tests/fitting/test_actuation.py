"""A user adds a new kind of load by one class, without a change of the package."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest

from eimi_fitting import Beam, BeamModel, Experiment, Loads, Magnet, PointObservation, Specimen, identify

MAGNET = Magnet(4.0, 3.0, 5.0, 0.48, 7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", MAGNET)
SECTIONS = ["plane-strain", "plane-stress", "solid"]
MU_PA = 46e3


@dataclass(frozen=True)
class TipMoment:
    # A moment (N mm) on the magnet about the depth axis, one value for each load step.

    moment_N_mm: np.ndarray

    @property
    def numbers(self):
        return self.moment_N_mm[:, None]

    def take(self, states):
        return TipMoment(self.moment_N_mm[states])

    def apply(self, numbers, field_factor, mesh, total):
        total.moment[:] += numbers[0] * mesh.share


@dataclass(frozen=True)
class GradientForce:
    # The force of a field gradient on a magnetic dipole.
    # numbers : derivatives of the field along x and y in T/mm, shape (K, 2) for K load steps

    numbers: np.ndarray

    def take(self, states):
        return GradientForce(self.numbers[states])

    def apply(self, numbers, field_factor, mesh, total):
        force = field_factor[:, None] * mesh.magnet_dipole[0] * numbers
        total.force[:] += force
        total.tensor[:] += force[:, :, None] * mesh.magnet_centre_mm


def solved(section, loads):
    along, across = (8, 1) if section == "solid" else (13, 1)
    bent = Beam(replace(BEAM, section=section), along, across).solve("neo-hookean", [MU_PA], loads)
    assert bent.converged
    return bent


@pytest.mark.parametrize("section", SECTIONS)
def test_a_tip_moment_bends_like_a_field_with_the_same_torque(section):
    field_mT = np.array([0.0, 2.0, 4.0])
    in_field = solved(section, Loads.along(field_mT))
    # m B sin(90 degrees - theta), the torque of the field after the magnet has turned by theta.
    moment = 1e3 * MAGNET.moment_A_m2 * 1e-3 * field_mT * np.cos(np.radians(in_field.tip_angle_deg))
    by_moment = solved(section, Loads.along(0 * field_mT).plus(TipMoment(moment)))
    assert in_field.tip_angle_deg[-1] > 25
    assert by_moment.tip_angle_deg == pytest.approx(in_field.tip_angle_deg, abs=1e-3)
    tip = [[30.0, 0.0]]
    assert by_moment.positions(tip) == pytest.approx(in_field.positions(tip), abs=1e-4)


@pytest.mark.parametrize("section", SECTIONS)
def test_the_force_of_a_gradient_is_a_force_at_the_magnets_centre(section):
    gradient = np.array([[0.0, 0.0], [0.0, 2e-5], [1e-5, 4e-5]])
    dipole = 1e3 * MAGNET.moment_A_m2
    factor = 1.1
    specimen = replace(BEAM, section=section, tip_load_mm=(28.0, 0.0))
    beam = Beam(specimen, 8, 1)
    loads = Loads.along(np.zeros(3))
    by_gradient = beam.solve("neo-hookean", [MU_PA], loads.plus(GradientForce(gradient)), field_factor=factor)
    by_force = beam.solve("neo-hookean", [MU_PA], replace(loads, tip_force_N=factor * dipole * gradient))
    assert by_force.tip_angle_deg[-1] > 1
    assert by_gradient.tip_angle_deg == pytest.approx(by_force.tip_angle_deg, rel=1e-9)


@pytest.mark.parametrize("section", ["plane-strain", "solid"])
def test_a_new_load_identifies_a_material(section):
    moment = np.array([0.0, 0.02, 0.05, 0.08])
    loads = Loads.along(0 * moment, gravity_angle_deg=None).plus(TipMoment(moment))
    specimen = replace(BEAM, section=section)
    bent = Beam(specimen, 20, 2).solve("neo-hookean", [MU_PA], loads)
    rest = np.array([[x, y] for x in (10.0, 20.0, 30.0) for y in (-1.0, 1.0)])
    observed = PointObservation(np.tile(rest, (4, 1, 1)), bent.positions(rest), np.full((4, 6), 0.01))
    model = BeamModel(specimen, plane=specimen.planar_section)
    fit = identify("neo-hookean", [Experiment(model, loads, observed)])
    assert bent.tip_angle_deg[-1] > 20
    assert fit.initial_shear_modulus.value == pytest.approx(MU_PA, rel=0.005)


def test_loads_with_a_new_kind_of_load_can_be_pickled():
    assert len(Loads.along(0.0, gravity_angle_deg=90.0, pressure_Pa=[0.0, 1.0, 2.0])) == 3
    loads = Loads.along([0.0, 1.0], pressure_Pa=5.0).plus(TipMoment(np.array([0.0, 0.1])))
    back = pickle.loads(pickle.dumps(loads))
    assert back.state(1) == pytest.approx([0.0, 1e-3, 9.80665, 0.0, 0.0, 0.0, 5.0, 0.1])
    assert back.take(np.array([1])).state(0) == pytest.approx(loads.state(1))


def test_a_load_with_another_number_of_states_is_refused():
    with pytest.raises(ValueError, match="TipMoment has 3 states, but the other loads have 2"):
        Loads.along([0.0, 1.0]).plus(TipMoment(np.zeros(3)))
