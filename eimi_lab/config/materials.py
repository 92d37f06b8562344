"""materials.toml of a virtual rig: the true materials of its specimens, and the unstated properties of its bench."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.prony import Prony
from eimi_lab.config.calibration import Numbers
from eimi_lab.config.coil_shape import CoilShapeTable, Pair
from eimi_lab.config.toml import Document, Table, parse, read_text


class TrueMaterial(Table):
    """The true material of a virtual specimen: its law and the parameters."""

    model: str
    """Name of the law: neo-hookean, mooney-rivlin, yeoh or ogden."""
    parameters: dict[str, float]
    """Parameters of the law; a name ends with _Pa if the value is in pascal. With a series, of the long-term law."""
    prony_h: Numbers = ()
    """Prony series: mu_i / mu_inf of each term. Without a series the material is elastic; its beam rings with a loss
    factor of 0.1."""
    prony_tau_s: Numbers = ()
    """Relaxation time of each term."""

    @model_validator(mode="after")
    def _complete(self) -> TrueMaterial:
        if self.model not in LAWS:
            raise ValueError(f"model = {self.model!r} should be one of {', '.join(LAWS)}")
        if set(self.parameters) != set(self._keys):
            raise ValueError(
                f"parameters of {self.model} are {', '.join(self._keys)}; got {', '.join(self.parameters)}"
            )
        if len(self.prony_h) != len(self.prony_tau_s) or min((*self.prony_h, *self.prony_tau_s), default=1.0) <= 0:
            raise ValueError(
                f"prony_h = {list(self.prony_h)} and prony_tau_s = {list(self.prony_tau_s)} should be two lists of "
                "equal length, of numbers above 0"
            )
        return self

    @property
    def _keys(self) -> tuple[str, ...]:
        law = LAWS[self.model]
        return tuple(
            f"{name}_Pa" if unit == "Pa" else name for name, unit in zip(law.parameter_names, law.units, strict=True)
        )

    @property
    def series(self) -> Prony | None:
        """The Prony series; None without terms."""
        if not self.prony_h:
            return None
        h = np.array(self.prony_h)
        return Prony(h / (1 + h.sum()), np.array(self.prony_tau_s))

    @property
    def values(self) -> tuple[float, ...]:
        """The parameters in the law's order, moduli in Pa."""
        return tuple(self.parameters[key] for key in self._keys)


class TrueBench(Table):
    """The properties of a virtual bench that differ from its specimen file and its calibration."""

    magnetisation_angle_deg: float = Field(default=0.0, ge=-180.0, le=180.0)
    """Angle by which the magnetisation is turned from its stated direction."""
    cast_bend_mm: float = 0.0
    """Offset of the centre line by which the beam was cast with an even bend, at the end of its flexible part."""
    taper_mm: float = 0.0
    """Change of the width from the clamp to the end of the flexible part."""
    coil_constant_mT_per_A: float | None = Field(default=None, gt=0)
    """Field per current at the magnet, instead of the stated value."""
    background_field_mT: Pair | None = None
    """Field without a current, instead of the stated field: to the right and down in the image."""
    field: CoilShapeTable | None = None
    """The coil's field as a function of the place, instead of the stated field."""


class TrueMaterials(Document):
    """The contents of materials.toml."""

    silicone: dict[str, TrueMaterial]
    """One table for each material, under the name that specimen.material has."""
    bench: TrueBench | None = None
    """The properties in which the virtual bench differs from its files."""


def load_materials(path: Path) -> TrueMaterials:
    """Read a materials file; raise InputError if it is not valid."""
    return parse(TrueMaterials, read_text(path), path)
