"""Profiles of grey values across an edge are sampled exactly, and the fitted step has the right position and blur."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import erf

from eimi_lab.vision.edges.curve import SmoothCurve
from eimi_lab.vision.edges.profiles import fit_steps, read_profiles, sample, stations
from eimi_lab.vision.edges.uneven_light import light_along
from eimi_lab.vision.intensity import full_scale, grey, state_mean


@given(st.floats(-3.0, 14.0), st.floats(-3.0, 11.0))
def test_bilinear_sampling_is_exact_on_a_bilinear_image(x, y):
    row, column = np.mgrid[:10, :13].astype(float)
    image = 3.0 + 2.0 * column - row + 0.5 * row * column
    x_in, y_in = np.clip(x, 0, 12), np.clip(y, 0, 9)
    expected = 3.0 + 2.0 * x_in - y_in + 0.5 * x_in * y_in
    assert sample(image, np.array([x, y])) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1)])
def test_an_image_one_pixel_wide_is_sampled(shape):
    assert sample(np.full(shape, 7, dtype=np.uint8), np.array([[0.3, 0.6], [9.0, 9.0]])) == pytest.approx([7.0, 7.0])


def step_profiles(u, offset, dark, bright, blur):
    rise = 0.5 * (1 + erf((u - offset[:, None]) / (np.sqrt(2) * blur)))
    return dark[:, None] + (bright - dark)[:, None] * rise


@given(st.integers(0, 2**32 - 1), st.floats(0.6, 3.0))
def test_the_step_fit_recovers_the_parameters_of_the_profiles(seed, blur):
    rng = np.random.default_rng(seed)
    u = stations(12.0, 12.0)
    offset, dark = rng.uniform(-1.5, 1.5, 20), rng.uniform(2, 60, 20)
    bright = dark + rng.uniform(80, 190, 20)
    steps = fit_steps(u, step_profiles(u, offset, dark, bright, blur))
    assert steps.sound.all()
    assert steps.blur_px == pytest.approx(blur, rel=1e-3)
    np.testing.assert_allclose(steps.offset_px, offset, atol=1e-3)
    np.testing.assert_allclose(steps.dark, dark, atol=0.05)
    np.testing.assert_allclose(steps.bright, bright, atol=0.05)


def test_the_sensitivity_is_the_scatter_for_independent_noise():
    rng = np.random.default_rng(1)
    u = stations(6.0, 6.0)
    ones = np.ones(4000)
    clean = step_profiles(u, 0 * ones, 10 * ones, 200 * ones, 1.2)
    steps = fit_steps(u, clean + rng.normal(0, 2.0, clean.shape))
    assert steps.offset_px.std() == pytest.approx((steps.sensitivity * 2.0).mean(), rel=0.05)


def test_one_dirty_profile_does_not_change_the_blur():
    u = stations(8.0, 8.0)
    ones = np.ones(30)
    profiles = step_profiles(u, 0 * ones, 10 * ones, 200 * ones, 1.0)
    profiles[3] = 10 + 190 * (u > -5) - 150 * (u > 3)
    assert fit_steps(u, profiles).blur_px == pytest.approx(1.0, rel=1e-3)


def test_flat_and_falling_profiles_do_not_count_as_edges():
    u = stations(5.0, 5.0)
    flat, falling = np.full(len(u), 80.0), np.linspace(200.0, 10.0, len(u))
    steps = fit_steps(u, np.array([flat, falling]))
    assert not steps.sound.any()
    assert np.isfinite(steps.blur_px)


@given(st.floats(0.0, 360.0), st.floats(-0.002, 0.002))
def test_the_light_along_profiles_has_the_slope_of_the_light_beside_them(direction_deg, slope):
    # The back-light changes linearly, and dirt disturbs one profile in five.
    normal = np.array([np.cos(np.deg2rad(direction_deg)), np.sin(np.deg2rad(direction_deg))])
    x, y = np.meshgrid(np.arange(200.0), np.arange(200.0))
    image = 100.0 * (1.0 + slope * ((x - 100.0) * normal[0] + (y - 100.0) * normal[1]))
    points = 100.0 + 2.0 * (np.arange(30) - 15.0)[:, None] * np.array([-normal[1], normal[0]])
    for dirty in points[::5] + 15.0 * normal:
        image[int(dirty[1]), int(dirty[0])] = 0.0
    u = stations(7.0, 7.0)
    light = light_along(image, points[:, None], np.tile(normal, (30, 1, 1)), u, [30])
    np.testing.assert_allclose(light, np.tile(1.0 + slope * u, (30, 1)), atol=0.004)


def test_the_light_counts_as_even_if_the_picture_ends_beside_the_profiles():
    points, normals = np.full((3, 1, 2), 10.0), np.tile([1.0, 0.0], (3, 1, 1))
    light = light_along(np.full((20, 20), 50.0), points, normals, stations(7.0, 7.0), [3])
    np.testing.assert_array_equal(light, 1.0)


def test_profiles_that_leave_the_image_are_marked():
    line = np.array([[[10.0, 10.0]], [[2.0, 10.0]]])
    normal = np.tile([1.0, 0.0], (2, 1, 1))
    _, inside = read_profiles(np.zeros((20, 20), dtype=np.uint8), line, normal, stations(5.0, 5.0))
    assert inside.tolist() == [True, False]


def test_a_curve_through_points_of_a_circle_has_its_length_and_tangents():
    angle = np.linspace(0.0, 1.5, 60)
    curve = SmoothCurve(200.0 * np.column_stack([np.cos(angle), np.sin(angle)]), 8)
    assert curve.length == pytest.approx(300.0, abs=0.01)
    points, tangents = curve.at(np.array([[0.0, 100.0], [200.0, 300.0]]))
    np.testing.assert_allclose(np.linalg.norm(points, axis=-1), 200.0, atol=0.01)
    np.testing.assert_allclose((points * tangents).sum(axis=-1), 0.0, atol=0.1)
    beyond, tangent = curve.at(np.array([300.0, 310.0]))
    np.testing.assert_allclose(beyond[1] - beyond[0], 10.0 * tangent[0], atol=1e-6)


def test_the_grey_value_is_the_value_of_the_brightest_channel():
    image = np.zeros((8, 8, 3), dtype=np.uint8)
    image[..., 2] = 200
    assert grey(image).tolist() == [[200] * 8] * 8
    assert grey(image).dtype == np.uint8


@pytest.mark.parametrize("array", [np.zeros(5), np.zeros((2, 2, 2, 2)), np.zeros((0, 4, 3)), 3.0])
def test_an_array_that_is_no_image_has_no_grey_values(array):
    with pytest.raises(ValueError, match="should have the shape"):
        grey(array)


@pytest.mark.parametrize(("brightest", "scale"), [(0, 255), (255, 255), (256, 1023), (4095, 4095), (65535, 65535)])
def test_full_scale_is_that_of_the_smallest_bit_depth_that_contains_the_image(brightest, scale):
    assert full_scale(np.array([[brightest]])) == scale


def test_the_mean_of_a_state_keeps_bit_depth_and_colours():
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 4096, (5, 6, 7), dtype=np.uint16)
    np.testing.assert_allclose(state_mean(frames), frames.mean(axis=0), rtol=1e-6)
    colour = rng.integers(0, 256, (5, 6, 7, 3), dtype=np.uint8)
    np.testing.assert_allclose(state_mean(colour), colour.mean(axis=0), rtol=1e-6)
    with pytest.raises(ValueError, match="at least one frame"):
        state_mean([])
    with pytest.raises(ValueError, match="frame 1 has the shape"):
        state_mean([np.zeros((4, 4)), np.zeros((4, 5))])
