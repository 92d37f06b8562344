"""The table of all quality checks: measured quantity, limit, severity and advice.

To add a flag, add an entry here, measure its value, and add its picture to `benchmarks/flag_pictures.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from eimi_lab.vision.check import Check, Flag, Severity
from eimi_lab.vision.followed_checks import FOLLOWED


def _motion_px(ratio: float) -> float:
    """Return how far (px) the beam moved between two frames, from their mean squared difference relative to noise."""
    # The excess over 1 grows with the square of the motion.
    return math.sqrt(max(ratio - 1.0, 0.0) / 30.0)


# The checks of one image come first, and the checks that compare frames follow. A person would check in this order.
CHECKS = (
    Check(
        name="LOW_CONTRAST",
        finding="contrast",
        quantity="difference between the grey values outside and inside the edge, share of full scale",
        limit=0.2,
        below=True,
        remedy="Use a brighter back-light or a longer exposure, and check that clamp_midpoint_px and axis_angle_deg "
        "give the place and the direction of the beam.",
        picture="a back-light of 12 % of full scale",
        severity=Severity.NOTE,  # the scatter of the points already shows the noise
        unusable_beyond=0.03,
    ),
    Check(
        name="SATURATED",
        finding="saturated_share",
        quantity="share of clipped pixels in the back-light (or in the lit beam)",
        limit=0.01,
        remedy="Lower the exposure or the gain until the back-light stays below 90 % of full scale.",
        picture="a back-light of 120 % of full scale",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.3 * math.sqrt(min(share, 1.0)),  # full clipping moves each edge inward by 0.26 px
    ),
    Check(
        name="GAMMA",
        finding="gamma",
        quantity="gamma of the camera, from the asymmetry of the edges",
        limit=1.3,
        remedy="Switch the camera's gamma (and tone curve) off, so that grey values are proportional to light.",
        picture="a camera with gamma 2.2",
        severity=Severity.DOUBTFUL,
        widens=lambda gamma: 0.4 * (gamma - 1.0),  # a gamma of 2.2 moves each edge by 0.46 px
    ),
    Check(
        name="CLAMP_NOT_FOUND",
        finding="clamp_seen",
        quantity="share of the grey-value profiles beside the beam that show the edge of the clamp",
        limit=0.5,
        below=True,
        remedy="Make the clamp's edge visible on both sides of the beam, or correct clamp_midpoint_px and "
        "axis_angle_deg.",
        picture="no clamp",
        severity=Severity.NOTE,
    ),
    Check(
        name="CALIBRATION_STALE",
        finding="clamp_offset_mm",
        quantity="distance of the clamp from clamp_midpoint_px, mm",
        limit=0.1,
        remedy="Calibrate again, or correct clamp_midpoint_px: the value is the distance in millimetres from this "
        "point to the place where the beam leaves its clamp.",
        picture="a calibration 400 days old",
        severity=Severity.DOUBTFUL,
        widens=lambda offset_mm: offset_mm,
        widens_in="mm",
    ),
    Check(
        name="CALIBRATION_STALE",
        finding="calibration_age_days",
        quantity="age of the calibration when the frames were taken, days",
        limit=90.0,
        remedy="Calibrate again, or check calibrated_on: the value is the age of the calibration in days.",
        severity=Severity.NOTE,
    ),
    Check(
        name="TOUCHES_FRAME",
        finding="touches_frame",
        quantity="1 if the beam reaches the border of the picture",
        limit=0.0,
        remedy="Bring the whole beam into the picture.",
        picture="the picture's lower third is missing",
    ),
    Check(
        name="MULTI_CONTOUR",
        finding="other_bodies",
        quantity="number of other dark bodies in the part of the picture that the beam can reach",
        limit=0.0,
        remedy="Remove every dark body except the beam and its clamp from in front of the back-light.",
        picture="a ball beside the beam",
        severity=Severity.NOTE,
    ),
    Check(
        name="HOLE_OR_REFLECTION",
        finding="hole_share",
        quantity="area of the largest bright patch in the beam, divided by the square of the beam's width",
        limit=0.002,
        remedy="Shade the front of the beam from light, and look for holes and bubbles that let the back-light "
        "through.",
        picture="a bright spot on the beam",
        severity=Severity.NOTE,  # a patch that touches an edge raises EDGE_RESIDUAL
    ),
    Check(
        name="CORNER_AMBIGUOUS",
        finding="corner_turn_deg",
        quantity="angle by which the outline turns at the less sharp corner of the tip, degrees",
        limit=55.0,
        below=True,
        remedy="Cut the tip square, clean it, and keep both corners of the tip in the picture.",
        picture="a round tip",
        severity=Severity.NOTE,  # only the long edges are compared, but the beam must have a tip
        unusable_beyond=10.0,
    ),
    Check(
        name="DEFOCUS",
        finding="blur_px",
        quantity="standard deviation of the blur at the edges, px",
        limit=2.5,
        remedy="Focus on the beam's middle plane, or stop the lens down.",
        picture="a blur of 4 px",
        severity=Severity.NOTE,  # measured up to 4 px: no bias, and the scatter grows with the blur
        unusable_beyond=8.0,
    ),
    Check(
        name="EDGE_RESIDUAL",
        finding="residual",
        quantity="RMS residual of the blurred step fitted to a grey-value profile, share of the height of the step",
        limit=0.03,
        remedy="Remove dirt and reflections at the edges, keep the edges away from the border of the picture, average "
        "more frames if the image is noisy, and give --flat if the pixels or the light are uneven.",
        picture="dirt on the left edge",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.15,
        widens=lambda share: 4.0 * share,  # 4 px is one over the slope of a step that is blurred by 1.6 px
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="width_deviation",
        quantity="relative deviation of the measured width from width_mm (beyond 0.5 no edges are returned)",
        limit=0.05,
        remedy="Check width_mm and pixels_per_mm, look for dirt or another body that touches the beam, and check that "
        "the beam is not turned about its axis{even_turn}.",
        picture="a width_mm that is 10 % too large",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.15,
        widens=lambda share: 0.5 * share,  # half of the deviation at each edge
        widens_in="width",
    ),
    *FOLLOWED,
    Check(
        name="TWIST",
        finding="twist_deg",
        quantity="angle by which the tip is turned about the beam's axis, degrees",
        limit=1.5,
        remedy="Mount the beam so that it bends in the plane of the image: the twist changes a fitted modulus by "
        "{twist_effect} %, and it shows that a load acts out of this plane.",
        picture="a tip turned by 2 degrees",
        severity=Severity.DOUBTFUL,
        unusable_beyond=10.0,
        widens=lambda turn_deg: 0.5 * math.sin(math.radians(turn_deg)),  # at each edge, at the tip
        widens_in="depth",
    ),
    Check(
        name="LENGTH_ANOMALY",
        finding="length_deviation",
        quantity="relative deviation of the measured length from length_mm",
        limit=0.10,
        remedy="Check length_mm and pixels_per_mm, and check that nothing hides a part of the beam.",
        picture="a length_mm that is 13 % too large",
        severity=Severity.NOTE,
        unusable_beyond=0.25,
    ),
    Check(
        name="DROPPED",
        finding="missing_frames",
        quantity="number of frames missing between consecutive frames of a state",
        limit=0.0,
        remedy="Lower the frame rate of the camera, or remove other devices from its bus.",
        picture="frames numbered 1, 2, 5",
        severity=Severity.NOTE,
    ),
    Check(
        name="DROPPED",
        finding="damaged_frames",
        quantity="number of frames of a state that `eimi recover` found damaged in the file",
        limit=0.0,
        remedy="The file was damaged after it was written: measure the state again, and copy datasets to another disk.",
        severity=Severity.NOTE,
    ),
    Check(
        name="DUPLICATE",
        finding="repeated_frames",
        quantity="number of frames that are identical to the previous frame, or whose frame number is not larger than "
        "that of the previous frame",
        limit=0.0,
        remedy="Check that the camera delivers new frames and does not repeat an old one.",
        picture="a third frame that repeats the second",
        severity=Severity.NOTE,
    ),
    Check(
        name="DUPLICATE",
        finding="repeated_images",
        quantity="1 if `eimi import` found that the first image of a state is identical to the last image of the "
        "state before",
        limit=0.0,
        remedy="Import the right image: {image} is identical to the previous image, which belongs to another load.",
    ),
    Check(
        name="NOT_SETTLED",
        finding="settling_ratio",
        quantity="mean squared difference of two frames at the end of the wait, divided by the difference that noise "
        "alone causes (limit in the protocol)",
        limit=1.2,
        remedy="Increase settle.timeout_s in the protocol, or shield the beam from draught and vibration.",
        picture="the beam moves from frame to frame",
        severity=Severity.DOUBTFUL,
        unusable_beyond=30.0,
        widens=_motion_px,
    ),
    Check(
        name="NOT_SETTLED",
        finding="motion_ratio",
        quantity="mean squared difference of two imported images of a state, divided by the difference that noise "
        "alone causes",
        limit=1.2,  # the ratio is 1 at rest, 1.06 for a motion of 1/20 px and 2.3 for 1/5 px
        remedy="Take the frames of a state after the beam has come to rest, and shield the beam from draught and "
        "vibration.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=30.0,
        widens=_motion_px,
    ),
)
CHECK_OF = {check.finding: check for check in CHECKS}


def judge(
    findings: Mapping[str, float],
    limits: Mapping[str, float] | None = None,
    words: Mapping[str, str] | None = None,
) -> tuple[Flag, ...]:
    """Return the flags (failed quality checks) for measured values, in the order of the table of checks.

    Parameters
    ----------
    findings : mapping of str to float
        Measured values, with the keys of the table (`Check.finding`).
    limits : mapping of str to float, optional
        Limits that replace limits of the table, with the same keys.
    words : mapping of str to str, optional
        Texts for the placeholders in the advice.

    Returns
    -------
    tuple of Flag
        The flags; empty if every value is within its limit.

    Raises
    ------
    KeyError
        If `findings` or `limits` has a key that is not in the table.

    Examples
    --------
    >>> [flag] = judge({"blur_px": 3.0, "gamma": 1.1})
    >>> flag.name, flag.value, flag.limit
    ('DEFOCUS', 3.0, 2.5)
    """
    limits = limits or {}
    if unknown := (findings.keys() | limits.keys()) - CHECK_OF.keys():
        raise KeyError(f"no quality check has the key {', '.join(sorted(unknown))}")
    raised = []
    for check in CHECKS:
        value, limit = findings.get(check.finding), limits.get(check.finding, check.limit)
        if value is not None and (value < limit if check.below else value > limit):
            raised.append(check.flag(value, limit, **(words or {})))
    return tuple(raised)
