"""Frames of a dataset, cut to where the beam goes."""

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

_MARGIN = 0.06  # of the beam's length in the picture, around all that it reaches


@dataclass(frozen=True)
class Crop:
    """The part of the frames that the beam reaches in any state: left, top, right, bottom in pixels."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def height_over_width(self) -> float:
        return (self.bottom - self.top) / (self.right - self.left)

    def of(self, image: NDArray[Any]) -> NDArray[Any]:
        """The crop of an image as matplotlib shows it: grey from 0 to 1, or red, green and blue."""
        cut = image[self.top : self.bottom, self.left : self.right]
        scaled = cut / (np.iinfo(cut.dtype).max if cut.dtype.kind in "ui" and cut.dtype.itemsize > 1 else 255)
        if cut.dtype.itemsize > 1:  # cameras of 10 or 12 bits leave most of the range unused
            scaled = scaled / max(float(scaled.max()), 1e-9)
        return np.asarray(np.clip(scaled[..., ::-1] if cut.ndim == 3 else scaled, 0, 1))

    def places(self, points_px: Array) -> Array:
        """Pixels of the frame (n, 2) as pixels of the crop."""
        return np.asarray(points_px - [self.left, self.top])


def frame_of(contents: DatasetContents) -> BeamFrame:
    """The map to pixels. Raises ValueError for a dataset of tracked points."""
    calibration: Calibration | None = contents.dataset.calibration
    if calibration is None:
        raise ValueError("tracked points have no frames")
    return BeamFrame(calibration)


def crop_of(contents: DatasetContents) -> Crop:
    """Around all measured edges; the whole frame where none was found."""
    (height, width, *_), _ = contents.dataset.frame_format()
    frame = frame_of(contents)
    every = [edge.points_mm for found in contents.dataset.edges() or () for edge in (found.left, found.right)]
    points = np.concatenate([np.zeros((0, 2)), *(frame.to_px(p) for p in every if len(p))])
    if not len(points):
        return Crop(0, 0, width, height)
    margin = max(10.0, _MARGIN * contents.dataset.specimen.specimen.length_mm * _pixels_per_mm(contents))
    left, top = np.maximum(points.min(axis=0) - margin, 0).astype(int)
    right, bottom = np.minimum(points.max(axis=0) + margin, [width, height]).astype(int)
    return Crop(int(left), int(top), int(right), int(bottom))


def measured_mm(contents: DatasetContents, k: int) -> list[Array]:
    """The measured left and right edge of the evidence's state k, those points that count."""
    observed = contents.evidence.experiment.observed
    if not isinstance(observed, EdgeObservation):
        raise ValueError("tracked points have no edges")
    return [observed.points_mm[k, side][np.isfinite(observed.sigma_mm[k, side])] for side in range(2)]


def edges_px(contents: DatasetContents, state: State) -> list[Array]:
    """Both edges of a state in pixels: simulated by the leading fit, or else as measured; none where there are none."""
    frame, numbers = frame_of(contents), [own.index for own in contents.evidence.states]
    if contents.best is not None and state.index in numbers:
        return [frame.to_px(side) for side in contents.best.edges_mm[numbers.index(state.index)]]
    found = contents.dataset.edges()
    sides = (found[state.index].left, found[state.index].right) if found else ()
    return [frame.to_px(side.points_mm) for side in sides if len(side.points_mm)]


def some_states(contents: DatasetContents, most: int) -> list[int]:
    """Of the evidence's states, from the smallest load to the largest, as many as asked for or as there are."""
    order = np.argsort(loads(contents), kind="stable")
    rows = np.unique(np.linspace(0, len(order) - 1, min(most, len(order))).round().astype(int))
    return [int(order[row]) for row in rows]


def loads(contents: DatasetContents) -> Array:
    """(K,) how hard each of the evidence's states is loaded, for ordering them."""
    own = np.abs([(s.field_mT, s.tip_force_N) for s in contents.evidence.states])
    return np.asarray((own / np.maximum(own.max(axis=0), 1e-12)).sum(axis=1))


def load_words(state: State) -> str:
    """A state's load: `7.05 mT`, with the force at its tip where there is one."""
    force = f"{1e3 * state.tip_force_N:.3g} mN" if state.tip_force_N else ""
    field = f"{state.field_mT:.3g} mT" if state.field_mT or not force else ""
    return ", ".join(word for word in (field, force) if word)


def _pixels_per_mm(contents: DatasetContents) -> float:
    calibration = contents.dataset.calibration
    return calibration.pixels_per_mm if calibration else 1.0
