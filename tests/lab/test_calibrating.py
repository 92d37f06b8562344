"""`eimi calibrate` finds scale, distortion and directions in rendered pictures of boards, beams, rulers and threads."""

import os
import re
import zlib
from datetime import UTC, date, datetime
from functools import lru_cache

import cv2
import numpy as np
import pytest

from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.virtual.optics import expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.calibration.board import Board, print_board
from eimi_lab.vision.calibration.lens import calibrate_lens
from eimi_lab.vision.calibration.plumb_line import measure_plumb_line
from tests.shared.flag_pictures import photograph
from tests.shared.rendered_edges import CALIBRATION, NOMINAL, SPECIMEN, bend
from tests.shared.small_pictures import SmallPicture, within

SIZE = (480, 384)
FOCAL = 1100.0
MATRIX = np.array([[FOCAL, 0.0, 247.0], [0.0, FOCAL, 188.0], [0.0, 0.0, 1.0]])
DISTORTION = np.array([-0.15, 0.05, 0.001, -0.001, 0.0])
STAND_OFF = 120.0
CHARUCO = Board("charuco", 9, 7, 4.0)
FINE = 3  # number of rays along each side of a pixel
TURNS = [(0, 0, 1.2), (25, 0, 2), (-25, 5, -3), (0, 30, 5), (5, -30, 0), (20, 20, 10)]


def board_texture(board):
    # Return the brightness of a board on a fine grid, and the number of cells of this grid per mm.
    cells = 20
    if board.kind == "circles":
        x, y = np.meshgrid(*(np.arange(cells * n) % cells + 0.5 for n in (board.columns, board.rows)))
        dark = np.hypot(x - cells / 2, y - cells / 2) < 0.3 * cells
    else:
        dark = np.kron(board.cells(), np.ones((2, 2), dtype=bool))
    return np.pad(np.where(dark, 30.0, 210.0), cells, constant_values=210.0).astype(np.float32), cells / board.square_mm


@lru_cache
def camera_rays(dx, dy, bent):
    # Return the directions (right, down, away) of the light through n pixels, (n, 3).
    # dx, dy: shift from the centre of the pixel in px. bent: whether the lens has distortion.
    place = np.indices(SIZE[::-1])[::-1].reshape(2, -1).T + np.array([dx, dy])
    rays = cv2.undistortPoints(place.reshape(-1, 1, 2), MATRIX, DISTORTION if bent else np.zeros(5))[:, 0]
    return np.column_stack([rays, np.ones(len(rays))])


