"""Datasets from what a lab already has: images, a video or a table of tracked points, and a table of states."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from datetime import UTC, datetime
from itertools import chain, groupby, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.cameras.image_series import natural_key
from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.corrections import Images, check_like, store_correction
from eimi_lab.dataset.images import described, find_images, read_image
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.points import NAME_BYTES, Load, TrackedPoints, write_points
from eimi_lab.dataset.state_checks import state_flags
from eimi_lab.dataset.tables import Row, read_table
from eimi_lab.dataset.videos import ENDINGS as VIDEOS
from eimi_lab.dataset.videos import read_video
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.errors import InputError
from eimi_lab.outputs import whole_file
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edge_set import Flag

LOAD_COLUMNS = ("current_A", "field_mT", "tip_force_N")
POINT_COLUMNS = ("state", "point", "x0_mm", "y0_mm", "x_mm", "y_mm", "sigma_mm")
ON_THE_BEAM_MM = 1e-6  # rounding in a table
LOSSLESS = frozenset({".png", ".tif", ".tiff", ".bmp", ".pgm"})
MANY_FRAMES = 50  # from here on progress is shown


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
) -> int:
    """Make a dataset of a folder of images or of a video; returns the number of states. Raises InputError.

    Images are taken in natural order, and all have to be listed; of a video the listed frames are taken, counted from
    0. Neighbours under the same load are frames of one state: kept, or averaged into one. What the frames of a state
    say against one another becomes its flags. progress: is shown where there are many frames.
    correction: dark frame and flat field to keep with them.
    """
    with whole_file(path, force) as temporary:
        rows = read_table(states, ["frame"], LOAD_COLUMNS)
        loads = {row.line: _load(row, calibration) for row in rows}
        found = _match_video(source, rows) if source.suffix.lower() in VIDEOS else _match(find_images(source), rows)
        frames = [(loads[row.line], image) for image, row in found]
        by_state = [(load, [image for _, image in group]) for load, group in groupby(frames, key=lambda f: f[0])]
        _enough(states, len(by_state))
        listed = [image for _, image in frames]
        images = _read(source, listed)
        first = next(images)
        images = chain([first], images)
        height, width = first.shape
        _check_in_view(listed[0], specimen, calibration, width, height)
        oldest = min(file.stat().st_mtime for file in ([source] if source.is_file() else listed))
        taken = datetime.fromtimestamp(oldest, UTC).isoformat(timespec="seconds")
        header = Header(specimen=specimen, calibration=calibration, taken=taken)
        like = _mean([first]) if average else first
        # A mean of 8 bits is stored as 16: so are the images that correct it.
        correcting = {name: _mean([image]) if average else image for name, image in (correction or {}).items()}
        check_like(correcting, like)
        shown = progress("import", len(by_state)) if progress and len(frames) >= MANY_FRAMES else None
        with (
            shown or nullcontext(_silent) as report,
            DatasetWriter(temporary, header, Frame(like, 0, 0.0), force=True) as writer,
        ):
            number, last = 0, None
            for load, names in by_state:
                taken_here = list(islice(images, len(names)))
                for image, name in zip(taken_here, names, strict=True):
                    if image.shape != first.shape or image.dtype != first.dtype:
                        raise InputError(f"{name}: is {described(image)}; {listed[0].name} is {described(first)}")
                flags = _flags(names, taken_here, last)
                last = taken_here[-1]
                kept = [_mean(taken_here)] if average else taken_here
                writer.append_state(
                    [Frame(image, number + k, float("nan")) for k, image in enumerate(kept)],
                    current_A=float("nan") if load.current_A is None else load.current_A,
                    field_mT=load.field_mT,
                    tip_force_N=load.tip_force_N,
                    flags=flags,
                )
                number += len(kept)
                report(f"{len(names)} frames at {load.field_mT:g} mT")
        if correcting:
            store_correction(temporary, correcting)
        return len(by_state)


def import_points(
    points: Path, states: Path, specimen: SpecimenFile, gravity_angle_deg: float, path: Path, force: bool = False
) -> int:
    """Make a dataset of tracked points; returns the number of states. Raises InputError."""
    with whole_file(path, force) as temporary:
        loads = _numbered_loads(read_table(states, ["state"], LOAD_COLUMNS))
        _enough(states, len(loads))
        by_state: dict[int, list[Row]] = {state: [] for state in loads}
        for row in read_table(points, POINT_COLUMNS):
            state = row.count("state")
            if state not in by_state:
                raise row.fault("state", f"one of the states in {states}")
            if any(other.text("point") == row.text("point") for other in by_state[state]):
                raise InputError(f"{points}: row {row.line}: point {row.text('point')} is twice in state {state}")
            by_state[state].append(row)
        for state, rows in by_state.items():
            if not rows:
                raise InputError(f"{points}: has no point of state {state}, which is in {states}")
        tracked = [_tracked(rows, specimen) for rows in by_state.values()]
        write_points(temporary, Header(specimen=specimen), gravity_angle_deg, list(loads.values()), tracked)
        return len(loads)


def _match(images: list[Path], rows: list[Row]) -> list[tuple[Path, Row]]:
    """Every image with its row. A row names its image in full, without the ending, or by the number at its end."""
    matched: dict[Path, Row] = {}
    missing: list[Row] = []
    for row in rows:
        found = _named(row.text("frame"), images)
        if not found:
            missing.append(row)
            continue
        if len(found) > 1:
            raise row.fault("frame", f"one image; {', '.join(image.name for image in found)} all fit")
        if found[0] in matched:
            raise row.fault("frame", f"listed once; row {matched[found[0]].line} is the same image")
        matched[found[0]] = row
    if missing:
        more = f"; nor of that in rows {_some([str(row.line) for row in missing[1:]])}" if missing[1:] else ""
        raise missing[0].fault("frame", f"an image in {images[0].parent}; there is none of that name{more}")
    extra = [image for image in images if image not in matched]
    if extra:
        more = f"; nor {_some([image.name for image in extra[1:]])}" if extra[1:] else ""
        raise InputError(f"{extra[0]}: is not listed in {rows[0].path}{more}")
    return sorted(matched.items(), key=lambda pair: (natural_key(pair[0].name), pair[0].name))


def _named(name: str, images: list[Path]) -> list[Path]:
    found = [image for image in images if name in (image.name, image.stem)]
    if not found and name.isascii() and name.isdigit():
        found = [image for image in images if _last_number(image.stem) == int(name)]
    return found


def _some(words: list[str]) -> str:
    """A list that stays one line, however long it is."""
    return ", ".join(words[:5]) + (f" and {len(words) - 5} more" if len(words) > 5 else "")


def _match_video(video: Path, rows: list[Row]) -> list[tuple[Path, Row]]:
    """Every listed frame of a video, named by the video and its number, in order."""
    by_number: dict[int, Row] = {}
    for row in rows:
        number = row.count("frame")
        if number in by_number:
            raise row.fault("frame", f"listed once; row {by_number[number].line} is the same frame")
        by_number[number] = row
    return [(video / str(number), row) for number, row in sorted(by_number.items())]


def _read(source: Path, listed: list[Path]) -> Iterator[NDArray[Any]]:
    """The images one after another, as they are asked for."""
    if source.is_file():
        return read_video(source, [int(image.name) for image in listed])
    return (read_image(image) for image in listed)


def _flags(names: list[Path], images: list[NDArray[Any]], last: NDArray[Any] | None) -> tuple[Flag, ...]:
    """What a state's images say against one another, and against the last image of the state before."""
    numbers = [_last_number(name.stem) for name in names]
    known = [number for number in numbers if number is not None]
    if len(known) < len(names) or any(later <= earlier for earlier, later in pairwise(known)):
        known = list(range(len(names)))
    lossless = all(name.suffix.lower() in LOSSLESS for name in names)
    frames = [Frame(image, number, 0.0) for image, number in zip(images, known, strict=True)]
    flags = state_flags(frames, lossless)
    if last is not None and np.array_equal(last, images[0]):
        remedy = f"Look for the right image: {names[0].name} is, bit for bit, the one before it, of another load."
        flags = (*flags, Flag("DUPLICATE", 1.0, 0.0, remedy))
    return flags


