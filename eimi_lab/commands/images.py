"""Commands that make edges of images: import, calibration, segmentation."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.options import Force, Output, Specimen
from eimi_lab.errors import InputError

Dark = Annotated[
    Path | None, typer.Option(help="image taken without light, to take off every frame; the dataset keeps it")
]
Flat = Annotated[
    Path | None, typer.Option(help="image of the bare back-light, to even out the light; the dataset keeps it")
]


def import_(
    source: Annotated[Path, typer.Argument(help="folder of images, video, or points.csv with tracked points")],
    states: Annotated[Path, typer.Option(help="states.csv: frame (or state), current_A or field_mT, tip_force_N")],
    specimen: Specimen,
    output: Output,
    calibration: Annotated[Path | None, typer.Option(help="calibration.toml, for images")] = None,
    gravity_angle: Annotated[
        float | None,
        typer.Option(help="for tracked points: gravity in the beam frame, degrees from +x toward +y; 0 hangs down"),
    ] = None,
    average: Annotated[bool, typer.Option("--average", help="keep the mean of a state's frames, not each")] = False,
    dark: Dark = None,
    flat: Flat = None,
    force: Force = False,
) -> None:
    """Make a dataset of images, a video or tracked points that a lab already has."""
    from eimi_lab.config.calibration import load_calibration
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.dataset.corrections import read_correction_images
    from eimi_lab.dataset.importing import VIDEOS, import_frames, import_points
    from eimi_lab.progress import progress

    if not source.exists():
        raise InputError(f"{source}: no such folder of images, video or table of points")
    beam = load_specimen(specimen)
    if source.is_dir() or source.suffix.lower() in VIDEOS:
        if calibration is None or gravity_angle is not None:
            raise InputError(f"{source}: images need --calibration, which holds the direction of gravity as well")
        seen = load_calibration(calibration)
        correction = read_correction_images(dark, flat)
        count = import_frames(source, states, beam, seen, output, force, average, progress, correction)
    else:
        if gravity_angle is None or calibration is not None or dark is not None or flat is not None:
            raise InputError(f"{source}: tracked points need --gravity-angle and no --calibration, --dark or --flat")
        count = import_points(source, states, beam, gravity_angle, output, force)
    print(f"{output}: {count} states")


def calibrate(
    output: Annotated[Path, typer.Option("-o", "--output", help="calibration.toml, or the board's PDF")],
    images: Annotated[list[Path] | None, typer.Argument(help="of a board; or one, of the beam or of a ruler")] = None,
    board: Annotated[str | None, typer.Option(help="charuco, checkerboard or circles")] = None,
    columns: Annotated[int, typer.Option(help="squares (or circles) in a row of the board")] = 20,
    rows: Annotated[int, typer.Option(help="rows of the board")] = 16,
    square_mm: Annotated[float, typer.Option(help="side of a square, or distance of the circles' centres")] = 2.0,
    board_error_percent: Annotated[float, typer.Option(help="by how much the print's scale may be wrong", min=0)] = 0.1,
    print_board: Annotated[
        bool, typer.Option("--print-board", help="write the board as a PDF to scale, no more")
    ] = False,
    mid_plane: Annotated[
        Path | None, typer.Option(help="image of the board in the beam's middle plane; else the first")
    ] = None,
    specimen: Annotated[
        str | None,
        typer.Option(help="specimen.toml of the beam at rest in the image, when there is no board; or in --beam"),
    ] = None,
    width_tolerance_mm: Annotated[float, typer.Option(help="by how much its width may be wrong", min=0)] = 0.05,
    ruler_px: Annotated[
        tuple[float, float, float, float] | None, typer.Option(help="without a board: x y of both ends of a length")
    ] = None,
    ruler_mm: Annotated[float, typer.Option(help="that length")] = 0.0,
    coil_constant: Annotated[float | None, typer.Option(help="mT per ampere at the specimen")] = None,
    clamp_midpoint_px: Annotated[
        tuple[float, float] | None, typer.Option(help="x y of the middle of the clamp line, where the beam comes out")
    ] = None,
    beam: Annotated[
        Path | None, typer.Option(help="image of the beam at rest, to measure --clamp-midpoint-px, which is then rough")
    ] = None,
    plumb_line: Annotated[
        Path | None, typer.Option(help="image of a dark thread with a weight, to measure the direction of gravity")
    ] = None,
    axis_angle: Annotated[float, typer.Option(help="undeformed beam, degrees clockwise from the image's +x")] = 90.0,
    gravity_angle: Annotated[
        float | None, typer.Option(help="gravity; else along the beam. Beside --plumb-line: roughly, else down")
    ] = None,
    field_angle: Annotated[float | None, typer.Option(help="positive coil field; else 90 degrees less")] = None,
    telecentric: Annotated[bool, typer.Option("--telecentric", help="the lens is telecentric")] = False,
    force: Force = False,
) -> None:
    """Scale, distortion and orientation from images of a board, of the beam itself, or of a ruler."""
    from eimi_lab import calibrating
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.outputs import refuse_existing, whole_file
    from eimi_lab.vision.board import Board
    from eimi_lab.vision.board import print_board as write_board

    refuse_existing(output, force)
    if beam is not None and (specimen is None or (board is None and ruler_px is None)):
        raise InputError("--beam goes with --specimen and one of --board and --ruler-px, which give the scale")
    if sum(way is not None for way in (board, None if beam else specimen, ruler_px)) != 1:
        raise InputError("calibrate needs one of --board, --specimen and --ruler-px, and not more than one")
    try:
        pattern = Board(board, columns, rows, square_mm) if board else None  # type: ignore[arg-type]
    except ValueError as error:
        raise InputError(f"--board, --columns, --rows, --square-mm: {error}") from None
    if print_board:
        if pattern is None:
            raise InputError("--print-board needs --board: charuco, checkerboard or circles")
        with whole_file(output, force) as temporary:
            write_board(pattern, temporary)
        print(output)
        return
    if not images or (pattern is None and len(images) > 1):
        raise InputError("IMAGES: give the images of the board, or the one image of the beam or the ruler")
    if coil_constant is None or coil_constant <= 0 or clamp_midpoint_px is None:
        raise InputError("--coil-constant (greater than 0) and --clamp-midpoint-px are missing: no image tells them")
    gravity = axis_angle if gravity_angle is None else gravity_angle
    field = axis_angle - 90.0 if field_angle is None else field_angle
    setting = calibrating.Setting(coil_constant, clamp_midpoint_px, axis_angle, gravity, field, telecentric)
    if pattern:
        found, told = calibrating.from_board(
            images, mid_plane or images[0], pattern, setting, board_error_percent / 100.0
        )
    elif specimen and not beam:
        found, told = calibrating.from_beam(images[0], load_specimen(specimen), setting, width_tolerance_mm)
    else:
        found, told = calibrating.from_ruler(images[0], ruler_px or (0.0, 0.0, 0.0, 0.0), ruler_mm, setting)
    if beam and specimen:
        found = calibrating.with_clamp_of(found, beam, load_specimen(specimen))
        told.append(f"clamp at {found.clamp_midpoint_px[0]:.2f}, {found.clamp_midpoint_px[1]:.2f} px")
    if plumb_line:
        roughly = 90.0 if gravity_angle is None else gravity_angle  # cameras are seldom upside down
        found, more = calibrating.with_gravity_of(found, plumb_line, roughly)
        told += more
    calibrating.write_calibration(found, output, force)
    uncertain = found.uncertainty
    for line in told:
        print(line)
    if uncertain:
        print(f"{found.pixels_per_mm:.4f} ± {uncertain.pixels_per_mm:.2g} px/mm")
        print(f"axis at {found.axis_angle_deg:.3f} ± {uncertain.axis_angle_deg:.2g} degrees")
    print(output)


def segment(
    dataset: Annotated[Path, typer.Argument(help="a dataset of frames")],
    csv: Annotated[Path | None, typer.Option(help="folder for the edges as CSV and quality.json")] = None,
    overlay: Annotated[Path | None, typer.Option(help="folder for pictures of the edges on the frames")] = None,
    dark: Dark = None,
    flat: Flat = None,
    uncorrected: Annotated[
        bool, typer.Option("--uncorrected", help="forget the dark frame and the flat field that the dataset keeps")
    ] = False,
    force: Force = False,
) -> None:
    """Find the beam's edges in every state and store them in the dataset, as a dark frame and a flat field are."""
    from eimi_lab.dataset.corrections import forget_correction, read_correction_images, store_correction
    from eimi_lab.dataset.reading import open_dataset
    from eimi_lab.outputs import whole_folder
    from eimi_lab.progress import progress
    from eimi_lab.segmentation import segment as find
    from eimi_lab.segmentation import write_csv, write_overlays

    with open_dataset(dataset) as opened:
        total = len(opened.states)
    correction = read_correction_images(dark, flat)
    if uncorrected and correction:
        raise InputError("--uncorrected: goes neither with --dark nor with --flat")
    with ExitStack() as stack:
        unfinished = {folder: stack.enter_context(whole_folder(folder, force)) for folder in (csv, overlay) if folder}
        if correction:
            store_correction(dataset, correction)
        if uncorrected:
            forget_correction(dataset)
        with progress("segment", total) as report:
            edge_sets = find(dataset, report)
        if csv:
            write_csv(unfinished[csv], edge_sets)
        if overlay:
            write_overlays(unfinished[overlay], dataset, edge_sets)
    flagged = sum(bool(edge_set.flags) for edge_set in edge_sets)
    print(f"{dataset}: edges of {total} states, {flagged} with flags")
