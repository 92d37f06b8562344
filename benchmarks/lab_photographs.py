"""What photographs from benches have, one difficulty a picture: ``python -m benchmarks.lab_photographs``.

Rendered beams of known shape, random colour and bend, each with one thing that real pictures have: glare, a ruler
beside it, a second beam, a hand, a hard shadow, motion. ``--pictures N`` (6) of each kind, ``--seed``,
``--kind NAME`` (one or more), ``--draw FOLDER`` writes an overlay of each.

A picture is *good* (within 0.07 of the beam's width, root mean square, as the beams of `photographs` count), *doubted*
(worse, and a doubtful flag says so), *refused*, or *silent*: wrong without a flag, of which there is to be none. With
``lookalike`` there is no beam, and every picture that gives points without a doubt is silent.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.edges import BentBeam, bend, errors_px
from benchmarks.photographs import CALIBRATION, SPECIMEN
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.virtual.raster import coverage
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.edges.overlay import draw_overlay

Array = NDArray[np.float64]
Image = NDArray[Any]

WRONG = 0.07
"""Of the width: root mean square error beyond which points are of something else."""
_APART = 70.0  # of two colours that an eye clearly parts
_QUALITY = 85


@dataclass(frozen=True)
class Scene:
    """One bench. size: (width, height) px. beam: the true outline, of a beam as `specimen` and `calibration` state."""

    rng: np.random.Generator
    size: tuple[int, int]
    calibration: Calibration
    specimen: SpecimenFile
    beam: BentBeam
    own: Array
    behind: Array

    @property
    def width_px(self) -> float:
        return self.specimen.specimen.width_mm * self.calibration.pixels_per_mm

    def outline(self, along: tuple[float, float] = (0.0, 1.0), across: tuple[float, float] = (-0.5, 0.5)) -> Array:
        """(n, 2) px: a part of the beam from a share of its length to another, between places across it in widths."""
        count = len(self.beam.left)
        first, last = (int(np.clip(round(share * (count - 1)), 0, count - 1)) for share in along)
        left, right = self.beam.left[first : last + 1], self.beam.right[first : last + 1]
        one, other = (left + (place + 0.5) * (right - left) for place in across)
        return BeamFrame(self.calibration).to_px(np.vstack([one, other[::-1]]))

    def paint(self, picture: Array, polygon: Array, colour: Array | float, share: float = 1.0) -> None:
        """A polygon (n, 2) px of one colour, in place."""
        picture += share * coverage(polygon, self.size)[..., None] * (np.asarray(colour) - picture)

    def box(self, ahead: tuple[float, float], aside: tuple[float, float]) -> Array:
        """(4, 2) px: a rectangle in the beam's frame, in widths from the clamp and from the axis."""
        corners = [[a, b] for a, b in zip((*ahead, *ahead[::-1]), np.repeat(aside, 2), strict=True)]
        return BeamFrame(self.calibration).to_px(self.specimen.specimen.width_mm * np.array(corners))

    def other_colour(self) -> Array:
        """One that is neither the beam's nor what is behind it."""
        return _colour(self.rng, self.own, self.behind)


def _colour(rng: np.random.Generator, *others: Array) -> Array:
    while True:
        colour = rng.uniform(25.0, 235.0, 3)
        if all(np.linalg.norm(colour - other) > _APART for other in others):
            return colour


Hook = Callable[[Scene, Array], Array]


@dataclass(frozen=True)
class Kind:
    """What is painted behind the beam and in front of it, done to its light, and to the picture by lens and camera.

    size: of the picture, times 960 x 720. magnification: of the beam, times 42 px in width. beam: whether there is one.
    """

    behind: Hook | None = None
    light: Hook | None = None
    front: Hook | None = None
    camera: Hook | None = None
    size: float = 1.0
    magnification: float = 1.0
    beam: bool = True


def _parallel_beam(scene: Scene, picture: Array) -> Array:
    """Another beam of the same colour from the same clamp."""
    away = scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(1.4, 3.0)
    scene.paint(picture, scene.outline(across=(away - 0.5, away + 0.5)), scene.own)
    return picture


def _ruler(scene: Scene, picture: Array) -> Array:
    """A ruler along the clamp's axis, with a tick every half width."""
    side = scene.rng.choice([-1.0, 1.0])
    near = side * scene.rng.uniform(0.7, 1.6)
    scene.paint(picture, scene.box((-0.5, 12.0), (near, near + 1.5 * side)), np.full(3, 225.0))
    for tick in np.arange(0.0, 12.0, 0.5):
        scene.paint(picture, scene.box((tick, tick + 0.06), (near, near + 0.6 * side)), np.full(3, 30.0))
    return picture


