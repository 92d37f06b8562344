"""Making a calibration.toml: from images of a board, of the beam at rest, or from two ends of a ruler.

The clamp's place and the direction of gravity may come from pictures of their own.
"""

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
from eimi_lab.config.toml import check, parse
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import write_file
from eimi_lab.vision.calibration.board import Board
from eimi_lab.vision.calibration.known_width import measure_beam, measure_clamp
from eimi_lab.vision.calibration.lens import FEWEST_VIEWS, BoardPose, Lens, View, calibrate_lens, place_in_plane
from eimi_lab.vision.calibration.plumb_line import measure_plumb_line
from eimi_lab.vision.image_files import read_grey

MOST_TILT_DEG = 5.0
READING_PX = 1.0  # standard deviation of a point that a person reads off an image


@dataclass(frozen=True)
class BenchSetup:
    """What no image tells: the coil, where the clamp is, and which way is which (degrees clockwise from +x).

    The axis angle need only be right to some degrees where a board or a beam shows it better; gravity and field keep
    their angles to it.
    """

    coil_constant_mT_per_A: float
    clamp_midpoint_px: tuple[float, float]
    axis_angle_deg: float
    gravity_angle_deg: float
    field_angle_deg: float
    telecentric: bool = False

    def calibration(
        self, pixels_per_mm: float, turned_deg: float, uncertainty: dict[str, float], on: date
    ) -> Calibration:
        """A calibration with the axis and all that goes with it turned by some degrees. Raises InputError."""
        table = {
            "pixels_per_mm": pixels_per_mm,
            "coil_constant_mT_per_A": self.coil_constant_mT_per_A,
            "clamp_midpoint_px": self.clamp_midpoint_px,
            "axis_angle_deg": self.axis_angle_deg + turned_deg,
            "gravity_angle_deg": self.gravity_angle_deg + turned_deg,
            "field_angle_deg": self.field_angle_deg + turned_deg,
            "telecentric": self.telecentric,
            "calibrated_on": on,
            "uncertainty": uncertainty,
        }
        return check(Calibration, table, "", "calibrate")


def from_board(
    images: Sequence[Path], mid_plane: Path, board: Board, setup: BenchSetup, board_error: float
) -> tuple[Calibration, list[str]]:
    """Lens, scale and orientation from images of a board; also lines that tell how well. Raises InputError.

    mid_plane: the image in which the board lies in the beam's middle plane, along the beam. From less than four
    images, or through a telecentric lens, the lens's own distortion is not found. board_error: of the print, a share.
    """
    paths = list(dict.fromkeys([*images, mid_plane]))
    views, size = _views_of(board, paths)
    _check_clamp(mid_plane, size, setup.clamp_midpoint_px)
    view, lens, stand_off_mm = views[mid_plane], None, None
    told: list[str] = []
    if not setup.telecentric and len(paths) < FEWEST_VIEWS:
        told.append(f"lens: not calibrated; that takes {FEWEST_VIEWS} or more views, most of them tilted")
    elif not setup.telecentric:
        lens, stand_off_mm = _lens_of(views, size, view)
        view = (view[0], lens.undistort(view[1]))
        told.append(f"lens: {lens.residual_px:.3f} px RMS over {len(paths)} views")
    pose = place_in_plane(view, board_error)
    if pose.tilt_deg > MOST_TILT_DEG:
        raise InputError(
            f"{mid_plane}: the board is tilted by {pose.tilt_deg:.1f} degrees; hold it in the beam's middle plane, or "
            "name the image in which it is there with --mid-plane"
        )
    told.append(f"mid-plane: {pose.residual_px:.3f} px RMS, tilted by about {pose.tilt_deg:.1f} degrees")
    return _with_board_and_lens(setup, pose, lens, stand_off_mm, _day_of(paths)), told


