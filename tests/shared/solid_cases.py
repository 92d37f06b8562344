"""Compute errors of the solid element and beam model against exact solutions, plane strain and the program FElupe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from eimi_fitting.beam.bricks import Bricks, brick_mesh, shape_functions
from eimi_fitting.beam.element import Batch
from eimi_fitting.beam.equilibrium import Configuration, Solid, SolidLoads, Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.laws import LAWS

LAW_EXAMPLES = {
    "neo-hookean": [1.0],
    "mooney-rivlin": [0.4, 0.1],
    "yeoh": [0.5, 0.1, -0.01],
    "ogden": [0.6, 1.7, 0.02, 8.0, -0.2, -2.5],
}
"""Parameters of each law; moduli are in MPa."""
CANTILEVER = Specimen(100.0, 30.0, 30.0, 1070.0, "plane-stress")
MAGNETIC = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 5.0, 0.48, 7500.0))


def equilibrium(solid: Solid, name: str, force: np.ndarray, bulk: float, steps: int) -> Configuration:
    """Return the equilibrium of a solid under forces on its N nodes, shape (N, 3), applied in equal steps.

    name : key of the law in `LAW_EXAMPLES`
    bulk : bulk modulus in MPa
    """
    batch = Batch(LAWS[name], np.array([LAW_EXAMPLES[name]]), "solid", np.array([bulk]))
    now = solid.rest(1)
    for part in np.linspace(0, 1, steps + 1)[1:]:
        dead = SolidLoads(part * force[None], np.zeros((1, 2)), np.zeros((1, 2, 2)), np.zeros(1), np.zeros(1))
        now, status, _ = solid.equilibrium(batch, dead, now, 1e-10)
        assert status[0] == Status.CONVERGED
    return now


def face_forces(mesh: Bricks, axis: int, at: int, traction: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Convert a traction on one face of a mesh to forces on its N nodes, shape (N, 3).

    axis, at : the face at the beginning (0) or end (-1) of this axis of the grid
    traction : function from n points, shape (n, 3), to the traction at each point, shape (n, 3)
    """
    numbers = np.take(mesh.numbers, at, axis=axis)
    corner = numbers[0:-1:2, 0:-1:2].ravel()
    faces = corner[:, None] + (numbers[:3, :3] - numbers[0, 0]).ravel()
    gauss, weight = np.polynomial.legendre.leggauss(4)
    a, b = (g.ravel() for g in np.meshgrid(gauss, gauss, indexing="ij"))
    values, slopes = shape_functions(np.full(16, -1.0), a, b)
    x = mesh.nodes[faces]  # (F, 9, 3)
    tangents = np.einsum("fai,qar->fqri", x, slopes[:, :9, 1:])
    area = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=-1) * np.outer(weight, weight).ravel()
    places = np.einsum("fai,qa->fqi", x, values[:, :9])
    pull = traction(places.reshape(-1, 3)).reshape(places.shape)
    force = np.zeros(mesh.nodes.shape)
    np.add.at(force, faces, np.einsum("fq,qa,fqi->fai", area, values[:, :9], pull))
    return force


def principal_stress(name: str, stretches: np.ndarray) -> np.ndarray:
    """Return the principal nominal stresses, shape (3,), of an incompressible body whose third pair of faces is free.

    name : the law
    stretches : the three principal stretches
    """
    _, tau, _ = LAWS[name].principal(np.array(LAW_EXAMPLES[name]), stretches)
    return np.asarray((tau - tau[2]) / stretches)


