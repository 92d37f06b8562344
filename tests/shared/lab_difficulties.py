"""Paint difficulties, such as glare or a hand, into pictures of a bench, shape (height, width, 3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.virtual.raster import coverage
from tests.shared.lab_scene import Scene, cloth, through_jpeg

Array = NDArray[np.float64]
Image = NDArray[Any]
Hook = Callable[[Scene, Array], Array]


@dataclass(frozen=True)
class Kind:
    """A kind of photograph: the functions that paint its glare, shadows, objects or noise, and its sizes.

    behind, front, light, camera : paint behind the beam, before it, on its surface, on the whole picture
    size : size of the picture relative to 960 x 720 px
    magnification : width of the beam relative to 42 px
    beam : whether the picture shows a beam
    """

    behind: Hook | None = None
    light: Hook | None = None
    front: Hook | None = None
    camera: Hook | None = None
    size: float = 1.0
    magnification: float = 1.0
    beam: bool = True


def _parallel_beam(scene: Scene, picture: Array) -> Array:
    """Paint another beam of the same colour that hangs from the same clamp."""
    away = scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(1.4, 3.0)
    scene.paint(picture, scene.outline(across=(away - 0.5, away + 0.5)), scene.own)
    return picture


def _ruler(scene: Scene, picture: Array) -> Array:
    """Paint a ruler along the axis of the clamp, with a tick at every half width of the beam."""
    side = scene.rng.choice([-1.0, 1.0])
    near = side * scene.rng.uniform(0.7, 1.6)
    scene.paint(picture, scene.box((-0.5, 12.0), (near, near + 1.5 * side)), np.full(3, 225.0))
    for tick in np.arange(0.0, 12.0, 0.5):
        scene.paint(picture, scene.box((tick, tick + 0.06), (near, near + 0.6 * side)), np.full(3, 30.0))
    return picture


def _squared_paper(scene: Scene, picture: Array) -> Array:
    """Paint the lines of graph paper."""
    picture += 0.8 * (230.0 - picture)
    scene_line = scene.rng.uniform(40.0, 190.0, 3)
    step = scene.width_px * scene.rng.uniform(0.4, 1.2)
    for axis, extent in enumerate(scene.size):
        for at in np.arange(scene.rng.uniform(0.0, step), extent, step):
            index = (slice(None), int(at)) if axis == 0 else (int(at), slice(None))
            picture[index] = scene_line
    return picture


def _stripes(scene: Scene, picture: Array) -> Array:
    """Paint stripes along the axis of the clamp, about as wide as the beam."""
    wide = scene.rng.uniform(0.6, 1.6)
    colour = scene.other_colour()
    for at in np.arange(-14.0, 14.0, 2.0 * wide):
        scene.paint(picture, scene.box((-4.0, 20.0), (at, at + wide)), colour)
    return picture


def _hard_shadow(scene: Scene, picture: Array) -> Array:
    """Paint the shadow of a point-like lamp on a wall close behind the beam."""
    shift = scene.rng.uniform(0.08, 0.35) * scene.width_px * np.array([scene.rng.choice([-1.0, 1.0]), 0.1])
    shadow = coverage(scene.outline() + shift, scene.size).astype(np.float32)
    picture *= (1.0 - scene.rng.uniform(0.25, 0.5) * cv2.GaussianBlur(shadow, (0, 0), 0.8))[..., None]
    return picture


def _two_lamps(scene: Scene, picture: Array) -> Array:
    """Paint soft shadows at both edges of the beam, as from two lamps."""
    for side in (-1.0, 1.0):
        shift = scene.width_px * np.array([side * scene.rng.uniform(0.07, 0.3), scene.rng.uniform(-0.05, 0.05)])
        shadow = coverage(scene.outline() + shift, scene.size).astype(np.float32)
        soft = cv2.GaussianBlur(shadow, (0, 0), scene.width_px * scene.rng.uniform(0.03, 0.12))
        picture *= (1.0 - scene.rng.uniform(0.15, 0.4) * soft)[..., None]
    return picture


def _leaning(scene: Scene, picture: Array) -> Array:
    """Paint the shadow of a beam whose distance from a wall grows toward the tip."""
    away = scene.width_px * scene.rng.uniform(0.2, 0.6) * scene.rng.choice([-1.0, 1.0])
    left, right = np.array_split(scene.outline(), 2)
    far = np.linspace(0.0, away, len(left))[:, None] * np.array([1.0, 0.1])
    shadow = coverage(np.vstack([left + far, right + far[::-1]]), scene.size).astype(np.float32)
    soft = cv2.GaussianBlur(shadow, (0, 0), scene.width_px * scene.rng.uniform(0.03, 0.12))
    return np.asarray(picture * (1.0 - scene.rng.uniform(0.25, 0.6) * soft)[..., None])


def _ruler_touching(scene: Scene, picture: Array) -> Array:
    """Paint a ruler that touches the beam."""
    side = scene.rng.choice([-1.0, 1.0])
    scene.paint(picture, scene.box((0.3, 12.0), (0.45 * side, 2.0 * side)), np.full(3, 225.0))
    for tick in np.arange(0.5, 12.0, 0.5):
        scene.paint(picture, scene.box((tick, tick + 0.06), (0.45 * side, 1.0 * side)), np.full(3, 30.0))
    return picture


def _writing_behind(scene: Scene, picture: Array) -> Array:
    grey = np.ascontiguousarray(np.zeros(picture.shape[:2], dtype=np.uint8))
    for row in range(20, scene.size[1], 40):
        cv2.putText(grey, "beam 7 B=4.7 mT  " * 4, (5, row), cv2.FONT_HERSHEY_SIMPLEX, 1.0, 255, 2, cv2.LINE_AA)
    return np.asarray(picture * (1.0 - 0.8 * grey[..., None] / 255.0))


def _same_clamp(scene: Scene, picture: Array) -> Array:
    """Paint a clamp that has the colour of the beam."""
    scene.paint(picture, scene.box((-4.0, 0.0), (-3.0, 3.0)), scene.own)
    return picture


def _glare(scene: Scene, picture: Array) -> Array:
    """Paint the reflection of a lamp along the beam."""
    at = scene.rng.uniform(-0.3, 0.3)
    shine = coverage(scene.outline((0.05, 0.9), (at - 0.06, at + 0.06)), scene.size).astype(np.float32)
    return np.asarray(picture + 220.0 * cv2.GaussianBlur(shine, (0, 0), 0.05 * scene.width_px)[..., None])


def _glare_at_edge(scene: Scene, picture: Array) -> Array:
    """Paint the reflection of a lamp on one edge of the beam."""
    at, begin = scene.rng.choice([-0.45, 0.45]), scene.rng.uniform(0.1, 0.6)
    shine = coverage(scene.outline((begin, begin + 0.33), (at - 0.06, at + 0.06)), scene.size).astype(np.float32)
    return np.asarray(picture + 220.0 * cv2.GaussianBlur(shine, (0, 0), 0.04 * scene.width_px)[..., None])


def _markers(scene: Scene, picture: Array) -> Array:
    """Paint tracking dots along the centre line of the beam."""
    colour = scene.other_colour()
    for place in np.arange(0.08, 0.95, 0.12):
        scene.paint(picture, scene.outline((place, place + 0.03), (-0.18, 0.18)), colour)
    return picture


def _bands(scene: Scene, picture: Array) -> Array:
    """Paint tape around the beam."""
    colour = scene.other_colour()
    for place in scene.rng.uniform(0.1, 0.9, 3):
        scene.paint(picture, scene.outline((place, place + 0.04)), colour)
    return picture


def _other_tip(scene: Scene, picture: Array) -> Array:
    """Paint a magnet at the tip of the beam, in a different colour."""
    scene.paint(picture, scene.outline((0.85, 1.0)), scene.other_colour())
    return picture


def _two_faces(scene: Scene, picture: Array) -> Array:
    """Paint the upper face of the beam beside its front face, in a lighter colour."""
    scene.paint(picture, scene.outline(across=(-0.5, -0.5 + scene.rng.uniform(0.15, 0.4))), scene.own * 0.5 + 127.0)
    return picture


def _round(scene: Scene, picture: Array) -> Array:
    """Shade the beam as a round cord."""
    for depth in np.linspace(0.5, 0.35, 8):
        for side in (-1.0, 1.0):
            scene.paint(picture, scene.outline(across=(side * depth, side * (depth - 0.02))), 0.0, (depth - 0.3) * 2.0)
    return picture


def _fading(scene: Scene, picture: Array) -> Array:
    """Darken the beam with the distance from the clamp, as with a lamp at the clamp."""
    inside = coverage(scene.outline(), scene.size)[..., None]
    x, y = np.meshgrid(*(np.arange(extent, dtype=np.float64) for extent in scene.size))
    away = np.hypot(x - scene.calibration.clamp_midpoint_px[0], y - scene.calibration.clamp_midpoint_px[1])
    return np.asarray(picture * (1.0 - 0.5 * inside * (away / away.max())[..., None]))


def _clear(scene: Scene, picture: Array) -> Array:
    """Make the beam transparent, with darker edges."""
    rest = cloth(scene)
    inside = coverage(scene.outline(), scene.size)[..., None]
    picture += 0.5 * inside * (rest - picture)
    for side in (-1.0, 1.0):
        scene.paint(picture, scene.outline(across=(side * 0.5, side * 0.4)), 0.0, 0.35)
    return picture


def _hand(scene: Scene, picture: Array) -> Array:
    """Paint fingers across a sixth of the beam."""
    share = scene.rng.uniform(0.2, 0.8)
    middle = scene.outline((share, share + 0.02)).mean(axis=0)
    turn = scene.rng.uniform(0.0, 2.0 * np.pi)
    far = middle + 6.0 * scene.width_px * np.array([np.cos(turn), np.sin(turn)])
    aside = 0.8 * scene.width_px * np.array([-np.sin(turn), np.cos(turn)])
    scene.paint(picture, np.array([middle + aside, far + 2 * aside, far - 2 * aside, middle - aside]), [120, 150, 205])
    return picture


def _thread(scene: Scene, picture: Array) -> Array:
    """Paint three thin wires across the beam."""
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
    return through_jpeg(picture, 40).astype(np.float64)


def _cut_off(scene: Scene, picture: Array) -> Array:
    """Blacken the picture below the tip of the beam."""
    tip = scene.outline((0.97, 1.0)).mean(axis=0)
    picture[int(tip[1]) :] = 0.0
    return picture


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
    "two lamps": Kind(behind=_two_lamps),
    "leaning off a wall": Kind(behind=_leaning),
    "ruler touching it": Kind(behind=_ruler_touching),
}
