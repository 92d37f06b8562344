"""Image files in the order in which a person numbered them."""

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
    """Key that sorts `frame_10` after `frame_9`: runs of digits compare as numbers, the rest as text."""
    parts = re.findall(r"\d+|\D+", name)
    return tuple((int(part), "") if part.isdecimal() else (-1, part) for part in parts)


def list_images(source: str | Path) -> tuple[Path, ...]:
    """The images of a folder, or of a numbered pattern such as `frames/f_%03d.png`, in natural order.

    Empty when there are none.
    """
    source = Path(source)
    if source.is_dir():
        found = [path for path in source.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
    elif _NUMBER_FIELD.search(source.name) and source.parent.is_dir():
        pattern = re.compile(r"\d+".join(re.escape(part) for part in _NUMBER_FIELD.split(source.name)[::2]))
        found = [path for path in source.parent.iterdir() if pattern.fullmatch(path.name)]
    else:
        found = []
    return tuple(sorted(found, key=lambda path: natural_key(path.name)))


def recording_length(source: str) -> int | None:
    """How many frames a recording has, a video as its head tells it; None for a device, or where there is nothing."""
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
    """Raises InstrumentError when there is a setting that a recording cannot have."""
    if names := ", ".join(settings.chosen()):
        raise InstrumentError(f"{recording}: a recording has no {names} to set")


class ImageSeries:
    """Reads the images of a series one after the other, grey values and bit depth as they are stored."""

    def __init__(self, paths: tuple[Path, ...]) -> None:
        self._paths = paths
        self._next = 0

    def set_up(self, settings: CameraSettings) -> CameraSettings:
        """Nothing can be set on a recording. Raises InstrumentError when something is to be."""
        refuse_on_recording(str(self._paths[0].parent), settings)
        return NO_SETTINGS

    def read(self) -> tuple[NDArray[Any], float]:
        """The next image, and its place in the series for a time stamp, since an image file has none.

        Raises EndOfPlayback after the last, ReplyNotUnderstood for a file that is no image.
        """
        if self._next == len(self._paths):
            raise EndOfPlayback(f"{self._paths[0].parent}: end of playback after {self._next} images")
        path = self._paths[self._next]
        image = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
        if image is None:
            raise ReplyNotUnderstood(f"{path}: cannot be read as an image")
        self._next += 1
        return image, float(self._next - 1)

    def release(self) -> None:
        """Nothing to release."""