def distorted(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Move the inner points of a unit cube, to distort the elements of a mesh."""
    inner = (1 - np.abs(2 * x - 1)) * (1 - np.abs(2 * y - 1)) * (1 - np.abs(2 * z - 1))
    return x + 0.11 * inner, y - 0.07 * inner, z + 0.09 * inner


def even_stretch(name: str, along: float, across: float) -> float:
    """Return the largest error of a displacement in a patch test: a uniform stretch of distorted solid elements.

    name : the law
    along, across : stretches in two directions
    """
    stretches = np.array([along, across, 1 / (along * across)])
    lines = np.linspace(0, 1, 3)
    mesh = brick_mesh(lines, lines, lines, distorted)
    fixed = mesh.nodes == 0
    nominal = principal_stress(name, stretches)
    pull = [
        face_forces(mesh, k, -1, lambda x, k=k: np.broadcast_to(nominal[k] * np.eye(3)[k], x.shape)) for k in (0, 1)
    ]
    displacement = equilibrium(Solid(mesh, fixed), name, pull[0] + pull[1], 1e7, 8)
    return float(np.abs(displacement.displacement[0] - mesh.nodes * (stretches - 1)).max())


def torsion(name: str, divisions: int, twist: float = 1.0) -> tuple[float, float]:
    """Twist a unit cube about z; return the largest error of a displacement, and the torque divided by its exact value.

    Exact solution: Rivlin 1948, Phil. Trans. R. Soc. A 241:379.
    name : the law, neo-hookean or mooney-rivlin
    divisions : number of elements along a side
    twist : angle for each unit of z (rad)
    """
    lines = np.linspace(-0.5, 0.5, divisions + 1)
    mesh = brick_mesh(lines, lines, lines)
    x, y, z = mesh.nodes.T
    surface = (np.abs(mesh.nodes) == 0.5).any(axis=1)
    c, s = np.cos(twist * z), np.sin(twist * z)
    exact = np.column_stack([c * x - s * y, s * x + c * y, z]) - mesh.nodes
    solid = Solid(mesh, np.repeat(surface[:, None], 3, axis=1))
    batch = Batch(LAWS[name], np.array([LAW_EXAMPLES[name]]), "solid", np.array([1e4]))
    nothing = SolidLoads(
        np.zeros((1, *mesh.nodes.shape)), np.zeros((1, 2)), np.zeros((1, 2, 2)), np.zeros(1), np.zeros(1)
    )
    now = solid.rest(1)
    for part in np.linspace(0, 1, 6)[1:]:
        c, s = np.cos(part * twist * z), np.sin(part * twist * z)
        target = np.column_stack([c * x - s * y, s * x + c * y, z]) - mesh.nodes
        now.displacement[0, surface] = target[surface]
        now, status, _ = solid.equilibrium(batch, nothing, now, 1e-10)
        assert status[0] == Status.CONVERGED
    force = solid.kind.evaluate(solid.ops, batch, solid.by_element(now.displacement), now.pressure).force[:, 0]
    # The torque in the middle section, from the forces on its nodes by the elements on one side.
    upper = mesh.nodes[mesh.elements].mean(axis=1)[:, 2] > 0
    half = np.zeros(mesh.nodes.shape)
    np.add.at(half, mesh.elements[upper], force[upper].transpose(0, 2, 1))
    middle = np.abs(z) < 1e-9
    place = mesh.nodes[middle] + now.displacement[0, middle]
    torque = -np.sum(place[:, 0] * half[middle, 1] - place[:, 1] * half[middle, 0])
    mu = float(LAWS[name].initial_shear_modulus(np.array(LAW_EXAMPLES[name])))
    inner = ~surface
    return float(np.abs(now.displacement[0, inner] - exact[inner]).max()), float(torque / (mu * twist / 6))


def cylinder(divisions: int, stretch: float) -> tuple[float, float, float]:
    """Inflate a cylinder (radii 1 and 2, plane strain); return the errors of inner radius, displacements and pressure.

    divisions : number of elements across the wall
    stretch : inner radius after the inflation
    """
    outer = np.sqrt((3 + stretch**2) / 4)
    load = stretch * (np.log(stretch / outer) + 0.5 * (outer**-2 - stretch**-2))

    def place(s: np.ndarray, t: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = 0.5 * np.pi * (1 - s)
        return (1 + t) * np.cos(angle), (1 + t) * np.sin(angle), z

    mesh = brick_mesh(
        np.linspace(0, 1, 2 * divisions + 1), np.linspace(0, 1, divisions + 1), np.array([0.0, 1 / divisions]), place
    )
    fixed = np.zeros(mesh.nodes.shape, bool)
    fixed[mesh.numbers[0].ravel(), 0] = fixed[mesh.numbers[-1].ravel(), 1] = True
    fixed[:, 2] = True
    force = face_forces(mesh, 1, 0, lambda x: load * x * [1, 1, 0] / np.linalg.norm(x[:, :2], axis=1)[:, None])
    solid = Solid(mesh, fixed)
    displacement = equilibrium(solid, "neo-hookean", force, 1e6, 6)
    rest = mesh.nodes[mesh.elements]
    grid = np.meshgrid(*(np.polynomial.legendre.leggauss(k)[0] for k in (2, 3, 3)), indexing="ij")
    values, _ = shape_functions(*(g.ravel() for g in grid))
    X = np.einsum("qa,eai->eqi", values, rest)
    u = np.einsum("qa,eai->eqi", values, displacement.displacement[0][mesh.elements])
    R = np.linalg.norm(X[..., :2], axis=-1)
    local = np.sqrt(R**2 + stretch**2 - 1) / R
    gap = u[..., :2] - X[..., :2] * (local - 1)[..., None]
    p = np.einsum("eqk,ek->eq", solid.ops.basis, displacement.pressure[:, 0])
    sigma = -(np.log(local / outer) + 0.5 * (outer**-2 - local**-2))
    exact = sigma - local**-2 + (local**2 + local**-2 + 1) / 3
    w = solid.ops.weights * divisions  # for one unit of depth
    inner = mesh.numbers[:, 0, 0]
    radius = np.linalg.norm((mesh.nodes + displacement.displacement[0])[inner, :2], axis=1)
    return (
        float(np.abs(radius / stretch - 1).max()),
        float(np.sqrt(np.sum(w * np.sum(gap**2, axis=-1)))),
        float(np.sqrt(np.sum(w * (p - exact) ** 2))),
    )


def held(specimen: Specimen, along: int, across: int) -> SolidModel:
    """Return a solid model that is held in plane strain: no node moves in depth."""
    model = SolidModel(specimen, along, across)
    fixed = np.zeros(model.mesh.nodes.shape, bool)
    fixed[model.mesh.numbers[0].ravel()] = True
    fixed[:, 2] = True
    model.solid = Solid(model.mesh, fixed, model.grid.magnet_nodes, (specimen.flexible_length_mm, 0.0))
    return model


def against_plane_strain(name: str) -> float:
    """Return the largest difference (mm) between the plane-strain model and a solid held in plane strain."""
    law = LAWS[name]
    parameters = np.array(LAW_EXAMPLES[name]) * [1 if u == "1" else 4.6e4 for u in law.units]
    loads = Loads.along(np.linspace(0, 7, 6), 70.0, 10.0, 1e-4)
    points = np.array([[10.0, 1.0], [20.0, -1.5], [26.0, 1.5], [30.0, 0.0]])
    flat, solid = BeamModel(MAGNETIC, 13, 2), held(MAGNETIC, 13, 2)
    one = flat.positions(flat.solve(law, parameters, loads, tolerance_mm=1e-8), points)
    other = solid.positions(
        solid.solve(law, parameters, loads, tolerance_mm=1e-8), np.column_stack([points, [0.0, 1.0, 2.5, 2.5]])
    )
    return float(np.abs(other[..., :2] - one).max())


def drop(specimen: Specimen, mu: float, along: int, across: int, more: int = 0) -> float:
    """Return by how many mm the tip of a horizontal solid beam sinks under its weight.

    mu : shear modulus in Pa
    along, across : numbers of elements
    more : elements in depth in addition to the usual number
    """
    model = SolidModel(specimen, along, across, more)
    loads = Loads.along(np.zeros(4), 90.0, -90.0)
    loads = replace(loads, gravity=loads.gravity * np.array([[0.25], [0.5], [0.75], [1.0]]))
    shapes = model.solve(LAWS["neo-hookean"], np.array([mu]), loads)
    assert shapes.converged[0]
    return float(-model.positions(shapes, np.array([[specimen.length_mm, 0.0, 0.0]]))[0, -1, 0, 1])


def felupe_drop(specimen: Specimen, mu: float, cells: tuple[int, int, int]) -> float:
    """Return by how many mm the tip of a horizontal beam sinks under its weight, as FElupe computes it.

    cells : numbers of elements along, across, and in half of the depth
    """
    import felupe

    half = 0.5 * specimen.depth_mm
    mesh = felupe.Cube(
        a=(0, -0.5 * specimen.width_mm, 0),
        b=(specimen.length_mm, 0.5 * specimen.width_mm, half),
        n=tuple(c + 1 for c in cells),
    )
    region = felupe.RegionHexahedron(mesh)
    field = felupe.FieldContainer([felupe.Field(region, dim=3)])
    body = felupe.SolidBodyNearlyIncompressible(felupe.NeoHooke(mu=1e-6 * mu), field, bulk=5e-3 * mu)
    weight = felupe.SolidBodyForce(field)
    clamp = felupe.Boundary(field[0], fx=0)
    middle = felupe.Boundary(field[0], fz=0, skip=(1, 1, 0))
    bounds = {"clamp": clamp, "middle": middle}
    dof0, dof1 = felupe.dof.partition(field, bounds)
    ext0 = felupe.dof.apply(field, bounds, dof0)
    for part in (0.25, 0.5, 0.75, 1.0):
        weight.update([0.0, -part * 1e-9 * specimen.density_kg_m3 * 9.80665, 0.0])
        felupe.newtonraphson(items=[body, weight], dof0=dof0, dof1=dof1, ext0=ext0, verbose=0, tol=1e-8)
    tip = np.argmin(np.linalg.norm(mesh.points - [specimen.length_mm, 0, 0], axis=1))
    return float(-field[0].values[tip, 1])
