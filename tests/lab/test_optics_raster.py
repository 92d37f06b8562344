"""The drawing of polygons computes exactly which share of each pixel is covered."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eimi_lab.virtual.raster import coverage

place = st.floats(-20.0, 60.0)


def shoelace(polygon):
    x, y = polygon.T
    return 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def test_coverage_of_a_rectangle_is_exact_in_every_pixel():
    covered = coverage([[0.25, 0.5], [2.5, 0.5], [2.5, 1.75], [0.25, 1.75]], (5, 4))
    across = np.array(
        [0.25, 1.0, 1.0, 0.0, 0.0]
    )  # the interval 0.25 to 2.5 over the pixels -0.5 to 0.5, 0.5 to 1.5 and 1.5 to 2.5
    down = np.array([0.0, 1.0, 0.25, 0.0])
    np.testing.assert_allclose(covered, np.outer(down, across), atol=1e-12)


def test_a_pixel_that_is_cut_along_its_diagonal_is_half_covered():
    covered = coverage([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5]], (2, 2))
    np.testing.assert_allclose(covered, [[0.5, 0.0], [0.0, 0.0]], atol=1e-12)


@given(st.lists(st.tuples(place, place), min_size=3, max_size=3), st.booleans())
def test_the_area_of_any_triangle_inside_the_frame_is_exact(corners, turned):
    triangle = np.clip(np.array(corners), -0.5, 39.5)
    covered = coverage(triangle[::-1] if turned else triangle, (40, 40))
    assert covered.sum() == pytest.approx(shoelace(triangle), abs=1e-8)
    assert covered.min() >= 0.0
    assert covered.max() <= 1.0


@given(st.floats(0.0, 2 * np.pi), st.floats(-12.0, 12.0))
def test_coverage_by_a_half_plane_equals_the_mean_of_finer_pixels(angle, offset):
    normal = np.array([np.cos(angle), np.sin(angle)])
    along = np.array([-normal[1], normal[0]])
    foot = np.array([9.5, 7.0]) + offset * normal
    half_plane = np.array([foot + 99 * along, foot - 99 * along, foot - 99 * along - 99 * normal])
    half_plane = np.vstack([half_plane, foot + 99 * along - 99 * normal])
    coarse = coverage(half_plane, (20, 15))
    # Exact coverage is additive: the coverage of a pixel is the mean of its four quarters.
    fine = coverage((half_plane + 0.5) * 2.0 - 0.5, (40, 30))
    np.testing.assert_allclose(coarse, fine.reshape(15, 2, 20, 2).mean(axis=(1, 3)), atol=1e-9)
    # A pixel whose centre is farther from the line than half its diagonal lies completely on one side.
    y, x = np.mgrid[:15, :20]
    distance = (np.stack([x, y], axis=-1) - foot) @ normal
    np.testing.assert_allclose(coarse[distance > 0.71], 0.0, atol=1e-12)
    np.testing.assert_allclose(coarse[distance < -0.71], 1.0, atol=1e-12)


@given(st.integers(-3, 3), st.integers(-3, 3))
def test_shift_by_whole_pixels_shifts_the_image(right, down):
    star = np.array([[8.2, 4.1], [12.7, 9.3], [19.9, 8.8], [14.0, 13.1], [16.2, 20.5], [6.3, 15.7]])
    still = coverage(star, (28, 28))
    np.testing.assert_allclose(
        coverage(np.add(star, [right, down]), (28, 28)), np.roll(still, (down, right), axis=(0, 1)), atol=1e-12
    )


def test_a_polygon_may_leave_the_frame_or_lie_outside_it():
    np.testing.assert_allclose(coverage([[-1e7, -1e7], [1e7, -1e7], [1e7, 1e7], [-1e7, 1e7]], (6, 4)), 1.0)
    np.testing.assert_array_equal(coverage([[50, 50], [60, 50], [60, 60]], (6, 4)), 0.0)


@pytest.mark.parametrize("polygon", [[[0, 0], [1, 1]], [[0, 0], [1, np.nan], [2, 2]], [0, 1, 2]])
def test_an_outline_that_is_not_a_polygon_is_refused(polygon):
    with pytest.raises(ValueError, match="at least three vertices"):
        coverage(polygon, (4, 4))
