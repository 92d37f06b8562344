"""Both edges of the beam to a few hundredths of a pixel, from one image."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.clamp import ClampLine, find_clamp_line
from eimi_lab.vision.dimensions import even_turn_deg, length_deviation, local_widths, twist_deg, width_deviation
from eimi_lab.vision.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.intensity import full_scale, grey
from eimi_lab.vision.passes import Beside, Located, Side, first_pass, scatter_scale, second_pass
from eimi_lab.vision.profiles import AVERAGED_PX, sample
from eimi_lab.vision.quality import SATURATION_LEVEL, Findings, Limits, judge
from eimi_lab.vision.response import estimate_gamma
from eimi_lab.vision.silhouette import find_silhouette, measure_back_light

Array = NDArray[np.float64]

_SMALLEST_FRAME_PX = 16
_LEAST_SIGMA_PX = 1e-3  # of a drawn picture without noise, whose points scatter not at all
_ABSURD_WIDTH = 0.5  # departure from the specimen's; such a body is not the beam, or not the beam alone
# By which a cast magnet may be off the beam's middle; one in little silicone may be anywhere within it, and has the
# standard deviation of an even distribution.
_MAGNET_PLACE_MM = 0.2


def find_edges(
    image: ArrayLike,
    calibration: Calibration,
    specimen_file: SpecimenFile,
    *,
    spacing_mm: float = 0.3,
    limits: Limits | None = None,
    calibration_age_days: float | None = None,
) -> EdgeSet:
    """The beam's edges in one image, (height, width) or (height, width, 3), of any depth.

    spacing_mm: wanted distance of the points along the edges; wider where that would give more than
    `passes.MOST_POINTS` or where profiles would overlap. Where they would lie farther apart than a tenth of the beam's
    width, more are looked for than are returned. A few pixels at the clamp line and at the corners are left out, where
    the profile is no clean step. A beam brighter than what is beside its root is taken for a lit one in front of a dark
    background. calibration_age_days: how old the calibration was when the image was taken. A picture without a beam
    gives an edge set without points, and flags; it never raises for a picture.

    Method: on normals to the outline, the mean of four neighbouring profiles is fitted with a step blurred by
    a Gaussian, with plateaus of its own on both sides and one blur for the whole image; twice, the second
    time on normals to the curve through the first result.
    """
    limits = limits or Limits()
    frame = BeamFrame(calibration)
    specimen = specimen_file.specimen
    findings = Findings(contrast=0.0, clamp_seen=0.0, calibration_age_days=calibration_age_days)

    def edge_set(left: EdgePoints, right: EdgePoints, findings: Findings, corners_px: Array) -> EdgeSet:
        flags = judge(findings, limits, specimen.width_mm, specimen.depth_mm)
        return EdgeSet(left, right, flags, corners_px, calibration.digest, calibration_age_days)

    def no_edges(findings: Findings) -> EdgeSet:
        nothing = EdgePoints(np.zeros((0, 2)), np.zeros(0))
        return edge_set(nothing, nothing, findings, np.full((4, 2), np.nan))

    try:
        pixels = grey(image)
    except ValueError:
        pixels = np.zeros((0, 0), dtype=np.uint8)
    if min(pixels.shape) < _SMALLEST_FRAME_PX:
        return no_edges(findings)

    largest = full_scale(pixels)
    lit_beam = _is_brighter_than_beside(pixels, frame, specimen.width_mm)
    if lit_beam:
        pixels = (largest - pixels).astype(pixels.dtype)
    light = measure_back_light(pixels, frame, specimen.width_mm)
    clamp = find_clamp_line(pixels, frame, specimen.width_mm, light.bright)
    contrast = (light.bright - light.dark) / largest if largest else 0.0
    findings = replace(findings, contrast=contrast, clamp_seen=clamp.seen)
    # A root hardly darker than the light around it is no beam, however the picture is exposed.
    if light.bright - light.dark < 0.2 * light.bright or light.bright <= 0.0:
        return no_edges(replace(findings, contrast=0.0))
    silhouette = find_silhouette(pixels, frame, clamp, light, specimen.length_mm, specimen.width_mm)
    if silhouette is None:
        return no_edges(replace(findings, length_deviation=1.0))
    findings = replace(
        findings,
        touches_frame=silhouette.touches_frame,
        other_bodies=silhouette.other_bodies,
        hole_share=silhouette.hole_share,
        corner_turn_deg=silhouette.turn_deg,
    )
    if silhouette.corners is None:
        return no_edges(findings)

    spacing_px = max(spacing_mm * calibration.pixels_per_mm, AVERAGED_PX)
    width_px = specimen.width_mm * calibration.pixels_per_mm
    magnet = specimen_file.magnet
    silicone_mm = 0.5 * (specimen.width_mm - magnet.width_mm) if magnet else 0.0
    from_tip_mm = magnet.length_mm + magnet.tip_offset_mm if magnet else 0.0
    beside = Beside(
        silicone_mm * calibration.pixels_per_mm,
        min(_MAGNET_PLACE_MM, silicone_mm / math.sqrt(3.0)) * calibration.pixels_per_mm,
        from_tip_mm * calibration.pixels_per_mm,
    )
    first = first_pass(pixels, silhouette, frame.hand, spacing_px, width_px, beside)
    if first is None:
        return no_edges(replace(findings, residual=1.0))
    left, tip, right = first.sides
    corners_px = _corners(clamp, left, tip, right, width_px)
    second = second_pass(pixels, first, corners_px, frame.hand, spacing_px, width_px, beside)
    if second is None:
        return no_edges(replace(findings, residual=1.0))
    left, right = second.sides
    steps = second.steps
    found_left, found_right = left.points_px[left.sound], right.points_px[right.sound]
    widths = local_widths(found_left, found_right)
    deviation = width_deviation(widths, width_px)
    if deviation > _ABSURD_WIDTH:
        return no_edges(replace(findings, width_deviation=deviation))
    clipped = second.plateau(-1.0) < (1.0 - SATURATION_LEVEL) * largest if lit_beam else None
    if clipped is None:
        clipped = second.plateau(1.0) > SATURATION_LEVEL * largest
    findings = replace(
        findings,
        contrast=float(np.percentile((steps.bright - steps.dark)[steps.sound], 10)) / largest,
        saturated_share=float(clipped.mean()),
        blur_px=steps.blur_px,
        residual=float(np.percentile(second.residual, 95)),
        width_deviation=deviation,
        length_deviation=length_deviation(
            found_left, found_right, corners_px, specimen.length_mm * calibration.pixels_per_mm
        ),
        even_turn_deg=even_turn_deg(widths, width_px, specimen.depth_mm * calibration.pixels_per_mm),
        twist_deg=twist_deg(widths, width_px, specimen.depth_mm * calibration.pixels_per_mm),
        clamp_offset_mm=float(np.linalg.norm(frame.to_mm(corners_px[:2]).mean(axis=0))),
    )
    if clipped.mean() <= limits.saturated_share:  # a clipped step is as lopsided as one of a bent response
        findings = replace(findings, gamma=_gamma(second, largest if lit_beam else None))
    scatter = scatter_scale(left, right)
    return edge_set(
        _edge_points(left, scatter, frame, calibration.pixels_per_mm),
        _edge_points(right, scatter, frame, calibration.pixels_per_mm),
        findings,
        corners_px,
    )


def _is_brighter_than_beside(image: NDArray[Any], frame: BeamFrame, width_mm: float) -> bool:
    """Whether the beam's root is brighter by a fifth than what is to both sides of it."""
    along, across = np.meshgrid(np.linspace(0.3, 0.9, 7), np.linspace(-0.25, 0.25, 5))
    inside, left, right = (
        float(np.median(sample(image, frame.to_px(width_mm * np.column_stack([along.ravel(), (across + y).ravel()])))))
        for y in (0.0, -1.5, 1.5)
    )
    return inside > 1.2 * max(left, right) + 1.0


