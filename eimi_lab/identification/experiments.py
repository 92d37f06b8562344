"""A dataset as evidence: its specimen's model, its loads and what was seen, in the terms of the mechanics."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eimi_fitting.actuation import Loads
from eimi_fitting.experiment import Experiment
from eimi_fitting.forward import BeamModel
from eimi_fitting.observation import EdgeObservation, Observation, Perspective, PointObservation
from eimi_fitting.specimen import Section
from eimi_lab.dataset.reading import Dataset, State, open_dataset
from eimi_lab.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edge_set import EdgeSet

FEWEST_POINTS = 10  # on each edge; fewer cannot say where the beam is


@dataclass(frozen=True)
class Evidence:
    """One dataset ready to fit: the experiment, and which of its states it holds."""

    path: Path
    sha256: str
    experiment: Experiment
    states: tuple[State, ...]
    left_out: tuple[State, ...]


def _silent(words: str) -> None:
    """For callers that do not want to hear of each state."""


def load_evidence(
    path: str | Path,
    *,
    section: Section | None = None,
    flagged: bool = False,
    report: Callable[[str], None] = _silent,
) -> Evidence:
    """Read a dataset, segmenting it first where that was not done; raises InputError.

    section overrides the specimen's own; flagged states are left out unless asked for; ``report`` gets a line for
    each state that had to be segmented.
    """
    path = Path(path)
    with open_dataset(path) as dataset:
        needs_edges = dataset.kind == "frames" and dataset.edges() is None
    if needs_edges:
        from eimi_lab.segmentation import segment  # a slow import that a fit of stored edges does without

        segment(path, report)
    with open_dataset(path) as dataset:
        specimen = dataset.specimen.mechanics()
        if section:
            specimen = dataclasses.replace(specimen, section=section)
        used, observed = _observed(dataset, flagged)
        states = tuple(dataset.states[i] for i in used)
        if len(states) < 2:
            raise InputError(
                f"{path}: {len(states)} of {len(dataset.states)} states can be used; a fit needs at least 2"
                + ("" if flagged else " (--include-flagged takes the flagged ones too)")
            )
        loads = Loads.along(
            [s.field_mT for s in states],
            dataset.field_angle_deg,
            dataset.gravity_angle_deg,
            [s.tip_force_N for s in states],
        )
        left_out = tuple(s for s in dataset.states if s not in states)
    model = BeamModel(specimen).refined()
    if isinstance(observed, PointObservation):
        rest = observed.rest_mm[np.isfinite(observed.sigma_mm)]
        try:
            model.place(rest[~model.grid.on_magnet(rest)])
        except ValueError as error:
            raise InputError(f"{path}: {error}") from error
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return Evidence(path, digest, Experiment(model, loads, observed), states, left_out)


def _observed(dataset: Dataset, flagged: bool) -> tuple[list[int], Observation]:
    if dataset.kind == "points":
        points = dataset.points()
        most = max(len(p.names) for p in points)
        rest, moved = np.zeros((2, len(points), most, 2))
        sigma = np.full((len(points), most), np.inf)
        for k, p in enumerate(points):
            rest[k, : len(p.names)], moved[k, : len(p.names)] = p.rest_mm, p.points_mm
            sigma[k, : len(p.names)] = p.sigma_mm
        return list(range(len(points))), PointObservation(rest, moved, sigma)
    edges = dataset.edges() or ()
    used = [
        i
        for i, (state, found) in enumerate(zip(dataset.states, edges, strict=True))
        if _enough(found) and (flagged or not (found.flags or state.flags))
    ]
    if not used:
        raise InputError(f"{dataset.path}: no state has edges that can be used; {_first_flag(edges)}")
    return used, EdgeObservation.from_edges(
        [(e.left.points_mm, e.left.sigma_mm, e.right.points_mm, e.right.sigma_mm) for e in (edges[i] for i in used)],
        _perspective(dataset),
    )


def _perspective(dataset: Dataset) -> Perspective | None:
    if dataset.calibration is None:
        return None
    (height, width), _ = dataset.frame_format()
    try:
        return BeamFrame(dataset.calibration).perspective(dataset.specimen.specimen.depth_mm, (width, height))
    except ValueError as error:
        raise InputError(f"{dataset.path}: calibration.stand_off_mm: {error}") from error


def _enough(found: EdgeSet) -> bool:
    return min(len(found.left.points_mm), len(found.right.points_mm)) >= FEWEST_POINTS


def _first_flag(edges: tuple[EdgeSet, ...]) -> str:
    flags = [flag for found in edges for flag in found.flags]
    if not flags:
        return "the frames show no beam"
    return f"the first flag is {flags[0].name}: {flags[0].remedy}"
