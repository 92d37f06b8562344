"""Find and store the edges of the beam in every load step, and write them as tables and pictures."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing
from dataclasses import asdict, replace
from functools import lru_cache, partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.dataset.moving.recorded_motion import recorded_kinds, recorded_motions
from eimi_lab.dataset.neighbouring_states import is_reliable, search_beside_neighbours
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import write_whole
from eimi_lab.process.workers import completed
from eimi_lab.process.writer_lock import only_writer
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Flag, Severity
from eimi_lab.vision.edges.edge_set import EdgeSet, tip_angle_deg
from eimi_lab.vision.edges.finding import find_edges, follow_beam
from eimi_lab.vision.edges.overlay import contact_sheet, draw_overlay
from eimi_lab.vision.edges.region import region_of
from eimi_lab.vision.edges.suggested_corrections import suggest_correction
from eimi_lab.vision.following.explaining import draw_steps
from eimi_lab.vision.following.follow import FollowedBeam
from eimi_lab.vision.intensity import state_mean
from eimi_lab.vision.projection import Projection, choose_projection
from eimi_lab.vision.ruled_picture import ruled_picture

_STRAIGHT_DEG = 10.0  # largest difference of the tip angles of two states that count as equally straight

Workers = Callable[[], AbstractContextManager[Executor]]


def segment(path: Path, report: Callable[[str], None], executor: Workers | None = None) -> tuple[EdgeSet, ...]:
    """Find the edges of every load step, store them in the dataset, and return them.

    If free oscillations or creep were recorded, the motion of the beam is also measured and stored.

    Parameters
    ----------
    path
        The dataset.
    report
        Function that gets a line of text for each load step.
    executor
        Function that creates an executor with worker processes (`workers.executor_for`); None to use this process.

    Raises
    ------
    InputError
        If the dataset has no frames or no load step, or cannot be read or written.
    ChildProcessError
        If worker processes fail repeatedly.
    """
    with only_writer(path):
        with open_dataset(path) as dataset:
            if dataset.kind == "points":
                raise InputError(f"{path}: holds tracked points, so there are no edges to find")
            dataset.refuse_without_state()
            frames = Frames(dataset)
            projection = frames.projection()
            edge_sets = _find_all(frames, projection, report, executor)
            motions = recorded_motions(dataset, edge_sets, projection, report)
            kinds = recorded_kinds(dataset)
            length_mm = dataset.specimen.specimen.length_mm
        write_edges(path, edge_sets, projection, motions, length_mm, kinds)
    return edge_sets


class Frames:
    """The mean image of each load step, corrected by the dark frame (no light) and the flat field (no beam)."""

    def __init__(self, dataset: Dataset) -> None:
        """Read the images for the correction of frames. Raises InputError for a dataset of tracked points."""
        if dataset.kind == "points" or dataset.calibration is None:
            raise InputError(f"{dataset.path}: holds tracked points, which have no images")
        self.dataset, self.calibration = dataset, dataset.calibration
        self._correction = dataset.correction()

    def mean(self, index: int) -> NDArray[np.float32]:
        """Return the mean of the frames of a load step, shape (H, W), or (H, W, 3) with colours.

        The mean is corrected by the dark frame and the flat field if the dataset contains these images.
        """
        image = state_mean(self.dataset.each_image(index))
        return image if self._correction is None else self._correction.apply(image)

    def projection(self) -> Projection | None:
        """Return the conversion of colours to grey values for all frames; None for frames without colours."""
        if len(self.dataset.frame_format()[0]) == 2:
            return None
        beam = self.dataset.specimen.specimen
        images = (self.mean(state.index) for state in self.dataset.states)
        return choose_projection(images, self.calibration, beam.width_mm, beam.length_mm)


def _find_all(
    frames: Frames, projection: Projection | None, report: Callable[[str], None], executor: Workers | None
) -> tuple[EdgeSet, ...]:
    edge_sets: list[EdgeSet] = []
    last_reliable: EdgeSet | None = None
    clicked = _clicked_mm(frames.calibration)
    with closing(_found_by_workers(frames.dataset, projection, None if clicked is not None else executor)) as results:
        for state, edge_set in zip(frames.dataset.states, results, strict=True):
            if edge_set is None:
                expected = None
                if clicked is not None and state.index:
                    expected = clicked if last_reliable is None else last_reliable.middle_mm
                edge_set = _edges_in(frames, state.index, projection, partial(_return, last_reliable), expected)
            if is_reliable(edge_set):
                last_reliable = edge_set
            edge_sets.append(edge_set)
            flags = state.flags + edge_set.flags
            report(
                f"{len(edge_set.left.sigma_mm)} points on the left edge and {len(edge_set.right.sigma_mm)} on the "
                f"right, {_in_words(flags)}"
            )

    def search_again(index: int, guide: EdgeSet, *lines_mm: NDArray[np.float64]) -> EdgeSet:
        return _edges_in(frames, index, projection, partial(_return, guide), *lines_mm)

    search_beside_neighbours(edge_sets, search_again, frames.dataset.specimen.specimen.width_mm)
    return clamp_judged_when_straight(
        [
            replace(edge_set, flags=state.flags + edge_set.flags)
            for state, edge_set in zip(frames.dataset.states, edge_sets, strict=True)
        ]
    )


def clamp_judged_when_straight(edge_sets: Sequence[EdgeSet]) -> tuple[EdgeSet, ...]:
    """Return the edges of all load steps, with corrected flags for a wrong position of the clamp.

    The check is inaccurate if the beam is strongly curved. The load step with the straightest beam therefore decides.
    """
    turns = np.abs([tip_angle_deg(edge_set) for edge_set in edge_sets])
    if not np.isfinite(turns).any():
        return tuple(edge_sets)
    straightest = int(np.nanargmin(turns))
    of_straightest = tuple(flag for flag in edge_sets[straightest].flags if _is_clamp_offset(flag))
    return tuple(
        replace(one, flags=(*(flag for flag in one.flags if not _is_clamp_offset(flag)), *of_straightest))
        if turn > turns[straightest] + _STRAIGHT_DEG and any(_is_clamp_offset(flag) for flag in one.flags)
        else one
        for one, turn in zip(edge_sets, turns, strict=True)
    )


def _is_clamp_offset(flag: Flag) -> bool:
    return flag.name == "CALIBRATION_STALE" and flag.widens_in == "mm"


def _in_words(flags: Sequence[Flag]) -> str:
    """Return a text with the flags (defects) of a load step. Flags that do not affect a fit come last."""
    notes = [flag.name for flag in flags if flag.severity is Severity.NOTE]
    names = ", ".join(flag.name for flag in flags if flag.severity is not Severity.NOTE) or "no flags"
    return f"{names}; notes: {', '.join(notes)}" if notes else names


def _clicked_mm(calibration: Calibration) -> NDArray[np.float64] | None:
    """Return the n points that the user clicked on the beam, mm, shape (n, 2); None if there are none.

    x runs along the straight beam from the clamp, and y across it.
    """
    if calibration.picture is None or calibration.picture.along_px is None:
        return None
    return BeamFrame(calibration).to_mm(np.array(calibration.picture.along_px))


def _return(edge_set: EdgeSet | None) -> EdgeSet | None:
    return edge_set


def _found_by_workers(
    dataset: Dataset, projection: Projection | None, executor: Workers | None
) -> Generator[EdgeSet | None]:
    """Yield, for each load step, the edges that a worker process found, or None if no worker found them."""
    states = range(len(dataset.states))
    if executor is None:
        yield from (None for _ in states)
        return
    outcomes: dict[int, Callable[[], EdgeSet | None]] = {}
    results = completed(
        find_alone,
        lambda index: {"path": dataset.path, "index": index, "projection": projection},
        states,
        executor,
        (InputError,),
    )
    with closing(results):
        for index in states:
            while index not in outcomes:
                outcomes |= [next(results)]
            yield outcomes.pop(index)()


def find_alone(path: Path, index: int, projection: Projection | None) -> EdgeSet | None:
    """Find the edges of one load step without knowledge of other load steps.

    Parameters
    ----------
    path
        The dataset.
    index
        Number of the load step, from 0.
    projection
        Conversion of colours to grey values; None for frames without colours.

    Returns
    -------
    EdgeSet or None
        The edges; None if several bodies may be the beam.

    Raises
    ------
    InputError
        If the dataset cannot be read.
    """
    needs_earlier_state = False

    def earlier() -> None:
        nonlocal needs_earlier_state
        needs_earlier_state = True

    edge_set = _edges_in(_frames_of(path), index, projection, earlier)
    return None if needs_earlier_state else edge_set


@lru_cache(maxsize=1)
def _frames_of(path: Path) -> Frames:
    """Return the mean images of a dataset; a second call in a process returns the same object."""
    return Frames(open_dataset(path))


def edges_of_state(dataset: Dataset, index: int) -> EdgeSet:
    """Return the stored edges of one load step; if the dataset has no edges, find them without storing them.

    Raises InputError if the frames cannot be read.
    """
    stored = dataset.edges()
    if stored is not None:
        return stored[index]
    frames = Frames(dataset)
    edge_set = _edges_in(frames, index, frames.projection())
    return replace(edge_set, flags=dataset.states[index].flags + edge_set.flags)


def _edges_in(
    frames: Frames,
    index: int,
    projection: Projection | None,
    earlier: Callable[[], EdgeSet | None] | None = None,
    expected_mm: NDArray[np.float64] | None = None,
    between_mm: NDArray[np.float64] | None = None,
) -> EdgeSet:
    """Find the edges in the mean image of a load step."""
    # ``earlier`` returns the edges of an earlier load step, if several bodies may be the beam. The middle line is
    # expected at ``expected_mm`` (n, 2), mm, or between this line and ``between_mm`` (m, 2), mm.
    image, calibration, dataset = frames.mean(index), frames.calibration, frames.dataset
    region = region_of(calibration, image.shape)
    edge_set = find_edges(
        region.cut(image) if region else image,
        region.calibration if region else calibration,
        dataset.specimen,
        calibration_age_days=calibration.age_days(dataset.start_time()),
        projection=projection,
        earlier=earlier,
        expected_mm=expected_mm,
        between_mm=between_mm,
    )
    return region.in_picture(edge_set) if region else edge_set


def explain_missing_beam(path: Path, index: int) -> tuple[str, bytes]:
    """Explain to the user why no beam was found in a load step.

    Returns
    -------
    advice : str
        A text with the probable cause.
    picture : bytes
        A PNG image of the first frame, with rulers in pixels and the straight beam at its expected position.
    """
    with open_dataset(path) as dataset:
        frames = Frames(dataset)
        image, calibration, beam = frames.mean(index), frames.calibration, dataset.specimen.specimen
        suggested = suggest_correction(image, calibration, dataset.specimen, dataset.projection())
        shown = dataset.images(index)[0]
    half, long = beam.width_mm / 2, beam.length_mm
    sides = [[[0, -half], [long, -half]], [[0, half], [long, half]], [[0, -3 * half], [0, 3 * half]]]
    lines = [BeamFrame(calibration).to_px(side) for side in sides]
    words = suggested.words + (" (green in the picture)" if suggested.edges_px else "")
    return words, _png(ruled_picture(shown, lines, suggested.edges_px))


def write_csv(folder: Path, edge_sets: Sequence[EdgeSet]) -> None:
    """Write the edges of every load step as two tables, and the flags (failed quality checks) as JSON.

    The tables ``step_00_left.csv``, ``step_00_right.csv``, … have the columns x_mm, y_mm and sigma_mm. Rows go from the
    clamp to the tip. The flags are in ``quality.json``.
    """
    for index, edge_set in enumerate(edge_sets):
        for side in ("left", "right"):
            edge = getattr(edge_set, side)
            table = np.column_stack([edge.points_mm, edge.sigma_mm])
            text = io.BytesIO()
            np.savetxt(text, table, "%.6f", ",", header="x_mm,y_mm,sigma_mm", comments="")
            write_whole(folder / f"step_{index:02d}_{side}.csv", text.getvalue())
    quality = [
        {
            "step": index,
            "flags": [asdict(flag) for flag in edge_set.flags],
            "calibration_digest": edge_set.calibration_digest,
            "calibration_age_days": edge_set.calibration_age_days,
        }
        for index, edge_set in enumerate(edge_sets)
    ]
    write_whole(folder / "quality.json", (json.dumps({"steps": quality}, indent=2) + "\n").encode())


def write_overlays(folder: Path, path: Path, edge_sets: Sequence[EdgeSet]) -> None:
    """Write a picture of the mean frame with the edges for each load step, and one overview of all pictures.

    The files are ``step_00.png``, …, and ``contact_sheet.png``.
    """
    small: list[NDArray[np.uint8]] = []
    captions = []
    with open_dataset(path) as dataset:
        frames = Frames(dataset)
        for state, edge_set in zip(dataset.states, edge_sets, strict=True):
            image = state_mean(dataset.each_image(state.index))
            followed = None if len(edge_set.left.points_mm) else _followed(frames, image)
            picture = draw_overlay(image, edge_set, frames.calibration, dataset.specimen, followed)
            write_whole(folder / f"step_{state.index:02d}.png", _png(picture))
            share = min(1.0, 512 / max(picture.shape))
            shrunk = cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
            small.append(np.asarray(shrunk, dtype=np.uint8))
            flags = " ".join(flag.name for flag in edge_set.flags)
            captions.append(f"{state.index:02d}: {state.field_mT:.3g} mT {flags}")
    write_whole(folder / "contact_sheet.png", _png(contact_sheet(small, captions)))


def write_explained(folder: Path, path: Path) -> None:
    """Write pictures that show, for each load step, how the beam was followed from the clamp to the tip.

    The name of a file contains the load step and the stage, for example ``step_00_strip.png``.
    """
    with open_dataset(path) as dataset:
        frames = Frames(dataset)
        for state in dataset.states:
            for name, picture in draw_steps(_followed(frames, frames.mean(state.index))).items():
                write_whole(folder / f"step_{state.index:02d}_{name}.png", _png(picture))


def _followed(frames: Frames, image: NDArray[np.float32]) -> FollowedBeam:
    """Follow the beam from the clamp to the tip in a mean image; the result is in pixels of the whole picture."""
    dataset = frames.dataset
    region = region_of(frames.calibration, image.shape)
    projection = dataset.projection()
    if region is None:
        return follow_beam(image, frames.calibration, dataset.specimen, projection=projection)
    followed = follow_beam(region.cut(image), region.calibration, dataset.specimen, projection=projection)
    return followed.moved(np.array([region.left, region.top], dtype=np.float64))


def _png(picture: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", picture)[1].tobytes()