def view(board, turn_deg, stand_off=STAND_OFF, seed=0, bent=True):
    # Return the picture of a board, whose midpoint is on the optical axis.
    # turn_deg: rotations about x, y and z. stand_off: distance from the camera. bent: whether the lens has distortion.
    turn = np.eye(3)
    for axis, angle in zip(np.eye(3), np.radians(turn_deg), strict=True):
        turn = cv2.Rodrigues(axis * angle)[0] @ turn
    offsets = (np.arange(FINE) + 0.5) / FINE - 0.5
    total = np.zeros(SIZE[0] * SIZE[1])
    texture, per_mm = board_texture(board)
    middle = 0.5 * board.square_mm * np.array([board.columns, board.rows])
    for dx in offsets:
        for dy in offsets:
            rays = camera_rays(dx, dy, bent) @ turn  # in the frame of the board
            camera = np.array([0.0, 0.0, -stand_off]) @ turn
            hit = camera[:2] - camera[2] / rays[:, 2:] * rays[:, :2]
            where = np.floor((hit + middle + board.square_mm) * per_mm).astype(int)
            inside = ((where >= 0) & (where < texture.shape[::-1])).all(axis=1)
            where = np.where(inside[:, None], where, 0)
            total += np.where(inside, texture[where[:, 1], where[:, 0]], 210.0)
    image = cv2.GaussianBlur((total / FINE**2).reshape(SIZE[::-1]), (0, 0), 0.7)
    noise = np.random.default_rng(seed).normal(0.0, 1.0, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def charuco_views(tmp_path_factory):
    folder = tmp_path_factory.mktemp("boards")
    for number, turn in enumerate(TURNS):
        assert cv2.imwrite(str(folder / f"view_{number}.png"), view(CHARUCO, turn, seed=number))
    return folder


COMMON = ("--coil-constant", "4.7", "--clamp-midpoint-px", "320", "40")
BOARD = ("--board", "charuco", "--columns", "9", "--rows", "7", "--square-mm", "4")


def test_pictures_of_a_charuco_board_give_lens_scale_and_orientation(run, charuco_views, tmp_path):
    output = tmp_path / "calibration.toml"
    views = sorted(charuco_views.glob("*.png"))
    assert run("calibrate", *views, *BOARD, *COMMON, "-o", output) == (0, "")
    calibration = load_calibration(output)
    uncertainty = calibration.uncertainty
    focal, stated = calibration.camera_matrix[0][0], uncertainty["focal_length_px"]
    assert focal == pytest.approx(FOCAL, abs=min(4 * stated, 10.0))
    truth = FOCAL / STAND_OFF
    assert calibration.pixels_per_mm == pytest.approx(truth, rel=0.002)
    assert abs(calibration.pixels_per_mm - truth) < 3 * uncertainty["pixels_per_mm"]
    assert uncertainty["pixels_per_mm"] < 0.003 * truth
    assert calibration.axis_angle_deg == pytest.approx(91.2, abs=0.03)
    assert calibration.field_angle_deg == pytest.approx(1.2, abs=0.03)
    assert calibration.stand_off_mm == pytest.approx(STAND_OFF, abs=4 * uncertainty["stand_off_mm"])
    # The map from pixels to mm gives the right lengths on the board everywhere in the image.
    on_board, image = CHARUCO.find(cv2.imread(str(views[0]), cv2.IMREAD_GRAYSCALE))
    places = BeamFrame(calibration).to_mm(image)
    gaps = np.linalg.norm(places[:, None] - places, axis=-1) - np.linalg.norm(on_board[:, None] - on_board, axis=-1)
    assert np.abs(gaps).max() < 0.06


@pytest.mark.parametrize("kind", ["charuco", "checkerboard", "circles"])
def test_every_kind_of_board_gives_the_scale(run, tmp_path, kind):
    board = Board(kind, 9, 7, 4.0)
    cv2.imwrite(str(tmp_path / "flat.png"), view(board, (0, 0, -2.0), bent=False))
    arguments = ("--board", kind, "--columns", "9", "--rows", "7", "--square-mm", "4")
    output = tmp_path / "calibration.toml"
    assert run("calibrate", tmp_path / "flat.png", *arguments, *COMMON, "-o", output) == (0, "")
    calibration = load_calibration(output)
    truth = FOCAL / STAND_OFF
    assert calibration.pixels_per_mm == pytest.approx(truth, rel=0.0015)
    assert abs(calibration.pixels_per_mm - truth) < 3 * calibration.uncertainty["pixels_per_mm"]
    assert calibration.axis_angle_deg == pytest.approx(88.0, abs=0.05)
    assert calibration.camera_matrix is None


@pytest.mark.parametrize("angle_deg", [60.0, 90.0, -90.0, 180.0])
def test_a_turned_board_of_circles_gives_the_scale(run, tmp_path, angle_deg):
    board, spacing_px, middle = Board("circles", 8, 6, 2.0), 20.0, np.array([120.0, 110.0])
    image = np.full((220, 240), 220, np.uint8)
    turn = cv2.getRotationMatrix2D((0.0, 0.0), -angle_deg, 1.0)[:, :2]
    for place in np.argwhere(np.ones((8, 6))) - [3.5, 2.5]:
        x, y = np.rint(16 * (middle + spacing_px * turn @ place)).astype(int).tolist()
        cv2.circle(image, (x, y), 16 * 6, 20, -1, cv2.LINE_AA, 4)  # in sixteenths of a pixel
    cv2.imwrite(str(tmp_path / "turned.png"), cv2.GaussianBlur(image, (0, 0), 0.8))
    arguments = ("--board", "circles", "--columns", "8", "--rows", "6", "--square-mm", "2", *COMMON[2:3], "120", "20")
    output = tmp_path / "calibration.toml"
    assert run("calibrate", tmp_path / "turned.png", *arguments, "-o", output) == (0, "")
    calibration = load_calibration(output)
    assert calibration.pixels_per_mm == pytest.approx(spacing_px / board.square_mm, rel=0.002)
    nearest_deg = (angle_deg + 45.0) % 90.0 + 45.0
    assert calibration.axis_angle_deg == pytest.approx(nearest_deg, abs=0.05)


def test_a_view_of_a_single_row_of_corners_is_refused(run, tmp_path):
    long = Board("charuco", 20, 5, 2.0)
    drawn = np.kron(np.pad(~long.cells(), 10, constant_values=True), np.ones((3, 3))).astype(np.uint8) * 220
    drawn[30 + 2 * 30 + 10 :] = 220  # two rows of squares, and a row of corners between them
    cv2.imwrite(str(tmp_path / "strip.png"), cv2.GaussianBlur(drawn, (0, 0), 0.8))
    size = ("--board", "charuco", "--columns", "20", "--rows", "5", "--square-mm", "2")
    status, message = run("calibrate", tmp_path / "strip.png", *size, *COMMON, "-o", tmp_path / "c.toml")
    assert (status, "strip.png: shows no charuco board of 20 x 5" in message) == (2, True)


def test_views_of_a_single_row_of_corners_give_no_lens():
    row = np.column_stack([4.0 * np.arange(14), np.zeros(14)])
    with pytest.raises(ValueError, match="no lens fits the views"):
        calibrate_lens([(row, 9.0 * row + [100.0, 100.0 + y]) for y in range(4)], SIZE)


def test_parallel_views_do_not_determine_the_focal_length():
    flat = [CHARUCO.find(view(CHARUCO, (0, 0, angle), seed=angle)) for angle in (0, 1, 2, 3)]
    with pytest.raises(ValueError, match="tilt the board"):
        calibrate_lens(flat, SIZE)


@pytest.mark.parametrize("lit", [False, True])
def test_the_width_of_the_beam_gives_the_scale(run, tmp_path, lit):
    image = photograph(NOMINAL, bend(SPECIMEN, 0.0))
    cv2.imwrite(str(tmp_path / "rest.png"), 240 - image if lit else image)
    specimen = SPECIMEN.specimen
    lines = [f"{key} = {value!r}" for key, value in specimen.model_dump(exclude_defaults=True).items()]
    (tmp_path / "specimen.toml").write_text("[specimen]\n" + "\n".join(lines).replace("'", '"'))
    output = tmp_path / "calibration.toml"
    guess = ("--coil-constant", "4.7", "--clamp-midpoint-px", "652", "106", "--axis-angle", "88.5")
    status = run("calibrate", tmp_path / "rest.png", "--specimen", tmp_path / "specimen.toml", *guess, "-o", output)
    assert status == (0, "")
    calibration = load_calibration(output)
    assert calibration.pixels_per_mm == pytest.approx(25.0, rel=5e-4)
    assert calibration.clamp_midpoint_px == pytest.approx(CALIBRATION.clamp_midpoint_px, abs=0.2)
    assert calibration.axis_angle_deg == pytest.approx(90.0, abs=0.02)
    # The uncertainty of the scale comes from the caliper, 0.05 mm of 3 mm; the pixels contribute much less.
    assert calibration.uncertainty["pixels_per_mm"] == pytest.approx(25.0 * 0.05 / 3.0, rel=0.01)
    assert run("segment", tmp_path / "nowhere.h5")[0] == 2


@pytest.mark.parametrize(("turned_deg", "thread_deg", "hangs"), [(0, 90.0, True), (0, 98.0, False), (90, 180.0, True)])
def test_the_measured_gravity_decides_whether_the_beam_hangs(run, tmp_path, turned_deg, thread_deg, hangs):
    image, clamp = photograph(NOMINAL, bend(SPECIMEN, 0.0)), (652, 106)
    if turned_deg:  # the camera lies on its side: the picture is turned by 90 degrees clockwise
        clamp = (image.shape[0] - 1 - clamp[1], clamp[0])
        image = np.rot90(image, -1)
    cv2.imwrite(str(tmp_path / "rest.png"), np.ascontiguousarray(image))
    cv2.imwrite(str(tmp_path / "thread.png"), thread(thread_deg))
    lines = [f"{key} = {value!r}" for key, value in SPECIMEN.specimen.model_dump(exclude_defaults=True).items()]
    (tmp_path / "specimen.toml").write_text("[specimen]\n" + "\n".join(lines).replace("'", '"'))
    place = ("--clamp-midpoint-px", *map(str, clamp), "--axis-angle", str(90 + turned_deg))
    gravity = ("--plumb-line", tmp_path / "thread.png", "--gravity-angle", str(90 + turned_deg))
    arguments = (tmp_path / "rest.png", "--specimen", tmp_path / "specimen.toml", *place, *gravity)
    status, message = run("calibrate", *arguments, "-o", tmp_path / "c.toml")
    assert (status, "gravity at 98 degrees" in message) == ((0, False) if hangs else (2, True))
    assert "give --gravity-angle" not in message


STEPPED = """
[specimen]
name = "bar"
material = "silicone"
length_mm = 12.0
width_mm = [[0.0, 3.0], [5.0, 3.0], [5.0, 2.0], [12.0, 2.0]]
depth_mm = 4.0
density_kg_m3 = 1070.0
"""


def test_a_table_of_widths_gives_the_scale(run, tmp_path):
    picture = SmallPicture(ground=(200.0,), above_px=16)  # 7 px/mm; the clamp line is at (60, 26) px
    half_px = np.where(picture.along < 5.0 * 7.0, 10.5, 7.0)
    picture.add(within(picture.along, -99.0, 0.0), (20.0,))
    picture.add(within(picture.aside, -half_px, half_px) * within(picture.along, -20.0, 84.0), (20.0,))
    cv2.imwrite(str(tmp_path / "rest.png"), picture.exposed()[..., 0])
    (tmp_path / "specimen.toml").write_text(STEPPED)
    output = tmp_path / "calibration.toml"
    arguments = ("--specimen", tmp_path / "specimen.toml", "--clamp-midpoint-px", "60", "26", "-o", output)
    assert run("calibrate", tmp_path / "rest.png", *arguments) == (0, "")
    calibration, mean_mm = load_calibration(output), 29.0 / 12.0
    assert calibration.pixels_per_mm == pytest.approx(7.0, rel=0.003)
    assert calibration.uncertainty["pixels_per_mm"] == pytest.approx(7.0 * 0.05 / mean_mm, rel=0.02)


def thread(angle_deg, width_px=6.0, bob=True):
    # Render a dark plumb line in a picture of 1280 x 1024 px, with a weight at its end if `bob` is True.
    # angle_deg: direction, clockwise from +x.
    angle = np.radians(angle_deg)
    along, aside = np.array([np.cos(angle), np.sin(angle)]), 0.5 * np.array([-np.sin(angle), np.cos(angle)])
    middle = np.array([600.0, 480.0])

    def box(begin, end, wide):
        return [middle + a * along + b * wide * aside for a, b in ((begin, -1), (end, -1), (end, 1), (begin, 1))]

    weight = box(290, 360, 80.0) if bob else None
    scene = make_scene(NOMINAL, (1280, 1024), box(-700, 300, width_px), None, weight)
    return expose(scene, np.random.default_rng(0))


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_a_plumb_line_gives_gravity_and_its_standard_deviation(hand):
    calibration = CALIBRATION.model_copy(update={"field_angle_deg": 90.0 - 90.0 * hand})
    pulls = []
    for angle_deg, width_px in ((90.0, 6.0), (88.6, 3.0), (91.3, 20.0), (75.0, 6.0), (0.4, 6.0), (178.0, 6.0)):
        plumb = measure_plumb_line(thread(angle_deg, width_px), calibration, 90.0 * round(angle_deg / 90.0))
        assert plumb.gravity_angle_deg == pytest.approx(angle_deg, abs=0.002)
        pulls.append((plumb.gravity_angle_deg - angle_deg) / plumb.gravity_angle_sigma_deg)
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 2.0
    up = measure_plumb_line(thread(90.0), calibration, -90.0)
    assert up.gravity_angle_deg == pytest.approx(-90.0, abs=0.002)


def test_a_picture_without_a_straight_thread_is_refused():
    curved = thread(90.0)
    bent = np.stack([np.roll(row, int(12 * np.sin(y / 100))) for y, row in enumerate(curved)])
    for image, message in (
        (photograph(NOMINAL, bend(SPECIMEN, 0.0)), "no dark thread"),
        (np.full((600, 800), 200, np.uint8), "no dark thread"),
        (np.zeros((10, 10), np.uint8), "too small"),
        (bent, "straight line"),
    ):
        with pytest.raises(ValueError, match=message):
            measure_plumb_line(image, CALIBRATION, 90.0)


def test_clamp_and_gravity_may_come_from_separate_pictures(run, tmp_path):
    cv2.imwrite(str(tmp_path / "rest.png"), photograph(NOMINAL, bend(SPECIMEN, 5.0)))
    cv2.imwrite(str(tmp_path / "thread.png"), thread(91.3))
    lines = [f"{key} = {value!r}" for key, value in SPECIMEN.specimen.model_dump(exclude_defaults=True).items()]
    (tmp_path / "specimen.toml").write_text("[specimen]\n" + "\n".join(lines).replace("'", '"'))
    output = tmp_path / "calibration.toml"
    scale = ("--ruler-px", "10", "50", "1010", "50", "--ruler-mm", "40")
    rough = ("--coil-constant", "4.7", "--clamp-midpoint-px", "650", "95")
    pictures = ("--beam", tmp_path / "rest.png", "--plumb-line", tmp_path / "thread.png")
    arguments = (tmp_path / "rest.png", *scale, *rough, *pictures)
    assert run("calibrate", *arguments, "--specimen", tmp_path / "specimen.toml", "-o", output) == (0, "")
    calibration = load_calibration(output)
    assert calibration.clamp_midpoint_px == pytest.approx(CALIBRATION.clamp_midpoint_px, abs=0.2)
    assert calibration.gravity_angle_deg == pytest.approx(91.3, abs=0.002)
    assert calibration.uncertainty["gravity_angle_deg"] < 0.002
    assert calibration.axis_angle_deg == 90.0
    status, message = run("calibrate", *arguments, "-o", tmp_path / "other.toml")
    assert (status, "--beam: also needs --specimen" in message) == (2, True)


def test_a_ruler_gives_the_scale_and_its_uncertainty(run, tmp_path):
    cv2.imwrite(str(tmp_path / "ruler.png"), np.zeros((100, 400), np.uint8))
    os.utime(tmp_path / "ruler.png", (0, 86400 * 365.25 * 50))
    ends = ("--ruler-px", "10", "50", "260", "50", "--ruler-mm", "20")
    assert run("calibrate", tmp_path / "ruler.png", *ends, *COMMON, "-o", tmp_path / "c.toml") == (0, "")
    calibration = load_calibration(tmp_path / "c.toml")
    assert calibration.pixels_per_mm == pytest.approx(12.5)
    assert calibration.uncertainty["pixels_per_mm"] == pytest.approx(np.sqrt(2) / 20, rel=0.01)
    assert calibration.calibrated_on == date(2020, 1, 1)
    assert calibration.age_days(datetime(2020, 1, 11, 12, tzinfo=UTC)) == pytest.approx(10.5)


BAD = {
    "no way": ((), "give exactly one of --board, --specimen and --ruler-px"),
    "two ways": ((*BOARD, "--specimen", "type1"), "give exactly one of --board"),
    "clamp outside": (
        ("--ruler-px", "1", "1", "90", "1", "--ruler-mm", "9", "--clamp-midpoint-px", "400", "40"),
        "blank.png: is 400 x 100 px; --clamp-midpoint-px 400 40 is outside the image",
    ),
    "clamp beside the beam's picture": (
        ("--specimen", "type1", "--clamp-midpoint-px", "-3.5", "40"),
        "blank.png: is 400 x 100 px; --clamp-midpoint-px -3.5 40 is outside the image",
    ),
    "kind": (("--board", "chess"), "board = 'chess' should be one of"),
    "small": (("--board", "circles", "--rows", "2"), "should have 4 to 60"),
    "not a board": (BOARD, "blank.png: shows no charuco board of 9 x 7"),
    "not a beam": (("--specimen", "type1"), "blank.png: no beam leaves clamp_midpoint_px"),
    "weight across the beam": (
        ("--specimen", "type1", "--axis-angle", "0", "--gravity-angle", "90"),
        "the hanging beam; if gravity has another direction in the picture, give --gravity-angle",
    ),
    "ruler outside": (
        ("--ruler-px", "1", "1", "900", "1", "--ruler-mm", "9"),
        "both points of --ruler-px 1 1 900 1 should lie in the image",
    ),
    "endless squares": ((*BOARD, "--square-mm", "inf"), "square_mm = inf should be a finite number"),
    "endless ruler": (("--ruler-px", "1", "1", "90", "1", "--ruler-mm", "inf"), "--ruler-mm inf for 89.0 px gives no"),
    "ruler of nothing": (("--ruler-px", "1", "1", "90", "1"), "gives no scale"),
    "field": ((*("--ruler-px", "1", "1", "90", "1", "--ruler-mm", "9"), "--field-angle", "90"), "should be across"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_mistake_gives_one_line_and_no_file(run, tmp_path, case):
    cv2.imwrite(str(tmp_path / "blank.png"), np.full((100, 400), 200, np.uint8))
    arguments, message = BAD[case]
    status, printed = run("calibrate", tmp_path / "blank.png", *COMMON, *arguments, "-o", tmp_path / "c.toml")
    assert (status, printed.count("\n")) == (2, 1)
    assert message in printed
    assert not (tmp_path / "c.toml").exists()


def test_points_that_do_not_fit_the_board_are_refused(run, tmp_path, monkeypatch):
    x, y = np.meshgrid(4.0 * np.arange(8), 4.0 * np.arange(6))
    mirrored = np.column_stack([x.ravel(), y.ravel()]), np.column_stack([200.0 - x.ravel(), y.ravel()])
    monkeypatch.setattr(Board, "find", lambda board, image: mirrored)
    cv2.imwrite(str(tmp_path / "flat.png"), np.zeros(SIZE[::-1], np.uint8))
    status, message = run("calibrate", tmp_path / "flat.png", *BOARD, *COMMON, "-o", tmp_path / "c.toml")
    assert (status, "flat.png: the points of the board have a residual of" in message) == (2, True)


def test_a_tilted_mid_plane_is_refused(run, charuco_views, tmp_path):
    tilted = charuco_views / "view_1.png"
    status, message = run("calibrate", tilted, *BOARD, *COMMON, "-o", tmp_path / "c.toml")
    assert (status, "the board is tilted by" in message) == (2, True)


@pytest.mark.parametrize("kind", ["charuco", "checkerboard", "circles"])
def test_a_board_is_printed_to_scale(run, tmp_path, kind):
    output = tmp_path / "board.pdf"
    arguments = ("--board", kind, "--columns", "9", "--rows", "7", "--square-mm", "4", "--print-board")
    assert run("calibrate", *arguments, "-o", output) == (0, "")
    raw = output.read_bytes()
    points_per_mm = 72 / 25.4
    box = [float(number) for number in re.search(rb"/MediaBox \[([^\]]+)\]", raw).group(1).split()]
    assert box == pytest.approx([0, 0, (36 + 24) * points_per_mm, (28 + 24) * points_per_mm], abs=0.01)
    drawn = b"".join(zlib.decompress(part) for part in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", raw, re.S)[:1])
    x = np.array([float(place) for place in re.findall(rb"(?m)^([-\d.]+) [-\d.]+ [ml]$", drawn)]) / points_per_mm
    if kind == "circles":  # the path of each circle begins at its lowest point, below the centre
        assert {14.0, 46.0} <= set(x.round(3))
    else:
        inside = x[(x > 1) & (x < 59)]
        assert [inside.min(), inside.max()] == pytest.approx([12.0, 48.0], abs=0.01)


def test_the_printed_board_is_detected_in_a_picture(tmp_path):
    print_board(CHARUCO, tmp_path / "board.pdf")
    assert (tmp_path / "board.pdf").stat().st_size > 1000
    shown = np.kron(np.pad(~CHARUCO.cells(), 10, constant_values=True), np.ones((6, 6))) * 255
    on_board, image = CHARUCO.find(cv2.GaussianBlur(shown.astype(np.uint8), (0, 0), 1.0))
    assert len(on_board) == 8 * 6
    np.testing.assert_allclose(image, on_board / 4.0 * 60 + 60 - 0.5, atol=0.05)


def test_the_digest_of_a_calibration_depends_on_its_numbers_alone():
    assert CALIBRATION.digest == Calibration.model_validate(CALIBRATION.model_dump()).digest
    assert CALIBRATION.digest != CALIBRATION.model_copy(update={"pixels_per_mm": 25.1}).digest
