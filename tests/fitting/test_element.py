"""Forces and stiffness of the planar element are derivatives of one energy, objective, isotropic and symmetric."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_fitting.beam import element
from eimi_fitting.beam.element import Batch, Operators
from eimi_fitting.beam.mesh import Mesh, grid_mesh
from eimi_fitting.laws import LAWS, Section

EXAMPLES = {
    "neo-hookean": [1.0],
    "mooney-rivlin": [0.4, 0.1],
    "yeoh": [0.5, 0.1, -0.01],
    "ogden": [0.6, 1.7, 0.02, 8.0, -0.2, -2.5],
}
SECTIONS = get_args(Section)
H = 1e-5

every_law = pytest.mark.parametrize("name", EXAMPLES)
every_section = pytest.mark.parametrize("section", SECTIONS)
random_deformations = given(seed=st.integers(0, 10**6))


def one_element(name: str, section: str) -> tuple[Mesh, Operators, Batch]:
    mesh = grid_mesh(np.array([0.0, 2.0]), np.array([-0.5, 0.5]))
    return mesh, element.operators(mesh), Batch(LAWS[name], np.array([EXAMPLES[name]]), section, np.array([50.0]))


def deformation(seed: int) -> tuple[np.ndarray, np.ndarray]:
    # Return random nodal displacements of one element, shape (1, 1, 2, 9), and pressures, shape (1, 1, 3).
    rng = np.random.default_rng(seed)
    return rng.normal(0, 0.05, (1, 1, 2, 9)), rng.normal(0, 0.1, (1, 1, 3))


def potential(ops: Operators, batch: Batch, nodal: np.ndarray, pressure: np.ndarray) -> float:
    # Return the potential energy of a planar element: the integral of psi(F) + p (J - 1).
    # psi: energy of the law; F: deformation gradient; J: its determinant; p: pressure (absent in plane stress).
    ev = element.evaluate(ops, batch, nodal, pressure)
    density = ev.energy.value
    if batch.section == "plane-strain":
        density = density + (ev.J - 1) * np.einsum("eqk,ebk->ebq", ops.basis, pressure)
    return float(np.sum(density * ops.weights[:, None]))


def differences(function, nodal: np.ndarray) -> np.ndarray:
    # Return central differences of `function` with respect to the 18 nodal displacements of a planar element.
    steps = (np.eye(18) * H).reshape(18, 1, 1, 2, 9)
    return np.array([(np.asarray(function(nodal + s)) - np.asarray(function(nodal - s))) / (2 * H) for s in steps])


@every_law
@every_section
@settings(max_examples=8)
@random_deformations
def test_forces_are_the_derivative_of_the_energy(name, section, seed):
    _, ops, batch = one_element(name, section)
    nodal, pressure = deformation(seed)
    forces = element.evaluate(ops, batch, nodal, pressure).force.ravel()
    expected = differences(lambda u: potential(ops, batch, u, pressure), nodal)
    assert forces == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(forces).max())


@every_law
@every_section
@settings(max_examples=8)
@random_deformations
def test_tangent_is_the_derivative_of_the_forces_and_symmetric(name, section, seed):
    _, ops, batch = one_element(name, section)
    nodal, pressure = deformation(seed)
    ev = element.evaluate(ops, batch, nodal, pressure)
    K = element.stiffness(ops, ev, ev.S)[0, 0]
    expected = differences(lambda u: element.evaluate(ops, batch, u, pressure).force.ravel(), nodal).T
    assert pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(K).max()) == K
    assert pytest.approx(K.T, abs=1e-12 * np.abs(K).max()) == K


@settings(max_examples=20)
@random_deformations
def test_volume_coupling_is_the_derivative_of_the_volume_residual(seed):
    _, ops, batch = one_element("neo-hookean", "plane-strain")
    nodal, pressure = deformation(seed)

    def gap(u):
        return element.volume_gap(ops, batch, element.evaluate(ops, batch, u, pressure), pressure).ravel()

    coupling = element.volume_coupling(ops, element.evaluate(ops, batch, nodal, pressure))[0, 0]
    assert coupling == pytest.approx(differences(gap, nodal), rel=1e-6, abs=1e-6)


@every_law
@every_section
@settings(max_examples=8)
@random_deformations
def test_predicted_stress_is_the_stress_to_first_order(name, section, seed):
    _, ops, batch = one_element(name, section)
    nodal, pressure = deformation(seed)
    rng = np.random.default_rng(seed + 1)
    step, pressure_step = rng.normal(0, 1, nodal.shape), rng.normal(0, 1, pressure.shape)
    ev = element.evaluate(ops, batch, nodal, pressure)
    given_pressure = H * pressure_step if section == "plane-strain" else None
    rate = (element.predict_stress(ops, ev, H * step, given_pressure) - ev.S) / H
    up, down = (element.evaluate(ops, batch, nodal + s * H * step, pressure + s * H * pressure_step).S for s in (1, -1))
    assert rate == pytest.approx((up - down) / (2 * H), rel=1e-6, abs=1e-6 * np.abs(rate).max())


def rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def forces_at(mesh: Mesh, batch: Batch, places: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    # Return the forces (x, y) on the nine nodes of one element, shape (2, 9).
    # batch : the law
    # places : positions (x, y) of the nodes, shape (2, 9)
    nodal = (places - mesh.nodes[mesh.elements[0]].T)[None, None]
    return element.evaluate(element.operators(mesh), batch, nodal, pressure).force[0, 0]


@every_law
@every_section
@settings(max_examples=10)
@given(angle=st.floats(-np.pi, np.pi), seed=st.integers(0, 10**6))
def test_the_forces_are_objective(name, section, angle, seed):
    mesh, _, batch = one_element(name, section)
    nodal, pressure = deformation(seed)
    places, turn = mesh.nodes[mesh.elements[0]].T + nodal[0, 0], rotation(angle)
    straight, turned = (forces_at(mesh, batch, p, pressure) for p in (places, turn @ places))
    assert turned == pytest.approx(turn @ straight, abs=1e-9)


@every_law
@every_section
@settings(max_examples=10)
@given(angle=st.floats(-np.pi, np.pi), seed=st.integers(0, 10**6))
def test_the_material_is_isotropic(name, section, angle, seed):
    # The body is rotated at rest, not after the deformation: the same deformed nodes need the same forces.
    mesh, _, batch = one_element(name, section)
    nodal, pressure = deformation(seed)
    places = mesh.nodes[mesh.elements[0]].T + nodal[0, 0]
    turned = replace(mesh, nodes=mesh.nodes @ rotation(angle).T)
    assert forces_at(turned, batch, places, pressure) == pytest.approx(
        forces_at(mesh, batch, places, pressure), abs=1e-9
    )


@every_law
@every_section
@settings(max_examples=10)
@random_deformations
def test_a_mirrored_deformation_has_mirrored_forces_that_are_in_balance(name, section, seed):
    mesh, ops, batch = one_element(name, section)
    nodal, pressure = deformation(seed)
    forces = element.evaluate(ops, batch, nodal, pressure).force[0, 0]
    swap = np.arange(9).reshape(3, 3)[:, ::-1].ravel()  # the nodes of the lower and the upper row are exchanged
    mirrored = nodal[..., swap] * np.array([[1.0], [-1.0]])
    mirrored_pressure = pressure * np.array([1.0, 1.0, -1.0])  # the pressure modes: constant, along and across
    mirrored_force = element.evaluate(ops, batch, mirrored, mirrored_pressure).force[0, 0]
    assert mirrored_force == pytest.approx(forces[:, swap] * np.array([[1.0], [-1.0]]), abs=1e-10)
    places = mesh.nodes[mesh.elements[0]].T + nodal[0, 0]
    assert forces.sum(axis=1) == pytest.approx([0, 0], abs=1e-10)
    assert np.sum(places[0] * forces[1] - places[1] * forces[0]) == pytest.approx(0, abs=1e-10)
