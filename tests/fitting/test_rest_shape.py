"""Beams that are curved, tapered or stepped at rest have the stated geometry and bend as in beam theory."""

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.rest_shape import RestShape, centre_line
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.strip import ImpossibleShape, Strip

NEO, MU = LAWS["neo-hookean"], np.array([[46e3]])
YOUNG_PA = 3 * MU[0, 0]
LENGTH, WIDTH, DEPTH = 60.0, 2.0, 3.0
STRIP = Specimen(LENGTH, WIDTH, DEPTH, 0.0, "plane-stress")
MAGNETIC = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 2.0, 2.0, 1.2, 7500.0, 1.0))
FINGER = replace(
    with_modes(MAGNETIC, (1.0, 0.3, -0.2), (0.1, 0.05)),
    section="solid",
)


def pushed(specimen: Specimen, force_N: float, along: int = 30) -> np.ndarray:
    # Return the displacement (x, y) of the middle of the tip in mm, shape (2,), under a small force along y.
    model = BeamModel(specimen, along, 3)
    loads = Loads.along([0.0], 90.0, None, tip_force_N=[force_N], tip_force_angle_deg=90.0)
    shapes = model.solve(NEO, MU, loads, tolerance_mm=1e-8)
    return model.displacements(shapes, np.array([[specimen.length_mm, 0.0]]))[0, 0, 0]


@pytest.mark.parametrize(("at_clamp", "at_tip"), [(2.4, 1.6), (3.0, 1.0)])
def test_a_tapered_cantilever_deflects_as_an_euler_bernoulli_beam(at_clamp, at_tip):
    middle = 0.5 * (at_clamp + at_tip)
    shape = RestShape(widths=((0.0, at_clamp - middle), (1.0, at_tip - middle)))
    x, force_N = np.linspace(0, LENGTH, 20001), 1e-6
    second_moment = DEPTH * (at_clamp + (at_tip - at_clamp) * x / LENGTH) ** 3 / 12
    expected = np.trapezoid(force_N * (LENGTH - x) ** 2 / (1e-6 * YOUNG_PA * second_moment), x)
    deflection = pushed(replace(STRIP, width_mm=middle, rest_shape=shape), force_N)[1]
    assert deflection == pytest.approx(expected, rel=1e-3)


def test_a_cantilever_of_decreasing_depth_deflects_as_an_euler_bernoulli_beam():
    shape, force_N = RestShape(depths=((0.0, 0.5), (1.0, -0.5))), 1e-6
    x = np.linspace(0, LENGTH, 20001)
    second_moment = (DEPTH + 0.5 - x / LENGTH) * WIDTH**3 / 12
    expected = np.trapezoid(force_N * (LENGTH - x) ** 2 / (1e-6 * YOUNG_PA * second_moment), x)
    assert pushed(replace(STRIP, rest_shape=shape), force_N)[1] == pytest.approx(expected, rel=1e-3)


def test_a_quarter_of_a_circle_deflects_as_castiglianos_theorem_predicts():
    radius, width, force_N = 60.0, 1.0, 2e-9
    shape = RestShape(turns=tuple((s, 0.5 * np.pi * s) for s in np.linspace(0, 1, 9)))
    quarter = replace(STRIP, length_mm=0.5 * np.pi * radius, width_mm=width, rest_shape=shape)
    a = np.linspace(0, 0.5 * np.pi, 4001)
    arm = radius * (1 - np.sin(a))
    stiffness = 1e-6 * YOUNG_PA * DEPTH * width**3 / 12  # N mm²
    along_y = np.trapezoid(force_N * arm * arm * radius, a) / stiffness
    along_x = -np.trapezoid(force_N * arm * radius * np.cos(a) * radius, a) / stiffness
    assert pushed(quarter, force_N, 40) == pytest.approx([along_x, along_y], rel=2e-3)


