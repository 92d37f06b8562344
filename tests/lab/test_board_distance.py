"""The distance from a lens to a board is measured along the optical axis, wherever the board is in the picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from eimi_lab.vision.calibration.lens import Lens

FOCAL_PX = 4000.0
MATRIX = np.array([[FOCAL_PX, 0.0, 999.5], [0.0, FOCAL_PX, 749.5], [0.0, 0.0, 1.0]])
LENS = Lens(MATRIX, np.array([-0.1, 0.02, 0.0, 0.0, 0.0]), 10.0, 0.1)
BOARD = np.array([[4.0 * column, 4.0 * row] for row in range(5) for column in range(7)])


@pytest.mark.parametrize("aside_mm", [(0.0, 0.0), (30.0, 0.0), (-25.0, 18.0)])
@pytest.mark.parametrize("tilt_deg", [0.0, 25.0])
def test_the_distance_of_a_board_is_the_distance_of_its_midpoint_along_the_optical_axis(
    aside_mm: tuple[float, float], tilt_deg: float
) -> None:
    stand_off_mm = 150.0
    turn = cv2.Rodrigues(np.radians([tilt_deg, 0.5 * tilt_deg, 3.0]))[0]
    middle = np.append(BOARD.mean(axis=0), 0.0)
    shift = np.array([*aside_mm, stand_off_mm]) - turn @ middle
    on_board = np.column_stack([BOARD, np.zeros(len(BOARD))])
    in_image = cv2.projectPoints(on_board, turn, shift, LENS.matrix, LENS.distortion)[0].reshape(-1, 2)
    assert LENS.stand_off_mm((BOARD, in_image)) == pytest.approx(stand_off_mm, rel=1e-4)
    assert LENS.focal_length_px == FOCAL_PX
