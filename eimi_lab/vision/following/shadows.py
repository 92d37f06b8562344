"""Detect edges that are borders of a shadow, by weighted sums of the colours in which a shadow is invisible."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_lab.vision.following.colour_seams import OUTWARD, Seams, find_colour_seams
from eimi_lab.vision.following.discriminant import INSIDE_BAND, OUTSIDE_BAND, ColourProjection
from eimi_lab.vision.following.unrolled import UnrolledPicture

Array = NDArray[np.float64]

_TOLERANCES = (0.6, 0.2)  # widths, of the two passes: about the border of a shadow, which may be as wide as this, then
# about the edges that the first pass has found
_WINDOW = 1.0  # widths along the beam over which both edges are compared; a shorter difference is ignored
_LEAST_SHIFT, _LEAST_SHIFT_PX = 0.03, 1.5  # widths, and pixels of the image: a smaller shift is ignored
_LEAST_SEPARATION = 3.0  # standard deviations between inside and outside
_AS_SURE = 0.15  # least separation by a sum in which a shadow is invisible, divided by the separation by all colours
_LEAST_BODY_STEP = 0.2  # of the step at the border: behind the border of a shadow the body differs by more
_HALF = 0.5  # of the fall of a full step
_SIDE_SIGMAS = 2.0  # a side face is at most wider than expected by this multiple of its standard uncertainty
_ALONG_IT = 0.2  # of the edge: along a shadow at least this long, every place with a clear colour step is moved


def move_off_shadows(unrolled: UnrolledPicture, colour_seams: Seams, noise: float) -> Seams:
    """Move edges that are borders of the beam's shadow to the edge of the beam. A grey picture is not changed.

    Parameters
    ----------
    unrolled : UnrolledPicture
        The straightened picture of the beam.
    colour_seams : Seams
        Both edges, located with all colours.
    noise : float
        Standard deviation of the noise, grey levels (0 to 255).

    Returns
    -------
    Seams
        The edges, with their attribute `shadow`: the width of a dark region inside the edge in `colour_seams`, or 0.
    """
    if unrolled.colours.shape[2] == 1:
        return colour_seams
    # In shadow, all colours of a surface in white light are darker by the same factor (R. Gershon, A. D. Jepson and J.
    # K. Tsotsos, J. Opt. Soc. Am. A 3 (1986) 1700). A sum that is orthogonal to the colour of the surroundings maps all
    # multiples of this colour to 0: the border of a shadow has no step. The first pass takes the colours of the beam
    # from its middle, because beside the border of a shadow they are colours of the shadow.
    body = find_colour_seams(unrolled, colour_seams.edge, noise, _TOLERANCES, shadowless=True)
    shift = np.array(OUTWARD)[:, None] * (colour_seams.edge - body.edge)
    window = max(3, round(_WINDOW * unrolled.stations_in_width))
    noticed = max(_LEAST_SHIFT, _LEAST_SHIFT_PX / float(np.linalg.norm(unrolled.aside[0])))
    separation, shadowless_separation = (
        np.stack([side.separation for side in seams.projected]) for seams in (colour_seams, body)
    )
    clear = shadowless_separation > np.maximum(_LEAST_SEPARATION, _AS_SURE * separation)
    smooth_shift = scipy.ndimage.median_filter(shift, size=(1, window), mode="nearest")
    # In perspective, a dark region may be a side face of the beam.
    least = np.maximum(noticed, unrolled.side_faces + _SIDE_SIGMAS * unrolled.side_sigma)
    moved = clear & (body.support > _HALF) & (smooth_shift > least)
    moved &= np.stack([is_dimmed(unrolled, *seams, window) for seams in zip(body.edge, colour_seams.edge, strict=True)])
    opening = np.ones((1, window), dtype=bool)
    dark = scipy.ndimage.binary_opening(moved, opening)
    if not dark.any():
        return colour_seams
    dark |= clear & (dark.mean(axis=1, keepdims=True) > _ALONG_IT)
    # The cut side of a coloured board has another hue than a shadow. The rim of a translucent beam is excluded below.
    # In these cases the outer border stays the edge, and only `shadow` tells of the region.
    of_surroundings = [
        _has_hue_of_surroundings(unrolled, *pair, window) for pair in zip(body.edge, colour_seams.edge, strict=True)
    ]
    moved = scipy.ndimage.binary_opening(moved & np.stack(of_surroundings), opening)
    moved |= clear & (moved.mean(axis=1, keepdims=True) > _ALONG_IT)
    shadow = np.where(dark, shift, 0.0)
    for edge, border, places in zip(body.edge, colour_seams.edge, moved, strict=True):
        if places.any() and _is_rim(unrolled, edge, border, places, window):
            places[:] = False
    left, right = (merged(*sides) for sides in zip(moved, body.projected, colour_seams.projected, strict=True))
    return Seams(
        edge=np.where(moved, body.edge, colour_seams.edge),
        support=np.where(moved, body.support, colour_seams.support),
        projected=(left, right),
        shadow=shadow,
    )


def _is_rim(unrolled: UnrolledPicture, edge: Array, border: Array, moved: NDArray[np.bool_], window: int) -> bool:
    """Return whether the region between two lines along a beam, `edge` and `border`, is beam and not shadow."""
    # A translucent rim has nearly the colour of the beam: nearly the whole change of colour is at the outer border
    colours = [colour[moved] for colour in _three_colours(unrolled, edge, border, window)]
    at_edge, at_border = (np.median(np.linalg.norm(step, axis=1)) for step in -np.diff(colours, axis=0))
    return bool(at_edge < _LEAST_BODY_STEP * at_border)


def _has_hue_of_surroundings(unrolled: UnrolledPicture, edge: Array, border: Array, window: int) -> NDArray[np.bool_]:
    """Return, for each row, whether the region from the line `edge` to `border` has the hue of the surroundings."""
    colours = _three_colours(unrolled, edge, border, window)
    hues = [colour / np.maximum(colour.sum(axis=1, keepdims=True), 1.0) for colour in colours]
    of_body, of_region = (np.linalg.norm(hue - hues[2], axis=1) for hue in hues[:2])
    return np.asarray(of_region < _HALF * of_body)


def _three_colours(unrolled: UnrolledPicture, edge: Array, border: Array, window: int) -> list[Array]:
    outward = np.sign(border - edge)[:, None]
    inward, beyond = (outward * (unrolled.across - place[:, None]) for place in (edge, border))
    gap = np.abs(border - edge)[:, None]
    bands = (
        (inward <= -INSIDE_BAND[0]) & (inward >= -INSIDE_BAND[1]),
        (inward >= 0.25 * gap) & (inward <= 0.75 * gap),
        (beyond >= OUTSIDE_BAND[0]) & (beyond <= OUTSIDE_BAND[1]),
    )
    return [_colours_of(unrolled, band, window) for band in bands]


def is_dimmed(unrolled: UnrolledPicture, edge: Array, border: Array, window: int) -> NDArray[np.bool_]:
    """Return, for each row, whether the region from the line `edge` to `border` is darker than the surroundings."""
    outward = np.sign(border - edge)[:, None]
    beyond = outward * (unrolled.across - border[:, None])
    between = np.abs(unrolled.across - 0.5 * (edge + border)[:, None])
    half = np.maximum(0.5 * np.abs(border - edge), 0.5 * (unrolled.across[1] - unrolled.across[0]))[:, None]
    outside = (beyond >= OUTSIDE_BAND[0]) & (beyond <= OUTSIDE_BAND[1])
    dim, light = (_colours_of(unrolled, mask, window) for mask in (between <= half, outside))
    return np.asarray((dim * light).sum(axis=1) < (light**2).sum(axis=1))


def _colours_of(unrolled: UnrolledPicture, mask: NDArray[np.bool_], window: int) -> Array:
    in_image = (mask & unrolled.inside)[..., None]
    total = scipy.ndimage.uniform_filter1d((in_image * unrolled.colours).sum(axis=1, dtype=np.float64), window, axis=0)
    count = scipy.ndimage.uniform_filter1d(in_image.sum(axis=1, dtype=np.float64), window, axis=0)
    return np.asarray(total / np.maximum(count, 1e-3))


def merged(moved: NDArray[np.bool_], where_moved: ColourProjection, elsewhere: ColourProjection) -> ColourProjection:
    """Return the values of `where_moved` in the rows where `moved` is True, and of `elsewhere` in the other rows."""
    values = {}
    for field in fields(where_moved):
        one, two = getattr(where_moved, field.name), getattr(elsewhere, field.name)
        values[field.name] = np.where(moved.reshape(-1, *[1] * (one.ndim - 1)), one, two)
    return ColourProjection(**values)
