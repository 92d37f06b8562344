"""Calibrations, boards, plumb lines and clicked points agree with calculations by hand."""

from __future__ import annotations

import math
import os
from datetime import date
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_lab.config.calibration import Calibration, Picture
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.calibration import calibration_file
from eimi_lab.vision.calibration.board import Board, _runs, print_board
from eimi_lab.vision.calibration.calibration_file import (
    BenchSetup,
    from_beam,
    from_board,
    from_ruler,
    with_measured_clamp,
    with_measured_gravity,
)
from eimi_lab.vision.calibration.known_width import _dark_steps, _tilt, measure_beam, measure_clamp
from eimi_lab.vision.calibration.lens import BoardPose, Lens, calibrate_lens, fit_board_pose
from eimi_lab.vision.calibration.plumb_line import measure_plumb_line
from eimi_lab.vision.calibration.writing import write_calibration
from eimi_lab.vision.clicked_points import check_clicked_points
from eimi_lab.vision.field_at_beam import stated_background_T
from tests.shared.small_pictures import CALIBRATION, SmallPicture, specimen, within

Array = np.ndarray
SETUP = BenchSetup(4.7, (60.0, 26.0), 90.0, 91.0, 0.0)
DAY = 1_772_582_400  # 4 March 2026, UTC, in s


def written(path: Path, image: Array) -> Path:
    assert cv2.imwrite(str(path), image)
    os.utime(path, (DAY, DAY))
    return path


def back_lit(slope: float = 0.0, bend: float = 0.0) -> Array:
    picture = SmallPicture(bend, (200.0,), slope, above_px=16)
    picture.add(within(picture.along, -99.0, 0.0), (20.0,))
    picture.add(within(picture.aside, -7.0, 7.0) * within(picture.along, -20.0, 84.0), (20.0,))
    return picture.exposed()[..., 0]


def test_a_calibration_is_written_with_every_value(tmp_path: Path) -> None:
    full = Calibration(
        pixels_per_mm=12.3456789,
        coil_constant_mT_per_A=4.7,
        clamp_midpoint_px=(60.25, 26.0),
        axis_angle_deg=90.1234567,
        gravity_angle_deg=91.0,
        field_angle_deg=0.1234567,
        gravity=False,
        camera_matrix=((300.0, 0.0, 70.5), (0.0, 300.0, 50.0), (0.0, 0.0, 1.0)),
        distortion=(-0.05, 0.02, 0.001, -0.001, 0.0),
        stand_off_mm=123.4567,
        calibrated_on=date(2026, 3, 4),
        uncertainty={"pixels_per_mm": 0.012345, "stand_off_mm": 1.0},
    )
    write_calibration(full, tmp_path / "full.toml", False)
    assert (tmp_path / "full.toml").read_text() == (
        "pixels_per_mm = 12.345679\n"
        "clamp_midpoint_px = [60.25, 26.0]\n"
        "axis_angle_deg = 90.12346       # clockwise from the image's +x, like all angles\n"
        "gravity_angle_deg = 91.00000\n"
        "coil_constant_mT_per_A = 4.7\n"
        "field_angle_deg = 0.12346\n"
        "gravity = false\n"
        "camera_matrix = [[300.0, 0.0, 70.5], [0.0, 300.0, 50.0], [0.0, 0.0, 1.0]]\n"
        "distortion = [-0.05, 0.02, 0.001, -0.001, 0.0]\n"
        "stand_off_mm = 123.457\n"
        "calibrated_on = 2026-03-04\n"
        "\n"
        "[uncertainty]    # standard uncertainties of the numbers above; add all others that you know\n"
        "pixels_per_mm = 0.0123\n"
        "stand_off_mm = 1\n"
    )
    with pytest.raises(InputError):
        write_calibration(full, tmp_path / "full.toml", False)
    plain = Calibration(
        pixels_per_mm=12.0,
        clamp_midpoint_px=(60.0, 26.0),
        axis_angle_deg=90.0,
        gravity_angle_deg=90.0,
        telecentric=True,
    )
    write_calibration(plain, tmp_path / "full.toml", True)
    assert (tmp_path / "full.toml").read_text() == (
        "pixels_per_mm = 12.000000\n"
        "clamp_midpoint_px = [60.0, 26.0]\n"
        "axis_angle_deg = 90.00000       # clockwise from the image's +x, like all angles\n"
        "gravity_angle_deg = 90.00000\n"
        "telecentric = true\n"
    )