def _mean(images: list[NDArray[Any]]) -> NDArray[np.uint16]:
    """The mean of images (H, W) as 16 bits; of 8 bits it is 257 times as much, so that the full scales agree."""
    scale = 257.0 if images[0].dtype == np.uint8 else 1.0
    return np.rint(scale * np.mean(images, axis=0, dtype=np.float64)).astype(np.uint16)


def _silent(words: str) -> None:
    """For imports too short to be watched."""


def _last_number(stem: str) -> int | None:
    found = re.search(r"[0-9]+$", stem)
    return int(found.group()) if found else None


def _load(row: Row, calibration: Calibration | None) -> Load:
    """What acts in the state of a row. Raises InputError."""
    has_current, has_field = "current_A" in row.cells, "field_mT" in row.cells
    if has_current == has_field:
        wrong = "both current_A and field_mT" if has_current else "neither current_A nor field_mT"
        raise InputError(f"{row.path}: row 1: has {wrong}; give one of them")
    force = row.number("tip_force_N") if "tip_force_N" in row.cells else 0.0
    if has_field:
        field = row.number("field_mT")
        return Load(field / calibration.coil_constant_mT_per_A if calibration else None, field, force)
    current = row.number("current_A")
    if calibration:
        return Load(current, current * calibration.coil_constant_mT_per_A, force)
    if current:
        raise row.fault("current_A", "0, or field_mT be given instead: tracked points come without a coil constant")
    return Load(current, 0.0, force)


