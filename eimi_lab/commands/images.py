"""The commands `import` and `segment`, which make a dataset from images and find the edges in a dataset."""

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

if TYPE_CHECKING:  # OpenCV is slow to import, and most commands do not need it
    from eimi_lab.config.specimen import SpecimenFile

Dark = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="image taken without light, which is subtracted from every frame; the dataset stores it"
    ),
]
Flat = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="image of the back-light without the beam, which corrects uneven light; the dataset stores it",
    ),
]


@with_fields(ImportOptions)
def import_(
    source: Annotated[
        Path,
        typer.Argument(
            help="a folder of images, an image, a video, a table of points or, with --format, the file of a tracking "
            "program"
        ),
    ],
    specimen: Specimen,
    output: Output,
    states: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="states.csv with a row for each state (load step). One column identifies the state: frame, time_s or "
            "state. Other columns give the loads: current_A or field_mT, and, for a force at the tip, tip_force_N and "
            "tip_force_angle_deg. Not needed if SOURCE contains only a motion",
            show_default=False,
        ),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(metavar="FILE", help="calibration.toml; needed for images and for states in a video")
    ] = None,
    gravity_angle: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="for tracked points: direction of gravity, from +x (along the straight beam) toward +y (across); 0 "
            "for a beam that hangs down",
        ),
    ] = None,
    no_gravity: Annotated[
        bool, typer.Option("--no-gravity", help="for tracked points: ignore gravity, because it does not bend the beam")
    ] = False,
    average: Annotated[
        bool, typer.Option("--average", help="store the mean frame of each state (load step), not every frame")
    ] = False,
    every: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="for a video: import every N-th frame. With this option, a row of states.csv gives the time (column "
            "time_s) or the number of the frame at which a load begins. The load acts until the time in the column "
            "until_s or, without this column, until the load of the next row begins",
            min=1,
        ),
    ] = None,
    dark: Dark = None,
    flat: Flat = None,
    *,
    options: ImportOptions,
    force: Force = False,
) -> Result:
    """Make a dataset from images, a video or tracked points.

    SOURCE contains states in which the beam is at rest (--states), or a motion (--ring-down or --creep), or both.
    """
    from eimi_lab.config.specimen import load_specimen
    from eimi_lab.dataset.listing import is_image, is_video
    from eimi_lab.dataset.moving.motion_import import add_motions, write_motion_dataset
    from eimi_lab.dataset.moving.recording_checks import flagged_lines
    from eimi_lab.dataset.tracked.points_csv import import_points
    from eimi_lab.face.moving import read_motions
    from eimi_lab.process.outputs import check_distinct, refuse_existing

    facts = options.motion_facts()
    _check_source(source, states)
    inputs = (source, states, Path(specimen), calibration, dark, flat)
    check_distinct([path for path in dict.fromkeys(inputs) if path], [output])
    beam, read = load_specimen(specimen), None
    if facts is not None:
        if states is None and (dark or flat or average or every is not None):
            raise InputError(
                f"{source}: --every, --average, --dark and --flat: are only for states (load steps at rest), which "
                "--states lists; leave them out for a motion"
            )
        refuse_existing(output, force)
        has_gravity = gravity_angle is not None or no_gravity
        if options.format is None:
            options.refuse_track_options()
        read = read_motions(
            source,
            beam,
            facts,
            calibration=calibration,
            changes=options.changes(),
            tool=options.format,
            placing=options.placing,
            has_gravity_direction=has_gravity,
            output=output,
        )
        content = {
            "dataset": output,
            "states": 0,
            "motions": len(read.motions),
            "frames": sum(len(motion.time_s) for motion in read.motions),
            "lost": sum(motion.lost_frames for motion in read.motions),
        }
        if states is None:
            write_motion_dataset(output, read.motions, beam, read.calibration, gravity_angle, not no_gravity, force)
            return Result([f"{output}: {read.in_words}", *flagged_lines(read.motions)], content)
        if options.format is None and not is_video(source):
            raise InputError(
                f"{source}: --states: a table of the points of a motion contains no states (load steps at rest); "
                "import the states into a second dataset, and fit both datasets together"
            )
    if states is None:
        raise InputError("--states is missing; give states.csv or, for a motion, --ring-down or --creep")
    tables = _Tables(source, states, beam, output, force)
    if every is not None and (options.format is not None or not is_video(source)):
        raise InputError(f"--every {every}: is for a video only, but {source} is not a video; leave --every out")
    if options.format is not None:
        if dark or flat or average:
            raise InputError("--dark, --flat and --average: are only for images; leave them out for tracked points")
        count = _import_tracks(tables, options, calibration, gravity_angle, not no_gravity)
    else:
        options.refuse_track_options()
        if source.is_dir() or is_video(source) or is_image(source):
            if calibration is None or gravity_angle is not None or no_gravity:
                raise InputError(
                    f"{source}: images need --calibration, which also gives the direction of gravity; leave out "
                    "--gravity-angle and --no-gravity"
                )
            count = _import_pictures(tables, options, str(calibration), average, every, (dark, flat))
        else:
            has_none = gravity_angle is None and not no_gravity
            if has_none or calibration or dark or flat or options.changes():
                raise InputError(
                    f"{source}: a table of tracked points needs --gravity-angle or --no-gravity; leave out options for "
                    "images such as --calibration, --dark, --flat and --clamp; for a file of a tracking program, add "
                    "--format"
                )
            count = import_points(source, states, tables.beam, gravity_angle, output, force, not no_gravity)
    line = f"{output}: {count} state{'s' if count > 1 else ''}"
    if read is not None:
        add_motions(output, read.motions, beam)
        return Result([f"{line}, {read.in_words}", *flagged_lines(read.motions)], {**content, "states": count})
    return Result([line], {"dataset": output, "states": count})


