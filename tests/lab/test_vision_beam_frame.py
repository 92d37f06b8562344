"""The map between pixels and the beam frame (x along the beam, y across, in mm) is right for every mounting."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eimi_lab.config.calibration import Calibration
from eimi_lab.vision.beam_frame import BeamFrame


def calibration(axis=90.0, field=0.0, gravity=90.0, **more):
    return Calibration(
        pixels_per_mm=more.pop("pixels_per_mm", 25.0),
        coil_constant_mT_per_A=4.7,
        clamp_midpoint_px=more.pop("clamp_midpoint_px", (400.0, 100.0)),
        axis_angle_deg=axis,
        gravity_angle_deg=gravity,
        field_angle_deg=field,
        **more,
    )


def test_x_points_down_and_y_along_the_field_for_a_hanging_beam():
    frame = BeamFrame(calibration())
    np.testing.assert_allclose(frame.to_mm([[400, 100], [400, 350], [425, 100]]), [[0, 0], [10, 0], [0, 1]], atol=1e-9)
    assert frame.gravity_deg == pytest.approx(0.0)
    assert frame.field_deg == pytest.approx(90.0)


def test_y_points_to_the_left_if_the_field_points_to_the_left():
    frame = BeamFrame(calibration(field=180.0))
    np.testing.assert_allclose(frame.to_mm([[425, 350]]), [[10, -1]], atol=1e-9)
    assert frame.field_deg == pytest.approx(90.0)


def test_the_angle_of_gravity_is_measured_from_x_toward_y_in_right_and_left_handed_frames():
    # The beam points to the right; gravity points down in the image, and the field up or down.
    assert BeamFrame(calibration(axis=0.0, field=90.0)).gravity_deg == pytest.approx(90.0)
    assert BeamFrame(calibration(axis=0.0, field=-90.0)).gravity_deg == pytest.approx(-90.0)


@given(
    axis=st.floats(-180, 180),
    across=st.floats(31, 149),
    mirrored=st.booleans(),
    gravity=st.floats(-180, 180),
    x=st.floats(-50, 50),
    y=st.floats(-50, 50),
)
def test_pixels_are_recovered_from_the_beam_frame_and_directions_agree(axis, across, mirrored, gravity, x, y):
    field = axis + (-across if mirrored else across)
    frame = BeamFrame(calibration(axis=axis, field=(field + 180) % 360 - 180, gravity=gravity))
    np.testing.assert_allclose(frame.to_mm(frame.to_px([[x, y]])), [[x, y]], atol=1e-9)

    def direction(degrees):
        return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])

    # A step along gravity or the field in the image is a step along gravity_deg or field_deg in the beam frame.
    start = np.array([400.0, 100.0])
    for in_image, in_beam in ((gravity, frame.gravity_deg), (field, frame.field_deg)):
        np.testing.assert_allclose(frame.to_mm([start + 25 * direction(in_image)])[0], direction(in_beam), atol=1e-9)
    assert frame.field_deg > 0  # the field has a component toward +y


MATRIX = ((1500.0, 0.0, 640.0), (0.0, 1500.0, 512.0), (0.0, 0.0, 1.0))
DISTORTION = (-0.2, 0.08, 0.001, -0.002, 0.0)


def test_pixels_are_recovered_through_the_lens_distortion():
    frame = BeamFrame(calibration(camera_matrix=MATRIX, distortion=DISTORTION))
    points = np.column_stack([np.linspace(0, 32, 20), np.linspace(-12, 20, 20)])
    pixels = frame.to_px(points)
    np.testing.assert_allclose(frame.to_mm(pixels), points, atol=1e-6)
    np.testing.assert_allclose(frame.to_px([[0.0, 0.0]]), [[400.0, 100.0]], atol=1e-5)
    line = np.polyfit(pixels[:, 0], pixels[:, 1], 1)
    assert (
        np.abs(np.polyval(line, pixels[:, 0]) - pixels[:, 1]).max() > 1.0
    )  # a line that is straight in space and bent in the image


def test_the_lens_distortion_is_that_of_the_documented_model():
    # OpenCV, "Camera Calibration and 3D Reconstruction": x'' = x'(1 + k1 r2 + k2 r4) + 2 p1 x'y' + p2 (r2 + 2 x'2), …
    k1, k2, p1, p2, _ = DISTORTION
    x, y = 60.0 / 1500.0, 88.0 / 1500.0
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2
    distorted_px = [
        640.0 + 1500.0 * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)),
        512.0 + 1500.0 * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y),
    ]
    frame = BeamFrame(calibration(camera_matrix=MATRIX, distortion=DISTORTION, clamp_midpoint_px=(640.0, 512.0)))
    np.testing.assert_allclose(frame.to_mm([distorted_px]), [[88.0 / 25.0, 60.0 / 25.0]], atol=1e-6)


def test_empty_arrays_of_points_stay_empty():
    frame = BeamFrame(calibration())
    assert frame.to_mm(np.zeros((0, 2))).shape == (0, 2)
    assert frame.to_px(np.zeros((0, 2))).shape == (0, 2)


def test_the_optical_axis_passes_through_the_principal_point() -> None:
    # Without a camera matrix, the axis passes through the image centre.
    matrix = ((2000.0, 0.0, 700.0), (0.0, 2000.0, 430.0), (0.0, 0.0, 1.0))
    lens = {"telecentric": False, "stand_off_mm": 200.0}
    with_matrix = BeamFrame(calibration(camera_matrix=matrix, distortion=DISTORTION, **lens))
    view = with_matrix.view(5.0, (1280, 1024))
    assert view is not None
    np.testing.assert_allclose(with_matrix.to_px(view.centre_mm), [[700.0, 430.0]], atol=1e-6)
    without_matrix = BeamFrame(calibration(**lens))
    view = without_matrix.view(5.0, (1280, 1024))
    assert view is not None
    np.testing.assert_allclose(without_matrix.to_px(view.centre_mm), [[639.5, 511.5]], atol=1e-6)
