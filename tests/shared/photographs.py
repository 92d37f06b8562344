"""Render photographs of coloured beams with known outlines, and measure the errors of the detected edges."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import Beam, SpecimenFile
from eimi_lab.virtual.raster import coverage
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges
from tests.shared.rendered_edges import BentBeam, bend, errors_px

Array = NDArray[np.float64]
Image = NDArray[Any]
SIZE = (960, 720)
CALIBRATION = Calibration(
    pixels_per_mm=14.0,
    coil_constant_mT_per_A=4.7,
    clamp_midpoint_px=(480.3, 90.6),
    axis_angle_deg=90.0,
    gravity_angle_deg=90.0,
    field_angle_deg=0.0,
)
SPECIMEN = SpecimenFile(
    specimen=Beam(
        name="photograph",
        material="silicone",
        length_mm=30.0,
        width_mm=3.0,
        depth_mm=5.0,
        density_kg_m3=1070.0,
        section="plane-stress",
    )
)
KINDS = ("clutter", "uneven light", "JPEG 80", "shadow beside", "own shadow")
WRONG_PX = 3.0
"""Root-mean-square error (px) beyond which the detected points belong to another object than the beam."""


@dataclass(frozen=True)
class Photograph:
    """A rendered photograph with the true outline of its beam.

    kind : difficulty, one of `KINDS`
    image : shape (height, width, 3), uint8
    beam : true outline
    """

    kind: str
    image: Image
    beam: BentBeam


def photograph(
    kind: str, rng: np.random.Generator, angle_deg: float | None = None, colours: Array | None = None
) -> Photograph:
    """Return a rendered photograph of a kind of `KINDS`.

    angle_deg : tip angle of the beam; None for a random one
    colours : of beam and background (blue, green, red), shape (2, 3); None for random ones
    """
    beam = bend(SPECIMEN, rng.uniform(-90.0, 90.0) if angle_deg is None else angle_deg)
    frame = BeamFrame(CALIBRATION)
    outline = frame.to_px(beam.outline)
    colour, behind = colours if colours is not None else _two_colours(rng)
    picture = _background(behind, colour, rng, 14 if kind == "clutter" else 4)
    if kind in ("shadow beside", "own shadow"):
        far = (22.0, 34.0) if kind == "shadow beside" else (4.0, 12.0)
        shift = rng.uniform(*far) * np.array([rng.choice([-1.0, 1.0]), rng.uniform(-0.3, 0.3)])
        shadow = cv2.GaussianBlur(coverage(outline + shift, SIZE).astype(np.float32), (0, 0), rng.uniform(2.0, 5.0))
        picture *= (1.0 - rng.uniform(0.2, 0.5) * shadow)[..., None]
    inside = coverage(outline, SIZE)[..., None]
    picture += inside * (colour * _shading(beam, frame, rng)[..., None] - picture)
    plate = frame.to_px([[0.0, -6.0], [0.0, 6.0], [-5.0, 6.0], [-5.0, -6.0]])
    picture += coverage(plate, SIZE)[..., None] * (rng.uniform(30.0, 220.0) - picture)
    if kind == "uneven light":
        picture *= _light(rng)[..., None]
    picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.7, 1.4))
    picture += rng.standard_normal(picture.shape) * np.sqrt(np.maximum(picture, 0.0)) * 0.16
    image = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    if kind in ("JPEG 80", "clutter"):
        image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])[1], cv2.IMREAD_COLOR)
    return Photograph(kind, image, beam)


def _two_colours(rng: np.random.Generator) -> Array:
    """Return clearly different random colours of beam and background, shape (2, 3)."""
    while True:
        colours = rng.uniform(25.0, 235.0, (2, 3))
        if np.linalg.norm(colours[0] - colours[1]) > 70.0:
            return colours


def _background(colour: Array, other: Array, rng: np.random.Generator, things: int) -> Array:
    """Return a picture (height, width, 3) of cloth with at most `things` rectangles, none of the colour `other`."""
    knots = rng.uniform(-12.0, 12.0, (9, 12, 3)).astype(np.float32)
    picture = colour + cv2.resize(knots, SIZE, interpolation=cv2.INTER_CUBIC)
    picture += (
        cv2.GaussianBlur(rng.standard_normal((SIZE[1], SIZE[0])).astype(np.float32), (0, 0), 1.5)[..., None] * 12.0
    )
    for _ in range(things):
        beam_colour = _two_colours(rng)[0]
        if np.linalg.norm(beam_colour - other) < 70.0:
            continue
        middle, half = rng.uniform([0, 0], SIZE), rng.uniform(8.0, 120.0, 2)
        turn = rng.uniform(0.0, np.pi)
        way = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        box = middle + (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half) @ way
        picture += coverage(box, SIZE)[..., None] * (beam_colour - picture)
    return picture


def _shading(beam: BentBeam, frame: BeamFrame, rng: np.random.Generator) -> Array:
    """Return the relative light on the beam, shape (height, width), which changes linearly by up to 10 %."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    direction = rng.uniform(-0.1, 0.1, 2)
    return 1.0 + direction[0] * (x / SIZE[0] - 0.5) * 2.0 + direction[1] * (y / SIZE[1] - 0.5) * 2.0


