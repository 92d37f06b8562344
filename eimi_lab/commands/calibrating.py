"""The command `calibrate`, which measures a calibration from pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force
from eimi_lab.process.errors import InputError

if TYPE_CHECKING:  # OpenCV is slow to import, and most commands do not need it
    from eimi_lab.vision.calibration.board import Board


def calibrate(
    images: Annotated[
        list[Path] | None,
        typer.Argument(help="images of a calibration board, or one image of the beam or of a ruler"),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="file to write",
            show_default="calibration.toml; board.pdf with --print-board",
        ),
    ] = None,
    board: Annotated[
        str | None, typer.Option(metavar="charuco|checkerboard|circles", help="pattern of the board")
    ] = None,
    columns: Annotated[int, typer.Option(help="number of squares or circles in a row of the board")] = 20,
    rows: Annotated[int, typer.Option(help="number of rows of the board: rows of squares or of circles")] = 16,
    square_mm: Annotated[
        float, typer.Option(help="side of a square, or distance between the centres of neighbouring circles, in mm")
    ] = 2.0,
    board_error_percent: Annotated[
        float, typer.Option(help="standard uncertainty of the scale of the printed board, in per cent", min=0)
    ] = 0.1,
    print_board: Annotated[
        bool, typer.Option("--print-board", help="only write the board as a PDF for printing in true size")
    ] = False,
    mid_plane: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="image in which the board lies in the middle plane of the beam; this image gives the scale",
            show_default="first of IMAGES",
        ),
    ] = None,
    specimen: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="specimen.toml of the beam. Without --beam, the scale is computed from the width of the beam in "
            "IMAGES; with --beam, the specimen is used only to find the clamp",
        ),
    ] = None,
    width_tolerance_mm: Annotated[
        float, typer.Option(help="standard uncertainty of the width of the beam, in mm", min=0)
    ] = 0.05,
    ruler_px: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(metavar="X Y X Y", help="two points of a ruler in the image, in px"),
    ] = None,
    ruler_mm: Annotated[
        float,
        typer.Option(help="distance between the two points, in mm; needed with --ruler-px", show_default=False),
    ] = 0.0,
    coil_constant: Annotated[
        float | None,
        typer.Option(help="field of the coil at the magnet, in mT for each ampere", show_default="no coil"),
    ] = None,
    clamp_midpoint_px: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="X Y", help="middle of the line at which the beam leaves the clamp, in px"),
    ] = None,
    beam: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="image of the beam at rest, in which the position of the clamp is measured; then --clamp-midpoint-px "
            "may be an estimate",
        ),
    ] = None,
    plumb_line: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="image of a dark thread with a weight, which shows the direction of gravity"),
    ] = None,
    axis_angle: Annotated[
        float,
        typer.Option(
            metavar="DEG",
            help="direction of the straight beam in degrees, clockwise from +x of the image (to the right)",
        ),
    ] = 90.0,
    gravity_angle: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="direction of gravity in degrees, clockwise from +x of the image (to the right); with --plumb-line, "
            "an estimate is enough",
            show_default="--axis-angle; 90 with --plumb-line",
        ),
    ] = None,
    field_angle: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="direction of the field of a positive current in degrees, clockwise from +x of the image (to the "
            "right)",
            show_default="--axis-angle minus 90",
        ),
    ] = None,
    telecentric: Annotated[
        bool,
        typer.Option(
            "--telecentric", help="the lens is telecentric: the scale does not depend on the distance of the beam"
        ),
    ] = False,
    force: Force = False,
) -> Result:
    """Measure scale, distortion and orientation from images.

    The images show a board, the beam or a ruler; give --board, --specimen or --ruler-px.
    """
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.process.outputs import check_distinct, refuse_existing
    from eimi_lab.vision.calibration import calibration_file
    from eimi_lab.vision.calibration.writing import write_calibration

    output = output or Path("board.pdf" if print_board else "calibration.toml")
    inputs = (*(images or []), mid_plane, beam, plumb_line, Path(specimen) if specimen else None)
    check_distinct([path for path in dict.fromkeys(inputs) if path], [output])
    refuse_existing(output, force)
    if print_board:
        _write_board(_board(board or "charuco", columns, rows, square_mm), output, force)
        return Result([output], {"board": output})
    if beam is not None and (specimen is None or (board is None and ruler_px is None)):
        raise InputError("--beam: also needs --specimen and, for the scale, --board or --ruler-px")
    if sum(way is not None for way in (board, None if beam else specimen, ruler_px)) != 1:
        raise InputError("give exactly one of --board, --specimen and --ruler-px, from which the scale is measured")
    pattern = _board(board, columns, rows, square_mm) if board else None
    if not images or (pattern is None and len(images) > 1):
        raise InputError("IMAGES: give the images of the board, or one image of the beam or of the ruler")
    if clamp_midpoint_px is None:
        raise InputError(
            "--clamp-midpoint-px is missing; give the pixel at which the middle of the beam leaves the clamp"
        )
    if coil_constant is not None and coil_constant <= 0:
        raise InputError(
            f"--coil-constant {coil_constant:g}: should be greater than 0; without a coil, leave --coil-constant out"
        )
    estimate = 90.0 if plumb_line else axis_angle  # cameras are seldom upside down
    gravity = estimate if gravity_angle is None else gravity_angle
    field = axis_angle - 90.0 if field_angle is None else field_angle
    setup = calibration_file.BenchSetup(coil_constant, clamp_midpoint_px, axis_angle, gravity, field, telecentric)
    if pattern:
        share = board_error_percent / 100.0
        calibration, remarks = calibration_file.from_board(images, mid_plane or images[0], pattern, setup, share)
    elif specimen and not beam:
        if not plumb_line:  # it measures the direction of gravity below
            calibration_file.check_hangs(images[0], axis_angle, gravity, is_measured=False)
        calibration, remarks = calibration_file.from_beam(images[0], load_specimen(specimen), setup, width_tolerance_mm)
    else:
        calibration, remarks = calibration_file.from_ruler(images[0], ruler_px or (0.0, 0.0, 0.0, 0.0), ruler_mm, setup)
    if beam and specimen:
        calibration = calibration_file.with_measured_clamp(calibration, beam, load_specimen(specimen))
        x, y = calibration.clamp_midpoint_px
        remarks.append(f"middle of the clamp: x = {x:.2f}, y = {y:.2f} px")
    if plumb_line:
        calibration, more = calibration_file.with_measured_gravity(calibration, plumb_line, gravity)
        if specimen and not beam:
            axis, down = calibration.axis_angle_deg, calibration.gravity_angle_deg
            calibration_file.check_hangs(images[0], axis, down, is_measured=True)
        remarks += more
    write_calibration(calibration, output, force)
    if calibration.uncertainty:
        remarks.append(f"{calibration.pixels_per_mm:.4f} ± {calibration.uncertainty['pixels_per_mm']:.2g} px/mm")
        remarks.append(
            f"direction of the straight beam: {calibration.axis_angle_deg:.3f} ± "
            f"{calibration.uncertainty['axis_angle_deg']:.2g} degrees"
        )
    content = {"calibration": output, "told": remarks, "values": calibration.model_dump(mode="json")}
    return Result([*remarks, output], content)


def _board(kind: str, columns: int, rows: int, square_mm: float) -> Board:
    from eimi_lab.vision.calibration.board import Board

    try:
        return Board(kind, columns, rows, square_mm)  # type: ignore[arg-type]
    except ValueError as error:
        raise InputError(f"--board, --columns, --rows, --square-mm: {error}") from None


def _write_board(board: Board, output: Path, force: bool) -> None:
    from eimi_lab.process.outputs import whole_file
    from eimi_lab.vision.calibration.board import print_board

    with whole_file(output, force) as temporary:
        print_board(board, temporary)
