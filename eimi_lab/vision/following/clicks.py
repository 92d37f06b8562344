"""Compare the path along which the beam was followed with the points that a person clicked on the beam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.centre_line import CLICKED_PX
from eimi_lab.vision.following.follow import FollowedBeam

Array = NDArray[np.float64]

_FARTHEST = 99.0  # widths: reported if nothing was followed


def with_clicks(followed: FollowedBeam, clicks: Array, width_px: float) -> FollowedBeam:
    """Compare the path along which a beam was followed with points that a person clicked.

    Parameters
    ----------
    followed : FollowedBeam
        The result of following.
    clicks : ndarray, shape (n, 2)
        The n clicked points, px.
    width_px : float
        Width of the beam according to the specimen file.

    Returns
    -------
    FollowedBeam
        The result, in which ``findings["followed_click"]`` is the largest distance of a click from the path, minus
        10 px (the error of a click), at least 0, in widths of the beam. Unchanged if the beam was too narrow to be
        followed.
    """
    path = followed.path_px
    if "followed_px" in followed.findings:
        return followed
    distance = off_path(path, clicks) if len(path) > 1 else np.full(len(clicks), np.inf)
    worst = int(distance.argmax())
    off = "no body as wide as width_mm could be followed through the points"
    if np.isfinite(distance[worst]):
        # without coordinates, because `clicks` may count them from the corner of a region
        off = f"point {worst + 1} lies {distance[worst]:.0f} px from the body that was followed"
    beyond = max(0.0, float(distance[worst]) - CLICKED_PX) / width_px
    findings = followed.findings | {"followed_click": min(beyond, _FARTHEST)}
    return replace(followed, findings=findings, words=followed.words | {"clicks_off": off})


def off_path(path: Array, clicks: Array) -> Array:
    """Return the distance of each clicked point from a path, px."""
    begin, step = path[:-1], np.diff(path, axis=0)
    offset = clicks[:, None] - begin
    share = np.clip((offset * step).sum(axis=2) / np.maximum((step**2).sum(axis=1), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(offset - share[..., None] * step, axis=2).min(axis=1))
