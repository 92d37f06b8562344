"""The solid element and the solid beam model agree with exact solutions and with an independent program."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_fitting.beam import brick
from eimi_fitting.beam.bricks import brick_mesh
from eimi_fitting.beam.element import Batch, volume_gap
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Magnet, PressureFace, Specimen
from eimi_fitting.laws import LAWS
from tests.shared import solid_cases as checks

H = 1e-5
SHALLOW = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
NEO, MODULUS = LAWS["neo-hookean"], np.array([4.6e4])

every_law = pytest.mark.parametrize("name", LAWS)


def one_brick(name: str) -> tuple[brick.Operators, Batch]:
    mesh = brick_mesh(
        np.array([0.0, 2.0]),
        np.array([-0.5, 0.5]),
        np.array([0.0, 1.5]),
        lambda x, y, z: (x + 0.1 * y * z, y + 0.05 * x, z + 0.1 * x * y),
    )
    return brick.operators(mesh), Batch(LAWS[name], np.array([checks.LAW_EXAMPLES[name]]), "solid", np.array([50.0]))


def potential(ops: brick.Operators, batch: Batch, nodal: np.ndarray, pressure: np.ndarray) -> float:
    # Return the potential energy of a solid element: the integral of psi + p (J - 1).
    # psi: energy of the law; J: volume ratio; p: pressure.
    F = brick.gradients(ops, nodal)
    F[range(3), range(3)] += 1
    J = np.linalg.det(np.moveaxis(F, (0, 1), (-2, -1)))
    stretches = np.linalg.svd(np.moveaxis(F, (0, 1), (-2, -1)), compute_uv=False) * J[..., None] ** (-1 / 3)
    density, _, _ = batch.law.principal(batch.parameters[:, None, :], stretches)
    density = density + (J - 1) * np.einsum("eqk,ebk->ebq", ops.basis, pressure)
    return float(np.sum(density * ops.weights[:, None]))


def differences(function, nodal: np.ndarray) -> np.ndarray:
    # Return central differences of `function` with respect to the 81 nodal displacements of a solid element.
    steps = (np.eye(81) * H).reshape(81, 1, 1, 3, 27)
    return np.array([(np.asarray(function(nodal + s)) - np.asarray(function(nodal - s))) / (2 * H) for s in steps])


@every_law
@pytest.mark.parametrize("size", [0.05, 1e-3, 1e-6, 0.0])  # sizes of the deformation, down to equal stretches
@settings(max_examples=2)
@given(seed=st.integers(0, 10**6))
def test_forces_tangent_and_predicted_stress_are_derivatives_of_the_energy(name, size, seed):
    ops, batch = one_brick(name)
    rng = np.random.default_rng(seed)
    nodal, pressure = rng.normal(0, size, (1, 1, 3, 27)), rng.normal(0, 0.1, (1, 1, 4))
    ev = brick.evaluate(ops, batch, nodal, pressure)
    forces = differences(lambda u: potential(ops, batch, u, pressure), nodal)
    assert ev.force.ravel() == pytest.approx(forces, abs=1e-6 * np.abs(forces).max())
    K = brick.stiffness(ops, ev, ev.S)[0, 0]
    slope = differences(lambda u: brick.evaluate(ops, batch, u, pressure).force.ravel(), nodal).T
    assert pytest.approx(slope, abs=1e-6 * np.abs(K).max()) == K
    assert pytest.approx(K.T, abs=1e-12 * np.abs(K).max()) == K
    gap = differences(
        lambda u: volume_gap(ops, batch, brick.evaluate(ops, batch, u, pressure), pressure).ravel(), nodal
    )
    coupling = brick.volume_coupling(ops, ev)[0, 0]
    assert coupling == pytest.approx(gap, abs=1e-6 * np.abs(coupling).max())
    step, change = rng.normal(0, 1, nodal.shape), rng.normal(0, 1, pressure.shape)
    rate = (brick.predict_stress(ops, ev, H * step, H * change) - ev.S) / H
    up, down = (brick.evaluate(ops, batch, nodal + s * H * step, pressure + s * H * change).S for s in (1, -1))
    assert rate == pytest.approx((up - down) / (2 * H), abs=2e-6 * np.abs(rate).max())


@every_law
def test_the_element_with_its_depth_held_is_in_plane_strain(name):
    assert checks.against_plane_strain(name) < 1e-6


@every_law
@pytest.mark.parametrize("stretches", [(1.5, 1.5**-0.5), (1.3, 1.3)])  # uniaxial and equibiaxial tension
def test_a_patch_of_distorted_bricks_stretches_uniformly(name, stretches):
    assert checks.even_stretch(name, *stretches) < 2e-6


def test_a_thick_cylinder_converges_with_the_expected_orders():
    coarse, fine = (np.array(checks.cylinder(n, 1.5)) for n in (2, 4))
    assert fine[0] < 1e-5
    orders = np.log2(coarse / fine)
    assert orders[1] == pytest.approx(3.0, abs=0.2)
    assert orders[2] == pytest.approx(2.0, abs=0.35)


@pytest.mark.parametrize(("name", "of_torque"), [("neo-hookean", 0.005), ("mooney-rivlin", 0.005)])
def test_pure_torsion_of_a_block_agrees_with_the_exact_solution(name, of_torque):
    inner, torque = checks.torsion(name, 2, 0.5)
    assert inner < 1e-4
    assert torque == pytest.approx(1.0, abs=of_torque)


def test_the_deflection_of_a_cantilever_agrees_with_felupe():
    pytest.importorskip("felupe", reason="FElupe is not installed (pip install -e '.[bench]')")
    ours = checks.drop(checks.CANTILEVER, 88e3, 13, 2)
    coarse, fine = (checks.felupe_drop(checks.CANTILEVER, 88e3, cells) for cells in ((10, 3, 2), (20, 6, 3)))
    assert coarse < fine < 1.001 * ours
    assert fine == pytest.approx(ours, rel=0.02)


def test_the_solid_lies_between_plane_strain_and_plane_stress():
    def angle(depth: float) -> list[float]:
        specimen = Specimen(30.0, 3.0, depth, 1070.0, "plane-stress", Magnet(4.0, 3.0, depth, 1.2, 7500.0))
        loads = Loads.along(np.linspace(0, 3, 4))
        solid = SolidModel(specimen, 13, 2).solve(NEO, MODULUS, loads)
        planar = [
            BeamModel(replace(specimen, section=s), 13, 2).solve(NEO, MODULUS, loads)
            for s in ("plane-strain", "plane-stress")
        ]
        return [float(np.degrees(shapes.rigid[0, -1, 2])) for shapes in (planar[0], solid, planar[1])]

    strain, solid, stress = angle(5.0)
    assert strain < solid < stress
    strain, thin, stress = angle(0.3)
    assert thin == pytest.approx(stress, rel=0.004)


def test_positions_are_symmetric_in_depth_and_rigid_on_the_magnet():
    model = SolidModel(SHALLOW, 8, 1)
    shapes = model.solve(NEO, MODULUS, Loads.along([3.0, 6.0]))
    assert shapes.converged[0]
    points = np.array([[13.0, 1.0, 2.0], [13.0, 1.0, -2.0], [28.0, 1.5, 0.7], [28.0, 1.5, 2.4], [20.0, 0.0, 0.0]])
    places = model.positions(shapes, points)[0, -1]
    assert places[1] == pytest.approx(places[0] * [1, 1, -1])
    x, y, turn = shapes.rigid[0, -1]
    expected = np.array([26 + x + 2 * np.cos(turn) - 1.5 * np.sin(turn), y + 2 * np.sin(turn) + 1.5 * np.cos(turn)])
    assert places[2] == pytest.approx([*expected, 0.7])
    assert 1e-3 < np.linalg.norm(places[3, :2] - expected) < 0.3  # the silicone in front of the magnet is soft
    assert places[4, 2] == pytest.approx(0.0)
    with pytest.raises(ValueError, match="z = 3 mm"):
        model.positions(shapes, np.array([[13.0, 0.0, 3.0]]))


@pytest.mark.parametrize("magnet", [None, Magnet(4.0, 2.0, 2.0, 1.2, 7500.0, 1.0)])
def test_the_reactions_balance_weight_force_and_field(magnet):
    # Virtual work of a translation along y: the reactions at the clamp are weight and tip force.
    specimen = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", magnet, magnetisation_A_per_m=(2e4, 1e4))
    model = SolidModel(specimen, 8, 1)
    loads = Loads.along([4.0], 60.0, -90.0, 2e-4)
    shapes = model.solve(NEO, MODULUS, loads, tolerance_mm=1e-9)
    assert shapes.converged[0]
    solid = model.solid
    batch = Batch(NEO, 1e-6 * MODULUS[None], "solid", np.array([460.0]))
    last = shapes.last
    force = solid.kind.evaluate(solid.ops, batch, solid.by_element(last.displacement), last.pressure).force[:, 0]
    total = np.zeros(model.mesh.nodes.shape)
    np.add.at(total, model.mesh.elements, force.transpose(0, 2, 1))
    clamp = model.mesh.numbers[0].ravel()
    block = magnet.length_mm * magnet.width_mm * magnet.depth_mm if magnet else 0.0
    mass = 1e-9 * (1070.0 * (30 * 3 * 5 - block) + 7500.0 * block)
    expected = mass * 9.80665 + 2e-4
    at_clamp = loads.on(model.loaded)(loads.state(0), np.ones(1)).nodal[
        0, clamp
    ]  # the nodes at the clamp carry this part of the weight directly
    assert 2 * (total[clamp] - at_clamp)[:, :2].sum(axis=0) == pytest.approx(
        [0.0, expected], abs=1e-7 * expected + 1e-10
    )


def test_unsupported_input_of_the_solid_is_refused_by_name():
    with pytest.raises(ValueError, match="pressure_face"):
        SolidModel(replace(SHALLOW, pressure_face=PressureFace("left")))
    with pytest.raises(ValueError, match="pressure_Pa"):
        SolidModel(SHALLOW, 8, 1).solve(NEO, MODULUS, Loads.along([1.0], pressure_Pa=10.0))
    with pytest.raises(ValueError, match="no flexible part is left"):
        SolidModel(replace(SHALLOW, length_mm=4.0))


@pytest.mark.parametrize(
    "principal", [(1.3, 0.9, 0.8), (0.8, 0.9, 1.3), (0.9, 0.8, 0.7), (1.3, 1.3, 0.6), (1.0, 1.0, 1.0)]
)
def test_the_largest_stretch_does_not_depend_on_its_direction(principal):
    mesh = brick_mesh(np.array([0.0, 2.0]), np.array([-0.5, 0.5]), np.array([0.0, 1.5]), lambda x, y, z: (x, y, z))
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    gradient = np.diag(principal) @ turn
    nodal = (mesh.nodes[mesh.elements] @ (gradient - np.eye(3)).T).transpose(0, 2, 1)[:, None]
    assert brick.stretch(brick.operators(mesh), nodal) == pytest.approx(max(principal))
