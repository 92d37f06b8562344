"""A rendered picture for every flag, to show what it means: ``python -m eimi_lab.vision.flag_cases FILE.jpg``.

NOT_SETTLED, DROPPED and DUPLICATE speak of several frames of a state: their picture is the frames' mean, as in a run.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.state_checks import state_flags
from eimi_lab.virtual.optics import Optics, expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.benchmark import CALIBRATION, NOMINAL, SIZE, SPECIMEN, BentBeam, bend, make_bent_scene
from eimi_lab.vision.edge_set import EdgeSet, Flag
from eimi_lab.vision.edges import find_edges
from eimi_lab.vision.intensity import state_mean
from eimi_lab.vision.overlay import contact_sheet, draw_overlay

Image = NDArray[Any]

BEAM = bend(SPECIMEN, 30.0)
_DARK = 20
_SHEET_PX = (520, 440)


@dataclass(frozen=True)
class Case:
    """An image and what a person believes of it; `edges` is what the search says.

    run_flags: what several frames, of which the image is the mean, said against one another.
    """

    image: Image
    calibration: Calibration = CALIBRATION
    specimen: SpecimenFile = SPECIMEN
    calibration_age_days: float | None = None
    run_flags: tuple[Flag, ...] = ()

    def edges(self) -> EdgeSet:
        found = find_edges(self.image, self.calibration, self.specimen, calibration_age_days=self.calibration_age_days)
        return replace(found, flags=self.run_flags + found.flags)


def photograph(optics: Optics = NOMINAL, beam: BentBeam = BEAM) -> Image:
    """One frame of the benchmark's beam."""
    return expose(make_bent_scene(optics, CALIBRATION, SPECIMEN, beam), np.random.default_rng(0))


def twisted(tip_deg: float, root_deg: float = 0.0) -> BentBeam:
    """The beam turned about its own axis, evenly from the root to the tip: the outline of a box so turned."""
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


def _believed(**beam: float) -> Case:
    changed = SPECIMEN.specimen.model_copy(update=beam)
    return Case(photograph(), specimen=SpecimenFile(specimen=changed, magnet=SPECIMEN.magnet))


def _state(angles_deg: Sequence[float], numbers: Sequence[int], copied: bool = False) -> Case:
    """Frames of one state: the beam's angle and the camera's number in each; copied: the last is the one before."""
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
    "TWIST": lambda: Case(photograph(beam=twisted(2.0))),
    "CALIBRATION_STALE": lambda: Case(photograph(), calibration_age_days=400.0),
    "NOT_SETTLED": lambda: _state((29.8, 29.9, 30.0), (1, 2, 3)),
    "DROPPED": lambda: _state((30.0, 30.0, 30.0), (1, 2, 5)),
    "DUPLICATE": lambda: _state((30.0, 30.0, 30.0), (1, 2, 3), copied=True),
}


def main() -> None:
    cases = [(name, make()) for name, make in CASES.items()]
    pictures = [draw_overlay(case.image, case.edges(), case.calibration) for _, case in cases]
    sheet = contact_sheet(pictures, [name for name, _ in cases], _SHEET_PX)
    cv2.imwrite(sys.argv[1], sheet, [cv2.IMWRITE_JPEG_QUALITY, 60])


if __name__ == "__main__":
    main()
