"""Smooth deviations of a specimen from its given rest shape, as sums of a few modes.

A mode is a polynomial in x = 2 s / l - 1, which increases from -1 at the clamp to 1 at the end of the flexible part.
Here s is the arc length from the clamp and l the length of the flexible part. P_i are Legendre's polynomials. Bending
mode i adds the curvature

    c_i P_i(x),    i = 0, 1, 2,

to the centre line. The factor c_i makes the largest offset of the centre line 1 mm. A mode of the width adds P_1(x) or
P_2(x) to the width: P_1 makes a taper, and P_2 a difference between the middle and the ends. The mean width of the
flexible part stays the same.
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
TAPER, WAIST = 2.0, 1.5  # change of the width from the clamp to the end by P_1, and from the middle to the ends by P_2
_STATIONS = 17  # rows of a table that holds modes; its spline reproduces their cubics exactly


def with_modes(
    specimen: Specimen, bends_mm: Sequence[float] | Array = (), widths_mm: Sequence[float] | Array = ()
) -> Specimen:
    """Return the specimen with smooth deviations added to its rest shape.

    Parameters
    ----------
    specimen : Specimen
        The specimen with its given rest shape.
    bends_mm : sequence of float
        Amplitudes of the modes of bending: the largest offset of the centre line in mm, positive toward +y. The
        curvature of mode i is proportional to the Legendre polynomial P_i.
    widths_mm : sequence of float
        Amplitudes in mm of the Legendre polynomials P_1 and P_2 that are added to the width. The amplitude of P_1 is
        half of the change of the width from the clamp to the end of the flexible part.
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
    """Return a table of a rest shape with a mode (a smooth deviation) added to its values.

    Parameters
    ----------
    rows : tuple of (float, float)
        The table without the mode: each row has a fraction of the beam's length and a value. It may be empty.
    share : float
        Length of the flexible part divided by the length of the beam.
    mode : callable
        The mode as a function of the arc length divided by the length of the flexible part, from 0 at the clamp to 1.
        Beyond the flexible part, the value of the mode at 1 is added.
    before : callable
        Function that interpolates the table ``rows`` at any fractions of the beam's length, for rows that have to be
        inserted.
    """
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
    """Return the offset of the centre line, normal to the beam, due to modes of bending, (n,) in mm.

    Mode i is a deviation from the given rest shape, whose curvature is proportional to the Legendre polynomial P_i.

    Parameters
    ----------
    bends_mm : sequence of float
        Amplitudes of the modes: the largest offset in mm.
    along : ndarray, shape (n,)
        Arc length from the clamp, divided by the length of the flexible part.
    """
    return sum((a * _turn(i, along, 1) for i, a in enumerate(bends_mm)), start=np.zeros(len(along)))


def _turn(i: int, x: Array, integrals: int = 0) -> Array:
    """Return the angle (``integrals`` = 0) or the offset (``integrals`` = 1) of the centre line in bending mode i.

    The curvature of the mode is proportional to the Legendre polynomial P_i. The angle is in rad. x: arc length from
    the clamp. Arc length and offset are divided by the length of the flexible part.
    """
    turn = Legendre.basis(i, domain=[0.0, 1.0]).integ(lbnd=0.0)
    offset = turn.integ(lbnd=0.0)
    return np.asarray((offset if integrals else turn)(x) / np.abs(offset(np.linspace(0, 1, 101))).max())
