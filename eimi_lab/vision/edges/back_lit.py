"""Locate both edges of a beam in front of a back-light, to a few hundredths of a pixel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.clamp_line import ClampLine, find_clamp_line
from eimi_lab.vision.edges.dimensions import (
    anticlastic_bow,
    even_turn_deg,
    length_deviation,
    local_widths,
    twist_deg,
    width_deviation,
)
from eimi_lab.vision.edges.edge_set import EdgePoints
from eimi_lab.vision.edges.passes import PassResult, Side, SiliconeMargin, first_pass, scatter_scale, second_pass
from eimi_lab.vision.edges.profiles import AVERAGED_PX, sample
from eimi_lab.vision.edges.quality import describe_turn_effects, light_findings
from eimi_lab.vision.edges.silhouette import Silhouette, find_silhouette, measure_back_light, root_places
from eimi_lab.vision.edges.stated_shape import StatedShape
from eimi_lab.vision.intensity import full_scale, grey
from eimi_lab.vision.projection import Projection

Array = NDArray[np.float64]

_SMALLEST_FRAME_PX = 16
_LEAST_SIGMA_PX = 1e-3  # for a drawn picture without noise, whose points do not scatter
_ABSURD_WIDTH = 0.5  # relative deviation of the width; such a body is not the beam, or not the beam alone
# Standard deviation of the place of a cast magnet across the beam. A magnet in little silicone may lie anywhere in it;
# its place then has the standard deviation of a uniform distribution.
_MAGNET_PLACE_MM = 0.2


@dataclass(frozen=True)
class _DarkBeamImage:
    pixels: NDArray[Any]
    largest: float
    lit_beam: bool


@dataclass(frozen=True)
class OutlinedBeam:
    """An image of a beam, with the clamp line and the outline of the beam (accurate to about a pixel)."""

    picture: _DarkBeamImage
    clamp: ClampLine
    silhouette: Silhouette


@dataclass
class BackLitSearch:
    """The search for the edges of a beam in one image, in front of a back-light.

    Attributes
    ----------
    frame : BeamFrame
        Map between pixels and millimetres.
    pixels_per_mm : float
        Scale.
    specimen_file : SpecimenFile
        The specimen and its magnet.
    findings : dict of str to float
        Measured values for the quality checks; filled by the search.
    limits : mapping of str to float, optional
        Limits that replace the usual limits of the quality checks.
    even_turn_deg : float
        Rotation of the beam about its axis that would explain its apparent width; 0 before the search.
    projection : Projection, optional
        Weights that convert colours to grey values.
    polarity : {"dark", "bright"}, optional
        Whether the beam is darker or brighter than its surroundings; None to decide from the image.
    """

    frame: BeamFrame
    pixels_per_mm: float
    specimen_file: SpecimenFile
    findings: dict[str, float]
    limits: Mapping[str, float] | None
    even_turn_deg: float = 0.0
    projection: Projection | None = None
    polarity: str | None = None

    def __post_init__(self) -> None:
        beam = self.specimen_file.specimen
        self.length_mm, self.width_mm, self.depth_mm = beam.length_mm, beam.width_mm, beam.depth_mm
        self.shape = StatedShape(self.specimen_file.mechanics())
        self.width_px = self.shape.narrowest_mm * self.pixels_per_mm

    def find_outline(self, image: ArrayLike) -> OutlinedBeam | None:
        """Find the outline of the beam and its corners, accurate to about a pixel.

        Parameters
        ----------
        image : array_like, shape (rows, columns) or (rows, columns, 3)
            The image.

        Returns
        -------
        OutlinedBeam or None
            None if no beam with two corners at its tip is found.
        """
        picture = self._dark_beam_image(image)
        outline = None if picture is None else self._outline(picture)
        return None if picture is None or outline is None else OutlinedBeam(picture, *outline)

    def locate_edges(self, beam: OutlinedBeam, spacing_mm: float) -> tuple[EdgePoints, EdgePoints, Array] | None:
        """Locate the left edge, the right edge and the corners of an outlined beam.

        Parameters
        ----------
        beam : OutlinedBeam
            The beam with its approximate outline.
        spacing_mm : float
            Desired distance between points along an edge.

        Returns
        -------
        left, right : EdgePoints
            The edges.
        corners_px : ndarray, shape (4, 2)
            Clamp-left, clamp-right, tip-left, tip-right.

            None is returned if an edge is too short, or if the body is too wide to be the beam.
        """
        picture = beam.picture
        located = self._two_passes(picture, beam.clamp, beam.silhouette, spacing_mm)
        if located is None:
            self.findings["residual"] = 1.0
            return None
        second, corners_px = located
        if not self._measure_shape(second, corners_px):
            return None
        second = self._without_steps(second, corners_px)
        self.findings |= light_findings(second, picture.largest, picture.lit_beam, self.limits)
        left, right = second.sides
        scatter = scatter_scale(left, right)
        return self._edge_points(left, scatter), self._edge_points(right, scatter), corners_px

    def _dark_beam_image(self, image: ArrayLike) -> _DarkBeamImage | None:
        """Convert an image to grey values with a dark beam; return None if it is no image or too small."""
        try:
            pixels = grey(image) if self.projection is None else self.projection.apply(image)
        except ValueError:
            return None
        if min(pixels.shape) < _SMALLEST_FRAME_PX:
            return None
        largest = full_scale(pixels)
        lit_beam = self.polarity == "bright"
        if self.polarity is None:
            lit_beam = _is_brighter_than_beside(pixels, self.frame, self.shape.at_clamp_mm)
        return _DarkBeamImage((largest - pixels).astype(pixels.dtype) if lit_beam else pixels, largest, lit_beam)

    def _outline(self, picture: _DarkBeamImage) -> tuple[ClampLine, Silhouette] | None:
        """Return the clamp line and the outline of the beam; None if no beam is found."""
        pixels = picture.pixels
        light = measure_back_light(pixels, self.frame, self.shape.at_clamp_mm)
        clamp = find_clamp_line(pixels, self.frame, self.shape.at_clamp_mm, light.bright)
        contrast = (light.bright - light.dark) / picture.largest if picture.largest else 0.0
        self.findings |= {"contrast": contrast, "clamp_seen": clamp.visible_share}
        # A root that is hardly darker than the light around it is not a beam.
        if light.bright - light.dark < 0.2 * light.bright or light.bright <= 0.0:
            self.findings["contrast"] = 0.0
            return None
        silhouette = find_silhouette(pixels, self.frame, clamp, light, self.shape)
        if silhouette is None:
            self.findings["length_deviation"] = 1.0
            return None
        self.findings |= {
            "touches_frame": float(silhouette.touches_frame),
            "other_bodies": float(silhouette.other_bodies),
            "hole_share": silhouette.hole_share,
            "corner_turn_deg": silhouette.turn_deg,
        }
        return None if silhouette.corners is None else (clamp, silhouette)

    def _two_passes(
        self, picture: _DarkBeamImage, clamp: ClampLine, silhouette: Silhouette, spacing_mm: float
    ) -> tuple[PassResult, Array] | None:
        """Locate the edges in two searches; return None if an edge is too short."""
        spacing_px = max(spacing_mm * self.pixels_per_mm, AVERAGED_PX)
        margin, hand = self._silicone_margin(), self.frame.hand
        first = first_pass(picture.pixels, silhouette, hand, spacing_px, self.width_px, margin)
        if first is None:
            return None
        left, tip, right = first.sides
        corners_px = _corners(clamp, left, tip, right, self.width_px)
        second = second_pass(picture.pixels, first, corners_px, hand, spacing_px, self.width_px, margin)
        return None if second is None else (second, corners_px)

    def _silicone_margin(self) -> SiliconeMargin:
        # without a magnet, the width is 0
        magnet = self.specimen_file.magnet
        silicone_mm = 0.5 * max(self.shape.at_magnet_mm - magnet.width_mm, 0.0) if magnet else 0.0
        from_tip_mm = magnet.length_mm + magnet.tip_offset_mm if magnet else 0.0
        return SiliconeMargin(
            silicone_mm * self.pixels_per_mm,
            min(_MAGNET_PLACE_MM, silicone_mm / math.sqrt(3.0)) * self.pixels_per_mm,
            from_tip_mm * self.pixels_per_mm,
        )

    def _measure_shape(self, second: PassResult, corners_px: Array) -> bool:
        """Store the measured shape of the beam in `findings`; return False if the body is too wide to be the beam."""
        left, right = (side.points_px[side.sound] for side in second.sides)
        # Widths as those of a beam that has its mean width everywhere.
        even = self.shape.even_widths(left, local_widths(left, right), corners_px[:2])
        width_px, depth_px = self.width_mm * self.pixels_per_mm, self.depth_mm * self.pixels_per_mm
        edge_length_px = self.shape.edge_length_mm * self.pixels_per_mm
        away_from_steps = ~self.shape.near_step(left, corners_px[:2], 0)  # where `even_widths` states a width
        bow = anticlastic_bow(left, right, width_px, depth_px)[away_from_steps]
        self.findings["width_deviation"] = width_deviation(even, width_px, bow)
        if self.findings["width_deviation"] > _ABSURD_WIDTH:
            return False
        self.even_turn_deg = even_turn_deg(even, width_px, depth_px)
        self.findings |= {
            "length_deviation": length_deviation(left, right, corners_px, edge_length_px),
            "twist_deg": twist_deg(even, width_px, depth_px),
            "clamp_offset_mm": float(np.linalg.norm(self.frame.to_mm(corners_px[:2]).mean(axis=0))),
        }
        return True

    def _without_steps(self, second: PassResult, corners_px: Array) -> PassResult:
        """Mark the edge points near an abrupt change of the beam's width as not usable."""
        near = [self.shape.near_step(side.points_px, corners_px[:2], i) for i, side in enumerate(second.sides)]
        sides = tuple(
            replace(side, sound=side.sound & ~left_out) for side, left_out in zip(second.sides, near, strict=True)
        )
        return replace(second, sides=sides, residual=np.where(np.concatenate(near), 0.0, second.residual))

    def _edge_points(self, side: Side, scatter: float) -> EdgePoints:
        """Return the usable points of one edge in mm; multiply their standard deviations by `scatter`."""
        kept = np.flatnonzero(side.sound)[:: side.stride]
        sigma_px = np.maximum(scatter * np.hypot(side.sigma_px, side.common_px)[kept], _LEAST_SIGMA_PX)
        return EdgePoints(self.frame.to_mm(side.points_px[kept]), sigma_px / self.pixels_per_mm)

    def words(self) -> dict[str, str]:
        """Return how a rotation of the beam about its axis changes a fitted modulus, as texts to insert in messages."""
        twist = self.findings.get("twist_deg", 0.0)
        return describe_turn_effects(twist, self.even_turn_deg, self.width_mm, self.depth_mm)


def _is_brighter_than_beside(image: NDArray[Any], frame: BeamFrame, width_mm: float) -> bool:
    inside, left, right = (
        float(np.median(sample(image, root_places(frame, width_mm, aside)))) for aside in (0.0, -1.5, 1.5)
    )
    return inside > 1.2 * max(left, right) + 1.0


def _corners(clamp: ClampLine, left: Side, tip: Side, right: Side, width_px: float) -> Array:
    """Return the corners of the beam, px: clamp-left, clamp-right, tip-left, tip-right."""
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
    """Return the centre and the unit direction of the total-least-squares line through points."""
    centre = points.mean(axis=0)
    return centre, np.linalg.svd(points - centre, full_matrices=False)[2][0]


def _crossing(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Return the point at which two lines (point, direction) cross; NaN if they are almost parallel."""
    directions = np.column_stack([one[1], -other[1]])
    if abs(np.linalg.det(directions)) < 0.1:
        return np.full(2, np.nan)
    return one[0] + one[1] * np.linalg.solve(directions, other[0] - one[0])[0]