def test_a_point_of_the_straight_strip_is_recovered_from_its_position_in_the_shape_at_rest():
    strip, rng = Strip(FINGER), np.random.default_rng(1)
    points = np.column_stack([rng.uniform(0, 30, 200), rng.uniform(-0.5, 0.5, 200) * strip.straight.width_mm])
    assert strip.straightened(strip.at_rest(points)) == pytest.approx(points, abs=1e-9)


def test_a_point_beside_a_curved_strip_is_moved_to_its_edge():
    strip = Strip(FINGER)
    half = 0.5 * strip.straight.width_mm
    straight = np.array([[10.0, half], [25.0, -half], [20.0, 0.2 * half]])
    beside = strip.at_rest(straight * [1.0, 1.2])
    beside[2] = strip.at_rest(straight)[2]  # a point of the strip stays where it is
    assert strip.nearest(beside) == pytest.approx(strip.at_rest(straight), abs=1e-6)


def test_a_mode_of_bending_moves_the_centre_line_by_its_amplitude():
    strip = Strip(with_modes(STRIP, (1.0,)))
    along = np.linspace(0, LENGTH, 7)
    centre = strip.at_rest(np.column_stack([along, np.zeros(7)]))
    assert centre[:, 1] == pytest.approx((along / LENGTH) ** 2, abs=1e-3)
    widths = Strip(with_modes(STRIP, (), (0.1,))).width_mm(along)
    assert widths == pytest.approx(WIDTH - 0.1 + 0.2 * along / LENGTH, abs=1e-12)


def test_the_magnet_stays_a_straight_block_in_a_bent_and_tapered_beam():
    strip = Strip(replace(FINGER, rest_shape=replace(FINGER.rest_shape, widths=((0.0, 0.5), (1.0, -0.5)))))
    near, far = FINGER.flexible_length_mm, FINGER.flexible_length_mm + 4.0
    corners = strip.at_rest(np.array([[near, -1.0], [far, -1.0], [far, 1.0], [near, 1.0]]))
    sides = np.diff(np.concatenate([corners, corners[:1]]), axis=0)
    assert np.linalg.norm(sides, axis=1) == pytest.approx([4.0, 2.0, 4.0, 2.0])
    assert np.sum(sides[:-1] * sides[1:], axis=1) == pytest.approx(0, abs=1e-6)


def test_a_bent_beam_has_the_same_shape_from_load_steps_and_from_its_planar_model():
    loads = Loads.along([0.0, 2.0])
    beside, solid = SolidBeside(FINGER, 10, 2), SolidModel(FINGER, 10, 2)
    from_plane = beside.tip_angle_deg(beside.solve(NEO, MU, loads, tolerance_mm=1e-5))
    followed = solid.tip_angle_deg(solid.solve(NEO, MU, loads))
    assert from_plane == pytest.approx(followed, abs=1e-3)
    assert abs(followed[0, 0]) > 1  # the weight straightens the beam


def test_points_of_a_centre_line_give_its_angles():
    angles = np.linspace(0, 0.5, 12)
    points = 60.0 * np.column_stack([np.sin(angles), 1 - np.cos(angles)])
    shape = RestShape(turns=centre_line(points, 30.0))
    assert shape.angle_rad(np.array([0.0, 0.5, 1.0])) == pytest.approx([0.0, 0.25, 0.5], abs=2e-3)


@pytest.mark.parametrize("turn_deg", [-190.0, 170.0, 540.0])
def test_the_tip_of_a_strongly_bent_beam_rotates_without_jumps(turn_deg):
    shape = RestShape(turns=tuple((s, np.radians(turn_deg) * s) for s in np.linspace(0, 1, 9)))
    model = BeamModel(replace(STRIP, length_mm=120.0, rest_shape=shape), 12, 1)
    loads = Loads.along(np.zeros(5), 90.0, None, tip_force_N=np.linspace(-3e-5, 3e-5, 5), tip_force_angle_deg=90.0)
    rotation_deg = model.tip_angle_deg(model.solve(NEO, MU, loads))[0]
    assert rotation_deg[2] == pytest.approx(0, abs=1e-6)
    assert 1 < np.abs(rotation_deg).max() < 60
    assert rotation_deg[0] * rotation_deg[4] < 0


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([[0, 0], [10, 0], [30, 0]], "at least 4 points"),
        ([[5, 0], [10, 0], [20, 0], [30, 0]], "should begin at the clamp"),
        ([[0, 0], [10, 0], [10, 0], [30, 0]], "are the same"),
        ([[0, 0], [10, 0], [20, 0], [25, 0]], "25 mm long, but the beam has length_mm = 30"),
    ],
)
def test_an_impossible_centre_line_of_the_beam_is_refused(points, words):
    with pytest.raises(ValueError, match=words):
        centre_line(np.array(points, float), 30.0)


