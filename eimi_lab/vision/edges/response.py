"""Estimate the gamma of the camera from the shape of blurred edges.

A camera with gamma stores light to the power 1/gamma. This displaces the middle of a blurred edge.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BIN_PX = 0.25
_REACH_IN_BLURS = 4.0
_FEWEST_BINS = 12
_FEWEST_IN_BIN = 4
_CERTAIN = 0.1  # a gamma is accepted if its standard deviation is below this limit
_CLEARLY_BENT = 4.0  # a gamma is also accepted if it exceeds 1 by more than this number of standard deviations
_CLEARLY_STRAIGHT = 0.1  # a first estimate of gamma this close to 1 is not refined
# Of scale, dark, offset (px), blur (px) and gamma.
_BOUNDS = ([0.5, 0.0, -3.0, 0.2, 0.3], [1.5, 0.95, 3.0, 10.0, 5.0])


def estimate_gamma(
    stations_px: Array, profiles: Array, offset_px: Array, bright: Array, blur_px: float
) -> float | None:
    """Estimate the gamma of the camera from blurred edges, where grey = light ** (1 / gamma).

    Parameters
    ----------
    stations_px : ndarray, shape (m,)
        Distances along lines across the edges.
    profiles : ndarray, shape (n, m)
        Grey values on n lines; larger values mean more light.
    offset_px : ndarray, shape (n,)
        Distance at which each line crosses the edge.
    bright : ndarray, shape (n,)
        Grey value at the bright end of each line.
    blur_px : float
        Standard deviation of the blur.

    Returns
    -------
    float or None
        None if the grey values do not determine gamma.
    """
    places = stations_px - offset_px[:, None]
    near_edge = np.abs(places) < _REACH_IN_BLURS * blur_px + 1.0
    bins = np.rint(places[near_edge] / _BIN_PX).astype(int)
    bins -= (lowest := int(bins.min(initial=0)))
    count = np.bincount(bins)
    values = (profiles / np.maximum(bright, 1e-9)[:, None])[near_edge]
    full = count >= _FEWEST_IN_BIN
    if full.sum() < _FEWEST_BINS:
        return None
    place = np.bincount(bins, weights=places[near_edge])[full] / count[full]
    mean = np.bincount(bins, weights=values)[full] / count[full]
    dark, blur = float(np.clip(mean[0], 0.01, 0.9)), float(np.clip(blur_px, 0.3, 9.0))
    gamma = _gamma_in_one_step(place, mean, np.sqrt(count[full]), dark, blur)
    if abs(gamma - 1.0) < _CLEARLY_STRAIGHT:
        return gamma
    start = (1.0, dark, 0.0, blur, 1.0)
    try:
        parameters, covariance = scipy.optimize.curve_fit(
            _step, place, mean, start, sigma=1.0 / np.sqrt(count[full]), bounds=_BOUNDS, max_nfev=60
        )
    except RuntimeError:  # no minimum within the allowed number of steps
        return None
    gamma, gamma_sigma = float(parameters[4]), float(np.sqrt(covariance[4, 4]))
    is_certain = gamma_sigma < _CERTAIN or gamma - 1.0 > _CLEARLY_BENT * gamma_sigma
    return gamma if is_certain and lowest < 0 else None


def _gamma_in_one_step(place: Array, mean: Array, weight: Array, dark: float, blur: float) -> float:
    """Estimate gamma from mean grey values across an edge by one least-squares step from gamma = 1."""
    z = place / blur
    rise, bell = scipy.special.ndtr(z), np.exp(-0.5 * z**2)
    light = dark + (1.0 - dark) * rise
    columns = np.column_stack([light, 1.0 - rise, bell, z * bell, -light * np.log(light)])
    return 1.0 + float(np.linalg.lstsq(weight[:, None] * columns, weight * (mean - light), rcond=None)[0][4])


def _step(place: Array, scale: float, dark: float, offset: float, blur: float, gamma: float) -> Array:
    light = dark + (1.0 - dark) * scipy.special.ndtr((place - offset) / blur)
    return np.asarray(scale * np.maximum(light, 1e-9) ** (1.0 / gamma))
