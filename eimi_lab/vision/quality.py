"""What speaks against a frame: measured values, their limits, and what to do about each."""

from __future__ import annotations

from dataclasses import dataclass

from eimi_lab.vision.dimensions import stiffening_by_twist
from eimi_lab.vision.edge_set import Flag


@dataclass(frozen=True)
class Limits:
    """The values at which a frame is flagged. `Findings` says what each is measured against."""

    saturated_share: float = 0.01
    contrast: float = 0.2
    blur_px: float = 2.5
    residual: float = 0.03
    clamp_seen: float = 0.5
    corner_turn_deg: float = 55.0
    width_deviation: float = 0.05
    length_deviation: float = 0.10
    hole_share: float = 0.002
    gamma: float = 1.3
    twist_deg: float = 1.5
    clamp_offset_mm: float = 0.1
    calibration_age_days: float = 90.0


@dataclass(frozen=True)
class Findings:
    """What was measured on a frame; None where the search did not come that far.

    saturated_share: of the back-light beside the edges, the part above `SATURATION_LEVEL` of full scale.
    contrast: step from beam to back-light, as a share of full scale. blur_px: standard deviation of the
    edges' blur. residual: what a blurred step leaves of an edge profile (RMS, as a share of the step), 19 of
    20 profiles leave less. clamp_seen: share of the profiles beside the beam that show the clamp line.
    corner_turn_deg: turn of the outline at the less clear corner of the tip. width_deviation,
    length_deviation: from the specimen's, as a share of it. hole_share: the largest bright patch inside the beam, as a
    share of its width squared. gamma: of the camera (`response`). twist_deg: of the tip about the beam's axis.
    even_turn_deg: of the whole beam about its axis, were that why it looks wide.
    clamp_offset_mm: from the calibration's clamp midpoint to where the beam leaves its clamp.
    """

    contrast: float
    clamp_seen: float
    saturated_share: float | None = None
    blur_px: float | None = None
    residual: float | None = None
    touches_frame: bool | None = None
    other_bodies: int | None = None
    corner_turn_deg: float | None = None
    width_deviation: float | None = None
    length_deviation: float | None = None
    hole_share: float | None = None
    gamma: float | None = None
    twist_deg: float | None = None
    even_turn_deg: float | None = None
    clamp_offset_mm: float | None = None
    calibration_age_days: float | None = None


_MOST_TURN_DEG = 15.0  # beyond, nobody would take it for a twist
SATURATION_LEVEL = 0.985  # of full scale: noise reaches the limit before the mean does


def judge(findings: Findings, limits: Limits, width_mm: float, depth_mm: float) -> tuple[Flag, ...]:
    """The flags of a frame, in the order in which one would look into them; width and depth are the specimen's."""
    twist, even = findings.twist_deg or 0.0, findings.even_turn_deg or 0.0
    stiffer = 100.0 * stiffening_by_twist(0.0, twist, width_mm, depth_mm)
    too_wide = (
        f": a turn of {even:.1f} degrees about its axis all along would look so wide, and make a fitted modulus "
        f"{100.0 * stiffening_by_twist(even, even, width_mm, depth_mm):+.2g} % wrong"
    )
    checks: list[tuple[str, float | None, float, bool, str]] = [
        (
            "LOW_CONTRAST",
            findings.contrast,
            limits.contrast,
            True,
            "Brighten the back-light or the exposure, and check that the beam hangs where "
            "clamp_midpoint_px and axis_angle_deg say.",
        ),
        (
            "SATURATED",
            findings.saturated_share,
            limits.saturated_share,
            False,
            "Lower the exposure or the gain until the back-light stays below 90 % of full scale.",
        ),
        (
            "GAMMA",
            findings.gamma,
            limits.gamma,
            False,
            "Switch the camera's gamma (and tone curve) off, so that grey values are proportional to light.",
        ),
        (
            "CLAMP_NOT_FOUND",
            findings.clamp_seen,
            limits.clamp_seen,
            True,
            "Make the clamp's edge visible on both sides of the beam, or correct clamp_midpoint_px and axis_angle_deg.",
        ),
        (
            "CALIBRATION_STALE",
            findings.clamp_offset_mm,
            limits.clamp_offset_mm,
            False,
            "Calibrate again, or correct clamp_midpoint_px: the beam leaves its clamp so many millimetres from there.",
        ),
        (
            "CALIBRATION_STALE",
            findings.calibration_age_days,
            limits.calibration_age_days,
            False,
            "Calibrate again, and see that calibrated_on is right: the calibration was this many days old.",
        ),
        (
            "TOUCHES_FRAME",
            findings.touches_frame,
            0.0,
            False,
            "Bring the whole beam into the picture.",
        ),
        (
            "MULTI_CONTOUR",
            findings.other_bodies,
            0.0,
            False,
            "Clear everything dark but the beam and its clamp from in front of the back-light.",
        ),
        (
            "HOLE_OR_REFLECTION",
            findings.hole_share,
            limits.hole_share,
            False,
            "Shade the beam from light in front of it, and look for holes and bubbles through which the light comes.",
        ),
        (
            "CORNER_AMBIGUOUS",
            findings.corner_turn_deg,
            limits.corner_turn_deg,
            True,
            "Look at the tip: cut it square, clean it, and keep its both corners in the picture.",
        ),
        (
            "DEFOCUS",
            findings.blur_px,
            limits.blur_px,
            False,
            "Focus on the beam's middle plane, or stop the lens down.",
        ),
        (
            "EDGE_RESIDUAL",
            findings.residual,
            limits.residual,
            False,
            "Look for dirt, reflections or anything else at the edges, and keep them clear of the picture's border; "
            "average more frames if the image is noisy, and give --flat where pixels or light are uneven.",
        ),
        (
            "WIDTH_ANOMALY",
            findings.width_deviation,
            limits.width_deviation,
            False,
            "Check width_mm and pixels_per_mm, look for dirt or another body at it, and see that it does not twist"
            f"{too_wide if 0.0 < even < _MOST_TURN_DEG else ''}.",
        ),
        (
            "TWIST",
            findings.twist_deg,
            limits.twist_deg,
            False,
            "Mount the beam so that it bends in the image's plane; a twist of so many degrees alone makes "
            f"a fitted modulus {stiffer:+.2g} % wrong, and beside it tells of a load out of the plane.",
        ),
        (
            "LENGTH_ANOMALY",
            findings.length_deviation,
            limits.length_deviation,
            False,
            "Check length_mm and pixels_per_mm, and that nothing hides a part of the beam.",
        ),
    ]
    return tuple(
        Flag(name, float(value), limit, remedy)
        for name, value, limit, is_floor, remedy in checks
        if value is not None and (value < limit if is_floor else value > limit)
    )
