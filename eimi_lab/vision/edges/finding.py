"""Both edges of the beam from one image: by its silhouette in front of a back-light, or followed from its clamp."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity, leaves_out
from eimi_lab.vision.edges.back_lit import BackLitSearch
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.flags import judge
from eimi_lab.vision.following.edge_points import StripEdges
from eimi_lab.vision.following.follow import FollowedBeam, follow
from eimi_lab.vision.following.in_picture import in_255, stated_beam
from eimi_lab.vision.projection import Projection

Array = NDArray[np.float64]
Found = tuple[EdgePoints, EdgePoints, Array]

# What says of a silhouette that it is the beam's and something else's, or not all of it.
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
) -> EdgeSet:
    """The beam's edges in one image, (height, width) or (height, width, 3), of any depth.

    spacing_mm: wanted distance of the points along the edges; wider where that would give more than
    `passes.MOST_POINTS` or where profiles would overlap. Where they would lie farther apart than a tenth of the beam's
    width, more are looked for than are returned. A few pixels at the clamp line and at the corners are left out, where
    the profile is no clean step. A beam brighter than what is beside its root is taken for a lit one in front of a dark
    background. limits: in place of those of the table of flags, by the names of its findings. calibration_age_days: how
    old the calibration was when the image was taken. projection: of the image's colours, if it has any. earlier: gives
    the edges of a state before this one, by the same calibration; it is asked where several bodies may as well be the
    beam, and nowhere else: the one nearest to them is taken, and ROOT_AMBIGUOUS says so. A picture without a beam gives
    an edge set without points, and flags; it never raises for a picture.

    The silhouette comes first (`back_lit`): in front of a back-light it is at the limit that the noise sets. Where it
    gives no edges, or runs into something else, the beam is followed from its clamp (`eimi_lab.vision.following`).
    In a picture with colours that is also done where the silhouette is in doubt.
    """
    age = {} if calibration_age_days is None else {"calibration_age_days": calibration_age_days}
    findings = {"contrast": 0.0, "clamp_seen": 0.0} | age
    search = BackLitSearch(BeamFrame(calibration), calibration.pixels_per_mm, specimen_file, findings, limits)
    search.projection, search.polarity = projection, calibration.picture.polarity if calibration.picture else None
    outlined = search.outlined(image)
    sure = outlined is not None and not _is_in_doubt(image, search)
    found = search.edges(outlined, spacing_mm) if outlined is not None and sure else None
    if found is not None and not _is_in_doubt(image, search):
        flags = judge(findings, limits, search.words())
    else:
        followed = follow_beam(
            image, calibration, specimen_file, spacing_mm=spacing_mm, projection=projection, earlier=earlier
        )
        instead = _in_mm(followed, search.frame, limits)
        if instead is not None:
            seen = {"followed_clamp": findings["clamp_seen"]}
            found, flags = instead, judge(followed.findings | seen | age, limits, followed.words)
        else:
            if outlined is not None and not sure:  # the best there is, and what is wrong with it
                found = search.edges(outlined, spacing_mm)
            flags = judge(findings, limits, search.words())
            if found is None:
                known = {flag.name for flag in flags}
                told = judge(followed.findings, limits, followed.words)
                grave = {flag.name: flag for flag in told if flag.severity is Severity.UNUSABLE}
                flags += tuple(flag for name, flag in grave.items() if name not in known)
    nothing = EdgePoints(np.zeros((0, 2)), np.zeros(0))
    left, right, corners_px = found or (nothing, nothing, np.full((4, 2), np.nan))
    return EdgeSet(left, right, flags, corners_px, calibration.digest, calibration_age_days)


def follow_beam(
    image: ArrayLike,
    calibration: Calibration,
    specimen_file: SpecimenFile,
    *,
    spacing_mm: float = 0.3,
    projection: Projection | None = None,
    earlier: Callable[[], EdgeSet | None] | None = None,
) -> FollowedBeam:
    """The beam followed from its clamp in an image as for `find_edges`, with all that was found on the way.

    All colours are used, for each stretch of each edge its own projection of them, unless a person named one.
    """
    pixels = np.asarray(image)
    if pixels.ndim not in (2, 3) or min(pixels.shape[:2]) < _SMALLEST_FRAME_PX:
        return FollowedBeam({"followed_length": 0.0})
    help_given = calibration.picture
    if projection is not None and help_given and (help_given.channel or help_given.beam_colour):
        pixels = projection.apply(pixels)
    beam = specimen_file.specimen
    frame = BeamFrame(calibration)
    stated = stated_beam(frame, beam.length_mm, beam.width_mm)
    polarity = help_given.polarity if help_given else None

    def earlier_px() -> Array | None:
        before = earlier() if earlier else None
        return None if before is None else frame.to_px(before.middle_mm)

    return follow(in_255(pixels), stated, spacing_mm * calibration.pixels_per_mm, polarity, earlier_px)


def _is_in_doubt(image: ArrayLike, search: BackLitSearch) -> bool:
    """Whether a silhouette that gave edges is to be followed all the same."""
    doubts = {name: value for name, value in search.findings.items() if name in _OF_THE_OUTLINE}
    if np.ndim(image) == 2:  # in front of a back-light these say what is wrong, and the edges are the best there are
        doubts = {name: value for name, value in doubts.items() if name == "touches_frame"}
    return bool(judge(doubts, search.limits, search.words()))


def _in_mm(followed: FollowedBeam, frame: BeamFrame, limits: Mapping[str, float] | None) -> Found | None:
    """The edges that were followed; None where there are none, or what was found makes them unusable."""
    if followed.edges is None or leaves_out(judge(followed.findings, limits, followed.words)):
        return None
    left, right = (_points(side, frame) for side in followed.edges)
    if frame.hand < 0.0:  # left is where y < 0, whichever way the image shows it
        left, right = right, left
    return left, right, np.full((4, 2), np.nan)


def _points(side: StripEdges, frame: BeamFrame) -> EdgePoints:
    return EdgePoints(frame.to_mm(side.points), side.sigma * _mm_in_px(frame))


def _mm_in_px(frame: BeamFrame) -> float:
    origin, ahead = frame.to_px([[0.0, 0.0], [1.0, 0.0]])
    return 1.0 / float(np.linalg.norm(ahead - origin))
