"""Lengths and widths of the beam, from the specimen file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip

Array = NDArray[np.float64]

_STATIONS = 1025
_NEAR_STEP = 0.5  # of the smallest width


@dataclass(frozen=True)
class StatedShape:
    """Lengths and widths (mm) of a specimen whose width may vary along its length.

    Parameters
    ----------
    specimen : Specimen
        The specimen.
    """

    specimen: Specimen

    @cached_property
    def _strip(self) -> Strip:
        return Strip(self.specimen)

    @cached_property
    def _along_mm(self) -> Array:
        return np.linspace(0.0, self.length_mm, _STATIONS)

    @property
    def length_mm(self) -> float:
        """Length of the specimen along its centre line, mm."""
        return self.specimen.length_mm

    @property
    def at_clamp_mm(self) -> float:
        """Width of the specimen at the clamp, mm."""
        return float(self._strip.width_mm(np.zeros(1))[0])

    @property
    def at_tip_mm(self) -> float:
        """Width of the specimen at the tip, mm."""
        return float(self._strip.width_mm(np.array([self.length_mm]))[0])

    @property
    def at_magnet_mm(self) -> float:
        """Smallest width of the specimen along the magnet, mm."""
        return self._strip.straight.width_mm

    @property
    def narrowest_mm(self) -> float:
        """Smallest width of the specimen, mm."""
        return float(self._strip.width_mm(self._along_mm).min())

    @property
    def median_mm(self) -> float:
        """Median of the widths of the specimen along its length, mm."""
        return float(np.median(self._strip.width_mm(self._along_mm)))

    @cached_property
    def edge_length_mm(self) -> float:
        """Mean length of the two edges of the specimen, mm."""
        if self._strip.is_straight:
            return self.length_mm
        half = np.full(_STATIONS, 0.5 * self._strip.straight.width_mm)
        edges = (self._strip.at_rest(np.column_stack([self._along_mm, side * half])) for side in (-1, 1))
        return 0.5 * sum(float(np.hypot(*np.diff(edge, axis=0).T).sum()) for edge in edges)

    def even_widths(self, edge: Array, widths: Array, clamp: Array) -> Array:
        """Scale measured widths to those of a beam of constant width; leave out points near an abrupt change of width.

        Parameters
        ----------
        edge : ndarray, shape (n, 2)
            Points of the left edge, ordered from the clamp.
        widths : ndarray, shape (n,)
            Width of the beam at each point.
        clamp : ndarray, shape (2, 2)
            Points at which the left and the right edge leave the clamp.

        Returns
        -------
        ndarray, shape (k,)
            Measured widths at the k remaining points, times ``specimen.width_mm`` / width in the specimen file there.
        """
        if not self._varies:
            return widths
        along_mm = self._along_edge(edge, clamp, 0)
        stated = self._strip.width_mm(np.interp(along_mm, self._edge_mm, self._along_mm))
        even = np.asarray(widths * self.specimen.width_mm / stated)
        return even[~self.near_step(edge, clamp, 0)]

    def near_step(self, edge: Array, clamp: Array, side: int) -> NDArray[np.bool_]:
        """Return which points of an edge lie near an abrupt change of the specimen's width.

        `clamp`: points at which the left and the right edge leave the clamp. `side`: 0 for the left edge, 1 for the
        right.
        """
        near = np.zeros(len(edge), bool)
        if not self._varies:
            return near
        along_mm, kinks_mm = self._along_edge(edge, clamp, side), self._strip.kinks_mm
        margin_mm = _NEAR_STEP * self.narrowest_mm
        for first, last in zip(kinks_mm[:-1:2], kinks_mm[1::2], strict=False):  # the two ends of a ramp
            begin, end = np.interp([first, last], self._along_mm, self._edge_mm)
            near |= (along_mm > begin - margin_mm) & (along_mm < end + margin_mm)
        return near

    @property
    def _varies(self) -> bool:
        return bool(self.specimen.rest_shape and self.specimen.rest_shape.widths)

    @cached_property
    def _edge_mm(self) -> Array:
        """Distances from the clamp along the edge of the specimen, mm."""
        half = 0.5 * self._strip.width_mm(self._along_mm)
        return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(self._along_mm), np.diff(half)))])

    def _along_edge(self, edge: Array, clamp: Array, side: int) -> Array:
        """Return the distance of each edge point from the clamp along the edge, mm."""
        path = np.vstack([clamp[side : side + 1], edge])
        scale = np.linalg.norm(clamp[1] - clamp[0]) / self.at_clamp_mm
        return np.asarray(np.cumsum(np.hypot(*np.diff(path, axis=0).T)) / scale)
