"""Find the pictures that the table states.csv lists with their loads: image files, or frames of a video."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.cameras.image_series import natural_key
from eimi_lab.config.csv_tables import Row, read_table
from eimi_lab.dataset.state_loads import FRAME_COLUMNS, LOAD_COLUMNS, UNTIL_COLUMNS
from eimi_lab.dataset.videos import ENDINGS as VIDEOS
from eimi_lab.dataset.videos import frame_times, read_video
from eimi_lab.process.errors import InputError
from eimi_lab.process.paths import followed, named_in
from eimi_lab.vision.image_files import ENDINGS as IMAGES
from eimi_lab.vision.image_files import find_images, read_image


@dataclass(frozen=True)
class ListedFrame:
    """A picture to import, and the row of the table states.csv that gives its load.

    Parameters
    ----------
    path
        Path of the image; for a frame of a video, ``<path of the video>/<number of the frame>``.
    row
        The row of the table.
    time_s
        Time of the frame in the video, s; NaN if the time is unknown.
    """

    path: Path
    row: Row
    time_s: float = float("nan")


@dataclass(frozen=True)
class Listing:
    """The pictures that are imported, each with the row of the table states.csv that gives its load.

    Parameters
    ----------
    source
        The folder of images, the image or the video.
    frames
        The listed pictures: images in the natural order of their names, frames of a video in the order of time.
    left_out
        Images in the folder that the table does not list.
    """

    source: Path
    frames: tuple[ListedFrame, ...]
    left_out: tuple[Path, ...] = ()

    def images(self) -> Iterator[NDArray[Any]]:
        """Read the pictures in their order, each of shape (H, W) or (H, W, 3: blue, green, red).

        Raises InputError for an unreadable picture.
        """
        if is_video(self.source):
            return read_video(self.source, [int(frame.path.name) for frame in self.frames])
        return (read_image(frame.path) for frame in self.frames)

    def files(self) -> list[Path]:
        """Return the paths of the image files, or the path of the video."""
        return [self.source] if is_video(self.source) else [frame.path for frame in self.frames]


def is_video(path: Path) -> bool:
    """Return whether a file name ends like that of a video, such as ".mp4"."""
    return path.suffix.lower() in VIDEOS


def is_image(path: Path) -> bool:
    """Return whether a file name ends like that of an image, such as ".png"."""
    return path.suffix.lower() in IMAGES


def list_frames(source: Path, states: Path, every: int | None = None) -> Listing:
    """Find the pictures that the table states.csv lists.

    A row names an image by its path relative to the table, by its name in the folder, or by the number at the end of
    its name. A row names a frame of a video by its number, counted from 0, or by its time in the column ``time_s``.

    Parameters
    ----------
    source
        A folder of images, an image or a video.
    states
        The table with the load of each picture.
    every
        Take every n-th frame of a video. A load then begins at the time in its row, and ends at the time ``until_s`` or
        at the next row.

    Raises
    ------
    InputError
        If the table is wrong, if a row names no picture or several, or if two rows name the same picture.
    """
    if every is not None and (every < 1 or not is_video(source)):
        if is_video(source):
            raise InputError(f"--every {every}: should be 1 or more")
        raise InputError(f"--every {every}: is for a video only, but {source} is not a video; leave --every out")
    if not is_video(source):
        return _listed_images(source, read_table(states, ["frame"], LOAD_COLUMNS))
    rows = read_table(states, [], [*FRAME_COLUMNS, *LOAD_COLUMNS, *(UNTIL_COLUMNS if every else ())])
    if ("frame" in rows[0].cells) == ("time_s" in rows[0].cells):
        raise InputError(
            f"{states}: row 1: needs one of the columns frame and time_s, which specify frames of {source.name}"
        )
    if every is not None:
        return _listed_spans(source, rows, every)
    return _listed_numbers(source, rows) if "frame" in rows[0].cells else _listed_times(source, rows)


def _listed_images(source: Path, rows: list[Row]) -> Listing:
    images = [source] if source.is_file() else find_images(source)
    matched: dict[Path, ListedFrame] = {}
    missing: list[Row] = []
    for row in rows:
        candidates = images_named(row.text("frame"), images) or _image_at_path(row)
        if not candidates:
            missing.append(row)
            continue
        if len(candidates) > 1:
            names = ", ".join(image.name for image in candidates)
            raise row.fault("frame", f"the name of one image, but several images fit it: {names}")
        image = candidates[0]
        if earlier := matched.get(followed(image)):
            raise row.fault("frame", f"listed once; row {earlier.row.line} lists the same image")
        matched[followed(image)] = ListedFrame(image, row)
    if missing:
        more = f"; the same holds for rows {some([str(row.line) for row in missing[1:]])}" if missing[1:] else ""
        more += _near(missing[0], images)
        where = images[0].parent if source.is_dir() else f"{source}, or a path relative to {rows[0].path.name}"
        raise missing[0].fault("frame", f"an image in {where}; no image has this name{more}")
    frames = sorted(matched.values(), key=lambda frame: (natural_key(frame.path.name), str(frame.path)))
    return Listing(source, tuple(frames), tuple(image for image in images if followed(image) not in matched))


def images_named(name: str, images: list[Path]) -> list[Path]:
    """Return the images with this name, with or without its ending, or with this number at the end of their names."""
    candidates = [image for image in images if name in (image.name, image.stem)]
    if not candidates and name.isascii() and name.isdigit():
        candidates = [image for image in images if last_number(image.stem) == int(name)]
    return candidates


def _near(row: Row, images: list[Path]) -> str:
    """Return a suggestion for a row whose image does not exist; an empty text without a similar name."""
    name = re.split(r"[/\\]", row.text("frame"))[-1].casefold()
    near = [image.name for image in images if name in (image.name.casefold(), image.stem.casefold())]
    return f"; did you mean {near[0]}?" if near else ""


def _image_at_path(row: Row) -> list[Path]:
    # Return a list that contains the path of the image of a row; empty if the image does not exist.
    image = named_in(row.path, row.text("frame").replace("\\", "/"))
    try:
        return [image] if is_image(image) and image.is_file() else []
    except (OSError, ValueError):  # the text cannot be the name of a file
        return []


def last_number(stem: str) -> int | None:
    """Return the number at the end of a file name without its ending; None if there is no number."""
    digits = re.search(r"[0-9]+$", stem)
    return int(digits.group()) if digits else None


def some(words: list[str]) -> str:
    """Return the first five words, separated by commas, and the number of further words, as text."""
    return ", ".join(words[:5]) + (f" and {len(words) - 5} more" if len(words) > 5 else "")


def _listed_numbers(video: Path, rows: list[Row]) -> Listing:
    return _in_video(video, "frame", [(row.count("frame"), float("nan"), row) for row in rows])


def _listed_times(video: Path, rows: list[Row]) -> Listing:
    requested_s = [row.number("time_s") for row in rows]
    for row, time_s in zip(rows, requested_s, strict=True):
        if time_s < 0:
            raise row.fault("time_s", "0 or more, in seconds from the beginning of the video")
    times = frame_times(video)
    end_s = times[-1] + (times[-1] - times[-2] if len(times) > 1 else 0.0)
    for row, time_s in zip(rows, requested_s, strict=True):
        if time_s > end_s:
            raise row.fault("time_s", f"within {video.name}, which ends at {end_s:.3f} s")
    nearest = [int(np.argmin(np.abs(times - time_s))) for time_s in requested_s]
    return _in_video(video, "time_s", [(n, float(times[n]), row) for n, row in zip(nearest, rows, strict=True)])


def _listed_spans(video: Path, rows: list[Row], every: int) -> Listing:
    """List every n-th frame of a video with the row whose load acts at the time of the frame."""
    times = frame_times(video)
    by_time = "time_s" in rows[0].cells
    column = "time_s" if by_time else "frame"
    clock = times if by_time else np.arange(len(times), dtype=np.float64)
    starts = [row.number("time_s") if by_time else float(row.count("frame")) for row in rows]
    for row, start, before in zip(rows[1:], starts[1:], starts, strict=False):
        if start <= before:
            raise row.fault(column, "later than in the previous row")
    frames: list[ListedFrame] = []
    for index, (row, start) in enumerate(zip(rows, starts, strict=True)):
        end = starts[index + 1] if index + 1 < len(rows) else np.inf
        in_span = (clock >= start) & (clock < end)
        if row.cells.get("until_s"):
            in_span &= times <= row.number("until_s")
        numbers = np.flatnonzero(in_span)
        numbers = numbers[numbers % every == 0]
        if not len(numbers):
            raise row.fault(
                column,
                f"the beginning of a load with at least one of the frames 0, {every}, {2 * every}, ... of --every "
                f"{every}; the video has {len(times)} frames and ends at {times[-1]:.3f} s",
            )
        frames += [ListedFrame(video / str(number), row, float(times[number])) for number in numbers]
    return Listing(video, tuple(frames))


def _in_video(video: Path, column: str, listed: list[tuple[int, float, Row]]) -> Listing:
    by_number: dict[int, ListedFrame] = {}
    for number, time_s, row in listed:
        if number in by_number:
            raise row.fault(column, f"listed once; row {by_number[number].row.line} lists the same frame")
        by_number[number] = ListedFrame(video / str(number), row, time_s)
    return Listing(video, tuple(frame for _, frame in sorted(by_number.items())))
