"""Segmenting a whole dataset: every state's frames to edges, stored, and written out for a person on request."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.dataset.edges import write_edges
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.errors import InputError
from eimi_lab.outputs import write_whole
from eimi_lab.vision.edge_set import EdgeSet
from eimi_lab.vision.edges import find_edges
from eimi_lab.vision.intensity import state_mean
from eimi_lab.vision.overlay import contact_sheet, draw_overlay


def segment(path: Path, report: Callable[[str], None]) -> tuple[EdgeSet, ...]:
    """Find the edges of every state, store them in the dataset, return them; `report` gets a line a state.

    The frames of a state are averaged, and corrected by the dark frame and flat field that the dataset keeps. Its
    flags are those of the run (NOT_SETTLED, …) and those of the image. Raises InputError.
    """
    edge_sets = []
    with open_dataset(path) as dataset:
        if dataset.calibration is None:
            raise InputError(f"{path}: holds tracked points, which need no segmentation")
        age = dataset.calibration.age_days(dataset.start_time())
        correction = dataset.correction()
        for state in dataset.states:
            image = state_mean(dataset.images(state.index))
            if correction is not None:
                image = correction.apply(image)
            found = find_edges(image, dataset.calibration, dataset.specimen, calibration_age_days=age)
            edge_set = replace(found, flags=state.flags + found.flags)
            edge_sets.append(edge_set)
            flags = ", ".join(flag.name for flag in edge_set.flags) or "no flags"
            report(f"{len(edge_set.left.sigma_mm)} + {len(edge_set.right.sigma_mm)} points, {flags}")
    write_edges(path, edge_sets)
    return tuple(edge_sets)


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
        if dataset.calibration is None:
            raise InputError(f"{path}: holds tracked points, which have no images")
        for state, edge_set in zip(dataset.states, edge_sets, strict=True):
            picture = draw_overlay(state_mean(dataset.images(state.index)), edge_set, dataset.calibration)
            write_whole(folder / f"step_{state.index:02d}.png", _png(picture))
            share = min(1.0, 512 / max(picture.shape))
            shrunk = cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
            small.append(np.asarray(shrunk, dtype=np.uint8))
            flags = " ".join(flag.name for flag in edge_set.flags)
            captions.append(f"{state.index:02d}: {state.field_mT:.3g} mT {flags}")
    write_whole(folder / "contact_sheet.png", _png(contact_sheet(small, captions)))


def _png(picture: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", picture)[1].tobytes()
