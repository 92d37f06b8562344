"""Segmenting a whole dataset: every state's frames to edges, stored, and written out for a person on request."""

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

from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import write_whole
from eimi_lab.process.workers import completed
from eimi_lab.process.writer_lock import only_writer
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import leaves_out
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges, follow_beam
from eimi_lab.vision.edges.overlay import contact_sheet, draw_overlay
from eimi_lab.vision.edges.region import region_of
from eimi_lab.vision.edges.suggested_corrections import suggest_correction
from eimi_lab.vision.following.explaining import draw_steps
from eimi_lab.vision.following.follow import FollowedBeam
from eimi_lab.vision.intensity import state_mean
from eimi_lab.vision.projection import Projection, choose_projection
from eimi_lab.vision.ruled_picture import ruled_picture

Workers = Callable[[], AbstractContextManager[Executor]]


def segment(path: Path, report: Callable[[str], None], executor: Workers | None = None) -> tuple[EdgeSet, ...]:
    """Find the edges of every state, store them in the dataset, return them; `report` gets a line a state.

    The frames of a state are averaged, and corrected by the dark frame and flat field that the dataset keeps. Its
    flags are those of the run (NOT_SETTLED, …) and those of the image. executor: of the workers that share the states
    (`workers.executor_for`); the edges are the same with any number. Raises InputError, ChildProcessError when workers
    are lost for good.
    """
    with only_writer(path):
        with open_dataset(path) as dataset:
            if dataset.calibration is None:
                raise InputError(f"{path}: holds tracked points, which need no segmentation")
            frames = Frames(dataset)
            projection = frames.projection()
            edge_sets = _find_all(frames, projection, report, executor)
        write_edges(path, edge_sets, projection)
    return edge_sets


class Frames:
    """What there is to see in a dataset of frames: its states' mean images, its calibration."""

    def __init__(self, dataset: Dataset) -> None:
        """Raises InputError for a dataset of tracked points."""
        if dataset.calibration is None:
            raise InputError(f"{dataset.path}: holds tracked points, which have no images")
        self.dataset, self.calibration = dataset, dataset.calibration
        self._correction = dataset.correction()

    def mean(self, index: int) -> NDArray[np.float32]:
        """The mean of a state's frames, corrected by what the dataset keeps: (H, W), or (H, W, 3) with colours."""
        image = state_mean(self.dataset.images(index))
        return image if self._correction is None else self._correction.apply(image)

    def projection(self) -> Projection | None:
        """One for all states; None for frames without colours."""
        if len(self.dataset.frame_format()[0]) == 2:
            return None
        beam = self.dataset.specimen.specimen
        images = (self.mean(state.index) for state in self.dataset.states)
        return choose_projection(images, self.calibration, beam.width_mm, beam.length_mm)


def _find_all(
    frames: Frames, projection: Projection | None, report: Callable[[str], None], executor: Workers | None
) -> tuple[EdgeSet, ...]:
    edge_sets: list[EdgeSet] = []
    sure: EdgeSet | None = None
    with closing(_found_alone(frames.dataset, projection, executor)) as alone:
        for state, found in zip(frames.dataset.states, alone, strict=True):
            if found is None:
                found = _found(frames, state.index, projection, partial(_given, sure))
            if _is_sure(found):
                sure = found
            edge_set = replace(found, flags=state.flags + found.flags)
            edge_sets.append(edge_set)
            flags = ", ".join(flag.name for flag in edge_set.flags) or "no flags"
            report(f"{len(edge_set.left.sigma_mm)} + {len(edge_set.right.sigma_mm)} points, {flags}")
    return tuple(edge_sets)


def _given(sure: EdgeSet | None) -> EdgeSet | None:
    return sure


def _found_alone(
    dataset: Dataset, projection: Projection | None, executor: Workers | None
) -> Generator[EdgeSet | None]:
    """The edges of each state in order, found by workers in its own frames; None where that is left to do."""
    states = range(len(dataset.states))
    if executor is None:
        yield from (None for _ in states)
        return
    outcomes: dict[int, Callable[[], EdgeSet | None]] = {}
    each = completed(
        find_alone,
        lambda index: {"path": dataset.path, "index": index, "projection": projection},
        states,
        executor,
        (InputError,),
    )
    with closing(each):
        for index in states:
            while index not in outcomes:
                outcomes |= [next(each)]
            yield outcomes.pop(index)()


