"""Render the image of a beam in front of a back-light, with uneven light, blur, shot noise and quantisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.simulated_optics import Optics
from eimi_lab.virtual.raster import coverage

_LUMP_GRID = (9, 12)  # numbers of random values over height and width, from which bright and dark patches are made


@dataclass(frozen=True)
class Scene:
    """The light at each pixel of a motionless scene, and its noise.

    Parameters
    ----------
    mean, deviation
        Mean of the light, and standard deviation of its shot noise, in grey levels, shape (height, width).
    bits
        Bit depth of the image.
    gamma
        The camera stores the relative light (1 at full scale) to the power 1/gamma. 1 for a linear camera.
    """

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
    """Return the scene of a motionless beam: mean and noise of the light at each pixel.

    Parameters
    ----------
    optics
        Back-light, lens and sensor.
    size
        Width and height of the frame, px.
    beam_px
        Outline of the whole beam including the magnet: x and y of n points, px, shape (n, 2).
    magnet_px
        Outline of the magnet: m points, px, shape (m, 2); None without a magnet.
    clamp_px
        Outline of the clamp, in front of the beam: c points, px, shape (c, 2); None without a clamp.
    oversampling
        Number of smaller pixels into which each pixel is divided, in each direction, to compute the blur.

    Raises
    ------
    ValueError
        An outline has fewer than three points, or a coordinate is not finite.
    """

    def finer(outline_px: ArrayLike) -> NDArray[np.float64]:
        return (np.asarray(outline_px, dtype=np.float64) + 0.5) * oversampling - 0.5

    fine = (size[0] * oversampling, size[1] * oversampling)
    beam = coverage(finer(beam_px), fine).astype(np.float32)
    transmitted: NDArray[Any] = np.ones_like(beam)
    if clamp_px is not None:
        clamp = coverage(finer(clamp_px), fine).astype(np.float32)
        np.minimum(beam, 1 - clamp, out=beam)
        clamp *= 1.0 - optics.clamp_transmission
        transmitted -= clamp
    if magnet_px is not None:
        magnet = np.minimum(coverage(finer(magnet_px), fine).astype(np.float32), beam)
        magnet *= optics.silicone_transmission - optics.magnet_transmission
        transmitted -= magnet
    beam *= 1.0 - optics.silicone_transmission
    transmitted -= beam
    if optics.blur_px > 0.0:
        transmitted = cv2.GaussianBlur(
            transmitted, (0, 0), optics.blur_px * oversampling, borderType=cv2.BORDER_REPLICATE
        )
    # For a blur of 1 px, oversampling = 1 displaces an edge along the pixel rows by up to 0.01 px. With the value 2,
    # the displacement is at most 0.002 px, and the computation takes four times as long.
    if oversampling > 1:
        transmitted = cv2.resize(transmitted, size, interpolation=cv2.INTER_AREA)
    # The blur is applied before the multiplication with the illumination, which varies slowly over the picture.
    light = np.maximum(transmitted, 0.0, out=transmitted)  # rounding gives about -1e-8 where no light is transmitted
    light *= _illumination(optics, size)
    full_scale = 2**optics.bits - 1
    mean = light * np.float32(full_scale)
    # Shot noise: the variance of the number of electrons is equal to the number.
    deviation = np.sqrt(light) * np.float32(full_scale / np.sqrt(optics.full_well_e))
    return Scene(mean, deviation, optics.bits, optics.gamma)


def expose(scene: Scene, rng: np.random.Generator) -> NDArray[Any]:
    """Return one frame of a scene, with shot noise, rounded to whole grey levels and clipped at full scale.

    Parameters
    ----------
    scene
        The scene.
    rng
        Random number generator.

    Returns
    -------
    numpy.ndarray
        The frame, shape (height, width), uint8 for 8 bits and uint16 for more bits.
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
    """Return one frame of a beam with noise, shape (height, width), uint8 for 8 bits and uint16 for more bits.

    Parameters
    ----------
    optics
        Back-light, lens and sensor.
    size
        Width and height of the frame, px.
    rng
        Random number generator of the noise.
    beam_px, magnet_px, clamp_px
        Outlines of the beam including the magnet, of the magnet and of the clamp, px, shape (n, 2). None if there is no
        magnet or no clamp.
    """
    return expose(make_scene(optics, size, beam_px, magnet_px, clamp_px), rng)


@lru_cache(maxsize=4)
def _illumination(optics: Optics, size: tuple[int, int]) -> NDArray[np.float32]:
    width, height = size
    x = np.linspace(-1.0, 1.0, width)
    y = np.linspace(-1.0, 1.0, height)[:, None]
    light = 1.0 - 0.5 * optics.vignette * (x**2 + y**2)
    light = light * (1.0 - 0.25 * optics.gradient * (2.0 + x + y))
    if optics.lumps > 0.0:
        # The pattern has a fixed seed, because the lumps belong to the back-light and not to the frame.
        knots = np.random.default_rng(0).uniform(-1.0, 1.0, _LUMP_GRID)
        light = light * (1.0 + optics.lumps * cv2.resize(knots, size, interpolation=cv2.INTER_CUBIC))
    return (optics.background / light.max() * light).astype(np.float32)