def _views_of(board: Board, paths: Sequence[Path]) -> tuple[dict[Path, View], tuple[int, int]]:
    """What each image shows of the board, and the images' width and height. Raises InputError."""
    views: dict[Path, View] = {}
    size: tuple[int, int] | None = None
    for path in paths:
        image = read_grey(path)
        if size not in (None, image.shape[::-1]):
            raise InputError(f"{path}: is {image.shape[1]} x {image.shape[0]} px; {paths[0].name} is another size")
        size = (image.shape[1], image.shape[0])
        found = board.find(image)
        if found is None:
            raise InputError(
                f"{path}: shows no {board.kind} board of {board.columns} x {board.rows}; check --board, --columns and "
                "--rows, and that the picture is sharp"
            )
        views[path] = found
    assert size is not None  # there is at least the image of the mid-plane
    return views, size


def _lens_of(views: dict[Path, View], size: tuple[int, int], mid_plane: View) -> tuple[Lens, float]:
    """The lens, and its distance from the board of the mid-plane in mm. Raises InputError."""
    try:
        lens = calibrate_lens(list(views.values()), size)
        return lens, lens.stand_off_mm(mid_plane)
    except ValueError as error:
        raise InputError(f"{next(iter(views))} and {len(views) - 1} more: {error}") from error


def _with_board_and_lens(
    setup: BenchSetup, pose: BoardPose, lens: Lens | None, stand_off_mm: float | None, on: date
) -> Calibration:
    turned = (pose.angle_deg - setup.axis_angle_deg + 45.0) % 90.0 - 45.0  # to the nearer of the board's directions
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
    seen = {
        "camera_matrix": matrix,
        "distortion": tuple(map(float, lens.distortion)),
        "stand_off_mm": stand_off_mm,
        "uncertainty": of_board | of_lens,
    }
    return calibration.model_copy(update=seen)


def from_beam(
    image: Path, specimen: SpecimenFile, setup: BenchSetup, tolerance_mm: float
) -> tuple[Calibration, list[str]]:
    """Scale, clamp and axis from the beam at rest, whose width is known to `tolerance_mm`. Raises InputError."""
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
    return calibration, [_how_well(calibration, f"width_mm = {width:g} ± {tolerance_mm:g}")]


def from_ruler(
    image: Path, ends_px: tuple[float, float, float, float], length_mm: float, setup: BenchSetup
) -> tuple[Calibration, list[str]]:
    """Scale from the two ends (x1, y1, x2, y2) of a known length in the beam's middle plane. Raises InputError."""
    height, width = _image_with_clamp(image, setup.clamp_midpoint_px).shape
    if not (
        0 <= min(ends_px[::2]) <= max(ends_px[::2]) < width and 0 <= min(ends_px[1::2]) <= max(ends_px[1::2]) < height
    ):
        raise InputError(f"{image}: is {width} x {height} px; the ruler's ends {ends_px} are not both in it")
    long_px = math.dist(ends_px[:2], ends_px[2:])
    if not (0 < length_mm < math.inf and long_px > 20 * READING_PX):
        raise InputError(
            f"{image}: --ruler-mm {length_mm:g} over {long_px:.1f} px gives no scale; it should be a length that "
            f"the image shows more than {20 * READING_PX:g} px long"
        )
    uncertainty = {
        "pixels_per_mm": math.sqrt(2.0) * READING_PX / length_mm,
        "axis_angle_deg": 1.0,
        "clamp_midpoint_px": READING_PX,
    }
    calibration = setup.calibration(long_px / length_mm, 0.0, uncertainty, _day_of([image]))
    return calibration, [_how_well(calibration, f"{length_mm:g} mm read off by eye")]


def _check_clamp(image: Path, size: tuple[int, ...], midpoint_px: tuple[float, float]) -> None:
    """Raise InputError where the clamp's midpoint is not in an image of so many pixels across and down."""
    if not all(0 <= place < extent for place, extent in zip(midpoint_px, size, strict=True)):
        x, y = midpoint_px
        raise InputError(f"{image}: is {size[0]} x {size[1]} px; --clamp-midpoint-px {x:g} {y:g} is not in it")


