"""Find both edges of the beam in one image."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity, leaves_out
from eimi_lab.vision.edges.back_lit import BackLitSearch
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.flags import judge
from eimi_lab.vision.following.centre_line import CLICKED_PX, carried_line, clicked_line, line_between
from eimi_lab.vision.following.clicks import off_path, with_clicks
from eimi_lab.vision.following.edge_points import StripEdges
from eimi_lab.vision.following.follow import FollowedBeam, follow
from eimi_lab.vision.following.in_picture import in_255, stated_beam
from eimi_lab.vision.projection import Projection

Array = NDArray[np.float64]
_Edges = tuple[EdgePoints, EdgePoints, Array]

# Findings which show that a silhouette is not that of the whole beam alone.
_OF_THE_OUTLINE = frozenset(
    ("touches_frame", "other_bodies", "hole_share", "corner_turn_deg", "residual", "width_deviation", "clamp_seen")
)
_SMALLEST_FRAME_PX = 16


def find_edges(
    image: ArrayLike,
    calibration: Calibration,
    specimen_file: SpecimenFile,
    *,
    spacing_mm: float = 0.3,
    limits: Mapping[str, float] | None = None,
    calibration_age_days: float | None = None,
    projection: Projection | None = None,
    earlier: Callable[[], EdgeSet | None] | None = None,
    expected_mm: Array | None = None,
    between_mm: Array | None = None,
) -> EdgeSet:
    """Find both edges of the beam in one image.

    Parameters
    ----------
    image : array_like, shape (rows, columns) or (rows, columns, 3)
        The image.
    calibration : Calibration
        Scale, clamp, axis and lens.
    specimen_file : SpecimenFile
        The specimen and its magnet.
    spacing_mm : float
        Desired distance between points along an edge; increased if the points would be too many or too close.
    limits : mapping of str to float, optional
        Limits that replace the usual limits of the quality checks.
    calibration_age_days : float, optional
        Age of the calibration when the image was taken.
    projection : Projection, optional
        Weights that convert colours to grey values.
    earlier : callable, optional
        Function that returns the edges in an earlier picture, or None. It is called if several bodies may be the beam;
        the body nearest to the earlier edges is chosen.
    expected_mm : ndarray, shape (n, 2), optional
        Centre line of the beam in an earlier picture, from the clamp. It replaces the clicked points in `calibration`.
    between_mm : ndarray, shape (m, 2), optional
        Centre line in a later picture. The beam is expected between both lines.

    Returns
    -------
    EdgeSet
        Edges, corners and failed quality checks. Without a beam, the edges are empty.

    Examples
    --------
    An image without a beam:

    >>> calibration = Calibration(
    ...     pixels_per_mm=8.0, coil_constant_mT_per_A=4.7, clamp_midpoint_px=(64.0, 8.0),
    ...     axis_angle_deg=90.0, gravity_angle_deg=90.0, field_angle_deg=0.0,
    ... )
    >>> specimen = SpecimenFile.model_validate(
    ...     {"specimen": {"name": "bar", "material": "silicone", "length_mm": 8.0, "width_mm": 1.5,
    ...                   "depth_mm": 2.0, "density_kg_m3": 1070.0}}
    ... )
    >>> edges = find_edges(np.full((96, 128), 200, np.uint8), calibration, specimen)
    >>> len(edges.left.points_mm), "LOW_CONTRAST" in [flag.name for flag in edges.flags]
    (0, True)
    """
    age = {} if calibration_age_days is None else {"calibration_age_days": calibration_age_days}
    findings = {"contrast": 0.0, "clamp_seen": 0.0} | age
    search = BackLitSearch(BeamFrame(calibration), calibration.pixels_per_mm, specimen_file, findings, limits)
    search.projection, search.polarity = projection, calibration.picture.polarity if calibration.picture else None
    outlined = search.find_outline(image)
    lit_beam = outlined is not None and outlined.picture.lit_beam
    trusted = outlined is not None and not _is_in_doubt(image, search, lit_beam)
    edges = search.locate_edges(outlined, spacing_mm) if outlined is not None and trusted else None
    clicks = _clicks(calibration) if expected_mm is None else None
    if edges is not None and clicks is not None and _passes_beside(edges, search.frame, clicks):
        edges, outlined = None, None
    if edges is not None and not _is_in_doubt(image, search, lit_beam):
        flags = judge(findings, limits, search.words())
    else:
        followed = follow_beam(
            image,
            calibration,
            specimen_file,
            spacing_mm=spacing_mm,
            projection=projection,
            earlier=earlier,
            expected_mm=expected_mm,
            between_mm=between_mm,
        )
        followed_edges = _followed_edges(followed, search.frame, limits)
        if followed_edges is not None:
            clamp = {"followed_clamp": findings["clamp_seen"]}
            edges, flags = followed_edges, judge(followed.findings | clamp | age, limits, followed.words)
        else:
            if outlined is not None and not trusted and clicks is None:
                edges = search.locate_edges(
                    outlined, spacing_mm
                )  # better than none, although the silhouette is doubtful
            flags = judge(findings, limits, search.words())
            if edges is None:
                flags_of_following = judge(followed.findings, limits, followed.words)
                grave = {flag.name: flag for flag in reversed(flags_of_following) if flag.severity is Severity.UNUSABLE}
                grave = dict(reversed(grave.items()))  # the first flag of each name, in the order of the table
                is_photograph = np.ndim(image) == 3 or clicks is not None
                if is_photograph and grave:  # advice for a back-light does not help a photograph
                    flags = tuple(grave.values())
                else:
                    raised = {flag.name for flag in flags}
                    flags += tuple(flag for name, flag in grave.items() if name not in raised)
    nothing = EdgePoints(np.zeros((0, 2)), np.zeros(0))
    left, right, corners_px = edges or (nothing, nothing, np.full((4, 2), np.nan))
    return EdgeSet(left, right, flags, corners_px, calibration.digest, calibration_age_days)


def follow_beam(
    image: ArrayLike,
    calibration: Calibration,
    specimen_file: SpecimenFile,
    *,
    spacing_mm: float = 0.3,
    projection: Projection | None = None,
    earlier: Callable[[], EdgeSet | None] | None = None,
    expected_mm: Array | None = None,
    between_mm: Array | None = None,
) -> FollowedBeam:
    """Follow the beam from its clamp in one image, and keep the intermediate results.

    Parameters
    ----------
    image, calibration, specimen_file, spacing_mm, projection, earlier, expected_mm, between_mm
        See `find_edges`.

    Returns
    -------
    FollowedBeam
        Both edges in px, the measured values and the intermediate results.
    """
    pixels = np.asarray(image)
    if pixels.ndim not in (2, 3) or min(pixels.shape[:2]) < _SMALLEST_FRAME_PX:
        return FollowedBeam({"followed_length": 0.0})
    help_given = calibration.picture
    if projection is not None and help_given and (help_given.channel or help_given.beam_colour):
        pixels = projection.apply(pixels)
    beam = specimen_file.specimen
    frame = BeamFrame(calibration)
    is_near = calibration.stand_off_mm is None or calibration.stand_off_mm <= beam.depth_mm
    view = None if is_near else frame.view(beam.depth_mm, (pixels.shape[1], pixels.shape[0]))
    stated = stated_beam(frame, beam.length_mm, beam.width_mm, beam.depth_mm, view)
    clicks = _clicks(calibration)
    if expected_mm is not None:
        lines = [frame.to_px(np.vstack([[0.0, 0.0], line])) for line in (expected_mm, between_mm) if line is not None]
        stated = replace(stated, line=line_between(*lines) if between_mm is not None else carried_line(lines[0]))
        clicks = None
    elif clicks is not None:
        stated = replace(stated, line=clicked_line(stated.clamp_px, stated.ahead, clicks))
    polarity = help_given.polarity if help_given else None

    def earlier_px() -> Array | None:
        before = earlier() if earlier else None
        return None if before is None else frame.to_px(before.middle_mm)

    followed = follow(in_255(pixels), stated, spacing_mm * calibration.pixels_per_mm, polarity, earlier_px)
    return followed if clicks is None else with_clicks(followed, clicks, stated.width_px)


def _clicks(calibration: Calibration) -> Array | None:
    clicks = calibration.picture.along_px if calibration.picture else None
    return None if clicks is None else np.array(clicks)


def _passes_beside(edges: _Edges, frame: BeamFrame, clicks: Array) -> bool:
    """Return whether a point that a person clicked lies clearly outside the edges."""
    left, right = (frame.to_px(edge.points_mm) for edge in edges[:2])
    middle = 0.5 * (left + right[np.linalg.norm(left[:, None] - right, axis=2).argmin(axis=1)])
    half = 0.5 * float(np.median(np.linalg.norm(left[:, None] - right, axis=2).min(axis=1)))
    return bool(off_path(middle, clicks).max() > half + CLICKED_PX)


def _is_in_doubt(image: ArrayLike, search: BackLitSearch, lit_beam: bool) -> bool:
    doubts = {name: value for name, value in search.findings.items() if name in _OF_THE_OUTLINE}
    if np.ndim(image) == 2 and lit_beam:
        return leaves_out(judge(doubts, search.limits, search.words()))
    if np.ndim(image) == 2:
        # probably in front of a back-light, where the outline gives the best edges
        doubts = {name: value for name, value in doubts.items() if name == "touches_frame"}
    return bool(judge(doubts, search.limits, search.words()))


def _followed_edges(followed: FollowedBeam, frame: BeamFrame, limits: Mapping[str, float] | None) -> _Edges | None:
    if followed.edges is None or leaves_out(judge(followed.findings, limits, followed.words)):
        return None
    left, right = (_points(side, frame) for side in followed.edges)
    if frame.hand < 0.0:  # left is where y < 0, also in a mirrored view
        left, right = right, left
    return left, right, np.full((4, 2), np.nan)  # the corners are not located


def _points(side: StripEdges, frame: BeamFrame) -> EdgePoints:
    return EdgePoints(frame.to_mm(side.points), side.sigma * _pixel_mm(frame))


def _pixel_mm(frame: BeamFrame) -> float:
    origin, ahead = frame.to_px([[0.0, 0.0], [1.0, 0.0]])
    return 1.0 / float(np.linalg.norm(ahead - origin))