def test_a_step_is_a_ramp_that_ends_on_lines_of_the_mesh():
    shape = RestShape(widths=((0.0, 0.0), (0.8, 0.0), (0.8, 3.0), (1.0, 3.0)))
    grid = BeamModel(replace(MAGNETIC, magnet=Magnet(3.0, 2.0, 2.0, 1.2, 7500.0, 1.0), rest_shape=shape), 10).grid
    assert np.abs(grid.x_mm[:, None] - [24.0, 24.3]).min(axis=0) == pytest.approx(0, abs=1e-9)
    assert grid.strip.width_mm(np.array([23.9, 24.4])) == pytest.approx([3.0, 6.0])


@pytest.mark.parametrize("rib_mm", [4.0, 1.5, 1.0])
def test_the_steps_of_a_narrow_rib_do_not_cross(rib_mm):
    near, far = 30.0 - 0.5 * rib_mm, 30.0 + 0.5 * rib_mm
    rib = tuple((s / LENGTH, more) for s, more in ((0, 0), (near, 0), (near, 10), (far, 10), (far, 0), (LENGTH, 0)))
    model = BeamModel(replace(STRIP, rest_shape=RestShape(widths=rib)), 20, 3)
    strip, ramp = model.grid.strip, min(1.0, 0.4 * rib_mm)
    assert strip.kinks_mm == pytest.approx([near, near + ramp, far - ramp, far])
    along = np.array([near - 0.1, near + 0.5 * ramp, 30.0, far - 0.5 * ramp, far + 0.1])
    assert strip.width_mm(along) == pytest.approx([2.0, 7.0, 12.0, 7.0, 2.0])


@pytest.mark.parametrize(("at", "step_mm"), [(0.454, 4.0), (0.5151, 4.0), (0.5151, 8.0), (0.5151, -8.0)])
def test_a_small_taper_keeps_the_ramp_of_a_step(at, step_mm):
    more = (step_mm, 0.0) if step_mm > 0 else (0.0, -step_mm)
    shape = RestShape(widths=((0.0, more[0]), (at, more[0]), (at, more[1]), (1.0, more[1])))
    stepped = Specimen(40.0, 3.0, 5.0, 1070.0, section="plane-stress", rest_shape=shape)
    along = np.linspace(0, 40, 4001)
    change = Strip(with_modes(stepped, (), [0.005])).width_mm(along) - Strip(stepped).width_mm(along)
    assert 0.002 < np.abs(change).max() < 0.006


def test_a_width_that_decreases_to_zero_is_refused():
    with pytest.raises(ValueError, match="width_mm of the rest shape falls to"):
        BeamModel(replace(STRIP, rest_shape=RestShape(widths=((0.0, 0.0), (1.0, -2.5)))))


def test_a_bend_with_a_radius_below_half_the_width_is_refused():
    def turned(radius_mm: float) -> Specimen:
        # A beam that is bent in its middle third.
        turns = ((0.0, 0.0), (1 / 3, 0.0), (2 / 3, LENGTH / 3 / radius_mm))
        return replace(STRIP, width_mm=8.0, rest_shape=RestShape(turns=turns))

    assert Strip(turned(4.2)).straight.width_mm == 8.0
    with pytest.raises(ImpossibleShape, match=r"a radius of 3\.8 mm at .* above half the width, 4 mm"):
        Strip(turned(3.8))