def _image_with_clamp(image: Path, midpoint_px: tuple[float, float]) -> NDArray[Any]:
    pixels = read_grey(image)
    _check_clamp(image, pixels.shape[::-1], midpoint_px)
    return pixels


def with_clamp_of(calibration: Calibration, image: Path, specimen: SpecimenFile) -> Calibration:
    """The calibration with the clamp's place from an image of the beam. Raises InputError."""
    pixels = _image_with_clamp(image, calibration.clamp_midpoint_px)
    try:
        midpoint = measure_clamp(pixels, specimen, calibration)
    except ValueError as error:
        raise InputError(f"{image}: {error}") from error
    return calibration.model_copy(update={"clamp_midpoint_px": midpoint})


def with_gravity_of(calibration: Calibration, image: Path, roughly_deg: float) -> tuple[Calibration, list[str]]:
    """The calibration with gravity along a plumb line in an image, and a line to say how well. Raises InputError."""
    try:
        plumb = measure_plumb_line(read_grey(image), calibration, roughly_deg)
    except ValueError as error:
        raise InputError(f"{image}: {error}") from error
    changed: dict[str, object] = {"gravity_angle_deg": plumb.gravity_angle_deg}
    if calibration.uncertainty is not None:
        told = {"gravity_angle_deg": plumb.gravity_angle_sigma_deg}
        changed["uncertainty"] = calibration.uncertainty | told
    line = (
        f"gravity at {plumb.gravity_angle_deg:.3f} ± {plumb.gravity_angle_sigma_deg:.2g} degrees; "
        f"thread straight to {plumb.residual_px:.3f} px RMS"
    )
    return calibration.model_copy(update=changed), [line]


def write_calibration(calibration: Calibration, path: Path, force: bool) -> None:
    """Write a calibration.toml. Raises InputError."""
    uncertain = calibration.uncertainty
    lines = [
        f"pixels_per_mm = {calibration.pixels_per_mm:.6f}",
        f"coil_constant_mT_per_A = {calibration.coil_constant_mT_per_A!r}",
        f"clamp_midpoint_px = {_listed(calibration.clamp_midpoint_px)}",
        f"axis_angle_deg = {calibration.axis_angle_deg:.5f}       # clockwise from the image's +x, as all angles",
        f"gravity_angle_deg = {calibration.gravity_angle_deg:.5f}",
        f"field_angle_deg = {calibration.field_angle_deg:.5f}",
    ]
    if not calibration.gravity:
        lines.append("gravity = false")
    if calibration.camera_matrix is not None and calibration.distortion is not None:
        lines.append("camera_matrix = [" + ", ".join(map(_listed, calibration.camera_matrix)) + "]")
        lines.append(f"distortion = {_listed(calibration.distortion)}")
    if calibration.stand_off_mm is not None:
        lines.append(f"stand_off_mm = {calibration.stand_off_mm:.3f}")
    if calibration.telecentric:
        lines.append("telecentric = true")
    if calibration.calibrated_on is not None:
        lines.append(f"calibrated_on = {calibration.calibrated_on.isoformat()}")
    if uncertain is not None:
        lines += ["", "[uncertainty]    # standard uncertainties of the numbers above; add what else you know"]
        lines += [f"{name} = {value:.3g}" for name, value in uncertain.items()]
    text = "\n".join(lines) + "\n"
    parse(Calibration, text, path)
    write_file(path, text, force)


def _listed(numbers: Sequence[float]) -> str:
    return "[" + ", ".join(f"{number:.8g}" if number % 1 else f"{number:.1f}" for number in numbers) + "]"


def _how_well(calibration: Calibration, source: str) -> str:
    share = (calibration.uncertainty or {}).get("pixels_per_mm", math.nan) / calibration.pixels_per_mm
    return f"scale from {source}: uncertain by {100.0 * share:.2g} %; a board in the beam's plane gives about 0.1 %"


def _day_of(images: Sequence[Path]) -> date:
    """The day on which the newest image file was written."""
    return datetime.fromtimestamp(max(path.stat().st_mtime for path in images), UTC).date()