def _numbered_loads(rows: list[Row]) -> dict[int, Load]:
    loads: dict[int, Load] = {}
    for row in rows:
        state = row.count("state")
        if state in loads:
            raise row.fault("state", "a state that was not listed before")
        loads[state] = _load(row, None)
    return dict(sorted(loads.items()))


def _tracked(rows: list[Row], specimen: SpecimenFile) -> TrackedPoints:
    beam = specimen.specimen
    for row in rows:
        if not -ON_THE_BEAM_MM <= row.number("x0_mm") <= beam.length_mm + ON_THE_BEAM_MM:
            raise row.fault("x0_mm", f"on the beam, from 0 to length_mm = {beam.length_mm:g}")
        if abs(row.number("y0_mm")) > beam.width_mm / 2 + ON_THE_BEAM_MM:
            raise row.fault("y0_mm", f"on the beam, within half of width_mm = {beam.width_mm:g}")
        if row.number("sigma_mm") <= 0:
            raise row.fault("sigma_mm", "greater than 0")
        if len(row.text("point").encode()) > NAME_BYTES:
            raise row.fault("point", f"a name of at most {NAME_BYTES} bytes")
    return TrackedPoints(
        tuple(row.text("point") for row in rows),
        np.array([[row.number("x0_mm"), row.number("y0_mm")] for row in rows]),
        np.array([[row.number("x_mm"), row.number("y_mm")] for row in rows]),
        np.array([row.number("sigma_mm") for row in rows]),
    )


def _enough(states: Path, count: int) -> None:
    if count < 2:
        raise InputError(f"{states}: has one state only; a fit needs at least two different ones")


def _check_in_view(image: Path, specimen: SpecimenFile, calibration: Calibration, width: int, height: int) -> None:
    """The beam at rest has to be inside the image."""
    length, half = specimen.specimen.length_mm, specimen.specimen.width_mm / 2
    corners = BeamFrame(calibration).to_px(np.array([[0, -half], [0, half], [length, -half], [length, half]]))
    if (corners < 0).any() or (corners > [width - 1, height - 1]).any():
        raise InputError(
            f"{image}: specimen.length_mm = {length:g} at pixels_per_mm = {calibration.pixels_per_mm:g} is "
            f"{length * calibration.pixels_per_mm:.0f} px and leaves the image of {width} x {height} px from "
            f"clamp_midpoint_px = {list(calibration.clamp_midpoint_px)}; check length, scale, clamp and axis"
        )
