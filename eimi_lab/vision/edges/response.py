"""Whether grey values are proportional to light, read from the shape of the edges themselves.

A lens blurs light: an edge is a symmetric step in it. A camera that stores light to the power 1/gamma bends the step,
more at its dark foot than at its bright shoulder, and every method that looks for the middle of the step is misled.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit
from scipy.special import ndtr

Array = NDArray[np.float64]

_BIN_PX = 0.25
_REACH_IN_BLURS = 4.0
_FEWEST_BINS = 12
_FEWEST_IN_BIN = 4
_CERTAIN = 0.1  # standard deviation of gamma above which the picture is too sharp or too noisy to tell,
_CLEARLY_BENT = 4.0  # unless gamma is above 1 by so many of them
_CLEARLY_STRAIGHT = 0.1  # of gamma from 1; a first guess so close needs no second
_BOUNDS = ([0.5, 0.0, -3.0, 0.2, 0.3], [1.5, 0.95, 3.0, 10.0, 5.0])


def estimate_gamma(
    stations_px: Array, profiles: Array, offset_px: Array, bright: Array, blur_px: float
) -> float | None:
    """Gamma of the camera: grey = light ** (1 / gamma); None where the edges cannot tell it.

    profiles: (n, m) at stations_px (m,), their edges at offset_px (n,), their bright plateaus at bright (n,). All are
    laid over one another, each in units of its plateau (a power law does not mind the scale), and a blurred step to
    the power 1 / gamma is fitted to their mean.
    """
    places = stations_px - offset_px[:, None]
    near = np.abs(places) < _REACH_IN_BLURS * blur_px + 1.0
    bins = np.rint(places[near] / _BIN_PX).astype(int)
    bins -= (lowest := int(bins.min(initial=0)))
    count = np.bincount(bins)
    values = (profiles / np.maximum(bright, 1e-9)[:, None])[near]
    full = count >= _FEWEST_IN_BIN
    if full.sum() < _FEWEST_BINS:
        return None
    place = np.bincount(bins, weights=places[near])[full] / count[full]
    mean = np.bincount(bins, weights=values)[full] / count[full]
    dark, blur = float(np.clip(mean[0], 0.01, 0.9)), float(np.clip(blur_px, 0.3, 9.0))
    gamma = _near_one(place, mean, np.sqrt(count[full]), dark, blur)
    if abs(gamma - 1.0) < _CLEARLY_STRAIGHT:
        return gamma
    start = (1.0, dark, 0.0, blur, 1.0)
    try:
        found, covariance = curve_fit(
            _step, place, mean, start, sigma=1.0 / np.sqrt(count[full]), bounds=_BOUNDS, max_nfev=60
        )
    except RuntimeError:  # no minimum in so many steps: nothing that a judgement could rest on
        return None
    gamma, uncertain = float(found[4]), float(np.sqrt(covariance[4, 4]))
    tells = uncertain < _CERTAIN or gamma - 1.0 > _CLEARLY_BENT * uncertain
    return gamma if tells and lowest < 0 else None


def _near_one(place: Array, mean: Array, weight: Array, dark: float, blur: float) -> float:
    """Gamma from one linear step away from 1: what most pictures need, in a twentieth of the time."""
    z = place / blur
    rise, bell = ndtr(z), np.exp(-0.5 * z**2)
    light = dark + (1.0 - dark) * rise
    columns = np.column_stack([light, 1.0 - rise, bell, z * bell, -light * np.log(light)])
    return 1.0 + float(np.linalg.lstsq(weight[:, None] * columns, weight * (mean - light), rcond=None)[0][4])


def _step(place: Array, scale: float, dark: float, offset: float, blur: float, gamma: float) -> Array:
    light = dark + (1.0 - dark) * ndtr((place - offset) / blur)
    return np.asarray(scale * np.maximum(light, 1e-9) ** (1.0 / gamma))
