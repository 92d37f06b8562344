"""Compute a calibration from points that a person clicked on a photograph: clamp, tip and two ticks of a ruler."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Literal

from pydantic import Field

from eimi_lab.config.calibration import Calibration, Pair
from eimi_lab.config.toml import Document, parse
from eimi_lab.process.errors import InputError
from eimi_lab.vision.calibration.exif_lens import FOCAL_LENGTH_SHARE, FocalLength

FEWEST_RULER_PX = 40.0
FEWEST_BEAM_PX = 40.0  # from the clamp to the tip
LARGEST_TILT_DEG = 20.0  # of a phone; beyond it, a ruler is probably neither horizontal nor vertical
LEVEL_DEG = 0.5  # assumed: a ruler or a clamp that was set horizontal or vertical by eye or with a spirit level
UPRIGHT_DEG = 1.5  # assumed: a phone that was held upright
PARALLEL_DEG = 2.0  # assumed: a phone that was held parallel to the plane of the beam by eye
IN_PLANE_MM = 1.0  # assumed: distance of the ruler from the middle plane of the beam
CLICK_SHARE = 4e-4  # assumed: uncertainty of a click as a share of the diagonal of the picture
CLICK_PX = 1.0  # assumed: smallest uncertainty of a click
STAND_OFF_SHARE = 0.05  # assumed, of a distance that was measured with a ruler
LARGEST_STAND_OFF_SIGMA_MM = 100.0
REACH = 1.25  # the beam is searched for within this multiple of its length from the clamp
_RISES_SIGMAS = 3.0  # the tip is above the clamp beyond this multiple of the standard uncertainty
_SLACK = 1.1  # the tip may be this factor times the stated length away from the clamp

Points = Annotated[tuple[Pair, ...], Field(strict=False)]


class ClickedBench(Document):
    """Points (px) that a person clicked on a photograph of clamp, beam and ruler, and further entries of the person."""

    clamp_px: Points = Field(min_length=1, max_length=2)
    """Middle of the line at which the beam leaves its clamp, or both ends of this line."""
    tip_px: Pair
    """Middle of the tip of the beam."""
    ruler_px: Points = Field(min_length=2, max_length=2)
    """Two ticks of a ruler in the plane of the beam."""
    ruler_mm: float = Field(gt=0)
    """Distance of the two ticks."""
    plumb: Literal["ruler", "clamp", "picture"] = "ruler"
    """What is horizontal or vertical: the ruler, the clamp's edge, or the picture itself."""
    leaves: Literal["level", "downward", "upward", "clamp"] = "level"
    """How the beam leaves its clamp: horizontally (level), downward, upward, or perpendicular to the clamp's edge."""
    stand_off_mm: float | None = Field(default=None, gt=0)
    """Distance from the lens to the beam; needed if the Exif data of the picture give no focal length."""
    along_px: Annotated[tuple[Pair, ...], Field(strict=False, max_length=5)] = ()
    """Further points on the centre line, from the clamp to the tip."""


@dataclass(frozen=True)
class MeasuredBench:
    """The calibration from a photograph, with a text on how each value was obtained."""

    calibration: Calibration
    sources: dict[str, str]


