"""Import a motion of a beam from a video or from tracked points: a ring-down (a free vibration) or creep."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from eimi_fitting.time.measured import Kind
from eimi_lab.config.calibration import Calibration, Changes, changed_calibration, load_calibration
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.face.given import AnyPath, AnySpecimen, files, named_options, specimen_of
from eimi_lab.face.segmenting import stated_changes
from eimi_lab.process.errors import InputError

if TYPE_CHECKING:
    from eimi_fitting.time.measured import Motion
    from eimi_lab.config.specimen import SpecimenFile
    from eimi_lab.dataset.moving.motion_facts import MotionFacts
    from eimi_lab.dataset.tracked.axes import Placing


@named_options
def import_motion(
    source: AnyPath,
    specimen: AnySpecimen,
    output: AnyPath,
    *,
    kind: Literal["ring_down", "creep"] = "ring_down",
    calibration: AnyPath | Calibration | None = None,
    along: Sequence[tuple[float, float]] | None = None,
    clamp: tuple[float, float] | None = None,
    axis: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    polarity: Literal["dark", "bright"] | None = None,
    channel: Literal["red", "green", "blue", "grey"] | None = None,
    beam_colour: tuple[float, float, float] | None = None,
    gravity_angle: float | None = None,
    no_gravity: bool = False,
    rate: float | None = None,
    released: float | None = None,
    hanging: float = 0.0,
    removed: float = 0.0,
    exposure: float | None = None,
    row_time: float = 0.0,
    format: str | None = None,
    unit: str | None = None,
    pixels_per_mm: float | None = None,
    sigma: float | None = None,
    rest: int | None = None,
    plane: str | None = None,
    force: bool = False,
) -> Dataset:
    """Make a dataset from a motion of a beam that was recorded as a video or as tracked points.

    A motion is a ring-down (a free vibration) or creep under a constant load. A video needs the argument
    ``calibration`` or ``along``. Tracked points need ``gravity_angle`` or ``no_gravity``.

    Parameters
    ----------
    source : str or Path
        A video; a table (CSV) with the columns time_s, point, x0_mm, y0_mm, x_mm, y_mm and sigma_mm; or, with
        ``format``, the file of a tracking program.
    specimen : str, Path or SpecimenFile
        The beam.
    output : str or Path
        The dataset to write.
    kind : "ring_down" or "creep"
        "ring_down" if the beam swings freely after a flick or a release, "creep" if it creeps under a constant load.
    calibration : str, Path or Calibration
        Calibration of the pictures.
    along : sequence of (float, float)
        Two to six points on the centre line of the beam at rest, from the clamp to the tip, px. Without a calibration,
        clamp, axis and scale follow from these points, and gravity points down in the picture.
    clamp, axis, region, polarity, channel, beam_colour
        New values for the calibration; see `import_pictures`.
    gravity_angle : float
        For tracked points: direction of gravity, degrees from +x (along the straight beam from the clamp) toward +y
        (across the beam); 0 for a beam that hangs down.
    no_gravity : bool
        For tracked points: gravity does not bend the beam.
    rate : float
        Frames per second, if the file does not contain the rate or the video is in slow motion.
    released : float
        Time in the recording at which the beam was released or its load changed, s. By default, the program finds the
        release of each flick.
    hanging, removed : float
        Weight that hangs at the tip during the motion, and weight that was taken from the tip at the time ``released``,
        N. For creep without ``removed``, the weight ``hanging`` was hung on the beam at the time ``released``.
    exposure : float
        Exposure time of a frame, s.
    row_time : float
        Time between the exposures of neighbouring rows of the sensor, s; 0 for a global shutter.
    format : str
        Name of the tracking program: dice, ncorr, mudic, dltdv, tracker, deeplabcut or c3d.
    unit : str
        Unit of the points of a tracking program: mm, cm, m, in or px.
    pixels_per_mm : float
        Scale of the picture, px per mm, for tracked points in px without a calibration.
    sigma : float
        Standard deviation of a tracked coordinate, in the unit of the file.
    rest : int
        Number of the frame of the tracks in which the beam is straight.
    plane : str
        For points in three dimensions: the plane in which the beam bends, such as "xz".
    force : bool
        Replace an existing dataset.

    Returns
    -------
    Dataset
        The dataset, open for reading. `Dataset.ring_downs` and `Dataset.creeps` return its motions.

    Raises
    ------
    InputError
        If a file cannot be used.
    """
    from eimi_lab.dataset.moving.motion_facts import MotionFacts
    from eimi_lab.dataset.moving.motion_import import write_motion_dataset
    from eimi_lab.dataset.tracked.axes import Placing
    from eimi_lab.process.outputs import check_distinct, refuse_existing

    path, beam = Path(output), specimen_of(specimen)
    check_distinct(files(source, specimen, calibration), [path])
    refuse_existing(path, force)
    for name, value in (("rate", rate), ("exposure", exposure)):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"{source}: {name} = {value:g} should be a finite number greater than 0")
    for name, weight_N in (("hanging", hanging), ("removed", removed)):
        if not 0.0 <= weight_N < math.inf:
            raise InputError(f"{source}: {name} = {weight_N:g} should be a finite number, 0 or more")
    facts = MotionFacts(
        kind=kind,
        rate_Hz=rate,
        released_s=released,
        hanging_N=hanging,
        removed_N=removed,
        exposure_s=exposure,
        row_time_s=row_time,
    )
    read = read_motions(
        Path(source),
        beam,
        facts,
        calibration=calibration,
        changes=stated_changes(clamp, axis, region, polarity, channel, beam_colour, along),
        tool=format,
        placing=lambda loaded: Placing(
            calibration=loaded,
            unit=unit,
            pixels_per_mm=pixels_per_mm,
            clamp=clamp,
            axis_deg=axis,
            sigma=sigma,
            rest=rest,
            plane=plane,
        ),
        has_gravity_direction=gravity_angle is not None or no_gravity,
        output=path,
    )
    write_motion_dataset(path, read.motions, beam, read.calibration, gravity_angle, not no_gravity, force)
    return open_dataset(path)


@dataclass(frozen=True)
class ReadMotions:
    """The motions (ring-downs or creep) that were read from a file, and the calibration (None if there is none)."""

    motions: tuple[Motion, ...]
    calibration: Calibration | None

    @property
    def in_words(self) -> str:
        """A text with the number of frames, the kind and the number of motions, and the number of lost frames."""
        kind: Kind = self.motions[0].kind
        frames = sum(len(motion.time_s) for motion in self.motions)
        parts = f" after {len(self.motions)} flicks" if len(self.motions) > 1 else ""
        lost = sum(motion.lost_frames for motion in self.motions)
        return f"{frames} frames of {kind.replace('_', '-')}{parts}" + (f", {lost} lost" if lost else "")


def read_motions(
    source: Path,
    specimen: SpecimenFile,
    facts: MotionFacts,
    *,
    calibration: AnyPath | Calibration | None,
    changes: Changes,
    tool: str | None,
    placing: Callable[[Calibration | None], Placing],
    has_gravity_direction: bool,
    output: Path,
) -> ReadMotions:
    """Read the motions (ring-downs or creep of the beam) from a video or from a file of tracked points.

    Parameters
    ----------
    source : Path
        A video, a table of points, or the file of a tracking program.
    specimen : SpecimenFile
        The specimen.
    facts : MotionFacts
        What the user knows about the recording, such as the frame rate.
    calibration : str, Path or Calibration, optional
        The calibration.
    changes : mapping
        New values for keys of the calibration of a video. A video without a calibration needs the key ``picture`` with
        ``along_px``, the points on the beam.
    tool : str, optional
        Name of the tracking program.
    placing : callable
        Takes the calibration (or None) and returns how coordinates of the tracking program are converted into the beam
        frame.
    has_gravity_direction : bool
        Whether the user gives an option about gravity.
    output : Path
        The dataset. A picture with rulers is written to its folder if points on the beam are missing.

    Returns
    -------
    ReadMotions
        The motions and the calibration.

    Raises
    ------
    InputError
        If the source cannot be read, or if an option is missing or not allowed.
    """
    from eimi_lab.dataset.listing import is_image, is_video

    if not source.exists():
        raise InputError(f"{source}: no such file; give a video or tracked points")
    if source.is_dir() and tool is None:
        raise InputError(
            f"{source}: is a folder; a motion is read from a video or from tracked points (--format), not from images"
        )
    if is_image(source):
        raise InputError(f"{source}: is one image; a motion is read from a video or from tracked points")
    if is_video(source):
        if has_gravity_direction:
            raise InputError(
                f"{source}: --gravity-angle and --no-gravity: are only for tracked points; leave them out for a video, "
                "whose calibration gives the direction of gravity (without a calibration: down in the picture)"
            )
        if tool is not None:
            raise InputError(f"{source}: --format: is for the file of a tracking program, not for a video")
        return _of_video(source, specimen, facts, calibration, changes, output)
    loaded = _loaded(calibration, {}) if calibration is not None else None
    if loaded is None and not has_gravity_direction:
        raise InputError(
            f"{source}: tracked points need --gravity-angle (direction of gravity, measured from the axis of the "
            "straight beam) or --no-gravity"
        )
    if facts.row_time_s or facts.exposure_s:
        raise InputError(f"{source}: --row-time and --exposure: are only for a video; leave them out for this file")
    if tool is not None:
        from eimi_lab.dataset.moving.tracked_motion import read_tracked_motion

        return ReadMotions(read_tracked_motion(source, tool, specimen, placing(loaded), facts), loaded)
    from eimi_lab.dataset.moving.motion_csv import read_motion_csv

    if loaded or changes:
        raise InputError(
            f"{source}: a table of points is in the beam frame already; leave out --calibration, --clamp and the other "
            "options of the calibration"
        )
    return ReadMotions(read_motion_csv(source, specimen, facts), None)


def _loaded(calibration: AnyPath | Calibration, changes: Changes) -> Calibration:
    if isinstance(calibration, Calibration):
        return changed_calibration(calibration, changes)
    return load_calibration(calibration, changes)


def _of_video(
    source: Path,
    specimen: SpecimenFile,
    facts: MotionFacts,
    calibration: AnyPath | Calibration | None,
    changes: Changes,
    output: Path,
) -> ReadMotions:
    from eimi_lab.dataset.moving.clicked_line import clicked_from_changes
    from eimi_lab.dataset.moving.filmed_motion import NoBeam, read_video_motions

    try:
        if calibration is not None:
            used, is_clicked = _loaded(calibration, changes), False
        else:
            if "along_px" not in changes.get("picture", {}):
                problem = "a video needs --calibration, or --along 'X,Y X,Y X,Y' with pixels of points on the beam"
                raise InputError(_where(source, output, problem))
            used = clicked_from_changes(changes, specimen, str(source))
            is_clicked = not {"axis_angle_deg", "clamp_midpoint_px"} & changes.keys()
        read = read_video_motions(source, used, specimen, facts, is_clicked=is_clicked)
    except NoBeam as error:
        raise InputError(_where(source, output, str(error).removeprefix(f"{source}: "))) from error
    return ReadMotions(read.motions, read.calibration)


def _where(source: Path, output: Path, problem: str) -> str:
    """Write a picture of the beam at rest with rulers, and return a message that asks for points on the beam.

    ``problem`` is the beginning of the message.
    """
    import cv2

    from eimi_lab.dataset.moving.filmed_motion import frame_at_rest
    from eimi_lab.process.outputs import write_file
    from eimi_lab.vision.ruled_picture import ruled_picture

    picture = output.with_name(f"{output.stem}_where.png")
    write_file(picture, cv2.imencode(".png", ruled_picture(frame_at_rest(source)))[1].tobytes(), force=True)
    return (
        f"{source}: {problem}; {picture} shows the beam at rest with rulers in px: read the pixels of three points on "
        "its centre line, at the clamp, in the middle and at the tip, and give them with --along"
    )
