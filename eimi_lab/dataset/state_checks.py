"""What an acquisition watches while it runs, asked of frames that exist already: lost, repeated, not at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np

from eimi_drivers.interfaces import Frame
from eimi_lab.acquisition.capture import frame_flags
from eimi_lab.acquisition.settling import FEWEST_PIXELS, edge_band, measure_noise
from eimi_lab.dataset.grey import grey
from eimi_lab.vision.edge_set import Flag

NOISE_RATIO = 1.2  # of frames at rest it is 1; a twentieth of a pixel of motion gives 1.06, a fifth 2.3
CLEAR_OF_EDGES_PX = 12  # what is farther from every edge tells the noise, whether or not the beam moves
_REMEDY = "Take the frames of a state after the beam has come to rest, and shield it from draught and vibration."


def state_flags(frames: Sequence[Frame], lossless: bool) -> tuple[Flag, ...]:
    """Flags DROPPED, DUPLICATE and NOT_SETTLED of one state's frames (H, W), of one size, in the order taken.

    The numbers of the frames may have any constant step. lossless: the files kept the camera's noise, which the
    comparison of frames needs; of compressed ones only losses and repetitions are told. One frame gives no flags.
    """
    if len(frames) < 2:
        return ()
    step = max(1, min(later.number - earlier.number for earlier, later in pairwise(frames)))
    numbered = [replace(frame, number=(frame.number - frames[0].number) // step) for frame in frames]
    images = [grey(frame.image) for frame in frames]
    different = [images[0], *(later for earlier, later in pairwise(images) if not np.array_equal(earlier, later))]
    side = 2 * CLEAR_OF_EDGES_PX + 1
    edges = np.any([edge_band(image) for image in (images[0], images[-1])], axis=0)
    still = cv2.dilate(edges.astype(np.uint8), np.ones((side, side), np.uint8)) == 0
    if len(different) == 1 or still.sum() < FEWEST_PIXELS:
        return frame_flags(numbered, measure_noise(images))
    noise = measure_noise([image[still] for image in different])
    flags = frame_flags(numbered, noise)
    if not lossless or not noise.seen:
        return flags
    ratio = max(noise.difference_ratio(*pair) for pair in [*pairwise(different), (different[0], different[-1])])
    return (*flags, Flag("NOT_SETTLED", ratio, NOISE_RATIO, _REMEDY)) if ratio > NOISE_RATIO else flags
