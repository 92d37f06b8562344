"""Smooth changes of the shape of an unloaded beam, described by a few numbers."""

# Let x increase from -1 at the clamp to 1 at the end of the flexible part. Bending mode i = 0, 1, ... has a curvature
# proportional to the Legendre polynomial P_i(x) and a largest offset of 1 mm. A mode of the width adds P_1(x) or P_2(x)
# in mm.

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.polynomial import Legendre
from numpy.typing import NDArray

from eimi_fitting.beam.rest_shape import RestShape, Rows, table_at
from eimi_fitting.beam.specimen import Specimen

Array = NDArray[np.float64]

BENDS, WIDTHS = 3, 2  # numbers of modes
TAPER, WAIST = 2.0, 1.5  # change of the width from the clamp to the end by P_1, and from the middle to the ends by P_2
_STATIONS = 17  # rows of a table that holds modes; its spline reproduces their cubics exactly
_STEEP = 0.12  # least distance of a new row from a step of the width, divided by the step: beyond its ramp in `strip`


def with_modes(
    specimen: Specimen, bends_mm: Sequence[float] | Array = (), widths_mm: Sequence[float] | Array = ()
) -> Specimen:
    """Add smooth deviations to the rest shape of a specimen."""
    # ``bends_mm``: largest offset of the centre line in mm, toward +y, in each bending mode i = 0, 1, ...
    # ``widths_mm``: factors in mm on P_1 and P_2, which are added to the width.
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
        steep = _STEEP / specimen.length_mm
        more = replace(more, widths=_added(shape.widths, share, widened, lambda s: table_at(shape.widths, s), steep))
    return replace(specimen, rest_shape=more)


def _added(
    rows: Rows, share: float, mode: Callable[[Array], Array], value_at: Callable[[Array], Array], steep: float = 0.0
) -> Rows:
    # Add a mode to the rows of a table of the rest shape.
    # ``rows``: the table, with a fraction of the beam's length and a value in each row. ``share``: length of the
    # flexible part divided by the length of the beam. ``value_at``: function that gives the value of the table at any
    # fraction. ``steep``: least distance of a new row from a step, divided by the change of the value at the step.
    if rows:
        at, values = np.array(rows).T
        if len(at) < _STATIONS:
            inner = np.linspace(0, 1, _STATIONS)
            far = np.abs(inner[:, None] - at).min(axis=1) > 0.25 / _STATIONS
            for (step, before), (end, after) in pairwise(rows):
                if end <= step:
                    far &= np.abs(inner - step) > steep * abs(after - before)
            at, values = np.concatenate([at, inner[far]]), np.concatenate([values, value_at(inner[far])])
            order = np.argsort(at, kind="stable")
            at, values = at[order], values[order]
    else:
        at = np.linspace(0, share, _STATIONS)
        values = np.zeros(len(at))
    added = values + mode(np.minimum(at / share, 1.0))
    return tuple(zip(at.tolist(), added.tolist(), strict=True))


def bend_offset(bends_mm: Sequence[float] | Array, along: Array) -> Array:
    """Return the offset of the centre line due to modes of bending, in mm."""
    # ``bends_mm``: largest offset in each mode. ``along`` (n,): arc length divided by the length of the flexible part.
    return sum((a * _turn(i, along, 1) for i, a in enumerate(bends_mm)), start=np.zeros(len(along)))


def _turn(i: int, x: Array, integrals: int = 0) -> Array:
    # The angle (``integrals`` 0) or the offset (1) of the centre line in bending mode ``i``. The largest offset is 1.
    # ``x``: arc length. Arc length and offset are divided by the length of the flexible part.
    turn = Legendre.basis(i, domain=[0.0, 1.0]).integ(lbnd=0.0)
    offset = turn.integ(lbnd=0.0)
    return np.asarray((offset if integrals else turn)(x) / np.abs(offset(np.linspace(0, 1, 101))).max())
