"""The planar element and the solver agree with exact or published solutions, and converge with the right orders."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.beam.element import Batch
from eimi_fitting.beam.equilibrium import Configuration, Solid, SolidLoads, Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.mesh import Mesh, mapped_mesh, shape_functions
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.laws import LAWS

NEO = LAWS["neo-hookean"]


def edge_forces(mesh: Mesh, nodes: np.ndarray, traction) -> np.ndarray:
    # Convert a traction on one edge of a mesh to forces (x, y) in newton on its n nodes, shape (n, 2).
    # nodes : the nodes of the edge, in order
    # traction : function from a point (x, y) to the traction in N/mm², shape (2,)
    force = np.zeros((len(mesh.nodes), 2))
    for a, b, c in zip(nodes[0:-1:2], nodes[1::2], nodes[2::2], strict=True):
        x = mesh.nodes[[a, b, c]]
        for s, w in zip(*np.polynomial.legendre.leggauss(5), strict=True):
            values = np.array([0.5 * s * (s - 1), 1 - s * s, 0.5 * s * (s + 1)])
            length = np.linalg.norm(np.array([s - 0.5, -2 * s, s + 0.5]) @ x)
            force[[a, b, c]] += w * length * np.outer(values, traction(values @ x))
    return force


def solve(solid: Solid, force: np.ndarray, mu: float, bulk: float, steps: int = 1) -> Configuration:
    # Return the equilibrium of a neo-Hookean body under forces on its nodes, applied in equal steps.
    # force : forces (x, y) on n nodes, shape (n, 2)
    # mu, bulk : shear and bulk modulus
    batch = Batch(NEO, np.array([[mu]]), "plane-strain", np.array([bulk]))
    now = solid.rest(1)
    for k in range(1, steps + 1):
        loads = SolidLoads(force[None] * k / steps, np.zeros((1, 2)), np.zeros((1, 2, 2)), np.zeros(1), np.zeros(1))
        now, status, _ = solid.equilibrium(batch, loads, now, 1e-9)
        assert status[0] == Status.CONVERGED
    return now


def cooks_membrane(n: int) -> tuple[Solid, np.ndarray]:
    # Return a mesh (n x n elements) of Cook's membrane, clamped on the left, and the nodes of its right edge.
    mesh = mapped_mesh(n, n, lambda s, t: (48 * s, 44 * s + t * (44 * (1 - s) + 16 * s)))
    fixed = np.zeros((len(mesh.nodes), 2), bool)
    fixed[mesh.column(0)] = True
    return Solid(mesh, fixed), mesh.column(-1)


def quarter_cylinder(n: int) -> tuple[Solid, np.ndarray]:
    # Return a mesh (n elements across the wall) of a quarter cylinder of radii 1 and 2, and its inner nodes.
    mesh = mapped_mesh(
        2 * n,
        n,
        lambda s, t: ((1 + t) * np.cos(np.pi / 2 * (1 - s)), (1 + t) * np.sin(np.pi / 2 * (1 - s))),
    )
    fixed = np.zeros((len(mesh.nodes), 2), bool)
    fixed[mesh.column(0), 0] = True
    fixed[mesh.column(-1), 1] = True
    return Solid(mesh, fixed), mesh.row(0)


def inflate(n: int, stretch: float, pressure: float) -> tuple[Solid, Configuration]:
    # Inflate a thick cylinder by a pressure on its inner face; return the mesh and its deformed shape.
    solid, inner = quarter_cylinder(n)
    force = edge_forces(solid.mesh, inner, lambda x: pressure * stretch * x / np.linalg.norm(x))
    return solid, solve(solid, force, 1.0, 1e6, steps=6)


@pytest.mark.parametrize(("stretch", "pressure"), [(1.1, 0.131562), (1.5, 0.428228), (2.0, 0.574054), (3.0, 0.660417)])
def test_a_thick_cylinder_agrees_with_the_exact_solution(stretch, pressure):
    # p/mu = ln(la/lb) + (lb^-2 - la^-2)/2 with A = 1, B = 2 (Ogden, Non-linear Elastic Deformations, 5.3.3).
    outer = np.sqrt((4 + stretch**2 - 1) / 4)
    assert np.log(stretch / outer) + 0.5 * (outer**-2 - stretch**-2) == pytest.approx(pressure, abs=1e-6)
    solid, displacement = inflate(3, stretch, pressure)
    radius = np.linalg.norm(solid.mesh.nodes + displacement.displacement[0], axis=1)[solid.mesh.row(0)]
    assert radius == pytest.approx(stretch, rel=2e-4)


def test_displacement_and_pressure_converge_with_their_orders():
    # L2 norms of the errors on the inflated cylinder; quadratic displacement: 3, linear pressure: 2.
    stretch, pressure = 1.5, 0.42822836
    s, w = np.polynomial.legendre.leggauss(4)
    xi, eta = (g.ravel() for g in np.meshgrid(s, s))
    weight = np.outer(w, w).ravel()
    values, slopes = shape_functions(xi, eta)
    errors = []
    for n in (2, 4, 8):
        solid, state = inflate(n, stretch, pressure)
        rest = solid.mesh.nodes[solid.mesh.elements]
        jacobian = np.einsum("eai,qar->eqir", rest, slopes)
        area = np.linalg.det(jacobian) * weight
        X = np.einsum("qa,eai->eqi", values, rest)
        u = np.einsum("qa,eai->eqi", values, state.displacement[0][solid.mesh.elements])
        R = np.linalg.norm(X, axis=-1)
        r = np.sqrt(R**2 + stretch**2 - 1)
        displacement = np.sqrt(np.sum(area * np.sum((u - X * ((r - R) / R)[..., None]) ** 2, axis=-1)))
        # Pressure at the Gauss points of the element. At the exact solution the Kirchhoff stress is
        # b - 1/3 tr b + p, and its radial part vanishes at the outer radius.
        p = np.einsum("eqk,ek->eq", solid.ops.basis, state.pressure[:, 0])
        own_xi, own_eta = np.meshgrid(*(np.polynomial.legendre.leggauss(k)[0] for k in (2, 3)), indexing="ij")
        Xg = np.einsum("qa,eai->eqi", shape_functions(own_xi.ravel(), own_eta.ravel())[0], rest)
        exact = exact_pressure(np.linalg.norm(Xg, axis=-1), stretch)
        errors.append([displacement, np.sqrt(np.sum(solid.ops.weights * (p - exact) ** 2))])
    rates = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert rates[-1, 0] == pytest.approx(3.0, abs=0.35)
    assert rates[-1, 1] == pytest.approx(2.0, abs=0.35)


def exact_pressure(R: np.ndarray, stretch: float) -> np.ndarray:
    # Return the exact pressure in an inflated cylinder of radii 1 and 2 at the undeformed radii R, divided by mu.
    # stretch : inner radius after the inflation
    lam = np.sqrt(R**2 + stretch**2 - 1) / R
    outer = np.sqrt((4 + stretch**2 - 1) / 4)
    # Radial equilibrium: sigma_r(R) = -(ln(lam/outer) + (outer^-2 - lam^-2)/2); sigma_r = lam^-2 - tr b/3 + p.
    sigma = -(np.log(lam / outer) + 0.5 * (outer**-2 - lam**-2))
    return sigma - lam**-2 + (lam**2 + lam**-2 + 1) / 3


@pytest.mark.parametrize("n", [8, 16])
def test_a_nearly_incompressible_cooks_membrane_has_its_published_deflection(n):
    # G = 80.1938, K = 40.0942e4, load 100: 6.92 within 0.5 % (6.9083 published at 128 x 128; finer runs rise to 6.923).
    solid, right = cooks_membrane(n)
    displacement = solve(solid, edge_forces(solid.mesh, right, lambda x: np.array([0.0, 100 / 16])), 80.1938, 40.0942e4)
    assert displacement.displacement[0, right[-1], 1] == pytest.approx(6.92, rel=0.005)


def test_an_incompressible_cooks_membrane_has_its_published_deflection():
    # E = 3, nu = 1/2, traction 0.05: u_y = 4.7011.
    solid, right = cooks_membrane(16)
    displacement = solve(solid, edge_forces(solid.mesh, right, lambda x: np.array([0.0, 0.05])), 1.0, 1e5)
    assert displacement.displacement[0, right[-1], 1] == pytest.approx(4.7011, rel=1e-3)


@pytest.mark.parametrize(
    ("q", "angle", "x", "y"),
    [
        (1, 26.4335, 0.94357, 0.30172),
        (2, 44.7910, 0.83936, 0.49346),
        (5, 69.6355, 0.61237, 0.71379),
        (10, 81.9493, 0.44500, 0.81061),
    ],
)
def test_a_magnetised_beam_bends_as_the_hard_magnetic_elastica(q, angle, x, y):
    # A beam magnetised along its length in a field across it: the inextensible thin limit with q = M B A L^2 / (E I).
    length, width, mu = 100.0, 1.0, 0.05
    magnetisation = 1e5  # A/m
    field_T = q * (4 * mu * 1e6) * (width * 1e-3) ** 2 / 12 / (magnetisation * (length * 1e-3) ** 2)
    specimen = Specimen(length, width, 1.0, 0.0, "plane-strain", magnetisation_A_per_m=(magnetisation, 0.0))
    model = BeamModel(specimen, 40, 1)
    loads = Loads.along(1e3 * field_T * np.linspace(0, 1, 6), gravity_angle_deg=None)
    shapes = model.solve(NEO, np.array([[mu * 1e6]]), loads)
    assert shapes.converged[0]
    tip = model.positions(shapes, np.array([[length, 0.0]]))[0, -1, 0] / length
    assert model.tip_angle_deg(shapes)[0, -1] == pytest.approx(angle, rel=0.005)
    assert tip == pytest.approx([x, y], rel=0.005)


def test_a_tip_moment_bends_a_thin_beam_to_an_arc():
    # u = L (sin t / t - 1), v = L (1 - cos t) / t with t = M L / (E I), exact in the thin limit.
    magnet = Magnet(1.0, 1.0, 1.0, 1.0, 0.0)
    length, width, mu = 100.0, 1.0, 0.05
    stiffness = 4 * mu * width**3 / 12
    t = np.radians(np.linspace(0, 120, 13)[1:])
    moment = stiffness * t / length
    field = moment / (1e3 * magnet.moment_A_m2)
    # The field rotates with the tip, so that the moment on the magnet has the given value.
    loads = Loads(field[:, None] * np.column_stack([-np.sin(t), np.cos(t)]), np.zeros((12, 2)), np.zeros((12, 2)))
    model = BeamModel(Specimen(length + 1.0, width, 1.0, 0.0, "plane-strain", magnet), 40, 1)
    shapes = model.solve(NEO, np.array([[mu * 1e6]]), loads)
    assert shapes.converged[0]
    end = model.positions(shapes, np.array([[length, 0.0]]))[0, :, 0] - [length, 0.0]
    assert end[:, 0] == pytest.approx(length * (np.sin(t) / t - 1), abs=0.005 * length)
    assert end[:, 1] == pytest.approx(length * (1 - np.cos(t)) / t, abs=0.005 * length)


def test_a_patch_of_distorted_elements_stretches_uniformly():
    mesh = mapped_mesh(4, 3, lambda s, t: (2 * s + 0.1 * np.sin(3 * np.pi * s) * t * (1 - t) * 4, t))
    inside = (
        (mesh.nodes[:, 0] > 0.01) & (mesh.nodes[:, 0] < 1.99) & (mesh.nodes[:, 1] > 0.01) & (mesh.nodes[:, 1] < 0.99)
    )
    assert np.ptp(mesh.nodes[inside, 0] % 0.25) > 0.01  # the inner nodes are displaced from the straight lines
    fixed = np.zeros((len(mesh.nodes), 2), bool)
    fixed[mesh.column(0), 0] = True
    fixed[mesh.row(0), 1] = True
    solid = Solid(mesh, fixed)
    stretch = 1.3
    nominal = stretch - stretch**-3  # plane strain, free sides, mu = 1
    displacement = solve(
        solid, edge_forces(mesh, mesh.column(-1), lambda x: np.array([nominal, 0.0])), 1.0, 1e6, steps=2
    )
    expected = mesh.nodes * [stretch - 1, 1 / stretch - 1]
    assert displacement.displacement[0] == pytest.approx(expected, abs=2e-6)
    assert solid.stretch(displacement.displacement) == pytest.approx(stretch, rel=1e-5)


@pytest.mark.parametrize("principal", [(1.3, 0.8), (0.8, 1.3), (1.2, 1.1), (0.9, 0.8)])
def test_the_largest_stretch_does_not_depend_on_its_direction(principal):
    mesh = mapped_mesh(2, 2, lambda s, t: (s, t))
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    gradient = turn @ np.diag(principal) @ turn.T @ turn
    solid = Solid(mesh, np.zeros((len(mesh.nodes), 2), bool))
    displacement = mesh.nodes @ (gradient - np.eye(2)).T
    assert solid.stretch(displacement[None]) == pytest.approx(max(principal))
