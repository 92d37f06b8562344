"""More load steps need more memory for the results only, and not for temporary arrays."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.laws import LAWS

FEW, MANY = 80, 240
MODEL = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)))
CANDIDATES = np.array([[46e3], [50e3]])
NODE_BYTES = MODEL.mesh.nodes.nbytes  # memory of the nodes for one set of parameters in one state


def solved(states: int, **more: Any) -> Shapes:
    candidates = CANDIDATES[:1] if "near" in more else CANDIDATES
    loads = Loads.along(np.linspace(0, 7.0, states))
    return MODEL.solve(LAWS["neo-hookean"], candidates, loads, tolerance_mm=1e-2, **more)


def bytes_a_state(run: Callable[[int], object]) -> float:
    # Return the growth of the peak memory (bytes) for each additional load step.
    peaks = []
    for states in (FEW, MANY):
        tracemalloc.start()
        run(states)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    return (peaks[1] - peaks[0]) / (MANY - FEW)


def test_a_path_keeps_its_last_states_only() -> None:
    assert bytes_a_state(solved) < 1.5 * len(CANDIDATES) * NODE_BYTES


def test_states_solved_together_need_memory_for_a_block_only() -> None:
    # The limit is 30 times the memory of the nodes; the element stiffness matrices alone would need 100 times.
    every = {states: solved(states, keep=True).every for states in (FEW, MANY)}
    assert bytes_a_state(lambda states: solved(states, near=every[states])) < 30 * NODE_BYTES


def test_states_are_compared_in_blocks() -> None:
    view = View(np.array([15.0, 0.0]), 300.0)
    shapes = {states: solved(states) for states in (FEW, MANY)}
    peaks = {}
    for states, shape in shapes.items():
        points = points_on(outline(MODEL, shape, view)[0], 4)
        peaks[states] = EdgeObservation(points, np.full(points.shape[:-1], 0.005), view)
    residuals = peaks[MANY].misfit(MODEL, shapes[MANY]).residuals
    assert np.abs(residuals[0]).max() < 1e-9 < np.abs(residuals[1]).max(axis=(1, 2)).min()
    growth = bytes_a_state(lambda states: peaks[states].misfit(MODEL, shapes[states]))
    assert growth < 4 * residuals[:, 0].nbytes