def _squared_paper(scene: Scene, picture: Array) -> Array:
    """Lines as graph paper has them."""
    picture += 0.8 * (230.0 - picture)
    scene_line = scene.rng.uniform(40.0, 190.0, 3)
    step = scene.width_px * scene.rng.uniform(0.4, 1.2)
    for axis, extent in enumerate(scene.size):
        for at in np.arange(scene.rng.uniform(0.0, step), extent, step):
            index = (slice(None), int(at)) if axis == 0 else (int(at), slice(None))
            picture[index] = scene_line
    return picture


def _stripes(scene: Scene, picture: Array) -> Array:
    """Stripes along the clamp's axis, as wide as the beam or so."""
    wide = scene.rng.uniform(0.6, 1.6)
    colour = scene.other_colour()
    for at in np.arange(-14.0, 14.0, 2.0 * wide):
        scene.paint(picture, scene.box((-4.0, 20.0), (at, at + wide)), colour)
    return picture


def _hard_shadow(scene: Scene, picture: Array) -> Array:
    """Of a lamp like a point, on a wall close behind the beam."""
    shift = scene.rng.uniform(0.08, 0.35) * scene.width_px * np.array([scene.rng.choice([-1.0, 1.0]), 0.1])
    shadow = coverage(scene.outline() + shift, scene.size).astype(np.float32)
    picture *= (1.0 - scene.rng.uniform(0.25, 0.5) * cv2.GaussianBlur(shadow, (0, 0), 0.8))[..., None]
    return picture


def _writing_behind(scene: Scene, picture: Array) -> Array:
    grey = np.ascontiguousarray(np.zeros(picture.shape[:2], dtype=np.uint8))
    for row in range(20, scene.size[1], 40):
        cv2.putText(grey, "beam 7 B=4.7 mT  " * 4, (5, row), cv2.FONT_HERSHEY_SIMPLEX, 1.0, 255, 2, cv2.LINE_AA)
    return np.asarray(picture * (1.0 - 0.8 * grey[..., None] / 255.0))


def _same_clamp(scene: Scene, picture: Array) -> Array:
    """A clamp of the beam's own colour."""
    scene.paint(picture, scene.box((-4.0, 0.0), (-3.0, 3.0)), scene.own)
    return picture


def _glare(scene: Scene, picture: Array) -> Array:
    """A lamp's reflection along the beam."""
    at = scene.rng.uniform(-0.3, 0.3)
    shine = coverage(scene.outline((0.05, 0.9), (at - 0.06, at + 0.06)), scene.size).astype(np.float32)
    return np.asarray(picture + 220.0 * cv2.GaussianBlur(shine, (0, 0), 0.05 * scene.width_px)[..., None])


def _glare_at_edge(scene: Scene, picture: Array) -> Array:
    """A lamp's reflection on one of the edges over a third of the length."""
    at, begin = scene.rng.choice([-0.45, 0.45]), scene.rng.uniform(0.1, 0.6)
    shine = coverage(scene.outline((begin, begin + 0.33), (at - 0.06, at + 0.06)), scene.size).astype(np.float32)
    return np.asarray(picture + 220.0 * cv2.GaussianBlur(shine, (0, 0), 0.04 * scene.width_px)[..., None])


def _markers(scene: Scene, picture: Array) -> Array:
    """Dots for tracking along the middle."""
    colour = scene.other_colour()
    for place in np.arange(0.08, 0.95, 0.12):
        scene.paint(picture, scene.outline((place, place + 0.03), (-0.18, 0.18)), colour)
    return picture


def _bands(scene: Scene, picture: Array) -> Array:
    """Tape around the beam, over all of its width."""
    colour = scene.other_colour()
    for place in scene.rng.uniform(0.1, 0.9, 3):
        scene.paint(picture, scene.outline((place, place + 0.04)), colour)
    return picture


def _other_tip(scene: Scene, picture: Array) -> Array:
    """A magnet at the tip."""
    scene.paint(picture, scene.outline((0.85, 1.0)), scene.other_colour())
    return picture


def _two_faces(scene: Scene, picture: Array) -> Array:
    """The upper face beside the front one, lighter."""
    scene.paint(picture, scene.outline(across=(-0.5, -0.5 + scene.rng.uniform(0.15, 0.4))), scene.own * 0.5 + 127.0)
    return picture


def _round(scene: Scene, picture: Array) -> Array:
    """A round cord, dark toward both edges."""
    for depth in np.linspace(0.5, 0.35, 8):
        for side in (-1.0, 1.0):
            scene.paint(picture, scene.outline(across=(side * depth, side * (depth - 0.02))), 0.0, (depth - 0.3) * 2.0)
    return picture


