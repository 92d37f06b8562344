"""The bending under each load agrees with exact results: the elastica, and a thick cylinder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import root

from eimi_fitting.beam.bending import Beam
from eimi_fitting.beam.element import Batch
from eimi_fitting.beam.equilibrium import Solid, SolidLoads, Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.mesh import mapped_mesh
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.pressure import FollowerPressure
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.specimen import STANDARD_GRAVITY, Magnet, PressureFace, Specimen
from eimi_fitting.laws import LAWS

NEO = LAWS["neo-hookean"]
MU = np.array([[0.05e6]])
LENGTH, WIDTH, DEPTH = 100.0, 1.0, 4.0
BENDING = 3 * 0.05 * WIDTH**3 / 12  # N mm² for each mm of depth, plane stress: E = 3 mu


def elastica(couple=None, dead=(0.0, 0.0), pressure=(0.0, 0.0, 0.0), force=(0.0, 0.0), end_couple=None):
    # Return rotation (rad), x and y (mm) at the tip of an inextensible elastic rod, clamped at 0.
    # Forces and moments are those for each mm of depth.
    # couple : moment for each mm of length (N/mm), a function of the rotation
    # dead : distributed force (x, y) in N/mm²
    # pressure : pressure (N/mm²) on the lower side, and the lengths (mm) between which it acts
    # force : force (x, y) at the tip (N/mm)
    # end_couple : moment at the tip (N), a function of the rotation
    p, first, last = pressure
    scale = np.array([BENDING / LENGTH, BENDING / LENGTH**2, BENDING / LENGTH**2])

    def integrate(clamp, share):
        y = np.concatenate([[0.0], clamp * scale, [0.0, 0.0]])
        for begin, end, acting in ((0.0, first, 0.0), (first, last, share * p), (last, LENGTH, 0.0)):
            if end <= begin:
                continue

            def slope(s, y, acting=acting):
                theta, moment, fx, fy = y[:4]
                c, sn = np.cos(theta), np.sin(theta)
                curvature = moment / BENDING
                push = acting * (1 + 0.5 * WIDTH * curvature)
                turning = fx * sn - fy * c - (share * couple(theta) if couple else 0.0)
                return [curvature, turning, push * sn - share * dead[0], -push * c - share * dead[1], c, sn]

            y = solve_ivp(slope, (begin, end), y, rtol=1e-9, atol=1e-12).y[:, -1]
        return y

    def miss(clamp, share):
        y = integrate(clamp, share)
        return (y[1:4] - share * np.array([end_couple(y[0]) if end_couple else 0.0, *force])) / scale

    clamp = np.zeros(3)
    for share in np.linspace(0.2, 1.0, 5):
        solution = root(miss, clamp, (share,), tol=1e-8)
        assert solution.success
        clamp = solution.x
    y = integrate(clamp, 1.0)
    return np.array([y[0], y[4], y[5]])


def beam(loads, **specimen):
    # Return (rotation, x, y) at the tip of a slender plane-stress beam under `loads` (rad and mm).
    model = BeamModel(Specimen(LENGTH, WIDTH, DEPTH, specimen.pop("density", 0.0), "plane-stress", **specimen), 40, 1)
    shapes = model.solve(NEO, MU, loads, tolerance_mm=1e-7)
    assert shapes.converged[0]
    return np.array(
        [np.radians(model.tip_angle_deg(shapes)[0, -1]), *model.positions(shapes, [[LENGTH, 0.0]])[0, -1, 0]]
    )


def check(computed, exact, accuracy=1e-3):
    # Assert that (rotation, x, y) of the tip agree with the exact solution.
    assert abs(exact[0]) > 0.3  # a large deflection
    assert computed[0] == pytest.approx(exact[0], rel=accuracy)
    assert computed[1:] == pytest.approx(exact[1:], abs=accuracy * LENGTH)


@pytest.mark.parametrize(("start", "stop", "strength"), [(0.0, LENGTH, 16.0), (30.0, 77.7, 26.0)])
def test_a_pressure_follows_its_face(start, stop, strength):
    p = strength * BENDING / LENGTH**3
    loads = Loads.along(np.zeros(6), gravity_angle_deg=None, pressure_Pa=1e6 * np.linspace(0, p, 6))
    left, right = (beam(loads, pressure_face=PressureFace(side, start, stop)) for side in ("left", "right"))
    check(left, elastica(pressure=(p, start, stop)))
    assert right == pytest.approx(left * [-1, 1, -1], rel=1e-6)


@pytest.mark.parametrize(("angle", "direction"), [(30.0, 0.0), (150.0, 0.0), (100.0, 40.0)])
def test_magnetised_silicone_in_an_oblique_field_agrees_with_the_elastica(angle, direction):
    field, strength = np.radians(angle), 6 * BENDING / (WIDTH * LENGTH**2)  # magnetisation times field, N/mm²
    at_rest = np.radians(direction)
    flux = 0.02
    magnetisation = 1e6 * strength / flux * np.array([np.cos(at_rest), np.sin(at_rest)])
    computed = beam(
        Loads.along(1e3 * np.linspace(0, flux, 6), angle, None), magnetisation_A_per_m=tuple(map(float, magnetisation))
    )
    check(computed, elastica(couple=lambda theta: strength * WIDTH * np.sin(field - theta - at_rest)), 2e-3)


@pytest.mark.parametrize("angle", [30.0, 120.0])
def test_a_magnet_in_an_oblique_field_agrees_with_the_elastica(angle):
    magnet = Magnet(1e-2, WIDTH, DEPTH, 1.0, 1.0)  # so small that the magnet is like a point at the tip
    moment = 2.5 * BENDING / LENGTH  # moment times field, N mm for each mm of depth
    flux = moment * DEPTH / (1e3 * magnet.moment_A_m2)
    computed = beam(Loads.along(1e3 * np.linspace(0, flux, 6), angle, None), magnet=magnet)
    check(computed, elastica(end_couple=lambda theta: moment * np.sin(np.radians(angle) - theta)))


@pytest.mark.parametrize("angle", [50.0, -130.0])
def test_oblique_gravity_agrees_with_the_elastica(angle):
    down = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    weight = 12 * BENDING / LENGTH**3
    density = weight / (1e-9 * STANDARD_GRAVITY * WIDTH)
    computed = beam(Loads.along(0.0, gravity_angle_deg=angle), density=density)
    check(computed, elastica(dead=weight * down))


@pytest.mark.parametrize(("angle", "place"), [(70.0, None), (110.0, (LENGTH, 0.5 * WIDTH))])
def test_an_oblique_eccentric_tip_force_agrees_with_the_elastica(angle, place):
    force = 3 * BENDING / LENGTH**2
    down = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    loads = Loads.along(0.0, gravity_angle_deg=angle, tip_force_N=force * DEPTH)
    arm = 0.0 if place is None else place[1]

    def couple(theta):  # the lever arm turns with the tip
        return arm * force * (-np.sin(theta) * down[1] - np.cos(theta) * down[0])

    check(beam(loads, tip_load_mm=place), elastica(force=force * down, end_couple=couple))


@pytest.mark.parametrize("section", ["plane-stress", "solid"])
@pytest.mark.parametrize(("beyond_face", "across"), [(0.0, 0.0), (4.0, 0.0), (2.0, 1.0)])
def test_a_tip_force_on_a_magnet_acts_with_its_lever_arm(section, beyond_face, across):
    # At the inner face of the magnet, F turns the tip by F l² / (2 E I), with the flexible length l; at another point
    # the moment F times its lever arm is added.
    magnet, free = Magnet(4.0, 3.0, 5.0, 1.0, 7500.0), 26.0
    specimen = Specimen(30.0, 3.0, 5.0, 1070.0, section, magnet, (free + beyond_face, across))
    stiffness = 3 * 46e3 * 1e-6 * 5.0 * 3.0**3 / 12  # E I in N mm2
    for angle, moment in ((90.0, beyond_face), (0.0, -across)):
        force = 1e-5  # N, so small that the response is linear
        loads = Loads.along(0.0, gravity_angle_deg=None, tip_force_N=force, tip_force_angle_deg=angle)
        turn = Beam(specimen, 20, 2).solve("neo-hookean", [46e3], loads).tip_angle_deg[0]
        exact = (force * free**2 / 2 * np.sin(np.radians(angle)) + force * moment * free) / stiffness
        assert turn == pytest.approx(np.degrees(exact), rel=0.03, abs=1e-4)  # the clamp stiffens the solid by 2.5 %


def test_a_tip_force_on_a_beam_with_a_cast_bend_acts_at_the_end_of_its_centre_line():
    straight = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", tip_load_mm=(30.0, 0.0))
    bent = with_modes(straight, (3.0,))
    loads = Loads.along(0.0, gravity_angle_deg=None, tip_force_N=1e-3, tip_force_angle_deg=90.0)
    at_point, at_tip = (
        Beam(specimen, 13, 1).solve("neo-hookean", [46e3], loads).tip_angle_deg[0]
        for specimen in (bent, replace(bent, tip_load_mm=None))
    )
    assert at_point > 1
    assert at_point == pytest.approx(at_tip, rel=1e-9)


def cylinder(n):
    # Return a mesh (n elements across the wall) of a quarter cylinder of radii 1 and 2, and an inner pressure.
    mesh = mapped_mesh(
        2 * n, n, lambda s, t: ((1 + t) * np.cos(np.pi / 2 * (1 - s)), (1 + t) * np.sin(np.pi / 2 * (1 - s)))
    )
    fixed = np.zeros((len(mesh.nodes), 2), bool)
    fixed[mesh.column(0), 0] = fixed[mesh.column(-1), 1] = True
    return Solid(mesh, fixed, face=FollowerPressure(mesh, mesh.row(0)))


@pytest.mark.parametrize(("stretch", "pressure"), [(1.1, 0.131562), (1.5, 0.428228), (2.0, 0.574054), (3.0, 0.660417)])
def test_a_thick_cylinder_under_pressure_agrees_with_the_exact_solution(stretch, pressure):
    # p/mu = ln(la/lb) + (lb^-2 - la^-2)/2 with A = 1, B = 2 (Ogden, Non-linear Elastic Deformations, 5.3.3).
    solid = cylinder(3)
    batch, now = Batch(NEO, np.array([[1.0]]), "plane-strain", np.array([1e6])), solid.rest(1)
    for p in np.linspace(0, pressure, 7)[1:]:
        nothing = np.zeros((1, len(solid.mesh.nodes), 2))
        loads = SolidLoads(nothing, np.zeros((1, 2)), np.zeros((1, 2, 2)), np.array([p]), np.zeros(1))
        now, status, _ = solid.equilibrium(batch, loads, now, 1e-9)
        assert status[0] == Status.CONVERGED
    radius = np.linalg.norm(solid.mesh.nodes + now.displacement[0], axis=1)[solid.mesh.row(0)]
    assert radius == pytest.approx(stretch, rel=2e-4)


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_the_tangent_of_the_pressure_is_the_derivative_of_its_forces(seed):
    rng = np.random.default_rng(seed)
    face = cylinder(1).face
    e = 2

    def forces(nodal):
        force, stiffness = np.zeros((e, 1, 18)), np.zeros((e, 1, 18, 18))
        face.press(np.array([0.7]), nodal, force, stiffness)
        return force[:, 0], stiffness[:, 0]

    nodal, h = rng.normal(0, 0.3, (e, 1, 18)), 1e-6
    _, tangent = forces(nodal)
    assert np.abs(tangent - tangent.swapaxes(-1, -2)).max() > 0.01  # the exact tangent is not symmetric
    for i in range(18):
        step = h * np.eye(18)[i]
        difference = (forces(nodal + step)[0] - forces(nodal - step)[0]) / (2 * h)
        assert tangent[:, :, i] == pytest.approx(difference, abs=1e-6)


def test_newtons_method_with_a_pressure_converges_quadratically():
    p = 16 * BENDING / LENGTH**3
    specimen = Specimen(LENGTH, WIDTH, DEPTH, 0.0, "plane-stress", pressure_face=PressureFace("left"))
    model = BeamModel(specimen, 40, 1)
    loads = Loads.along(0.0, gravity_angle_deg=None, pressure_Pa=1e6 * p)
    start = model.solve(NEO, MU, loads, tolerance_mm=1e-9)
    nearby = Loads.along(0.0, gravity_angle_deg=None, pressure_Pa=1.001e6 * p)
    # The start is 0.5 mm away: three steps with quadratic convergence reach 1 nm, linear convergence would not.
    assert model.solve(NEO, MU, nearby, tolerance_mm=1e-6, start=start.last).iterations[0, 0] <= 4


def test_pressure_at_the_sides_of_a_full_width_magnet_is_refused():
    magnet = Magnet(4.0, 3.0, 3.0, 1.0, 7500.0)
    specimen = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", magnet, pressure_face=PressureFace("right"))
    with pytest.raises(ValueError, match="not on a face of the silicone"):
        BeamModel(specimen)


def test_several_directions_of_a_tip_force_are_several_states():
    loads = Loads.along(0.0, tip_force_N=0.01, tip_force_angle_deg=[0, 90, 180])
    assert len(loads) == len(loads.gravity) == len(loads.actuations[0].numbers) == 3
    assert loads.tip_force_N == pytest.approx(0.01 * np.array([[1, 0], [0, 1], [-1, 0]]))
    one = Loads.along([0.0, 1.0], tip_force_N=0.01, tip_force_angle_deg=90.0)
    assert one.tip_force_N == pytest.approx(np.array([[0, 0.01], [0, 0.01]]))


def test_selected_states_keep_their_pressure():
    loads = Loads.along(np.arange(4.0), pressure_Pa=10.0 * np.arange(4.0))
    assert loads.take(np.array([3, 1])).state(0) == pytest.approx(loads.state(3))
    assert Loads.along(np.arange(4.0), pressure_Pa=5.0).take(np.array([3, 1])).state(1)[-1] == 5.0


def test_a_pressure_without_a_face_is_refused():
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress"), 4, 1)
    loads = Loads.along([1.0], pressure_Pa=100.0)
    with pytest.raises(ValueError, match="has no pressure_face"):
        model.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads)
