"""Measure contrast, clipping, blur and gamma at the edges of a picture, for the quality checks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eimi_lab.vision.edges.dimensions import stiffening_by_twist
from eimi_lab.vision.edges.passes import PassResult
from eimi_lab.vision.edges.response import estimate_gamma
from eimi_lab.vision.flags import judge

SATURATION_LEVEL = 0.985  # of full scale: the noise is clipped before the mean reaches full scale
_MOST_TURN_DEG = 15.0  # a wider beam is not explained by a turn


def light_findings(
    edge_pass: PassResult, largest: float, lit_beam: bool, limits: Mapping[str, float] | None
) -> dict[str, float]:
    """Measure contrast, clipping, blur, residual and gamma at the edges, for the quality checks.

    Parameters
    ----------
    edge_pass : PassResult
        Grey values across the edges, with fitted steps, for a dark beam.
    largest : float
        Largest grey value of the camera.
    lit_beam : bool
        Whether the grey values were inverted because the beam is bright.
    limits : mapping of str to float, optional
        Limits that replace the usual limits of the quality checks.

    Returns
    -------
    dict of str to float
        The measured values, with the keys of the quality checks.
    """
    steps = edge_pass.steps
    if lit_beam:
        clipped = edge_pass.plateau(-1.0) < (1.0 - SATURATION_LEVEL) * largest
    else:
        clipped = edge_pass.plateau(1.0) > SATURATION_LEVEL * largest
    findings = {
        "contrast": float(np.percentile((steps.bright - steps.dark)[steps.sound], 10)) / largest,
        "saturated_share": float(clipped.mean()),
        "blur_px": steps.blur_px,
        "residual": float(np.percentile(edge_pass.residual, 95)),
    }
    saturated = {"saturated_share": findings["saturated_share"]}
    if not judge(saturated, limits):  # a clipped step is as asymmetric as that of a gamma
        gamma = _gamma(edge_pass, largest if lit_beam else None)
        if gamma is not None:
            findings["gamma"] = gamma
    return findings


def _gamma(edge_pass: PassResult, inverted_from: float | None) -> float | None:
    """Return the gamma of the camera from the edges near the clamp; None if it cannot be determined.

    `inverted_from`: largest grey value of the camera if the grey values were inverted, else None.
    """
    near, steps, stations = edge_pass.near_clamp, edge_pass.steps, edge_pass.stations_px
    profiles, offset, bright = edge_pass.profiles[near], steps.offset_px[near], steps.bright[near]
    if inverted_from is not None:  # turn the negative back, so that grey values rise with the light
        stations, offset = -stations[::-1], -offset
        profiles, bright = inverted_from - profiles[:, ::-1], inverted_from - steps.dark[near]
    return estimate_gamma(stations, profiles, offset, bright, steps.blur_px)


def describe_turn_effects(twist_deg: float, even_turn_deg: float, width: float, depth: float) -> dict[str, str]:
    """Return in words how much a rotation of the beam about its axis changes the fitted modulus.

    Parameters
    ----------
    twist_deg : float
        Rotation of the tip relative to the clamp.
    even_turn_deg : float
        Rotation of the whole beam.
    width, depth : float
        Width and depth of the specimen, in any unit.

    Returns
    -------
    dict of str to str
        Texts for ``{even_turn}`` and ``{twist_effect}`` in messages.
    """
    even_turn = ""
    if 0.0 < even_turn_deg < _MOST_TURN_DEG:
        effect = 100.0 * stiffening_by_twist(even_turn_deg, even_turn_deg, width, depth)
        even_turn = (
            f": a turn of {even_turn_deg:.1f} degrees of the whole beam about its axis gives the same width and "
            f"changes a fitted modulus by {effect:+.2g} %"
        )
    twist_effect = 100.0 * stiffening_by_twist(0.0, twist_deg, width, depth)
    return {"even_turn": even_turn, "twist_effect": f"{twist_effect:+.2g}"}