def _gamma(located: Located, inverted_from: float | None) -> float | None:
    """The camera's gamma from the half of each edge that is nearer to the clamp, where no magnet is behind it."""
    near = np.concatenate([np.arange(len(side.sound)) < len(side.sound) // 2 for side in located.sides])
    near &= located.sound
    steps, stations, profiles = located.steps, located.stations_px, located.profiles[near]
    offset, bright = steps.offset_px[near], steps.bright[near]
    if inverted_from is not None:  # back to a step that rises as the light does
        stations, offset = -stations[::-1], -offset
        profiles, bright = inverted_from - profiles[:, ::-1], inverted_from - steps.dark[near]
    return estimate_gamma(stations, profiles, offset, bright, steps.blur_px)


def _edge_points(side: Side, scatter: float, frame: BeamFrame, pixels_per_mm: float) -> EdgePoints:
    kept = np.flatnonzero(side.sound)[:: side.every]
    sigma_px = scatter * np.hypot(side.sigma_px, side.common_px)[kept]
    return EdgePoints(frame.to_mm(side.points_px[kept]), np.maximum(sigma_px, _LEAST_SIGMA_PX) / pixels_per_mm)


def _corners(clamp: ClampLine, left: Side, tip: Side, right: Side, width_px: float) -> Array:
    """(4, 2) px: where the left and right edges cross the clamp line, then the line of the tip's face."""
    face = _line_through(tip.points_px[tip.sound])
    corners = []
    for side in (left, right):
        points = side.points_px[side.sound]
        near = points[: max(5, int((np.linalg.norm(points - points[0], axis=1) < width_px).sum()))]
        ahead = clamp.distance_px(near)
        across = (near - clamp.point_px) @ np.array([-clamp.ahead[1], clamp.ahead[0]])
        at_line = np.polyval(np.polyfit(ahead, across, 2 if len(near) > 4 else 1), 0.0)
        corners.append(clamp.point_px + at_line * np.array([-clamp.ahead[1], clamp.ahead[0]]))
    for side in (left, right):
        points = side.points_px[side.sound]
        near = points[-max(3, int((np.linalg.norm(points - points[-1], axis=1) < 0.75 * width_px).sum())) :]
        corners.append(_crossing(_line_through(near), face))
    return np.array(corners)


def _line_through(points: Array) -> tuple[Array, Array]:
    """Centre and unit direction of the line with the least squared distances to points (n, 2), n >= 2."""
    centre = points.mean(axis=0)
    return centre, np.linalg.svd(points - centre, full_matrices=False)[2][0]


def _crossing(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Where two lines (place, direction) cross; NaN where they are all but parallel."""
    directions = np.column_stack([one[1], -other[1]])
    if abs(np.linalg.det(directions)) < 0.1:
        return np.full(2, np.nan)
    return one[0] + one[1] * np.linalg.solve(directions, other[0] - one[0])[0]
