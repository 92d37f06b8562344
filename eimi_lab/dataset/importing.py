"""Make a dataset from existing images or an existing video, and a table with the load of each picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from datetime import UTC, datetime
from itertools import groupby, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.dark_and_flat import Images, check_like, store_correction
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.listing import ListedFrame, Listing, last_number, list_frames, some
from eimi_lab.dataset.measured_columns import store_measured_columns
from eimi_lab.dataset.points import Load
from eimi_lab.dataset.state_loads import load_of
from eimi_lab.dataset.storage_failure import StorageFailed
from eimi_lab.dataset.tip_force_angles import store_tip_force_angles
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError, tell
from eimi_lab.process.limits import refuse_unpacked
from eimi_lab.process.outputs import whole_file
from eimi_lab.process.progress import silent
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Flag
from eimi_lab.vision.clicked_points import check_clicked_points
from eimi_lab.vision.edges.region import region_of
from eimi_lab.vision.flags import judge
from eimi_lab.vision.frame_checks import state_flags
from eimi_lab.vision.image_files import describe_image
from eimi_lab.vision.intensity import in_channels, is_coloured

LOSSLESS = frozenset({".png", ".tif", ".tiff", ".bmp", ".pgm"})
MANY_FRAMES = 50  # smallest number of frames for which the progress is shown
MOST_DIAGONALS = 2.0  # largest length of a beam, in diagonals of the picture; a coiled beam may exceed one diagonal


Progress = Callable[[str, int], AbstractContextManager[Callable[[str], None]]]


def import_frames(
    source: Path,
    states: Path,
    specimen: SpecimenFile,
    calibration: Calibration,
    path: Path,
    force: bool = False,
    average: bool = False,
    progress: Progress | None = None,
    correction: Images | None = None,
    every: int | None = None,
) -> int:
    """Make a dataset from images or a video, and return the number of load steps.

    Without ``every``, only the pictures that the table states.csv lists are imported, images in the natural order of
    their names (2 before 10). Consecutive pictures with the same load form one load step.

    Parameters
    ----------
    source
        A folder of images, an image or a video.
    states
        The table states.csv with the load of each picture.
    specimen, calibration
        The specimen and the calibration of the pictures.
    path
        The dataset to write.
    force
        Whether an existing file is overwritten.
    average
        Whether the mean of the frames of a load step is stored instead of the frames.
    progress
        Function that shows the progress.
    correction
        Dark frame (taken without light) and flat field (back-light without the beam).
    every
        Import every n-th frame of a video; each row of the table then gives the beginning of a load.

    Raises
    ------
    InputError
        If the table, a picture or the calibration is wrong.
    """
    with whole_file(path, force) as temporary:
        listing = list_frames(source, states, every)
        loads = [(load_of(frame.row, calibration), frame) for frame in listing.frames]
        by_state = [_as_state(list(group)) for _, group in groupby(loads, key=lambda pair: pair[0])]
        coloured = any(map(is_coloured, listing.images()))
        first = in_channels(next(listing.images()), coloured)
        largest = max(len(frames) for _, frames in by_state)
        refuse_unpacked(largest * first.nbytes, f"{states}: one state has {largest} frames, which")
        _check_against_picture(listing.frames[0].path, specimen, calibration, first.shape[1], first.shape[0])
        # The mean of 8-bit frames is stored with 16 bits, so the dark frame and the flat field are converted too.
        stored = (lambda image: _mean([image])) if average else np.asarray
        correcting = {name: stored(in_channels(image, coloured)) for name, image in (correction or {}).items()}
        check_like(correcting, stored(first))
        header = Header(specimen=specimen, calibration=calibration, taken=_oldest(listing))
        shown = progress("import", len(by_state)) if progress and len(listing.frames) >= MANY_FRAMES else None
        try:
            with (
                shown or nullcontext(silent) as report,
                DatasetWriter(temporary, header, Frame(stored(first), 0, 0.0), force=True) as writer,
            ):
                images = (in_channels(image, coloured) for image in listing.images())
                _append_states(writer, by_state, images, first, average, report)
        except StorageFailed as error:  # its message names the temporary file and --resume
            raise OSError(f"{path}: cannot be written: {error.reason}") from error
        store_tip_force_angles(temporary, [load.tip_force_angle_deg for load, _ in by_state])
        store_measured_columns(temporary, [load for load, _ in by_state])
        if correcting:
            store_correction(temporary, correcting)
    _report_unlisted(listing, states)
    return len(by_state)


def _as_state(frames: list[tuple[Load, ListedFrame]]) -> tuple[Load, list[ListedFrame]]:
    """Return the load and the pictures of one load step, with the mean of the temperatures of its pictures."""
    given_degC = [load.temperature_degC for load, _ in frames if load.temperature_degC is not None]
    mean_degC = float(np.mean(given_degC)) if given_degC else None
    return replace(frames[0][0], temperature_degC=mean_degC), [frame for _, frame in frames]


def _append_states(
    writer: DatasetWriter,
    by_state: list[tuple[Load, list[ListedFrame]]],
    images: Iterator[NDArray[Any]],
    first: NDArray[Any],
    average: bool,
    report: Callable[[str], None],
) -> None:
    number, last = 0, None
    (_, (first_frame, *_)), *_ = by_state
    for load, frames in by_state:
        names = [frame.path for frame in frames]
        images_of_state = list(islice(images, len(names)))
        for image, name in zip(images_of_state, names, strict=True):
            if image.shape != first.shape or image.dtype != first.dtype:
                raise InputError(
                    f"{name}: is {describe_image(image)}, but {first_frame.path.name} is {describe_image(first)}; all "
                    f"pictures of a dataset need the same size and bit depth: {_remedy(image, first)}"
                )
        flags = _flags(names, images_of_state, last)
        last = images_of_state[-1]
        kept, times = images_of_state, [frame.time_s for frame in frames]
        if average:
            kept, times = [_mean(images_of_state)], [float(np.mean(times))]
        writer.append_state(
            [Frame(image, number + k, float("nan")) for k, image in enumerate(kept)],
            current_A=float("nan") if load.current_A is None else load.current_A,
            field_mT=load.field_mT,
            tip_force_N=load.tip_force_N,
            time_s=times,
            flags=flags,
        )
        number += len(kept)
        report(f"{len(names)} frames of the state at {load.field_mT:g} mT")


def _remedy(image: NDArray[Any], first: NDArray[Any]) -> str:
    """Return advice about an image that differs from the first image in size or bit depth."""
    if image.shape[:2] == first.shape[1::-1] and image.dtype == first.dtype:
        return "rotate this picture by 90 degrees, or remove it from states.csv"
    return "export all pictures in the same way, or remove this picture from states.csv"


def _oldest(listing: Listing) -> str:
    """Return the time of the last change of the oldest image file, or of the video file (ISO 8601, UTC)."""
    seconds = min(file.stat().st_mtime for file in listing.files())
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")


def _report_unlisted(listing: Listing, states: Path) -> None:
    if listing.left_out:
        names = some([image.name for image in listing.left_out])
        tell(f"note: left out, because {states} does not list them: {names}")


def _flags(names: list[Path], images: list[NDArray[Any]], last: NDArray[Any] | None) -> tuple[Flag, ...]:
    """Return the defects of one load step, which are recognised by comparing its images.

    ``last`` is the last image of the previous load step; None for the first load step.
    """
    numbers = [number for name in names if (number := last_number(name.stem)) is not None]
    if len(numbers) < len(names) or any(later <= earlier for earlier, later in pairwise(numbers)):
        numbers = list(range(len(names)))
    lossless = all(name.suffix.lower() in LOSSLESS for name in names)
    frames = [Frame(image, number, 0.0) for image, number in zip(images, numbers, strict=True)]
    flags = state_flags(frames, lossless)
    if last is not None and np.array_equal(last, images[0]):
        flags += judge({"repeated_images": 1}, words={"image": names[0].name})
    return flags


def _mean(images: list[NDArray[Any]]) -> NDArray[np.uint16]:
    """Return the mean of several images in 16 bits. Grey values of 8 bits are multiplied by 257."""
    scale = 257.0 if images[0].dtype == np.uint8 else 1.0
    return np.rint(scale * np.mean(images, axis=0, dtype=np.float64)).astype(np.uint16)


def _check_against_picture(
    image: Path, specimen: SpecimenFile, calibration: Calibration, width: int, height: int
) -> None:
    """Raise InputError if the clamp is outside the picture, or if the beam is larger than the picture.

    Prints a warning if a part of the straight beam would be outside the picture.
    """
    beam, scale = specimen.specimen, calibration.pixels_per_mm
    clamp, size = np.array(calibration.clamp_midpoint_px), f"{width} x {height} px"
    if (clamp < -0.5).any() or (clamp > [width - 0.5, height - 0.5]).any():
        raise InputError(
            f"{image}: is {size}; clamp_midpoint_px = {list(calibration.clamp_midpoint_px)} is outside this picture; "
            "x is counted from the left edge and y from the top edge, also in a picture that was cropped or scaled"
        )
    long_px, wide_px, diagonal_px = beam.length_mm * scale, beam.width_mm * scale, float(np.hypot(width, height))
    if wide_px > min(width, height) or long_px > MOST_DIAGONALS * diagonal_px:
        raise InputError(
            f"{image}: is {size}; a beam of length_mm = {beam.length_mm:g} and width_mm = {beam.width_mm:g} at "
            f"pixels_per_mm = {scale:g} is {long_px:.0f} x {wide_px:.0f} px, which does not fit: correct pixels_per_mm "
            "in the calibration, or length_mm and width_mm of the specimen"
        )
    region_of(calibration, (height, width))
    check_clicked_points(calibration, specimen, (height, width))
    half = beam.width_mm / 2
    straight = [[0, -half], [0, half], [beam.length_mm, -half], [beam.length_mm, half]]
    corners = BeamFrame(calibration).to_px(np.array(straight))
    if (corners < 0).any() or (corners > [width - 1, height - 1]).any():
        tell(
            f"warning: {image}: the straight beam, {long_px:.0f} px long, would leave the picture of {size} "
            f"from clamp_midpoint_px = {list(calibration.clamp_midpoint_px)} at axis_angle_deg = "
            f"{calibration.axis_angle_deg:g}; if the bent beam also leaves the picture, check length_mm, "
            "pixels_per_mm, clamp_midpoint_px and axis_angle_deg"
        )
