"""The specimen: a beam of soft material that may have a magnet at its tip."""

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
    """A block magnet in the middle of the beam's width.

    By default it is magnetised along the beam, toward the tip.

    Parameters
    ----------
    length_mm, width_mm, depth_mm : float
        Size of the magnet along x, y and z.
    remanence_T : float
        Remanent flux density.
    density_kg_m3 : float
        Density of the magnet.
    tip_offset_mm : float
        Distance between the magnet and the tip of the specimen.
    magnetisation_angle_deg : float
        Angle from the direction of the magnet's length to the magnetisation, in the plane of the picture, from +x
        toward +y.

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
        """The magnitude of the dipole moment, B_r V / mu_0, with the remanence B_r and the volume V."""
        volume_m3 = self.length_mm * self.width_mm * self.depth_mm * 1e-9
        return self.remanence_T / VACUUM_PERMEABILITY * volume_m3

    @property
    def direction(self) -> tuple[float, float]:
        """The direction of the magnetisation as a unit vector: its components along the magnet's length and width."""
        angle = np.radians(self.magnetisation_angle_deg)
        return float(np.cos(angle)), float(np.sin(angle))


@dataclass(frozen=True)
class PressureFace:
    """The part of a side of the beam on which a pressure acts."""

    # The left side (y < 0) or the right side (y > 0).
    side: Literal["left", "right"]
    # Distance of the start of the part from the clamp.
    from_mm: float = 0.0
    # Distance of the end of the part from the clamp; None: the part ends at the tip.
    to_mm: float | None = None


@dataclass(frozen=True)
class Specimen:
    """A beam that is clamped at x = 0.

    The origin is the middle of the clamped section. x is along the beam, y across it (width), and z in depth.

    Parameters
    ----------
    length_mm : float
        Length along the centre line from the clamp to the tip, including the magnet.
    width_mm, depth_mm : float
        Width and depth. If they vary along the beam, the tables of ``rest_shape`` are added to these values.
    density_kg_m3 : float
        Density of the silicone.
    section : {"solid", "plane-stress", "plane-strain"}
        How the depth is modelled: in three dimensions ("solid"), or by a planar assumption.
    magnet : Magnet or None
        The magnet; None for a beam without a magnet.
    tip_load_mm : tuple of float or None
        Material point at which a tip force acts: arc length from the clamp, and distance from the centre line. None:
        the middle of the tip.
    magnetisation_A_per_m : tuple of float
        Magnetisation along and across the centre line at rest, for silicone that was cast with magnetic powder.
    pressure_face : PressureFace or None
        The part of a side on which a pressure acts; None if no pressure acts.
    rest_shape : RestShape or None
        The stress-free shape; None for a straight beam of constant width and depth.

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
        """The planar assumption, "plane-stress" or "plane-strain", for a planar model of the specimen.

        It is the ``section`` of the specimen, or "plane-stress" if the section is solid.
        """
        return "plane-stress" if self.section == "solid" else self.section

    @property
    def flexible_length_mm(self) -> float:
        """The length between the clamp and the magnet in mm; without a magnet, the whole length."""
        magnet = self.magnet
        return self.length_mm - (magnet.length_mm + magnet.tip_offset_mm if magnet else 0.0)

    @property
    def field_place_mm(self) -> float:
        """The distance in mm from the clamp to the point at which a non-uniform field is specified.

        The point is the middle of the magnet; without a magnet, it is the middle of the beam.
        """
        return self.flexible_length_mm + 0.5 * self.magnet.length_mm if self.magnet else 0.5 * self.length_mm
