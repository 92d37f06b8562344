"""The perspective of a tilted camera agrees with a pinhole camera that is rotated in space."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from eimi_fitting.beam.view import View

CENTRE_MM, STAND_OFF_MM = np.array([15.0, 4.0]), 180.0
PLACES = np.random.default_rng(3).uniform([-5.0, -20.0, -4.0], [45.0, 30.0, 4.0], (40, 3))
RULER_MM = np.array([[2.0, -18.0], [48.0, -19.0]])


def pinhole(places: np.ndarray, tilt_deg: tuple[float, float]) -> np.ndarray:
    # Return the image of n points by a tilted pinhole camera, (n, 2): x and y in mm at the distance STAND_OFF_MM.
    # places : the points in mm, shape (n, 3): right, down and away from the camera
    # tilt_deg : rotations that bring the right side and the lower side nearer
    along, across = np.radians(tilt_deg)
    turn = cv2.Rodrigues(np.array([-across, along, 0.0]))[0]
    in_camera = (places - [*CENTRE_MM, 0.0]) @ turn.T + [0.0, 0.0, STAND_OFF_MM]
    return np.asarray(STAND_OFF_MM * in_camera[:, :2] / in_camera[:, 2:])


@pytest.mark.parametrize("tilt_deg", [(3.0, 0.0), (0.0, -5.0), (-2.0, 6.0), (0.0, 0.0)])
def test_a_tilted_view_is_that_of_a_turned_pinhole_camera(tilt_deg: tuple[float, float]) -> None:
    view = View(CENTRE_MM, STAND_OFF_MM, tilt_deg)
    clamp = pinhole(np.zeros((1, 3)), tilt_deg)
    assert view.seen(PLACES) == pytest.approx(pinhole(PLACES, tilt_deg) - clamp, abs=1e-9)
    with_ruler = View(CENTRE_MM, STAND_OFF_MM, tilt_deg, RULER_MM)
    first, second = with_ruler.seen(np.column_stack([RULER_MM, np.zeros(2)]))
    assert second - first == pytest.approx(RULER_MM[1] - RULER_MM[0], abs=1e-9)
    assert with_ruler.seen(np.zeros((1, 3))) == pytest.approx(np.zeros((1, 2)), abs=1e-12)
