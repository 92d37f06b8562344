"""Render photographs of a bench with one difficulty each, and judge the edges that are detected in them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.edge_set import EdgeSet
from tests.shared.lab_difficulties import KINDS
from tests.shared.lab_scene import Scene, another_colour, cloth, through_jpeg
from tests.shared.photographs import CALIBRATION, SPECIMEN
from tests.shared.rendered_edges import bend, errors_px

Image = NDArray[Any]
WRONG = 0.07
"""Largest root-mean-square error of edges that count as good, as a share of the beam's width."""
_QUALITY = 85


def lab_photograph(name: str, rng: np.random.Generator) -> tuple[Image, Scene]:
    """Return a photograph, shape (height, width, 3), uint8, with the difficulty `name`, and its scene."""
    kind = KINDS[name]
    size = (round(960 * kind.size), round(720 * kind.size))
    share = kind.magnification / kind.size
    clamp = (size[0] * (0.5 + rng.uniform(-0.02, 0.02)), size[1] * (0.5 - 0.37 * min(share, 1.0)))
    changes = {"pixels_per_mm": 14.0 * kind.magnification, "clamp_midpoint_px": clamp}
    beam = bend(SPECIMEN, rng.uniform(-80.0, 80.0))
    behind = rng.uniform(25.0, 235.0, 3)
    calibration = CALIBRATION.model_copy(update=changes)
    scene = Scene(rng, size, calibration, SPECIMEN, beam, another_colour(rng, behind), behind)
    picture = cloth(scene)
    if kind.behind:
        picture = kind.behind(scene, picture)
    if kind.beam:
        scene.paint(picture, scene.outline(), scene.own)
        if kind.light:
            picture = kind.light(scene, picture)
    scene.paint(picture, scene.box((-1.5, 0.0), (-2.0, 2.0)), rng.uniform(30.0, 220.0))
    if kind.front:
        picture = kind.front(scene, picture)
    picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.6, 1.3))
    if kind.camera:
        picture = kind.camera(scene, picture)
    picture = picture + rng.standard_normal(picture.shape) * np.sqrt(np.maximum(picture, 0.0)) * 0.2
    return through_jpeg(picture, _QUALITY), scene


def stated(scene: Scene, rng: np.random.Generator) -> tuple[Calibration, SpecimenFile]:
    """Return the calibration and the specimen file of a user who estimates by eye and with a ruler."""
    beam = scene.specimen.specimen
    aside = rng.uniform(-0.08, 0.08, 2) * scene.width_px
    changes = {
        "clamp_midpoint_px": tuple((np.array(scene.calibration.clamp_midpoint_px) + aside).tolist()),
        "axis_angle_deg": scene.calibration.axis_angle_deg + rng.uniform(-3.0, 3.0),
    }
    size = {"width_mm": beam.width_mm * rng.uniform(0.94, 1.06), "length_mm": beam.length_mm * rng.uniform(0.93, 1.07)}
    specimen = scene.specimen.model_copy(update={"specimen": beam.model_copy(update=size)})
    return scene.calibration.model_copy(update=changes), specimen


def verdict(name: str, scene: Scene, edges: EdgeSet, calibration: Calibration) -> tuple[str, float]:
    """Return a verdict on detected edges, and their RMS error divided by the width of the beam (NaN without edges).

    refused  no edges, or a flag (warning) of the severity "unusable"
    good     an error of at most `WRONG`
    doubted  a larger error, and a flag of the severity "doubtful"
    silent   a larger error without such a flag
    """
    severities = {flag.severity for flag in edges.flags}
    if not len(edges.left.points_mm) or Severity.UNUSABLE in severities:
        return "refused", np.nan
    doubted = Severity.DOUBTFUL in severities
    if not KINDS[name].beam:
        return "doubted" if doubted else "silent", np.nan
    stated_frame, true_frame = BeamFrame(calibration), BeamFrame(scene.calibration)
    sides = [
        replace(side, points_mm=true_frame.to_mm(stated_frame.to_px(side.points_mm)))
        for side in (edges.left, edges.right)
    ]
    errors = np.concatenate(errors_px(replace(edges, left=sides[0], right=sides[1]), scene.beam, scene.calibration))
    error = float(np.sqrt((errors**2).mean())) / scene.width_px
    return ("good" if error <= WRONG else "doubted" if doubted else "silent"), error
