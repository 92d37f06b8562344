"""The rows of the table of flags for edges that were followed from the clamp (see `following`).

The *followed path* is the stretch of the beam from the clamp to where the search ended. An edge is *sure* at a place
where `following.support` accepts it.
"""

from __future__ import annotations

import math

from eimi_lab.vision.check import Check, Severity

FOLLOWED = (
    Check(
        name="TOO_NARROW",
        finding="followed_px",
        quantity="width of a beam without a silhouette, px",
        limit=6.0,
        below=True,
        remedy="Move the camera nearer or use a longer lens: the beam is {narrow_px} px wide and should be at least 6.",
        picture="a coloured beam 5 px wide on cloth",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_click",
        quantity="distance of the farthest clicked point from the followed path, beyond 10 px, in beam widths",
        limit=0.5,
        remedy="Correct --along: {clicks_off}.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_length",
        quantity="length over which the beam was followed from its clamp, share of its stated length",
        limit=0.55,
        below=True,
        remedy="Look in the overlay where the search ended; check clamp_midpoint_px, axis_angle_deg, width_mm and "
        "pixels_per_mm, and put something of another colour behind the beam.",
        picture="two thirds of a beam behind a plate",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_stretch",
        quantity="length over which the beam was followed, if both edges are clear and have no gap",
        limit=0.55,
        below=True,
        remedy="Only this part of the beam is used: see in the overlay what covers the rest, and check length_mm.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.4,
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_sides",
        quantity="share of the followed path on which the worse edge is sure, if long stretches are not",
        limit=0.7,
        below=True,
        remedy="See in the overlay which edge is lost, and put something of another colour behind the beam there.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_patches",
        quantity="share of the followed path on which the worse edge is sure, if no gap is a tenth of the path",
        limit=0.7,
        below=True,
        remedy="Check in the overlay that the sure places lie on the edge; an even background and light from the sides "
        "show more of it.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.4,
        widens=lambda share: 0.05 * (1.0 - share),
        widens_in="width",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_contrast",
        quantity="difference between the colours on both sides of the worse edge, in standard deviations",
        limit=3.0,
        below=True,
        remedy="Put something even and of another colour behind the beam, and light it evenly.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_gain",
        quantity="mean evidence for the beam along the followed path, at most 1.2",
        limit=0.2,
        below=True,
        remedy="Put something even and of another colour behind the beam: the evidence for the followed body is weak.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_faint",
        quantity="mean evidence for the beam, if both edges are sure without a gap from the clamp to the tip",
        limit=0.2,
        below=True,
        remedy="Check in the overlay that the edges are those of the beam: the evidence is weak; put something even "
        "and of another colour behind the beam.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.0,
        widens=lambda gain: 0.1 * (0.2 - gain),
        widens_in="width",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_begin",
        quantity="distance from the clamp to the first place at which both edges are sure, in beam widths",
        limit=1.5,
        remedy="Check clamp_midpoint_px and axis_angle_deg: the beam must begin there.",
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="followed_width",
        quantity="absolute logarithm of the followed width over the specimen's width",
        limit=0.1,  # the error of a width read by eye; a hard shadow widens a beam by as much
        remedy="Check width_mm and pixels_per_mm: the followed body is another one, or includes its shadow, or the "
        "beam has another width.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.21,
        widens=lambda share: 0.5 * share,  # half of the deviation at each edge
        widens_in="width",
    ),
    Check(
        name="LENGTH_ANOMALY",
        finding="followed_beyond",
        quantity="length over which a body was followed beyond the end of the beam, share of the stated length",
        limit=1.15,
        remedy="Check length_mm and pixels_per_mm; check in the overlay that the followed body is the beam, and look "
        "what is behind its tip.",
        severity=Severity.DOUBTFUL,
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="followed_narrowing",
        quantity="relative narrowing of the followed body toward its tip",
        limit=0.4,
        remedy="Check in the overlay what was followed: a beam of one width does not taper this much.",
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="followed_change",
        quantity="relative difference of the followed body's widest and narrowest fifths",
        limit=0.08,
        remedy="Check in the overlay whether the border of a shadow or another body was taken for an edge; a lens at a "
        "short distance also shows a beam wider where it is nearer.",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.25 * share,  # at each edge, as a mean along the beam
        widens_in="width",
    ),
    Check(
        name="OWN_SHADOW",
        finding="followed_shadow",
        quantity="RMS distance between edges and the borders of possible shadows, px",
        limit=0.0,
        remedy="Check in the overlay that the edges are those of the beam, not of its shadow and not of a layer inside "
        "it; move the lamp, or move the background farther back.",
        picture="a beam on its own shadow",
        severity=Severity.DOUBTFUL,
        widens=lambda px: 0.5 * px,  # half the distance between the shadow's border and the beam's edge
    ),
    Check(
        name="OWN_SHADOW",
        finding="followed_penumbra",
        quantity="blur of an edge that may be the border of a shadow, or the excess width if that is larger, px",
        limit=0.0,
        remedy="Check in the overlay whether the softer edge is the border of the beam's own shadow; move the lamp, or "
        "move the background farther back.",
        severity=Severity.DOUBTFUL,
        widens=lambda px: px,  # the distance between the shadow's border and the beam's edge
    ),
    Check(
        name="SATURATED",
        finding="followed_clipped",
        quantity="share of a followed edge that has clipped light on one side",
        limit=0.1,
        remedy="Lower the exposure until neither the beam nor its surroundings are clipped in any colour.",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.5 * math.sqrt(min(share, 1.0)),  # twice the light moved edges by 0.4 to 1.2 px
    ),
    Check(
        name="HOLE_OR_REFLECTION",
        finding="followed_gleam",
        quantity="share of a followed edge that has a clipped reflection on it",
        limit=0.03,
        remedy="Check in the overlay whether the border of the reflection was taken for the edge; shade the beam from "
        "that lamp, or powder the beam.",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.1 * math.sqrt(min(share, 1.0)),  # half of the searched distance
        widens_in="width",
    ),
    Check(
        name="ROOT_AMBIGUOUS",
        finding="followed_rival",
        quantity="evidence for another body, as a share of the evidence for the followed one",
        limit=0.93,
        remedy="Check in the overlay that the beam was followed; state clamp_midpoint_px and axis_angle_deg more "
        "exactly, or cover the other body.",
        picture="two stripes, and the clamp is stated between them",
        severity=Severity.DOUBTFUL,
    ),
    Check(
        name="CORNER_AMBIGUOUS",
        finding="followed_tip",
        quantity="1 if the edges were followed from the clamp, so that the tip is not used",
        limit=0.0,
        remedy="Nothing needs to be done: each edge ends at its last sure place, and a fit compares it up to there.",
        severity=Severity.NOTE,
    ),
    Check(
        name="CLAMP_NOT_FOUND",
        finding="followed_clamp",
        quantity="share of profiles beside a followed beam that show the clamp",
        limit=0.5,
        below=True,
        remedy="Check that clamp_midpoint_px is where the beam leaves its clamp: the picture does not confirm it.",
        severity=Severity.NOTE,
    ),
    Check(
        name="TOUCHES_FRAME",
        finding="followed_out",
        quantity="1 if the beam was followed to the border of the picture",
        limit=0.0,
        remedy="Bring the whole beam into the picture, so that its tip is used too.",
        severity=Severity.NOTE,
    ),
)