def test_a_setup_turns_all_directions_with_the_axis() -> None:
    calibration = SETUP.calibration(12.0, 1.5, {"pixels_per_mm": 0.1}, date(2026, 3, 4))
    assert (calibration.axis_angle_deg, calibration.gravity_angle_deg) == (91.5, 92.5)
    assert (calibration.field_angle_deg, calibration.coil_constant_mT_per_A) == (1.5, 4.7)
    assert (calibration.pixels_per_mm, calibration.calibrated_on) == (12.0, date(2026, 3, 4))
    assert calibration.uncertainty == {"pixels_per_mm": 0.1}
    without = BenchSetup(None, (60.0, 26.0), 90.0, 90.0, 0.0, True).calibration(12.0, 0.0, {}, date(2026, 3, 4))
    assert without.coil_constant_mT_per_A is None
    assert without.telecentric
    with pytest.raises(InputError, match="calibrate"):
        SETUP.calibration(-12.0, 0.0, {}, date(2026, 3, 4))


@pytest.mark.parametrize(
    "ends",
    [(0, 0, 30, 0), (119, 10, 0, 10), (10, 99, 10, 50), (10, 10, 10, 30.1)],
)
def test_a_ruler_between_points_of_the_picture_gives_the_scale(tmp_path: Path, ends: tuple[float, ...]) -> None:
    picture = written(tmp_path / "ruler.png", np.zeros((100, 120), np.uint8))
    calibration, [line] = from_ruler(picture, ends, 5.0, SETUP)  # type: ignore[arg-type]
    scale = math.dist(ends[:2], ends[2:]) / 5.0
    assert calibration.pixels_per_mm == pytest.approx(scale)
    uncertain = {"pixels_per_mm": math.sqrt(2.0) / 5.0, "axis_angle_deg": 1.0, "clamp_midpoint_px": 1.0}
    assert calibration.uncertainty == pytest.approx(uncertain)
    assert calibration.calibrated_on == date(2026, 3, 4)
    assert line == (
        f"scale from two points 5 mm apart, read by eye: standard uncertainty "
        f"{100.0 * math.sqrt(2.0) / 5.0 / scale:.2g} %; a board in the beam's plane gives about 0.1 %"
    )


@pytest.mark.parametrize(
    "ends", [(0, 0, 120, 0), (-1, 10, 50, 10), (10, 100, 10, 50), (10, -1, 50, 10), (10, 10, 10, 30)]
)
def test_a_ruler_outside_the_picture_or_too_short_is_refused(tmp_path: Path, ends: tuple[float, ...]) -> None:
    picture = written(tmp_path / "ruler.png", np.zeros((100, 120), np.uint8))
    with pytest.raises(InputError, match="--ruler-px"):
        from_ruler(picture, ends, 5.0, SETUP)  # type: ignore[arg-type]


@pytest.mark.parametrize(("clamp", "is_inside"), [((0.0, 0.0), True), ((119.9, 99.9), True), ((120.0, 50.0), False),
                                                  ((50.0, 100.0), False), ((-0.1, 50.0), False)])  # fmt: skip
def test_the_clamp_lies_in_the_picture(tmp_path: Path, clamp: tuple[float, float], is_inside: bool) -> None:
    picture = written(tmp_path / "ruler.png", np.zeros((100, 120), np.uint8))
    setup = BenchSetup(None, clamp, 90.0, 90.0, 0.0)
    if is_inside:
        assert from_ruler(picture, (0, 0, 50, 0), 5.0, setup)[0].clamp_midpoint_px == clamp
    else:
        with pytest.raises(InputError, match="is outside the image"):
            from_ruler(picture, (0, 0, 50, 0), 5.0, setup)


