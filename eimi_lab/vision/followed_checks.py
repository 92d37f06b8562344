"""The quality checks of edges that were followed from the clamp."""

from __future__ import annotations

import math

from eimi_lab.vision.check import Check, Severity

FOLLOWED = (
    Check(
        name="TOO_NARROW",
        finding="followed_px",
        quantity="width of a beam that is to be followed from its clamp, px",
        limit=6.0,
        below=True,
        remedy="Move the camera nearer or use a longer lens: the beam is {narrow_px} px wide and should be at least 6 "
        "px wide.",
        picture="a coloured beam 5 px wide on cloth",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_click",
        quantity="distance of the farthest clicked point from the followed path minus 10 px, divided by the width",
        limit=0.5,
        remedy="Correct --along: {clicks_off}.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_length",
        quantity="length of the followed path, share of length_mm, if an edge is unclear or has gaps",
        limit=0.55,
        below=True,
        remedy="See in the overlay where the followed path ends, check clamp_midpoint_px, axis_angle_deg, width_mm and "
        "pixels_per_mm, and put something of another colour behind the beam.",
        picture="two thirds of a beam behind a plate",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_stretch",
        quantity="length of the followed path, share of length_mm, if both edges are clear and without gaps",
        limit=0.55,
        below=True,
        remedy="See in the overlay what covers the rest of the beam, and check length_mm: a fit uses only the followed "
        "part.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.4,
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_sides",
        quantity="share of the followed path on which the less clear edge was found with certainty, if one of its "
        "gaps is a tenth of the path or longer",
        limit=0.7,
        below=True,
        remedy="See in the overlay which edge is lost, and put something of another colour behind the beam there.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_patches",
        quantity="share of the followed path on which the less clear edge was found with certainty, if all of its "
        "gaps are shorter than a tenth of the path",
        limit=0.7,
        below=True,
        remedy="Check in the overlay that the followed lines lie on the edges of the beam, put an even background "
        "behind the beam, and light the beam from the sides.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.4,
        widens=lambda share: 0.05 * (1.0 - share),
        widens_in="width",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_contrast",
        quantity="difference between the colours inside and outside the less clear edge, in standard deviations",
        limit=3.0,
        below=True,
        remedy="Put something even and of another colour behind the beam, and light it evenly.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_gain",
        quantity="mean evidence for the beam along the followed path (at most 1.2), in all cases but the next row",
        limit=0.2,
        below=True,
        remedy="Put something even and of another colour behind the beam: the evidence for the followed body is weak.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_faint",
        quantity="mean evidence for the beam along the followed path, if both edges were found with certainty on 90 "
        "% of it and the path ends near the tip",
        limit=0.2,
        below=True,
        remedy="Check in the overlay that the followed edges belong to the beam, because the evidence is weak, and "
        "put something even and of another colour behind the beam.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.0,
        widens=lambda gain: 0.1 * (0.2 - gain),
        widens_in="width",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_begin",
        quantity="distance from the clamp to the first place at which both edges were found with certainty, minus "
        "a tenth of the followed path, in beam widths, if an edge is unclear or has gaps",
        limit=1.5,
        remedy="Check clamp_midpoint_px and axis_angle_deg: the beam should begin there, but its edges are unclear.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_late",
        quantity="distance from the clamp to the first place at which both edges were found with certainty, minus "
        "a tenth of the followed path, in beam widths, if both edges are clear and without gaps from there on",
        limit=1.5,
        remedy="See in the overlay what hides the edges near the clamp, and check clamp_midpoint_px and "
        "axis_angle_deg: a fit uses only the followed part.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=3.0,
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="followed_width",
        quantity="absolute value of the logarithm of the followed width divided by width_mm",
        limit=0.1,  # the error of a width read by eye; a hard shadow widens a beam by as much
        remedy="Check width_mm and pixels_per_mm, and check in the overlay that neither another body nor the beam with "
        "its shadow was followed.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.21,
        widens=lambda share: 0.5 * share,  # half of the deviation at each edge
        widens_in="width",
    ),
    Check(
        name="LENGTH_ANOMALY",
        finding="followed_beyond",
        quantity="length of the followed path, share of length_mm (more than 1 if it continues beyond the tip)",
        limit=1.15,
        remedy="Check length_mm and pixels_per_mm, and check in the overlay that the beam was followed, and not a body "
        "behind its tip.",
        severity=Severity.DOUBTFUL,
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="followed_narrowing",
        quantity="largest relative decrease of the width between two fifths of the followed path, away from the clamp",
        limit=0.4,
        remedy="Check in the overlay that the beam was followed: a beam of constant width does not become so much "
        "narrower.",
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="followed_change",
        quantity="relative difference between the widths of the widest and the narrowest fifth of the followed path",
        limit=0.08,
        remedy="Check in the overlay whether the border of a shadow or another body was taken for an edge, and move "
        "the camera farther away: from a short distance, the nearer part of a beam looks wider.",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.25 * share,  # at each edge, as a mean along the beam
        widens_in="width",
    ),
    Check(
        name="OWN_SHADOW",
        finding="followed_shadow",
        quantity="RMS distance between the edges and the borders of possible shadows, px",
        limit=0.0,
        remedy="Check in the overlay that the followed edges belong to the beam, and not to its shadow or to a layer "
        "inside the beam, and move the lamp, or move the background farther back.",
        picture="a beam on its own shadow",
        severity=Severity.DOUBTFUL,
        widens=lambda px: 0.5 * px,  # half the distance between the shadow's border and the beam's edge
    ),
    Check(
        name="OWN_SHADOW",
        finding="followed_penumbra",
        quantity="blur of an edge that may be the border of a shadow, or the excess of the width if the excess is "
        "larger, px",
        limit=0.0,
        remedy="Check in the overlay whether the softer edge is the border of the beam's own shadow, and move the "
        "lamp, or move the background farther back.",
        severity=Severity.DOUBTFUL,
        widens=lambda px: px,  # the distance between the shadow's border and the beam's edge
    ),
    Check(
        name="SATURATED",
        finding="followed_clipped",
        quantity="share of a followed edge beside which the picture is clipped, inside or outside the beam",
        limit=0.1,
        remedy="Lower the exposure until neither the beam nor its surroundings are clipped in any colour.",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.5 * math.sqrt(min(share, 1.0)),  # twice the light moved edges by 0.4 to 1.2 px
    ),
    Check(
        name="HOLE_OR_REFLECTION",
        finding="followed_gleam",
        quantity="share of a followed edge on which a clipped reflection lies",
        limit=0.03,
        remedy="Check in the overlay whether the border of a reflection was taken for the edge, and shade the beam "
        "from the lamp, or powder the beam.",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.1 * math.sqrt(min(share, 1.0)),  # half of the searched distance
        widens_in="width",
    ),
    Check(
        name="ROOT_AMBIGUOUS",
        finding="followed_rival",
        quantity="evidence for another body, divided by the evidence for the followed body",
        limit=0.93,
        remedy="Check in the overlay that the beam was followed, and give clamp_midpoint_px and axis_angle_deg more "
        "exactly, or cover the other body.",
        picture="two stripes, and a clamp_midpoint_px between them",
        severity=Severity.DOUBTFUL,
    ),
    Check(
        name="CORNER_AMBIGUOUS",
        finding="followed_tip",
        quantity="1 if the edges were followed from the clamp; the tip is then not used",
        limit=0.0,
        remedy="Nothing needs to be done: each followed edge ends at the last place at which it was found with "
        "certainty, and a fit uses the edge up to this place.",
        severity=Severity.NOTE,
    ),
    Check(
        name="CLAMP_NOT_FOUND",
        finding="followed_clamp",
        quantity="share of the grey-value profiles beside a followed beam that show the edge of the clamp",
        limit=0.5,
        below=True,
        remedy="Check that the beam leaves its clamp at clamp_midpoint_px: the picture does not show the clamp there.",
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
