"""Read the motion that `eimi import` stores with `--ring-down` or `--creep`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from eimi_lab.commands.track_options import ImportOptions
from eimi_lab.process.errors import InputError

if TYPE_CHECKING:
    from eimi_fitting.time.measured import Motion
    from eimi_lab.config.calibration import Calibration
    from eimi_lab.config.specimen import SpecimenFile
    from eimi_lab.dataset.moving.motion_facts import MotionFacts


def read_motion(
    source: Path,
    specimen: SpecimenFile,
    options: ImportOptions,
    facts: MotionFacts,
    calibration: Calibration | None,
    has_gravity_direction: bool,
) -> Motion:
    """Read a motion from a video or from tracked points.

    Parameters
    ----------
    source : Path
        A video, a table of points, or the file of a tracking program.
    specimen : SpecimenFile
        The specimen.
    options : ImportOptions
        All options of the command.
    facts : MotionFacts
        The facts about the recording that the user stated by options, such as the frame rate.
    calibration : Calibration, optional
        The calibration, if the user gave one.
    has_gravity_direction : bool
        Whether the user gave --gravity-angle or --no-gravity.

    Raises
    ------
    InputError
        If the source cannot be read, or if an option is missing or superfluous.
    """
    from eimi_lab.dataset.listing import is_image, is_video

    if source.is_dir() and options.format is None:
        raise InputError(f"{source}: a motion is read from a video or from tracked points, not from a folder of images")
    if is_image(source):
        raise InputError(f"{source}: is one image; a motion is read from a video or from tracked points")
    if is_video(source):
        if calibration is None or has_gravity_direction:
            raise InputError(
                f"{source}: a video needs --calibration, and neither --gravity-angle nor --no-gravity: the calibration "
                "states the direction of gravity"
            )
        from eimi_lab.dataset.moving.filmed_motion import read_video_motion

        options.refuse_track_options()
        return read_video_motion(source, calibration, specimen, facts)
    if calibration is None and not has_gravity_direction:
        raise InputError(f"{source}: tracked points need --gravity-angle or --no-gravity")
    if facts.row_time_s or facts.exposure_s:
        raise InputError(f"{source}: --row-time and --exposure: are for a video, not for tracked points")
    if options.format is not None:
        from eimi_lab.dataset.moving.tracked_motion import read_tracked_motion

        return read_tracked_motion(source, options.format, specimen, options.placing(calibration), facts)
    from eimi_lab.dataset.moving.motion_csv import read_motion_csv

    options.refuse_track_options()
    if calibration or options.changes():
        raise InputError(
            f"{source}: is in the beam frame; leave out --calibration, --clamp and the other options that place points"
        )
    return read_motion_csv(source, specimen, facts)
