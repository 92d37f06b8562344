"""Leave out bodies that cross the beam, such as a cable, in the straightened picture of the beam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_lab.vision.following.unrolled import UnrolledPicture

Mask = NDArray[np.bool_]

_WINDOW = 3.0  # widths along the beam, in which the usual colour at a distance from the middle line is the median
_SPACING = 3  # stations: the medians are computed at every third one
_DISTINCT = 40.0  # grey levels on a scale from 0 to 255, root of the summed squares of the channels
_CERTAIN = 6.0  # median deviations from the usual colour
_WIDEST = 0.8  # widths along the beam: a longer part of another colour belongs to the beam


def leave_out_crossings(unrolled: UnrolledPicture) -> UnrolledPicture:
    """Mark the points of the picture at which another body crosses the beam."""
    colours = unrolled.colours.astype(np.float64)
    stations = len(colours)
    window = max(3, round(_WINDOW * unrolled.stations_in_width / _SPACING))
    usual = scipy.ndimage.median_filter(colours[::_SPACING], size=(window, 1, 1), mode="nearest")
    usual = np.repeat(usual, _SPACING, axis=0)[:stations]
    deviation = np.linalg.norm(colours - usual, axis=2)
    limit = np.maximum(_DISTINCT, _CERTAIN * np.median(deviation, axis=0))
    bodies = scipy.ndimage.label(deviation > limit, np.ones((3, 3)))[0]
    # The colours of such a body occur inside and outside the beam, and would hide the difference between both sides,
    # also at some distance from the crossing.
    covered = np.zeros(bodies.shape, dtype=bool)
    for number in np.intersect1d(bodies[:, 0], bodies[:, -1]):
        body = bodies == number
        lengths = body.sum(axis=0)
        if number and lengths.min() > 0 and float(np.median(lengths)) < _WIDEST * unrolled.stations_in_width:
            covered |= body
    if not covered.any():
        return unrolled
    covered = scipy.ndimage.binary_dilation(covered, np.ones((3, 3)))
    return replace(unrolled, covered=covered, inside=unrolled.inside & ~covered)
