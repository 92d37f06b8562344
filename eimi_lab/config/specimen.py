"""specimen.toml: a beam of soft material, perhaps with a magnet at its tip."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

import eimi_fitting.beam.specimen as mechanics
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.config.toml import Document, Table, locate, parse, read_text
from eimi_lab.config.uncertainty import OfSpecimen, check_sizes, stated_of

STRONGEST_kA_PER_M = 1600.0  # a remanence of 2 T, more than any magnetic powder has


class Beam(Table):
    """The beam as cast. length_mm runs from the clamp to the tip, the magnet included; width_mm is what is imaged.

    measured_with is the instrument that measured the lengths: specimens that name the same one share its error.
    magnetisation_kA_per_m is that of silicone cast with magnetic powder, along and across the beam at rest.
    """

    name: str = Field(min_length=1)
    """What the specimen is called: datasets of one name share its dimensions and their errors."""
    material: str = Field(min_length=1)
    """What it is made of; a protocol has to name the same."""
    length_mm: float = Field(gt=0)
    """From the clamp to the tip, a magnet included."""
    width_mm: float = Field(gt=0)
    """Across the beam, as the camera sees it; the stiffness goes with its cube."""
    depth_mm: float = Field(gt=0)
    """Along the camera's view."""
    density_kg_m3: float = Field(gt=0)
    """Of the silicone."""
    section: mechanics.Section = "solid"
    """What is taken of the depth: the solid that the beam is, or a planar assumption."""
    magnetisation_kA_per_m: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)
    """Of silicone cast with magnetic powder, along and across the beam at rest."""
    measured_with: str | None = Field(default=None, min_length=1)
    """The instrument that measured the lengths: specimens that name the same one share its error."""


class Magnet(Table):
    """A block magnet magnetised along the beam toward the tip, at the distal end or tip_offset_mm before it."""

    length_mm: float = Field(gt=0)
    """Along the beam."""
    width_mm: float = Field(gt=0)
    """Across the beam; at most the specimen's."""
    depth_mm: float = Field(gt=0)
    """Along the camera's view; at most the specimen's."""
    remanence_T: float = Field(gt=0, le=2.0)
    """Of the data sheet: 1.17 to 1.21 T for N35, 1.32 to 1.37 T for N45."""
    density_kg_m3: float = Field(gt=0)
    """Of the magnet; 7500 kg/m³ for NdFeB."""
    tip_offset_mm: float = Field(default=0.0, ge=0)
    """Silicone between the magnet and the tip."""


class TipLoad(Table):
    """Where a tip force acts, in the beam frame."""

    x_mm: float
    """Along the beam at rest, from the clamp."""
    y_mm: float
    """Across it, from the middle."""


class SpecimenFile(Document):
    """A whole specimen.toml. uncertainty: standard uncertainties, of the magnet's sizes as magnet_width_mm."""

    specimen: Beam
    """The beam as cast."""
    magnet: Magnet | None = None
    """A block magnet magnetised along the beam toward the tip; without one leave the table out."""
    tip_load: TipLoad | None = None
    """Where a tip force acts; the middle of the tip unless given."""
    uncertainty: OfSpecimen | None = None
    """Standard uncertainties under the keys of the values, the magnet's as magnet_width_mm. 0 is exact."""

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
        check_sizes(self.uncertainty or {}, self._values())
        return self

    def _values(self) -> dict[str, tuple[str, float | None]]:
        """What an uncertainty is a share of, by its key: where it stands, and its value; an offset may be zero."""
        beam, magnet = self.specimen, self.magnet
        sizes = ("length_mm", "width_mm", "depth_mm", "density_kg_m3")
        return {
            **{key: (f"specimen.{key}", getattr(beam, key)) for key in sizes},
            **{f"magnet_{key}": (f"magnet.{key}", getattr(magnet, key, None)) for key in sizes},
            "remanence_T": ("magnet.remanence_T", getattr(magnet, "remanence_T", None)),
        }

    def keys_that_count(self) -> tuple[str, ...]:
        """Keys whose values this specimen has."""
        return tuple(key for key, (_, value) in self._values().items() if value is not None)

    def stated(self) -> tuple[StatedSource, ...]:
        """How uncertain its numbers are; lengths by one instrument and all numbers of one specimen err together."""
        own = f"specimen {self.specimen.name}"
        instrument = self.specimen.measured_with

        def of(key: str) -> str:
            return f"instrument {instrument}" if instrument and key.endswith("_mm") else own

        return stated_of("specimen", self.uncertainty, of, {})

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
