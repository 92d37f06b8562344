"""specimen.toml: a beam of soft material, with or without a magnet at its tip."""

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
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.config.csv_tables import read_table
from eimi_lab.config.size_along import rows_of, size_along, written
from eimi_lab.config.toml import Document, Table, locate, parse, read_text
from eimi_lab.config.uncertainty import OfSpecimen, check_sizes, stated_sources
from eimi_lab.process.paths import named_in

Array = NDArray[np.float64]

MEASURED: Literal["measured"] = "measured"
"""The shape at rest is measured in the states without load."""
SAME = 1e-3  # relative difference within which two lengths are the same
_NAMED_CSV = re.compile(r"""^\s*rest_shape\s*=\s*(?P<value>["'](?P<name>[^"']+\.csv)["'])""", re.MULTILINE)
STRONGEST_kA_PER_M = 1600.0  # a remanence of 2 T, more than that of any magnetic powder


LEAST_SIZE_MM = 0.05
"""A smaller size is assumed to be given in metres: no beam of silicone is cast so thin."""


def _in_millimetres(size_mm: float) -> float:
    if size_mm < LEAST_SIZE_MM:
        raise ValueError(
            f"is below {LEAST_SIZE_MM:g} mm; the unit is millimetres, and in metres this would be {1e3 * size_mm:g} mm"
        )
    return size_mm


LEAST_LENGTH_MM = 1.0
"""A shorter beam is assumed to be given in metres."""

IN_G_CM3 = (0.1, 20.0)
"""A density between these numbers is assumed to be given in g/cm³. No soft solid is as light in kg/m³, and a smaller
density leaves the weight out."""


def _long_in_millimetres(length_mm: float) -> float:
    if length_mm < LEAST_LENGTH_MM:
        raise ValueError(
            f"is below {LEAST_LENGTH_MM:g} mm; the unit is millimetres, and in metres this would be "
            f"{1e3 * length_mm:g} mm"
        )
    return length_mm


def _in_kg_m3(density_kg_m3: float) -> float:
    least, most = IN_G_CM3
    if least <= density_kg_m3 <= most:
        raise ValueError(f"is too light for a soft solid in kg/m3; if it is in g/cm3, write {1e3 * density_kg_m3:g}")
    return density_kg_m3


Density = Annotated[float, Field(gt=0), AfterValidator(_in_kg_m3)]
Size = Annotated[float, Field(gt=0), AfterValidator(_in_millimetres)]


CentreLine = Annotated[tuple[Annotated[tuple[float, float], Field(strict=False)], ...], Field(strict=False)]


class Beam(Table):
    """The beam as cast."""

    name: str = Field(min_length=1)
    """Name of the specimen; datasets with the same name share its dimensions and their errors."""
    material: str = Field(min_length=1)
    """Material of the beam; the protocol's material must be the same."""
    length_mm: Annotated[float, Field(gt=0), AfterValidator(_long_in_millimetres)]
    """Length from the clamp to the tip, including a magnet."""
    width_mm: Annotated[Size, WrapValidator(size_along), PlainSerializer(written)]
    """Width across the beam, as the camera sees it; the bending stiffness grows with its cube. Where it varies: a table
    of rows [arc length, width] from the clamp to the tip. Two rows at one arc length are a step."""
    depth_mm: Annotated[Size, WrapValidator(size_along), PlainSerializer(written)]
    """Depth along the camera's line of sight; a number, or a table as for ``width_mm``."""
    density_kg_m3: Density
    """Density of the silicone."""
    poisson_ratio: float = Field(default=0.5, gt=0, le=0.5)
    """Poisson's ratio of the material at small strain. A fit assumes an incompressible material; below 0.495 it
    states the effect of this assumption on the modulus."""
    section: mechanics.Section = "solid"
    """Model of the depth: the solid beam, or one of two planar approximations."""
    magnetisation_kA_per_m: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)
    """Magnetisation of silicone cast with magnetic powder, along and across the beam at rest."""
    rest_shape: Literal["measured", "straight"] | CentreLine = MEASURED
    """Shape without load. "measured": from the states without field and tip force; gravity must act along the beam, and
    these states must have edges. "straight": straight, with the stated widths. Otherwise the centre line: the name of a
    CSV file beside this one (columns x_mm, y_mm, from the clamp to the tip), or its points [x, y]."""
    measured_with: str | None = Field(default=None, min_length=1)
    """Instrument that measured the lengths; specimens that name the same one share its error."""


class Magnet(Table):
    """A block magnet at the tip or ``tip_offset_mm`` before it, magnetised along the beam toward the tip."""

    length_mm: Size
    """Length along the beam."""
    width_mm: Size
    """Width across the beam; at most that of the specimen."""
    depth_mm: Size
    """Depth along the camera's line of sight; at most that of the specimen."""
    remanence_T: float = Field(gt=0, le=2.0)
    """Remanence from the data sheet: 1.17 to 1.21 T for N35, 1.32 to 1.37 T for N45."""
    density_kg_m3: Density
    """Density of the magnet; 7500 kg/m³ for NdFeB."""
    tip_offset_mm: float = Field(default=0.0, ge=0)
    """Length of silicone between the magnet and the tip."""
    magnetisation_angle_deg: float = Field(default=0.0, ge=-180.0, le=180.0)
    """Direction of the magnetisation at rest: 0 along the beam toward the tip, positive toward the positive field.
    Data sheets give its uncertainty as 3 to 5 degrees; 1 degree changes the modulus by 3 to 5 %."""


