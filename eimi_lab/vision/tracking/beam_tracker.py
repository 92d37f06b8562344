"""Find the beam in each frame of a recording, near its place in the previous frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.profiles import AVERAGED_PX, read_profiles, stations
from eimi_lab.vision.projection import Projection
from eimi_lab.vision.tracking.beam_curve import BeamCurve, curve_through
from eimi_lab.vision.tracking.step_places import band_shifts, step_places

Array = NDArray[np.float64]

STATIONS = 24
_FIRST, _LAST = 0.06, 0.97  # shares of the length; near the clamp and near the corners a profile is not a clean step
_REACH_PX = 7.0  # half length of an edge profile without motion
_WIDEST = 0.45  # share of the beam's width: the inner end of an edge profile does not reach the other edge
_FAINT = 0.35  # share of the contrast in the first frame; a band or step with less contrast is not the beam
_FEWEST = 0.5  # smallest share of the stations at which the beam has to be seen
_LINES_PX = np.arange(AVERAGED_PX) - 0.5 * (AVERAGED_PX - 1)
_SEARCH = 1.0  # largest shift in the first search, in widths of the beam
_WIDER_SEARCH = 3.0
_MARGIN_PX = 30.0  # additional distance from the beam up to which a frame is converted to grey values
_CLOSE_PX = 1.0  # the edges are measured again if the curve was farther from their middle
_OFF_CURVE_PX = 3.0  # an edge point farther from the smooth curve is dirt or a reflection


@dataclass(frozen=True)
class SeenBeam:
    """The beam in one frame of a recording, at p arc lengths.

    Parameters
    ----------
    middle_px, left_px, right_px : ndarray, shape (p, 2)
        Points of the centre line and of both edges; NaN where no edge was detected.
    """

    middle_px: Array
    left_px: Array
    right_px: Array

    @property
    def is_seen(self) -> bool:
        """Whether the beam was detected at half or more of its arc lengths."""
        return float(np.isfinite(self.middle_px[:, 0]).mean()) >= _FEWEST


class BeamTracker:
    """The search for a beam in successive frames of a recording.

    Parameters
    ----------
    image : ndarray, shape (rows, columns) or (rows, columns, 3)
        The first frame of the search.
    edges : EdgeSet
        Edges of the beam in this frame.
    frame : BeamFrame
        Map between pixels and millimetres.
    length_mm : float
        Length of the beam.
    projection : Projection, optional
        Weights that convert colours to grey values.

    Attributes
    ----------
    along_mm : ndarray, shape (p,)
        Arc lengths at which the beam is followed.

    Raises
    ------
    ValueError
        If the edges are empty, or if the beam does not contrast with its surroundings.
    """

    def __init__(
        self,
        image: NDArray[Any],
        edges: EdgeSet,
        frame: BeamFrame,
        length_mm: float,
        projection: Projection | None = None,
    ) -> None:
        if not len(edges.middle_mm):
            raise ValueError("no edges of the beam were found in the first frame")
        self._projection = projection
        root, ahead = frame.to_px([[0.0, 0.0], [1.0, 0.0]])
        length_px = length_mm * float(np.linalg.norm(ahead - root))
        self.along_mm = np.linspace(_FIRST, _LAST, STATIONS) * length_mm
        self._along_px = self.along_mm * length_px / length_mm
        ordered = edges.middle_mm[np.argsort(np.hypot(*edges.middle_mm.T), kind="stable")]
        step = max(1, len(ordered) // (2 * STATIONS))
        self._curve = curve_through(np.vstack([root, frame.to_px(ordered[step // 2 :: step])]), length_px)
        self._before: BeamCurve | None = None
        self._first = self._curve
        left, right = (frame.to_px(side.points_mm) for side in (edges.left, edges.right))
        places, normals = self._curve.at(self._along_px)
        near_left, near_right = (_nearest(side, places) for side in (left, right))
        self._half_px = 0.5 * (
            np.abs(_across(near_left, places, normals)) + np.abs(_across(near_right, places, normals))
        )
        self._half_px = np.maximum(np.median(self._half_px) * 0.5, self._half_px)
        self._left_sign = float(np.sign(np.median(_across(near_left, places, normals)))) or 1.0
        self._polarity = 1.0
        contrasts = [self._bands(self._grey(image, 1.0), self._curve, 1.0, sign)[1] for sign in (1.0, -1.0)]
        best = int(np.argmax([np.median(contrast) for contrast in contrasts]))
        self._polarity = (1.0, -1.0)[best]
        self._contrast = float(np.median(contrasts[best]))
        if self._contrast <= 0.0:
            raise ValueError("the beam does not contrast with its surroundings")
        beam, curve = self._on_edges(self._grey(image, 1.0), self._curve, 0.0, None)
        if beam.is_seen:  # the root then lies on the centre line, also if the clamp is stated a few px beside it
            self._first = self._curve = curve

    @property
    def outline_px(self) -> Array:
        """Corners of a polygon with a margin around the beam in the first frame, px, shape (n, 2)."""
        places, normals = self._first.at(np.linspace(0.0, self._first.length_px, 2 * STATIONS))
        aside = 3.0 * float(self._half_px.max()) * normals
        ahead = 3.0 * float(self._half_px.max()) * np.array([normals[-1, 1], -normals[-1, 0]])
        return np.vstack([places - aside, places[-1] - aside[-1] + ahead, places[-1] + aside[-1] + ahead,
                          (places + aside)[::-1]])  # fmt: skip

    def follow(self, image: NDArray[Any]) -> SeenBeam:
        """Return edges and centre line of the beam in the next frame; mostly NaN if no beam is found."""
        grey = self._grey(image, _SEARCH)
        predicted = self._curve if self._before is None else self._curve.extrapolated(self._before, 1.0)
        band = None
        for start, reach in (
            (predicted, _SEARCH),
            (self._curve, _SEARCH),
            (self._curve, _WIDER_SEARCH),
            (self._first, _WIDER_SEARCH),  # after the beam was hidden
        ):
            if reach > _SEARCH:
                grey = self._grey(image, reach)
            band = self._near(grey, start, reach)
            if band is not None:
                break
        if band is None:
            self._before = None
            missing = np.full((STATIONS, 2), np.nan)
            return SeenBeam(missing, missing, missing)
        # `band` is where a strip as wide as the beam contrasts most; now it is moved to the middle between the edges.
        beam, curve = self._on_edges(grey, band, self._smear_px(band), self._first)
        if beam.is_seen:
            self._before, self._curve = self._curve, curve
        else:
            self._before = None
        return beam

    def _grey(self, image: NDArray[Any], widths: float) -> NDArray[Any]:
        """Return the grey values of a frame, at least up to a distance of `widths` beam widths from the beam."""
        if image.ndim == 2:
            return image
        if image.dtype != np.uint8:  # the full scale of other pictures depends on all pixels
            return self._projected(image)
        reach = 2.0 * (widths + 1.0) * float(self._half_px.max()) + _MARGIN_PX
        curves = [self._first, self._curve]
        if self._before is not None:  # the search begins where the beam would be at its present rate
            curves.append(self._curve.extrapolated(self._before, 1.0))
        places = np.vstack([curve.at(self._along_px)[0] for curve in curves])
        low = np.maximum(np.floor(places.min(axis=0) - reach), 0.0).astype(int)
        high = np.maximum(np.ceil(places.max(axis=0) + reach).astype(int), low)
        part = slice(low[1], high[1]), slice(low[0], high[0])
        grey = np.zeros(image.shape[:2], np.float32)
        if grey[part].size:
            grey[part] = self._projected(image[part])
        return grey

    def _projected(self, image: NDArray[Any]) -> NDArray[np.float32]:
        if self._projection is None:
            return np.asarray(image.mean(axis=2, dtype=np.float32))
        return self._projection.apply(image)

    def _near(self, grey: NDArray[Any], curve: BeamCurve, reach: float) -> BeamCurve | None:
        """Return the beam's centre line, searched up to `reach` beam widths from a curve; None if no beam is found."""
        for again in range(2):
            shift, contrast = self._bands(grey, curve, reach, self._polarity)
            weight = (contrast > _FAINT * self._contrast).astype(float)
            if weight.mean() < _FEWEST:
                return None
            moved = curve.moved(self._along_px, shift, weight, self._first)
            off = np.abs(shift - _across(moved.at(self._along_px)[0], *curve.at(self._along_px)))
            weight *= off <= max(3.0 * float(np.median(off[weight > 0])), 2.0)
            curve = curve.moved(self._along_px, shift, weight, self._first)
            if again or np.abs(shift[weight > 0]).max() < 0.5 * self._half_px.min():
                break
            reach = min(reach, 0.5)
        return curve

    def _bands(self, grey: NDArray[Any], curve: BeamCurve, reach: float, polarity: float) -> tuple[Array, Array]:
        places, normals = curve.at(self._along_px)
        share = self._along_px / curve.length_px
        widest = 2.0 * float(self._half_px.max())
        reach_px = np.clip(2.0 * reach * widest * share**1.5, 3.0, reach * widest)  # points near the clamp move least
        span = np.ceil(1.4 * self._half_px.max() + reach_px.max() + 5.0)
        across = np.arange(-span, span + 1.0)
        tangents = np.stack([normals[:, 1], -normals[:, 0]], axis=1)
        points = places[:, None, :] + np.array([-1.5, 1.5])[None, :, None] * tangents[:, None, :]
        profiles, _ = read_profiles(grey, points, np.repeat(normals[:, None], 2, axis=1), across)
        return band_shifts(profiles, across, self._half_px, reach_px, polarity)

    def _smear_px(self, curve: BeamCurve) -> float:
        """Return the largest motion (px) of a point of the beam from the last frame to `curve`."""
        places, normals = self._curve.at(self._along_px)
        return float(np.abs(_across(curve.at(self._along_px)[0], places, normals)).max())

    def _on_edges(
        self, grey: NDArray[Any], curve: BeamCurve, smear_px: float, usual: BeamCurve | None
    ) -> tuple[SeenBeam, BeamCurve]:
        """Return the edges of the beam near an approximate centre line, and a corrected centre line.

        `smear_px`: motion of the beam since the last frame. `usual`: centre line of the first frame, toward which the
        ends of the new line are pulled.
        """

        def through(curve: BeamCurve, offset: Array, is_usable: NDArray[np.bool_]) -> BeamCurve:
            return curve.moved(self._along_px, np.where(is_usable, offset, 0.0), is_usable.astype(float), usual)

        reach = _REACH_PX + 0.5 * smear_px
        for _ in range(3):
            places, normals = curve.at(self._along_px)
            left, right = (self._edge(grey, places, normals, side, reach) for side in (1.0, -1.0))
            middle = 0.5 * (left + right)
            offset = _across(middle, places, normals)
            is_usable = np.isfinite(offset)
            if is_usable.mean() < _FEWEST:
                break
            moved = through(curve, offset, is_usable)
            deviations = offset - _across(moved.at(self._along_px)[0], places, normals)
            off = np.abs(deviations - np.nanmedian(deviations)) > _OFF_CURVE_PX
            left[off], right[off], middle[off] = np.nan, np.nan, np.nan
            is_usable &= ~off
            curve = through(curve, offset, is_usable)
            if np.nanmax(np.abs(offset)) < _CLOSE_PX:
                break
        sides = (left, right) if self._left_sign > 0 else (right, left)
        return SeenBeam(middle, *sides), curve

    def _edge(self, grey: NDArray[Any], places: Array, normals: Array, side: float, reach: float) -> Array:
        """Return points of one edge (px), searched up to `reach` px from its expected place; NaN where none is found.

        `places`, `normals`: points and unit normals of the centre line. `side`: +1 for the edge on the side of the
        normals, else -1.
        """
        inner = float(min(reach, 2.0 * _WIDEST * self._half_px.min()))
        across = stations(inner, max(inner, min(reach, 2.0 * self._half_px.max())))
        outward = side * normals
        tangents = np.stack([normals[:, 1], -normals[:, 0]], axis=1)
        origins = places + self._half_px[:, None] * outward
        lines = origins[:, None, :] + _LINES_PX[None, :, None] * tangents[:, None, :]
        profiles, inside = read_profiles(grey, lines, np.repeat(outward[:, None], AVERAGED_PX, axis=1), across)
        steps = step_places(across, profiles)
        sound = inside & (self._polarity * steps.height > _FAINT * self._contrast)
        sound &= (steps.offset_px > across[0]) & (steps.offset_px < across[-1])
        points = origins + steps.offset_px[:, None] * outward
        return np.where(sound[:, None], points, np.nan)


def _across(points: Array, places: Array, normals: Array) -> Array:
    return np.asarray(((points - places) * normals).sum(axis=1))


def _nearest(line: Array, places: Array) -> Array:
    """Return, for each point of `places`, the nearest point of a line."""
    return np.asarray(line[((places[:, None] - line) ** 2).sum(axis=2).argmin(axis=1)])
