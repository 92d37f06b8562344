"""A rigid magnet with silicone beside it bends the beam as a very stiff part of the mesh does."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from eimi_fitting.beam import element
from eimi_fitting.beam.element import Batch
from eimi_fitting.beam.equilibrium import Solid, SolidLoads, Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.mesh import grid_mesh
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, PressureFace, Specimen
from eimi_fitting.inference.evidence.measurements import EdgeObservation, edge_curves, points_on, signed_distance
from eimi_fitting.laws import LAWS, NeoHookean

NEO = LAWS["neo-hookean"]
MU = np.array([[46e3]])
FULL = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
FIELDS = np.linspace(0, 7.05, 8)


def with_magnet(width_mm: float, tip_offset_mm: float = 0.0, section: str = "plane-strain") -> Specimen:
    # Return a beam with a magnet of this width, and a moment and weight that do not depend on the width.
    # tip_offset_mm : length of silicone beyond the magnet
    share = 3.0 / width_mm
    magnet = Magnet(4.0, width_mm, 2.0, 1.2 * share, 7500.0 * share, tip_offset_mm)
    return Specimen(30.0 + tip_offset_mm, 3.0, 5.0, 1070.0, section, magnet)


@dataclass(frozen=True)
class TwoStiffnesses(NeoHookean):
    # A neo-Hookean law with a separate shear modulus `mu` for each element.

    mu: np.ndarray | None = None

    def planar(self, parameters, a, J, section):
        # Return the neo-Hookean energy with the modulus `mu` of each element.
        return super().planar(self.mu[:, None, None, None], a, J, section)


@pytest.mark.parametrize("section", ["plane-strain", "plane-stress"])
@pytest.mark.parametrize(("width", "offset"), [(2.0, 0.0), (2.0, 1.5), (3.0, 1.5)])
def test_a_magnet_moves_like_a_very_stiff_part_of_the_mesh(section, width, offset):
    model = BeamModel(with_magnet(width, offset, section), 10, 2)
    loads = Loads.along(FIELDS, gravity_angle_deg=None)
    ours = model.solve(NEO, MU, loads, tolerance_mm=1e-8)
    mesh = grid_mesh(model.grid.x_mm, model.grid.y_mm)
    inside = np.isin(mesh.elements, model.grid.magnet_nodes).all(axis=1)
    assert len(mesh.elements) - inside.sum() == len(model.mesh.elements)
    fixed = np.zeros((len(mesh.nodes), 2), bool)
    fixed[mesh.column(0)] = True
    solid = Solid(mesh, fixed)
    # The energy of the field on a block with even magnetisation M is -B . F M.
    slopes = np.zeros((len(mesh.nodes), 2))
    np.add.at(slopes, mesh.elements[inside], solid.ops.slope[inside])
    magnet = model.specimen.magnet
    density = 1e3 * magnet.moment_A_m2 / (magnet.length_mm * magnet.width_mm * model.specimen.depth_mm)
    law = TwoStiffnesses(mu=np.where(inside, 3e4, 1.0) * 1e-6 * MU[0, 0])
    batch = Batch(law, 1e-6 * MU, section, 1e4 * 1e-6 * MU[0])
    now = solid.rest(1)
    for field in loads.field_T[1:]:
        nodal = slopes[:, :1] * density * field
        now, status, _ = solid.equilibrium(
            batch,
            SolidLoads(nodal[None], np.zeros((1, 2)), np.zeros((1, 2, 2)), np.zeros(1), np.zeros(1)),
            now,
            1e-7,
            60,
        )
        assert status[0] == Status.CONVERGED
    assert model.tip_angle_deg(ours)[0, -1] > 40
    assert ours.displacement[0, -1] == pytest.approx(now.displacement[0], abs=3e-4)
    assert np.abs(now.displacement).max() > 10


def test_a_magnet_of_almost_full_width_approaches_the_full_width_magnet():
    tips = []
    for width in (2.0, 2.5, 2.8, 2.94):
        model = BeamModel(with_magnet(width), 26, 2)
        shapes = model.solve(NEO, MU, Loads.along(FIELDS))
        assert shapes.converged[0]
        tips.append(model.positions(shapes, [[30.0, 0.0]])[0, -1, 0])
    model = BeamModel(FULL, 26, 2)
    full = model.positions(model.solve(NEO, MU, Loads.along(FIELDS)), [[30.0, 0.0]])[0, -1, 0]
    off = np.linalg.norm(np.array(tips) - full, axis=1)
    assert np.all(np.diff(off) < 0)
    assert off[-1] < 5e-4 * np.linalg.norm(full - [30.0, 0.0])
    assert off[0] > 5e-3 * np.linalg.norm(full - [30.0, 0.0])


@pytest.mark.parametrize("width", [3.0, 2.0])
@pytest.mark.parametrize("gravity_angle_deg", [0.0, 90.0, 180.0])
def test_silicone_before_and_behind_a_shallow_magnet_has_its_weight(width, gravity_angle_deg):
    shapes = []
    for depth_mm in (1.0, 5.0):
        magnet = Magnet(4.0, width, depth_mm, 1.2 / depth_mm, FULL.density_kg_m3)
        model = BeamModel(replace(FULL, magnet=magnet))
        shapes.append(model.solve(NEO, MU, Loads.along([0.0, 7.0], gravity_angle_deg=gravity_angle_deg)))
    shallow, deep = (shape.displacement for shape in shapes)
    assert shallow == pytest.approx(deep, abs=1e-6)
    assert np.abs(deep).max() > 1
    # The weight of this silicone has an effect.
    light = BeamModel(replace(FULL, magnet=replace(magnet, density_kg_m3=0.0)))
    light_shapes = light.solve(NEO, MU, Loads.along([0.0, 7.0], gravity_angle_deg=gravity_angle_deg))
    assert np.abs(light_shapes.displacement - deep).max() > 0.05


def test_silicone_thinner_than_a_hundredth_of_the_width_moves_rigidly_with_the_magnet():
    thin, full = BeamModel(with_magnet(2.95)), BeamModel(FULL)
    assert len(thin.mesh.elements) == len(full.mesh.elements)
    angles = [m.tip_angle_deg(m.solve(NEO, MU, Loads.along(7.05)))[0, 0] for m in (thin, full)]
    assert angles[0] == pytest.approx(angles[1], rel=1e-3)


@pytest.mark.parametrize(("width", "offset"), [(2.0, 0.0), (2.0, 1.5), (3.0, 1.5)])
def test_the_outline_is_that_of_the_silicone(width, offset):
    model = BeamModel(with_magnet(width, offset), 20, 2)
    length = model.specimen.length_mm
    shapes = model.solve(NEO, MU, Loads.along(FIELDS))
    curves = edge_curves(model, shapes)[0, -1]
    left, right = points_on(curves, 4)
    rest = np.array([[x, y] for y in (-1.5, 1.5) for x in (0.0, length - 3.0, length)])
    place = model.positions(shapes, rest)[0, -1]
    for curve, points, corners in zip(curves, (left, right), (place[:3], place[3:]), strict=True):
        assert points[0] == pytest.approx(corners[0], abs=1e-9)
        assert points[-1] == pytest.approx(corners[2], abs=1e-9)
        assert signed_distance(curve, corners[1:2]) == pytest.approx(0, abs=1e-4)
    # Silicone beside or beyond the magnet deforms: it does not move rigidly with the magnet.
    carried = model.carried(shapes, rest)[0, -1]
    assert np.linalg.norm(place - carried, axis=1)[[2, 5]].max() > 1e-6
    # Points on the magnet move rigidly and agree with its nodes.
    near = length - offset - 4.0
    inner = np.array([[near + 1.0, 0.0], [near + 3.0, 0.4 * width]])
    assert model.grid.on_magnet(inner).all()
    nodes, weights = model.place(inner)
    by_nodes = inner + np.einsum("nai,na->ni", shapes.displacement[0, -1][nodes], weights)
    assert model.positions(shapes, inner)[0, -1] == pytest.approx(by_nodes, abs=1e-9)
    # The distance is zero for the outline of the model itself.
    observed = EdgeObservation.from_edges([(left, np.ones(len(left)), right, np.ones(len(right)))])
    last = model.solve(NEO, MU, Loads.along(FIELDS[-1:]), start=shapes.last)
    assert observed.misfit(model, last).error_mm.max() < 1e-6


def test_points_may_lie_outside_a_magnet_without_silicone_but_not_outside_silicone():
    assert BeamModel(FULL).grid.on_magnet(np.array([[30.4, 1.7], [25.9, 0.0]])).tolist() == [True, False]
    model = BeamModel(with_magnet(2.0, 1.0))
    assert model.grid.on_magnet(np.array([[28.0, 1.2], [30.5, 0.0], [28.0, 0.9]])).tolist() == [False, False, True]
    with pytest.raises(ValueError, match=r"point \(28, 1.6\) mm is not on the specimen"):
        model.place(np.array([[28.0, 1.6]]))


def test_the_whole_tangent_is_the_derivative_of_the_forces():
    # Silicone around the magnet, and a pressure that makes the system unsymmetric, need a bordered, general solver.
    specimen = replace(with_magnet(2.0, 1.0), pressure_face=PressureFace("left", 5.0, 29.0))
    model = BeamModel(specimen, 4, 1)
    solid, rng = model.solid, np.random.default_rng(3)
    body, system = solid.body, solid.system
    batch = Batch(NEO, 1e-6 * MU, "plane-stress", np.ones(1))
    free = 5e-3 * rng.normal(size=system.n)
    rigid = np.array([[0.02, 0.03, 0.04]])
    pressure = np.array([2e-3])

    def linearise(free, rigid):
        displacement = np.zeros((1, len(solid.mesh.nodes), 2))
        displacement.reshape(-1)[solid.free] = free
        body.carry(displacement, rigid)
        nodal = solid.by_element(displacement)
        ev = element.evaluate(solid.ops, batch, nodal, np.zeros((len(nodal), 1, 3)))
        assert ev.valid.all()
        stiffness, force = element.stiffness(solid.ops, ev, ev.S), ev.force.reshape(-1, 1, 18).copy()
        solid.face.press(pressure, nodal.reshape(-1, 1, 18), force, stiffness)
        return stiffness, force, body.matrix(rigid)

    def solve(right):
        stiffness, force, tie = linearise(free, rigid)
        turning = np.zeros((1, 3, 3))
        turning[:, 2, 2] = body.stiffness_of_turning(force, rigid)
        zero = np.zeros_like(force)
        x, r, sound, _ = system.solve(
            stiffness, zero, right[None, :-3], (tie, turning, right[None, -3:]), np.ones(1, bool), False
        )
        assert sound.all()
        return np.concatenate([x[0], r[0]])

    def residual(unknowns):
        _, force, tie = linearise(unknowns[:-3], unknowns[None, -3:])
        assembled = system._assembly.vector(force)[0, : system.n]
        return np.concatenate([assembled, np.einsum("ebdr,ebd->r", tie, force[body.elements])])

    about = np.concatenate([free, rigid[0]])
    tangent = np.linalg.inv(np.array([solve(column) for column in np.eye(len(about))]).T)
    for i, column in enumerate(tangent.T):
        step = 1e-6 * np.eye(len(about))[i]
        difference = (residual(about + step) - residual(about - step)) / 2e-6
        assert column == pytest.approx(difference, abs=1e-6 * np.abs(tangent).max())
    assert np.abs(tangent - tangent.T).max() > 1e-3 * pressure[0]


def test_candidates_with_a_rigid_body_do_not_affect_each_other():
    model = BeamModel(with_magnet(2.0, 1.0))
    loads = Loads.along(FIELDS)
    crowd = np.array([[1.0], [np.nan], [46e3], [-3.0], [1e10], [np.inf]])
    together = model.solve(NEO, crowd, loads, field_factor=np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1e300]))
    assert together.displacement[2] == pytest.approx(model.solve(NEO, MU, loads).displacement[0], abs=1e-7)
    assert together.converged.tolist()[1:] == [False, True, False, True, False]
    assert np.isfinite(together.displacement).all()


@pytest.mark.parametrize("flexible_mm", [0.1, 1.0])
def test_a_short_flexible_part_has_a_mesh_of_limited_size(flexible_mm):
    model = BeamModel(replace(with_magnet(2.0, 20.0), length_mm=24.0 + flexible_mm))
    assert len(model.mesh.elements) < 1000
    assert model.solve(NEO, MU, Loads.along(FIELDS)).converged[0]
