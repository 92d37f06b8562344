"""Render a picture for every flag, that is, for every warning that the edge search can give."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.simulated_optics import Optics
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.virtual.optics import expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Flag
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.flags import CHECKS
from eimi_lab.vision.frame_checks import state_flags
from eimi_lab.vision.intensity import state_mean
from tests.shared import photographs
from tests.shared.rendered_edges import CALIBRATION, NOMINAL, SIZE, SPECIMEN, BentBeam, bend, make_bent_scene

Image = NDArray[Any]
BEAM = bend(SPECIMEN, 30.0)
_DARK = 20


@dataclass(frozen=True)
class Case:
    """An image with a user's calibration and specimen.

    run_flags : flags from the comparison of several frames, of which `image` is the mean
    calibration_age_days : age of the calibration; None if unknown
    """

    image: Image
    calibration: Calibration = CALIBRATION
    specimen: SpecimenFile = SPECIMEN
    calibration_age_days: float | None = None
    run_flags: tuple[Flag, ...] = ()

    def edges(self) -> EdgeSet:
        edge_set = find_edges(
            self.image, self.calibration, self.specimen, calibration_age_days=self.calibration_age_days
        )
        return replace(edge_set, flags=self.run_flags + edge_set.flags)


def photograph(optics: Optics = NOMINAL, beam: BentBeam = BEAM) -> Image:
    """Return one rendered frame of `beam`."""
    return expose(make_bent_scene(optics, CALIBRATION, SPECIMEN, beam), np.random.default_rng(0))


def twisted(tip_deg: float, root_deg: float = 0.0) -> BentBeam:
    """Return the outline of a beam that is evenly twisted, from `root_deg` at the clamp to `tip_deg` at the tip."""
    width, depth = SPECIMEN.specimen.width_mm, SPECIMEN.specimen.depth_mm
    turn = np.radians(np.linspace(root_deg, tip_deg, len(BEAM.left)))
    wider = ((np.cos(turn) + depth / width * np.sin(turn) - 1.0) / 2.0)[:, None] * (BEAM.right - BEAM.left)
    return BentBeam(BEAM.left - wider, BEAM.right + wider, BEAM.magnet)


def _with(draw: Callable[[Image], Any]) -> Case:
    image = photograph().copy()
    draw(image)
    return Case(image)


def _dirt_on_the_left_edge(image: Image) -> None:
    for place in BeamFrame(CALIBRATION).to_px(BEAM.left[200:1300:140]).round().astype(int):
        cv2.circle(image, place.tolist(), 6, _DARK, -1)


def _reflection(image: Image) -> None:
    place = BeamFrame(CALIBRATION).to_px(0.5 * (BEAM.left + BEAM.right)[600:601])[0].round().astype(int)
    cv2.ellipse(image, place.tolist(), (12, 7), 0, 0, 360, 190, -1, cv2.LINE_AA)


def _without_clamp() -> Case:
    outline = BeamFrame(CALIBRATION).to_px(BEAM.outline)
    return Case(expose(make_scene(NOMINAL, SIZE, outline), np.random.default_rng(0)))


def _round_tip() -> Case:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 60)
    round_end = np.column_stack([28.5 + 1.5 * np.cos(angle), 1.5 * np.sin(angle)])
    frame = BeamFrame(CALIBRATION)
    outline = frame.to_px(np.vstack([[0.0, -1.5], round_end, [0.0, 1.5]]))
    clamp = frame.to_px([[0.0, -6.0], [0.0, 6.0], [-10.0, 6.0], [-10.0, -6.0]])
    return Case(expose(make_scene(NOMINAL, SIZE, outline, None, clamp), np.random.default_rng(0)))


def _photographed(half_hidden: bool = False, share: float = 1.0) -> Case:
    """Return a photograph of a coloured beam in front of cloth.

    half_hidden : whether a plate covers the lower half of the beam
    share : scale of the picture
    """
    colours = np.array([[40.0, 60.0, 200.0], [150.0, 160.0, 90.0]])
    image = photographs.photograph("uneven light", np.random.default_rng(5), 25.0, colours).image
    if half_hidden:
        image[230:] = (120, 130, 140)
    calibration = photographs.CALIBRATION
    x, y = (share * (value + 0.5) - 0.5 for value in calibration.clamp_midpoint_px)
    changes = {"clamp_midpoint_px": (x, y), "pixels_per_mm": calibration.pixels_per_mm * share}
    image = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    return Case(image, calibration.model_copy(update=changes), photographs.SPECIMEN)


def _on_its_shadow() -> Case:
    """Return a photograph of a coloured beam close to a wall, with a sharp shadow."""
    image = photographs.photograph("own shadow", np.random.default_rng([11, 22])).image
    return Case(image, photographs.CALIBRATION, photographs.SPECIMEN)


def _two_stripes() -> Case:
    """Return a picture of two stripes as wide as the beam, with the clamp midpoint of the calibration between them."""
    colours = {"left": (40.0, 60.0, 200.0), "right": (200.0, 170.0, 40.0)}
    calibration = photographs.CALIBRATION.model_copy(update={"pixels_per_mm": 3.0, "clamp_midpoint_px": (100.0, 20.0)})
    image = np.full((160, 200, 3), 120.0)
    image[20:110, 90:100], image[20:110, 101:111] = colours["left"], colours["right"]
    image = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(1).normal(0.0, 2.0, image.shape)
    return Case(np.clip(image, 0, 255).astype(np.uint8), calibration, photographs.SPECIMEN)


def _believed(**beam: float) -> Case:
    changed = SPECIMEN.specimen.model_copy(update=beam)
    return Case(photograph(), specimen=SpecimenFile(specimen=changed, magnet=SPECIMEN.magnet))


def _state(angles_deg: Sequence[float], numbers: Sequence[int], copied: bool = False) -> Case:
    """Return the mean of several frames at one current, and the flags (warnings) from their comparison.

    angles_deg, numbers : tip angle and number of each frame
    copied : whether the last frame is a copy
    """
    rng = np.random.default_rng(0)
    images = [
        expose(make_bent_scene(NOMINAL, CALIBRATION, SPECIMEN, bend(SPECIMEN, angle)), rng) for angle in angles_deg
    ]
    if copied:
        images[-1] = images[-2]
    frames = [Frame(image, number, 0.0) for image, number in zip(images, numbers, strict=True)]
    return Case(state_mean(images), run_flags=state_flags(frames, lossless=True))


CASES: dict[str, Callable[[], Case]] = {
    "SATURATED": lambda: Case(photograph(replace(NOMINAL, background=1.2))),
    "LOW_CONTRAST": lambda: Case(photograph(replace(NOMINAL, background=0.12))),
    "GAMMA": lambda: Case(photograph(replace(NOMINAL, gamma=2.2))),
    "DEFOCUS": lambda: Case(photograph(replace(NOMINAL, blur_px=4.0))),
    "EDGE_RESIDUAL": lambda: _with(_dirt_on_the_left_edge),
    "HOLE_OR_REFLECTION": lambda: _with(_reflection),
    "TOUCHES_FRAME": lambda: Case(photograph()[:700]),
    "MULTI_CONTOUR": lambda: _with(lambda image: cv2.circle(image, (950, 600), 40, _DARK, -1)),
    "CLAMP_NOT_FOUND": _without_clamp,
    "CORNER_AMBIGUOUS": _round_tip,
    "WIDTH_ANOMALY": lambda: _believed(width_mm=3.3),
    "LENGTH_ANOMALY": lambda: _believed(length_mm=34.0),
    "TOO_NARROW": lambda: _photographed(share=0.125),
    "NOT_FOLLOWED": lambda: _photographed(half_hidden=True),
    "OWN_SHADOW": _on_its_shadow,
    "ROOT_AMBIGUOUS": _two_stripes,
    "TWIST": lambda: Case(photograph(beam=twisted(2.0))),
    "CALIBRATION_STALE": lambda: Case(photograph(), calibration_age_days=400.0),
    "NOT_SETTLED": lambda: _state((29.8, 29.9, 30.0), (1, 2, 3)),
    "DROPPED": lambda: _state((30.0, 30.0, 30.0), (1, 2, 5)),
    "DUPLICATE": lambda: _state((30.0, 30.0, 30.0), (1, 2, 3), copied=True),
}


def table() -> str:
    """Return a Markdown table of all flags: measured quantity, limit, severity and contribution to the uncertainty."""
    rows = ["| flag | value | limit | severity | adds to σ at the limit |", "| --- | --- | --- | --- | --- |"]
    for check in CHECKS:
        below = "below " if check.below else ""
        graver = "" if check.unusable_beyond is None else f"; unusable {below or 'beyond '}{check.unusable_beyond:g}"
        unit = {"px": "px", "mm": "mm", "width": "of the width", "depth": "of the depth"}[check.widens_in]
        adds = f"{check.widens(check.limit):.2g} {unit}" if check.widens else ""
        rows.append(f"| {check.name} | {check.quantity} | {below}{check.limit:g} | {check.severity}{graver} | {adds} |")
    return "\n".join(rows)
