"""Check the points that a person clicked on the centre line of the beam."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.following.centre_line import CLICKED_PX, off_clamp
from eimi_lab.vision.following.in_picture import stated_beam

Array = NDArray[np.float64]

_LONGEST = 1.3  # of the stated length: the length is known to a tenth, and the clicks to ten pixels
_SHARPEST_DEG = 120.0  # turn of the line at a point


def check_clicked_points(calibration: Calibration, specimen: SpecimenFile, shape: tuple[int, ...]) -> None:
    """Check that the clicked points of a calibration lie in the picture and lead from the clamp to the tip.

    Parameters
    ----------
    calibration : Calibration
        The calibration, in pixels of the whole picture.
    specimen : SpecimenFile
        The specimen.
    shape : tuple of int
        Shape of the pictures: height, width and, in colour, number of channels.

    Raises
    ------
    InputError
        If a point lies outside the picture, if two points are the same, if the points are not in order, or if the line
        through them is much longer than the beam.
    """
    if calibration.picture is None or calibration.picture.along_px is None:
        return
    clicks = np.array(calibration.picture.along_px)
    stated = f"along_px = {[list(point) for point in calibration.picture.along_px]} (--along)"
    for number, (x, y) in enumerate(clicks.tolist(), start=1):
        if not (0 <= x < shape[1] and 0 <= y < shape[0]):
            raise InputError(
                f"{stated}: point {number}, [{x:g}, {y:g}], should lie in the pictures of {shape[1]} x {shape[0]} px"
            )
    beam = specimen.specimen
    stated_px = stated_beam(BeamFrame(calibration), beam.length_mm, beam.width_mm)
    line = off_clamp(stated_px.clamp_px, clicks)
    steps = np.diff(line, axis=0)
    lengths = np.hypot(*steps.T)
    if (lengths < 0.5).any():
        raise InputError(f"{stated}: two points are the same; click places that are farther apart")
    ahead = np.vstack([stated_px.ahead, steps[:-1] / lengths[:-1, None]])
    cosine = (ahead * steps).sum(axis=1) / lengths
    sharp = (cosine < np.cos(np.radians(_SHARPEST_DEG))) & (lengths > 2.0 * CLICKED_PX)
    if sharp.any():
        x, y = line[1 + int(sharp.argmax())]
        raise InputError(
            f"{stated}: the line turns back before the point [{x:g}, {y:g}]; give the points in the order from the "
            "clamp to the tip"
        )
    total, longest = float(lengths.sum()), _LONGEST * stated_px.length_px + CLICKED_PX
    if total > longest:
        raise InputError(
            f"{stated}: the line from the clamp through the points is {total:.0f} px long, and the beam is "
            f"{stated_px.length_px:.0f} px long; give points on the beam in the order from the clamp to the tip, or "
            "correct length_mm or pixels_per_mm"
        )
