"""specimen.toml: a beam of soft material, perhaps with a magnet at its tip."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, model_validator

import eimi_fitting.specimen as mechanics
from eimi_lab.config.reading import Document, Table, locate, parse, read_text


class Beam(Table):
    """The beam as cast. length_mm runs from the clamp to the tip, the magnet included; width_mm is what is imaged."""

    name: str = Field(min_length=1)
    material: str = Field(min_length=1)
    length_mm: float = Field(gt=0)
    width_mm: float = Field(gt=0)
    depth_mm: float = Field(gt=0)
    density_kg_m3: float = Field(gt=0)
    section: mechanics.Section


class Magnet(Table):
    """A block magnet at the distal end, magnetised along the beam toward the tip."""

    length_mm: float = Field(gt=0)
    width_mm: float = Field(gt=0)
    depth_mm: float = Field(gt=0)
    remanence_T: float = Field(gt=0, le=2.0)
    density_kg_m3: float = Field(gt=0)


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
        if self.magnet:
            if self.magnet.length_mm >= beam.length_mm:
                raise ValueError(
                    f"magnet.length_mm = {self.magnet.length_mm:g} must be less than "
                    f"specimen.length_mm = {beam.length_mm:g}"
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
        return mechanics.Specimen(
            length_mm=beam.length_mm,
            width_mm=beam.width_mm,
            depth_mm=beam.depth_mm,
            density_kg_m3=beam.density_kg_m3,
            section=beam.section,
            magnet=mechanics.Magnet(**self.magnet.model_dump()) if self.magnet else None,
            tip_load_mm=(self.tip_load.x_mm, self.tip_load.y_mm) if self.tip_load else None,
        )


def load_specimen(name: str | Path) -> SpecimenFile:
    """Read a specimen file, or a shipped one by its name ("type1"). Raises InputError."""
    file = locate(name, "specimens")
    return parse(SpecimenFile, read_text(file), file)