def measure_bench(
    clicked: ClickedBench,
    size: tuple[int, int],
    length_mm: float,
    depth_mm: float,
    lens: FocalLength | None,
    day: date,
) -> MeasuredBench:
    """Return the calibration that follows from a person's clicks on a photograph.

    Parameters
    ----------
    clicked : ClickedBench
        The clicks.
    size : tuple of int
        Width and height of the picture, px.
    length_mm : float
        Length of the beam, to check the clicks.
    depth_mm : float
        Depth of the beam, to correct for the clicks on its near face.
    lens : FocalLength or None
        Focal length from the Exif data.
    day : date
        Day on which the picture was taken.

    Returns
    -------
    MeasuredBench
        The calibration, with a text on how each value was obtained.

    Raises
    ------
    InputError
        If the clicks contradict each other, if a click is outside the picture, or if the distance from the lens to the
        beam is not known.
    """
    _check_inside(clicked, size)
    click_px = max(CLICK_PX, CLICK_SHARE * math.hypot(*size))
    scale, scale_share, ruler_words = _scale(clicked, click_px)
    clamp = _middle(clicked)
    chord_px = math.dist(clamp, clicked.tip_px)
    if chord_px < FEWEST_BEAM_PX:
        raise InputError(
            f"the clicked tip is {chord_px:.0f} px from the clamp (at least {FEWEST_BEAM_PX:g}); click the tip again, "
            "or take a picture in which the beam is larger"
        )
    gravity_deg, gravity_sigma, gravity_words = _gravity(clicked, click_px)
    axis_deg, axis_sigma, axis_words = _axis(clicked, gravity_deg, click_px)
    chord_mm = chord_px / scale
    if chord_mm > _SLACK * length_mm:
        raise InputError(
            f"the tip is {chord_mm:.3g} mm from the clamp by the ruler, but length_mm = {length_mm:g}: click the tip "
            "or the ticks again, or correct the length or the distance of the ticks"
        )
    _check_order(clicked, gravity_deg, gravity_sigma, click_px)
    stand_off_mm, stand_off_share, stand_off_words = _stand_off(clicked, scale, lens)
    if stand_off_mm < 2.0 * depth_mm:
        raise InputError(
            f"the lens would be {stand_off_mm:.3g} mm from the beam, less than twice the beam's "
            f"depth_mm = {depth_mm:g}: correct the distance between the ticks of the ruler, or the distance from "
            "the lens to the beam"
        )
    nearer = 0.5 * depth_mm / stand_off_mm
    from_axis = (clamp[0] - 0.5 * (size[0] - 1), clamp[1] - 0.5 * (size[1] - 1))
    clamp = (clamp[0] - nearer * from_axis[0], clamp[1] - nearer * from_axis[1])
    by_tilt = 0.5 * depth_mm * math.radians(PARALLEL_DEG) * scale  # of the near face relative to the middle plane
    clamp_px = math.hypot(click_px / math.sqrt(len(clicked.clamp_px)), 0.5 * nearer * math.hypot(*from_axis), by_tilt)
    scale_share = math.hypot(scale_share, IN_PLANE_MM / stand_off_mm)
    values = {
        "pixels_per_mm": (f"{scale:.5g}", f"{scale_share * scale:.2g}", ruler_words),
        "clamp_midpoint_px": (
            f"[{clamp[0]:.1f}, {clamp[1]:.1f}]",
            f"{clamp_px:.2g}",
            "where the beam leaves its clamp: clicked on the near face of the beam, moved to its middle plane",
        ),
        "axis_angle_deg": (f"{axis_deg:.2f}", f"{axis_sigma:.2g}", axis_words),
        "gravity_angle_deg": (f"{gravity_deg:.2f}", f"{gravity_sigma:.2g}", gravity_words),
        "stand_off_mm": (
            f"{stand_off_mm:.1f}",
            f"{min(LARGEST_STAND_OFF_SIGMA_MM, stand_off_share * stand_off_mm):.2g}",
            stand_off_words,
        ),
        "camera_tilt_deg": (
            "[0.0, 0.0]",
            f"{PARALLEL_DEG:g}",
            f"the phone was parallel to the plane of the beam (assumed to {PARALLEL_DEG:g} degrees about both axes)",
        ),
    }
    reach_px = REACH * length_mm * scale
    text = _text(values, clicked, _region(clamp, reach_px, size), day)
    return MeasuredBench(
        parse(Calibration, text, "calibration.toml"), {key: words for key, (_, _, words) in values.items()}
    )