def test_the_width_of_a_beam_at_rest_gives_scale_clamp_and_axis(tmp_path: Path) -> None:
    # A beam 14 px and 2 mm wide has the scale 7 px/mm; its clamp line is at (60, 26) px.
    picture = written(tmp_path / "rest.png", back_lit())
    guess = BenchSetup(4.7, (61.0, 27.0), 89.0, 90.0, -1.0)
    calibration, [line] = from_beam(picture, specimen(), guess, 0.04)
    assert calibration.pixels_per_mm == pytest.approx(7.0, abs=0.1)
    assert calibration.clamp_midpoint_px == pytest.approx((60.0, 26.0), abs=0.3)
    assert calibration.axis_angle_deg == pytest.approx(90.0, abs=0.1)
    assert calibration.field_angle_deg == pytest.approx(0.0, abs=0.1)
    assert calibration.gravity_angle_deg == pytest.approx(91.0, abs=0.1)
    uncertainty = calibration.uncertainty
    assert uncertainty is not None
    assert uncertainty["pixels_per_mm"] == pytest.approx(0.02 * calibration.pixels_per_mm, rel=0.02)
    assert 0.0 < uncertainty["axis_angle_deg"] < 0.2
    assert line.startswith("scale from width_mm = 2 ± 0.04: standard uncertainty 2 %")
    lit = written(tmp_path / "lit.png", 230 - np.minimum(back_lit(), 230))
    assert from_beam(lit, specimen(), guess, 0.04)[0].pixels_per_mm == pytest.approx(7.0, abs=0.1)
    moved = CALIBRATION.model_copy(update={"clamp_midpoint_px": (62.0, 24.0)})
    assert with_measured_clamp(moved, picture, specimen()).clamp_midpoint_px == pytest.approx((60.0, 26.0), abs=0.3)
    assert measure_clamp(back_lit(), specimen(), moved) == pytest.approx((60.0, 26.0), abs=0.3)
    blank = written(tmp_path / "blank.png", np.full((128, 128), 200, np.uint8))
    with pytest.raises(InputError, match=r"blank.png: no beam leaves"):
        from_beam(blank, specimen(), guess, 0.04)
    with pytest.raises(InputError, match=r"blank.png: the beam cannot be measured"):
        with_measured_clamp(moved, blank, specimen())
    pose = measure_beam(back_lit(), specimen(), guess.calibration(1.0, 0.0, {}, date(2026, 3, 4)))
    assert 0.0 < pose.pixels_per_mm_sigma < 0.05


def test_the_steps_to_the_first_bright_pixel() -> None:
    bright = np.zeros((9, 12), np.uint8)
    bright[4, 8] = bright[1, 3] = 1
    assert _dark_steps(bright, np.array([3.0, 4.0]), np.array([1.0, 0.0])) == 5
    assert _dark_steps(bright, np.array([3.0, 4.0]), np.array([0.0, -1.0])) == 3
    assert _dark_steps(bright, np.array([8.0, 4.0]), np.array([1.0, 0.0])) is None
    assert _dark_steps(bright, np.array([3.0, 6.0]), np.array([1.0, 0.0])) is None


def test_the_tilt_is_the_mean_slope_of_the_first_halves() -> None:
    x = np.arange(20.0)
    rng = np.random.default_rng(1)
    left, right = (np.column_stack([x, slope * x + rng.normal(0.0, 0.01, 20)]) for slope in (0.1, 0.3))
    left[10:, 1] += 5.0
    angle, sigma = _tilt(left, right)
    lines = [np.polyfit(points[:10, 0], points[:10, 1], 1, cov=True) for points in (left, right)]
    assert angle == pytest.approx(np.mean([math.atan(line[0][0]) for line in lines]))
    assert sigma == pytest.approx(0.5 * math.sqrt(sum(line[1][0, 0] for line in lines)))


