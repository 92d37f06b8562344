"""The distances of measured edge points or tracked points from the simulated beam."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_lab.fits.evidence import Evidence
from eimi_lab.showing.tables import data_frame, html_table, installed

Array = NDArray[np.float64]

_SMOOTHED = 9  # points of a moving mean, without which the scatter of the points would lengthen the path along them


@dataclass(frozen=True)
class Residuals:
    """Distances of measured points from the simulated beam, for K states and m points of an edge.

    Parameters
    ----------
    dataset : str
        Path of the dataset.
    state : ndarray, shape (K,)
        Indices of the states in the dataset.
    field_mT : ndarray, shape (K,)
        Field of each state.
    edge : tuple of str
        ``("left", "right")``, or ``("x", "y")`` for the components of tracked points.
    arc_length_mm : ndarray, shape (K, 2, m)
        Distance of each point from the clamp along the edge or, for tracked points, along the beam at rest. NaN without
        a point.
    distance_mm : ndarray, shape (K, 2, m)
        Measured minus simulated position; for an edge, positive to the left of the direction from clamp to tip. NaN
        without a point.
    """

    dataset: str
    state: NDArray[np.intp]
    field_mT: Array
    edge: tuple[str, str]
    arc_length_mm: Array
    distance_mm: Array

    @staticmethod
    def of(evidence: Evidence, residuals_mm: Array) -> Residuals:
        """Return the distances of measured from simulated points, labelled with states, fields and edges.

        `residuals_mm` has the axes state, edge and point.
        """
        observed = evidence.experiment.observed
        is_edges = isinstance(observed, EdgeObservation)
        return Residuals(
            dataset=str(evidence.path),
            state=np.array([state.index for state in evidence.states]),
            field_mT=np.array([state.field_mT for state in evidence.states]),
            edge=("left", "right") if is_edges else ("x", "y"),
            arc_length_mm=np.where(np.isfinite(residuals_mm), _arc_length_mm(observed), np.nan),
            distance_mm=residuals_mm,
        )

    @property
    def root_mean_square_mm(self) -> Array:
        """Return the root mean square distance in each state (mm), shape (K,)."""
        squares = np.nansum(self.distance_mm**2, axis=(1, 2))
        points = np.isfinite(self.distance_mm).sum(axis=(1, 2)) / (1 if self.edge == ("left", "right") else 2)
        return np.asarray(np.sqrt(squares / points))

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame of the distances (mm). Raises ImportError without pandas."""
        rows = [
            {
                "state": int(self.state[k]),
                "field_mT": float(self.field_mT[k]),
                "edge": self.edge[side],
                "arc_length_mm": float(self.arc_length_mm[k, side, i]),
                "distance_mm": float(self.distance_mm[k, side, i]),
            }
            for k, side, i in np.argwhere(np.isfinite(self.distance_mm))
        ]
        return data_frame(rows, "state")

    def to_xarray(self) -> Any:
        """Return the distances as an xarray.Dataset: axes state, edge, point; mm. Raises ImportError without xarray."""
        axes, mm = ("state", "edge", "point"), {"units": "mm"}
        variables = {"distance": (axes, self.distance_mm, mm)}
        coordinates = {
            "state": self.state,
            "edge": list(self.edge),
            "field": ("state", self.field_mT, {"units": "mT"}),
            "arc_length": (axes, self.arc_length_mm, mm),
        }
        return installed("xarray").Dataset(variables, coordinates, {"path": self.dataset})

    def plot(self) -> Any:
        """Return a matplotlib figure of the distances of measured from simulated points against the arc length."""
        from eimi_lab.fits.fit_figures import drawn_residuals  # matplotlib is slow to import

        return drawn_residuals(self.edge, self.field_mT, self.arc_length_mm, self.distance_mm)

    def __repr__(self) -> str:
        measured = np.isfinite(self.distance_mm)
        points = int((measured.any(axis=1) if self.edge == ("x", "y") else measured).sum())
        return f"<Residuals of {self.dataset}: {len(self.state)} states, {points} points>"

    def _repr_html_(self) -> str:
        rows = [
            (str(state), f"{field:.3f}", f"{1e3 * error:.3g}")
            for state, field, error in zip(self.state, self.field_mT, self.root_mean_square_mm, strict=True)
        ]
        return html_table(repr(self)[1:-1], ("state", "field, mT", "root mean square, µm"), rows)


def _arc_length_mm(observed: EdgeObservation | PointObservation) -> Array:
    """Return the arc lengths of the measured points from the clamp (mm); axes state, edge and point."""
    if isinstance(observed, PointObservation):
        return np.repeat(observed.rest_mm[:, None, :, 0], 2, axis=1)
    lengths = np.full(observed.sigma_mm.shape, np.nan)
    for k, side in np.ndindex(lengths.shape[:2]):
        measured = np.isfinite(observed.sigma_mm[k, side])
        lengths[k, side, measured] = _along_mm(observed.points_mm[k, side, measured])
    return lengths


def _along_mm(points_mm: Array) -> Array:
    """Return the arc length (mm) along an edge, from the clamp to each of its m points, shape (m,)."""
    if not len(points_mm):
        return np.zeros(0)
    half = min(_SMOOTHED, len(points_mm)) // 2
    ahead = np.concatenate(
        [2 * points_mm[0] - points_mm[half:0:-1], points_mm, 2 * points_mm[-1] - points_mm[-2 : -half - 2 : -1]]
    )
    smooth = np.lib.stride_tricks.sliding_window_view(ahead, 2 * half + 1, axis=0).mean(axis=-1)
    steps = np.linalg.norm(np.diff(smooth, axis=0), axis=1)
    return points_mm[0, 0] + np.concatenate([[0.0], np.cumsum(steps)])
