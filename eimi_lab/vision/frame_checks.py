"""Detect lost frames, repeated frames and motion in the frames of one state (load step)."""

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

CLEAR_OF_EDGES_PX = 12  # the noise is measured farther than this from every edge, where motion does not show


def frame_flags(frames: Sequence[Frame], noise: Noise) -> tuple[Flag, ...]:
    """Return the flags for missing frames (DROPPED) and repeated frames (DUPLICATE) of one load step.

    Parameters
    ----------
    frames : sequence of Frame
        Frames in the order in which they were taken, numbered by the camera.
    noise : Noise
        Noise of the camera. Equal frames count as repeated only if the noise exceeds the rounding of grey levels.

    Returns
    -------
    tuple of Flag
        Empty if no frame is missing or repeated.
    """
    pairs = list(pairwise(frames))
    return judge(
        {
            "missing_frames": sum(max(0, later.number - earlier.number - 1) for earlier, later in pairs),
            "repeated_frames": sum(
                later.number <= earlier.number
                or (noise.exceeds_rounding and np.array_equal(earlier.image, later.image))
                for earlier, later in pairs
            ),
        }
    )


def state_flags(frames: Sequence[Frame], lossless: bool) -> tuple[Flag, ...]:
    """Return the flags for missing frames, repeated frames and motion of one imported load step.

    Parameters
    ----------
    frames : sequence of Frame
        Frames of one size in the order in which they were taken. Their numbers may have any constant step.
    lossless : bool
        Whether the files keep the noise of the camera; motion is only detected in such files.

    Returns
    -------
    tuple of Flag
        Empty for fewer than two frames.
    """
    if len(frames) < 2:
        return ()
    # The smallest difference of the numbers is taken as the difference between neighbouring frames.
    step = max(1, min(later.number - earlier.number for earlier, later in pairwise(frames)))
    numbered = [replace(frame, number=(frame.number - frames[0].number) // step) for frame in frames]
    images = [frame.image for frame in frames]
    if images[0].ndim == 3:  # use the channel with the largest contrast in all images
        channel = int(np.argmax(images[0].std(axis=(0, 1))))
        images = [image[..., channel] for image in images]
    different = [images[0], *(later for earlier, later in pairwise(images) if not np.array_equal(earlier, later))]
    side = 2 * CLEAR_OF_EDGES_PX + 1
    edges = np.any([edge_band(image) for image in (images[0], images[-1])], axis=0)
    clear_of_edges = cv2.dilate(edges.astype(np.uint8), np.ones((side, side), np.uint8)) == 0
    if len(different) == 1 or clear_of_edges.sum() < FEWEST_PIXELS:
        return frame_flags(numbered, measure_noise(images))
    noise = measure_noise([image[clear_of_edges] for image in different])
    flags = frame_flags(numbered, noise)
    if not lossless or not noise.exceeds_rounding:
        return flags
    ratio = max(noise.difference_ratio(*pair) for pair in [*pairwise(different), (different[0], different[-1])])
    return flags + judge({"motion_ratio": ratio})
