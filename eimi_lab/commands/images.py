"""Commands that make edges of images: import, calibration, segmentation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eimi_lab.commands.picture_options import PictureOptions, ask_where
from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force, Output, Specimen, Workers, with_fields
from eimi_lab.commands.track_options import ImportOptions
from eimi_lab.process.errors import InputError

if TYPE_CHECKING:  # OpenCV is slow to load, and most commands do without
    from eimi_lab.config.specimen import SpecimenFile
    from eimi_lab.vision.calibration.board import Board

Dark = Annotated[
    Path | None, typer.Option(help="image taken without light, to take off every frame; the dataset keeps it")
]
Flat = Annotated[
    Path | None, typer.Option(help="image of the bare back-light, to even out the light; the dataset keeps it")
]


@with_fields(ImportOptions)
def import_(
    source: Annotated[
        Path,
        typer.Argument(help="folder of images, an image, a video, points.csv, or with --format a tracking tool's file"),
    ],
    states: Annotated[
        Path,
        typer.Option(help="states.csv: frame (or time_s, state), current_A or field_mT, tip_force_N, its _angle_deg"),
    ],
    specimen: Specimen,
    output: Output,
    calibration: Annotated[Path | None, typer.Option(help="calibration.toml, for images")] = None,
    gravity_angle: Annotated[
        float | None,
        typer.Option(help="for tracked points: gravity in the beam frame, degrees from +x toward +y; 0 hangs down"),
    ] = None,
    no_gravity: Annotated[
        bool, typer.Option("--no-gravity", help="for tracked points: their beam's weight does not bend it")
    ] = False,
    average: Annotated[bool, typer.Option("--average", help="keep the mean of a state's frames, not each")] = False,
    dark: Dark = None,
    flat: Flat = None,
    *,
    options: ImportOptions,
    force: Force = False,
) -> Result:
    """Make a dataset of images, a video or tracked points that a lab already has."""
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.dataset.listing import is_image, is_video
    from eimi_lab.dataset.tracked.points_csv import import_points
    from eimi_lab.process.outputs import check_distinct

    _check_source(source, states)
    given = (source, states, Path(specimen), calibration, dark, flat)
    check_distinct([path for path in dict.fromkeys(given) if path], [output])
    tables = _Tables(source, states, load_specimen(specimen), output, force)
    if options.format is not None:
        if dark or flat or average:
            raise InputError("--dark, --flat and --average: belong to pictures, not to points")
        count = _import_tracks(tables, options, calibration, gravity_angle, not no_gravity)
    else:
        options.refuse_track_options()
        if source.is_dir() or is_video(source) or is_image(source):
            if calibration is None or gravity_angle is not None or no_gravity:
                raise InputError(
                    f"{source}: images need --calibration, which holds gravity's direction or gravity = false"
                )
            count = _import_pictures(tables, options, str(calibration), average, (dark, flat))
        else:
            has_none = gravity_angle is None and not no_gravity
            if has_none or calibration or dark or flat or options.changes():
                raise InputError(
                    f"{source}: tracked points need --gravity-angle or --no-gravity, and nothing of pictures: no "
                    "--calibration, --dark, --flat, --clamp and the like; or is it another tool's file? Then --format"
                )
            count = import_points(source, states, tables.beam, gravity_angle, output, force, not no_gravity)
    return Result([f"{output}: {count} state{'s' if count > 1 else ''}"], {"dataset": output, "states": count})


@dataclass(frozen=True)
class _Tables:
    """What every import has."""

    source: Path
    states: Path
    beam: SpecimenFile
    output: Path
    force: bool


def _import_pictures(
    tables: _Tables,
    options: ImportOptions,
    calibration: str,
    average: bool,
    dark_and_flat: tuple[Path | None, Path | None],
) -> int:
    from eimi_lab.config.calibration import load_calibration, missing_places
    from eimi_lab.dataset.dark_and_flat import read_correction_images
    from eimi_lab.dataset.importing import import_frames
    from eimi_lab.process.outputs import refuse_existing
    from eimi_lab.process.progress import progress

    source, states, output = tables.source, tables.states, tables.output
    refuse_existing(output, tables.force)
    changes = options.changes()
    if missing := missing_places(calibration, changes):
        raise ask_where(missing, source, states, calibration, output)
    seen = load_calibration(calibration, changes)
    correction = read_correction_images(*dark_and_flat)
    return import_frames(source, states, tables.beam, seen, output, tables.force, average, progress, correction)


def _import_tracks(
    tables: _Tables, options: ImportOptions, calibration: Path | None, gravity_angle: float | None, gravity: bool
) -> int:
    from eimi_lab.config.calibration import load_calibration
    from eimi_lab.dataset.tracked.tracked_states import import_tracks

    if calibration is not None and gravity_angle is not None:
        raise InputError("--gravity-angle: the calibration tells it; give one of them")
    placing = options.placing(load_calibration(calibration) if calibration else None)
    tool = options.format or ""
    source, states, output = tables.source, tables.states, tables.output
    return import_tracks(source, tool, states, tables.beam, placing, gravity_angle, output, tables.force, gravity)


def _check_source(source: Path, states: Path) -> None:
    """Raise InputError for what is no source, and for one that was given in the place of another argument."""
    if not source.exists():
        raise InputError(f"{source}: no such folder of images, image, video or table of points")
    if states.exists() and source.samefile(states):
        raise InputError(f"{source}: is --states; the first argument is what it lists: images, a video or points")
    if source.suffix.lower() in (".h5", ".hdf5", ".nxs"):
        raise InputError(f"{source}: is a dataset already; `eimi segment` and `eimi fit` take it")
    if source.suffix.lower() == ".toml":
        raise InputError(f"{source}: is a TOML file; the first argument is a folder of images, a video or points.csv")


def calibrate(
    images: Annotated[list[Path] | None, typer.Argument(help="of a board; or one, of the beam or of a ruler")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="the file to write [calibration.toml; board.pdf]")
    ] = None,
    board: Annotated[str | None, typer.Option(metavar="charuco|checkerboard|circles", help="the pattern")] = None,
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
) -> Result:
    """Scale, distortion and orientation from images of a board, of the beam itself, or of a ruler."""
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.process.outputs import check_distinct, refuse_existing
    from eimi_lab.vision.calibration import calibration_file

    output = output or Path("board.pdf" if print_board else "calibration.toml")
    given = (*(images or []), mid_plane, beam, plumb_line, Path(specimen) if specimen else None)
    check_distinct([path for path in dict.fromkeys(given) if path], [output])
    refuse_existing(output, force)
    if print_board:
        _write_board(_board(board or "charuco", columns, rows, square_mm), output, force)
        return Result([output], {"board": output})
    if beam is not None and (specimen is None or (board is None and ruler_px is None)):
        raise InputError("--beam goes with --specimen and one of --board and --ruler-px, which give the scale")
    if sum(way is not None for way in (board, None if beam else specimen, ruler_px)) != 1:
        raise InputError("calibrate needs one of --board, --specimen and --ruler-px, and not more than one")
    pattern = _board(board, columns, rows, square_mm) if board else None
    if not images or (pattern is None and len(images) > 1):
        raise InputError("IMAGES: give the images of the board, or the one image of the beam or the ruler")
    if coil_constant is None or coil_constant <= 0 or clamp_midpoint_px is None:
        raise InputError("--coil-constant (greater than 0) and --clamp-midpoint-px are missing: no image tells them")
    gravity = axis_angle if gravity_angle is None else gravity_angle
    field = axis_angle - 90.0 if field_angle is None else field_angle
    setup = calibration_file.BenchSetup(coil_constant, clamp_midpoint_px, axis_angle, gravity, field, telecentric)
    if pattern:
        share = board_error_percent / 100.0
        found, told = calibration_file.from_board(images, mid_plane or images[0], pattern, setup, share)
    elif specimen and not beam:
        found, told = calibration_file.from_beam(images[0], load_specimen(specimen), setup, width_tolerance_mm)
    else:
        found, told = calibration_file.from_ruler(images[0], ruler_px or (0.0, 0.0, 0.0, 0.0), ruler_mm, setup)
    if beam and specimen:
        found = calibration_file.with_measured_clamp(found, beam, load_specimen(specimen))
        told.append(f"clamp at {found.clamp_midpoint_px[0]:.2f}, {found.clamp_midpoint_px[1]:.2f} px")
    if plumb_line:
        roughly = 90.0 if gravity_angle is None else gravity_angle  # cameras are seldom upside down
        found, more = calibration_file.with_measured_gravity(found, plumb_line, roughly)
        told += more
    calibration_file.write_calibration(found, output, force)
    if found.uncertainty:
        told.append(f"{found.pixels_per_mm:.4f} ± {found.uncertainty['pixels_per_mm']:.2g} px/mm")
        told.append(f"axis at {found.axis_angle_deg:.3f} ± {found.uncertainty['axis_angle_deg']:.2g} degrees")
    return Result([*told, output], {"calibration": output, "told": told, "values": found.model_dump(mode="json")})


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


@with_fields(PictureOptions)
def segment(
    dataset: Annotated[Path, typer.Argument(help="a dataset of frames")],
    specimen: Annotated[
        str | None, typer.Option(help="specimen.toml to take the place of the stored one, which the dataset keeps too")
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="calibration.toml to take the place of the stored one, which is kept too")
    ] = None,
    csv: Annotated[Path | None, typer.Option(help="folder for the edges as CSV and quality.json")] = None,
    overlay: Annotated[Path | None, typer.Option(help="folder for pictures of the edges on the frames")] = None,
    explain: Annotated[
        Path | None, typer.Option(help="folder for pictures of how the beam is followed from its clamp")
    ] = None,
    dark: Dark = None,
    flat: Flat = None,
    uncorrected: Annotated[
        bool, typer.Option("--uncorrected", help="forget the dark frame and the flat field that the dataset keeps")
    ] = False,
    workers: Workers = 1,
    *,
    options: PictureOptions,
    force: Force = False,
) -> Result:
    """Find the beam's edges in every state and store them in the dataset, as a dark frame and a flat field are."""
    from eimi_lab.dataset.reading import open_dataset
    from eimi_lab.face.segmenting import find_edges
    from eimi_lab.vision.check import leaves_out

    edge_sets, restated = find_edges(
        dataset,
        specimen=specimen,
        calibration=calibration,
        changes=options.changes(),
        csv=csv,
        overlay=overlay,
        explain=explain,
        dark=dark,
        flat=flat,
        uncorrected=uncorrected,
        workers=workers,
        force=force,
    )
    total = len(edge_sets)
    flagged = sum(bool(edge_set.flags) for edge_set in edge_sets)
    unusable = sum(leaves_out(edge_set.flags) for edge_set in edge_sets)
    with open_dataset(dataset) as opened:
        colours = opened.projection()
    lines = list(restated)
    lines += [] if colours is None else [f"colours seen as one: {colours}"]
    lines.append(
        f"{dataset}: edges of {total} state{'s' if total > 1 else ''}, {flagged} with flags, {unusable} unusable"
    )
    flags = [[flag.name for flag in edge_set.flags] for edge_set in edge_sets]
    return Result(
        lines,
        {
            "dataset": dataset,
            "states": total,
            "flagged": flagged,
            "unusable": unusable,
            "flags": flags,
            "restated": restated,
        },
    )