def find_alone(path: Path, index: int, projection: Projection | None) -> EdgeSet | None:
    """The edges of one state of a dataset; None where only those of an earlier state could tell the beam.

    Raises InputError.
    """
    asked = False

    def ask() -> None:
        nonlocal asked
        asked = True

    found = _found(_frames_of(path), index, projection, ask)
    return None if asked else found


@lru_cache(maxsize=1)
def _frames_of(path: Path) -> Frames:
    """In a worker, which has many states to do: opened once."""
    return Frames(open_dataset(path))


def edges_of_state(dataset: Dataset, index: int) -> EdgeSet:
    """The edges of one state of frames: those that are stored, else found now and not stored.

    Then no earlier state helps where several bodies may be the beam. Raises InputError.
    """
    stored = dataset.edges()
    if stored is not None:
        return stored[index]
    frames = Frames(dataset)
    found = _found(frames, index, frames.projection())
    return replace(found, flags=dataset.states[index].flags + found.flags)


def _found(
    frames: Frames,
    index: int,
    projection: Projection | None,
    earlier: Callable[[], EdgeSet | None] | None = None,
) -> EdgeSet:
    """The edges in the mean image of a state, within the region that the calibration states, without the run's flags.

    earlier: gives those of a state before, and is asked only where several bodies may be the beam.
    """
    image, calibration, dataset = frames.mean(index), frames.calibration, frames.dataset
    region = region_of(calibration, image.shape)
    found = find_edges(
        region.cut(image) if region else image,
        region.calibration if region else calibration,
        dataset.specimen,
        calibration_age_days=calibration.age_days(dataset.start_time()),
        projection=projection,
        earlier=earlier,
    )
    return region.in_picture(found) if region else found


def _is_sure(found: EdgeSet) -> bool:
    """Whether a later state may be told where the beam was; a guess is not, or it would be repeated."""
    guessed = any(flag.name == "ROOT_AMBIGUOUS" for flag in found.flags)
    return bool(len(found.middle_mm)) and not guessed and not leaves_out(found.flags)


def why_none(path: Path, index: int) -> tuple[str, bytes]:
    """For a state in which no beam was found: what may be wrong, and a PNG of where it was looked for.

    The picture has its pixels counted, and the straight beam of the stated place, width and length on it.
    """
    with open_dataset(path) as dataset:
        frames = Frames(dataset)
        image, calibration, beam = frames.mean(index), frames.calibration, dataset.specimen.specimen
        words = suggest_correction(image, calibration, dataset.specimen, dataset.projection())
        shown = dataset.images(index)[0]
    half, long = beam.width_mm / 2, beam.length_mm
    sides = [[[0, -half], [long, -half]], [[0, half], [long, half]], [[0, -3 * half], [0, 3 * half]]]
    lines = [BeamFrame(calibration).to_px(side) for side in sides]
    return words, _png(ruled_picture(shown, lines))


def write_csv(folder: Path, edge_sets: Sequence[EdgeSet]) -> None:
    """`step_00_left.csv`, … with x_mm, y_mm, sigma_mm from the clamp to the tip, and `quality.json` with the flags."""
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
    """`step_00.png`, …: the mean frame of each state with what was found on it; `contact_sheet.png`: all of them."""
    small: list[NDArray[np.uint8]] = []
    captions = []
    with open_dataset(path) as dataset:
        frames = Frames(dataset)
        for state, edge_set in zip(dataset.states, edge_sets, strict=True):
            image = state_mean(dataset.images(state.index))
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
    """`step_00_strip.png`, `step_00_unrolled.png`, …: on the way along the beam from its clamp, in each state."""
    with open_dataset(path) as dataset:
        frames = Frames(dataset)
        for state in dataset.states:
            for name, picture in draw_steps(_followed(frames, frames.mean(state.index))).items():
                write_whole(folder / f"step_{state.index:02d}_{name}.png", _png(picture))


def _followed(frames: Frames, image: NDArray[np.float32]) -> FollowedBeam:
    """What was found on the way along the beam in one state, in pixels of the whole picture."""
    dataset = frames.dataset
    region = region_of(frames.calibration, image.shape)
    projection = dataset.projection()
    if region is None:
        return follow_beam(image, frames.calibration, dataset.specimen, projection=projection)
    followed = follow_beam(region.cut(image), region.calibration, dataset.specimen, projection=projection)
    return followed.moved(np.array([region.left, region.top], dtype=np.float64))


def _png(picture: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", picture)[1].tobytes()
