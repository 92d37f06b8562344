"""A bootstrap replicate of the data consists of whole load steps, drawn at random."""

from __future__ import annotations

import numpy as np

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_fitting.inference.interval.bootstrap import resampled

STATES = 8


def experiments() -> list[Experiment]:
    # Return two experiments, with edges and with tracked points; each coordinate is the index of its load step.
    number = np.arange(float(STATES))
    loads = Loads.along(number, 90.0, 0.0, 1e-3 * number)
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", None))
    edges = EdgeObservation(
        np.tile(number[:, None, None, None], (1, 2, 5, 2)), np.tile(number[:, None, None], (1, 2, 5))
    )
    points = np.tile(number[:, None, None], (1, 3, 2))
    return [
        Experiment(model, loads, edges),
        Experiment(model, loads, PointObservation(points, points, np.tile(number[:, None], (1, 3)))),
    ]


def states(experiment: Experiment) -> list[int]:
    return np.rint(1e3 * experiment.loads.field_T[:, 1]).astype(int).tolist()


def test_whole_states_are_drawn_with_their_loads_and_in_order():
    measured = experiments()
    drawn = [states(e) for replicate in range(1, 200) for e in resampled(measured, 1, replicate)]
    for replicate in range(1, 20):
        edges, points = resampled(measured, 1, replicate)
        for drawn_states in (states(edges), states(points)):
            assert len(drawn_states) == STATES
            assert drawn_states == sorted(drawn_states)
        assert (
            edges.observed.points_mm[:, 1, 3, 0].tolist() == edges.observed.sigma_mm[:, 0, 2].tolist() == states(edges)
        )
        assert points.observed.rest_mm[:, 2, 0].tolist() == points.observed.sigma_mm[:, 1].tolist() == states(points)
        assert np.rint(1e3 * points.loads.tip_force_N[:, 0] * 1e3).tolist() == [1e3 * s for s in states(points)]
    # Each of 8 draws misses a given state with a probability of 7/8, so that 34 % of the states are in no draw.
    left_out = np.mean([1 - len(set(d)) / STATES for d in drawn])
    assert abs(left_out - (7 / 8) ** 8) < 0.02


def test_a_replicate_does_not_depend_on_other_replicates():
    measured = experiments()
    once = [states(e) for e in resampled(measured, 3, 7)]
    resampled(measured, 3, 8)
    assert [states(e) for e in resampled(measured, 3, 7)] == once
    assert once[0] != once[1]
    assert [states(e) for e in resampled(measured, 3, 8)] != once
    assert [states(e) for e in resampled(measured, 4, 7)] != once
