"""The specimen as the mechanics sees it: a beam of soft material, perhaps with a magnet at its tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

VACUUM_PERMEABILITY = 4e-7 * np.pi  # T m / A
STANDARD_GRAVITY = 9.80665  # m / s²

Section = Literal["plane-strain", "plane-stress"]


@dataclass(frozen=True)
class Magnet:
    """A block magnet at the distal end, magnetised along the beam toward the tip."""

    length_mm: float
    width_mm: float
    depth_mm: float
    remanence_T: float
    density_kg_m3: float

    @property
    def moment_A_m2(self) -> float:
        """Dipole moment: remanence / mu0 times volume."""
        volume_m3 = self.length_mm * self.width_mm * self.depth_mm * 1e-9
        return self.remanence_T / VACUUM_PERMEABILITY * volume_m3


@dataclass(frozen=True)
class Specimen:
    """A straight beam, clamped at x = 0, the magnet's length included in ``length_mm``.

    Beam frame: x from the clamp to the tip, y across, origin at the middle of the clamp line; width is along y,
    depth out of the plane. ``tip_load_mm`` is where a tip force acts (middle of the tip unless given).
    ``magnetisation_A_per_m`` is that of a silicone cast with magnetic powder, in the beam frame at rest.
    """

    length_mm: float
    width_mm: float
    depth_mm: float
    density_kg_m3: float
    section: Section
    magnet: Magnet | None = None
    tip_load_mm: tuple[float, float] | None = None
    magnetisation_A_per_m: tuple[float, float] = (0.0, 0.0)

    @property
    def flexible_length_mm(self) -> float:
        """Length between the clamp and the magnet."""
        return self.length_mm - (self.magnet.length_mm if self.magnet else 0.0)
