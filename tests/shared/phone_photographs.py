"""Simulate phone photographs of a horizontal beam with weights, and a person's values with the usual errors."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.ExifTags import IFD, Base

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws import LAWS

Array = NDArray[np.float64]
MESH = (26, 3, 1)  # the mesh of the virtual rig
GRAMS = (0.0, 0.5, 1.0, 2.0, 3.0)
DIAGONAL_35MM = 43.2666
FULL_SIZE = (4032, 3024)
RULER_MM = 50.0  # distance of the two ticks that a person clicks on the ruler
BEYOND_MM = 2.0  # the clamp is deeper than the beam by this length on each side
CLAMP_COLOUR = np.array([52.0, 50.0, 48.0])
_FINER = 4  # supersampling of the outlines
_DISTANT = 90.0  # smallest distance of the colours of beam and wall


@dataclass(frozen=True)
class PhoneScene:
    """The true properties of photographs. World axes, with the origin at the clamp: right, down, away from the camera.

    Attributes
    ----------
    modulus_Pa : float
        Initial shear modulus of the neo-Hookean solid.
    specimen : Specimen
        True dimensions.
    grams : tuple of float
        Weight in each photograph.
    size : tuple of int
        Width and height of the photographs (px).
    focal_px : float
        True focal length.
    stated_focal_mm : int
        Focal length in the Exif data, for 35 mm film.
    camera_mm : ndarray, shape (3,)
        Position of the pupil in the world frame.
    turned : ndarray, shape (3, 3)
        Rotation from the world frame to the camera frame.
    distortion : float
        First radial coefficient of the lens distortion.
    clamp_deg : float
        Downward angle of the clamped end.
    ruler_deg, ruler_z_mm : float
        Angle of the ruler to the horizontal, and its distance from the middle plane of the beam.
    seed : int
        Seed of colours and noise.
    """

    modulus_Pa: float
    specimen: Specimen
    grams: tuple[float, ...]
    size: tuple[int, int]
    focal_px: float
    stated_focal_mm: int
    camera_mm: Array
    turned: Array
    distortion: float
    clamp_deg: float
    ruler_deg: float
    ruler_z_mm: float
    seed: int

    def to_px(self, places_mm: Array) -> Array:
        """Project points of the world frame in mm, shape (..., 3), to pixels, shape (..., 2)."""
        in_camera = (places_mm - self.camera_mm) @ self.turned.T
        plane = in_camera[..., :2] / in_camera[..., 2:]
        plane = plane * (1.0 + self.distortion * (plane**2).sum(axis=-1, keepdims=True))
        return np.asarray(self.focal_px * plane + (np.array(self.size) - 1.0) / 2.0)

    def in_world(self, places_mm: Array) -> Array:
        """Convert points in mm, shape (..., 3), from the beam frame (y down) to the world frame."""
        angle = np.radians(self.clamp_deg)
        c, s = np.cos(angle), np.sin(angle)
        return places_mm @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def ruler(self, at_mm: Array) -> Array:
        """Return n points on the edge of the ruler in the world frame in mm, shape (n, 3).

        at_mm : distance of each point from the first tick, shape (n,)
        """
        angle, start = np.radians(self.ruler_deg), np.array([2.0, -0.55 * self.specimen.length_mm])
        line = start + np.asarray(at_mm)[:, None] * np.array([np.cos(angle), np.sin(angle)])
        return np.column_stack([line, np.full(len(line), self.ruler_z_mm)])


def drawn_scene(seed: int, share: float = 1.0) -> PhoneScene:
    """Choose a random scene in which the ticks of the ruler are inside the photographs.

    share : scale of the photographs (4032 x 3024 px)
    """
    rng = np.random.default_rng([seed, 32])
    length, width, depth = rng.uniform(30, 50), rng.uniform(3.0, 4.5), rng.uniform(4.0, 9.0)
    specimen = Specimen(length, width, depth, rng.uniform(1050.0, 1120.0), "solid")
    size = (round(FULL_SIZE[0] * share), round(FULL_SIZE[1] * share))
    equivalent = rng.choice([24.0, 26.0, 28.0, 52.0]) * (1.0 + 0.02 * rng.standard_normal())
    focal_px = equivalent / DIAGONAL_35MM * float(np.hypot(*size))
    far = max(150.0, rng.uniform(1.6, 2.6) * length * focal_px / size[0])  # the beam takes up about half of the width
    angles = np.radians(rng.normal(0.0, [1.0, 1.0, 1.0]))
    turned = cv2.Rodrigues(angles)[0]
    aim = np.array([rng.uniform(0.35, 0.65) * length, rng.uniform(0.1, 0.3) * length, 0.0])
    # A load of 3 g turns the tip of a beam of this modulus by about 45 degrees.
    stiffness = (3 * 9.81e-3 + 0.4 * length * width * depth * 1.08e-6 * 9.81) * length**2 / 2 / 0.9
    modulus = stiffness / (3.0 * depth * width**3 / 12.0) * 1e6 * rng.uniform(0.8, 1.4)
    scene = PhoneScene(
        modulus_Pa=modulus,
        specimen=specimen,
        grams=GRAMS,
        size=size,
        focal_px=focal_px,
        stated_focal_mm=round(equivalent * (1.0 + 0.01 * rng.standard_normal())),
        camera_mm=aim - turned.T @ np.array([0.0, 0.0, far]),
        turned=np.asarray(turned),
        distortion=0.01 * rng.standard_normal(),
        clamp_deg=0.4 * rng.standard_normal(),
        ruler_deg=0.4 * rng.standard_normal(),
        ruler_z_mm=1.0 * rng.standard_normal(),
        seed=seed,
    )
    while not _shows_ticks(scene):  # a person moves away from the beam until the picture shows all that is clicked
        far *= 1.05
        scene = replace(scene, camera_mm=aim - turned.T @ np.array([0.0, 0.0, far]))
    return scene


def _shows_ticks(scene: PhoneScene) -> bool:
    """Return whether the two clicked ticks of the ruler are inside the photographs."""
    ticks = scene.to_px(scene.ruler(np.array([0.0, RULER_MM])))
    return bool(((ticks >= 0.0) & (ticks <= np.array(scene.size) - 1.0)).all())


@dataclass(frozen=True)
class BentBody:
    """The surface of a bent beam, as several outlines of n points, one at each depth.

    around : points in mm in the world frame, shape (layers, n, 3), from the clamp around the tip and back
    """

    around: Array

    @property
    def tip(self) -> Array:
        """The midpoint of the tip in the world frame, mm, shape (3,)."""
        middle = self.around[len(self.around) // 2]
        return np.asarray(middle[len(middle) // 2])


def bent_bodies(scene: PhoneScene) -> list[BentBody]:
    """Return the surface of the bent beam under each weight of the scene."""
    beam = scene.specimen
    model = SolidBeside(beam, *MESH)
    loads = Loads.along(
        np.zeros(len(scene.grams)),
        gravity_angle_deg=90.0 - scene.clamp_deg,
        tip_force_N=9.80665e-3 * np.array(scene.grams),
    )
    shape = model.solve(LAWS["neo-hookean"], np.array([[scene.modulus_Pa]]), loads)
    if not shape.converged.all():
        raise ArithmeticError("a virtual beam has no equilibrium")
    along, half = np.linspace(0.0, beam.length_mm, 160), 0.5 * beam.width_mm
    across = np.linspace(-half, half, 9)
    side = np.concatenate(
        [
            np.column_stack([along, np.full(160, -half)]),
            np.column_stack([np.full(9, beam.length_mm), across])[1:-1],
            np.column_stack([along[::-1], np.full(160, half)]),
        ]
    )
    layers = []
    for z in np.linspace(-0.5, 0.5, 5) * beam.depth_mm:
        at = np.column_stack([side, np.full(len(side), z)])
        layers.append(model.positions(shape, at)[0])
    bodies = np.stack(layers, axis=1)  # (states, layers, n, 3)
    return [BentBody(scene.in_world(body)) for body in bodies]


def photograph(scene: PhoneScene, body: BentBody, grams: float, number: int) -> bytes:
    """Return one photograph as a JPEG file with Exif data; `number` is the seed of its noise."""
    rng = np.random.default_rng([scene.seed, 7])  # all photographs have the same wall, colours and clamp
    behind, beam = colours(rng)
    picture = wall(scene, behind, rng)
    dense = 3.2 * scene.size[0] / FULL_SIZE[0]
    shadow = np.zeros((scene.size[1], scene.size[0]), np.float32)
    moved = BentBody(body.around + np.array([2.0, 3.0, 4.0]))
    cover(shadow, silhouette(scene, moved), 1.0)
    shadow = cv2.GaussianBlur(shadow, (0, 0), 12 * dense)
    picture *= 1.0 - 0.22 * shadow[..., None]
    holder = BentBody(clamp(scene))
    paint(picture, silhouette(scene, holder), 0.8 * CLAMP_COLOUR)
    paint(picture, silhouette(scene, body), 0.86 * beam)
    paint(picture, [scene.to_px(body.around[0])], beam)
    if grams:
        _hang(scene, picture, body.tip, grams)
    paint(picture, [scene.to_px(holder.around[0])], CLAMP_COLOUR)  # the near face lies before the beam
    paint_ruler(scene, picture)
    picture = cv2.GaussianBlur(picture, (0, 0), 0.45 * dense)
    noise = np.random.default_rng([scene.seed, 9, number])
    picture += (1.2 + 0.08 * np.sqrt(picture)) * noise.standard_normal(picture.shape, dtype=np.float32)
    image = Image.fromarray(np.clip(np.rint(picture), 0, 255).astype(np.uint8)[..., ::-1])
    exif = Image.Exif()
    exif[Base.Make], exif[Base.Model] = "Example", "Phone"
    table = exif.get_ifd(IFD.Exif)
    table[Base.FocalLengthIn35mmFilm] = scene.stated_focal_mm
    table[Base.ExifImageWidth], table[Base.ExifImageHeight] = scene.size
    stored = io.BytesIO()
    image.save(stored, "JPEG", quality=92, exif=exif)
    return stored.getvalue()


def clicks(scene: PhoneScene, tip: Array, ruler_mm: float, rng: np.random.Generator, sigma_px: float) -> dict[str, Any]:
    """Return the points that a person clicks on the first photograph, with random errors, by key.

    tip : true midpoint of the tip in the world frame (mm), shape (3,)
    ruler_mm : distance between the two points on the ruler
    sigma_px : standard deviation of a click
    """
    ends = scene.ruler(np.array([0.0, ruler_mm]))
    nearer = BEYOND_MM if scene.camera_mm[0] < 0.0 else 0.0  # from the left, the near face of the clamp hides the line
    at_clamp = np.array([[0.0, 0.0, -0.5 * scene.specimen.depth_mm - nearer]])
    places = np.vstack([at_clamp, tip[None], ends])
    points = scene.to_px(places) + sigma_px * rng.standard_normal((4, 2))
    clamp, at_tip, first, second = points.round(1).tolist()
    return {"clamp_px": [clamp], "tip_px": at_tip, "ruler_px": [first, second], "ruler_mm": ruler_mm}


def measured_sizes(scene: PhoneScene, rng: np.random.Generator) -> dict[str, float]:
    """Return dimensions and density that a person measures, with random errors, by key."""
    beam = scene.specimen
    return {
        "length_mm": round(beam.length_mm + 0.2 * rng.standard_normal(), 1),
        "width_mm": round(beam.width_mm + 0.02 * rng.standard_normal(), 2),
        "depth_mm": round(beam.depth_mm + 0.03 * rng.standard_normal(), 2),
        "density_kg_m3": round(beam.density_kg_m3 + 10.0 * rng.standard_normal()),
    }


def clamp(scene: PhoneScene) -> Array:
    """Return the outlines of the near and the far face of the clamp in the world frame, mm, shape (2, 5, 3)."""
    half, z = 0.5 * scene.specimen.width_mm, 0.5 * scene.specimen.depth_mm + BEYOND_MM
    face = np.array([[0.0, -4 * half], [0.0, 4 * half], [-40.0, 4 * half], [-40.0, -4 * half], [0.0, -4 * half]])
    return scene.in_world(np.stack([np.column_stack([face, np.full(5, depth)]) for depth in (-z, z)]))


def colours(rng: np.random.Generator) -> tuple[Array, Array]:
    """Return clearly different random colours (blue, green, red) of wall and beam."""
    while True:
        wall, beam = rng.uniform(60.0, 215.0, 3), rng.uniform(60.0, 230.0, 3)
        if np.linalg.norm(wall - beam) > _DISTANT:
            return wall, beam


def wall(scene: PhoneScene, colour: Array, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a picture of the wall behind the beam, shape (height, width, 3), in uneven light."""
    width, height = scene.size
    lumps = rng.uniform(-12.0, 12.0, (6, 8, 3)).astype(np.float32)
    picture = cv2.resize(lumps, scene.size, interpolation=cv2.INTER_CUBIC)
    grain = rng.standard_normal((height // 4, width // 4)).astype(np.float32)
    picture += 5.0 * cv2.resize(grain, scene.size, interpolation=cv2.INTER_LINEAR)[..., None]
    return np.asarray(picture + colour.astype(np.float32), dtype=np.float32)


def silhouette(scene: PhoneScene, body: BentBody) -> list[Array]:
    """Return polygons that together cover the body in the picture, each with n corners in px, shape (n, 2)."""
    layers = scene.to_px(body.around)
    polygons = list(layers)
    for one, other in pairwise(layers):
        polygons += [
            np.array([a, b, d, c]) for a, b, c, d in zip(one[:-1], one[1:], other[:-1], other[1:], strict=True)
        ]
    return polygons


def cover(mask: NDArray[np.float32], polygons: list[Array], share: float) -> tuple[slice, slice]:
    """Write the covered share of each pixel times `share` into `mask`; return the changed rows and columns."""
    every = np.vstack(polygons)
    limit = np.array(mask.shape[::-1])
    first = np.clip(np.floor(every.min(axis=0)).astype(int) - 2, 0, limit)
    last = np.clip(np.ceil(every.max(axis=0)).astype(int) + 3, 0, limit)
    where = (slice(first[1], last[1]), slice(first[0], last[0]))
    wide, high = last - first
    if wide <= 0 or high <= 0:
        return where
    fine = np.zeros((high * _FINER, wide * _FINER), np.uint8)
    for polygon in polygons:
        at = (polygon - first + 0.5) * _FINER - 0.5
        cv2.fillPoly(fine, [np.rint(at * 256).astype(np.int32)], 255, shift=8)
    mask[where] = share / 255.0 * cv2.resize(fine, (int(wide), int(high)), interpolation=cv2.INTER_AREA)
    return where


def paint(picture: NDArray[np.float32], polygons: list[Array], colour: Array) -> None:
    mask = np.zeros(picture.shape[:2], np.float32)
    where = cover(mask, polygons, 1.0)
    picture[where] += mask[where][..., None] * (colour.astype(np.float32) - picture[where])


def _strip(scene: PhoneScene, start: Array, end: Array, half_mm: float) -> Array:
    """Return the corners (px), shape (4, 2), of a line of half-width `half_mm` between points of the world frame."""
    along = (end - start)[:2] / np.linalg.norm((end - start)[:2])
    aside = half_mm * np.array([-along[1], along[0], 0.0])
    return scene.to_px(np.array([start - aside, end - aside, end + aside, start + aside]))


def _hang(scene: PhoneScene, picture: NDArray[np.float32], tip: Array, grams: float) -> None:
    """Draw a weight of `grams` on a thread at the tip; change `picture` in place."""
    low = tip + np.array([0.0, 0.45 * scene.specimen.length_mm, 0.0])
    paint(picture, [_strip(scene, tip, low, 0.12)], np.array([30.0, 30.0, 30.0]))
    weight = 1.2 + grams
    paint(
        picture, [_strip(scene, low, low + np.array([0.0, weight, 0.0]), 0.6 * weight)], np.array([96.0, 150.0, 170.0])
    )


def paint_ruler(scene: PhoneScene, picture: NDArray[np.float32]) -> None:
    """Draw a ruler of 60 mm with ticks above the beam; change `picture` in place."""
    ends = scene.ruler(np.array([-3.0, 63.0]))
    up = np.array([0.0, -1.0, 0.0])
    body = np.array([ends[0], ends[1], ends[1] + 9 * up, ends[0] + 9 * up])
    paint(picture, [scene.to_px(body)], np.array([205.0, 225.0, 228.0]))
    ticks = scene.ruler(np.arange(0.0, 61.0))
    lines = [_strip(scene, tick, tick + (5.0 if k % 10 == 0 else 2.5) * up, 0.09) for k, tick in enumerate(ticks)]
    for line in lines:
        paint(picture, [line], np.array([35.0, 35.0, 35.0]))
