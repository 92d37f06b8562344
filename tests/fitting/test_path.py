"""Coarse load steps lead to the same equilibrium as fine load steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Magnet, Section, Specimen
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space

HIGHEST_MT, FINE_STEPS = 15.0, 72


def type3(section: Section) -> Specimen:
    return Specimen(30.0, 4.0, 5.0, 1070.0, section, Magnet(4.0, 4.0, 4.0, 1.2, 7500.0))


def candidates(name: str, count: int, seed: int) -> np.ndarray:
    # Return random parameters of the law `name` with moduli of common silicones, shape (count, n).
    space, rng = search_space(LAWS[name]), np.random.default_rng(seed)
    unit = rng.random((count, len(space.names)))
    unit[:, 0] = np.log(rng.uniform(1e4**0.1, 2e5**0.1, count) ** 10 / space.lower[0]) / np.log(1e3)
    return space.parameters(unit)


def leaps(model: BeamModel, name: str, parameters: np.ndarray) -> tuple[int, int, int]:
    # Solve a beam in 2 to 12 load steps; return the numbers of wrong, failed and all solutions.
    # A solution is wrong if it is not the equilibrium that 72 load steps reach.
    law = LAWS[name]
    fine = model.solve(law, parameters, Loads.along(np.linspace(0, HIGHEST_MT, FINE_STEPS + 1)))
    stable = fine.converged
    elsewhere = failed = 0
    for steps in (12, 6, 4, 3, 2):
        every = FINE_STEPS // steps
        shapes = model.solve(law, parameters[stable], Loads.along(np.linspace(0, HIGHEST_MT, steps + 1)))
        arrived = (shapes.status == Status.CONVERGED) | (shapes.status == Status.UNSTABLE)
        turn = np.abs(shapes.rigid[:, :, 2] - fine.rigid[stable, ::every, 2])
        stretch = np.abs(shapes.max_stretch - fine.max_stretch[stable, ::every])
        elsewhere += int((arrived & ((turn > 1e-4) | (stretch > 1e-3))).any(axis=1).sum())
        failed += int((~arrived).any(axis=1).sum())
    return elsewhere, failed, 5 * int(stable.sum())


@pytest.mark.parametrize("name", ["yeoh", pytest.param("ogden", marks=pytest.mark.slow)])
def test_coarse_steps_reach_the_same_equilibrium_as_fine_steps(name):
    elsewhere, failed, total = leaps(BeamModel(type3("plane-strain")), name, candidates(name, 30, 0))
    assert total > 100
    assert elsewhere == 0
    assert failed == 0


@pytest.mark.parametrize("section", ["plane-strain", "plane-stress"])
def test_states_solved_at_once_from_a_nearby_beam_equal_those_solved_in_order(section):
    law, loads = LAWS["yeoh"], Loads.along(np.linspace(0, HIGHEST_MT, 80))  # more states than one block holds
    parameters = np.array([[1.0], [0.99], [1.02]]) * candidates("yeoh", 1, 3)
    stated, wider = BeamModel(type3(section)), BeamModel(replace(type3(section), width_mm=4.04))
    near = stated.solve(law, parameters, loads, keep=True).every
    assert near is not None
    alone = wider.solve(law, parameters, loads, tolerance_mm=1e-6)
    once = wider.solve(law, parameters, loads, tolerance_mm=1e-6, near=near, keep=True)
    assert (once.status == alone.status).all()
    np.testing.assert_allclose(once.displacement, alone.displacement, atol=1e-6)
    np.testing.assert_allclose(once.max_stretch, alone.max_stretch, atol=1e-6)
    np.testing.assert_allclose(once.last.displacement, alone.displacement[:, -1], atol=1e-6)
    assert once.every is not None
    np.testing.assert_allclose(once.every.displacement, alone.displacement[0], atol=1e-6)
    assert once.iterations.max() <= 4
    # If the given beam is far away, the states are solved one after another.
    turned = Loads(-loads.field_T, loads.gravity, loads.tip_force_N)
    back = wider.solve(law, parameters, turned, tolerance_mm=1e-6, near=near)
    np.testing.assert_allclose(back.rigid[..., 2], -alone.rigid[..., 2], atol=1e-6)


def test_shapes_on_a_mesh_with_other_nodes_are_not_used_as_a_start():
    # A magnet that is narrower than the beam needs more elements, and therefore other nodes.
    law, loads, modulus = LAWS["neo-hookean"], Loads.along([0.0, 4.0]), np.array([[46e3]])
    wide = type3("plane-stress")
    assert wide.magnet is not None
    narrow = replace(wide, magnet=replace(wide.magnet, width_mm=3.8))
    near = BeamModel(wide).solve(law, modulus, loads, keep=True).every
    model = BeamModel(narrow)
    assert model.mesh.nodes.shape != BeamModel(wide).mesh.nodes.shape
    shapes = model.solve(law, modulus, loads, near=near)
    assert shapes.converged.all()
    np.testing.assert_allclose(shapes.displacement, model.solve(law, modulus, loads).displacement, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("section", ["plane-strain", "plane-stress"])
@pytest.mark.parametrize(("mesh", "count"), [((13, 1), 100), ((26, 3), 25)])
@pytest.mark.parametrize("name", LAWS)
def test_coarse_steps_reach_the_same_equilibrium_for_a_thousand_materials(name, section, mesh, count):
    elsewhere, failed, total = leaps(BeamModel(type3(section), *mesh), name, candidates(name, count, 1))
    assert elsewhere == 0
    assert failed <= 0.01 * total


def solid_leaps(name: str, parameters: np.ndarray, magnet: Magnet) -> tuple[int, int, int]:
    # Solve a solid beam in 3 and in 6 load steps; return the numbers of wrong, failed and all solutions.
    # A solution is wrong if it is not the equilibrium that 24 load steps reach.
    law, specimen = LAWS[name], replace(type3("solid"), magnet=magnet)
    alone, beside = SolidModel(specimen, 8, 1), SolidBeside(specimen, 8, 1)
    elsewhere = failed = total = 0
    for candidate in parameters:
        fine = alone.solve(law, candidate, Loads.along(np.linspace(0, HIGHEST_MT, 25)), tolerance_mm=1e-3)
        if not fine.converged[0]:
            continue
        for steps in (6, 3):
            shapes = beside.solve(law, candidate, Loads.along(np.linspace(0, HIGHEST_MT, steps + 1)))
            arrived = np.isin(shapes.status[0], (Status.CONVERGED, Status.UNSTABLE)).all()
            every = 24 // steps
            turn = np.abs(shapes.rigid[0, :, 2] - fine.rigid[0, ::every, 2])
            stretch = np.abs(shapes.max_stretch[0] - fine.max_stretch[0, ::every])
            elsewhere += bool(arrived and ((turn > 3e-4) | (stretch > 5e-3)).any())
            failed += not arrived
            total += 1
    return elsewhere, failed, total


def test_coarse_steps_of_a_solid_reach_the_same_equilibrium():
    elsewhere, failed, total = solid_leaps("yeoh", candidates("yeoh", 2, 3), Magnet(4.0, 4.0, 2.0, 1.2, 7500.0))
    assert (elsewhere, failed) == (0, 0)
    assert total >= 2


@pytest.mark.slow
@pytest.mark.parametrize("magnet", [Magnet(4.0, 4.0, 2.0, 1.2, 7500.0), Magnet(4.0, 4.0, 5.0, 0.5, 7500.0)])
@pytest.mark.parametrize("name", LAWS)
def test_coarse_steps_reach_the_same_equilibrium_for_a_hundred_solids(name, magnet):
    elsewhere, failed, total = solid_leaps(name, candidates(name, 15, 1), magnet)
    assert elsewhere == 0
    assert failed <= 0.01 * total


@pytest.mark.parametrize("magnet", [Magnet(4.0, 2.8, 2.0, 1.2, 7500.0), Magnet(4.0, 3.0, 2.0, 1.2, 7500.0, 0.05)])
def test_a_thin_layer_of_silicone_about_the_magnet_is_followed_in_big_steps(magnet):
    # Newton's method first fails for large steps, and the extrapolated start of smaller steps is bad.
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", magnet))
    four, forty = (
        model.solve(LAWS["neo-hookean"], np.array([[46390.0]]), Loads.along(np.linspace(0, 7.05, n + 1)))
        for n in (4, 40)
    )
    assert four.converged[0]
    assert four.rigid[0] == pytest.approx(forty.rigid[0, ::10], abs=1e-5)


def test_a_rotation_that_begins_late_is_followed_on_a_fine_mesh():
    # The beam hardly rotates at first, and then suddenly by much.
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)), 52, 6)
    one, forty = (
        model.solve(LAWS["neo-hookean"], [[20e3]], Loads.along(np.linspace(0, 15, n + 1)[1:]), tolerance_mm=1e-4)
        for n in (1, 40)
    )
    assert one.converged[0]
    assert forty.converged[0]
    assert one.rigid[0, -1] == pytest.approx(forty.rigid[0, -1], abs=1e-3)


@pytest.mark.parametrize("mesh", [(13, 1), (26, 3), (52, 6)])
def test_a_law_that_softens_beyond_the_reached_stretches_stays_on_its_path(mesh):
    model, parameters = BeamModel(type3("plane-strain"), *mesh), np.array([[23044.0, 534.0, -91.0]])
    six = model.solve(LAWS["yeoh"], parameters, Loads.along(1.41 * np.arange(6)))
    sixteen = model.solve(LAWS["yeoh"], parameters, Loads.along(0.47 * np.arange(16)))
    assert six.converged[0]
    assert six.rigid[0] == pytest.approx(sixteen.rigid[0, ::3], abs=1e-5)
    assert six.max_stretch[0] == pytest.approx(sixteen.max_stretch[0, ::3], abs=1e-4)
