"""Read a series of image files in the order of the numbers in their names."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cv2
from numpy.typing import NDArray

from eimi_drivers.cameras.settings import NO_SETTINGS, CameraSettings
from eimi_drivers.interfaces import EndOfPlayback, InstrumentError, ReplyNotUnderstood

IMAGE_SUFFIXES = frozenset({".png", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".jpg", ".jpeg"})

_NUMBER_FIELD = re.compile(r"%(0\d+)?d")


def natural_key(name: str) -> tuple[tuple[int, str], ...]:
    """Return a sort key that compares the digits in a name as numbers and the other characters as text.

    Examples
    --------
    >>> sorted(["frame_10", "frame_9"], key=natural_key)
    ['frame_9', 'frame_10']
    """
    parts = re.findall(r"\d+|\D+", name)
    return tuple((int(part), "") if part.isdecimal() else (-1, part) for part in parts)


def list_images(source: str | Path) -> tuple[Path, ...]:
    """Return the image files in a folder or of a pattern, sorted by the numbers in their names.

    Parameters
    ----------
    source : str or Path
        A folder, or a pattern such as `frames/f_%03d.png`.

    Returns
    -------
    tuple of Path
        The image files, possibly none.
    """
    source = Path(source)
    if source.is_dir():
        paths = [path for path in source.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
    elif _NUMBER_FIELD.search(source.name) and source.parent.is_dir():
        pattern = re.compile(r"\d+".join(re.escape(part) for part in _NUMBER_FIELD.split(source.name)[::2]))
        paths = [path for path in source.parent.iterdir() if pattern.fullmatch(path.name)]
    else:
        paths = []
    return tuple(sorted(paths, key=lambda path: natural_key(path.name)))


def recording_length(source: str) -> int | None:
    """Return the number of frames of a recording; None if `source` is not a recording that can be opened.

    A recording is a folder of images, a pattern such as ``f_%03d.png``, or a video file.
    """
    if source.isdecimal():
        return None
    if images := list_images(source):
        return len(images)
    if not Path(source).is_file():
        return None
    video = cv2.VideoCapture(source)
    try:
        return int(video.get(cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else None
    finally:
        video.release()


def refuse_on_recording(recording: str, settings: CameraSettings) -> None:
    """Raise InstrumentError if a setting is requested, because a recording has no settings.

    `recording` is the name of the recording in the message.
    """
    if names := ", ".join(settings.chosen()):
        raise InstrumentError(f"{recording}: a recording has no {names} to set")


class ImageSeries:
    """A series of image files that are read one after the other.

    `paths` are the files in the order of the frames.
    """

    def __init__(self, paths: tuple[Path, ...]) -> None:
        self._paths = paths
        self._next = 0

    def set_up(self, settings: CameraSettings) -> CameraSettings:
        """Return `NO_SETTINGS`, because a recording has no settings.

        Raises
        ------
        InstrumentError
            A setting is requested.
        """
        refuse_on_recording(str(self._paths[0].parent), settings)
        return NO_SETTINGS

    def read(self) -> tuple[NDArray[Any], float]:
        """Return the next image, and its index in the series.

        Raises
        ------
        EndOfPlayback
            The series has no further image.
        ReplyNotUnderstood
            The file cannot be read as an image.
        """
        if self._next == len(self._paths):
            raise EndOfPlayback(f"{self._paths[0].parent}: end of playback after {self._next} images")
        path = self._paths[self._next]
        image = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
        if image is None:
            raise ReplyNotUnderstood(f"{path}: the file cannot be read as an image")
        self._next += 1
        return image, float(self._next - 1)

    def release(self) -> None:
        """Do nothing, because no file is open between two reads."""
