"""Read photographs with edges traced by hand from ``../shared/data/pictures``, and compare detected edges with them."""

from __future__ import annotations

import importlib.util
import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.calibration import Picture as CalibrationPicture
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges

PICTURES = Path(__file__).parents[3] / "shared" / "data" / "pictures"
COVERAGE, MEDIAN_PX, P95_PX = 0.85, 1.5, 4.0
"""Smallest coverage, and largest median and 95 % quantile of the distance (px), of a good result."""


@dataclass(frozen=True)
class PictureScore:
    """The agreement of detected edges with edges that a person has traced.

    coverage : share of the traced edges with detected points nearby
    median, p95, rms : median, 95 % quantile and root mean square of the distances (px); NaN without points
    traced_px : standard uncertainty of the places of the traced edges
    """

    coverage: float
    median: float
    p95: float
    rms: float
    traced_px: float

    @property
    def good(self) -> bool:
        return self.coverage >= COVERAGE and self.median <= MEDIAN_PX and self.p95 <= P95_PX

    @property
    def wrong(self) -> bool:
        """Whether the detected points are far from the traced edges, or missing."""
        return not (self.median <= MEDIAN_PX and self.p95 <= P95_PX)

    def silent(self, edges: EdgeSet) -> bool:
        # Return whether edges are wrong although no warning was given. They are wrong if their root mean square
        # distance from the edges that a person traced exceeds three times the uncertainty of the traced edges.
        flagged = any(flag.severity is not Severity.NOTE for flag in edges.flags)
        return bool(len(edges.left.points_mm)) and not flagged and self.rms > 3.0 * self.traced_px


_NO_POINTS = PictureScore(0.0, math.nan, math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Picture:
    """A photograph with its calibration, its specimen file and its folder.

    beam : whether the picture shows a beam, with traced edges in the folder
    """

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
        """Return the calibration and the specimen file of a user who estimates by eye and with a ruler."""
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
        """Return the calibration with three clicks of a user along the beam, up to 10 px from its centre line."""
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
        """Return the agreement of edges with the traced edges, by the rules in the folder of the pictures."""
        reference = json.loads((self.folder / "reference.json").read_text())
        if not self.beam or not len(edges.left.points_mm):
            return _NO_POINTS
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
                rms = float(np.sqrt((apart**2).mean()))
                ways.append(
                    PictureScore(
                        covered / total,
                        float(np.median(apart)),
                        float(np.percentile(apart, 95)),
                        rms,
                        reference["uncertainty_px"],
                    )
                )
        return min(ways, key=lambda scored: scored.median, default=_NO_POINTS)


@cache
def pictures(group: str) -> tuple[Picture, ...]:
    """Return the pictures of the group ``development`` (with a beam) or ``refusal`` (without a beam)."""
    return tuple(_read(folder, group == "development") for folder in sorted((PICTURES / group).glob("*/")))


def _read(folder: Path, has_beam: bool) -> Picture:
    image = cv2.imread(str(folder / "frame.png"), cv2.IMREAD_UNCHANGED)
    if image.ndim == 3 and np.ptp(image, axis=2).max() == 0:
        image = image[..., 0]  # as a dataset stores it
    calibration = load_calibration(folder / "calibration.toml")
    specimen = load_specimen(folder / "specimen.toml")
    return Picture(folder.name, image, calibration, specimen, folder, has_beam)


def _foot() -> Any:
    spec = importlib.util.spec_from_file_location("score", PICTURES / "score.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.foot
