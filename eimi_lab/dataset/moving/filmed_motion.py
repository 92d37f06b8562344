"""A motion from a film: points of the centre line, each with the time at which its row was exposed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.time.measured import Motion
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.moving.film import Film, follow_film
from eimi_lab.dataset.moving.free_motion import free_motion
from eimi_lab.dataset.moving.motion_facts import MotionFacts
from eimi_lab.dataset.videos import row_direction, timed_frames
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.intensity import camera_grey, is_coloured

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FilmedPoints:
    """Points of a film in the beam frame.

    Parameters
    ----------
    points_mm : ndarray, shape (n, p, 2)
        Places; NaN where a point was not seen.
    rest_mm : ndarray, shape (p, 2)
        Places of the points in the undeformed beam.
    time_s, sigma_mm : ndarray, shape (n, p)
        Time of each point, and the standard uncertainty of a coordinate.
    """

    points_mm: Array
    rest_mm: Array
    time_s: Array
    sigma_mm: Array


def points_of_film(
    film: Film,
    calibration: Calibration,
    frame_s: Array,
    row_time_s: float = 0.0,
    rows: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> FilmedPoints:
    """Return the points of a film in millimetres, each with its own time.

    Parameters
    ----------
    film : Film
        The film.
    calibration : Calibration
        The calibration of the film.
    frame_s : ndarray, shape (n,)
        Time of the first row of each frame.
    row_time_s : float
        Time from one row to the next.
    rows : tuple of float
        Factors a and b and constant c: the pixel x, y lies in row a x + b y + c of the sensor.
    """
    frame = BeamFrame(calibration)
    middle = frame.to_mm(film.middle_px.reshape(-1, 2)).reshape(film.middle_px.shape)
    row = film.middle_px[..., 0] * rows[0] + film.middle_px[..., 1] * rows[1] + rows[2]
    time_s = frame_s[:, None] + row_time_s * np.where(np.isfinite(row), row, np.nanmean(row))
    return FilmedPoints(
        points_mm=middle,
        rest_mm=np.column_stack([film.along_mm, np.zeros(len(film.along_mm))]),
        time_s=time_s,
        sigma_mm=np.tile(film.sigma_mm(middle), (len(frame_s), 1)),
    )


def read_video_motion(path: Path, calibration: Calibration, specimen: SpecimenFile, facts: MotionFacts) -> Motion:
    """Read a motion from a video.

    Parameters
    ----------
    path : Path
        The video.
    calibration, specimen
        Calibration and specimen.
    facts : MotionFacts
        Facts that the user states; `rate_Hz` replaces the times of the video.

    Returns
    -------
    Motion

    Raises
    ------
    InputError
        If the video cannot be read, or if the beam is not found in it.
    """
    times: list[float] = []
    film = follow_film(_images(path, times), calibration, specimen, str(path))
    frame_s = np.arange(len(times)) / facts.rate_Hz if facts.rate_Hz else np.array(times)
    frame_s = frame_s[: len(film.middle_px)]
    points = points_of_film(film, calibration, frame_s, facts.row_time_s, row_direction(path))
    return free_motion(points.points_mm, points.rest_mm, points.time_s, points.sigma_mm, facts, str(path))


def _images(path: Path, times: list[float]) -> Iterator[NDArray[Any]]:
    """Yield the frames of a video, grey if the video has no colours, and append the time of each frame to `times`."""
    frames = timed_frames(path)
    first, first_s = next(frames)
    coloured = is_coloured(first)
    for image, time_s in chain([(first, first_s)], frames):
        times.append(time_s)
        yield image if coloured else camera_grey(image)