def _fading(scene: Scene, picture: Array) -> Array:
    """A lamp at the clamp: the tip has half of the light."""
    inside = coverage(scene.outline(), scene.size)[..., None]
    x, y = np.meshgrid(*(np.arange(extent, dtype=np.float64) for extent in scene.size))
    away = np.hypot(x - scene.calibration.clamp_midpoint_px[0], y - scene.calibration.clamp_midpoint_px[1])
    return np.asarray(picture * (1.0 - 0.5 * inside * (away / away.max())[..., None]))


def _clear(scene: Scene, picture: Array) -> Array:
    """Silicone through which half of what is behind it is seen, with darker edges."""
    rest = _cloth(scene)
    inside = coverage(scene.outline(), scene.size)[..., None]
    picture += 0.5 * inside * (rest - picture)
    for side in (-1.0, 1.0):
        scene.paint(picture, scene.outline(across=(side * 0.5, side * 0.4)), 0.0, 0.35)
    return picture


def _hand(scene: Scene, picture: Array) -> Array:
    """Fingers that hold something near the beam, and cover a sixth of it."""
    share = scene.rng.uniform(0.2, 0.8)
    middle = scene.outline((share, share + 0.02)).mean(axis=0)
    turn = scene.rng.uniform(0.0, 2.0 * np.pi)
    far = middle + 6.0 * scene.width_px * np.array([np.cos(turn), np.sin(turn)])
    aside = 0.8 * scene.width_px * np.array([-np.sin(turn), np.cos(turn)])
    scene.paint(picture, np.array([middle + aside, far + 2 * aside, far - 2 * aside, middle - aside]), [120, 150, 205])
    return picture


def _thread(scene: Scene, picture: Array) -> Array:
    """Wires across the beam."""
    for share in scene.rng.uniform(0.15, 0.9, 3):
        middle = scene.outline((share, share + 0.02)).mean(axis=0)
        turn = scene.rng.uniform(0.0, np.pi)
        way = np.array([np.cos(turn), np.sin(turn)]) * 400.0
        thick = 0.05 * scene.width_px * np.array([-np.sin(turn), np.cos(turn)])
        scene.paint(
            picture, np.array([middle - way - thick, middle + way - thick, middle + way + thick, middle - way]), 20
        )
    return picture


def _motion(scene: Scene, picture: Array) -> Array:
    length = round(scene.width_px * scene.rng.uniform(0.1, 0.25))
    turn = scene.rng.uniform(0.0, np.pi)
    kernel = np.zeros((2 * length + 1, 2 * length + 1), dtype=np.float32)
    way = 0.5 * length * np.array([np.cos(turn), np.sin(turn)])
    ends = [tuple(np.rint(length + sign * way).astype(int).tolist()) for sign in (-1.0, 1.0)]
    cv2.line(kernel, ends[0], ends[1], 1.0)
    return np.asarray(cv2.filter2D(picture, -1, kernel / kernel.sum()))


def _vignette(scene: Scene, picture: Array) -> Array:
    x, y = np.meshgrid(*(np.linspace(-1.0, 1.0, extent) for extent in scene.size))
    return np.asarray(picture * (1.0 - 0.35 * (x**2 + y**2))[..., None])


def _grey(scene: Scene, picture: Array) -> Array:
    return np.repeat((picture @ np.array([0.114, 0.587, 0.299]))[..., None], 3, axis=2)


def _noisy(scene: Scene, picture: Array) -> Array:
    return np.asarray(picture + scene.rng.normal(0.0, 14.0, picture.shape))


def _dark(scene: Scene, picture: Array) -> Array:
    return picture * 0.15


def _overexposed(scene: Scene, picture: Array) -> Array:
    return picture * 1.6


def _soft(scene: Scene, picture: Array) -> Array:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.1 * scene.width_px))


def _jpeg_40(scene: Scene, picture: Array) -> Array:
    return _through_jpeg(picture, 40).astype(np.float64)


def _cut_off(scene: Scene, picture: Array) -> Array:
    """The picture ends amid the beam's way: what is beyond is black, as letter-boxed video has it."""
    tip = scene.outline((0.97, 1.0)).mean(axis=0)
    picture[int(tip[1]) :] = 0.0
    return picture


def _through_jpeg(picture: Array, quality: int) -> Image:
    image = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    return cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)


