"""Make a calibration from images of a board, of the beam at rest, or of a ruler."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import check
from eimi_lab.process.errors import InputError
from eimi_lab.vision.calibration.board import Board
from eimi_lab.vision.calibration.known_width import measure_beam, measure_clamp
from eimi_lab.vision.calibration.lens import FEWEST_VIEWS, BoardPose, Lens, View, calibrate_lens, fit_board_pose
from eimi_lab.vision.calibration.plumb_line import measure_plumb_line
from eimi_lab.vision.image_files import read_grey

MOST_TILT_DEG = 5.0  # of a board in the beam's middle plane
LARGEST_RESIDUAL = 0.1  # of a board's pose, in squares
LARGEST_ACROSS = 0.1  # sine of the angle between gravity and a beam that is assumed to be straight
READING_PX = 1.0  # standard deviation of a point that a person reads off an image


@dataclass(frozen=True)
class BenchSetup:
    """Values of a calibration that an image of a board does not show.

    Attributes
    ----------
    coil_constant_mT_per_A : float or None
        Field at the magnet per ampere; None without a coil.
    clamp_midpoint_px : tuple of float
        Middle of the line at which the beam leaves its clamp.
    axis_angle_deg, gravity_angle_deg, field_angle_deg : float
        Directions of the beam's axis, gravity and positive field in the image, clockwise from +x. A measured axis
        replaces the given axis; gravity and field are then turned by the difference.
    telecentric : bool
        Whether the lens is telecentric.
    """

    coil_constant_mT_per_A: float | None
    clamp_midpoint_px: tuple[float, float]
    axis_angle_deg: float
    gravity_angle_deg: float
    field_angle_deg: float
    telecentric: bool = False

    def calibration(
        self, pixels_per_mm: float, turned_deg: float, uncertainty: dict[str, float], on: date
    ) -> Calibration:
        """Return a calibration with a measured scale and with the other values of this setup.

        Parameters
        ----------
        pixels_per_mm : float
            Scale in the beam's middle plane.
        turned_deg : float
            Clockwise rotation that corrects the directions of axis, gravity and field.
        uncertainty : dict of str to float
            Standard uncertainties, with the keys of the calibration.
        on : date
            Day of the calibration.

        Raises
        ------
        InputError
            If the values are not a valid calibration.
        """
        table = {
            "pixels_per_mm": pixels_per_mm,
            "clamp_midpoint_px": self.clamp_midpoint_px,
            "axis_angle_deg": self.axis_angle_deg + turned_deg,
            "gravity_angle_deg": self.gravity_angle_deg + turned_deg,
            "telecentric": self.telecentric,
            "calibrated_on": on,
            "uncertainty": uncertainty,
        }
        if self.coil_constant_mT_per_A is not None:
            table["coil_constant_mT_per_A"] = self.coil_constant_mT_per_A
            table["field_angle_deg"] = self.field_angle_deg + turned_deg
        return check(Calibration, table, "", "calibrate")


def from_board(
    images: Sequence[Path], mid_plane: Path, board: Board, setup: BenchSetup, board_error: float
) -> tuple[Calibration, list[str]]:
    """Make a calibration from images of a board.

    The lens is calibrated too if there are at least four images and the lens is not telecentric.

    Parameters
    ----------
    images : sequence of Path
        Views of the board, most of them tilted.
    mid_plane : Path
        Image of the board in the beam's middle plane, along the beam.
    board : Board
        The pattern.
    setup : BenchSetup
        Values that the images do not show.
    board_error : float
        Relative standard uncertainty of the size of the print.

    Returns
    -------
    calibration : Calibration
        The calibration.
    lines : list of str
        Text about the residuals.

    Raises
    ------
    InputError
        If an image shows no board or has another size, if the lens cannot be calibrated, or if the board in the middle
        plane is tilted by more than 5 degrees or has a residual of more than a tenth of a square.
    """
    paths = list(dict.fromkeys([*images, mid_plane]))
    views, size = _views_of(board, paths)
    _check_clamp(mid_plane, size, setup.clamp_midpoint_px)
    view, lens, stand_off_mm = views[mid_plane], None, None
    lines: list[str] = []
    if not setup.telecentric and len(paths) < FEWEST_VIEWS:
        lines.append(f"lens: not calibrated; give at least {FEWEST_VIEWS} views, most of them tilted, to calibrate it")
    elif not setup.telecentric:
        lens, stand_off_mm = _lens_of(views, size, view)
        view = (view[0], lens.undistort(view[1]))
        lines.append(f"lens: residual of {lens.residual_px:.3f} px RMS over {len(paths)} views")
    pose = fit_board_pose(view, board_error)
    if pose.tilt_deg > MOST_TILT_DEG:
        raise InputError(
            f"{mid_plane}: the board is tilted by {pose.tilt_deg:.1f} degrees (at most {MOST_TILT_DEG:g}); hold the "
            "board in the beam's middle plane, or give an image of the board in this plane with --mid-plane"
        )
    square_px = board.square_mm * pose.pixels_per_mm
    if pose.residual_px > LARGEST_RESIDUAL * square_px:
        raise InputError(
            f"{mid_plane}: the points of the board have a residual of {pose.residual_px:.1f} px RMS (at most "
            f"{LARGEST_RESIDUAL:g} of a square of {square_px:.1f} px); check --board, --columns and --rows, or give "
            "more views, so that the lens is calibrated"
        )
    residual = f"residual of {pose.residual_px:.3f} px RMS"
    lines.append(f"board in the middle plane: {residual}, tilted by about {pose.tilt_deg:.1f} degrees")
    return _with_board_and_lens(setup, pose, lens, stand_off_mm, _day_of(paths)), lines


def _views_of(board: Board, paths: Sequence[Path]) -> tuple[dict[Path, View], tuple[int, int]]:
    """Return the points of the board in each image, and the size of the images (px)."""
    views: dict[Path, View] = {}
    size: tuple[int, int] | None = None
    for path in paths:
        image = read_grey(path)
        if size is not None and size != image.shape[::-1]:
            raise InputError(
                f"{path}: is {image.shape[1]} x {image.shape[0]} px; it should have the size of {paths[0].name}, "
                f"{size[0]} x {size[1]} px"
            )
        size = (image.shape[1], image.shape[0])
        points = board.find(image)
        if points is None:
            raise InputError(
                f"{path}: shows no {board.kind} board of {board.columns} x {board.rows}; check --board, --columns and "
                "--rows, and check that the picture is sharp"
            )
        views[path] = points
    assert size is not None  # there is at least one image, that of the middle plane
    return views, size


def _lens_of(views: dict[Path, View], size: tuple[int, int], mid_plane: View) -> tuple[Lens, float]:
    """Return the calibrated lens, and the distance (mm) from the lens to the beam."""
    # `views`: the board in several images. `mid_plane`: the board in the middle plane of the beam. `size`: width and
    # height of the images.
    try:
        lens = calibrate_lens(list(views.values()), size)
        return lens, lens.stand_off_mm(mid_plane)
    except ValueError as error:
        raise InputError(f"{next(iter(views))} and {len(views) - 1} more images: {error}") from error


def _with_board_and_lens(
    setup: BenchSetup, pose: BoardPose, lens: Lens | None, stand_off_mm: float | None, on: date
) -> Calibration:
    """Return the calibration from given values (`setup`), a measured board (`pose`) and a calibrated lens."""
    # The angle from the stated axis to the nearest direction of the board's rows or columns.
    turned = (pose.angle_deg - setup.axis_angle_deg + 45.0) % 90.0 - 45.0
    of_board = {
        "pixels_per_mm": pose.pixels_per_mm_sigma,
        "axis_angle_deg": pose.angle_sigma_deg,
        "clamp_midpoint_px": READING_PX,
    }
    if lens is None or stand_off_mm is None:
        return setup.calibration(pose.pixels_per_mm, turned, of_board, on)
    of_lens = {
        "focal_length_px": lens.focal_length_sigma_px,
        "stand_off_mm": stand_off_mm * lens.focal_length_sigma_px / lens.focal_length_px,
    }
    calibration = setup.calibration(pose.pixels_per_mm, turned, of_board, on)
    matrix = tuple(tuple(map(float, row)) for row in lens.matrix)
    measured = {
        "camera_matrix": matrix,
        "distortion": tuple(map(float, lens.distortion)),
        "stand_off_mm": stand_off_mm,
        "uncertainty": of_board | of_lens,
    }
    return calibration.model_copy(update=measured)


def from_beam(
    image: Path, specimen: SpecimenFile, setup: BenchSetup, tolerance_mm: float
) -> tuple[Calibration, list[str]]:
    """Make a calibration from an image of the beam at rest, which shows scale, clamp and axis.

    Parameters
    ----------
    image : Path
        The beam in front of a back-light.
    specimen : SpecimenFile
        The specimen, whose width is known.
    setup : BenchSetup
        Approximate clamp and angles, and the values that the image does not show. The beam hangs or stands: gravity
        acts along its axis.
    tolerance_mm : float
        Standard uncertainty of the width.

    Returns
    -------
    calibration : Calibration
        The calibration.
    lines : list of str
        Text about the uncertainty of the scale.

    Raises
    ------
    InputError
        If the beam cannot be measured.
    """
    width = specimen.specimen.width_mm
    guess = setup.calibration(1.0, 0.0, {}, _day_of([image]))
    pixels = _image_with_clamp(image, setup.clamp_midpoint_px)
    try:
        pose = measure_beam(pixels, specimen, guess)
    except ValueError as error:
        raise InputError(f"{image}: {error}") from error
    uncertainty = {
        "pixels_per_mm": math.hypot(pose.pixels_per_mm_sigma, pose.pixels_per_mm * tolerance_mm / width),
        "axis_angle_deg": pose.axis_angle_sigma_deg,
    }
    turned = pose.axis_angle_deg - setup.axis_angle_deg
    calibration = setup.calibration(pose.pixels_per_mm, turned, uncertainty, _day_of([image]))
    calibration = calibration.model_copy(update={"clamp_midpoint_px": pose.clamp_midpoint_px})
    return calibration, [_scale_quality(calibration, f"width_mm = {width:g} ± {tolerance_mm:g}")]


def check_hangs(image: Path, axis_deg: float, gravity_deg: float, is_measured: bool) -> None:
    """Raise InputError if gravity in an image acts across the axis of the beam, so that the beam is bent.

    `is_measured` tells whether the direction of gravity was measured, and not assumed or stated.
    """
    remedy = "" if is_measured else "; if gravity has another direction in the picture, give --gravity-angle"
    if abs(math.sin(math.radians(gravity_deg - axis_deg))) > LARGEST_ACROSS:
        raise InputError(
            f"{image}: the weight of the beam acts across its axis and bends the beam (axis at {axis_deg:.4g} degrees, "
            f"gravity at {gravity_deg:.4g} degrees), so that its direction cannot be measured; use --board or "
            f"--ruler-px instead, or a picture of the hanging beam{remedy}"
        )


def from_ruler(
    image: Path, ends_px: tuple[float, float, float, float], length_mm: float, setup: BenchSetup
) -> tuple[Calibration, list[str]]:
    """Make a calibration whose scale follows from two points of known distance.

    Parameters
    ----------
    image : Path
        The picture.
    ends_px : tuple of float
        Two points in the beam's middle plane: x1, y1, x2, y2.
    length_mm : float
        Their distance.
    setup : BenchSetup
        Values that the image does not show.

    Returns
    -------
    calibration : Calibration
        The calibration.
    lines : list of str
        Text about the uncertainty of the scale.

    Raises
    ------
    InputError
        If a point is not in the image, if the points are less than 20 px apart, or if the distance is not positive.
    """
    height, width = _image_with_clamp(image, setup.clamp_midpoint_px).shape
    if not (
        0 <= min(ends_px[::2]) <= max(ends_px[::2]) < width and 0 <= min(ends_px[1::2]) <= max(ends_px[1::2]) < height
    ):
        points = " ".join(f"{place:g}" for place in ends_px)
        raise InputError(
            f"{image}: is {width} x {height} px; both points of --ruler-px {points} should lie in the image"
        )
    ruler_px = math.dist(ends_px[:2], ends_px[2:])
    if not (0 < length_mm < math.inf and ruler_px > 20 * READING_PX):
        raise InputError(
            f"{image}: --ruler-mm {length_mm:g} for {ruler_px:.1f} px gives no scale; --ruler-mm should be greater "
            f"than 0, and the points of --ruler-px more than {20 * READING_PX:g} px apart"
        )
    uncertainty = {
        "pixels_per_mm": math.sqrt(2.0) * READING_PX / length_mm,
        "axis_angle_deg": 1.0,
        "clamp_midpoint_px": READING_PX,
    }
    calibration = setup.calibration(ruler_px / length_mm, 0.0, uncertainty, _day_of([image]))
    return calibration, [_scale_quality(calibration, f"two points {length_mm:g} mm apart, read by eye")]


def _check_clamp(image: Path, size: tuple[int, ...], midpoint_px: tuple[float, float]) -> None:
    """Raise InputError if the middle of the clamp lies outside an image of width and height `size`."""
    if not all(0 <= place < extent for place, extent in zip(midpoint_px, size, strict=True)):
        x, y = midpoint_px
        raise InputError(f"{image}: is {size[0]} x {size[1]} px; --clamp-midpoint-px {x:g} {y:g} is outside the image")


def _image_with_clamp(image: Path, midpoint_px: tuple[float, float]) -> NDArray[Any]:
    """Read an image as grey values; raise InputError if the middle of the clamp lies outside."""
    pixels = read_grey(image)
    _check_clamp(image, pixels.shape[::-1], midpoint_px)
    return pixels


def with_measured_clamp(calibration: Calibration, image: Path, specimen: SpecimenFile) -> Calibration:
    """Return the calibration with the middle of the clamp's edge measured on an image.

    Parameters
    ----------
    calibration : Calibration
        Its `clamp_midpoint_px` must be right to a third of a beam's width.
    image : Path
        The beam in front of a back-light.
    specimen : SpecimenFile
        The specimen in the image.

    Raises
    ------
    InputError
        If the clamp's edge is not visible.
    """
    pixels = _image_with_clamp(image, calibration.clamp_midpoint_px)
    try:
        midpoint = measure_clamp(pixels, specimen, calibration)
    except ValueError as error:
        raise InputError(f"{image}: {error}") from error
    return calibration.model_copy(update={"clamp_midpoint_px": midpoint})


def with_measured_gravity(calibration: Calibration, image: Path, roughly_deg: float) -> tuple[Calibration, list[str]]:
    """Return the calibration with the direction of gravity measured on an image of a plumb line.

    Parameters
    ----------
    calibration : Calibration
        The calibration to change.
    image : Path
        A dark thread with a weight in front of the back-light.
    roughly_deg : float
        Approximate direction of gravity, clockwise from +x.

    Returns
    -------
    calibration : Calibration
        The changed calibration.
    lines : list of str
        Text about the direction of gravity and its uncertainty.

    Raises
    ------
    InputError
        If the image shows no straight thread.
    """
    try:
        plumb = measure_plumb_line(read_grey(image), calibration, roughly_deg)
    except ValueError as error:
        raise InputError(f"{image}: {error}") from error
    changed: dict[str, object] = {"gravity_angle_deg": plumb.gravity_angle_deg}
    if calibration.uncertainty is not None:
        of_gravity = {"gravity_angle_deg": plumb.gravity_angle_sigma_deg}
        changed["uncertainty"] = calibration.uncertainty | of_gravity
    line = (
        f"gravity at {plumb.gravity_angle_deg:.3f} ± {plumb.gravity_angle_sigma_deg:.2g} degrees; "
        f"the thread is straight to {plumb.residual_px:.3f} px RMS"
    )
    return calibration.model_copy(update=changed), [line]


def _scale_quality(calibration: Calibration, source: str) -> str:
    """Return in words how accurate the scale is, and what it was measured on (`source`)."""
    share = (calibration.uncertainty or {}).get("pixels_per_mm", math.nan) / calibration.pixels_per_mm
    return (
        f"scale from {source}: standard uncertainty {100.0 * share:.2g} %; a board in the beam's plane gives about "
        "0.1 %"
    )


def _day_of(images: Sequence[Path]) -> date:
    return datetime.fromtimestamp(max(path.stat().st_mtime for path in images), UTC).date()
