"""Calibrations from small pictures, and the steps toward them, have the numbers that are stored in this folder."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
import pytest

import eimi_lab.vision.calibration
from eimi_lab.vision.calibration.board import Board, print_board
from eimi_lab.vision.calibration.calibration_file import BenchSetup
from eimi_lab.vision.calibration.known_width import measure_beam, measure_clamp
from eimi_lab.vision.calibration.lens import calibrate_lens, fit_board_pose
from eimi_lab.vision.calibration.plumb_line import measure_plumb_line
from tests.shared.accepted_numbers import check, described
from tests.shared.small_pictures import CALIBRATION, SmallPicture, specimen, within
from tests.shared.traced_results import TracedResults

ACCEPTED = Path(__file__).parent / "calibration"
FOLDER = Path(eimi_lab.vision.calibration.__file__).parent
Array = np.ndarray
LENS = ((420.0, 0.0, 70.0), (0.0, 420.0, 60.0), (0.0, 0.0, 1.0))
BEHIND = CALIBRATION.model_copy(
    update={"camera_matrix": LENS, "distortion": (-0.03, 0.01, 0.001, -0.001, 0.0), "field_angle_deg": 180.0}
)


def beams() -> Iterator[tuple[str, Any]]:
    # Yield the results of measuring the beam and its clamp on pictures of a beam at rest.
    for name, bend, slope, lit in (("plain", 0.0, 0.0, False), ("bent", 0.04, 0.15, False), ("lit", -0.03, 0.1, True)):
        picture = SmallPicture(bend, (30.0,) if lit else (200.0,), slope, above_px=16)
        picture.add(within(picture.along, -99.0, 0.0), (200.0,) if lit else (20.0,))
        bar = within(picture.aside, -7.0, 7.0) * within(picture.along, -20.0, 84.0)
        image = picture.add(bar, (200.0,) if lit else (20.0,)).exposed()[..., 0]
        for kind, plain in (("", CALIBRATION), (" behind a lens", BEHIND)):
            guess = plain.model_copy(
                update={"pixels_per_mm": 1.0, "clamp_midpoint_px": (61.0, 27.0), "axis_angle_deg": 89.0}
            )
            yield f"{name}{kind} beam", measure_beam(image, specimen(), guess)
            moved = plain.model_copy(update={"clamp_midpoint_px": (62.0, 24.0)})
            yield f"{name}{kind} clamp", measure_clamp(image, specimen(), moved)


def thread(angle_deg: float, bob: bool, bend: float = 0.0) -> Array:
    # Return a picture, 180 x 140 px, with a thread of 2.6 px, a speck, a wide body and a knot.
    y, x = np.mgrid[0:140, 0:180].astype(float)
    angle = math.radians(angle_deg)
    along = (x - 85.0) * math.cos(angle) + (y - 72.0) * math.sin(angle)
    aside = (y - 72.0) * math.cos(angle) - (x - 85.0) * math.sin(angle) - bend * along**2
    dark = within(aside, -1.3, 1.3) * within(along, -60.0, 58.0)
    dark = np.maximum(dark, within(np.hypot(aside - 0.5, along - 20.0), -9.0, 3.2))
    if bob:
        dark = np.maximum(dark, within(aside, -6.0, 7.0) * within(along, 40.0, 60.0))
    dark = np.maximum(dark, within(np.hypot(x - 150.0, y - 30.0), -9.0, 5.0))
    dark = np.maximum(dark, within(x, -9.0, 30.0) * within(y, 90.0, 190.0))
    noise = np.random.default_rng(2).normal(0.0, 1.5, x.shape)
    return np.clip(np.rint(210.0 - 0.2 * x - 150.0 * dark + noise), 0, 255).astype(np.uint8)


def plumb_lines() -> Iterator[tuple[str, Any]]:
    for number, (angle, roughly, bob) in enumerate(
        ((86.0, 90.0, True), (93.5, -90.0, False), (4.0, 0.0, False), (171.0, -10.0, True), (90.0, 90.0, False))
    ):
        plumb = CALIBRATION if number % 2 else BEHIND
        yield f"thread {number}", measure_plumb_line(thread(angle, bob), plumb, roughly)
    yield "curved thread", measure_plumb_line(thread(88.0, False, 4e-4), CALIBRATION, 90.0)


def tilted(board: Board, turn: tuple[float, float, float], away: float = 105.0) -> Array:
    # Return a blurred picture, 270 x 240 px, of a board that is turned about three axes (degrees).
    dark = np.pad(board.cells(), 10)
    drawn = np.kron(np.where(dark, 30.0, 210.0), np.ones((3, 3))).astype(np.float32)
    scale = board.square_mm / 30.0  # mm per px of the drawing
    high, wide = drawn.shape
    matrix = np.array([[600.0, 0.0, 134.0], [0.0, 600.0, 118.0], [0.0, 0.0, 1.0]])
    rotation = cv2.Rodrigues(np.radians(np.array(turn)))[0]
    to_mm = np.array([[scale, 0.0, -0.5 * scale * wide], [0.0, scale, -0.5 * scale * high], [0.0, 0.0, 1.0]])
    place = np.column_stack([rotation[:, :2], [1.0, -2.0, away]])
    size = (270, 240)
    seen = cv2.warpPerspective(drawn, matrix @ place @ to_mm, size, flags=cv2.INTER_AREA, borderValue=210.0)
    return np.clip(np.rint(cv2.GaussianBlur(seen, (0, 0), 0.7)), 0, 255).astype(np.uint8)


TURNS = ((0.0, 0.0, 3.0), (22.0, 0.0, 0.0), (0.0, 24.0, 5.0), (-18.0, 12.0, -4.0), (12.0, -20.0, 8.0))


def boards() -> Iterator[tuple[str, Any]]:
    # Yield the points of boards in pictures, their poses, and the lens from five views.
    for kind in ("charuco", "checkerboard", "circles"):
        board = Board(kind, 6, 5, 5.0)  # type: ignore[arg-type]
        if kind == "circles":
            drawn = round_dots(6, 5)
            yield kind, board.find(drawn)
            yield f"{kind} of 12 bits", board.find(drawn.astype(np.uint16) * 16)
            continue
        views = [board.find(tilted(board, turn)) for turn in TURNS]
        yield kind, views
        for number, view in enumerate(views):
            if view is not None:
                yield f"{kind} {number} pose", fit_board_pose(view, 0.002)
    points = [lens_view(turn) for turn in TURNS]
    lens = calibrate_lens(points, (640, 480))
    yield "lens", lens
    yield "stand-off", [lens.stand_off_mm(view) for view in points]
    yield "straight", lens.undistort(points[1][1])
    yield "pose", [fit_board_pose((points[0][0], lens.undistort(points[0][1])), 0.001)]


def round_dots(columns: int, rows: int) -> Array:
    y, x = np.mgrid[0 : 24 * rows + 24, 0 : 24 * columns + 24].astype(float)
    dark = np.zeros(x.shape)
    for row in range(rows):
        for column in range(columns):
            dark = np.maximum(dark, within(np.hypot(x - 24.4 * column - 23.3, y - 24.1 * row - 22.7), -9.0, 6.5))
    return np.clip(np.rint(220.0 - 190.0 * dark), 0, 255).astype(np.uint8)


def lens_view(turn: tuple[float, float, float]) -> tuple[Array, Array]:
    # Return points of a board on the board and in an image, with errors of 0.05 px.
    matrix = np.array([[900.0, 0.0, 330.0], [0.0, 900.0, 250.0], [0.0, 0.0, 1.0]])
    x, y = np.meshgrid(4.0 * np.arange(9), 4.0 * np.arange(7))
    board = np.column_stack([x.ravel(), y.ravel()])
    solid = np.column_stack([board, np.zeros(len(board))])
    bent = np.array([-0.1, 0.02, 0.001, -0.002, 0.0])
    image, _ = cv2.projectPoints(solid, np.radians(np.array(turn)), np.array([-15.0, -14.0, 150.0]), matrix, bent)
    errors = np.random.default_rng(int(abs(turn[0]) + 50)).normal(0.0, 0.05, (len(board), 2))
    return board, image.reshape(-1, 2) + errors


def setups() -> Iterator[tuple[str, Any]]:
    for name, coil in (("without a coil", None), ("with a coil", 4.5)):
        setup = BenchSetup(coil, (60.0, 26.0), 88.0, 91.0, 3.0, telecentric=coil is None)
        made = setup.calibration(7.25, 1.5, {"pixels_per_mm": 0.03}, date(2026, 3, 4))
        yield name, {key: value for key, value in made.model_dump().items() if isinstance(value, int | float | tuple)}


CASES: tuple[Callable[[], Iterator[tuple[str, Any]]], ...] = (beams, plumb_lines, boards, setups)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_calibrations_have_the_accepted_numbers(case: Callable[[], Iterator[tuple[str, Any]]], tmp_path: Path) -> None:
    lines: list[str] = []
    with TracedResults(FOLDER) as traced:
        for name, value in case():
            lines += described(value, name)
    check([*lines, *traced.lines()], ACCEPTED / f"{case.__name__}.txt", tmp_path)


@pytest.mark.parametrize("kind", ["charuco", "checkerboard", "circles"])
def test_printed_boards_have_the_accepted_numbers(kind: Any, tmp_path: Path) -> None:
    # The description has the operators of the page, and all of its numbers.
    with mpl.rc_context({"pdf.compression": 0}):
        print_board(Board(kind, 5, 4, 7.5), tmp_path / "board.pdf")
    text = (tmp_path / "board.pdf").read_bytes().decode("latin-1")
    [page] = [
        part for part in re.findall(r"stream\n(.*?)\nendstream", text, re.DOTALL) if " re\n" in part or " m\n" in part
    ][:1]
    numbers = np.array([float(number) for number in re.findall(r"(?<![\w.])-?\d+\.?\d*", page)])
    box = re.search(r"/MediaBox \[([^\]]*)\]", text)
    assert box is not None
    lines = [f"{kind}: {box[1].strip()}", f"{kind}: {len(re.findall(r' [lmc]$', page, re.MULTILINE))} lines"]
    lines += described(numbers, f"{kind} numbers")
    lines += re.findall(r"\((.*)\) Tj", page)
    check(lines, ACCEPTED / f"printed_{kind}.txt", tmp_path)


@pytest.mark.parametrize(
    ("columns", "rows", "markers"),
    [(10, 10, 50), (11, 10, 100), (20, 10, 100), (21, 10, 250), (25, 20, 250), (26, 20, 1000), (50, 40, 1000)],
)
def test_the_smallest_dictionary_with_enough_markers_is_used(columns: int, rows: int, markers: int) -> None:
    pattern = Board("charuco", columns, rows, 5.0)._pattern
    expected = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_4X4_{markers}"))
    assert pattern.getDictionary().bytesList.shape == expected.bytesList.shape
    assert (pattern.getDictionary().bytesList == expected.bytesList).all()
    assert pattern.getMarkerLength() == pytest.approx(3.0)
    assert pattern.getSquareLength() == 5.0
    assert pattern.getChessboardSize() == (columns, rows)