def thread(angle_deg: float) -> Array:
    # Return a picture, 160 x 200 px, with a thread of 2.4 px through its middle.
    y, x = np.mgrid[0:200, 0:160].astype(float)
    angle = math.radians(angle_deg)
    aside = (x - 80.0) * -math.sin(angle) + (y - 100.0) * math.cos(angle)
    along = (x - 80.0) * math.cos(angle) + (y - 100.0) * math.sin(angle)
    dark = within(aside, -1.2, 1.2) * within(along, -75.0, 75.0)
    noise = np.random.default_rng(2).normal(0.0, 1.0, x.shape)
    return np.clip(np.rint(200.0 - 150.0 * dark + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("angle_deg", "roughly_deg", "field_deg"),
    [(88.0, 90.0, 0.0), (88.0, 90.0, 180.0), (2.0, 0.0, 0.0), (92.0, -90.0, 0.0), (-178.0, 180.0, 0.0)],
)
def test_a_thread_gives_the_direction_of_gravity(
    tmp_path: Path, angle_deg: float, roughly_deg: float, field_deg: float
) -> None:
    calibration = CALIBRATION.model_copy(
        update={"field_angle_deg": field_deg, "uncertainty": {"pixels_per_mm": 0.1}, "axis_angle_deg": 89.0}
    )
    image = thread(angle_deg)
    plumb = measure_plumb_line(image, calibration, roughly_deg)
    off = (plumb.gravity_angle_deg - angle_deg + 90.0) % 180.0 - 90.0
    assert abs(off) < 0.05
    assert abs(plumb.gravity_angle_deg - roughly_deg) <= 2.1
    assert 0.0 < plumb.gravity_angle_sigma_deg < 0.05
    assert plumb.residual_px < 0.2
    changed, [line] = with_measured_gravity(calibration, written(tmp_path / "thread.png", image), roughly_deg)
    assert changed.gravity_angle_deg == plumb.gravity_angle_deg
    assert changed.uncertainty == {"pixels_per_mm": 0.1, "gravity_angle_deg": plumb.gravity_angle_sigma_deg}
    assert line == (
        f"gravity at {plumb.gravity_angle_deg:.3f} ± {plumb.gravity_angle_sigma_deg:.2g} degrees; the thread is "
        f"straight to {plumb.residual_px:.3f} px RMS"
    )
    without = calibration.model_copy(update={"uncertainty": None})
    assert with_measured_gravity(without, tmp_path / "thread.png", roughly_deg)[0].uncertainty is None


def drawn_board(board: Board, cell_px: int = 3) -> Array:
    # Return a sharp picture of a board with a margin of one square.
    dark = np.pad(board.cells(), 10)
    image = np.kron(np.where(dark, 20.0, 220.0), np.ones((cell_px, cell_px)))
    return np.rint(cv2.GaussianBlur(image, (0, 0), 0.8)).astype(np.uint8)


@pytest.mark.parametrize("kind", ["charuco", "checkerboard"])
def test_a_drawn_board_is_found_with_its_points_in_mm(kind: Any, tmp_path: Path) -> None:
    board = Board(kind, 6, 5, 4.0)
    on_board, in_image = board.find(drawn_board(board))  # type: ignore[misc]
    assert len(on_board) == 5 * 4
    pose = fit_board_pose((on_board, in_image), 0.001)
    turn = (pose.angle_deg + 45.0) % 90.0 - 45.0
    assert pose.pixels_per_mm == pytest.approx(30.0 / 4.0, rel=2e-3)
    assert turn == pytest.approx(0.0, abs=0.05)
    assert np.ptp(on_board, axis=0).tolist() == [16.0, 12.0]
    path = written(tmp_path / "board.png", drawn_board(board))
    setup = BenchSetup(4.7, (60.0, 26.0), 88.0, 90.0, -2.0)
    calibration, lines = from_board([path], path, board, setup, 0.001)
    assert calibration.pixels_per_mm == pytest.approx(7.5, rel=2e-3)
    assert calibration.axis_angle_deg == pytest.approx(90.0, abs=0.05)
    assert calibration.field_angle_deg == pytest.approx(0.0, abs=0.05)
    assert calibration.camera_matrix is None
    assert lines[0] == "lens: not calibrated; give at least 4 views, most of them tilted, to calibrate it"
    assert lines[1].startswith("board in the middle plane: residual of 0.0")
    other = written(tmp_path / "other.png", drawn_board(board)[:-1])
    with pytest.raises(
        InputError, match=r"other.png: is 240 x 209 px; it should have the size of board.png, 240 x 210 px"
    ):
        from_board([path, other], path, board, setup, 0.001)


def test_the_cells_of_a_checkerboard_alternate_and_runs_of_dark_cells_are_found(tmp_path: Path) -> None:
    board = Board("checkerboard", 5, 4, 3.0)
    cells = board.cells()
    assert cells.shape == (40, 50)
    assert cells[::10, ::10].tolist() == [[(x + y) % 2 == 0 for x in range(5)] for y in range(4)]
    assert (cells == np.kron(cells[::10, ::10], np.ones((10, 10), bool))).all()
    dark = np.array([True, True, False, True, False, False, True])
    assert _runs(dark) == [(0, 2), (3, 4), (6, 7)]
    assert _runs(np.zeros(3, bool)) == []
    assert Board("charuco", 6, 5, 3.0).cells().shape == (50, 60)
    for kind in ("checkerboard", "circles"):
        print_board(Board(kind, 5, 4, 3.0), tmp_path / f"{kind}.pdf")  # type: ignore[arg-type]
        assert (tmp_path / f"{kind}.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("size", "square_mm", "words"),
    [
        ((3, 4), 4.0, "should have 4 to 60 columns and rows"),
        ((4, 61), 4.0, "should have 4 to 60 columns and rows"),
        ((50, 41), 4.0, "has more than 1000 markers"),
        ((4, 4), 0.0, "should be a finite number greater than 0"),
    ],
)
def test_a_board_that_cannot_be_made_is_refused(size: tuple[int, int], square_mm: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Board("charuco", *size, square_mm)
    assert Board("charuco", 50, 40, 4.0).columns == 50
    assert Board("checkerboard", 60, 60, 4.0).rows == 60


def seen_boards(turns: tuple[tuple[float, float], ...]) -> tuple[list[tuple[Array, Array]], Array]:
    # Return points of a board in several views through a lens, and the camera matrix of the lens.
    matrix = np.array([[900.0, 0.0, 330.0], [0.0, 900.0, 250.0], [0.0, 0.0, 1.0]])
    x, y = np.meshgrid(4.0 * np.arange(9), 4.0 * np.arange(7))
    board = np.column_stack([x.ravel(), y.ravel()])
    views = []
    rng = np.random.default_rng(4)
    for about_x, about_y in turns:
        solid = np.column_stack([board - board.mean(axis=0), np.zeros(len(board))])
        turn = np.radians(np.array([about_x, about_y, 2.0]))
        image, _ = cv2.projectPoints(solid, turn, np.array([1.0, -2.0, 150.0]), matrix, np.array([-0.1, 0.02, 0, 0, 0]))
        views.append((board, image.reshape(-1, 2) + rng.normal(0.0, 0.05, (len(board), 2))))
    return views, matrix


def test_the_lens_and_its_distance_follow_from_tilted_boards(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    views, matrix = seen_boards(((0.0, 0.0), (25.0, 0.0), (0.0, 28.0), (-20.0, 15.0), (15.0, -25.0)))
    lens = calibrate_lens(views, (640, 480))
    assert lens.focal_length_px == pytest.approx(900.0, abs=4 * lens.focal_length_sigma_px)
    assert 0.0 < lens.focal_length_sigma_px < 10.0
    assert lens.matrix[:2, 2] == pytest.approx(matrix[:2, 2], abs=8.0)
    assert lens.distortion[4] == 0.0
    assert lens.distortion[0] == pytest.approx(-0.1, abs=0.05)
    assert lens.residual_px == pytest.approx(0.05 * math.sqrt(2.0), rel=0.2)
    assert lens.stand_off_mm(views[0]) == pytest.approx(150.0, rel=0.01)
    straight = lens.undistort(views[0][1])
    assert np.abs(straight - views[0][1]).max() > 0.1
    with pytest.raises(ValueError, match="there are 3 views"):
        calibrate_lens(views[:3], (640, 480))
    flat, _ = seen_boards(((0.0, 0.0), (4.0, 0.0), (0.0, 5.0), (-4.0, 3.0)))
    with pytest.raises(ValueError, match="do not determine the focal length"):
        calibrate_lens(flat, (640, 480))
    by_path = {Path(f"{number}.png"): view for number, view in enumerate(views)}
    monkeypatch.setattr(calibration_file, "_views_of", lambda board, paths: (by_path, (640, 480)))
    monkeypatch.setattr(calibration_file, "_day_of", lambda paths: date(2026, 3, 4))
    calibration, lines = from_board(list(by_path), Path("0.png"), Board("charuco", 9, 7, 4.0), SETUP, 0.001)
    assert calibration.stand_off_mm == pytest.approx(150.0, rel=0.01)
    assert calibration.pixels_per_mm == pytest.approx(6.0, rel=0.01)
    assert calibration.camera_matrix is not None
    assert calibration.camera_matrix[0][0] == pytest.approx(lens.focal_length_px)
    uncertainty = calibration.uncertainty
    assert uncertainty is not None
    assert uncertainty["focal_length_px"] == pytest.approx(lens.focal_length_sigma_px, rel=1e-3)
    share = lens.focal_length_sigma_px / lens.focal_length_px
    assert uncertainty["stand_off_mm"] == pytest.approx(share * calibration.stand_off_mm, rel=1e-3)
    assert lines[0] == f"lens: residual of {lens.residual_px:.3f} px RMS over 5 views"
    with pytest.raises(InputError, match=r"1.png: the board is tilted by .* degrees \(at most 5\)"):
        from_board(list(by_path), Path("1.png"), Board("charuco", 9, 7, 4.0), SETUP, 0.001)


@pytest.mark.parametrize(("angle_deg", "axis_deg"), [(1.2, 91.2), (-88.8, 91.2), (46.0, 46.0), (-46.0, 134.0)])
def test_the_axis_is_the_direction_of_the_board_nearest_to_the_stated_one(angle_deg: float, axis_deg: float) -> None:
    pose = BoardPose(6.0, 0.01, angle_deg, 0.02, 0.3, 0.1)
    found = calibration_file._with_board_and_lens(SETUP, pose, None, None, date(2026, 3, 4))
    assert found.axis_angle_deg == pytest.approx(axis_deg)
    assert found.gravity_angle_deg == pytest.approx(axis_deg + 1.0)
    assert found.uncertainty == {"pixels_per_mm": 0.01, "axis_angle_deg": 0.02, "clamp_midpoint_px": 1.0}
    lens = Lens(np.eye(3), np.zeros(5), 5.0, 0.1)
    assert calibration_file._with_board_and_lens(SETUP, pose, lens, None, date(2026, 3, 4)).camera_matrix is None


def test_the_scale_of_a_board_with_scatter_is_that_of_a_complex_least_squares_fit() -> None:
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))
    board = np.column_stack([x.ravel(), y.ravel()])
    angle = math.radians(12.0)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    image = 20.0 * board @ turn.T + [50.0, 60.0] + rng.normal(0.0, 0.2, board.shape)
    pose = fit_board_pose((board, image), 0.002)
    columns = [[1, 0, bx, -by] for bx, by in board] + [[0, 1, by, bx] for bx, by in board]
    solution, [square], _, _ = np.linalg.lstsq(np.array(columns), image.T.ravel(), rcond=None)
    scale = math.hypot(*solution[2:])
    assert pose.pixels_per_mm == pytest.approx(scale)
    assert pose.angle_deg == pytest.approx(math.degrees(math.atan2(solution[3], solution[2])))
    assert pose.residual_px == pytest.approx(math.sqrt(square / 20))
    deviation = math.sqrt(square / (40 - 4))
    of_points = deviation / math.sqrt(((board - board.mean(axis=0)) ** 2).sum())
    assert pose.angle_sigma_deg == pytest.approx(math.degrees(of_points / scale))
    assert pose.pixels_per_mm_sigma >= math.hypot(of_points, 0.002 * scale)
    tilted = fit_board_pose((board, board * [20.0, 20.0 * math.cos(0.3)]), 0.0)
    assert tilted.tilt_deg == pytest.approx(math.degrees(0.3))
    assert tilted.pixels_per_mm_sigma > 0.5 * 20.0 * (1.0 - math.cos(0.3))


def clicked(*points: tuple[float, float]) -> Calibration:
    return CALIBRATION.model_copy(update={"picture": Picture(along_px=points)})


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (((60.0, 40.0), (60.0, 90.0)), ""),
        (((0.0, 12.0), (127.9, 90.0)), "long"),
        (((60.0, 112.0), (60.0, 90.0)), "should lie in the pictures of 128 x 112 px"),
        (((60.0, 40.0), (128.0, 50.0)), "should lie in the pictures"),
        (((-0.1, 50.0), (60.0, 90.0)), "should lie in the pictures"),
        (((60.0, -0.1), (60.0, 90.0)), "point 1, "),
        (((60.0, 40.0), (60.3, 40.3)), "two points are the same"),
        (((60.0, 40.0), (60.0, 40.6)), ""),
        (((60.0, 90.0), (60.0, 40.0)), "turns back before the point"),
        (((60.0, 60.0), (78.0, 50.4)), ""),  # a turn of 118 degrees
        (((60.0, 60.0), (78.0, 48.6)), "turns back before the point"),  # of 122 degrees
        (((60.0, 60.0), (60.0, 40.1)), ""),  # a point less than 20 px back may be a click beside the beam
        (((60.0, 60.0), (60.0, 39.9)), "turns back before the point"),
        (((60.0, 60.0), (113.0, 90.0)), ""),
        (((110.0, 30.0), (60.0, 80.0)), "long; give points on the beam"),
    ],
)
def test_clicked_points_lead_from_the_clamp_to_the_tip(points: tuple[tuple[float, float], ...], words: str) -> None:
    # The line through the points is at most 1.3 * 84 px + 10 px = 119.2 px long.
    if words:
        with pytest.raises(InputError, match=words):
            check_clicked_points(clicked(*points), specimen(), (112, 128))
    else:
        check_clicked_points(clicked(*points), specimen(), (112, 128))


