"""Store and read the edges of the beam that were found in the frames of a dataset."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import h5py
import numpy as np

from eimi_fitting.time.measured import Kind, Motion
from eimi_lab.dataset.default_plots import write_plots
from eimi_lab.dataset.layout import (
    PROGRAM,
    PROGRAM_URL,
    START_ATTRIBUTE,
    flags_from_text,
    flags_to_text,
    get_start,
    get_text,
    group,
    note,
    now,
    put_date,
    put_definition,
    put_text,
)
from eimi_lab.dataset.moving.stored_motions import write_motions
from eimi_lab.dataset.rewriting import rewritten
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.projection import Projection

GROUP = "segmentation"
BYTES_OF_A_STATE = 512
"""Bytes that are reserved for the flags, the corners and the tip of one state."""


def write_edges(
    path: str | Path,
    edge_sets: Sequence[EdgeSet],
    projection: Projection | None = None,
    motions: Sequence[Motion] = (),
    length_mm: float = 0.0,
    kinds: Sequence[Kind] = (),
) -> None:
    """Store the edges of every load step, and the motions of the beam, in a dataset. Earlier edges are replaced.

    Parameters
    ----------
    path
        The dataset.
    edge_sets
        The edges of each load step.
    projection
        Conversion of colours to grey values for these edges; None for frames without colours.
    motions
        Free oscillations and creep (positions of points over time), which replace stored ones of the same kind.
    length_mm
        Length of the beam, mm.
    kinds
        Kinds of motion of which stored motions are removed even if ``motions`` contains none of this kind.

    Raises
    ------
    InputError
        If the file is still being written, or if its writer crashed.
    ValueError
        If ``edge_sets`` does not contain one element for each load step.
    """
    path = Path(path)
    points = [edge for edge_set in edge_sets for edge in (edge_set.left, edge_set.right)]
    size = 2 * sum(edge.points_mm.nbytes + edge.sigma_mm.nbytes for edge in points)  # the outline plot holds them again
    size += sum(3 * motion.points_mm.nbytes for motion in motions)
    with rewritten(path, size + BYTES_OF_A_STATE * len(edge_sets)) as entry:
        states = len(entry["states/index"])
        if states != len(edge_sets):
            raise ValueError(
                f"{path}: {len(edge_sets)} sets of edges are given for {states} states; give one set of edges for "
                "each state"
            )
        drop_edges(entry)
        process = group(entry, GROUP, "NXprocess")
        _write(process, edge_sets)
        write_plots(entry, process, edge_sets)
        _comply_with_definition(entry)
        for kind in dict.fromkeys([*kinds, *(motion.kind for motion in motions)]):
            write_motions(entry, kind, [motion for motion in motions if motion.kind == kind], length_mm)
        if projection is not None:
            note(process, "projection", projection.to_json(), "application/json")


def drop_edges(entry: h5py.Group) -> None:
    """Remove the stored edges and their plots from a dataset, if there are any."""
    if GROUP in entry:
        del entry[GROUP]
        entry.attrs["default"] = "data"


def _write(process: h5py.Group, edge_sets: Sequence[EdgeSet]) -> None:
    put_text(process, "program", PROGRAM).attrs.update(version=version(PROGRAM), program_url=PROGRAM_URL)
    put_text(process, "version", version(PROGRAM))
    put_date(process, "date", now())
    edges = group(process, "edges", "NXcollection")
    for side in ("left", "right"):
        edges_of_side = [getattr(edge_set, side) for edge_set in edge_sets]
        store = group(edges, side, "NXcollection")
        store["count"] = np.array([len(edge.sigma_mm) for edge in edges_of_side], dtype=np.int64)
        store["points"] = np.concatenate([edge.points_mm.reshape(-1, 2) for edge in edges_of_side])
        store["sigma"] = np.concatenate([edge.sigma_mm for edge in edges_of_side])
        store["points"].attrs["units"] = store["sigma"].attrs["units"] = "mm"
    edges["corners"] = np.stack([edge_set.corners_px for edge_set in edge_sets])
    edges["corners"].attrs["units"] = "pixel"
    ages = [edge_set.calibration_age_days for edge_set in edge_sets]
    edges["calibration_age"] = np.array([np.nan if age is None else age for age in ages])
    edges["calibration_age"].attrs["units"] = "day"
    put_text(edges, "calibration_digest", json.dumps([edge_set.calibration_digest for edge_set in edge_sets]))
    put_text(edges, "flags", json.dumps([flags_to_text(edge_set.flags).decode() for edge_set in edge_sets]))


def _comply_with_definition(entry: h5py.Group) -> None:
    """Store what a NeXus application definition requires: its name, and the start and end of the run as dates."""
    dates = {"start_time": get_start(entry)}
    if "end" in entry.get("sessions", ()) and len(ends := entry["sessions/end"]):
        dates["end_time"] = ends[-1].decode()
    elif "end_time" in entry and not entry["end_time"].dtype.hasobject:
        dates["end_time"] = get_text(entry, "end_time").strip()
    for name in ("definition", *dates):
        if name in entry:
            del entry[name]
    put_definition(entry)
    entry["states"].attrs[START_ATTRIBUTE] = np.bytes_(dates["start_time"])
    for name, date in dates.items():
        if date:
            put_date(entry, name, date)


def read_edges(entry: h5py.Group) -> tuple[EdgeSet, ...]:
    """Return the stored edges of every load step of a dataset."""
    edges = entry[GROUP]["edges"]
    left, right = _read_side(edges["left"]), _read_side(edges["right"])
    flags = [flags_from_text(text.encode()) for text in json.loads(bytes(edges["flags"][()]))]
    digests = json.loads(bytes(edges["calibration_digest"][()]))
    ages = [None if np.isnan(age) else float(age) for age in edges["calibration_age"][()]]
    corners = edges["corners"][()]
    return tuple(EdgeSet(*parts) for parts in zip(left, right, flags, corners, digests, ages, strict=True))


def read_projection(entry: h5py.Group) -> Projection | None:
    """Return the conversion of colours to grey values that was used to find the stored edges.

    The result is None if no edges are stored, or if the frames have no colours.
    """
    if GROUP not in entry or "projection" not in entry[GROUP]:
        return None
    return Projection.from_json(get_text(entry[GROUP]["projection"], "data"))


def _read_side(store: h5py.Group) -> list[EdgePoints]:
    bounds = np.cumsum(store["count"][()])[:-1]
    points, sigma = np.split(store["points"][()], bounds), np.split(store["sigma"][()], bounds)
    return [EdgePoints(p, s) for p, s in zip(points, sigma, strict=True)]
