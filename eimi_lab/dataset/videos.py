"""Read the frames of a video file and their times."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.process.errors import InputError

# Without this setting, ffmpeg would print its own messages about a damaged video to stderr. OpenCV reads the variable
# when it opens the first video.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

_MOST_KEPT = 16  # largest number of frames in memory at the same time
ENDINGS = frozenset({".mp4", ".avi", ".mov", ".mkv", ".m4v"})


def frame_times(path: Path) -> NDArray[np.float64]:
    """Return the times of all n frames of a video, in seconds from its beginning, shape (n,).

    Raises
    ------
    InputError
        If OpenCV cannot read the video.
    """
    with _opened(path) as video:
        times = []
        while video.grab():
            times.append(video.get(cv2.CAP_PROP_POS_MSEC) / 1000.0)
    if not times:
        raise InputError(f"{path}: holds no frame that OpenCV can read, or is damaged")
    return np.array(times)


def looked_through(path: Path, every: int) -> tuple[NDArray[np.float64], dict[int, NDArray[Any]]]:
    """Return the times of all frames of a video, and at most 16 of its frames at equal intervals.

    Parameters
    ----------
    path
        The video.
    every
        Return every n-th frame; n is doubled until at most 16 frames are left.

    Returns
    -------
    times
        Times of all frames, in seconds from the beginning of the video.
    kept
        The returned frames by number, counted from 0, shape (H, W, 3: blue, green, red).

    Raises
    ------
    InputError
        If OpenCV cannot read the video.
    """
    times: list[float] = []
    kept: dict[int, NDArray[Any]] = {}
    with _opened(path) as video:
        while video.grab():
            if len(times) % every == 0:
                decoded, image = video.retrieve()
                if decoded and image is not None:
                    kept[len(times)] = image
                if len(kept) > _MOST_KEPT:
                    every *= 2
                    kept = {number: image for number, image in kept.items() if number % every == 0}
            times.append(video.get(cv2.CAP_PROP_POS_MSEC) / 1000.0)
    if not kept:
        raise InputError(f"{path}: holds no frame that OpenCV can read, or is damaged")
    return np.array(times), kept


def read_video(path: Path, numbers: Sequence[int]) -> Iterator[NDArray[Any]]:
    """Yield selected frames of a video, shape (H, W, 3: blue, green, red).

    Parameters
    ----------
    path
        The video.
    numbers
        Numbers of the frames, counted from 0, in increasing order.

    Raises
    ------
    InputError
        If OpenCV cannot read the video, or if the video ends before one of the frames.
    """
    with _opened(path) as video:
        at = 0
        for number in numbers:
            while at < number and video.grab():
                at += 1
            image = video.read()[1] if at == number else None
            if image is None:
                raise InputError(
                    f"{path}: has no frame {number} (counted from 0), because the video ends after {at} frames"
                )
            at += 1
            yield image


def timed_frames(path: Path) -> Iterator[tuple[NDArray[Any], float]]:
    """Yield every frame (H, W, 3: blue, green, red) of a video, with its time in seconds from the beginning.

    Raises
    ------
    InputError
        If OpenCV cannot read the video, or if the video has no frame.
    """
    with _opened(path) as video:
        count = 0
        while True:
            image = video.read()[1]
            if image is None:
                break
            count += 1
            yield image, video.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
    if not count:
        raise InputError(f"{path}: holds no frame that OpenCV can read, or is damaged")


def row_direction(path: Path) -> tuple[float, float, float]:
    """Return three numbers (a, b, c): the pixel (x, y) of a frame lies in the row a x + b y + c of the camera sensor.

    The rows of a frame are not those of the sensor if the video is shown rotated. Raises InputError if the video cannot
    be read.
    """
    with _opened(path) as video:
        turned = round(video.get(cv2.CAP_PROP_ORIENTATION_META)) % 360
        width, height = (video.get(name) for name in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    return {
        90: (-1.0, 0.0, width - 1.0),
        180: (0.0, -1.0, height - 1.0),
        270: (1.0, 0.0, 0.0),
    }.get(turned, (0.0, 1.0, 0.0))


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    video = cv2.VideoCapture(str(path))
    try:
        if not video.isOpened():
            raise InputError(f"{path}: is not a video that OpenCV can read, or is damaged")
        yield video
    finally:
        video.release()
