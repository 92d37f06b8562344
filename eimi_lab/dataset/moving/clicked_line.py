"""Make a calibration (clamp, direction of the beam, scale) from points that the user clicked on the beam at rest.

Let ξ be the distance from the clamp divided by the length. A uniform load bends the beam into the shape
(ξ⁴ - 4 ξ³ + 6 ξ²) / 3, and a load at the tip bends the beam into the shape (3 ξ² - ξ³) / 2 (S. Timoshenko, Strength of
Materials, part I, 1955, section 39).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration, Changes, changed_calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import check
from eimi_lab.process.errors import InputError

Array = NDArray[np.float64]

_SCALE_SHARE = 0.03  # relative standard uncertainty of the scale, due to perspective, inaccurate clicks and curvature
_CLICK_PX = 3.0
_AXIS_DEG, _GRAVITY_DEG = 1.0, 2.0
_DOWN_DEG = 90.0
_LEVEL_DEG = 20.0  # largest angle between the line through two clicks on a sagging beam and the axis of the beam
_SHORTEST_PX = 40.0


def clicked_calibration(
    along_px: Sequence[tuple[float, float]], specimen: SpecimenFile, axis_deg: float | None, origin: str
) -> Calibration:
    """Return a calibration from points that the user clicked on the centre line of the beam.

    Gravity is assumed to point down in the picture.

    Parameters
    ----------
    along_px : sequence of (float, float)
        Two to six points, px, from the clamp to the tip.
    specimen : SpecimenFile
        The specimen, whose length gives the scale.
    axis_deg : float, optional
        Direction in which the beam leaves the clamp, degrees clockwise from +x of the picture. By default it is
        computed from the points.
    origin : str
        Name of the recording in messages.

    Raises
    ------
    InputError
        If the number of points is wrong, or if the line through the points is too short or too crooked.
    """
    points = np.array(along_px, float)
    if not 2 <= len(points) <= 6:
        raise InputError(
            f"{origin}: --along has {len(points)} points; give two to six points, from the clamp to the tip"
        )
    length_px = float(np.hypot(*np.diff(points, axis=0).T).sum())
    chord_px = float(np.hypot(*(points[-1] - points[0])))
    if not (length_px >= _SHORTEST_PX and chord_px > 0.5 * length_px):  # NaN is refused, too
        raise InputError(
            f"{origin}: --along: the line through the points is {length_px:.0f} px long and its ends are "
            f"{chord_px:.0f} px apart; the points should follow the beam from the clamp to the tip"
        )
    scale = length_px / specimen.specimen.length_mm
    table = {
        "pixels_per_mm": scale,
        "clamp_midpoint_px": tuple(points[0].tolist()),
        "axis_angle_deg": _direction_deg(points) if axis_deg is None else axis_deg,
        "gravity_angle_deg": _DOWN_DEG,
        "uncertainty": {
            "pixels_per_mm": _SCALE_SHARE * scale,
            "clamp_midpoint_px": _CLICK_PX,
            "axis_angle_deg": _AXIS_DEG,
            "gravity_angle_deg": _GRAVITY_DEG,
        },
        "picture": {"along_px": tuple(map(tuple, points.tolist()))},
    }
    return check(Calibration, table, "", origin)


def clicked_from_changes(changes: Changes, specimen: SpecimenFile, origin: str) -> Calibration:
    """Return a calibration from values on the command line, which include points that were clicked on the beam.

    Parameters
    ----------
    changes : mapping
        Values of a calibration by key, with the points as ``changes["picture"]["along_px"]``.
    specimen : SpecimenFile
        The specimen, whose length gives the scale.
    origin : str
        Name of the recording in messages.

    Raises
    ------
    InputError
        If the points or the other values are wrong.
    """
    calibration = clicked_calibration(changes["picture"]["along_px"], specimen, changes.get("axis_angle_deg"), origin)
    return changed_calibration(calibration, changes)


def _direction_deg(points: Array) -> float:
    """Return the direction in which a beam leaves its clamp, in degrees clockwise from +x of the picture.

    ``points`` contains n points on the centre line, px, shape (n, 2), the first at the clamp.
    """
    from_clamp = points[1:] - points[0]
    chord_deg = float(np.degrees(np.arctan2(*from_clamp[-1][::-1])))
    if len(points) < 3:
        upright = 90.0 * round(chord_deg / 90.0)
        return upright if abs(chord_deg - upright) < _LEVEL_DEG else chord_deg
    ahead, across = _along_and_across(from_clamp, chord_deg)
    turn, _ = np.linalg.lstsq(np.column_stack([ahead, _uniform(ahead / ahead[-1])]), across, rcond=None)[0]
    return chord_deg + float(np.degrees(np.arctan(turn)))


def with_measured_axis(calibration: Calibration, rest_px: Array, along_mm: Array, has_tip_load: bool) -> Calibration:
    """Return a calibration whose axis and clamp are corrected with the measured centre line of the beam at rest.

    With fewer than six measured points, the calibration is returned unchanged.

    Parameters
    ----------
    calibration : Calibration
        The calibration from clicked points.
    rest_px : ndarray, shape (p, 2)
        Points of the centre line at rest; NaN for a missing point.
    along_mm : ndarray, shape (p,)
        Distances of the points from the clamp along the beam.
    has_tip_load : bool
        Whether a weight hangs at the tip.
    """
    is_seen = np.isfinite(rest_px[:, 0])
    if is_seen.sum() < 6:
        return calibration
    clamp, axis_deg = np.array(calibration.clamp_midpoint_px), calibration.axis_angle_deg
    ahead, across = _along_and_across(rest_px[is_seen] - clamp, axis_deg)
    share = along_mm[is_seen] / along_mm.max()
    shapes = [np.ones(len(share)), ahead, _uniform(share)] + ([0.5 * (3 - share) * share**2] if has_tip_load else [])
    offset, turn = np.linalg.lstsq(np.column_stack(shapes), across, rcond=None)[0][:2]
    normal = np.array([-np.sin(np.radians(axis_deg)), np.cos(np.radians(axis_deg))])
    moved = clamp + offset * normal
    places = {
        "clamp_midpoint_px": (float(moved[0]), float(moved[1])),
        "axis_angle_deg": axis_deg + float(np.degrees(np.arctan(turn))),
    }
    return changed_calibration(calibration, places)


def _along_and_across(from_clamp: Array, axis_deg: float) -> tuple[Array, Array]:
    """Return the distances of n points from the clamp along the axis of the beam and across it, px, each (n,).

    ``from_clamp`` (n, 2) are positions relative to the clamp, px. ``axis_deg`` is clockwise from +x of the picture.
    """
    cosine, sine = np.cos(np.radians(axis_deg)), np.sin(np.radians(axis_deg))
    return from_clamp @ np.array([cosine, sine]), from_clamp @ np.array([-sine, cosine])


def _uniform(share: Array) -> Array:
    return np.asarray((share**4 - 4 * share**3 + 6 * share**2) / 3)
