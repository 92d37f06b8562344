"""Draw the intermediate results of following a beam: the searched picture, the straightened picture and the edges."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.beam_search import Strip
from eimi_lab.vision.following.follow import FollowedBeam
from eimi_lab.vision.following.support import Sides
from eimi_lab.vision.following.unrolled import UnrolledPicture
from eimi_lab.vision.following.working import WorkingPicture

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

_ENLARGED = 4  # times
_SURE, _UNSURE, _STRIP = (0, 200, 0), (0, 0, 255), (0, 230, 255)
_MOST_STATIONS = 1500  # of the unrolled strip that are drawn
_SUB_PIXEL_BITS = 4


def draw_steps(followed: FollowedBeam) -> dict[str, Picture]:
    """Draw the intermediate results of following a beam, as far as they exist.

    Returns
    -------
    dict of str to ndarray of uint8
        ``"strip"``: the searched picture with the outline of the found beam, green where its edges are clear, red
        elsewhere.

        ``"unrolled"``: the straightened picture of the beam, and the weighted sums of the colours that show the left
        and the right edge. The edges are green where they are reliable, red elsewhere.
    """
    pictures: dict[str, Picture] = {}
    if followed.working is not None and followed.strip is not None:
        pictures["strip"] = _strip(followed.working, followed.strip)
    if followed.unrolled is not None and followed.sides is not None:
        pictures["unrolled"] = _unrolled(followed.unrolled, followed.sides)
    return pictures


def _strip(working: WorkingPicture, strip: Strip) -> Picture:
    picture = _enlarged(working.pixels)
    normal = np.column_stack([-np.sin(strip.angle), np.cos(strip.angle)])
    for side in (-0.5, 0.5):
        edge = (strip.place + side * strip.width[:, None] * normal + 0.5) * _ENLARGED - 0.5
        for begin, end, gain in zip(edge[:-1], edge[1:], strip.gain[1:], strict=True):
            green = int(255 * np.clip(gain, 0.0, 1.0))
            ends = np.rint(np.array([begin, end]) * 2**_SUB_PIXEL_BITS).astype(np.int32)
            cv2.polylines(picture, [ends], False, (0, green, 255 - green), 2, cv2.LINE_AA, _SUB_PIXEL_BITS)
    return picture


def _unrolled(unrolled: UnrolledPicture, sides: Sides) -> Picture:
    rows = slice(0, _MOST_STATIONS)
    panels = [_enlarged(unrolled.colours[rows])]
    panels += [_enlarged(255.0 * side.share[rows, :, None]) for side in sides.projected]
    step = float(unrolled.across[1] - unrolled.across[0])
    for panel in panels:
        for edge, sound in zip(sides.edge[:, rows], sides.sound[:, rows], strict=True):
            columns = np.rint(((edge - unrolled.across[0]) / step + 0.5) * _ENLARGED - 0.5).astype(int)
            for station, (column, is_sure) in enumerate(zip(columns.tolist(), sound.tolist(), strict=True)):
                place = (column, _ENLARGED * station + _ENLARGED // 2)
                cv2.circle(panel, place, 1, _SURE if is_sure else _UNSURE, -1)
    return np.asarray(np.hstack(panels), dtype=np.uint8)


def _enlarged(pixels: NDArray[np.floating]) -> Picture:
    shown = np.clip(np.rint(pixels), 0, 255).astype(np.uint8)
    shown = np.repeat(shown, 3, axis=2) if shown.shape[2] == 1 else shown
    large = cv2.resize(shown, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_NEAREST)
    return np.asarray(large, dtype=np.uint8)
