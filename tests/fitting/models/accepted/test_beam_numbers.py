"""Finite elements, linear systems, loads and motions of small beam models give the stored numbers."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen
from eimi_fitting.beam import brick, element, isotropy
from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.bricks import brick_mesh
from eimi_fitting.beam.coil_field import CoilShape, DipoleInField, FieldTable, SiliconeInField, loop_field
from eimi_fitting.beam.element import Batch
from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.grid import Grid
from eimi_fitting.beam.inertia import Inertia
from eimi_fitting.beam.mesh import graded, grid_mesh
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.path import candidates
from eimi_fitting.beam.pressure import FollowerPressure
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.rest_shape import RestShape
from eimi_fitting.beam.rigid import RigidBody, dead_moment
from eimi_fitting.beam.solid_grid import SolidGrid
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import PressureFace
from eimi_fitting.beam.strip import Strip
from eimi_fitting.beam.system import FactoredSystem, System
from eimi_fitting.beam.transient import Transient
from eimi_fitting.beam.twist import torsion_constant_mm4, twist_per_tilt, weight_beyond_kg
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.beam.view import View
from eimi_fitting.laws.prony import Prony
from tests.shared.accepted_numbers import check
from tests.shared.scaled_numbers import of

ACCEPTED = Path(__file__).parent / "beam"
MAGNET = Magnet(4.0, 2.0, 2.5, 1.2, 7500.0, tip_offset_mm=1.0, magnetisation_angle_deg=12.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", MAGNET)
FULL = replace(BEAM, magnet=replace(MAGNET, width_mm=3.0, tip_offset_mm=0.0))
BENT = RestShape(turns=((0.0, 0.0), (0.4, 0.05), (0.7, 0.15), (1.0, 0.1)), widths=((0.0, 0.2), (0.5, -0.1), (1.0, 0.1)))
DEEP = replace(BENT, depths=((0.0, 0.3), (0.6, -0.2), (1.0, 0.0)))
MAGNETISED = Specimen(24.0, 2.0, 4.0, 1500.0, "plane-strain", magnetisation_A_per_m=(20e3, 5e3))
OGDEN = LAWS["ogden"]
OF_OGDEN = np.array([30e3, 1.7, 900.0, 5.0, -9e3, -2.0])
YEOH = LAWS["yeoh"]
OF_YEOH = np.array([22e3, 2e3, 100.0])
LAWS_OF_ALL_KINDS = {
    "neo-hookean": [0.046],
    "mooney-rivlin": [0.02, 0.004],
    "yeoh": [0.022, 0.005, 0.0006],
    "ogden": [0.03, 1.7, 0.001, 8.0, -0.01, -2.5],
}
SERIES = Prony(np.array([0.15, 0.08]), np.array([0.04, 0.7]))


def compare(lines: Iterable[str], name: str, folder: Path) -> None:
    check(lines, ACCEPTED / name, folder, relative=1.1e-5, absolute=1e-9)


def load(field: tuple[float, float], force: tuple[float, float], pressure: float = 0.0) -> Loads:
    return Loads(np.array([field]), np.array([[9.0, 2.0]]), np.array([force]), pressure)


@pytest.mark.parametrize("beam", ["narrow magnet", "full magnet", "bent"])
def test_a_motion_in_time_has_the_accepted_numbers(beam: str, tmp_path: Path) -> None:
    specimen = {"narrow magnet": BEAM, "full magnet": FULL, "bent": replace(FULL, magnet=None, rest_shape=BENT)}[beam]
    model = BeamModel(specimen, 3, 1)
    motion = Transient(model, OGDEN, OF_OGDEN, SERIES, load((1e-3, 6e-3), (1e-4, 3e-4)))
    passes, newton = [0], motion._newton

    def counted(*arguments: Any) -> Any:
        passes[0] += 1
        return newton(*arguments)

    motion._newton = counted  # type: ignore[method-assign]
    lines = [*of(motion._state, "start"), *of(motion._arms, "arms")]
    later = load((2e-3, 9e-3), (0.0, 5e-4))
    for number, (step_s, with_inertia) in enumerate([(0.004, True), (0.02, True), (0.3, False)]):
        motion.advance(step_s, later, with_inertia)
        lines += [*of(motion._state, f"step {number}"), f"time: {motion.time_s:.6g}", f"passes: {passes[0]}"]
    shapes = motion.shapes()
    lines += of(
        [shapes.displacement, shapes.rigid, shapes.status, shapes.iterations, shapes.max_stretch, shapes.last], "now"
    )
    compare(lines, f"motion of a beam, {beam}.txt", tmp_path)


@pytest.mark.parametrize("specimen", [BEAM, FULL])
def test_a_beam_in_equilibrium_stays_at_rest(specimen: Specimen) -> None:
    loads = load((1e-3, 6e-3), (1e-4, 3e-4))
    motion = Transient(BeamModel(specimen, 3, 1), OGDEN, OF_OGDEN, SERIES, loads)
    before = motion._state
    motion.advance(0.01, loads)
    assert motion._state.nodes == pytest.approx(before.nodes, abs=1e-6)
    assert motion.rigid == pytest.approx(before.rigid, abs=1e-6)
    assert motion._state.points == pytest.approx(before.points, abs=1e-6)
    assert np.abs(motion._state.node_acceleration).max() < 1e-2 * 9810
    assert np.abs(motion._state.point_acceleration).max() < 1e-2 * 9810


def planar_elements() -> Any:
    # Return a mesh of two distorted planar elements of varying thickness.
    mesh = grid_mesh(np.array([0.0, 1.0, 2.5]), np.array([-0.5, 0.7]))
    x, y = mesh.nodes.T
    moved = np.column_stack([x + 0.05 * y * y, y + 0.1 * np.sin(x)])
    return replace(mesh, nodes=moved, thickness=1 + 0.1 * x + 0.05 * y)


def batch_of(law: str, section: str) -> Batch:
    parameters = np.array(LAWS_OF_ALL_KINDS[law])
    return Batch(LAWS[law], np.stack([parameters, 1.3 * parameters]), section, np.array([50.0, 70.0]))  # type: ignore[arg-type]


@pytest.mark.parametrize("section", ["plane-stress", "plane-strain"])
def test_planar_elements_have_the_accepted_numbers(section: str, tmp_path: Path) -> None:
    mesh, rng = planar_elements(), np.random.default_rng(3)
    ops = element.operators(mesh)
    lines = list(of(ops, "operators")) if section == "plane-stress" else []
    nodal, step = rng.normal(0, 0.06, (2, 2, 2, 2, 9))
    pressure, further = rng.normal(0, 0.1, (2, 2, 2, 3))
    for law in LAWS_OF_ALL_KINDS:
        batch = batch_of(law, section)
        ev = element.evaluate(ops, batch, nodal, pressure)
        predicted = element.predict_stress(ops, ev, step, further if section == "plane-strain" else None)
        lines += [
            *of(ev, law),
            *of(predicted, f"{law}.predicted"),
            *of(element.stiffness(ops, ev, predicted), f"{law}.stiffness"),
        ]
    lines += of(
        {
            "gap": element.volume_gap(ops, batch, ev, pressure),
            "coupling": element.volume_coupling(ops, ev),
            "stretch": element.stretch(ops, nodal),
            "mixed": element.mixed(batch),
        },
        "parts",
    )
    compare(lines, f"planar elements in {section}.txt", tmp_path)


def test_solid_elements_have_the_accepted_numbers(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    mesh = brick_mesh(
        np.array([0.0, 1.0, 2.2]),
        np.array([-0.5, 0.6]),
        np.array([0.0, 0.8]),
        lambda x, y, z: (x + 0.05 * y * z, y + 0.08 * np.sin(x), z + 0.03 * x * y),
    )
    ops = brick.operators(mesh)
    lines = [*of(mesh, "mesh"), *of(ops, "operators")]
    nodal, step = rng.normal(0, 0.05, (2, 2, 2, 3, 27))
    pressure, further = rng.normal(0, 0.1, (2, 2, 2, 4))
    for law in LAWS_OF_ALL_KINDS:
        batch = batch_of(law, "solid")
        ev = brick.evaluate(ops, batch, nodal, pressure)
        predicted = brick.predict_stress(ops, ev, step, further)
        lines += [
            *of(ev, law),
            *of(predicted, f"{law}.predicted"),
            *of(brick.stiffness(ops, ev, predicted), f"{law}.stiffness"),
        ]
    lines += of(
        {
            "coupling": brick.volume_coupling(ops, ev),
            "stretch": brick.stretch(ops, nodal),
            "gap": element.volume_gap(ops, batch, ev, pressure),  # type: ignore[arg-type]
            "mixed": brick.mixed(batch),
        },
        "parts",
    )
    compare(lines, "solid elements.txt", tmp_path)


def test_stresses_of_special_deformations_have_the_accepted_numbers(tmp_path: Path) -> None:
    cases = {
        "rest": np.eye(3),
        "equal stretches": np.diag([1.3, 1.3, 1 / 1.69]),
        "nearly equal": np.diag([1.3, 1.3 * (1 + 0.9e-5), 0.6]),
        "not quite equal": np.diag([1.3, 1.3 * (1 + 1.1e-5), 0.6]),
        "shear": np.array([[1.0, 0.4, 0.1], [0.0, 1.1, -0.2], [0.05, 0.0, 0.9]]),
    }
    lines: list[str] = []
    for name, F in cases.items():
        for law, parameters in LAWS_OF_ALL_KINDS.items():
            J = np.array([np.linalg.det(F)])
            found = isotropy.response(LAWS[law], np.array(parameters), F[..., None], J)
            lines += of(found, f"{name}, {law}")
            assert isotropy.right_cauchy_green(F[..., None])[:, 0] == pytest.approx(
                (F.T @ F)[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
            )
    compare(lines, "special deformations.txt", tmp_path)


def matrices(rng: np.random.Generator, elements: int, batch: int, unknowns: int) -> np.ndarray:
    # Return positive definite matrices of elements.
    root = rng.normal(0, 1, (elements, batch, unknowns, unknowns))
    return root @ root.swapaxes(-1, -2) + np.eye(unknowns)


DOFS = {
    "alone": (np.array([[-1, 0, 1], [0, 1, 2], [2, 3, 4], [4, 5, 6]]), None),
    "body in the band": (np.array([[-1, 0, 1, 6], [1, 2, 3, 4], [3, 4, 5, -1], [5, 6, 3, -1]]), np.array([2, 3])),
    "body beside the band": (np.array([[-1, 0, 1], [0, 1, 2], [2, 3, -1], [3, 4, 5]]), np.array([0, 2])),
}


@pytest.mark.parametrize("name", DOFS)
def test_systems_of_equations_have_the_solutions_of_dense_matrices(name: str) -> None:
    dofs, tied = DOFS[name]
    rng, batch, n = np.random.default_rng(8), 2, int(dofs.max()) + 1
    e, d = dofs.shape
    K, force = matrices(rng, e, batch, d), rng.normal(0, 1, (e, batch, d))
    right = rng.normal(0, 1, (batch, n))
    tie = rng.normal(0, 1, (0 if tied is None else len(tied), batch, d, 3))
    further, pull = np.diag([3.0, 2.0, 4.0]) + np.zeros((batch, 3, 3)), rng.normal(0, 1, (batch, 3))
    for at_once in (None, 3):
        system = System(dofs, n, tied, at_once)
        assert system._in_band == (name == "body in the band")
        for symmetric in (True, False):
            for weakened in (False, True):
                matrix = K if symmetric else K + 0.3 * rng.normal(0, 1, K.shape)
                if weakened:
                    matrix = matrix - 40 * np.eye(d)
                dense, rhs = np.zeros((batch, n + 3, n + 3)), np.zeros((batch, n + 3))
                for i in range(e):
                    place = np.zeros((batch, d, n + 3))
                    for k, dof in enumerate(dofs[i]):
                        if dof >= 0:
                            place[:, k, dof] = 1
                    if tied is not None and i in tied:
                        place[:, :, n:] += tie[list(tied).index(i)]
                    dense += place.swapaxes(-1, -2) @ matrix[i] @ place
                    rhs -= (place.swapaxes(-1, -2) @ force[i][..., None])[..., 0]
                rhs[:, :n] += right
                dense[:, n:, n:] += further
                rhs[:, n:] += pull
                body = None if tied is None else (tie, further, pull)
                stiffness = matrix if at_once is None else (matrix[part] for part in system._assembly.parts)
                found = system.solve(stiffness, force, right, body, np.ones(batch, bool), symmetric)
                size = n if tied is None else n + 3
                expected = np.linalg.solve(dense[:, :size, :size], rhs[:, :size, None])[..., 0]
                assert found.nodes == pytest.approx(expected[:, :n])
                assert found.sound.all()
                if tied is not None:
                    assert found.body == pytest.approx(expected[:, n:])
                assert found.indefinite.tolist() == [weakened and symmetric] * batch
                if symmetric:
                    factored = FactoredSystem(system, matrix, None if tied is None else (tie, further))
                    assert factored.sound.tolist() == [not weakened] * batch
                    if not weakened:
                        sides = rng.normal(0, 1, (3, batch, n + 3))
                        nodes, moved = factored.solve(sides[..., :n], sides[..., n:])
                        solved = np.linalg.solve(dense[:, :size, :size], sides[..., :size, None])[..., 0]
                        assert nodes == pytest.approx(solved[..., :n])
                        assert moved == pytest.approx(solved[..., n:] if tied is not None else np.zeros((3, batch, 3)))


def test_a_body_is_indefinite_if_its_schur_complement_is(tmp_path: Path) -> None:
    dofs, tied = DOFS["body beside the band"]
    rng = np.random.default_rng(9)
    K, tie = matrices(rng, 4, 1, 3), rng.normal(0, 1, (2, 1, 3, 3))
    system = System(dofs, 6, tied)
    weak = [np.diag(-1e3 * (np.arange(3) == k))[None] for k in range(3)]
    double = [np.diag(-1e3 * (np.arange(3) != k))[None] for k in range(3)]
    for further in [*weak, *double, np.diag([-1e3] * 3)[None]]:
        body = (tie, further, np.ones((1, 3)))
        found = system.solve(K, np.zeros((4, 1, 3)), np.ones((1, 6)), body, np.ones(1, bool), True)
        assert found.indefinite[0]
        assert found.sound[0]
        assert not FactoredSystem(system, K, (tie, further)).sound[0]


SPECIMENS = {
    "narrow magnet before the tip": BEAM,
    "full magnet": FULL,
    "wide cap": replace(BEAM, magnet=replace(MAGNET, width_mm=3.0, tip_offset_mm=9.0)),
    "nearly full magnet": replace(BEAM, magnet=replace(MAGNET, width_mm=2.95, tip_offset_mm=0.05)),
    "bent with a magnet": replace(BEAM, rest_shape=BENT),
    "bent without a magnet": replace(BEAM, magnet=None, rest_shape=DEEP),
    "tapered": replace(FULL, magnet=replace(FULL.magnet, depth_mm=5.0), rest_shape=replace(DEEP, turns=())),  # type: ignore[arg-type, type-var]
    "steps": replace(
        BEAM, rest_shape=RestShape(widths=((0.0, 0.0), (0.3, 0.0), (0.3, 0.4), (0.6, 0.4), (0.6, 0.1), (1.0, 0.1)))
    ),
    "modes": replace(BEAM, rest_shape=BENT),
    "modes alone": BEAM,
}


MODES = {"modes": ((0.3, -0.2, 0.1), (0.05, 0.08)), "modes alone": ((0.3, -0.2), (0.0, 0.08))}


@pytest.mark.parametrize("name", SPECIMENS)
def test_meshes_have_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    specimen = with_modes(SPECIMENS[name], *MODES.get(name, ()))
    strip, lines = Strip(specimen), []
    along, across = np.array([0.5, 9.0, 17.5, 25.5, 29.0]), np.array([0.3, -1.2, 1.4, -0.9, 0.2])
    points = np.column_stack([along, across])
    parts = {
        "straight": [strip.straight.width_mm, strip.straight.depth_mm],
        "kinks": strip.kinks_mm,
        "width": strip.width_mm(along),
        "depth": strip.depth_mm(along),
        "angle": strip.angle_rad(along),
        "at rest": strip.at_rest(points),
        "straightened": strip.straightened(points),
        "z": strip.z_at_rest_mm(along, 2 * across),
        "straight z": strip.straight_z_mm(along, 2 * across),
        "thickness": strip.thickness(along),
    }
    lines += of(parts, "strip")
    assert strip.straightened(strip.at_rest(points)) == pytest.approx(points, abs=1e-6)
    for along_count, across_count, divided in [(3, 1, False), (4, 3, True)]:
        grid = Grid(specimen, along_count, across_count, divided)
        nodes, weights = grid.place(points)
        lines += of(
            {
                "x": grid.x_mm,
                "y": grid.y_mm,
                "inside": grid.inside.astype(float),
                "block": list(grid.block_mm),
                "face": [*grid.face_mm, grid.turn_rad, grid.per_specimen],
                "nodes": grid.mesh.nodes,
                "elements": grid.mesh.elements.astype(float),
                "magnet": grid.magnet_nodes,
                "thickness": grid.mesh.thickness,
                "place": [nodes.astype(float), weights],
                "on the magnet": grid.on_magnet(points).tolist(),
                "columns": [grid.mesh.columns, grid.mesh.rows, *grid.mesh.column(-2), *grid.mesh.row(1)],
            },
            f"grid {along_count}",
        )
    solid = SolidGrid(specimen, 3, 1, 1)
    deep = np.column_stack([points, [0.2, -1.1, 2.2, 1.3, -0.4]])
    nodes, weights = solid.place(deep)
    shared, fractions = solid.through_depth(points[1])
    lines += of(
        {
            "z": solid.z_mm,
            "block": list(solid.block_mm),
            "nodes": solid.mesh.nodes,
            "elements": solid.mesh.elements.astype(float),
            "magnet": solid.magnet_nodes,
            "place": [nodes.astype(float), weights],
            "through": [shared.astype(float), fractions],
            "straightened": solid.straightened(deep),
            "on the magnet": solid.on_magnet(deep).tolist(),
        },
        "solid",
    )
    compare(lines, f"mesh of a beam, {name}.txt", tmp_path)


def test_points_are_on_the_magnet_up_to_its_ends() -> None:
    grid, solid = Grid(BEAM, 3, 1), SolidGrid(BEAM, 3, 1)
    points = [(25.0, 0.0), (25.001, 0.0), (29.0, 0.0), (29.001, 0.0), (27.0, 1.0), (27.0, -1.0), (27.0, 1.001)]
    assert grid.on_magnet(np.array(points)).tolist() == [False, True, True, False, True, True, False]
    deep = np.array([(27.0, 0.0, z) for z in (1.25, -1.25, 1.26, -1.26)])
    assert solid.on_magnet(deep).tolist() == [True, True, False, False]
    full = Grid(FULL, 3, 1)
    assert full.on_magnet(np.array([(26.001, 1.5), (30.001, 0.0), (27.0, -1.6)])).tolist() == [True, True, True]


def test_divided_lengths_have_the_accepted_numbers(tmp_path: Path) -> None:
    lines = [
        *of(graded(10.0, 4, 1.5, 3.0, 1.0), "plain"),
        *of(graded(10.0, 6, 1.5, 3.0, 1.0, np.array([2.5, 7.0])), "with steps"),
        *of(graded(10.0, 3, 1.5, 3.0, 1.0, (0.5,)), "near the end"),
    ]
    compare(lines, "divided lengths.txt", tmp_path)


COIL = FieldTable.of_loops(60.0, 40.0, (20.0, 5.0), (0.6, 0.8), 34.0)
SHAPE = CoilShape((0.6, 0.8), (1.5, -2.5), COIL, 30.0)


def test_coil_fields_have_the_accepted_numbers(tmp_path: Path) -> None:
    radial = np.array([0.0, 4.9e-6, -1e-3, -2e-2, 3e-2, 0.09])
    axial = np.array([0.01, 0.02, 0.03, -0.03, 0.0, 0.05])
    points = np.array([[27.0, 1.0], [20.0, -6.0], [29.0, 4.0]])
    rest = np.array([28.0, 0.5])
    dipole = DipoleInField(
        SHAPE, np.array([20.0, 5.0]), np.array([2.0, 0.3]), np.array([26.0, 0.2]), np.array([[3e-3, 8e-3]])
    )
    rng = np.random.default_rng(7)
    shares = rng.uniform(0.05, 0.2, (2, 9))
    silicone = SiliconeInField(
        SHAPE,
        rest,
        rng.uniform(0, 25, (2, 9, 2)),
        shares / shares.sum(axis=1, keepdims=True),
        rng.normal(0, 1e-3, (2, 9)),
        np.array([[3e-3, 8e-3], [1e-3, -4e-3]]),
    )
    parts = {
        "loop": loop_field(radial, axial, 0.05),
        "table again": FieldTable.of_loops(60.0, 40.0, (20.0, 5.0), (0.6, 0.8), 34.0),
        "small table": FieldTable.of_loops(80.0, 0.0, (5.0, -2.0), (0.0, 1.0), 15.0),
        "large table": FieldTable.of_loops(300.0, 0.0, (20.0, 5.0), (0.6, -0.8), 120.0),
        "table": [COIL.x_mm, COIL.y_mm, COIL.field, COIL.derivatives(points)],
        "ratio": SHAPE.ratio(points, rest),
        "without a table": CoilShape((0.6, 0.8), (1.5, -2.5), None, 30.0).ratio(points, rest),
        "without a curvature": CoilShape((0.6, 0.8), (1.5, -2.5), COIL).ratio(points, rest),
        "dipole": dipole.load(np.array([[0.3, -2.0, -0.4], [0.1, 1.0, 0.2]])),
        "silicone": silicone.load(rng.normal(0, 1, (2, 2, 2, 9))),
        "silicone of a solid": silicone.load(rng.normal(0, 1, (2, 2, 3, 9))),
        "covers": [COIL.covers(points), COIL.covers(np.array([[27.0, 35.0]]))],
    }
    compare(of(parts, "field"), "coil fields.txt", tmp_path)


def test_a_table_of_a_field_covers_its_ends() -> None:
    low, high = (COIL.x_mm[0], COIL.y_mm[0]), (COIL.x_mm[-1], COIL.y_mm[-1])
    assert COIL.covers(np.array([low, high, (low[0], high[1])]))
    for beyond in [(-1e-9, 0), (0, -1e-9)]:
        assert not COIL.covers(np.array([low]) + beyond)
    for beyond in [(1e-9, 0), (0, 1e-9)]:
        assert not COIL.covers(np.array([high]) + beyond)


LOADED = {
    "magnet": replace(BEAM, tip_load_mm=(29.5, 0.5)),
    "force on the magnet": replace(FULL, tip_load_mm=(28.0, 0.5)),
    "magnetised": replace(MAGNETISED, rest_shape=BENT),
    "pressed": replace(BEAM, pressure_face=PressureFace("left", 3.0, 20.0), section="plane-strain"),
    "pressed before a magnet": replace(FULL, pressure_face=PressureFace("left", 3.0, 20.0)),
    "pressed on the right": replace(MAGNETISED, pressure_face=PressureFace("right", 5.0)),
}
EVERY_LOAD = Loads(
    np.array([[1e-3, 5e-3], [-2e-3, 8e-3]]),
    np.array([[9.0, 2.0], [9.5, -1.0]]),
    np.array([[2e-5, 4e-5], [-1e-5, 5e-5]]),
)


@pytest.mark.parametrize("name", LOADED)
def test_loads_on_a_mesh_have_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    specimen = LOADED[name]
    model, factor = BeamModel(specimen, 3, 1), np.array([1.0, 0.8])
    pressed = "pressed" in name
    loads = replace(EVERY_LOAD, pressure_Pa=np.array([20.0, 35.0])) if pressed else EVERY_LOAD
    lines = [
        *of(loads.on(model.loaded)(loads.state(1), factor), "loads"),
        *of(
            {
                key: value
                for key, value in vars(model.loaded).items()
                if isinstance(value, np.ndarray | float) and not key.startswith("_")
            },
            "mesh",
        ),
        *of(loads.state(0), "state"),
        *of(loads.at_rest(), "rest"),
        *of(loads.take(np.array([1])).state(0), "taken"),
    ]
    if pressed:
        face = model.solid.face
        assert isinstance(face, FollowerPressure)
        lines += [*of(face.elements.astype(float), "face"), *of(face.operator, "operator")]
    else:
        solid, shaped = SolidModel(specimen, 3, 1), replace(loads, coil=SHAPE)
        in_space = loads.on(solid.loaded)(loads.state(1), factor)
        lines += [*of(in_space, "solid"), *of(shaped.on(model.loaded)(loads.state(1), factor), "coil")]
    compare(lines, f"loads, {name}.txt", tmp_path)


def test_angles_of_loads_are_those_of_their_vectors() -> None:
    loads = Loads.along([10.0, 20.0], 30.0, 60.0, [1.0, 2.0], 5.0, [0.0, 90.0])
    assert loads.field_T == pytest.approx(np.array([[8.660254e-3, 5e-3], [17.320508e-3, 10e-3]]))
    assert loads.gravity == pytest.approx(9.80665 * np.array([[0.5, 0.8660254]] * 2))
    assert loads.tip_force_N == pytest.approx(np.array([[1.0, 0.0], [0.0, 2.0]]))
    assert loads.pressure_Pa == 5.0
    assert Loads.along([1.0], tip_force_N=2.0, gravity_angle_deg=90.0).tip_force_N == pytest.approx(
        np.array([[0, 2.0]])
    )
    assert Loads.along(0.0, gravity_angle_deg=None).gravity.tolist() == [[0.0, 0.0]]
    plain = Loads.along([7.0])
    assert plain.field_T == pytest.approx(np.array([[0.0, 7e-3]]))
    assert plain.gravity == pytest.approx(np.array([[9.80665, 0.0]]))
    assert (plain.pressure_Pa, plain.others, plain.coil) == (0.0, (), None)
    assert plain.tip_force_N.tolist() == [[0.0, 0.0]]


def test_a_rigid_body_has_the_accepted_numbers(tmp_path: Path) -> None:
    mesh = brick_mesh(np.array([0.0, 1.0, 2.2]), np.array([-0.5, 0.6]), np.array([0.0, 0.8]))
    rng = np.random.default_rng(1)
    rigid = np.array([[0.2, -0.4, 0.7], [0.0, 0.1, -1.3]])
    lines: list[str] = []
    for name, some in [("planar", planar_elements()), ("solid", mesh)]:
        nodes = np.flatnonzero(some.nodes[:, 0] > 1.8)
        body = RigidBody(some, nodes, (1.7, 0.1))
        moved = np.zeros((2, *some.nodes.shape))
        body.carry(moved, rigid)
        size = some.nodes.shape[1] * some.elements.shape[1]
        force = rng.normal(0, 1, (len(some.elements), 2, size))
        lines += of([moved, body.matrix(rigid), body.stiffness_of_turning(force, rigid)], name)
        arms = some.nodes[nodes, :2] - np.array([1.7, 0.1])
        turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
        assert moved[0, nodes, :2] == pytest.approx(np.array([0.2, -0.4]) + arms @ turn.T - arms)
    tensor = np.array([[[1.0, 2.0], [5.0, -3.0]], [[0.5, 0.1], [-0.2, 0.4]]])
    moment, stiffness = dead_moment(tensor, rigid)

    def potential(angle: float, k: int) -> float:
        c, s = np.cos(angle), np.sin(angle)
        return float(-np.sum(tensor[k] * np.array([[c, -s], [s, c]])))

    for k, (_, _, angle) in enumerate(rigid):
        at = [potential(angle + step, k) for step in (-1e-4, 0.0, 1e-4)]
        assert moment[k] == pytest.approx(-(at[2] - at[0]) / 2e-4)
        assert stiffness[k] == pytest.approx((at[2] - 2 * at[1] + at[0]) / 1e-8, rel=1e-5)
    compare(lines, "rigid body.txt", tmp_path)


def described_shapes(model: Any, shapes: Any) -> dict[str, Any]:
    return {
        "displacement": shapes.displacement,
        "rigid": shapes.rigid,
        "status": shapes.status.tolist(),
        "iterations": shapes.iterations.tolist(),
        "stretch": shapes.max_stretch,
        "last": shapes.last,
        "angle": model.tip_angle_deg(shapes),
        "of elements": model.element_stretch(shapes),
    }


STATES = Loads(
    np.array([[1e-3, 1e-3], [2e-3, 4e-3], [3e-3, 7e-3]]),
    np.array([[9.0, 2.0]] * 3),
    np.array([[1e-5, 2e-5], [2e-5, 4e-5], [3e-5, 6e-5]]),
)
PATHS: dict[str, tuple[Specimen, Loads]] = {
    "magnet in plane stress": (BEAM, STATES),
    "magnet in plane strain": (replace(FULL, section="plane-strain"), STATES),
    "bent and magnetised": (replace(MAGNETISED, rest_shape=BENT), STATES),
    "pressed": (LOADED["pressed"], replace(STATES, pressure_Pa=np.array([5.0, 10.0, 15.0]))),
    "coil": (FULL, replace(STATES, coil=SHAPE)),
    "magnetised in a coil": (MAGNETISED, replace(STATES, coil=SHAPE)),
}


@pytest.mark.parametrize("name", PATHS)
def test_paths_of_equilibria_have_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    specimen, loads = PATHS[name]
    model = BeamModel(specimen, 3, 1)
    bulk = None if model.plane == "plane-stress" else np.array([3e6, 4e6])
    parameters, factor = np.stack([OF_OGDEN, 1.2 * OF_OGDEN]), np.array([1.0, 0.9])
    parameters[1, 1::2] = OF_OGDEN[1::2]
    shapes = model.solve(OGDEN, parameters, loads, bulk_modulus_Pa=bulk, field_factor=factor, keep=True)
    assert shapes.converged.all()
    assert shapes.every is not None
    bulk = None if bulk is None else bulk[:1]
    again = model.solve(OGDEN, 1.01 * parameters[:1], loads, bulk_modulus_Pa=bulk, near=shapes.every, keep=True)
    places = Strip(specimen).at_rest(np.array([[1.0, 0.3], [12.0, -0.6], [23.2, 0.4]]))
    lines = [
        *of(described_shapes(model, shapes), "followed"),
        *of(described_shapes(model, again), "at once"),
        *of([shapes.every, again.every], "every"),
        *of(model.positions(shapes, places), "positions"),
        *of(outline(model, shapes), "outline"),
        *of(points_on(outline(model, shapes, VIEW), 3), "seen"),
    ]
    compare(lines, f"path, {name}.txt", tmp_path)


VIEW = View(np.array([15.0, 2.0]), 120.0, (2.0, -1.5), np.array([[0.0, 0.0], [20.0, 3.0]]))


def test_one_step_of_newtons_method_has_the_accepted_numbers(tmp_path: Path) -> None:
    rng, lines = np.random.default_rng(6), []
    for name, (specimen, loads) in PATHS.items():
        model = BeamModel(specimen, 3, 1)
        chosen = candidates(YEOH, np.stack([OF_YEOH, 1.2 * OF_YEOH]), model.plane, None, np.array([1.0, 0.9]))
        solid, on_mesh = model.solid, loads.on(model.loaded)(loads.state(2), np.array([1.0, 0.9]))
        rest = solid.rest(2)
        now = replace(
            rest,
            displacement=0.005 * rng.normal(0, 1, rest.displacement.shape),
            rigid=0.02 * rng.normal(0, 1, rest.rigid.shape),
            pressure=0.01 * rng.normal(0, 1, rest.pressure.shape),
            stress=0.01 * rng.normal(0, 1, rest.stress.shape),
        )
        if solid.body:
            solid.body.carry(now.displacement, now.rigid)
        step = solid._step(chosen.batch, on_mesh, now, False)
        lines += [*of(step, name), *of(solid._moved(now, step), f"{name}, moved")]
        assert step.sound.all()
    compare(lines, "Newton steps.txt", tmp_path)


def test_a_difficult_path_has_the_accepted_numbers(tmp_path: Path) -> None:
    # The laws soften, buckle, diverge or are invalid, so that steps are divided and candidates are lost.
    model, lines = BeamModel(FULL, 3, 1), []
    loads = Loads.along([0.5, 30.0, 90.0], gravity_angle_deg=180.0, field_angle_deg=150.0)
    parameters = np.array([[20e3, 2e3, 100.0], [9e3, -2e3, 100.0], [1e3, 0.0, 0.0], [-1.0, 0.0, 0.0], [4e3, -1e3, 0.0]])
    shapes = model.solve(YEOH, parameters, loads, tolerance_mm=1e-6)
    rough = model.solve(YEOH, parameters, loads, tolerance_mm=2e-3)
    for name, found in [("fine", shapes), ("rough", rough)]:
        reached = np.isin(found.status, (Status.CONVERGED, Status.UNSTABLE))
        lines += of([found.status.tolist(), found.displacement[reached], found.max_stretch], name)
    assert {int(status) for status in shapes.status.ravel()} >= {0, 1}
    compare(lines, "difficult path.txt", tmp_path)


SOLIDS = {"magnet": FULL, "bent": replace(FULL, magnet=None, rest_shape=DEEP, magnetisation_A_per_m=(15e3, 2e3))}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_have_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    beside = SolidBeside(replace(SOLIDS[name], section="solid"), 2, 1)
    loads = replace(STATES, tip_force_N=2 * STATES.tip_force_N)
    law, parameters = LAWS["mooney-rivlin"], np.array([[20e3, 4e3]])
    followed = beside.solve(law, parameters, loads, tolerance_mm=1e-5, options=SolidOptions(method="follow"))
    rest = np.array([[1.0, 0.3, 0.5], [12.0, -0.8, -1.5], [23.2, 0.4, 2.0], [27.0, -0.3, -0.8]])
    rest[:, :2] = Strip(beside.specimen).at_rest(rest[:, :2])
    lines = [
        *of(described_shapes(beside, followed), "followed"),
        *of(beside.positions(followed, rest), "positions"),
        *of(outline(beside, followed), "outline"),
        *of(outline(beside, followed, VIEW), "seen"),
    ]
    on_a_ray = Loads.along([1.0, 3.0, 5.0, 7.0])
    options = SolidOptions(method="interpolate", accuracy_mm=1e-3)
    shapes = beside.solve(law, parameters, on_a_ray, tolerance_mm=1e-5, options=options)
    assert shapes.effect is not None
    similar = SolidOptions(method="interpolate", accuracy_mm=1e-3, similar=(shapes.effect,))
    other = beside.solve(law, 1.05 * parameters, on_a_ray, tolerance_mm=1e-5, options=similar)
    assert other.effect is not None
    lines += [
        *of(described_shapes(beside, shapes), "interpolated"),
        *of(list(shapes.effect.places), "places"),
        *of(list(shapes.effect.differences), "differences"),
        *of(described_shapes(beside, other), "corrected"),
        *of([list(other.effect.places), list(other.effect.places_of_base)], "places of the correction"),
        *of(shapes.effect.at(0.3), "at"),
        *of(other.effect.without_base.at(0.3), "without base"),
        *of(shapes.effect.thinned(2).at(0.3), "thinned"),
    ]
    compare(lines, f"solid, {name}.txt", tmp_path)


VIBRATING: dict[str, tuple[Any, float, Any]] = {
    "magnet": (BEAM, 0.0, None),
    "weight on the magnet": (replace(FULL, tip_load_mm=(28.0, 0.7)), 2e-4, None),
    "weight on a thread": (replace(FULL, magnet=None, rest_shape=BENT, section="plane-strain"), 1e-4, (0.6, 0.8)),
    "magnetised in a coil": (MAGNETISED, 0.0, None),
    "magnet in a coil": (FULL, 0.0, None),
    "solid": (replace(BEAM, magnet=None, section="solid"), 1e-4, None),
}


@pytest.mark.parametrize("name", VIBRATING)
def test_vibrations_have_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    specimen, weight_kg, thread = VIBRATING[name]
    model: Any = SolidModel(specimen, 2, 1) if specimen.section == "solid" else BeamModel(specimen, 3, 1)
    inertia = Inertia(model, weight_kg)
    lines = [*of(vars(inertia), "inertia"), *of(inertia.of_body(np.array([0.3, -0.5])), "body")]
    parameters = np.stack([OF_YEOH, 1.2 * OF_YEOH])
    loads = STATES.take(np.array([1]))
    loads = replace(loads, coil=SHAPE) if "coil" in name else loads
    vibration = Vibration(model, weight_kg, None if thread is None else np.array(thread))
    factor = np.array([1.0, 0.9])
    motion, now = vibration.about(YEOH, parameters, loads, field_factor=factor, stiffenings=(1.0, 1.4))
    signs = np.sign(np.einsum("mbnd,n->mb", motion.nodal, np.cos(np.arange(motion.nodal.shape[2]))))
    lines += of(
        {
            "frequencies": motion.frequencies_Hz(4),
            "roots": motion.roots(lambda s: 1.3 * SERIES.complex_ratio(s)),
            "diagonals": [np.einsum("bmm->bm", part) for part in (motion.material, motion.rest, motion.mass)],
            "nodal": motion.nodal * signs[..., None, None],
            "rigid": motion.rigid * signs[..., None],
            "sound": motion.sound.tolist(),
            "now": now.rigid,
        },
        "motion",
    )
    nodal = np.zeros((2, *model.mesh.nodes.shape))
    nodal[0, :, 1], nodal[1, :, 0] = model.mesh.nodes[:, 0] ** 2 / 900, model.mesh.nodes[:, 1] / 10
    given, _ = vibration.about(YEOH, parameters, loads, basis=(nodal, np.array([[0.1, 0.8, 0.06], [0.0, 0.1, 0.02]])))
    lines += of([given.material, given.rest, given.mass, given.frequencies_Hz(2)], "given shapes")
    lines += of([given.take(np.array([1])).material, given.take(np.array([1])).rigid], "taken")
    compare(lines, f"vibration, {name}.txt", tmp_path)


def test_a_twist_has_the_accepted_numbers(tmp_path: Path) -> None:
    rng, along = np.random.default_rng(12), np.linspace(0, 25, 6)
    angle = np.array([[0.02], [0.04]]) * along
    steps = np.stack([np.cos(angle[:, 1:]), np.sin(angle[:, 1:])], axis=-1) * 5.0
    middle = np.concatenate([np.zeros((2, 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    parts = {
        "torsion": [torsion_constant_mm4(3.0, 5.0), torsion_constant_mm4(5.0, 3.0), torsion_constant_mm4(2.0, 2.0)],
        "weight": weight_beyond_kg(BEAM, along),
        "weight without a magnet": weight_beyond_kg(replace(BEAM, magnet=None), along),
        "twist": twist_per_tilt(
            middle, rng.normal(0, 1e-4, (2, 5)), rng.normal(0, 5e-3, (2, 5, 2)), rng.normal(0, 1e-4, (2, 2)), 2e-6, 1e-6
        ),
    }
    compare(of(parts, "twist"), "twist.txt", tmp_path)
    whole = 1e-9 * (30 * 3 * 5 * 1070 + 4 * 2 * 2.5 * (7500 - 1070))
    assert weight_beyond_kg(BEAM, np.zeros(1)) == pytest.approx(whole)
    assert weight_beyond_kg(replace(BEAM, magnet=None), np.array([35.0])) == 0.0


def test_a_folded_candidate_has_finite_forces_and_does_not_change_the_other() -> None:
    rng = np.random.default_rng(13)
    bricks = brick_mesh(np.array([0.0, 1.0, 2.2]), np.array([-0.5, 0.6]), np.array([0.0, 0.8]))
    for kind, mesh, pressures, section in [
        (element, planar_elements(), 3, "plane-strain"),
        (brick, bricks, 4, "solid"),
    ]:
        ops, batch = kind.operators(mesh), batch_of("yeoh", section)  # type: ignore[attr-defined]
        nodes = mesh.nodes[mesh.elements].swapaxes(1, 2)
        nodal = rng.normal(0, 0.03, (2, 2, *nodes.shape[1:]))
        nodal[:, 0, 0] -= 2.0 * nodes[:, 0]
        pressure = rng.normal(0, 0.1, (2, 2, pressures))
        ev = kind.evaluate(ops, batch, nodal, pressure)  # type: ignore[attr-defined]
        assert ev.valid.tolist() == [False, True]
        assert np.isfinite(ev.force).all()
        alone = Batch(batch.law, batch.parameters[1:], batch.section, batch.bulk[1:])
        other = kind.evaluate(ops, alone, nodal[:, 1:], pressure[:, 1:])  # type: ignore[attr-defined]
        assert ev.force[:, 1:] == pytest.approx(other.force)