def test_the_stated_background_field_is_given_in_the_beam_frame() -> None:
    # The axis points down and the field to the right: a field to the right and down is (down, right).
    stated = CALIBRATION.model_copy(update={"background_field_mT": (0.3, -0.2)})
    assert stated_background_T(stated) == pytest.approx([-0.2e-3, 0.3e-3])
    assert stated_background_T(CALIBRATION).tolist() == [0.0, 0.0]
    frame = BeamFrame(CALIBRATION.model_copy(update={"gravity_angle_deg": 80.0}))
    assert (frame.gravity_deg, frame.field_deg, frame.hand) == (pytest.approx(10.0), pytest.approx(90.0), -1.0)
    assert frame.to_mm([[67.0, 24.0]])[0] == pytest.approx([2.0, 1.0])
    assert frame.to_px([[2.0, 1.0]])[0] == pytest.approx([67.0, 24.0])


def test_views_that_differ_in_tilt_by_25_degrees_determine_the_focal_length() -> None:
    views, _ = seen_boards(((0.0, 0.0), (18.0, 0.0), (0.0, 18.0), (-9.0, 9.0)))
    lens = calibrate_lens(views, (640, 480))
    assert lens.focal_length_px == pytest.approx(900.0, abs=4 * lens.focal_length_sigma_px)
