"""A lamp's reflections taken out of the picture in which a beam is looked for: they would split it into two."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from eimi_lab.vision.following.working import WorkingPicture

CLIPPED = 240.0  # of 255, after a lens, a sharpening and a JPEG
_NARROW = 0.3  # widths of the beam: what is broader may be the beam
_BRIGHTER = 30.0  # of 255, than what is beside it
_HALO = 0.12  # widths


def without_gleams(picture: WorkingPicture) -> WorkingPicture:
    """A picture in which clipped lines and spots, narrower than a third of the beam, are as what is beside them.

    By a grey opening, which takes out what is brighter than its neighbourhood and narrower than a disc (J. Serra, Image
    Analysis and Mathematical Morphology, 1982).
    """
    pixels, width_px = picture.pixels, picture.beam.width_px
    clipped = (pixels >= CLIPPED).mean(axis=2) > 0.5
    if not clipped.any():
        return picture
    size = 2 * round(0.5 * _NARROW * width_px) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    opened = cv2.morphologyEx(pixels, cv2.MORPH_OPEN, disc).reshape(pixels.shape)
    narrow = clipped & ((pixels - opened).max(axis=2) > _BRIGHTER)
    grown = 2 * max(1, round(_HALO * width_px)) + 1
    around = cv2.dilate(narrow.astype(np.uint8), np.ones((grown, grown), np.uint8)) > 0
    return replace(picture, pixels=np.where(around[..., None], opened, pixels).astype(np.float32))
