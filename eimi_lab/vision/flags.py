"""Every flag in one table: what is measured, its limit, how grave it is, what to do, and what its picture shows.

A state with an unusable flag is left out of a fit. One with a doubtful flag is used, and its points count for less: by
as much as the check measured. A note is for a person to read.

A new flag is an entry here, its value where it is measured, and its picture in `benchmarks/flag_pictures.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from eimi_lab.vision.check import Check, Flag, Severity
from eimi_lab.vision.followed_checks import FOLLOWED


def _moved_px(ratio: float) -> float:
    """By how far a beam moved between frames whose difference is so many times what their noise gives.

    A fifth of a pixel gave 2.3, a twentieth 1.06: the difference goes with the square.
    """
    return math.sqrt(max(ratio - 1.0, 0.0) / 30.0)


# In the order in which one would look into them: first those of one image, then those between the frames of a state.
CHECKS = (
    Check(
        name="LOW_CONTRAST",
        finding="contrast",
        quantity="step at the edge, share of full scale",
        limit=0.2,
        below=True,
        remedy="Brighten the back-light or the exposure, and check that the beam hangs where "
        "clamp_midpoint_px and axis_angle_deg say.",
        picture="a back-light of 12 % of full scale",
        severity=Severity.NOTE,  # its noise is in the points' scatter already
        unusable_beyond=0.03,
    ),
    Check(
        name="SATURATED",
        finding="saturated_share",
        quantity="share of the back-light (or of the lit beam) that is clipped",
        limit=0.01,
        remedy="Lower the exposure or the gain until the back-light stays below 90 % of full scale.",
        picture="a back-light of 120 % of full scale",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.3 * math.sqrt(min(share, 1.0)),  # all of it clipped moves each edge inward by 0.26 px
    ),
    Check(
        name="GAMMA",
        finding="gamma",
        quantity="the camera's gamma, from the lopsidedness of the edges",
        limit=1.3,
        remedy="Switch the camera's gamma (and tone curve) off, so that grey values are proportional to light.",
        picture="a camera with gamma 2.2",
        severity=Severity.DOUBTFUL,
        widens=lambda gamma: 0.4 * (gamma - 1.0),  # 2.2 moves each edge by 0.46 px
    ),
    Check(
        name="CLAMP_NOT_FOUND",
        finding="clamp_seen",
        quantity="share of profiles beside the beam that show the clamp",
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
        quantity="clamp's distance from its calibrated place, mm",
        limit=0.1,
        remedy="Calibrate again, or correct clamp_midpoint_px: the beam leaves its clamp so many millimetres from "
        "there.",
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
        remedy="Calibrate again, and see that calibrated_on is right: the calibration was this many days old.",
        severity=Severity.NOTE,
    ),
    Check(
        name="TOUCHES_FRAME",
        finding="touches_frame",
        quantity="whether the beam leaves the picture",
        limit=0.0,
        remedy="Bring the whole beam into the picture.",
        picture="the picture's lower third is missing",
    ),
    Check(
        name="MULTI_CONTOUR",
        finding="other_bodies",
        quantity="other dark bodies within reach",
        limit=0.0,
        remedy="Clear everything dark but the beam and its clamp from in front of the back-light.",
        picture="a ball beside the beam",
        severity=Severity.NOTE,
    ),
    Check(
        name="HOLE_OR_REFLECTION",
        finding="hole_share",
        quantity="largest bright patch in the beam, share of its width squared",
        limit=0.002,
        remedy="Shade the beam from light in front of it, and look for holes and bubbles through which the light "
        "comes.",
        picture="a bright spot on the beam",
        severity=Severity.NOTE,  # one that touches an edge shows in EDGE_RESIDUAL
    ),
    Check(
        name="CORNER_AMBIGUOUS",
        finding="corner_turn_deg",
        quantity="turn of the outline at the less clear corner of the tip, degrees",
        limit=55.0,
        below=True,
        remedy="Look at the tip: cut it square, clean it, and keep its both corners in the picture.",
        picture="a round tip",
        severity=Severity.NOTE,  # the long edges count without a tip, but there has to be one
        unusable_beyond=10.0,
    ),
    Check(
        name="DEFOCUS",
        finding="blur_px",
        quantity="blur, px",
        limit=2.5,
        remedy="Focus on the beam's middle plane, or stop the lens down.",
        picture="a blur of 4 px",
        severity=Severity.NOTE,  # measured up to 4 px: no bias, and the scatter says the rest
        unusable_beyond=8.0,
    ),
    Check(
        name="EDGE_RESIDUAL",
        finding="residual",
        quantity="what a blurred step leaves of a profile, share of the step",
        limit=0.03,
        remedy="Look for dirt, reflections or anything else at the edges, and keep them clear of the picture's border; "
        "average more frames if the image is noisy, and give --flat where pixels or light are uneven.",
        picture="dirt on the left edge",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.15,
        widens=lambda share: 4.0 * share,  # over the slope of a step that is blurred by 1.6 px
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="width_deviation",
        quantity="departure from the specimen's width (beyond 0.5 there are no edges)",
        limit=0.05,
        remedy="Check width_mm and pixels_per_mm, look for dirt or another body at it, and see that it does not twist"
        "{even_turn}.",
        picture="a specimen stated 10 % too wide",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.15,
        widens=lambda share: 0.5 * share,  # of either edge
        widens_in="width",
    ),
    *FOLLOWED,
    Check(
        name="TWIST",
        finding="twist_deg",
        quantity="turn of the tip about the beam's axis, degrees",
        limit=1.5,
        remedy="Mount the beam so that it bends in the image's plane; a twist of so many degrees alone makes "
        "a fitted modulus {twist_effect} % wrong, and beside it tells of a load out of the plane.",
        picture="a tip turned by 2 degrees",
        severity=Severity.DOUBTFUL,
        unusable_beyond=10.0,
        widens=lambda turn_deg: 0.5 * math.sin(math.radians(turn_deg)),  # of either edge at the tip
        widens_in="depth",
    ),
    Check(
        name="LENGTH_ANOMALY",
        finding="length_deviation",
        quantity="departure from the specimen's length",
        limit=0.10,
        remedy="Check length_mm and pixels_per_mm, and that nothing hides a part of the beam.",
        picture="a specimen stated 13 % too long",
        severity=Severity.NOTE,
        unusable_beyond=0.25,
    ),
    Check(
        name="DROPPED",
        finding="missing_frames",
        quantity="frames missing between neighbours of a state",
        limit=0.0,
        remedy="Lower the camera's frame rate or free its bus of other devices.",
        picture="frames numbered 1, 2, 5",
        severity=Severity.NOTE,
    ),
    Check(
        name="DROPPED",
        finding="damaged_frames",
        quantity="frames of a state that are damaged in the file (`eimi recover`)",
        limit=0.0,
        remedy="The file was damaged after it was written: measure the state again, and copy datasets to another disk.",
        severity=Severity.NOTE,
    ),
    Check(
        name="DUPLICATE",
        finding="repeated_frames",
        quantity="frames equal bit for bit to the one before",
        limit=0.0,
        remedy="Check that the camera delivers new frames, not one of them again.",
        picture="the third frame is the second",
        severity=Severity.NOTE,
    ),
    Check(
        name="DUPLICATE",
        finding="repeated_images",
        quantity="imported images equal bit for bit to the last one of the state before",
        limit=0.0,
        remedy="Look for the right image: {image} is, bit for bit, the one before it, of another load.",
    ),
    Check(
        name="NOT_SETTLED",
        finding="settling_ratio",
        quantity="while waiting, difference of frames over what their noise gives (limit: the protocol's)",
        limit=1.2,
        remedy="Raise settle.timeout_s in the protocol, or shield the beam from draught and vibration.",
        picture="the beam moves from frame to frame",
        severity=Severity.DOUBTFUL,
        unusable_beyond=30.0,
        widens=_moved_px,
    ),
    Check(
        name="NOT_SETTLED",
        finding="motion_ratio",
        quantity="difference of a state's imported images over what their noise gives",
        limit=1.2,  # at rest it is 1; a twentieth of a pixel of motion gives 1.06, a fifth 2.3
        remedy="Take the frames of a state after the beam has come to rest, and shield it from draught and vibration.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=30.0,
        widens=_moved_px,
    ),
)
CHECK_OF = {check.finding: check for check in CHECKS}


def judge(
    findings: Mapping[str, float],
    limits: Mapping[str, float] | None = None,
    words: Mapping[str, str] | None = None,
) -> tuple[Flag, ...]:
    """The flags that findings raise, in the table's order; what was not measured raises none.

    findings, limits: by the names of the table; limits in place of the table's. words: for the braces of the remedies.
    Raises KeyError for a name that is not in the table.
    """
    limits = limits or {}
    if unknown := (findings.keys() | limits.keys()) - CHECK_OF.keys():
        raise KeyError(f"the table of flags has no {', '.join(sorted(unknown))}")
    flags = []
    for check in CHECKS:
        value, limit = findings.get(check.finding), limits.get(check.finding, check.limit)
        if value is not None and (value < limit if check.below else value > limit):
            flags.append(check.flag(value, limit, **(words or {})))
    return tuple(flags)
