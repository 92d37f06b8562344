"""The part of the table of flags that is about edges followed from the clamp (`following`)."""

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
        remedy="Go nearer or take a longer lens: the beam is {narrow_px} px wide, and 6 are needed.",
        picture="a coloured beam 5 px wide on cloth",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_length",
        quantity="share of its length over which the beam was followed from its clamp",
        limit=0.55,
        below=True,
        remedy="See in the overlay where it ended; check clamp_midpoint_px, axis_angle_deg, width_mm and "
        "pixels_per_mm, and put something of another colour behind the beam.",
        picture="two thirds of a beam behind a plate",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_sides",
        quantity="share of the way followed on which the worse edge is sure",
        limit=0.7,
        below=True,
        remedy="See in the overlay which edge is lost, and put something of another colour behind the beam there.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_patches",
        quantity="the same, where no stretch without a sure place is a tenth of the way",
        limit=0.7,
        below=True,
        remedy="See in the overlay whether the places that are sure lie on the edge; something even behind the beam, "
        "and light from its sides, would show more of it.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.4,
        widens=lambda share: 0.05 * (1.0 - share),
        widens_in="width",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_contrast",
        quantity="difference of inside and outside along the worse edge, standard deviations of their colours",
        limit=3.0,
        below=True,
        remedy="Put something even and of another colour behind the beam, and light it evenly.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_gain",
        quantity="mean evidence of a step along the beam, of 1.2 at most",
        limit=0.2,
        below=True,
        remedy="Put something even and of another colour behind the beam; so little speaks for what was followed.",
    ),
    Check(
        name="NOT_FOLLOWED",
        finding="followed_begin",
        quantity="widths from the clamp to the first place at which both edges are sure",
        limit=1.5,
        remedy="Check clamp_midpoint_px and axis_angle_deg: the beam is to begin there.",
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="followed_width",
        quantity="logarithm of the followed width over the specimen's, either way",
        limit=0.1,  # an eye's and a ruler's; by so much the hard shadow of a beam makes it wider too
        remedy="Check width_mm and pixels_per_mm: what was followed from the clamp is another body, or has its shadow "
        "in it, or the beam is not as wide as that.",
        severity=Severity.DOUBTFUL,
        unusable_beyond=0.21,
        widens=lambda share: 0.5 * share,  # of either edge
        widens_in="width",
    ),
    Check(
        name="LENGTH_ANOMALY",
        finding="followed_beyond",
        quantity="share of its length over which a body was followed that goes on where the beam is to end",
        limit=1.15,
        remedy="Check length_mm and pixels_per_mm; see in the overlay whether what was followed is the beam, and what "
        "is behind its tip.",
        severity=Severity.DOUBTFUL,
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="followed_narrowing",
        quantity="by which share the followed body becomes narrower toward its tip",
        limit=0.4,
        remedy="Look at what was followed: a beam of one width does not taper so much.",
    ),
    Check(
        name="WIDTH_ANOMALY",
        finding="followed_change",
        quantity="by which share the followed body's widest fifth is wider than its narrowest",
        limit=0.08,
        remedy="See in the overlay whether the border of a shadow, or another body, was taken for an edge; a lens from "
        "near by also shows a beam wider where it is nearer.",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.25 * share,  # of either edge, on the mean along the beam
        widens_in="width",
    ),
    Check(
        name="OWN_SHADOW",
        finding="followed_shadow",
        quantity="by how much the edges were moved off the border of a shadow, root mean square, px",
        limit=0.0,
        remedy="See in the overlay whether the edges are the beam's and not its shadow's: they were found in colours "
        "that a shadow does not change; move the lamp, or the background farther behind the beam.",
        picture="a beam on its own shadow",
        severity=Severity.DOUBTFUL,
        widens=lambda px: 0.5 * px,  # the one or the other: half of their distance
    ),
    Check(
        name="OWN_SHADOW",
        finding="followed_penumbra",
        quantity="blur of a followed edge that may be the soft border of a shadow, or what it makes the beam wider, px",
        limit=0.0,
        remedy="See in the overlay whether one edge is the soft border of the beam's own shadow: the other is sharper; "
        "move the lamp, or the background farther behind the beam.",
        severity=Severity.DOUBTFUL,
        widens=lambda px: px,  # so far from the body's edge the border of a shadow lies that is taken for it
    ),
    Check(
        name="SATURATED",
        finding="followed_clipped",
        quantity="share of a followed edge at which the light on one side of it is clipped",
        limit=0.1,
        remedy="Lower the exposure until neither the beam nor what is beside it is clipped in any colour.",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.5 * math.sqrt(min(share, 1.0)),  # at twice the light, edges moved by 0.4 to 1.2 px
    ),
    Check(
        name="HOLE_OR_REFLECTION",
        finding="followed_gleam",
        quantity="share of a followed edge along which a clipped reflection lies",
        limit=0.03,
        remedy="See in the overlay whether the border of the reflection was taken for the edge; shade the beam from "
        "that lamp, or powder it.",
        severity=Severity.DOUBTFUL,
        widens=lambda share: 0.1 * math.sqrt(min(share, 1.0)),  # half of how far inside a reflection is looked for
        widens_in="width",
    ),
    Check(
        name="ROOT_AMBIGUOUS",
        finding="followed_rival",
        quantity="evidence for another body beside, as a share of that for the one followed from the clamp",
        limit=0.93,
        remedy="See in the overlay whether it is the beam that was followed; give clamp_midpoint_px and axis_angle_deg "
        "more exactly, or cover what is beside it.",
        picture="two stripes, the clamp stated between them",
        severity=Severity.DOUBTFUL,
    ),
    Check(
        name="CORNER_AMBIGUOUS",
        finding="followed_tip",
        quantity="whether the edges were followed from the clamp, and the tip is not used",
        limit=0.0,
        remedy="Nothing is needed: the edges end where they are sure, and are compared as far as they go.",
        severity=Severity.NOTE,
    ),
    Check(
        name="CLAMP_NOT_FOUND",
        finding="followed_clamp",
        quantity="share of profiles beside the beam that show the clamp, where the edges were followed from it",
        limit=0.5,
        below=True,
        remedy="See that clamp_midpoint_px is where the beam leaves its clamp: it is believed as it is.",
        severity=Severity.NOTE,
    ),
    Check(
        name="TOUCHES_FRAME",
        finding="followed_out",
        quantity="whether the beam was followed to the border of the picture",
        limit=0.0,
        remedy="Bring the whole beam into the picture to use its tip too.",
        severity=Severity.NOTE,
    ),
)
