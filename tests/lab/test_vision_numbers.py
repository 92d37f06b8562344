"""Corrections of frames, widths, motion and the scale of a board agree with calculations by hand."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting import Loads, Magnet, Specimen
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.laws import LAWS
from eimi_lab.dataset.segmentation import clamp_judged_when_straight
from eimi_lab.vision.calibration.lens import fit_board_pose
from eimi_lab.vision.edges.dimensions import anticlastic_bow, local_widths, width_deviation
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.flags import judge
from eimi_lab.vision.intensity import FieldCorrection


def test_the_dark_frame_is_subtracted_before_the_flat_field_is_applied() -> None:
    rng = np.random.default_rng(1)
    dark = rng.integers(5, 40, (30, 40)).astype(np.uint8)
    light = np.linspace(100, 200, 40) * np.ones((30, 1))
    scene = rng.uniform(0.1, 0.9, (30, 40))
    flat, image = (dark + light).round(), (dark + light * scene).round()
    corrected = FieldCorrection(dark, flat.astype(np.uint8)).apply(image.astype(np.uint8))
    assert corrected == pytest.approx(np.median(light.round()) * scene, abs=2.0)


def test_clipped_pixels_stay_clipped_and_others_are_corrected() -> None:
    flat = np.full((20, 20), 100, np.uint8)
    flat[:, :10] = 200  # the light on the left is twice as strong
    image = np.full((20, 20), 240, np.uint8)
    image[5] = 255
    corrected = FieldCorrection(None, flat).apply(image)
    assert (corrected[5] == 255).all()
    assert corrected[0, 0] == pytest.approx(240 * 150 / 200)


def test_a_tenth_of_the_length_may_have_another_width_without_a_flag() -> None:
    widths = np.full(100, 3.0)
    widths[:8] = 4.5
    assert width_deviation(widths, 3.0) == 0.0
    widths[:20] = 4.5
    assert width_deviation(widths, 3.0) == pytest.approx(0.5)
    assert width_deviation(np.full(100, 2.7), 3.0) == pytest.approx(0.1)


def test_the_anticlastic_bow_of_a_deep_strip_is_no_deviation_of_its_width():
    magnet = Magnet(4.0, 3.0, 6.0, 1.2, 7500.0)
    solid = SolidBeside(Specimen(30.0, 3.0, 15.0, 1070.0, "solid", magnet), 13, 1, 1)
    shapes = solid.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along([9.0]), tolerance_mm=1e-2)
    left, right = points_on(outline(solid, shapes)[0], 4)[0]
    widths, bow = local_widths(left, right), anticlastic_bow(left, right, 3.0, 15.0)
    assert width_deviation(widths, 3.0) > 0.1
    assert width_deviation(widths, 3.0, bow) < 0.02
    assert width_deviation(0.9 * widths, 3.0, 0.9 * bow) > 0.05  # a strip that is narrower is still flagged
    assert anticlastic_bow(left * [1, 0] - [0, 1.5], right * [1, 0] + [0, 1.5], 3.0, 15.0) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("straight_offset_mm", [0.0, 0.3])
def test_the_position_of_the_clamp_is_checked_in_the_straight_state(straight_offset_mm: float):
    def edge_set(turn_deg: float, offset_mm: float) -> EdgeSet:
        arc, turn = np.linspace(0.0, 30.0, 40), np.radians(turn_deg)
        edge = EdgePoints(np.column_stack([arc, 0.5 * turn * arc**2 / 30.0]), np.full(40, 0.01))
        return EdgeSet(edge, edge, judge({"clamp_offset_mm": offset_mm, "blur_px": 4.0}), np.zeros((4, 2)))

    straight, bent = clamp_judged_when_straight([edge_set(1.0, straight_offset_mm), edge_set(60.0, 0.32)])
    values = {flag.name: flag.value for flag in bent.flags}
    assert values.pop("DEFOCUS") == 4.0
    assert values == ({"CALIBRATION_STALE": 0.3} if straight_offset_mm else {})
    assert len(straight.flags) == len(bent.flags)


@pytest.mark.parametrize("finding", ["settling_ratio", "motion_ratio"])
def test_motion_adds_its_size_to_the_deviation_of_the_points(finding: str) -> None:
    (flag,) = judge({finding: 2.3})
    assert flag.widens_mm(25.0, 3.0, 5.0) == pytest.approx(0.2 / 25.0, rel=0.1)
    (further,) = judge({finding: 8.0})
    assert further.widens > 2 * flag.widens


@pytest.mark.parametrize(
    ("finding", "below", "above"),
    [
        ("hole_share", 0.001, 0.005),
        ("blur_px", 2.0, 3.0),
        ("saturated_share", 0.005, 0.02),
        ("gamma", 1.2, 1.4),
        ("residual", 0.02, 0.04),
        ("width_deviation", 0.04, 0.06),
        ("length_deviation", 0.08, 0.12),
        ("twist_deg", 1.0, 2.0),
        ("clamp_offset_mm", 0.05, 0.2),
        ("calibration_age_days", 60.0, 120.0),
        ("settling_ratio", 1.1, 1.4),
    ],
)
def test_the_limit_of_each_check_lies_between_a_good_and_a_bad_value(finding: str, below: float, above: float) -> None:
    words = {"even_turn": "", "twist_effect": ""}
    assert judge({finding: below}, words=words) == ()
    assert len(judge({finding: above}, words=words)) == 1


@pytest.mark.parametrize("error", [0.0, 1e-3, 5e-3])
def test_the_uncertainty_of_a_scale_includes_that_of_the_board(error: float) -> None:
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    board = np.column_stack([x.ravel(), y.ravel()])
    pose = fit_board_pose((board, 25.0 * board + [100.0, 50.0]), error)
    assert pose.pixels_per_mm == pytest.approx(25.0)
    assert pose.pixels_per_mm_sigma == pytest.approx(25.0 * error, abs=1e-6)
    tilted = fit_board_pose((board, board * [25.0, 24.5]), 0.0)
    assert tilted.pixels_per_mm_sigma > 0.2
