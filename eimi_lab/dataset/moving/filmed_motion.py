"""Convert a film of the beam into a motion: points of the centre line, each with the time of its exposure."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.strip import Strip
from eimi_fitting.time.measured import Motion
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.moving.clicked_line import with_measured_axis
from eimi_lab.dataset.moving.film import Film, NoBeam, follow_film, tracker_from
from eimi_lab.dataset.moving.free_motion import FEWEST_FRAMES, free_motions
from eimi_lab.dataset.moving.motion_facts import MotionFacts
from eimi_lab.dataset.moving.video_times import recorded_times
from eimi_lab.dataset.videos import looked_through, row_direction, timed_frames
from eimi_lab.process.errors import InputError, tell
from eimi_lab.process.progress import Report, progress
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.intensity import camera_grey, is_coloured
from eimi_lab.vision.projection import choose_projection
from eimi_lab.vision.tracking.steady_view import MOVED_PX, SteadyView

Array = NDArray[np.float64]

_EVERY = 8  # every 8th frame is kept in memory; one of the last kept frames shows the beam at rest
_AT_THE_END = 4  # divisor: the last quarter of a recording shows where the beam comes to rest
_LITTLE = 0.7  # share of the points that should be seen; with fewer points the user gets a note


@dataclass(frozen=True)
class FilmedPoints:
    """Positions of p points in the n frames of a film, with x along the straight beam from the clamp, and y across it.

    Parameters
    ----------
    points_mm : ndarray, shape (n, p, 2)
        Positions, mm; NaN for a point that was not found in a frame.
    rest_mm : ndarray, shape (p, 2)
        Positions in the undeformed beam, mm.
    time_s : ndarray, shape (n, p)
        Time at which the camera exposed each point, s.
    sigma_mm : ndarray, shape (n, p)
        Standard uncertainty of one coordinate, mm.
    """

    points_mm: Array
    rest_mm: Array
    time_s: Array
    sigma_mm: Array


def points_of_film(
    film: Film,
    calibration: Calibration,
    specimen: SpecimenFile,
    frame_s: Array,
    row_time_s: float = 0.0,
    rows: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> FilmedPoints:
    """Convert the points of a film from pixels into mm (x along the straight beam from the clamp, y across).

    With a rolling shutter, which exposes one row after another, the points of a frame have different times.

    Parameters
    ----------
    film : Film
        The film.
    calibration : Calibration
        The calibration of the film.
    specimen : SpecimenFile
        The specimen, whose shape at rest determines where the points are without a load.
    frame_s : ndarray, shape (n,)
        Time at which the first row of each of n frames was exposed, s.
    row_time_s : float
        Time between the exposures of two neighbouring rows, s; 0 for a global shutter.
    rows : tuple of float
        Three numbers (a, b, c): the pixel (x, y) lies in the row a x + b y + c of the sensor.
    """
    frame = BeamFrame(calibration)
    middle = frame.to_mm(film.middle_px.reshape(-1, 2)).reshape(film.middle_px.shape)
    row = film.middle_px[..., 0] * rows[0] + film.middle_px[..., 1] * rows[1] + rows[2]
    time_s = frame_s[:, None] + row_time_s * np.where(np.isfinite(row), row, np.nanmean(row))
    return FilmedPoints(
        points_mm=middle,
        rest_mm=Strip(specimen.mechanics()).at_rest(np.column_stack([film.along_mm, np.zeros(len(film.along_mm))])),
        time_s=time_s,
        sigma_mm=np.tile(film.sigma_mm(middle), (len(frame_s), 1)),
    )


@dataclass(frozen=True)
class VideoMotions:
    """The motions of the beam that were measured in a video, and the calibration that was used.

    Attributes
    ----------
    motions : tuple of Motion
        One motion for each time that the beam was pushed briefly.
    calibration : Calibration
        The calibration with which pixels were converted into mm.
    """

    motions: tuple[Motion, ...]
    calibration: Calibration


def read_video_motions(
    path: Path, calibration: Calibration, specimen: SpecimenFile, facts: MotionFacts, *, is_clicked: bool = False
) -> VideoMotions:
    """Measure the motions (positions of points over time) of the beam in a video.

    A movement of the camera is removed. Near the end of the video, the beam is assumed to be at rest.

    Parameters
    ----------
    path : Path
        The video.
    calibration, specimen
        Calibration of the camera, and the specimen.
    facts : MotionFacts
        Facts about the recording that the user gives.
    is_clicked : bool
        True if the calibration comes from clicked points; it is then corrected by the measured shape at rest.

    Raises
    ------
    InputError
        If the video cannot be read. If no beam is found in the video, the error is a `NoBeam`.
    """
    stored_s, kept = looked_through(path, _EVERY)
    if len(stored_s) < FEWEST_FRAMES:
        raise InputError(f"{path}: has {len(stored_s)} frames; a motion needs at least {FEWEST_FRAMES} frames")
    frame_s = recorded_times(path, stored_s, facts.rate_Hz)
    still = _still_frame(kept)
    coloured = is_coloured(still)
    reference = still if coloured else camera_grey(still)
    beam = specimen.specimen
    projection = choose_projection([reference], calibration, beam.width_mm, beam.length_mm) if coloured else None
    tracker = tracker_from(reference, calibration, specimen, projection)
    view = SteadyView(reference, tracker.outline_px) if tracker else None
    images = (image if coloured else camera_grey(image) for image, _ in timed_frames(path))
    steadied = images if view is None else map(view.steadied, images)
    with progress(f"follow the beam in {path.name}", len(frame_s)) as report:
        film = follow_film(_reported(steadied, report, len(frame_s)), calibration, specimen, str(path), projection,
                           tracker)  # fmt: skip
    count = min(len(frame_s), len(film.middle_px))
    film, frame_s = (
        Film(film.along_mm, film.middle_px[:count], film.left_px[:count], film.right_px[:count]),
        frame_s[:count],
    )
    _tell_view(path, view, film)
    if is_clicked:
        late = film.middle_px[-(count // _AT_THE_END + 1) :]
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # a point that was never seen
            rest_px = np.nanmedian(late, axis=0)
        rest_px = rest_px - _bow_px(calibration, specimen, film.along_mm)
        calibration = with_measured_axis(calibration, rest_px, film.along_mm, facts.hanging_N > 0)
    points = points_of_film(film, calibration, specimen, frame_s, facts.row_time_s, row_direction(path))
    motions = free_motions(points.points_mm, points.rest_mm, points.time_s, points.sigma_mm, facts, str(path))
    return VideoMotions(motions, calibration)


def _bow_px(calibration: Calibration, specimen: SpecimenFile, along_mm: Array) -> Array:
    """Return how far p points of the unloaded beam are from those of a straight beam, px, shape (p, 2)."""
    frame, straight = BeamFrame(calibration), np.column_stack([along_mm, np.zeros(len(along_mm))])
    return np.asarray(frame.to_px(Strip(specimen.mechanics()).at_rest(straight)) - frame.to_px(straight))


def frame_at_rest(path: Path) -> NDArray[Any]:
    """Return a frame near the end of a video, where the beam is assumed to be at rest (H, W, 3: blue, green, red).

    Raises InputError if the video cannot be read.
    """
    return _still_frame(looked_through(path, _EVERY)[1])


def _still_frame(frames: Mapping[int, NDArray[Any]]) -> NDArray[Any]:
    numbers = sorted(frames)
    return frames[numbers[max(len(numbers) - 2, 0)]]  # the beam is assumed to be at rest near the end of the video


def _reported(images: Iterable[NDArray[Any]], report: Report, total: int) -> Iterator[NDArray[Any]]:
    """Yield the frames of a film, and report the progress if standard error is a terminal."""
    for number, image in enumerate(images):
        yield image
        if sys.stderr.isatty():
            report(f"frame {number + 1} of {total} frames")


def _tell_view(path: Path, view: SteadyView | None, film: Film) -> None:
    """Print a note if the camera moved, if this cannot be checked, or if the beam was found in few frames."""
    visible_share = float(np.isfinite(film.middle_px[..., 0]).mean())
    if visible_share < _LITTLE:
        tell(
            f"note: {path}: the beam was seen in {visible_share:.0%} of the frames; poor light or focus, motion blur, "
            "or a hand in front of the beam can be the reason"
        )
    if view is not None and view.moved_px > MOVED_PX:
        tell(
            f"note: {path}: the camera moved by up to {view.moved_px:.1f} px; this movement was removed from the frames"
        )
    elif view is not None and not view.is_possible:
        tell(
            f"note: {path}: the background has too little detail to see whether the camera moved; put a ruler or "
            "printed paper behind the clamp"
        )


__all__ = ["FilmedPoints", "NoBeam", "VideoMotions", "frame_at_rest", "points_of_film", "read_video_motions"]
