"""Rough edges are averaged along the edge, smooth edges are not."""

import cv2
import numpy as np
import pytest

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.following.edge_points import StripEdges, estimate_scatter
from eimi_lab.vision.following.texture import average_texture
from tests.shared.photographs import CALIBRATION, SPECIMEN

WIDTH_PX = 100.0
POINTS = 100


def bent_edge(rough_px: float, seed: int, length_px: float = 5.0) -> tuple[StripEdges, np.ndarray, np.ndarray]:
    # Return an edge that bends by 90 degrees, its n true points, and the unit normals there, shapes (n, 2).
    # rough_px: standard deviation of the points. length_px: distance at which the correlation of their errors is 1/e.
    along = np.linspace(0.0, 6.0 * WIDTH_PX, POINTS)
    turn = 0.5 * np.pi * (along / along[-1]) ** 2
    step = along[1] * np.column_stack([np.cos(turn), np.sin(turn)])
    true = np.cumsum(step, axis=0)
    normal = np.column_stack([-np.sin(turn), np.cos(turn)])
    correlation = np.exp(-np.abs(along[:, None] - along) / length_px)
    errors = rough_px * np.linalg.cholesky(correlation) @ np.random.default_rng(seed).normal(size=POINTS)
    points, sigma, kept = estimate_scatter(true + errors[:, None] * normal, np.ones(POINTS))
    return StripEdges(points[kept], sigma[kept], along[kept] / WIDTH_PX, 1.0), true[kept], normal[kept]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(("length_px", "factor"), [(2.0, 0.72), (12.0, 0.8), (25.0, 0.87)])
def test_points_of_a_rough_edge_are_nearer_to_the_true_edge_after_the_average(length_px: float, factor: float) -> None:
    before, after, stated = [], [], []
    for seed in range(10):
        edge, true, normal = bent_edge(1.5, seed, length_px)
        averaged = average_texture(edge, WIDTH_PX)
        before.append(((edge.points - true) * normal).sum(axis=1))
        after.append(((averaged.points - true) * normal).sum(axis=1))
        stated.append(averaged.sigma)
        assert (averaged.along == edge.along).all()
    rms_before, rms_after, rms_stated = (rms(np.concatenate(each)) for each in (before, after, stated))
    assert rms_after < factor * rms_before
    assert 0.45 * rms_after < rms_stated < 1.1 * rms_after


def test_half_of_the_scatter_remains_from_which_the_deviation_is_estimated() -> None:
    edge, _, _ = bent_edge(1.5, 3)
    averaged = average_texture(edge, WIDTH_PX)
    assert 0.5 <= averaged.sigma.mean() / edge.sigma.mean() < 0.65


def test_a_smooth_edge_is_returned_as_it_is() -> None:
    edge, _, _ = bent_edge(0.4, 0)
    assert average_texture(edge, WIDTH_PX) is edge


def test_points_farther_apart_than_the_average_are_kept() -> None:
    edge, _, _ = bent_edge(1.5, 0)
    averaged = average_texture(edge, 4.0)
    assert np.abs(averaged.points - edge.points).max() < 1e-6
    assert averaged.sigma == pytest.approx(edge.sigma, rel=0.1)


def test_an_edge_of_few_points_is_returned_as_it_is() -> None:
    edge, _, _ = bent_edge(1.5, 0)
    few = StripEdges(edge.points[:13], edge.sigma[:13], edge.along[:13], 1.0)
    assert average_texture(few, WIDTH_PX) is few


def test_folds_of_a_wrapped_beam_move_its_edges_less_than_their_height() -> None:
    # The true edges are the straight middle lines of the folds.
    y, x = np.mgrid[0:480, 0:240].astype(float)
    folds = 2.5 * np.sin(2.0 * np.pi * y / 14.0)
    body = (np.abs(x - 120.0) < 21.0 + folds) & (y > 30.0) & (y < 450.0)
    image = np.where(body[..., None], (60.0, 70.0, 170.0), (180.0, 190.0, 170.0))
    image = cv2.GaussianBlur(image, (0, 0), 1.0) + np.random.default_rng(0).normal(0.0, 2.0, image.shape)
    calibration = CALIBRATION.model_copy(update={"clamp_midpoint_px": (120.0, 30.0)})
    edges = find_edges(np.clip(image, 0, 255).astype(np.uint8), calibration, SPECIMEN)
    assert all(flag.severity is not Severity.UNUSABLE for flag in edges.flags)
    for edge in (edges.left, edges.right):
        px, py = BeamFrame(calibration).to_px(edge.points_mm).T
        off = np.abs(px - 120.0) - 21.0
        assert np.ptp(py) > 300.0
        assert rms(off) < 0.6 * 2.5 / np.sqrt(2.0)
        scatter = np.std(off) / rms(edge.sigma_mm) / calibration.pixels_per_mm
        assert 0.8 < scatter < 1.25
