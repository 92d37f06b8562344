"""Both edges of the beam to a few hundredths of a pixel, from one image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.clamp import ClampLine, find_clamp_line
from eimi_lab.vision.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.intensity import full_scale, grey
from eimi_lab.vision.passes import Side, first_pass, scatter_scale, second_pass
from eimi_lab.vision.profiles import AVERAGED_PX
from eimi_lab.vision.quality import SATURATION_LEVEL, Findings, Limits, judge
from eimi_lab.vision.silhouette import find_silhouette, measure_back_light

Array = NDArray[np.float64]

_SMALLEST_FRAME_PX = 16


def find_edges(
    image: ArrayLike,
    calibration: Calibration,
    specimen_file: SpecimenFile,
    *,
    spacing_mm: float = 0.3,
    limits: Limits | None = None,
) -> EdgeSet:
    """The beam's edges in one image, (height, width) or (height, width, 3), of any depth.

    spacing_mm: wanted distance of the points along the edges; wider where that would give more than
    `passes.MOST_POINTS` or where profiles would overlap. A few pixels at the clamp line and at the corners are left
    out, where the profile is no clean step. A picture without a beam gives an edge set without points, and
    flags; it never raises for a picture.

    Method: on normals to the outline, the mean of four neighbouring profiles is fitted with a step blurred by
    a Gaussian, with plateaus of its own on both sides and one blur for the whole image; twice, the second
    time on normals to the curve through the first result.
    """
    limits = limits or Limits()
    frame = BeamFrame(calibration)
    specimen = specimen_file.specimen
    try:
        pixels = grey(image)
    except ValueError:
        pixels = np.zeros((0, 0), dtype=np.uint8)
    if min(pixels.shape) < _SMALLEST_FRAME_PX:
        return _no_edges(Findings(contrast=0.0, clamp_seen=0.0), limits)

    largest = full_scale(pixels)
    light = measure_back_light(pixels, frame, specimen.width_mm)
    findings = Findings(contrast=(light.bright - light.dark) / largest if largest else 0.0, clamp_seen=0.0)
    clamp = find_clamp_line(pixels, frame, specimen.width_mm, light.bright)
    findings = replace(findings, clamp_seen=clamp.seen)
    # A root hardly darker than the light around it is no beam, however the picture is exposed.
    if light.bright - light.dark < 0.2 * light.bright or light.bright <= 0.0:
        return _no_edges(replace(findings, contrast=0.0), limits)
    silhouette = find_silhouette(pixels, frame, clamp, light, specimen.length_mm, specimen.width_mm)
    if silhouette is None:
        return _no_edges(replace(findings, length_deviation=1.0), limits)
    findings = replace(
        findings,
        touches_frame=silhouette.touches_frame,
        other_bodies=silhouette.other_bodies,
        corner_turn_deg=silhouette.turn_deg,
    )
    if silhouette.corners is None:
        return _no_edges(findings, limits)

    spacing_px = max(spacing_mm * calibration.pixels_per_mm, AVERAGED_PX)
    width_px = specimen.width_mm * calibration.pixels_per_mm
    magnet_mm = specimen_file.magnet.width_mm if specimen_file.magnet else specimen.width_mm
    cover_px = 0.5 * (specimen.width_mm - magnet_mm) * calibration.pixels_per_mm
    first = first_pass(pixels, silhouette, frame.hand, spacing_px, width_px, cover_px)
    if first is None:
        return _no_edges(replace(findings, residual=1.0), limits)
    left, tip, right = first.sides
    corners_px = _corners(clamp, left, tip, right, width_px)
    second = second_pass(
        pixels, (left, right), corners_px, frame.hand, first.steps.blur_px, spacing_px, width_px, cover_px
    )
    if second is None:
        return _no_edges(replace(findings, residual=1.0), limits)
    left, right = second.sides
    steps = second.steps
    findings = replace(
        findings,
        contrast=float(np.percentile((steps.bright - steps.dark)[steps.sound], 10)) / largest,
        saturated_share=float((second.lit > SATURATION_LEVEL * largest).mean()),
        blur_px=steps.blur_px,
        residual=float(np.percentile(second.residual, 95)),
        width_deviation=_width_deviation(left, right, width_px),
        length_deviation=_length_deviation(left, right, corners_px, specimen.length_mm * calibration.pixels_per_mm),
    )
    scatter = scatter_scale(left, right)
    return EdgeSet(
        left=_edge_points(left, scatter, frame, calibration.pixels_per_mm),
        right=_edge_points(right, scatter, frame, calibration.pixels_per_mm),
        flags=judge(findings, limits),
        corners_px=corners_px,
    )


def _no_edges(findings: Findings, limits: Limits) -> EdgeSet:
    nothing = EdgePoints(np.zeros((0, 2)), np.zeros(0))
    return EdgeSet(nothing, nothing, judge(findings, limits), np.full((4, 2), np.nan))


def _edge_points(side: Side, scatter: float, frame: BeamFrame, pixels_per_mm: float) -> EdgePoints:
    points_mm = frame.to_mm(side.points_px[side.sound])
    return EdgePoints(points_mm, scatter * side.sigma_px[side.sound] / pixels_per_mm)


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


def _width_deviation(left: Side, right: Side, width_px: float) -> float:
    """Departure of the local width from the specimen's, as a share of it; a tenth of the beam departs more."""
    across = right.points_px[right.sound]
    points = left.points_px[left.sound]
    nearest = cKDTree(across).query(points)[1]
    # The neighbours' chord, not the nearest point itself: the points are far apart for what is asked here.
    behind, ahead = across[np.maximum(nearest - 1, 0)], across[np.minimum(nearest + 1, len(across) - 1)]
    chord = (ahead - behind) / np.linalg.norm(ahead - behind, axis=1, keepdims=True)
    gap = points - across[nearest]
    width = np.abs(chord[:, 0] * gap[:, 1] - chord[:, 1] * gap[:, 0])
    return float(np.percentile(np.abs(width / width_px - 1.0), 90))


def _length_deviation(left: Side, right: Side, corners_px: Array, length_px: float) -> float:
    """Departure of both edges' mean length, corner to corner, from the specimen's, as a share of it."""
    total = 0.0
    for side, start, end in ((left, corners_px[0], corners_px[2]), (right, corners_px[1], corners_px[3])):
        path = np.vstack([start, side.points_px[side.sound], end])
        total += float(np.hypot(*np.diff(path, axis=0).T).sum())
    return abs(0.5 * total / length_px - 1.0)
