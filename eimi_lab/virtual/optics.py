"""What a camera sees of a beam in front of a back-light: uneven light, blur, shot noise, quantisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.simulated_optics import Optics
from eimi_lab.virtual.raster import coverage

_LUMP_GRID = (9, 12)  # knots of the back-light's lumps over the height and the width of the frame


@dataclass(frozen=True)
class Scene:
    """A still scene: mean and standard deviation of each pixel's light, in grey levels, (height, width)."""

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    bits: int
    gamma: float = 1.0


def make_scene(
    optics: Optics,
    size: tuple[int, int],
    beam_px: ArrayLike,
    magnet_px: ArrayLike | None = None,
    clamp_px: ArrayLike | None = None,
    oversampling: int = 1,
) -> Scene:
    """The part of an image that does not change from frame to frame.

    size: (width, height). beam_px: (n, 2) outline of the whole beam, the magnet's block included; it may end
    at the clamp line or run on behind the clamp. magnet_px: outline of the magnet, inside the beam. clamp_px:
    outline of the clamp, in front of the beam. Raises ValueError where an outline is no polygon.

    oversampling: the blur is applied to an image so many times finer. At 1 the blur acts on pixels instead of
    before them, which displaces an edge along the pixel rows by up to 0.01 px at a blur of 1 px; at 2 by
    0.002 px, in four times the time.
    """

    def finer(outline_px: ArrayLike) -> NDArray[np.float64]:
        return (np.asarray(outline_px, dtype=np.float64) + 0.5) * oversampling - 0.5

    fine = (size[0] * oversampling, size[1] * oversampling)
    beam = coverage(finer(beam_px), fine).astype(np.float32)
    passed: NDArray[Any] = np.ones_like(beam)
    if clamp_px is not None:
        clamp = coverage(finer(clamp_px), fine).astype(np.float32)
        np.minimum(beam, 1 - clamp, out=beam)
        clamp *= 1.0 - optics.clamp_transmission
        passed -= clamp
    if magnet_px is not None:
        magnet = np.minimum(coverage(finer(magnet_px), fine).astype(np.float32), beam)
        magnet *= optics.silicone_transmission - optics.magnet_transmission
        passed -= magnet
    beam *= 1.0 - optics.silicone_transmission
    passed -= beam
    if optics.blur_px > 0.0:
        passed = cv2.GaussianBlur(passed, (0, 0), optics.blur_px * oversampling, borderType=cv2.BORDER_REPLICATE)
    if oversampling > 1:
        passed = cv2.resize(passed, size, interpolation=cv2.INTER_AREA)
    # The light varies so slowly that the blur may come first.
    light = np.maximum(passed, 0.0, out=passed)  # rounding leaves about -1e-8 where nothing passes
    light *= _illumination(optics, size)
    full_scale = 2**optics.bits - 1
    mean = light * np.float32(full_scale)
    # Electrons are counted: their variance is their number.
    deviation = np.sqrt(light) * np.float32(full_scale / np.sqrt(optics.full_well_e))
    return Scene(mean, deviation, optics.bits, optics.gamma)


def expose(scene: Scene, rng: np.random.Generator) -> NDArray[Any]:
    """One frame: shot noise (normal, which it is at hundreds of electrons), rounding, clipping at full scale.

    Returns (height, width), uint8 up to 8 bits and uint16 above.
    """
    frame = rng.standard_normal(scene.mean.shape, dtype=np.float32)
    frame *= scene.deviation
    frame += scene.mean
    if scene.gamma != 1.0:
        full_scale = np.float32(2**scene.bits - 1)
        frame = full_scale * np.maximum(frame / full_scale, 0.0) ** np.float32(1.0 / scene.gamma)
    frame += np.float32(0.5)
    np.clip(frame, 0.0, 2**scene.bits - 0.5, out=frame)
    return frame.astype(np.uint8 if scene.bits == 8 else np.uint16)


def render(
    optics: Optics,
    size: tuple[int, int],
    rng: np.random.Generator,
    beam_px: ArrayLike,
    magnet_px: ArrayLike | None = None,
    clamp_px: ArrayLike | None = None,
) -> NDArray[Any]:
    """One frame of one scene. For many frames of it, `make_scene` once and `expose` for each."""
    return expose(make_scene(optics, size, beam_px, magnet_px, clamp_px), rng)


@lru_cache(maxsize=4)
def _illumination(optics: Optics, size: tuple[int, int]) -> NDArray[np.float32]:
    """The back-light as the sensor meets it, (height, width), as a share of full scale."""
    width, height = size
    x = np.linspace(-1.0, 1.0, width)
    y = np.linspace(-1.0, 1.0, height)[:, None]
    light = 1.0 - 0.5 * optics.vignette * (x**2 + y**2)
    light = light * (1.0 - 0.25 * optics.gradient * (2.0 + x + y))
    if optics.lumps > 0.0:
        # A fixed pattern: the lumps belong to the back-light, not to the frame.
        knots = np.random.default_rng(0).uniform(-1.0, 1.0, _LUMP_GRID)
        light = light * (1.0 + optics.lumps * cv2.resize(knots, size, interpolation=cv2.INTER_CUBIC))
    return (optics.background / light.max() * light).astype(np.float32)
