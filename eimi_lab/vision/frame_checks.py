"""What the frames of one state say against one another: frames lost, repeated, not at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np

from eimi_drivers.interfaces import Frame
from eimi_lab.vision.check import Flag
from eimi_lab.vision.flags import judge
from eimi_lab.vision.settling_statistic import FEWEST_PIXELS, Noise, edge_band, measure_noise

CLEAR_OF_EDGES_PX = 12  # what is farther from every edge tells the noise, whether or not the beam moves


def frame_flags(frames: Sequence[Frame], noise: Noise) -> tuple[Flag, ...]:
    """Flags DROPPED and DUPLICATE: frames that are missing between neighbours, and neighbours that are the same.

    The same by number, or noise and all: two frames without noise (H, W) may be the same and both be new.
    """
    pairs = list(pairwise(frames))
    return judge(
        {
            "missing_frames": sum(max(0, later.number - earlier.number - 1) for earlier, later in pairs),
            "repeated_frames": sum(
                later.number <= earlier.number or (noise.seen and np.array_equal(earlier.image, later.image))
                for earlier, later in pairs
            ),
        }
    )


def state_flags(frames: Sequence[Frame], lossless: bool) -> tuple[Flag, ...]:
    """Flags DROPPED, DUPLICATE and NOT_SETTLED of one state's frames, of one size and colour, in the order taken.

    What an acquisition watches while it runs, asked of frames that exist already. The numbers of the frames may have
    any constant step. lossless: the files kept the camera's noise, which the comparison of frames needs; of compressed
    ones only losses and repetitions are told. One frame gives no flags.
    """
    if len(frames) < 2:
        return ()
    step = max(1, min(later.number - earlier.number for earlier, later in pairwise(frames)))
    numbered = [replace(frame, number=(frame.number - frames[0].number) // step) for frame in frames]
    images = [frame.image for frame in frames]
    if images[0].ndim == 3:  # one channel for all: that in which most is to be seen
        channel = int(np.argmax(images[0].std(axis=(0, 1))))
        images = [image[..., channel] for image in images]
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
    return flags + judge({"motion_ratio": ratio})
