"""Render pictures of the beam of an imperfect bench, and find the edges in the pictures.

An imperfect bench has one property that differs from its files, such as a tilted camera.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.virtual.optics import expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import leaves_out
from eimi_lab.vision.edges.finding import find_edges
from tests.shared.rendered_edges import CALIBRATION, NOMINAL, SIZE

Array = NDArray[np.float64]

_CLAMP_MM = np.array([[0.0, -6.0], [0.0, 6.0], [-15.0, 6.0], [-15.0, -6.0]])


def rendered(
    sides: Array, magnets: Array, clamp: Callable[[Array], Array], specimen: SpecimenFile, seed: int
) -> tuple[EdgeObservation, NDArray[np.intp]]:
    """Render one picture of each of K states (load steps); return the usable edges, and the indices of their states.

    Parameters
    ----------
    sides : ndarray, shape (K, 2, m, 2)
        Coordinates x and y in the beam frame (mm) of m points on the left and on the right edge, at the positions that
        the camera shows.
    magnets : ndarray, shape (K, 4, 2)
        Coordinates x and y in the beam frame (mm) of the corners of the magnet, at the positions that the camera shows.
    clamp : callable
        Maps true positions of the clamp to the positions at which the camera shows them.
    specimen : SpecimenFile
        The specimen that the search for the edges assumes.
    seed : int
        Seed of the noise of the pictures.
    """
    frame, rng = BeamFrame(CALIBRATION), np.random.default_rng(seed)
    usable_edges, used = [], []
    for k, ((left, right), magnet) in enumerate(zip(sides, magnets, strict=True)):
        beam = np.concatenate([left, right[::-1]])
        beam_px, magnet_px, clamp_px = (frame.to_px(places) for places in (beam, magnet, clamp(_CLAMP_MM)))
        scene = make_scene(NOMINAL, SIZE, beam_px, magnet_px, clamp_px, oversampling=2)
        edges = find_edges(expose(scene, rng), CALIBRATION, specimen)
        if not leaves_out(edges.flags):
            left_edge, right_edge = edges.left, edges.right
            usable_edges.append((left_edge.points_mm, left_edge.sigma_mm, right_edge.points_mm, right_edge.sigma_mm))
            used.append(k)
    return EdgeObservation.from_edges(usable_edges), np.array(used, np.intp)
