"""Smooth deviations of the rest shape, as sums of a few modes.

A mode of bending has the curvature

    kappa_i(s) = c_i P_i(2 s / l - 1),    i = 0, 1, 2,

with Legendre's polynomials P_i and the flexible length l; c_i makes the largest offset of the centre line 1 mm. A mode
of the width is the polynomial P_1 or P_2 itself, so that the mean width of the flexible part is unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.polynomial import Legendre
from numpy.typing import NDArray

from eimi_fitting.beam.rest_shape import RestShape, Rows, table_at
from eimi_fitting.beam.specimen import Specimen

Array = NDArray[np.float64]

BENDS, WIDTHS = 3, 2  # numbers of modes
_STATIONS = 17  # rows of a table that holds modes; its spline reproduces their cubics exactly


def with_modes(
    specimen: Specimen, bends_mm: Sequence[float] | Array = (), widths_mm: Sequence[float] | Array = ()
) -> Specimen:
    """Return the specimen with smooth deviations added to its rest shape.

    Parameters
    ----------
    specimen : Specimen
    bends_mm : sequence of float
        Amplitudes of the modes of bending: the largest offset of the centre line, toward +y, in mm.
    widths_mm : sequence of float
        Amplitudes of the modes of the width: half of the change from the clamp to the end of the flexible part (first),
        and the amplitude of P_2 (second).
    """
    if not any(bends_mm) and not any(widths_mm):
        return specimen
    shape, share = specimen.rest_shape or RestShape(), specimen.flexible_length_mm / specimen.length_mm
    length = specimen.flexible_length_mm

    def turned(x: Array) -> Array:
        return sum((a * _turn(i, x) / length for i, a in enumerate(bends_mm)), start=np.zeros(len(x)))

    def widened(x: Array) -> Array:
        modes = (a * Legendre.basis(i)(2 * x - 1) for i, a in enumerate(widths_mm, 1))
        return sum(modes, start=np.zeros(len(x)))

    more = replace(shape)
    if any(bends_mm):
        more = replace(more, turns=_added(shape.turns, share, turned, shape.angle_rad))
    if any(widths_mm):
        more = replace(more, widths=_added(shape.widths, share, widened, lambda s: table_at(shape.widths, s)))
    return replace(specimen, rest_shape=more)


def _added(rows: Rows, share: float, mode: Callable[[Array], Array], before: Callable[[Array], Array]) -> Rows:
    """Return a table with a smooth function of s / l added; the function is constant beyond the flexible part."""
    if rows:
        at, values = np.array(rows).T
        if len(at) < _STATIONS:
            inner = np.linspace(0, 1, _STATIONS)
            far = np.abs(inner[:, None] - at).min(axis=1) > 0.25 / _STATIONS
            at, values = np.concatenate([at, inner[far]]), np.concatenate([values, before(inner[far])])
            order = np.argsort(at, kind="stable")
            at, values = at[order], values[order]
    else:
        at = np.linspace(0, share, _STATIONS)
        values = np.zeros(len(at))
    added = values + mode(np.minimum(at / share, 1.0))
    return tuple(zip(at.tolist(), added.tolist(), strict=True))


def bend_offset(bends_mm: Sequence[float] | Array, along: Array) -> Array:
    """Return the offset (n,) in mm of the centre line due to modes of bending, at shares (n,) of the length."""
    return sum((a * _turn(i, along, 1) for i, a in enumerate(bends_mm)), start=np.zeros(len(along)))


def _turn(i: int, x: Array, integrals: int = 0) -> Array:
    """Return l times the angle of mode i at x = s / l for a largest offset of 1; or return the offset itself."""
    turn = Legendre.basis(i, domain=[0.0, 1.0]).integ(lbnd=0.0)
    offset = turn.integ(lbnd=0.0)
    return np.asarray((offset if integrals else turn)(x) / np.abs(offset(np.linspace(0, 1, 101))).max())
