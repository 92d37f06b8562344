"""Photographs that other people made, with traced edges, and the score of edges against them.

The pictures and the rules for scoring them are in ``../shared/data/pictures``, beside the checkout; they may not be
distributed.
"""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.calibration import Picture as CalibrationPicture
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges

PICTURES = Path(__file__).parents[3] / "shared" / "data" / "pictures"
COVERAGE, MEDIAN_PX, P95_PX = 0.85, 1.5, 4.0
"""What a good result has at least and at most."""


@dataclass(frozen=True)
class PictureScore:
    """The score of edges against traced ones.

    coverage: share of the traced edges that has points; median, p95: distance from them in px, NaN without points.
    """

    coverage: float
    median: float
    p95: float

    @property
    def good(self) -> bool:
        return self.coverage >= COVERAGE and self.median <= MEDIAN_PX and self.p95 <= P95_PX

    @property
    def wrong(self) -> bool:
        """Whether the points that were found are far from the traced edges, however few they are."""
        return not (self.median <= MEDIAN_PX and self.p95 <= P95_PX)


@dataclass(frozen=True)
class Picture:
    """A photograph with the values that an optimistic user states, and the folder with the traced edges, if any."""

    name: str
    image: NDArray[Any]
    calibration: Calibration
    specimen: SpecimenFile
    folder: Path
    beam: bool

    def edges(self, stated: tuple[Calibration, SpecimenFile] | None = None) -> EdgeSet:
        calibration, specimen = stated or (self.calibration, self.specimen)
        return find_edges(self.image, calibration, specimen)

    def wrongly_stated(self, rng: np.random.Generator) -> tuple[Calibration, SpecimenFile]:
        """Return clamp, axis, width and length with the errors of estimates by eye and ruler."""
        clamp = np.array(self.calibration.clamp_midpoint_px) + rng.uniform(-4.0, 4.0, 2)
        turn = rng.uniform(-4.0, 4.0)
        beam = self.specimen.specimen
        size = {
            "width_mm": beam.width_mm * rng.uniform(0.92, 1.08),
            "length_mm": beam.length_mm * rng.uniform(0.9, 1.1),
        }
        changes = {
            "clamp_midpoint_px": tuple(clamp.tolist()),
            "axis_angle_deg": self.calibration.axis_angle_deg + turn,
        }
        calibration = self.calibration.model_copy(update=changes)
        return calibration, self.specimen.model_copy(update={"specimen": beam.model_copy(update=size)})

    def clicked(self, calibration: Calibration, rng: np.random.Generator) -> Calibration:
        """Return a calibration with three clicks: at random places along the beam, up to 10 px from its centre line."""
        reference = json.loads((self.folder / "reference.json").read_text())
        left, right = (np.array(reference[side]) for side in ("side_a", "side_b"))
        middle = 0.5 * (left + right[np.linalg.norm(left[:, None] - right, axis=2).argmin(axis=1)])
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(middle, axis=0).T))])
        at = np.sort(rng.uniform(0.15, 1.0, 3)) * arc[-1]
        places = np.column_stack([np.interp(at, arc, middle[:, axis]) for axis in (0, 1)])
        aside, direction = 10.0 * np.sqrt(rng.uniform(size=3)), rng.uniform(0.0, 2.0 * np.pi, 3)
        places += aside[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
        places = np.clip(places, 0.0, np.array(self.image.shape[1::-1]) - 1.0)
        clicks = tuple((float(x), float(y)) for x, y in places)
        help_given = (calibration.picture or CalibrationPicture()).model_copy(update={"along_px": clicks})
        return calibration.model_copy(update={"picture": help_given})

    def score(self, edges: EdgeSet, calibration: Calibration) -> PictureScore:
        """Score edges by the rules that come with the pictures; either side may be the left one."""
        reference = json.loads((self.folder / "reference.json").read_text())
        if not self.beam or not len(edges.left.points_mm):
            return PictureScore(0.0, math.nan, math.nan)
        foot = _foot()
        frame = BeamFrame(calibration)
        edges_px = [frame.to_px(edge.points_mm) for edge in (edges.left, edges.right)]
        lines = [np.array(reference[side]) for side in ("side_a", "side_b")]
        near = max(3.0 * reference["uncertainty_px"], 0.15 * reference["width_px"])
        reach = max(reference["width_px"] / 4.0, reference["length_px"] / 50.0)
        ways = []
        for sides in (edges_px, edges_px[::-1]):
            distances, covered, total = [], 0, 0
            for points, line in zip(sides, lines, strict=True):
                length = float(np.hypot(*np.diff(line, axis=0).T).sum())
                stations = np.arange(0.0, length, max(reference["width_px"] / 8.0, 1.0))
                distance, along, beyond = foot(points, line)
                distances.append(distance[~beyond])
                at = along[distance <= near]
                total += len(stations)
                covered += int((np.abs(stations[:, None] - at).min(axis=1, initial=np.inf) <= reach).sum())
            apart = np.concatenate(distances)
            if len(apart):
                ways.append(PictureScore(covered / total, float(np.median(apart)), float(np.percentile(apart, 95))))
        return min(ways, key=lambda scored: scored.median, default=PictureScore(0.0, math.nan, math.nan))


def pictures(group: str) -> Iterator[Picture]:
    """Yield the pictures of a group, ``development`` or ``refusal``; none if the folder is missing."""
    for folder in sorted((PICTURES / group).glob("*/")):
        image = cv2.imread(str(folder / "frame.png"), cv2.IMREAD_UNCHANGED)
        if image.ndim == 3 and np.ptp(image, axis=2).max() == 0:
            image = image[..., 0]  # as a dataset stores it
        calibration = load_calibration(folder / "calibration.toml")
        specimen = load_specimen(folder / "specimen.toml")
        yield Picture(folder.name, image, calibration, specimen, folder, group == "development")


def _foot() -> Any:
    spec = importlib.util.spec_from_file_location("score", PICTURES / "score.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.foot
