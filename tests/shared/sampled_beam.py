"""Pictures that are sampled along and across a straight beam, the input of the edge search."""

from __future__ import annotations

from typing import Any

import numpy as np

from eimi_lab.vision.following.unrolled import UnrolledPicture

Array = np.ndarray
ACROSS = np.arange(-26, 27) / 24.0
EDGES = np.outer([-0.5, 0.5], np.ones(60))


def unrolled(colours: Array, stated: float = 1.0, faces: tuple[float, float] = (0.0, 0.0)) -> UnrolledPicture:
    # Return the picture of a straight vertical beam, 24 px wide, with given colours: one row for every 2 px along the
    # beam, one column for every px across it. `stated` is the width of the beam in the specimen file, `faces` are the
    # widths of its visible side faces; these are divided by 24 px.
    stations = len(colours)
    return UnrolledPicture(
        colours=colours.astype(np.float32),
        across=ACROSS,
        along=np.arange(stations) / 12.0,
        middle=np.column_stack([np.full(stations, 100.0), 2.0 * np.arange(stations)]),
        aside=np.tile([24.0, 0.0], (stations, 1)),
        width=np.ones(stations),
        stated=np.full(stations, stated),
        inside=np.ones(colours.shape[:2], dtype=bool),
        side_faces=np.array(faces)[:, None],
    )


def body(colour: tuple[float, ...], ground: tuple[float, ...], *bands: Any, stations: int = 60, seed: int = 1) -> Array:
    """Return noisy colours across a beam, whose edges are at -0.5 and 0.5; `bands` are stripes (low, high, colour)."""
    rng = np.random.default_rng(seed)
    colours = np.tile(np.array(ground), (stations, 53, 1)) + rng.normal(0.0, 0.5, (stations, 53, len(ground)))
    for low, high, of_band in ((-0.5, 0.5, colour), *bands):
        colours[:, (low < ACROSS) & (high > ACROSS)] += np.array(of_band) - np.array(ground)
    return colours
