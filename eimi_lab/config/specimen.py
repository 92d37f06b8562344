"""specimen.toml: a beam of soft material, perhaps with a magnet at its tip."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

import eimi_fitting.specimen as mechanics
from eimi_lab.config.reading import Document, Table, locate, parse, read_text

STRONGEST_kA_PER_M = 1600.0  # a remanence of 2 T, more than any magnetic powder has


class Beam(Table):
    """The beam as cast. length_mm runs from the clamp to the tip, the magnet included; width_mm is what is imaged.

    magnetisation_kA_per_m is that of silicone cast with magnetic powder, along and across the beam at rest.
    """

    name: str = Field(min_length=1)
    material: str = Field(min_length=1)
    length_mm: float = Field(gt=0)
    width_mm: float = Field(gt=0)
    depth_mm: float = Field(gt=0)
    density_kg_m3: float = Field(gt=0)
    section: mechanics.Section
    magnetisation_kA_per_m: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)


class Magnet(Table):
    """A block magnet magnetised along the beam toward the tip, at the distal end or tip_offset_mm before it."""

    length_mm: float = Field(gt=0)
    width_mm: float = Field(gt=0)
    depth_mm: float = Field(gt=0)
    remanence_T: float = Field(gt=0, le=2.0)
    density_kg_m3: float = Field(gt=0)
    tip_offset_mm: float = Field(default=0.0, ge=0)


class TipLoad(Table):
    """Where a tip force acts, in the beam frame."""

    x_mm: float
    y_mm: float


class SpecimenFile(Document):
    """A whole specimen.toml."""

    specimen: Beam
    magnet: Magnet | None = None
    tip_load: TipLoad | None = None

    @model_validator(mode="after")
    def _fits(self) -> SpecimenFile:
        beam = self.specimen
        if math.hypot(*beam.magnetisation_kA_per_m) > STRONGEST_kA_PER_M:
            x, y = beam.magnetisation_kA_per_m
            raise ValueError(
                f"specimen.magnetisation_kA_per_m = [{x:g}, {y:g}] must not exceed {STRONGEST_kA_PER_M:g} in strength"
            )
        if self.magnet:
            if self.magnet.length_mm >= beam.length_mm:
                raise ValueError(
                    f"magnet.length_mm = {self.magnet.length_mm:g} must be less than "
                    f"specimen.length_mm = {beam.length_mm:g}"
                )
            if self.magnet.length_mm + self.magnet.tip_offset_mm >= beam.length_mm:
                raise ValueError(
                    f"magnet.tip_offset_mm = {self.magnet.tip_offset_mm:g} must leave a flexible part: with "
                    f"magnet.length_mm = {self.magnet.length_mm:g} less than specimen.length_mm = {beam.length_mm:g}"
                )
            for side in ("width_mm", "depth_mm"):
                inner, outer = getattr(self.magnet, side), getattr(beam, side)
                if inner > outer:
                    raise ValueError(f"magnet.{side} = {inner:g} must not exceed specimen.{side} = {outer:g}")
        if self.tip_load:
            if not 0 < self.tip_load.x_mm <= beam.length_mm:
                raise ValueError(
                    f"tip_load.x_mm = {self.tip_load.x_mm:g} must lie on the beam, "
                    f"above 0 and up to specimen.length_mm = {beam.length_mm:g}"
                )
            if abs(self.tip_load.y_mm) > beam.width_mm / 2:
                raise ValueError(
                    f"tip_load.y_mm = {self.tip_load.y_mm:g} must lie on the beam, "
                    f"within half of specimen.width_mm = {beam.width_mm:g}"
                )
        return self

    def mechanics(self) -> mechanics.Specimen:
        """The specimen as the mechanics sees it."""
        beam = self.specimen
        along, across = beam.magnetisation_kA_per_m
        return mechanics.Specimen(
            length_mm=beam.length_mm,
            width_mm=beam.width_mm,
            depth_mm=beam.depth_mm,
            density_kg_m3=beam.density_kg_m3,
            section=beam.section,
            magnet=mechanics.Magnet(**self.magnet.model_dump()) if self.magnet else None,
            tip_load_mm=(self.tip_load.x_mm, self.tip_load.y_mm) if self.tip_load else None,
            magnetisation_A_per_m=(1e3 * along, 1e3 * across),
        )


def load_specimen(name: str | Path) -> SpecimenFile:
    """Read a specimen file, or a shipped one by its name ("type1"). Raises InputError."""
    file = locate(name, "specimens")
    return parse(SpecimenFile, read_text(file), file)
