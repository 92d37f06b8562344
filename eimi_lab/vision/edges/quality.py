"""What an edge pass tells of its picture, by the names that the table of flags has for it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eimi_lab.vision.edges.dimensions import stiffening_by_twist
from eimi_lab.vision.edges.passes import PassResult
from eimi_lab.vision.edges.response import estimate_gamma
from eimi_lab.vision.flags import judge

SATURATION_LEVEL = 0.985  # of full scale: noise reaches the limit before the mean does
_MOST_TURN_DEG = 15.0  # beyond, nobody would take it for a twist


def light_findings(
    found: PassResult, largest: float, lit_beam: bool, limits: Mapping[str, float] | None
) -> dict[str, float]:
    """Contrast, clipping, blur, residual and gamma at the edges of a back-lit picture, or of one turned into that.

    largest: the camera's full scale. limits: the caller's, by the names of the table.
    """
    steps = found.steps
    if lit_beam:
        clipped = found.plateau(-1.0) < (1.0 - SATURATION_LEVEL) * largest
    else:
        clipped = found.plateau(1.0) > SATURATION_LEVEL * largest
    findings = {
        "contrast": float(np.percentile((steps.bright - steps.dark)[steps.sound], 10)) / largest,
        "saturated_share": float(clipped.mean()),
        "blur_px": steps.blur_px,
        "residual": float(np.percentile(found.residual, 95)),
    }
    saturated = {"saturated_share": findings["saturated_share"]}
    if not judge(saturated, limits):  # a clipped step is as lopsided as one of a bent response
        gamma = _gamma(found, largest if lit_beam else None)
        if gamma is not None:
            findings["gamma"] = gamma
    return findings


def _gamma(found: PassResult, inverted_from: float | None) -> float | None:
    """The camera's gamma from the half of each edge that is nearer to the clamp, where no magnet is behind it."""
    near, steps, stations = found.near_clamp, found.steps, found.stations_px
    profiles, offset, bright = found.profiles[near], steps.offset_px[near], steps.bright[near]
    if inverted_from is not None:  # back to a step that rises as the light does
        stations, offset = -stations[::-1], -offset
        profiles, bright = inverted_from - profiles[:, ::-1], inverted_from - steps.dark[near]
    return estimate_gamma(stations, profiles, offset, bright, steps.blur_px)


def effects_of_turning(twist_deg: float, even_turn_deg: float, width: float, depth: float) -> dict[str, str]:
    """The words of the remedies that tell what a turn about the beam's axis does to a fitted modulus.

    twist_deg: of the tip. even_turn_deg: of the whole beam, were that why it looks wide. width, depth: the specimen's.
    """
    even_turn = ""
    if 0.0 < even_turn_deg < _MOST_TURN_DEG:
        effect = 100.0 * stiffening_by_twist(even_turn_deg, even_turn_deg, width, depth)
        even_turn = (
            f": a turn of {even_turn_deg:.1f} degrees about its axis all along would look so wide, and make a fitted "
            f"modulus {effect:+.2g} % wrong"
        )
    twist_effect = 100.0 * stiffening_by_twist(0.0, twist_deg, width, depth)
    return {"even_turn": even_turn, "twist_effect": f"{twist_effect:+.2g}"}
