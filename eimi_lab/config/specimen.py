"""Read specimen.toml, which describes a beam of soft material, with or without a magnet at its tip."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PlainSerializer, WrapValidator, model_validator

import eimi_fitting.beam.specimen as mechanics
from eimi_fitting.beam.rest_shape import RestShape, centre_line
from eimi_fitting.beam.strip import Strip
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.config.csv_tables import read_table
from eimi_lab.config.size_along import rows_of, size_along, written
from eimi_lab.config.toml import Document, Table, locate, parse, read_text
from eimi_lab.config.uncertainty import OfSpecimen, check_sizes, stated_sources
from eimi_lab.process.paths import named_in

Array = NDArray[np.float64]

MEASURED: Literal["measured"] = "measured"
"""Value of `rest_shape` for a shape at rest that is measured in the states without load."""
SAME = 1e-3  # largest relative difference of two lengths that count as equal
_NAMED_CSV = re.compile(r"""^\s*rest_shape\s*=\s*(?P<value>["'](?P<name>[^"']+\.csv)["'])""", re.MULTILINE)
STRONGEST_kA_PER_M = 1600.0  # remanence of 2 T, which no magnetic powder reaches


LEAST_SIZE_MM = 0.05
"""Smallest permitted width or depth. A smaller number is assumed to be in metres."""


def _in_millimetres(size_mm: float) -> float:
    if size_mm < LEAST_SIZE_MM:
        raise ValueError(f"should be {LEAST_SIZE_MM:g} mm or more; if the number is in metres, write {1e3 * size_mm:g}")
    return size_mm


LEAST_LENGTH_MM = 1.0
"""Smallest permitted length of the beam. A smaller number is assumed to be in metres."""

IN_G_CM3 = (0.1, 20.0)
"""A number between these bounds is assumed to be a density in g/cm³, because no soft solid has such a density in kg/m³.
A smaller number is allowed, and makes the weight of the beam negligible.
"""


def _long_in_millimetres(length_mm: float) -> float:
    if length_mm < LEAST_LENGTH_MM:
        raise ValueError(
            f"should be {LEAST_LENGTH_MM:g} mm or more; if the number is in metres, write {1e3 * length_mm:g}"
        )
    return length_mm


def _in_kg_m3(density_kg_m3: float) -> float:
    least, most = IN_G_CM3
    if least <= density_kg_m3 <= most:
        raise ValueError(
            f"should be above {most:g} kg/m3 for a soft solid; if the number is in g/cm3, write {1e3 * density_kg_m3:g}"
        )
    return density_kg_m3


Density = Annotated[float, Field(gt=0), AfterValidator(_in_kg_m3)]
Size = Annotated[float, Field(gt=0), AfterValidator(_in_millimetres)]


CentreLine = Annotated[tuple[Annotated[tuple[float, float], Field(strict=False)], ...], Field(strict=False)]


class Beam(Table):
    """The beam in the shape in which it was cast."""

    name: str = Field(min_length=1)
    """Name of the specimen. The program assumes that the measured dimensions have the same errors in all datasets with
    this name.
    """
    material: str = Field(min_length=1)
    """Material of the beam; it must be equal to the material in the protocol."""
    length_mm: Annotated[float, Field(gt=0), AfterValidator(_long_in_millimetres)]
    """Length from the clamp to the tip, including a magnet."""
    width_mm: Annotated[Size, WrapValidator(size_along), PlainSerializer(written)]
    """Width across the beam, as the camera sees it. The bending stiffness is proportional to the cube of the width. If
    the width varies along the beam, give a table of rows [arc length, width] from the clamp to the tip. Two rows with
    the same arc length are a step.
    """
    depth_mm: Annotated[Size, WrapValidator(size_along), PlainSerializer(written)]
    """Depth along the line of sight of the camera: a number, or a table as for ``width_mm``."""
    density_kg_m3: Density
    """Density of the silicone."""
    poisson_ratio: float = Field(default=0.5, gt=0, le=0.5)
    """Poisson's ratio of the material at small strain. A fit assumes an incompressible material (0.5). For a ratio
    below 0.495, the result tells the effect of this assumption on the modulus.
    """
    section: mechanics.Section = "solid"
    """Model of the cross-section: "solid" for the beam in three dimensions, or one of the planar approximations
    "plane-stress" and "plane-strain".
    """
    magnetisation_kA_per_m: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)
    """Magnetisation of silicone that was cast with magnetic powder: the components along and across the unloaded
    beam.
    """
    rest_shape: Literal["measured", "straight"] | CentreLine = MEASURED
    """Shape of the beam without load. "measured": from the edges in the states that have neither a field nor a tip
    force; gravity must act along the beam. "straight": a straight beam with the width in width_mm. A centre line of
    another shape is given as points [x, y] from the clamp to the tip, or as the name of a CSV file in the same folder,
    with the columns x_mm and y_mm.
    """
    measured_with: str | None = Field(default=None, min_length=1)
    """Name of the instrument that measured the lengths. The error of the instrument is the same for all specimens with
    this name.
    """


class Magnet(Table):
    """A block magnet at the tip of the beam, or at the distance ``tip_offset_mm`` from the tip."""

    length_mm: Size
    """Length along the beam."""
    width_mm: Size
    """Width across the beam; at most the width of the beam."""
    depth_mm: Size
    """Depth along the line of sight of the camera; at most the depth of the beam."""
    remanence_T: float = Field(gt=0, le=2.0)
    """Remanence from the data sheet: 1.17 to 1.21 T for N35, 1.32 to 1.37 T for N45."""
    density_kg_m3: Density
    """Density of the magnet; 7500 kg/m³ for NdFeB."""
    tip_offset_mm: float = Field(default=0.0, ge=0)
    """Length of silicone between the magnet and the tip."""
    magnetisation_angle_deg: float = Field(default=0.0, ge=-180.0, le=180.0)
    """Direction of the magnetisation in the unloaded beam. An angle of 0 points along the beam toward the tip, and an
    angle of 90 points along the field of a positive current. Data sheets give a tolerance of 3 to 5 degrees; an
    error of 1 degree changes the modulus by 3 to 5 %.
    """


class TipLoad(Table):
    """The point of the beam at which a tip force acts."""

    x_mm: float | None = None
    """Distance of the point from the clamp, along the unloaded beam; by default ``length_mm``."""
    y_mm: float = 0.0
    """Distance of the point from the centre line, across the unloaded beam."""


class SpecimenFile(Document):
    """The contents of specimen.toml: the beam, its magnet, the point of a tip force, and their uncertainties."""

    specimen: Beam
    """The beam."""
    magnet: Magnet | None = None
    """A block magnet at the tip. Leave the table out if there is no magnet."""
    tip_load: TipLoad | None = None
    """Point at which a tip force acts; by default the middle of the tip."""
    uncertainty: OfSpecimen | None = None
    """Standard uncertainties. Most keys are the keys of the values, such as width_mm; the key for the width of the
    magnet is magnet_width_mm. 0 means exact. If a key is absent, the uncertainty is unknown, and a fit takes the value
    as exact.
    """

    @model_validator(mode="after")
    def _consistent(self) -> SpecimenFile:
        beam = self.specimen
        if math.hypot(*beam.magnetisation_kA_per_m) > STRONGEST_kA_PER_M:
            x, y = beam.magnetisation_kA_per_m
            raise ValueError(
                f"specimen.magnetisation_kA_per_m = [{x:g}, {y:g}] has the magnitude {math.hypot(x, y):g}, which "
                f"should be at most {STRONGEST_kA_PER_M:g}"
            )
        if self.magnet:
            if self.magnet.length_mm >= beam.length_mm:
                raise ValueError(
                    f"magnet.length_mm = {self.magnet.length_mm:g} should be less than "
                    f"specimen.length_mm = {beam.length_mm:g}"
                )
            if self.magnet.length_mm + self.magnet.tip_offset_mm >= beam.length_mm:
                raise ValueError(
                    f"magnet.tip_offset_mm = {self.magnet.tip_offset_mm:g} and magnet.length_mm = "
                    f"{self.magnet.length_mm:g} together should be less than specimen.length_mm = {beam.length_mm:g}, "
                    "so that a part of the beam is flexible"
                )
            for side in ("width_mm", "depth_mm"):
                inner, outer = getattr(self.magnet, side), self._least_at_magnet(self.magnet, side)
                if inner > outer:
                    raise ValueError(f"magnet.{side} = {inner:g} should be at most specimen.{side} = {outer:g}")
        if self.tip_load:
            if self.tip_load.x_mm is not None and not 0 < self.tip_load.x_mm <= beam.length_mm:
                raise ValueError(
                    f"tip_load.x_mm = {self.tip_load.x_mm:g} should be on the beam, "
                    f"above 0 and at most specimen.length_mm = {beam.length_mm:g}"
                )
            if abs(self.tip_load.y_mm) > beam.width_mm / 2:
                raise ValueError(
                    f"tip_load.y_mm = {self.tip_load.y_mm:g} should be on the beam, "
                    f"at most half of specimen.width_mm = {beam.width_mm:g} from the centre line"
                )
        check_sizes(self.uncertainty or {}, self._values())
        check_sizes(self.uncertainty or {}, self._sizes_of_deviations(), largest=0.5)  # more would be another specimen
        for key, rows in (("width_mm", rows_of(beam.width_mm)), ("depth_mm", rows_of(beam.depth_mm))):
            if rows and abs(rows[-1][0] / beam.length_mm - 1) > SAME:
                raise ValueError(
                    f"specimen.{key}: the table ends at the arc length {rows[-1][0]:g}, but should end at "
                    f"specimen.length_mm = {beam.length_mm:g}"
                )
        try:
            Strip(self.mechanics())
        except ValueError as error:
            raise ValueError(f"specimen.rest_shape: {error}") from error
        if self.magnet is None and "magnetisation_angle_deg" in (self.uncertainty or {}):
            raise ValueError(
                "[uncertainty] magnetisation_angle_deg: the file has no table [magnet]; leave this uncertainty out"
            )
        return self

    def _least_at_magnet(self, magnet: Magnet, side: str) -> float:
        """Return the smallest width or depth (mm) of the part of the beam in which the magnet lies.

        ``side`` is "width_mm" or "depth_mm".
        """
        size: float = getattr(self.specimen, side)
        rows = rows_of(size)
        if not rows:
            return size
        along, sizes = np.array(rows).T
        far = self.specimen.length_mm - magnet.tip_offset_mm
        near = far - magnet.length_mm
        inside = np.array([1e-6, -1e-6])  # if the size has a step at an end of the magnet, take the size at the magnet
        at_faces = np.interp(np.array([near, far]) + inside, along, sizes)
        return float(min([*at_faces, *sizes[(along > near) & (along < far)]]))

    def _values(self) -> dict[str, tuple[str, float | None]]:
        """Return the sizes, the densities and the remanence, by their keys in the table [uncertainty].

        An item is, for example, ``"magnet_width_mm": ("magnet.width_mm", 4.0)``. An absent quantity is None.
        """
        beam, magnet = self.specimen, self.magnet
        sizes = ("length_mm", "width_mm", "depth_mm", "density_kg_m3")
        return {
            **{key: (f"specimen.{key}", getattr(beam, key)) for key in sizes},
            **{f"magnet_{key}": (f"magnet.{key}", getattr(magnet, key, None)) for key in sizes},
            "remanence_T": ("magnet.remanence_T", getattr(magnet, "remanence_T", None)),
        }

    def _sizes_of_deviations(self) -> dict[str, tuple[str, float | None]]:
        """Return the sizes with which the uncertainties of further lengths are compared, by the keys of these."""
        length = ("specimen.length_mm", self.specimen.length_mm)
        width = ("specimen.width_mm", self.specimen.width_mm)
        return {"rest_shape_mm": length, "magnet_tip_offset_mm": length, "taper_mm": width}

    def uncertain_keys(self) -> tuple[str, ...]:
        """Return the keys that the table [uncertainty] of this specimen file may have."""
        keys = tuple(key for key, (_, value) in self._values().items() if value is not None)
        return (*keys, "magnetisation_angle_deg") if self.magnet else keys

    def stated_sources(self) -> tuple[StatedSource, ...]:
        """Return the standard uncertainties in the table [uncertainty], in the form for a fit.

        For each uncertainty, the result names the object (specimen or measuring instrument) that causes the error.
        """
        this_specimen = f"specimen {self.specimen.name}"
        instrument = self.specimen.measured_with

        def shared_by(key: str) -> str:
            return f"instrument {instrument}" if instrument and key.endswith("_mm") else this_specimen

        return stated_sources("specimen", self.uncertainty, shared_by, {})

    def mechanics(self) -> mechanics.Specimen:
        """Return the specimen in the form for the simulation of the beam (`eimi_fitting.beam.specimen.Specimen`)."""
        beam = self.specimen
        along, across = beam.magnetisation_kA_per_m
        return mechanics.Specimen(
            length_mm=beam.length_mm,
            width_mm=beam.width_mm,
            depth_mm=beam.depth_mm,
            density_kg_m3=beam.density_kg_m3,
            section=beam.section,
            magnet=mechanics.Magnet(**self.magnet.model_dump()) if self.magnet else None,
            tip_load_mm=self._tip_load_mm(),
            magnetisation_A_per_m=(1e3 * along, 1e3 * across),
            rest_shape=self._rest_shape(),
        )

    def _tip_load_mm(self) -> tuple[float, float] | None:
        """Return the point (x along, y across the beam, mm) at which a tip force acts; None for the tip's middle."""
        load = self.tip_load
        if load is None:
            return None
        return self.specimen.length_mm if load.x_mm is None else load.x_mm, load.y_mm

    def _rest_shape(self) -> RestShape | None:
        """Return the shape of the beam without load; None if the file gives a straight beam of constant section."""
        beam = self.specimen
        turns = () if isinstance(beam.rest_shape, str) else centre_line(np.array(beam.rest_shape), beam.length_mm)
        widths, depths = (
            tuple((along / beam.length_mm, size - mean) for along, size in rows_of(mean))
            for mean in (beam.width_mm, beam.depth_mm)
        )
        return RestShape(turns, widths, depths) if turns or widths or depths else None


def load_specimen(name: str | Path) -> SpecimenFile:
    """Read a specimen from a path, or a shipped specimen by its name ("type1").

    Raises InputError if a file cannot be read, or if the specimen is not valid.
    """
    file = locate(name, "specimens")
    text = read_text(file)
    match = _NAMED_CSV.search(text)
    if match:
        rows = read_table(named_in(file, match["name"]), ("x_mm", "y_mm"))
        points = ", ".join(f"[{row.number('x_mm')!r}, {row.number('y_mm')!r}]" for row in rows)
        text = f"{text[: match.start('value')]}[{points}]{text[match.end('value') :]}"
    return parse(SpecimenFile, text, file)
