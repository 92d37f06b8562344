"""Describe a measured motion of the beam by the amplitudes of vibration modes of a uniform cantilever.

A mode is cosh βξ - cos βξ - σ (sinh βξ - sin βξ), with ξ = distance from the clamp / length, a root β of
cos β cosh β = -1, and σ = (cosh β + cos β) / (sinh β + sin β) (R. D. Blevins, Formulas for natural frequency and mode
shape, 1979, table 8-1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.time.measured import Motion

Array = NDArray[np.float64]

ROOTS = (1.8751040687, 4.6940911330, 7.8547574382)


def cantilever_modes(share: Array) -> Array:
    """Return the shapes of the first three vibration modes of a uniform cantilever at p points along the beam.

    Parameters
    ----------
    share : ndarray, shape (p,)
        Distances of the points from the clamp, divided by the length.

    Returns
    -------
    ndarray, shape (p, 3)
        Deflection of the three modes (columns) at the points (rows); 1 at the tip.

    Examples
    --------
    >>> cantilever_modes(np.array([0.5, 1.0])).round(3).tolist()
    [[0.34, -0.714, 0.02], [1.0, 1.0, 1.0]]
    """
    beta = np.array(ROOTS)
    ratio = (np.cosh(beta) + np.cos(beta)) / (np.sinh(beta) + np.sin(beta))

    def shape(xi: Array) -> Array:
        along = beta * xi[:, None]
        return np.asarray(np.cosh(along) - np.cos(along) - ratio * (np.sinh(along) - np.sin(along)))

    return np.asarray(shape(np.asarray(share, dtype=float)) / shape(np.ones(1)))


def modal_amplitudes_mm(motion: Motion, length_mm: float) -> Array:
    """Return the amplitudes of the cantilever's vibration modes in each frame of a motion (positions over time).

    The modes are fitted by least squares to the deflections from the mean position.

    Parameters
    ----------
    motion : Motion
        The motion of p points in n frames.
    length_mm : float
        Length of the beam.

    Returns
    -------
    ndarray, shape (n, m)
        Deflection of the tip in each of m modes (columns), mm; NaN for a frame with fewer than m points. m is 3 or, if
        smaller, the number of different distances of the points from the clamp.
    """
    modes = cantilever_modes(motion.rest_mm[:, 0] / length_mm)[:, : len(np.unique(motion.rest_mm[:, 0].round(3)))]
    is_seen = motion.seen
    across = np.where(is_seen, motion.points_mm[..., 1], 0.0)
    across = np.where(is_seen, across - across.sum(axis=0) / np.maximum(is_seen.sum(axis=0), 1), 0.0)
    normal = np.einsum("np,pj,pk->njk", is_seen, modes, modes)
    enough = is_seen.sum(axis=1) >= modes.shape[1]
    amplitudes = np.full((len(is_seen), modes.shape[1]), np.nan)
    amplitudes[enough] = np.linalg.solve(
        normal[enough] + 1e-9 * np.eye(modes.shape[1]), (across[enough] @ modes)[..., None]
    )[..., 0]
    return amplitudes


def tip_angles_deg(motion: Motion) -> Array:
    """Return the rotation of the beam's tip in each of the n frames of a recorded motion.

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    ndarray, shape (n,)
        Angle of the line through the two points nearest to the tip, relative to the undeformed beam, degrees from +x
        toward +y; NaN without two such points.
    """
    order = np.argsort(motion.rest_mm[:, 0], kind="stable")[-2:]
    if len(order) < 2 or np.ptp(motion.rest_mm[order, 0]) <= 0.0:
        return np.full(len(motion.time_s), np.nan)
    before, last = (motion.points_mm[:, point] for point in order)
    at_rest = np.subtract(*motion.rest_mm[order][::-1])
    x, y = (last - before).T
    return np.asarray(np.degrees(np.arctan2(y, x) - np.arctan2(at_rest[1], at_rest[0])))
