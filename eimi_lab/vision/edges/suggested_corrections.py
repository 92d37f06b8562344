"""Suggest which value of the calibration or of the specimen is wrong if no beam was found."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity, leaves_out
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges, follow_beam
from eimi_lab.vision.flags import CHECK_OF, judge
from eimi_lab.vision.following.follow import NARROWEST_PX, FollowedBeam
from eimi_lab.vision.intensity import full_scale
from eimi_lab.vision.projection import Projection

Array = NDArray[np.float64]

WIDTHS = (0.8, 1.25)
SCALES = (0.5, 0.7, 1.4, 2.0)
TURNS_DEG = (40.0, -40.0, 90.0, -90.0, 180.0)
ASIDE = (2.5, -2.5)  # beam widths by which the clamp is moved, across the beam and along it
_FULL_LENGTH = 0.8  # of the stated length, at the last point: the corners at the tip are left out
_LEAST_LENGTH = 0.1  # of the stated length: a shorter path is chance
_CLEAR_GAIN = 0.5  # mean evidence of a body that is clear against its surroundings
_LEAST_SPAN = 0.05  # of full scale, from the darkest to the brightest hundredth


@dataclass(frozen=True)
class SuggestedCorrection:
    """A suggestion which value of the calibration or of the specimen is wrong.

    Attributes
    ----------
    words : str
        The suggestion, as the end of the sentence "no beam was found; ...".
    edges_px : tuple of ndarray, shape (n, 2)
        Points of the edges that were located with the suggested value, px; empty without such a value.
    """

    words: str
    edges_px: tuple[Array, ...] = ()


def suggest_correction(
    image: NDArray[Any], calibration: Calibration, specimen: SpecimenFile, projection: Projection | None
) -> SuggestedCorrection:
    """Suggest which value is probably wrong if no beam was found in an image.

    Parameters
    ----------
    image : ndarray, shape (rows, columns) or (rows, columns, 3)
        The image.
    calibration : Calibration
        The calibration with which no beam was found.
    specimen : SpecimenFile
        The specimen.
    projection : Projection, optional
        Weights that convert colours to grey values.

    Returns
    -------
    SuggestedCorrection
        The suggestion, or another probable reason.
    """
    followed = follow_beam(image, calibration, specimen, projection=projection)
    if _is_probably_the_beam(followed):
        return SuggestedCorrection(_reason_of(followed))
    for changes, words in _corrections(calibration, specimen.specimen.width_mm):
        size = {key: changes[key] for key in changes if key == "width_mm"}
        beam = specimen.model_copy(update={"specimen": specimen.specimen.model_copy(update=size)})
        changed = calibration.model_copy(update={key: changes[key] for key in changes if key not in size})
        x, y = changed.clamp_midpoint_px
        if not (0 <= x < image.shape[1] and 0 <= y < image.shape[0]):
            continue
        edges = find_edges(image, changed, beam, projection=projection)
        if _is_convincing(edges, beam):
            frame = BeamFrame(changed)
            edges_px = tuple(frame.to_px(edge.points_mm) for edge in (edges.left, edges.right))
            return SuggestedCorrection(f"a beam is found with {words}", edges_px)
    if reason := _shows_nothing(image) or _cut_by_border(image, calibration, specimen):
        return SuggestedCorrection(reason)
    wide_px = specimen.specimen.width_mm * calibration.pixels_per_mm
    if wide_px < NARROWEST_PX:
        return SuggestedCorrection(
            f"the beam is {math.floor(10 * wide_px) / 10:g} px wide and should be at least {NARROWEST_PX:g} px wide: "
            "move the camera nearer, or use a longer lens;"
        )
    if reason := _reason_of(followed):
        return SuggestedCorrection(reason)
    is_clicked = calibration.picture is not None and calibration.picture.along_px is not None
    help_left = "--region" if is_clicked else "--along, --region"
    return SuggestedCorrection(
        "no body as wide as width_mm leaves the clamp at or near clamp_midpoint_px: check clamp_midpoint_px, "
        f"axis_angle_deg and pixels_per_mm, or help the search by {help_left}, --polarity or --beam-colour;"
    )


def _is_probably_the_beam(followed: FollowedBeam) -> bool:
    """Return whether a body with unusable edges is probably the beam."""
    findings = followed.findings
    return (
        findings.get("followed_beyond", 0.0) >= _FULL_LENGTH
        and findings.get("followed_gain", 0.0) >= _CLEAR_GAIN
        and findings.get("followed_width", math.inf) <= CHECK_OF["followed_width"].limit
        and findings.get("followed_click", 0.0) <= CHECK_OF["followed_click"].limit
        and leaves_out(judge(findings, None, followed.words))
    )


def _reason_of(followed: FollowedBeam) -> str:
    """Return in words why the edges of a followed body are unusable; empty if no reason is known."""
    share = followed.findings.get("followed_beyond", 0.0)
    grave = (flag for flag in judge(followed.findings, None, followed.words) if leaves_out([flag]))
    flag = next(grave, None)
    if flag is None or share < _LEAST_LENGTH:
        return ""
    remedy = flag.remedy[0].lower() + flag.remedy[1:].rstrip(".")
    return (
        f"a body was followed from the clamp over {100.0 * share:.0f} % of length_mm, but its edges are unusable "
        f"({flag.name} {flag.value:.2g}, limit {flag.limit:g}): {remedy};"
    )


def _is_convincing(edges: EdgeSet, specimen: SpecimenFile) -> bool:
    """Return whether the edges have nearly the specimen's length and no serious failed quality check."""
    if any(flag.severity is not Severity.NOTE for flag in edges.flags):
        return False
    for edge in (edges.left, edges.right):
        steps = np.diff(edge.points_mm, axis=0)
        end_mm = np.abs(edge.points_mm[:1, 0]).sum() + np.hypot(*steps.T).sum()
        if end_mm < _FULL_LENGTH * specimen.specimen.length_mm:
            return False
    return True


