"""Find points of the beam in every frame of a film, which is a video or a recording of a run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.edges.region import region_of
from eimi_lab.vision.projection import Projection, choose_projection
from eimi_lab.vision.tracking.beam_tracker import BeamTracker, SeenBeam

Array = NDArray[np.float64]

FIRST_TRIES = 200  # number of frames at the beginning of a film in which the beam has to be found
_SEARCH_EVERY = 5  # frames between two searches of a whole frame; one search takes as long as ten frames with a tracker
_SMOOTH = 6  # terms of a polynomial that describes a swinging beam with an error below the noise of the points
_LEAST_SIGMA_MM = 1e-4
_NORMAL_MEDIAN = 1.4826  # ratio of the standard deviation of a normal distribution to the median of its absolute values


class NoBeam(InputError):
    """The error that is raised if no beam is found in a film near the clamp position in the calibration."""


@dataclass(frozen=True)
class Film:
    """Positions of p points along the beam in the n frames of a film; NaN for a point that was not found in a frame.

    Parameters
    ----------
    along_mm : ndarray, shape (p,)
        Distances of the points from the clamp along the beam.
    middle_px, left_px, right_px : ndarray, shape (n, p, 2)
        The points on the centre line, on the left edge and on the right edge.
    """

    along_mm: Array
    middle_px: Array
    left_px: Array
    right_px: Array

    def sigma_mm(self, middle_mm: Array) -> Array:
        """Return the standard deviation of the measurement noise of each of the p points, across the beam, mm.

        The noise is the distance from a smooth curve through all points of a frame (a polynomial of degree 5).

        Parameters
        ----------
        middle_mm : ndarray, shape (n, p, 2)
            Points of the centre line, mm (x along the straight beam from the clamp, y across).

        Returns
        -------
        ndarray, shape (p,)
            The standard deviations; none is smaller than a fixed smallest value.
        """
        complete = np.isfinite(middle_mm[..., 1]).all(axis=1)
        if not complete.any():
            return np.full(len(self.along_mm), _LEAST_SIGMA_MM)
        terms = np.vander(self.along_mm / self.along_mm[-1], _SMOOTH)
        across = middle_mm[complete, :, 1].T
        fitted = terms @ np.linalg.lstsq(terms, across, rcond=None)[0]
        deviations = across - fitted
        deviations -= np.median(deviations, axis=1, keepdims=True)
        freedom = len(self.along_mm) / (len(self.along_mm) - _SMOOTH)
        sigma = _NORMAL_MEDIAN * np.median(np.abs(deviations), axis=1) * np.sqrt(freedom)
        return np.asarray(np.maximum(sigma, _LEAST_SIGMA_MM))


def follow_film(
    images: Iterable[NDArray[Any]],
    calibration: Calibration,
    specimen: SpecimenFile,
    origin: str,
    projection: Projection | None = None,
    tracker: BeamTracker | None = None,
) -> Film:
    """Find the beam in every frame of a film, which is a video or a recording of a run.

    Parameters
    ----------
    images : iterable of ndarray, shape (H, W) or (H, W, 3)
        The frames.
    calibration, specimen
        Calibration of the camera, and the specimen.
    origin : str
        Name of the film in messages.
    projection : Projection, optional
        Conversion of colours to grey values; by default it is chosen in the first frame.
    tracker : BeamTracker, optional
        An object that follows the beam, and already knows its position in some frame.

    Raises
    ------
    NoBeam
        If no beam is found in the first frames.
    """
    length_mm = specimen.specimen.length_mm
    beams: list[SeenBeam | None] = []
    missed = 0
    for image in images:
        if image.ndim == 3 and projection is None:
            projection = choose_projection([image], calibration, specimen.specimen.width_mm, length_mm)
        beam = tracker.follow(image) if tracker else None
        if beam is None or not beam.is_seen:
            if missed % _SEARCH_EVERY == 0:
                restarted = tracker_from(image, calibration, specimen, projection)
                tracker = restarted or tracker
                beam = restarted.follow(image) if restarted else None
            missed += 1
        else:
            missed = 0
        beams.append(beam)
        if tracker is None and len(beams) >= FIRST_TRIES:
            break
    if tracker is None:
        raise NoBeam(
            f"{origin}: no beam was found in the first {len(beams)} frames; check clamp_midpoint_px, axis_angle_deg "
            "and pixels_per_mm of the calibration, and --polarity, --channel or --beam-colour"
        )
    missing = np.full((len(tracker.along_mm), 2), np.nan)
    middle, left, right = (
        np.stack([missing if beam is None else getattr(beam, name) for beam in beams])
        for name in ("middle_px", "left_px", "right_px")
    )
    return Film(tracker.along_mm, middle, left, right)


def tracker_from(
    image: NDArray[Any], calibration: Calibration, specimen: SpecimenFile, projection: Projection | None
) -> BeamTracker | None:
    """Return an object that follows the beam, starting from its position in `image`; None if no beam is found.

    `image` has the shape (H, W) or (H, W, 3). `projection` converts colours into grey values.
    """
    edges = _edges(image, calibration, specimen, projection)
    if not len(edges.middle_mm) or np.hypot(*edges.middle_mm.T).max() < 0.5 * specimen.specimen.length_mm:
        return None
    try:
        return BeamTracker(image, edges, BeamFrame(calibration), specimen.specimen.length_mm, projection)
    except ValueError:  # the edges belong to another body
        return None


def _edges(
    image: NDArray[Any], calibration: Calibration, specimen: SpecimenFile, projection: Projection | None
) -> EdgeSet:
    region = region_of(calibration, image.shape)
    if region is None:
        return find_edges(image, calibration, specimen, projection=projection)
    return region.in_picture(find_edges(region.cut(image), region.calibration, specimen, projection=projection))
