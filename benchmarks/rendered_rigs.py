"""Render pictures of a beam whose bench differs from the stated values, and find the edges in the pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.virtual.optics import Scene, expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import leaves_out
from eimi_lab.vision.edges.finding import find_edges
from tests.shared.rendered_edges import CALIBRATION, NOMINAL, SIZE

Array = NDArray[np.float64]

_CLAMP_MM = np.array([[0.0, -6.0], [0.0, 6.0], [-15.0, 6.0], [-15.0, -6.0]])


def clean_pictures(sides: Array, magnets: Array, clamp: Callable[[Array], Array]) -> list[Scene]:
    """Render one picture without noise of each of K states.

    Parameters
    ----------
    sides : ndarray, shape (K, 2, m, 2)
        x and y (mm) of m points on the left and the right edge, as the camera shows them.
    magnets : ndarray, shape (K, 4, 2)
        x and y (mm) of the corners of the magnet, as the camera shows them.
    clamp : callable
        Maps true positions of the clamp to the positions that the camera shows.
    """
    frame, scenes = BeamFrame(CALIBRATION), []
    for (left, right), magnet in zip(sides, magnets, strict=True):
        beam = np.concatenate([left, right[::-1]])
        beam_px, magnet_px, clamp_px = (frame.to_px(places) for places in (beam, magnet, clamp(_CLAMP_MM)))
        scenes.append(make_scene(NOMINAL, SIZE, beam_px, magnet_px, clamp_px, oversampling=2))
    return scenes


def edges_in(pictures: Sequence[Scene], specimen: SpecimenFile, seed: int) -> tuple[EdgeObservation, NDArray[np.intp]]:
    """Add noise to pictures, and find the edges; return the usable edges and the indices of their pictures.

    `specimen` is the specimen that the search for the edges assumes.
    """
    rng, usable_edges, used = np.random.default_rng(seed), [], []
    for k, picture in enumerate(pictures):
        edges = find_edges(expose(picture, rng), CALIBRATION, specimen)
        if not leaves_out(edges.flags):
            left_edge, right_edge = edges.left, edges.right
            usable_edges.append((left_edge.points_mm, left_edge.sigma_mm, right_edge.points_mm, right_edge.sigma_mm))
            used.append(k)
    return EdgeObservation.from_edges(usable_edges), np.array(used, np.intp)
