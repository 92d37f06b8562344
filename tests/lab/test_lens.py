"""If the calibration does not give the distance from the lens to the beam, it is estimated from the edges."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import edge_curves, outline, points_on
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.laws import LAWS
from eimi_lab.fits import perspective
from eimi_lab.fits.perspective import seen_depth

DEPTH_MM, CENTRE_MM = 5.0, np.array([15.0, 0.0])


@pytest.fixture(scope="module")
def sides() -> np.ndarray:
    # The edges of the middle plane of a silicone beam in mm, (7 fields, left and right edge, n points, x and y).
    model = BeamModel(Specimen(30.0, 3.0, DEPTH_MM, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)))
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along(np.linspace(0, 8, 7)))
    return points_on(edge_curves(model, shapes)[0], 8)[:, :, 1:-1]


def edges_through_lens(sides: np.ndarray, stand_off_mm: float | None, noise_mm: float) -> EdgeObservation:
    # Return the outline of a beam, with noise, as a lens shows it.
    # sides: edges of the middle plane in 7 states, (7, 2, n, 2) in mm. stand_off_mm: distance of the lens; None if
    # telecentric.
    if stand_off_mm:
        faces = [np.insert(sides, 2, z, axis=-1) for z in (-0.5 * DEPTH_MM, 0.5 * DEPTH_MM)]
        near, far = map(View(CENTRE_MM, stand_off_mm).seen, faces)
        ahead = np.gradient(sides, axis=2)
        outward = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1) * np.array([-1.0, 1.0])[:, None, None]
        sides = np.where(((near - far) * outward).sum(axis=-1, keepdims=True) > 0, near, far)
    noisy = sides + np.random.default_rng(0).normal(0, noise_mm, sides.shape)
    return EdgeObservation(noisy, np.full(sides.shape[:3], noise_mm))


@pytest.mark.parametrize("stand_off_mm", [150.0, 300.0])
def test_the_stand_off_of_an_ordinary_lens_is_measured(sides: np.ndarray, stand_off_mm: float) -> None:
    depth = seen_depth(edges_through_lens(sides, stand_off_mm, 0.003), CENTRE_MM, DEPTH_MM)
    assert depth is not None
    assert stand_off_mm < depth.stand_off_mm < 1.4 * stand_off_mm


@pytest.mark.parametrize("noise_mm", [0.001, 0.003, 0.02])
def test_a_telecentric_lens_is_not_mistaken_for_an_ordinary_one(sides: np.ndarray, noise_mm: float) -> None:
    assert seen_depth(edges_through_lens(sides, None, noise_mm), CENTRE_MM, DEPTH_MM) is None


def test_a_beam_that_is_wider_at_its_tip_is_not_mistaken_for_a_lens(sides: np.ndarray) -> None:
    tapered = sides.copy()
    middle = tapered.mean(axis=1, keepdims=True)
    tapered = middle + (tapered - middle) * np.linspace(1.0, 1.1, tapered.shape[2])[:, None]
    assert seen_depth(edges_through_lens(tapered, None, 0.003), CENTRE_MM, DEPTH_MM) is None


@pytest.mark.parametrize("stand_off_mm", [None, 200.0])
def test_a_solid_that_bows_across_its_depth_is_not_mistaken_for_a_lens(stand_off_mm: float | None) -> None:
    model = SolidBeside(Specimen(30.0, 3.0, DEPTH_MM, 1070.0, "solid", Magnet(4.0, 3.0, 3.0, 1.2, 7500.0)), 20, 2)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along(np.linspace(0, 7, 16)))
    view = View(CENTRE_MM, stand_off_mm) if stand_off_mm else None
    depth = seen_depth(
        edges_through_lens(points_on(outline(model, shapes, view)[0], 8)[:, :, 1:-1], None, 0.001), CENTRE_MM, DEPTH_MM
    )
    if stand_off_mm is None:
        assert depth is None
    else:
        assert depth is not None
        assert 0.5 * stand_off_mm < depth.stand_off_mm < 1.5 * stand_off_mm


def arc(radius_mm: float, half_mm: float, points: int = 1500) -> EdgeObservation:
    # Return both edges of a beam that is bent to a circle about (0, -radius), from the top to one radian.
    angle = np.linspace(0.0, 1.0, points)
    rays = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    sides = np.array([(radius_mm + half_mm) * rays, (radius_mm - half_mm) * rays]) - [0.0, radius_mm]
    sigma = np.full((1, 2, points), 0.01)
    sides[0, -1] += 50.0  # a point that was not measured
    sigma[0, 0, -1] = np.inf
    return EdgeObservation(sides[None], sigma)


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_the_profile_of_a_circular_beam_has_its_width_its_distances_and_its_curvature(turned: float) -> None:
    radius_mm, half_mm, centre_mm = 25.0, 1.5, np.array([6.0, -3.0])
    one = arc(radius_mm, half_mm)
    edges = EdgeObservation(one.points_mm * [1.0, turned], one.sigma_mm)
    width, distances, curvature = perspective._profile(edges, 0, centre_mm * [1.0, turned])
    step = 0.05  # angle between neighbouring stations
    angle = np.linspace(0.1, 0.9, 17)
    rays = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    middle = radius_mm * rays - [0.0, radius_mm]
    expected = sum(np.abs(((middle + h * rays - centre_mm) * rays).sum(axis=1)) for h in (half_mm, -half_mm))
    inner = slice(2, -2)
    assert width[inner] == pytest.approx(np.full(13, 2 * half_mm), rel=1e-5)
    assert distances[inner] == pytest.approx(expected[inner], rel=1e-3)
    chord_mm = radius_mm * np.sin(step)  # half of the chord to the next station but one
    assert curvature[inner] == pytest.approx(np.full(13, step / chord_mm), rel=1e-3)


def test_the_stations_and_the_crossings_of_an_edge_are_those_of_its_lines_and_parabolas() -> None:
    corner = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 6.0]])
    stations = perspective._at_stations(corner)
    along = np.linspace(1.0, 9.0, 17)
    assert stations == pytest.approx(np.stack([np.minimum(along, 4.0), np.maximum(along - 4.0, 0.0)], axis=1))
    x = np.linspace(-1.0, 11.0, 25)
    edge = np.stack([x, 2.0 + 0.3 * x - 0.05 * x**2], axis=1)
    places = np.array([[0.0, 1.0], [3.2, 0.5], [7.0, -1.0]])
    up = np.tile([0.0, 1.0], (3, 1))
    expected = 2.0 + 0.3 * places[:, 0] - 0.05 * places[:, 0] ** 2 - places[:, 1]
    assert perspective._crossing(edge, places, up) == pytest.approx(expected)
    # Only the six nearest points count.
    far = edge.copy()
    far[np.abs(x - 3.2) > 1.6, 1] += 5.0
    assert perspective._crossing(far, places[1:2], up[:1]) == pytest.approx(expected[1:2])
    assert perspective._crossing(edge, places, -up) == pytest.approx(-expected)


def profiles(slope: float, scatter: float = 0.0) -> np.ndarray:
    # Return profiles of six states: each width is a number of its station, plus `slope` times the distance.
    # A curvature of 1 adds 0.7 to the width, and the `scatter` is a change of the slope from state to state.
    rng = np.random.default_rng(4)
    distance, curvature = rng.uniform(5.0, 20.0, (6, 5)), rng.uniform(0.0, 0.1, (6, 5))
    slopes = slope + scatter * np.array([1.0, -1.0, 0.5, -0.5, 0.2, -0.2])[:, None]
    width = np.arange(3.0, 8.0) + slopes * distance + 0.7 * curvature
    return np.stack([width, distance, curvature], axis=1)


def seen(values: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> perspective.SeenDepth | None:
    monkeypatch.setattr(perspective, "_profile", lambda observed, k, centre_mm: values[k])
    edges = EdgeObservation(np.zeros((len(values), 2, 4, 2)), np.ones((len(values), 2, 4)))
    return seen_depth(edges, CENTRE_MM, 5.0)


def test_the_stand_off_is_half_of_the_depth_over_the_slope_of_the_width(monkeypatch: pytest.MonkeyPatch) -> None:
    values = profiles(0.02)
    assert perspective._slope(values) == pytest.approx(0.02)
    depth = seen(values, monkeypatch)
    assert depth is not None
    assert depth.stand_off_mm == pytest.approx(2.5 / 0.02)
    assert depth.change_mm == pytest.approx(0.02 * np.ptp(values[:, 1], axis=0).max())
    assert seen(profiles(-0.02), monkeypatch) is None
    assert seen(values[:4], monkeypatch) is not None
    assert seen(values[:3], monkeypatch) is None


def test_a_slope_counts_from_six_standard_errors_of_the_jackknife_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def ratio(scatter: float) -> float:
        values = profiles(0.02, scatter)
        without = [perspective._slope(np.delete(values, k, axis=0)) for k in range(6)]
        error = np.sqrt(5 / 6 * sum((one - sum(without) / 6) ** 2 for one in without))
        return float(perspective._slope(values) / error)

    low, high = 1e-5, 0.04
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ratio(middle) > 6.0 else (low, middle)
    assert ratio(0.999 * low) > 6.0 > ratio(1.001 * low)
    assert seen(profiles(0.02, 0.999 * low), monkeypatch) is not None
    assert seen(profiles(0.02, 1.001 * low), monkeypatch) is None
