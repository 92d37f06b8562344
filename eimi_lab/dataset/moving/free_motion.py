"""Find the part of a recording in which the beam moves freely: from its release to the end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.time.measured import Motion
from eimi_lab.dataset.moving.flicks import FEWEST_PERIODS, parts_of
from eimi_lab.dataset.moving.motion_facts import MotionFacts
from eimi_lab.process.errors import InputError, tell

Array = NDArray[np.float64]

FEWEST_FRAMES = 8
_NEAR_GREATEST = 0.97  # share of the greatest deflection; 0.04 periods after its release a beam is below this share
_AT_THE_END = 4  # divisor: the last quarter of a recording shows where the beam comes to rest
_GAP = 1.5  # in units of the usual interval between frames: in a longer interval frames were lost


def free_motions(
    points_mm: Array, rest_mm: Array, time_s: Array, sigma_mm: Array, facts: MotionFacts, origin: str
) -> tuple[Motion, ...]:
    """Return the free motions in a recording, one for each brief push of the beam; for creep, the whole recording.

    If the user gives the time of the release, only the motion after this release is returned.

    Parameters
    ----------
    points_mm, rest_mm, time_s, sigma_mm
        Positions (n, p, 2) of p points in n frames, positions at rest (p, 2), times (n, p) and standard uncertainties
        (n, p), in mm and s, with x along the straight beam from the clamp, and y across.
    facts : MotionFacts
        Facts about the recording that the user gives, such as the time of the release.
    origin : str
        Name of the recording in messages.

    Raises
    ------
    InputError
        If the times do not increase, if no point was found, or if there are too few frames.
    """
    if facts.kind == "creep" and not (facts.hanging_N or facts.removed_N):
        tell(
            f"note: {origin}: a fit uses creep only after a known change of the load; give the weight that was hung on "
            "the beam with --hanging, or the weight that was taken from it with --removed"
        )
    frame_s, released_s = time_s.min(axis=1), facts.released_s
    alone = facts.kind != "ring_down" or len(frame_s) < FEWEST_FRAMES or not (np.diff(frame_s) > 0).all()
    parts = [(0, len(frame_s))] if alone else parts_of(frame_s, points_mm)
    if released_s is not None:
        end = next((last for _, last in parts if frame_s[last - 1] > released_s), len(frame_s))
        if end < len(frame_s):
            tell(f"note: {origin}: the motion ends at {frame_s[end - 1]:.4g} s, because the beam is moved again")
        parts = [(0, end)]
    elif len(parts) == 1 and parts[0] != (0, len(frame_s)):
        first, last = parts[0]
        tell(
            f"note: {origin}: the beam was moved several times; only the ring-down from {frame_s[first]:.4g} to "
            f"{frame_s[last - 1]:.4g} s is long enough, so only this ring-down is stored"
        )
    if len(parts) > 1:
        tell(
            f"note: {origin}: {len(parts)} ring-downs of at least {FEWEST_PERIODS:g} periods were found, and each "
            "ring-down is stored; to store only one ring-down, give the time of its release with --released"
        )
    return tuple(
        free_motion(
            points_mm[first:last],
            rest_mm,
            time_s[first:last],
            sigma_mm[first:last],
            facts,
            f"{origin}: flick {number}" if len(parts) > 1 else origin,
        )
        for number, (first, last) in enumerate(parts, start=1)
    )


def free_motion(
    points_mm: Array, rest_mm: Array, time_s: Array, sigma_mm: Array, facts: MotionFacts, origin: str
) -> Motion:
    """Return the motion of the beam after its release, with times from the release.

    If the user gives no time of release, the last frame with at least 97 % of the largest deflection is used.

    Parameters
    ----------
    points_mm : ndarray, shape (n, p, 2)
        Positions of p points in n frames (x along the straight beam from the clamp, y across); NaN for a missing point.
    rest_mm : ndarray, shape (p, 2)
        Positions in the undeformed beam.
    time_s : ndarray, shape (n, p)
        Times of the points since the beginning of the recording, s.
    sigma_mm : ndarray, shape (n, p)
        Standard uncertainty of one coordinate, mm.
    facts : MotionFacts
        Facts about the recording that the user gives, such as the time of the release.
    origin : str
        Name of the recording in messages.

    Raises
    ------
    InputError
        If the times do not increase, if no point was found, or if there are too few frames.
    """
    frame_s = time_s.min(axis=1)
    steps_s = np.diff(frame_s)
    if len(frame_s) < FEWEST_FRAMES:
        raise InputError(f"{origin}: has {len(frame_s)} frames; a motion needs at least {FEWEST_FRAMES} frames")
    if not (steps_s > 0).all():
        at = int(np.argmin(steps_s > 0))
        raise InputError(
            f"{origin}: frame {at + 1} (counted from 0) has the time {frame_s[at + 1]:g} s, which should be later than "
            f"{frame_s[at]:g} s; give --rate if the file has no times"
        )
    if not np.isfinite(points_mm).all(axis=2).any():
        raise InputError(f"{origin}: no frame has a point of the beam; check the calibration and the file of points")
    period_s = float(np.median(steps_s))
    first = _stated_release(frame_s, facts, origin) if facts.released_s is not None else _release(points_mm)
    released_s = float(frame_s[first]) if facts.released_s is None else facts.released_s
    if len(frame_s) - first < FEWEST_FRAMES:
        raise InputError(
            f"{origin}: only {len(frame_s) - first} frames follow the release at {released_s:g} s; a motion needs at "
            f"least {FEWEST_FRAMES}; if the release was earlier, give its time with --released"
        )
    if facts.released_s is None:
        tell(
            f"note: {origin}: the release is assumed at {released_s:.4g} s, in the last frame with at least "
            f"{_NEAR_GREATEST:.0%} of the largest deflection; if this is wrong, give the time with --released"
        )
    lost = np.where(steps_s[first:] > _GAP * period_s, np.rint(steps_s[first:] / period_s) - 1, 0).sum()
    return Motion(
        kind=facts.kind,
        points_mm=points_mm[first:],
        rest_mm=rest_mm,
        time_s=time_s[first:] - released_s,
        sigma_mm=sigma_mm[first:],
        exposure_s=facts.exposure_s,
        step_uncertainty_s=period_s if facts.released_s is None else period_s / np.sqrt(12.0),
        lost_frames=int(lost) if facts.kind == "ring_down" else 0,  # in creep the intervals grow on purpose
        tip_force_N=facts.removed_N,
        hanging_N=facts.hanging_N,
        label=origin,
    )


def _stated_release(frame_s: Array, facts: MotionFacts, origin: str) -> int:
    released_s = facts.released_s or 0.0
    if not 2 * frame_s[0] - frame_s[1] <= released_s < frame_s[-1]:  # the rows of a frame are later than the frame
        raise InputError(
            f"--released {released_s:g}: should be a time within {origin}, from {frame_s[0]:g} to {frame_s[-1]:g} s"
        )
    return int(np.argmax(frame_s >= released_s))


def _release(points_mm: Array) -> int:
    """Return the number of the last frame with at least 97 % of the largest deflection, for points (n, p, 2)."""
    moved = np.nanstd(points_mm, axis=0).sum(axis=1)
    place = points_mm[:, int(np.nanargmax(moved))]
    visible = place[np.isfinite(place).all(axis=1)]
    deflection = np.hypot(*(place - visible[-(len(visible) // _AT_THE_END + 1) :].mean(axis=0)).T)
    near = np.flatnonzero(deflection >= _NEAR_GREATEST * np.nanmax(deflection))
    return int(near[-1])
