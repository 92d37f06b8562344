"""Compare the edges found in real photographs with edges that a person traced: ``python -m benchmarks.real_pictures``.

The photographs are in ``../shared/data/pictures``, and may not be distributed. The table shows the errors of the
detected edges, and the stated standard deviation of the points divided by the observed scatter about a smooth line.

--draws 5         Search five times with random errors of the clamp (up to 4 px), the axis (4 degrees), the width (8 %)
                  and the length (10 %).
--clicks 3        Search three times with three clicks within 10 px of the centre line.
--overlay FOLDER  Draw the detected edges into pictures in a folder.
--chance DRAWS    Print the 95 % range of the ratio stated / observed deviation that chance alone causes, from DRAWS
                  simulated edges. A measured ratio in this range can be due to chance.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.edges.overlay import draw_overlay
from eimi_lab.vision.following.edge_points import estimate_scatter
from tests.shared.real_pictures import PICTURES, Picture, PictureScore, pictures

Array = NDArray[np.float64]
_DEGREE = 7  # degree of the polynomial about which the scatter of an edge is computed


def stated_over_observed(edge: EdgePoints) -> float:
    """Return the stated standard deviation of an edge's points, divided by their scatter about a smooth line.

    NaN for too few points.
    """
    if len(edge.points_mm) < 2 * _DEGREE:
        return math.nan
    return math.sqrt(float((edge.sigma_mm**2).mean())) / _Scatter(edge.points_mm).deviation


@dataclass(frozen=True)
class _Scatter:
    """The scatter of n points of an edge about a polynomial in the arc length.

    `points` contains x and y (mm or px), shape (n, 2).
    """

    points: Array

    @cached_property
    def along(self) -> Array:
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.points, axis=0).T))])

    @cached_property
    def line(self) -> Array:
        terms = np.polynomial.chebyshev.chebvander(2.0 * self.along / self.along[-1] - 1.0, _DEGREE)
        return np.asarray(terms @ np.linalg.lstsq(terms, self.points, rcond=None)[0])

    @cached_property
    def normal(self) -> Array:
        tangent = np.gradient(self.points, axis=0)
        return np.column_stack([tangent[:, 1], -tangent[:, 0]]) / np.hypot(*tangent.T)[:, None]

    @cached_property
    def across(self) -> Array:
        return np.asarray(((self.points - self.line) * self.normal).sum(axis=1))

    @property
    def deviation(self) -> float:
        return math.sqrt(float((self.across**2).sum()) / (len(self.points) - _DEGREE - 1))


def by_chance(points_px: Array, draws: int, rng: np.random.Generator) -> tuple[float, float, float]:
    # Return how much the standard deviation that the program states for the points of an edge varies by chance. Edges
    # with the scatter and the correlation of the given edge are simulated. Their true standard deviation is that of the
    # given edge.
    # points_px : ndarray, shape (n, 2)
    #     x and y of the n points of the edge, px.
    # draws : int
    #     Number of simulated edges.
    # rng : numpy Generator
    #     Random number generator.
    # Returns -------
    # low, high : float
    #     95 % range of the stated deviation divided by that of the simulated points.
    # median : float
    #     Median of the stated deviation divided by the true deviation.
    scatter = _Scatter(points_px)
    shared = float((scatter.across[1:] * scatter.across[:-1]).sum() / (scatter.across**2).sum())
    length = -scatter.along[-1] / (len(scatter.along) - 1) / math.log(min(max(shared, 0.01), 0.95))
    decay = np.exp(-np.abs(scatter.along[:, None] - scatter.along) / length)
    root = scatter.deviation * np.linalg.cholesky(decay + 1e-9 * np.eye(len(decay)))
    over_observed, over_true = [], []
    for _ in range(draws):
        drawn = scatter.line + (root @ rng.normal(size=len(root)))[:, None] * scatter.normal
        points, sigma, inliers = estimate_scatter(drawn, np.ones(len(drawn)))
        over_observed.append(stated_over_observed(EdgePoints(points[inliers], sigma[inliers])))
        over_true.append(float(np.median(sigma)) / scatter.deviation)
    low, high = np.percentile(over_observed, (2.5, 97.5))
    return float(low), float(high), float(np.median(over_true))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=0)
    parser.add_argument("--clicks", type=int, default=0, metavar="DRAWS")
    parser.add_argument("--chance", type=int, default=0, metavar="DRAWS")
    parser.add_argument("--overlay", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if not PICTURES.is_dir():
        print(f"{PICTURES} is not there: nothing to measure")
        return
    print("| picture | points | coverage | median px | 95 % px | stated over observed | s | flags |\n|" + " --- |" * 8)
    rng = np.random.default_rng(1)
    counts = {"good": 0, "thin": 0, "WRONG": 0, "refused": 0}
    for group in ("development",) if options.clicks else ("development", "refusal"):
        for picture in pictures(group):
            for draw in range(max(1, options.draws, options.clicks)):
                stated = picture.wrongly_stated(rng) if options.draws else (picture.calibration, picture.specimen)
                if options.clicks:
                    stated = picture.clicked(stated[0], rng), stated[1]
                begin = time.process_time()
                edges = picture.edges(stated)
                seconds = time.process_time() - begin
                _report(picture, edges, picture.score(edges, stated[0]), seconds, counts)
                for edge in (edges.left, edges.right) if options.chance and len(edges.left.points_mm) else ():
                    points_px = BeamFrame(stated[0]).to_px(edge.points_mm)
                    low, high, true = by_chance(points_px, options.chance, np.random.default_rng(2))
                    print(f"  by chance {low:.2f} to {high:.2f}; stated over true {true:.2f}", flush=True)
                if options.overlay:
                    options.overlay.mkdir(parents=True, exist_ok=True)
                    drawn = draw_overlay(picture.image, edges, stated[0])
                    cv2.imwrite(str(options.overlay / f"{picture.name}_{draw}.png"), drawn)
    print(counts)


def _report(picture: Picture, edges: EdgeSet, scored: PictureScore, seconds: float, counts: dict[str, int]) -> None:
    points = len(edges.left.points_mm), len(edges.right.points_mm)
    usable = bool(sum(points)) and all(flag.severity is not Severity.UNUSABLE for flag in edges.flags)
    kind = "refused" if not usable else "good" if scored.good else "WRONG" if scored.wrong else "thin"
    counts[kind] += 1
    flags = " ".join(dict.fromkeys(flag.name for flag in edges.flags)) or "none"
    ratios = ", ".join(f"{stated_over_observed(edge):.2f}" for edge in (edges.left, edges.right) if len(edge.points_mm))
    figures = f"{scored.coverage:.2f} | {scored.median:.2f} | {scored.p95:.2f} | {ratios} | {seconds:.2f}"
    print(f"| {picture.name} | {points[0]} + {points[1]} | {figures} | {flags} |", flush=True)


if __name__ == "__main__":
    main()