class TipLoad(Table):
    """The material point at which a tip force acts; it moves with the beam."""

    x_mm: float | None = None
    """Distance from the clamp along the beam; without this key the tip, wherever ``length_mm`` puts it."""
    y_mm: float = 0.0
    """Distance across the beam from its middle."""


class SpecimenFile(Document):
    """The contents of specimen.toml."""

    specimen: Beam
    """The beam as cast."""
    magnet: Magnet | None = None
    """A block magnet magnetised along the beam toward the tip; omit the table if there is none."""
    tip_load: TipLoad | None = None
    """Point at which a tip force acts; by default the middle of the tip."""
    uncertainty: OfSpecimen | None = None
    """Standard uncertainties under the keys of the values, such as magnet_width_mm for the magnet. 0 means exact."""

    @model_validator(mode="after")
    def _consistent(self) -> SpecimenFile:
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
                inner, outer = getattr(self.magnet, side), self._least_at_magnet(self.magnet, side)
                if inner > outer:
                    raise ValueError(f"magnet.{side} = {inner:g} must not exceed specimen.{side} = {outer:g}")
        if self.tip_load:
            if self.tip_load.x_mm is not None and not 0 < self.tip_load.x_mm <= beam.length_mm:
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
        for key, rows in (("width_mm", rows_of(beam.width_mm)), ("depth_mm", rows_of(beam.depth_mm))):
            if rows and abs(rows[-1][0] / beam.length_mm - 1) > SAME:
                raise ValueError(
                    f"specimen.{key}: the table ends at {rows[-1][0]:g}, and should end at "
                    f"specimen.length_mm = {beam.length_mm:g}"
                )
        try:
            self.mechanics()
        except ValueError as error:
            raise ValueError(f"specimen.rest_shape: {error}") from error
        if self.magnet is None and "magnetisation_angle_deg" in (self.uncertainty or {}):
            raise ValueError(
                "[uncertainty] magnetisation_angle_deg: there is no magnet.magnetisation_angle_deg to which it could "
                "belong"
            )
        return self

    def _least_at_magnet(self, magnet: Magnet, side: str) -> float:
        """Return the smallest width or depth of the beam along its magnet."""
        size: float = getattr(self.specimen, side)
        rows = rows_of(size)
        if not rows:
            return size
        along, sizes = np.array(rows).T
        far = self.specimen.length_mm - magnet.tip_offset_mm
        near = far - magnet.length_mm
        inside = np.array([1e-6, -1e-6])  # a step at a face of the magnet counts with its side at the magnet
        at_faces = np.interp(np.array([near, far]) + inside, along, sizes)
        return float(min([*at_faces, *sizes[(along > near) & (along < far)]]))

    def _values(self) -> dict[str, tuple[str, float | None]]:
        """Return, for each key of [uncertainty] that is compared with a value, the key of this value and the value."""
        beam, magnet = self.specimen, self.magnet
        sizes = ("length_mm", "width_mm", "depth_mm", "density_kg_m3")
        return {
            **{key: (f"specimen.{key}", getattr(beam, key)) for key in sizes},
            **{f"magnet_{key}": (f"magnet.{key}", getattr(magnet, key, None)) for key in sizes},
            "remanence_T": ("magnet.remanence_T", getattr(magnet, "remanence_T", None)),
        }

    def uncertain_keys(self) -> tuple[str, ...]:
        """Return the keys that have a value in this specimen and may have an uncertainty."""
        keys = tuple(key for key, (_, value) in self._values().items() if value is not None)
        return (*keys, "magnetisation_angle_deg") if self.magnet else keys

    def stated_sources(self) -> tuple[StatedSource, ...]:
        """Return the uncertainties that the file states.

        Datasets of one specimen share its errors. Lengths measured with one instrument share the instrument's error.
        """
        this_specimen = f"specimen {self.specimen.name}"
        instrument = self.specimen.measured_with

        def shared_by(key: str) -> str:
            return f"instrument {instrument}" if instrument and key.endswith("_mm") else this_specimen

        return stated_sources("specimen", self.uncertainty, shared_by, {})

    def mechanics(self) -> mechanics.Specimen:
        """Return the specimen as the finite-element model needs it, in the units of `eimi_fitting.beam.specimen`."""
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
        """Return the point at which a tip force acts; None: the middle of the tip."""
        load = self.tip_load
        if load is None:
            return None
        return self.specimen.length_mm if load.x_mm is None else load.x_mm, load.y_mm

    def _rest_shape(self) -> RestShape | None:
        """Return the stated shape of the unloaded beam; None for a straight beam of one width and depth."""
        beam = self.specimen
        turns = () if isinstance(beam.rest_shape, str) else centre_line(np.array(beam.rest_shape), beam.length_mm)
        widths, depths = (
            tuple((along / beam.length_mm, size - mean) for along, size in rows_of(mean))
            for mean in (beam.width_mm, beam.depth_mm)
        )
        return RestShape(turns, widths, depths) if turns or widths or depths else None


def load_specimen(name: str | Path) -> SpecimenFile:
    """Read a specimen from a path, or a shipped specimen by its name ("type1"); raise InputError if it is not valid.

    The points of a centre line in a CSV file replace the name of that file in the text, so that the text is complete.
    """
    file = locate(name, "specimens")
    text = read_text(file)
    stated = _NAMED_CSV.search(text)
    if stated:
        rows = read_table(named_in(file, stated["name"]), ("x_mm", "y_mm"))
        points = ", ".join(f"[{row.number('x_mm')!r}, {row.number('y_mm')!r}]" for row in rows)
        text = f"{text[: stated.start('value')]}[{points}]{text[stated.end('value') :]}"
    return parse(SpecimenFile, text, file)