KINDS = {
    "plain": Kind(),
    "parallel beam": Kind(behind=_parallel_beam),
    "ruler beside": Kind(behind=_ruler),
    "squared paper": Kind(behind=_squared_paper),
    "stripes behind": Kind(behind=_stripes),
    "hard shadow": Kind(behind=_hard_shadow),
    "writing behind": Kind(behind=_writing_behind),
    "clamp of its colour": Kind(front=_same_clamp),
    "glare amid it": Kind(light=_glare),
    "glare at an edge": Kind(light=_glare_at_edge),
    "dots on it": Kind(light=_markers),
    "bands around it": Kind(light=_bands),
    "magnet at the tip": Kind(light=_other_tip),
    "two faces": Kind(light=_two_faces),
    "round cord": Kind(light=_round),
    "fading light": Kind(light=_fading),
    "clear silicone": Kind(light=_clear),
    "hand": Kind(front=_hand),
    "wires across": Kind(front=_thread),
    "motion": Kind(camera=_motion),
    "vignette": Kind(camera=_vignette),
    "monochrome": Kind(camera=_grey),
    "noisy": Kind(camera=_noisy),
    "dark": Kind(camera=_dark),
    "overexposed": Kind(camera=_overexposed),
    "out of focus": Kind(camera=_soft),
    "JPEG 40": Kind(camera=_jpeg_40),
    "tip at a border": Kind(camera=_cut_off),
    "7 px wide": Kind(magnification=7.0 / 42.0, size=0.5),
    "12 px wide": Kind(magnification=12.0 / 42.0),
    "150 px wide": Kind(magnification=150.0 / 42.0, size=3.0),
    "lookalike": Kind(behind=_ruler, beam=False),
    "lookalike, stripes": Kind(behind=_stripes, beam=False),
}


def lab_photograph(name: str, rng: np.random.Generator) -> tuple[Image, Scene]:
    """A picture (height, width, 3) uint8 of a kind of `KINDS`, and what is in it."""
    kind = KINDS[name]
    size = (round(960 * kind.size), round(720 * kind.size))
    share = kind.magnification / kind.size
    clamp = (size[0] * (0.5 + rng.uniform(-0.02, 0.02)), size[1] * (0.5 - 0.37 * min(share, 1.0)))
    changes = {"pixels_per_mm": 14.0 * kind.magnification, "clamp_midpoint_px": clamp}
    beam = bend(SPECIMEN, rng.uniform(-80.0, 80.0))
    behind = rng.uniform(25.0, 235.0, 3)
    calibration = CALIBRATION.model_copy(update=changes)
    scene = Scene(rng, size, calibration, SPECIMEN, beam, _colour(rng, behind), behind)
    picture = _cloth(scene)
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
    return _through_jpeg(picture, _QUALITY), scene


def _cloth(scene: Scene) -> Array:
    """What is behind: a colour in uneven light, with some grain."""
    rng = np.random.default_rng(int(1e3 * scene.behind.sum()))  # the same each time
    lumps = rng.uniform(-10.0, 10.0, (6, 8, 3)).astype(np.float32)
    grain = rng.standard_normal((scene.size[1], scene.size[0])).astype(np.float32)
    picture = cv2.resize(lumps, scene.size, interpolation=cv2.INTER_CUBIC).astype(np.float64)
    return np.asarray(picture + scene.behind + 8.0 * cv2.GaussianBlur(grain, (0, 0), 1.5)[..., None])


def stated(scene: Scene, rng: np.random.Generator) -> tuple[Calibration, SpecimenFile]:
    """Clamp, axis, width and length as an eye and a ruler have them."""
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
    """good, doubted, refused or silent; and the error, in widths."""
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", nargs="*", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--draw", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    print("| kind | good | doubted | refused | silent | median error px | ms | silent ones |\n|" + " --- |" * 8)
    for name in options.kind:
        counts: Counter[str] = Counter()
        errors, seconds, silent = [], [], []
        for number in range(options.pictures):
            rng = np.random.default_rng([options.seed, list(KINDS).index(name), number])
            image, scene = lab_photograph(name, rng)
            calibration, specimen = stated(scene, rng)
            begin = time.process_time()
            edges = find_edges(image, calibration, specimen)
            seconds.append(time.process_time() - begin)
            found, error = verdict(name, scene, edges, calibration)
            counts[found] += 1
            if found == "good":
                errors.append(error * scene.width_px)
            if found == "silent":
                silent.append(f"{number} ({error:.2f})")
            if options.draw:
                options.draw.mkdir(parents=True, exist_ok=True)
                drawn = draw_overlay(image, edges, calibration)
                cv2.imwrite(str(options.draw / f"{name.replace(' ', '_')}_{number}_{found}.jpg"), drawn)
        figures = " | ".join(str(counts[key]) for key in ("good", "doubted", "refused", "silent"))
        median = float(np.median(errors)) if errors else np.nan
        print(
            f"| {name} | {figures} | {median:.2f} | {1e3 * np.median(seconds):.0f} | {' '.join(silent)} |", flush=True
        )


if __name__ == "__main__":
    main()