def _light(rng: np.random.Generator) -> Array:
    """Return the relative light of a lamp at one side, shape (height, width), with random variations."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, SIZE[0]), np.linspace(-1.0, 1.0, SIZE[1]))
    turn = rng.uniform(0.0, 2.0 * np.pi)
    knots = rng.uniform(-0.12, 0.12, (5, 7)).astype(np.float32)
    light = 0.85 + 0.3 * (np.cos(turn) * x + np.sin(turn) * y) / np.sqrt(2.0)
    return np.asarray(light + cv2.resize(knots, SIZE, interpolation=cv2.INTER_CUBIC))


@dataclass(frozen=True)
class Outcome:
    """The quality of the edges in one photograph.

    rms_px : root-mean-square error; NaN for unusable edges
    pull : RMS error divided by the standard uncertainties; NaN for unusable edges
    coverage : share of the length that the shorter edge covers
    usable : whether a fit uses the edges
    doubtful : whether a flag (warning) calls the edges doubtful
    """

    kind: str
    rms_px: float
    pull: float
    coverage: float
    usable: bool
    doubtful: bool
    seconds: float


def measured(photo: Photograph, edges: EdgeSet, seconds: float) -> Outcome:
    """Return the quality of the detected edges of a photograph.

    seconds : processor time of the edge search
    """
    usable = len(edges.left.points_mm) > 0 and all(flag.severity is not Severity.UNUSABLE for flag in edges.flags)
    errors = np.concatenate(errors_px(edges, photo.beam, CALIBRATION)) if usable else np.array([np.nan])
    sigma = np.concatenate([edges.left.sigma_mm, edges.right.sigma_mm]) * CALIBRATION.pixels_per_mm
    rms = float(np.sqrt((errors**2).mean()))
    pull = float(np.sqrt(((errors / sigma) ** 2).mean())) if usable else np.nan
    long = [np.ptp(edge.points_mm, axis=0) for edge in (edges.left, edges.right)] if usable else [np.zeros(2)]
    share = min(float(np.hypot(*span)) for span in long) / SPECIMEN.specimen.length_mm
    doubtful = any(flag.severity is Severity.DOUBTFUL for flag in edges.flags)
    return Outcome(photo.kind, rms, pull, share, usable, doubtful, seconds)


def run(pictures: int, seed: int, kinds: Sequence[str] = KINDS) -> list[Outcome]:
    """Render photographs of the kinds in turn, search their edges, and return the quality of each."""
    outcomes = []
    for number in range(pictures):
        photo = photograph(kinds[number % len(kinds)], np.random.default_rng([seed, number]))
        begin = time.process_time()
        edges = find_edges(photo.image, CALIBRATION, SPECIMEN)
        outcomes.append(measured(photo, edges, time.process_time() - begin))
    return outcomes