@dataclass(frozen=True)
class _Tables:
    """The input of an import of load steps.

    `source` contains the images, `states` is the table of load steps (states.csv), `beam` is the content of
    specimen.toml, and `output` is the dataset. `force` tells whether an existing dataset is replaced.
    """

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
    every: int | None,
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
        raise ask_where(missing, source, states, calibration, output, every)
    changed = load_calibration(calibration, changes)
    correction = read_correction_images(*dark_and_flat)
    return import_frames(
        source, states, tables.beam, changed, output, tables.force, average, progress, correction, every
    )


def _import_tracks(
    tables: _Tables, options: ImportOptions, calibration: Path | None, gravity_angle: float | None, gravity: bool
) -> int:
    from eimi_lab.config.calibration import load_calibration
    from eimi_lab.dataset.tracked.tracked_states import import_tracks

    if calibration is not None and gravity_angle is not None:
        raise InputError(
            "--gravity-angle: the calibration also gives the direction of gravity; leave out --gravity-angle or "
            "--calibration"
        )
    placing = options.placing(load_calibration(calibration) if calibration else None)
    tool = options.format or ""
    source, states, output = tables.source, tables.states, tables.output
    return import_tracks(source, tool, states, tables.beam, placing, gravity_angle, output, tables.force, gravity)


def _check_source(source: Path, states: Path | None) -> None:
    """Raise InputError if `source` does not exist, is a dataset, a TOML file or the table of load steps."""
    if not source.exists():
        raise InputError(f"{source}: no such file or folder; give a folder of images, an image, a video or points.csv")
    if states is not None and states.exists() and source.samefile(states):
        raise InputError(
            f"{source}: is also given with --states; the first argument should be the images, the video or the points"
        )
    if source.suffix.lower() in (".h5", ".hdf5", ".nxs"):
        raise InputError(f"{source}: is a dataset already; continue with `eimi segment` or `eimi fit`")
    if source.suffix.lower() == ".toml":
        raise InputError(
            f"{source}: is a TOML file; the first argument should be a folder of images, a video or points.csv"
        )


@with_fields(PictureOptions)
def segment(
    dataset: Annotated[Path, typer.Argument(help="dataset with frames of the beam")],
    specimen: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="corrected specimen.toml, which replaces the specimen in the dataset; the old specimen is kept there "
            "as a record",
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="corrected calibration.toml, which replaces the calibration in the dataset; the old calibration is "
            "kept there as a record",
        ),
    ] = None,
    csv: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="folder for the edges as CSV files, and for the flags (failed quality checks) as quality.json",
        ),
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="folder for pictures of the frames with their edges")
    ] = None,
    explain: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="folder for pictures that show how the beam was followed from the clamp to the tip"
        ),
    ] = None,
    dark: Dark = None,
    flat: Flat = None,
    uncorrected: Annotated[
        bool, typer.Option("--uncorrected", help="remove the dark frame and the flat field from the dataset")
    ] = False,
    workers: Workers = 1,
    *,
    options: PictureOptions,
    force: Force = False,
) -> Result:
    """Find the edges of the beam in every state (load step).

    The edges are stored in the dataset. If a dark frame and a flat field are given, they are stored too.
    """
    from eimi_lab.dataset.moving.recording_checks import flagged_lines
    from eimi_lab.dataset.reading import open_dataset
    from eimi_lab.face.segmenting import find_edges
    from eimi_lab.vision.check import Severity, leaves_out

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
    flagged = sum(any(flag.severity is not Severity.NOTE for flag in edge_set.flags) for edge_set in edge_sets)
    unusable = sum(leaves_out(edge_set.flags) for edge_set in edge_sets)
    with open_dataset(dataset) as opened:
        colours, ring_downs, creeps = opened.projection(), opened.ring_downs(), opened.creeps()
    lines = list(restated)
    lines += (
        [] if colours is None else [f"weights of the colours from which the program computes grey values: {colours}"]
    )
    lines.append(
        f"{dataset}: edges of {total} state{'s' if total > 1 else ''}, {flagged} with flags, {unusable} unusable"
    )
    if ring_downs or creeps:
        lines.append(f"{dataset}: points of {len(ring_downs)} ring-downs and of {len(creeps)} states with creep")
        lines += flagged_lines([*ring_downs, *creeps])
    flags = [[flag.name for flag in edge_set.flags] for edge_set in edge_sets]
    return Result(
        lines,
        {
            "dataset": dataset,
            "states": total,
            "flagged": flagged,
            "unusable": unusable,
            "flags": flags,
            "ring_downs": len(ring_downs),
            "creeps": len(creeps),
            "lost": [motion.lost_frames for motion in (*ring_downs, *creeps)],
            "restated": restated,
        },
    )
