"""Remove the reflections of a lamp from the searched picture."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from eimi_lab.vision.following.working import WorkingPicture

CLIPPED = 240.0  # of 255: blur, sharpening and JPEG compression lower a clipped value
_NARROW = 0.3  # widths of the beam: a broader bright body may be the beam
_BRIGHTER = 30.0  # of 255: least excess over the surroundings
_HALO = 0.12  # widths around a reflection that are replaced too


def remove_reflections(picture: WorkingPicture) -> WorkingPicture:
    """Replace saturated lines and spots that are narrower than a third of the beam by the colours around them."""
    pixels, width_px = picture.pixels, picture.beam.width_px
    clipped = (pixels >= CLIPPED).mean(axis=2) > 0.5
    if not clipped.any():
        return picture
    size = 2 * round(0.5 * _NARROW * width_px) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    # the opening removes bright spots that are narrower than the disc: a reflection would split the beam into two
    # bodies
    # grey-scale opening: J. Serra, Image Analysis and Mathematical Morphology, Academic Press 1982
    opened = cv2.morphologyEx(pixels, cv2.MORPH_OPEN, disc).reshape(pixels.shape)
    narrow = clipped & ((pixels - opened).max(axis=2) > _BRIGHTER)
    grown = 2 * max(1, round(_HALO * width_px)) + 1
    around = cv2.dilate(narrow.astype(np.uint8), np.ones((grown, grown), np.uint8)) > 0
    return replace(picture, pixels=np.where(around[..., None], opened, pixels).astype(np.float32))
