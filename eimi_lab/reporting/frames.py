"""Cut the images of a dataset to the region of the beam, and choose load steps to show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.config.calibration import Calibration
from eimi_lab.dataset.state import State
from eimi_lab.reporting.contents import DatasetContents
from eimi_lab.vision.beam_frame import BeamFrame

Array = NDArray[np.float64]

_MARGIN = 0.06  # around the region that the beam reaches, as a fraction of the beam's length


@dataclass(frozen=True)
class Crop:
    """A rectangle of the images, in pixels, that contains the beam at every load step."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def height_over_width(self) -> float:
        """The height of the crop divided by its width."""
        return (self.bottom - self.top) / (self.right - self.left)

    def of(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return the part of an image in the rectangle, with brightness from 0 to 1.

        The result of H by W pixels has the shape (H, W) if it is grey, or (H, W, 3) if it has three colours.
        """
        cut = image[self.top : self.bottom, self.left : self.right]
        scaled = cut / (np.iinfo(cut.dtype).max if cut.dtype.kind in "ui" and cut.dtype.itemsize > 1 else 255)
        if cut.dtype.itemsize > 1:  # cameras of 10 or 12 bits leave most of the range unused
            scaled = scaled / max(float(scaled.max()), 1e-9)
        return np.asarray(np.clip(scaled[..., ::-1] if cut.ndim == 3 else scaled, 0, 1))

    def places(self, points_px: Array) -> Array:
        """Convert n points, shape (n, 2), from pixels (x, y) of the image to pixels of this rectangle."""
        return np.asarray(points_px - [self.left, self.top])


def frame_of(contents: DatasetContents) -> BeamFrame:
    """Return the conversion from positions on the beam (mm) to pixels. Raises ValueError for tracked points."""
    return BeamFrame(_calibration_of(contents))


def crop_of(contents: DatasetContents) -> Crop:
    """Return the rectangle around the measured edges of all load steps; the whole image if no edges were measured."""
    (height, width, *_), _ = contents.dataset.frame_format()
    frame = frame_of(contents)
    edges_mm = [edge.points_mm for pair in contents.dataset.edges() or () for edge in (pair.left, pair.right)]
    points = np.concatenate([np.zeros((0, 2)), *(frame.to_px(edge) for edge in edges_mm if len(edge))])
    if not len(points):
        return Crop(0, 0, width, height)
    margin = max(10.0, _MARGIN * contents.dataset.specimen.specimen.length_mm * _calibration_of(contents).pixels_per_mm)
    left, top = np.maximum(points.min(axis=0) - margin, 0).astype(int)
    right, bottom = np.minimum(points.max(axis=0) + margin, [width, height]).astype(int)
    return Crop(int(left), int(top), int(right), int(bottom))


def measured_mm(contents: DatasetContents, k: int) -> list[Array]:
    """Return the measured left and right edge; `k` is the index among the load steps of the fit.

    Each edge is an array of n points (x along the straight beam, y across; mm), shape (n, 2).
    """
    observed = contents.evidence.experiment.observed
    if not isinstance(observed, EdgeObservation):
        raise ValueError("a dataset of tracked points contains no edges")
    return [observed.points_mm[k, side][np.isfinite(observed.sigma_mm[k, side])] for side in range(2)]


def edges_px(contents: DatasetContents, state: State) -> list[Array]:
    """Return the left and the right edge of the beam at a load step: n points (x, y) in pixels, shape (n, 2).

    The edges are simulated with the best fit or, without a simulation, measured.
    """
    frame, indices = frame_of(contents), [used.index for used in contents.evidence.states]
    if contents.best is not None and state.index in indices:
        return [frame.to_px(side) for side in contents.best.edges_mm[indices.index(state.index)]]
    edges = contents.dataset.edges()
    sides = (edges[state.index].left, edges[state.index].right) if edges else ()
    return [frame.to_px(side.points_mm) for side in sides if len(side.points_mm)]


def some_states(contents: DatasetContents, most: int) -> list[int]:
    """Return the indices of at most `most` load steps, evenly spaced from the smallest to the largest load."""
    order = np.argsort(loads(contents), kind="stable")
    rows = np.unique(np.linspace(0, len(order) - 1, min(most, len(order))).round().astype(int))
    return [int(order[row]) for row in rows]


def loads(contents: DatasetContents) -> Array:
    """Return a number for the size of the load at each of K load steps, shape (K,).

    The number is |field| / (largest |field|) + |tip force| / (largest |tip force|).
    """
    field_and_force = np.abs([(s.field_mT, s.tip_force_N) for s in contents.evidence.states])
    return np.asarray((field_and_force / np.maximum(field_and_force.max(axis=0), 1e-12)).sum(axis=1))


def load_words(state: State) -> str:
    """Return a load as text, such as `7.05 mT`; with a force at the tip, such as `7.05 mT, 2 mN`."""
    force = f"{1e3 * state.tip_force_N:.3g} mN" if state.tip_force_N else ""
    field = f"{state.field_mT:.3g} mT" if state.field_mT or not force else ""
    return ", ".join(word for word in (field, force) if word)


def _calibration_of(contents: DatasetContents) -> Calibration:
    calibration: Calibration | None = contents.dataset.calibration
    if calibration is None:
        raise ValueError("tracked points have no frames")
    return calibration