def _region(clamp: tuple[float, float], reach_px: float, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return the rectangle (left, top, width, height; px) that contains every possible position of the beam."""
    left, top = (max(0, math.floor(middle - reach_px)) for middle in clamp)
    right, bottom = (min(most, math.ceil(middle + reach_px)) for middle, most in zip(clamp, size, strict=True))
    return left, top, right - left, bottom - top


def _check_inside(clicked: ClickedBench, size: tuple[int, int]) -> None:
    points = (*clicked.clamp_px, clicked.tip_px, *clicked.ruler_px, *clicked.along_px)
    for x, y in points:
        if not (-0.5 <= x <= size[0] - 0.5 and -0.5 <= y <= size[1] - 0.5):
            raise InputError(f"the point [{x:g}, {y:g}] should lie in the picture of {size[0]} x {size[1]} px")


def _middle(clicked: ClickedBench) -> tuple[float, float]:
    (x, y), (other_x, other_y) = clicked.clamp_px[0], clicked.clamp_px[-1]
    return 0.5 * (x + other_x), 0.5 * (y + other_y)


def _scale(clicked: ClickedBench, click_px: float) -> tuple[float, float, str]:
    """Return the scale (px/mm), its relative uncertainty for clicks uncertain by `click_px`, and its source."""
    ruler_px = math.dist(*clicked.ruler_px)
    if ruler_px < FEWEST_RULER_PX:
        raise InputError(
            f"the two ticks of the ruler are {ruler_px:.0f} px apart; click ticks that are at least "
            f"{FEWEST_RULER_PX:g} px apart"
        )
    words = f"ticks of the ruler, {clicked.ruler_mm:g} mm and {ruler_px:.1f} px apart"
    return ruler_px / clicked.ruler_mm, math.sqrt(2.0) * click_px / ruler_px, words


def _direction_deg(points: tuple[tuple[float, float], ...]) -> float:
    """Return the direction from the first to the last point, degrees clockwise from +x."""
    (x, y), (end_x, end_y) = points[0], points[-1]
    return math.degrees(math.atan2(end_y - y, end_x - x))


def _from_clicks_deg(points: tuple[tuple[float, float], ...], click_px: float) -> float:
    """Return the uncertainty (degrees) of the direction through two clicks that are uncertain by `click_px`."""
    return math.degrees(math.sqrt(2.0) * click_px / math.dist(points[0], points[-1]))


def _gravity(clicked: ClickedBench, click_px: float) -> tuple[float, float, str]:
    """Return the direction of gravity, its uncertainty (degrees), and its source in words."""
    if clicked.plumb == "picture":
        return 90.0, UPRIGHT_DEG, f"the phone was upright (assumed to {UPRIGHT_DEG:g} degrees)"
    points = clicked.ruler_px if clicked.plumb == "ruler" else _clamp_line(clicked)
    tilt_deg = (_direction_deg(points) + 45.0) % 90.0 - 45.0
    body = "the ruler" if clicked.plumb == "ruler" else "the clamp's edge"
    if abs(tilt_deg) > LARGEST_TILT_DEG:
        raise InputError(
            f"{body} is turned by {tilt_deg:.0f} degrees in the picture, and is therefore neither horizontal nor "
            "vertical; choose something else that is horizontal or vertical"
        )
    assumed = f"{body} is horizontal or vertical (assumed to {LEVEL_DEG:g} degrees)"
    words = f"{assumed}, the phone tilted by {tilt_deg:.2f} degrees"
    return 90.0 + tilt_deg, math.hypot(LEVEL_DEG, _from_clicks_deg(points, click_px)), words


def _clamp_line(clicked: ClickedBench) -> tuple[tuple[float, float], ...]:
    """Return both clicked ends of the clamp's edge, px; raise InputError if they are missing or too close."""
    if len(clicked.clamp_px) < 2 or math.dist(*clicked.clamp_px) < 0.5 * FEWEST_RULER_PX:
        raise InputError(
            f"click both ends of the clamp's edge, at least {0.5 * FEWEST_RULER_PX:g} px apart, because the direction "
            "of this edge is used"
        )
    return clicked.clamp_px


def _axis(clicked: ClickedBench, gravity_deg: float, click_px: float) -> tuple[float, float, str]:
    """Return the direction of the beam at its clamp, its uncertainty (degrees), and its source in words."""
    clamp = _middle(clicked)
    to_tip_deg = _direction_deg((clamp, clicked.tip_px))
    if clicked.leaves == "clamp":
        line = _clamp_line(clicked)
        axis_deg = _nearer(_direction_deg(line) + 90.0, to_tip_deg)
        sigma = math.hypot(LEVEL_DEG, _from_clicks_deg(line, click_px))
        return axis_deg, sigma, "perpendicular to the clamp's edge"
    assumed = f"(assumed to {LEVEL_DEG:g} degrees)"
    if clicked.leaves == "level":
        return _nearer(gravity_deg - 90.0, to_tip_deg), LEVEL_DEG, f"the beam leaves its clamp horizontally {assumed}"
    axis_deg = gravity_deg if clicked.leaves == "downward" else gravity_deg - 180.0
    return axis_deg, LEVEL_DEG, f"the beam leaves its clamp {clicked.leaves} {assumed}"


def _check_order(clicked: ClickedBench, gravity_deg: float, gravity_sigma: float, click_px: float) -> None:
    """Raise InputError if the clicked tip is above the clamp, although the beam leaves its clamp horizontally."""
    if clicked.leaves != "level":
        return
    ends = (_middle(clicked), clicked.tip_px)
    rise_deg = -math.degrees(math.asin(math.cos(math.radians(_direction_deg(ends) - gravity_deg))))
    sigma = math.hypot(LEVEL_DEG, gravity_sigma, _from_clicks_deg(ends, click_px))
    if rise_deg > _RISES_SIGMAS * sigma:
        raise InputError(
            f"the clicked tip is above the clamp: the line between them rises by {rise_deg:.1f} degrees, but a beam "
            "that leaves its clamp horizontally (level) bends down under its weight. Click the clamp first and then "
            "the tip, or choose another direction in which the beam leaves its clamp"
        )


def _nearer(direction_deg: float, to_tip_deg: float) -> float:
    """Return `direction_deg` or the opposite direction, whichever is nearer to `to_tip_deg`."""
    if math.cos(math.radians(direction_deg - to_tip_deg)) < 0.0:
        direction_deg += 180.0
    return (direction_deg + 180.0) % 360.0 - 180.0


def _stand_off(clicked: ClickedBench, scale: float, lens: FocalLength | None) -> tuple[float, float, str]:
    """Return the distance from lens to beam (mm), its relative uncertainty, and its source in words."""
    if clicked.stand_off_mm is not None:
        return clicked.stand_off_mm, STAND_OFF_SHARE, "measured with a ruler"
    if lens is None:
        raise InputError(
            "stand_off_mm is missing: the picture has no focal length in its Exif data, or was cropped; measure the "
            "distance from the lens to the beam, and give it"
        )
    return lens.px / scale, FOCAL_LENGTH_SHARE, f"{lens.source}, and the scale"


def _text(
    values: dict[str, tuple[str, str, str]], clicked: ClickedBench, region: tuple[int, int, int, int], day: date
) -> str:
    """Return the text of calibration.toml, with a comment on the source of each value."""
    ticks = ", ".join(f"[{x:.1f}, {y:.1f}]" for x, y in clicked.ruler_px)
    lines = [
        '# Written by the page "Weights and a phone" from clicks on a picture. Angles: clockwise from the image\'s +x.',
        f"# Tip: [{clicked.tip_px[0]:.1f}, {clicked.tip_px[1]:.1f}].",
    ]
    settings = [f"{key} = {value}" for key, (value, _, _) in values.items()]
    wide = max(map(len, settings)) + 2
    words = [source for _, _, source in values.values()]
    lines += [f"{setting:{wide}}# {source}" for setting, source in zip(settings, words, strict=True)]
    lines += [
        f"ruler_px = [{ticks}]    # the ticks of the ruler",
        f"calibrated_on = {day.isoformat()}",
        "",
        "[uncertainty]    # standard uncertainties; correct them if you know better",
    ]
    lines += [f"{key} = {sigma}" for key, (_, sigma, _) in values.items()]
    lines += ["", "[picture]", f"region_px = {list(region)}    # the part of the picture that the beam can reach"]
    if clicked.along_px:
        points = [*clicked.along_px, clicked.tip_px]
        listed = ", ".join(f"[{x:.1f}, {y:.1f}]" for x, y in points)
        lines.append(f"along_px = [{listed}]    # points of the centre line")
    return "\n".join(lines) + "\n"