def _shows_nothing(image: NDArray[Any]) -> str:
    """Return advice on the exposure if the whole picture is about equally bright, else an empty string."""
    darkest, brightest = np.percentile(image[::2, ::2], (1, 99))
    full = full_scale(image)
    if brightest - darkest > _LEAST_SPAN * full:
        return ""
    way = "raise" if brightest < 0.5 * full else "lower"
    return (
        f"the grey values of the picture lie between {darkest:.0f} and {brightest:.0f} of {full:.0f}: {way} the "
        "exposure, or improve the light;"
    )


def _cut_by_border(image: NDArray[Any], calibration: Calibration, specimen: SpecimenFile) -> str:
    """Return advice on the clamp's position if the beam begins partly outside the picture, else an empty string."""
    half = 0.5 * specimen.specimen.width_mm
    begins = BeamFrame(calibration).to_px([[half, -half], [half, half]])
    if ((begins >= -0.5) & (begins <= np.array(image.shape[1::-1]) - 0.5)).all():
        return ""
    return (
        "an edge of the beam begins outside the picture: take a picture that shows the whole width of the beam, or "
        "correct clamp_midpoint_px;"
    )


def _corrections(calibration: Calibration, width_mm: float) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield changed values of the calibration or the width that may help to find the beam, with advice."""
    picture = calibration.picture
    if picture is not None and picture.along_px is not None:
        yield (
            {"picture": picture.model_copy(update={"along_px": None})},
            "another centre line than the one through the points of --along: are these points right?",
        )
    for factor in WIDTHS:
        width = factor * width_mm
        yield {"width_mm": width}, f"width_mm = {width:.3g}, {factor:g} times the given value: is the width right?"
    for scale in SCALES:
        changed = scale * calibration.pixels_per_mm
        words = f"pixels_per_mm = {changed:.3g}, {scale:g} times the given value: is the scale right?"
        yield {"pixels_per_mm": changed}, words
    for turn in TURNS_DEG:
        axis = (calibration.axis_angle_deg + turn + 180.0) % 360.0 - 180.0
        yield {"axis_angle_deg": axis}, f"axis_angle_deg = {axis:g}: is the given direction of the beam right?"
    frame = BeamFrame(calibration)
    for along, across in [(0.0, aside) for aside in ASIDE] + [(aside, 0.0) for aside in ASIDE]:
        x, y = np.round(frame.to_px([[along * width_mm, across * width_mm]])[0], 1).tolist()
        yield {"clamp_midpoint_px": (x, y)}, f"clamp_midpoint_px = [{x:g}, {y:g}]: is the clamp at the given place?"
