"""Distances of measured points from simulated edges agree with curves whose distances are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.measurements import (
    EdgeObservation,
    PointObservation,
    edge_curves,
    points_on,
    signed_distance,
)
from eimi_fitting.laws import LAWS

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))


ARRAYS = ("displacement", "rigid", "status", "iterations", "max_stretch")
"""The arrays of the solved shapes, whose first two axes are candidate and state."""


def arc(radius: float, segments: int = 12, angle: float = 1.2) -> np.ndarray:
    # Return S quadratic segments on a circular arc of `angle` (rad), shape (S, 3, 2): three nodes, x and y.
    ends = np.linspace(0, angle, 2 * segments + 1)
    points = radius * np.column_stack([np.cos(ends), np.sin(ends)])
    return np.stack([points[0:-1:2], points[1::2], points[2::2]], axis=1)


@settings(max_examples=50)
@given(offset=st.floats(-2.0, 2.0), along=st.floats(0.05, 1.15))
def test_distance_to_a_circle_is_the_difference_of_radii(offset, along):
    radius = 20.0
    point = (radius + offset) * np.array([[np.cos(along), np.sin(along)]])
    # The arc runs anticlockwise, so that the left side is inward.
    assert signed_distance(arc(radius), point)[0] == pytest.approx(-offset, abs=2e-4)


def test_beyond_the_ends_a_curve_is_continued_by_a_twentieth_of_its_length():
    line = np.array([[[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]])
    distance = signed_distance(line, np.array([[2.05, 0.0], [-3.05, 4.0], [1.04, 0.2], [-0.04, -0.2]]))
    assert np.abs(distance) == pytest.approx([1.0, 5.0, 0.2, 0.2])
    assert np.sign(distance[2:]).tolist() == [1.0, -1.0]


def test_the_distance_of_a_point_just_beyond_the_tip_changes_smoothly_while_the_edge_passes_it():
    line = np.array([[[0.0, 0.0], [15.0, 0.0], [30.0, 0.0]]])
    beside_mm = np.linspace(-0.01, 0.01, 9)
    points = np.stack([np.full(9, 30.4), beside_mm], axis=-1)
    assert signed_distance(line, points) == pytest.approx(beside_mm, abs=1e-12)


def test_edges_of_an_unloaded_beam_are_its_sides():
    model = BeamModel(SPECIMEN)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[4e4]]), Loads.along(0.0, gravity_angle_deg=None))
    left, right = points_on(edge_curves(model, shapes)[0, 0], 4)
    for side, y in ((left, -1.5), (right, 1.5)):
        assert side[:, 1] == pytest.approx(y, abs=1e-9)
        assert side[[0, -1], 0] == pytest.approx([0.0, 30.0], abs=1e-9)
        assert np.all(np.diff(side[:, 0]) > 0)


def test_error_and_deviation_by_hand():
    model = BeamModel(SPECIMEN)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[4e4]]), Loads.along(0.0, gravity_angle_deg=None))
    x = np.array([5.0, 10.0])
    sigma = np.ones(2)
    # The left points lie 0.3 mm outside, and the right points 0.1 mm: distances 0.3, 0.3, 0.1, 0.1.
    left, right = np.column_stack([x, [-1.8, -1.8]]), np.column_stack([x, [1.6, 1.6]])
    misfit = EdgeObservation.from_edges([(left, sigma, right, sigma)]).misfit(model, shapes)
    assert misfit.error_mm[0, 0] == pytest.approx(np.sqrt((0.09 + 0.01) / 2), abs=1e-9)
    assert misfit.deviation_mm[0, 0] == pytest.approx(0.1, abs=1e-9)


def test_error_and_deviation_of_points_by_hand():
    # Distances of 0.5 and 0.1 mm have a root mean square of 0.36 mm and a standard deviation of 0.2 mm.
    model = BeamModel(Specimen(50.0, 2.0, 4.0, 1.0, "plane-stress"))
    shapes = model.solve(LAWS["neo-hookean"], np.array([[4e4]]), Loads.along(0.0, gravity_angle_deg=None))
    rest = np.array([[[20.0, 0.0], [30.0, 0.5], [40.0, 0.0]]])
    moved = rest + np.array([[0.3, 0.4], [0.0, -0.1], [9.0, 9.0]])
    misfit = PointObservation(rest, moved, np.array([[0.01, 0.01, np.inf]])).misfit(model, shapes)
    assert misfit.error_mm[0, 0] == pytest.approx(np.sqrt((0.25 + 0.01) / 2), abs=1e-9)
    assert misfit.deviation_mm[0, 0] == pytest.approx(0.2, abs=1e-9)


def test_padding_points_are_ignored():
    model = BeamModel(SPECIMEN)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[4e4]]), Loads.along(0.0, gravity_angle_deg=None))
    one, three = np.array([[5.0, -1.7]]), np.column_stack([[5.0, 10.0, 15.0], [1.7] * 3])
    misfit = EdgeObservation.from_edges([(one, np.ones(1), three, np.ones(3))]).misfit(model, shapes)
    assert misfit.weights.sum() == 4
    assert misfit.error_mm[0, 0] == pytest.approx(0.2, abs=1e-9)


def test_points_of_each_state_are_compared_in_their_own_state():
    model = BeamModel(Specimen(50.0, 2.0, 4.0, 1.0, "plane-stress"))
    shapes = model.solve(
        LAWS["neo-hookean"], np.array([[4e4], [8e4]]), Loads.along([0.0, 0.0], 90.0, 90.0, [0.0, 1e-6])
    )
    rest = np.array([[50.0, 0.0]])
    where = model.positions(shapes, rest)[0, :, 0]
    observed = PointObservation(
        np.array([rest, rest]), where[:, None] + [[[0.0, 0.03]], [[0.04, 0.0]]], np.ones((2, 1))
    )
    misfit = observed.misfit(model, shapes)
    assert misfit.error_mm[0] == pytest.approx([0.03, 0.04], abs=1e-12)
    assert np.all(misfit.error_mm[1] != misfit.error_mm[0])


def test_many_states_have_the_same_residuals_as_each_state_alone():
    model = BeamModel(Specimen(50.0, 2.0, 4.0, 1.0, "plane-stress"))
    loads = Loads.along(np.zeros(35), 90.0, 90.0, np.linspace(0, 2e-6, 35))
    shapes = model.solve(LAWS["neo-hookean"], np.array([[4e4], [8e4]]), loads)
    rng = np.random.default_rng(0)
    points = edge_curves(model, shapes)[0, :, :, 3:9, 1] + 0.01 * rng.standard_normal((35, 2, 6, 2))
    rest = np.column_stack([np.linspace(10, 48, 5), np.zeros(5)]) + 0.5 * rng.integers(0, 2, (35, 1, 1))
    moved = rest + 0.01 * rng.standard_normal((35, 5, 2))
    for observed in (EdgeObservation(points, np.ones((35, 2, 6))), PointObservation(rest, moved, np.ones((35, 5)))):
        every = observed.misfit(model, shapes)
        for k in (0, 15, 16, 34):
            part = {name: value[:, [k]] for name, value in vars(shapes).items() if name in ARRAYS}
            alone = observed.of_states(np.array([k])).misfit(model, replace(shapes, **part))
            assert every.residuals[:, k] == pytest.approx(alone.residuals[:, 0], abs=1e-12)
