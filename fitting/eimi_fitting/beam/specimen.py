"""The specimen: a beam of soft material, perhaps with a magnet at its tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

import eimi_fitting.laws.law as law
from eimi_fitting.beam.rest_shape import RestShape

Section = Literal["solid", law.Section]
VACUUM_PERMEABILITY = 4e-7 * np.pi  # T m / A
STANDARD_GRAVITY = 9.80665  # m / s²


@dataclass(frozen=True)
class Magnet:
    """A block magnet in the middle of the beam's width, magnetised along the beam toward the tip.

    The magnet lies at the distal end of the beam, or ``tip_offset_mm`` before this end. Silicone surrounds it where the
    specimen is wider, longer or deeper. In a planar model the silicone before and behind the magnet moves rigidly with
    it.

    Parameters
    ----------
    length_mm, width_mm, depth_mm : float
        Size along x, y and z.
    remanence_T : float
        Remanent flux density.
    density_kg_m3 : float
    tip_offset_mm : float
        Distance from the magnet's distal face to the tip of the specimen.
    magnetisation_angle_deg : float
        Angle between the magnetisation and the magnet's long axis, in the plane of the picture, from +x toward +y.

    Examples
    --------
    >>> magnet = Magnet(
    ...     length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0
    ... )
    >>> round(magnet.moment_A_m2, 4)
    0.0229
    """

    length_mm: float
    width_mm: float
    depth_mm: float
    remanence_T: float
    density_kg_m3: float
    tip_offset_mm: float = 0.0
    magnetisation_angle_deg: float = 0.0

    @property
    def moment_A_m2(self) -> float:
        """The magnitude of the dipole moment: remanence / mu0 times volume."""
        volume_m3 = self.length_mm * self.width_mm * self.depth_mm * 1e-9
        return self.remanence_T / VACUUM_PERMEABILITY * volume_m3

    @property
    def direction(self) -> tuple[float, float]:
        """The unit vector of the magnetisation in a magnet that lies along x."""
        angle = np.radians(self.magnetisation_angle_deg)
        return float(np.cos(angle)), float(np.sin(angle))


@dataclass(frozen=True)
class PressureFace:
    """The face under pressure: the left (y < 0) or right face, from ``from_mm`` to ``to_mm`` (None: to the tip)."""

    side: Literal["left", "right"]
    from_mm: float = 0.0
    to_mm: float | None = None


@dataclass(frozen=True)
class Specimen:
    """A beam that is clamped at x = 0; it is straight, with constant width and depth, unless ``rest_shape`` is given.

    The beam frame has x from the clamp along the beam, y across, and its origin in the middle of the clamp line. The
    width is along y, the depth out of the plane.

    Parameters
    ----------
    length_mm : float
        Length from the clamp to the tip, the magnet included, along the centre line.
    width_mm, depth_mm : float
        Width and depth. If they vary along the beam, the tables of ``rest_shape`` are added to these numbers.
    density_kg_m3 : float
        Density of the silicone.
    section : {"solid", "plane-stress", "plane-strain"}
        The model of the depth: the whole solid, or a planar assumption.
    magnet : Magnet or None
    tip_load_mm : tuple of float or None
        Material point at which a tip force acts: the arc length from the clamp, and the distance from the centre line.
        None: the middle of the tip.
    magnetisation_A_per_m : tuple of float
        Magnetisation of a silicone that was cast with magnetic powder, along and across the centre line at rest.
    pressure_face : PressureFace or None
    rest_shape : RestShape or None
        The stress-free shape; None for a straight beam of one width and depth.

    Examples
    --------
    >>> magnet = Magnet(
    ...     length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0
    ... )
    >>> beam = Specimen(
    ...     length_mm=30.0, width_mm=3.0, depth_mm=5.0, density_kg_m3=1070.0, section="plane-strain", magnet=magnet
    ... )
    >>> beam.flexible_length_mm
    26.0
    """

    length_mm: float
    width_mm: float
    depth_mm: float
    density_kg_m3: float
    section: Section = "solid"
    magnet: Magnet | None = None
    tip_load_mm: tuple[float, float] | None = None
    magnetisation_A_per_m: tuple[float, float] = (0.0, 0.0)
    pressure_face: PressureFace | None = None
    rest_shape: RestShape | None = None

    @property
    def planar_section(self) -> law.Section:
        """The section of a planar model; plane stress for a solid, because its error is the smallest."""
        return "plane-stress" if self.section == "solid" else self.section

    @property
    def flexible_length_mm(self) -> float:
        """The length between the clamp and the magnet."""
        magnet = self.magnet
        return self.length_mm - (magnet.length_mm + magnet.tip_offset_mm if magnet else 0.0)

    @property
    def field_place_mm(self) -> float:
        """The x of the place at which the strength of a field is stated: the middle of the magnet, else of the beam."""
        return self.flexible_length_mm + 0.5 * self.magnet.length_mm if self.magnet else 0.5 * self.length_mm
