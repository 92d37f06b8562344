"""Calibration boards: find their points in an image, and print them at true size."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.intensity import eight_bit

Array = NDArray[np.float64]
Kind = Literal["charuco", "checkerboard", "circles"]
KINDS: tuple[str, ...] = get_args(Kind)

_CELLS = 10  # width of a square in cells
_MARKER = 6  # width of the marker in it: four cells of code and a border of one cell on each side
_CLEAR_OF_MARKER = 0.18  # of a square: a larger search window would include the marker, which begins at 0.2
# By number of markers. The smallest dictionary that is large enough is used, because it is searched fastest.
_DICTIONARIES = {
    50: cv2.aruco.DICT_4X4_50,
    100: cv2.aruco.DICT_4X4_100,
    250: cv2.aruco.DICT_4X4_250,
    1000: cv2.aruco.DICT_4X4_1000,
}
_FEWEST_POINTS = 12
_CIRCLE_SHARE = 0.6  # diameter of a printed circle over the distance of neighbouring centres
_PAGE_MARGIN_MM = 12.0


@dataclass(frozen=True)
class Board:
    """A flat calibration pattern.

    Attributes
    ----------
    kind : {"charuco", "checkerboard", "circles"}
        Kind of the pattern.
    columns, rows : int
        Number of squares or circles in both directions, 4 to 60.
    square_mm : float
        Side of a square, or distance of neighbouring circles.

    Raises
    ------
    ValueError
        If a value is out of its range, or if a ChArUco board has more than 1000 markers.
    """

    kind: Kind
    columns: int
    rows: int
    square_mm: float

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"board = {self.kind!r} should be one of {', '.join(KINDS)}")
        if min(self.columns, self.rows) < 4 or max(self.columns, self.rows) > 60:
            raise ValueError(f"a board of {self.columns} x {self.rows} should have 4 to 60 columns and rows")
        if self.kind == "charuco" and self.columns * self.rows > 2 * max(_DICTIONARIES):
            raise ValueError(
                f"a charuco board of {self.columns} x {self.rows} has more than 1000 markers; give fewer columns or "
                "rows"
            )
        if not 0.0 < self.square_mm < math.inf:
            raise ValueError(f"square_mm = {self.square_mm:g} should be a finite number greater than 0")

    def find(self, image: NDArray[Any]) -> tuple[Array, Array] | None:
        """Find the points of the board in an image; a ChArUco board may be partly hidden.

        Parameters
        ----------
        image : ndarray, shape (rows, columns) or (rows, columns, 3)
            The image.

        Returns
        -------
        board_mm : ndarray, shape (n, 2)
            The points on the board; x along its rows, y down.
        image_px : ndarray, shape (n, 2)
            The same points in the image.

            None is returned if fewer than 12 points are detected, or if all points lie on one line.
        """
        find = {"charuco": self._charuco, "checkerboard": self._checkerboard, "circles": self._circles}[self.kind]
        points = find(eight_bit(image))
        if points is None or len(points[0]) < _FEWEST_POINTS:
            return None
        from_middle = points[0] - points[0].mean(axis=0)
        return points if np.linalg.matrix_rank(from_middle, tol=0.5 * self.square_mm) == 2 else None

    def _charuco(self, shown: NDArray[np.uint8]) -> tuple[Array, Array] | None:
        corners, ids, _, _ = cv2.aruco.CharucoDetector(self._pattern).detectBoard(shown)
        if ids is None or len(ids) == 0:
            return None
        on_board = np.asarray(self._pattern.getChessboardCorners(), dtype=np.float64)[ids.ravel(), :2]
        places: NDArray[Any] = np.asarray(corners, dtype=np.float32).reshape(-1, 1, 2)
        if len(places) > 1:
            spacing_px = np.linalg.norm(places[1:] - places[:-1], axis=-1).min()
            half = int(np.clip(_CLEAR_OF_MARKER * spacing_px, 2, 11))
            stop_criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-4)
            places = cv2.cornerSubPix(shown, places, (half, half), (-1, -1), stop_criteria)
        return on_board, np.asarray(places, dtype=np.float64).reshape(-1, 2)

    def _checkerboard(self, shown: NDArray[np.uint8]) -> tuple[Array, Array] | None:
        size = (self.columns - 1, self.rows - 1)
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
        detected, corners = cv2.findChessboardCornersSB(shown, size, flags=flags)
        return (self._grid(*size), np.asarray(corners, np.float64).reshape(-1, 2)) if detected else None

    def _circles(self, shown: NDArray[np.uint8]) -> tuple[Array, Array] | None:
        size = (self.columns, self.rows)
        detected, centres = cv2.findCirclesGrid(shown, size, flags=cv2.CALIB_CB_SYMMETRIC_GRID)
        if not detected:
            return None
        on_board, in_image = self._grid(*size), np.asarray(centres, np.float64).reshape(-1, 2)
        if _mirrored(on_board, in_image):  # OpenCV's order if the rows are steep in the image
            in_image = in_image.reshape(self.rows, self.columns, 2)[:, ::-1].reshape(-1, 2)
        return on_board, in_image

    def _grid(self, columns: int, rows: int) -> Array:
        """Return the points of a regular grid on the board, mm, row by row, beginning at (0, 0)."""
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        return self.square_mm * np.column_stack([x.ravel(), y.ravel()]).astype(np.float64)

    @cached_property
    def _pattern(self) -> Any:
        marker_count = next(size for size in _DICTIONARIES if 2 * size >= self.columns * self.rows)
        dictionary = cv2.aruco.getPredefinedDictionary(_DICTIONARIES[marker_count])
        marker_mm = self.square_mm * _MARKER / _CELLS
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_mm, marker_mm, dictionary)

    def cells(self) -> NDArray[np.bool_]:
        """Return which parts of the board are dark, with 10 x 10 parts for each square."""
        if self.kind == "charuco":
            size = (_CELLS * self.columns, _CELLS * self.rows)
            return np.asarray(self._pattern.generateImage(size, marginSize=0, borderBits=1)) < 128
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.kron((x + y) % 2 == 0, np.ones((_CELLS, _CELLS), dtype=bool))


def _mirrored(on_board: Array, in_image: Array) -> bool:
    """Return whether the map from points on the board to points in the image mirrors the board."""
    affine = np.linalg.lstsq(on_board - on_board.mean(axis=0), in_image - in_image.mean(axis=0), rcond=None)[0]
    return bool(np.linalg.det(affine) < 0.0)


def print_board(board: Board, path: Path) -> None:
    """Write the board as a PDF page at its true size, with a line of stated length to check the print.

    Parameters
    ----------
    board : Board
        The pattern.
    path : Path
        The PDF file to write.
    """
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    wide, high = board.columns * board.square_mm, board.rows * board.square_mm
    page = (wide + 2 * _PAGE_MARGIN_MM, high + 2 * _PAGE_MARGIN_MM)
    figure = Figure(figsize=(page[0] / 25.4, page[1] / 25.4))
    FigureCanvasPdf(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(-_PAGE_MARGIN_MM, wide + _PAGE_MARGIN_MM)
    axes.set_ylim(high + _PAGE_MARGIN_MM, -_PAGE_MARGIN_MM)
    axes.axis("off")
    if board.kind == "circles":
        for row in range(board.rows):
            for column in range(board.columns):
                centre = ((column + 0.5) * board.square_mm, (row + 0.5) * board.square_mm)
                axes.add_patch(Circle(centre, 0.5 * _CIRCLE_SHARE * board.square_mm, color="black", linewidth=0))
    else:
        cell = board.square_mm / _CELLS
        boxes = [
            cell * np.array([(begin, row), (end, row), (end, row + 1), (begin, row + 1)])
            for row, dark in enumerate(board.cells())
            for begin, end in _runs(dark)
        ]
        axes.add_collection(PolyCollection(boxes, facecolor="black", edgecolor="none", antialiased=False))
    text = f"{board.kind}, {board.columns} x {board.rows}, {board.square_mm:g} mm; print at 100 %; the line is "
    length = float(np.clip(10.0 * (wide // 10), 10.0, 100.0))
    below = high + 0.5 * _PAGE_MARGIN_MM
    axes.plot([0.0, length], [below, below], color="black", linewidth=0.5)
    axes.text(0.0, below + 1.0, f"{text}{length:g} mm", fontsize=5, va="top")
    figure.savefig(path, format="pdf")


def _runs(dark: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first index and last index + 1 of every run of dark cells in a row."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], dark, [False]]).astype(np.int8)))
    return [(int(begin), int(end)) for begin, end in zip(change[::2], change[1::2], strict=True)]
