"""Read materials.toml: the materials and the properties of the bench with which a virtual rig is simulated."""

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
    """The material of a simulated specimen: an elastic law with its parameters, and a Prony series."""

    model: str
    """Name of the law: neo-hookean, mooney-rivlin, yeoh or ogden."""
    parameters: dict[str, float]
    """Parameters of the law. A name ends in _Pa if its value is in pascal. With a Prony series, these are the
    parameters after complete relaxation.
    """
    prony_h: Numbers = ()
    """Prony series: the ratio mu_i / mu_inf for each term i, where mu_inf is the shear modulus after complete
    relaxation. Without a series the material is elastic, and a ring-down is simulated with a loss factor of 0.1.
    """
    prony_tau_s: Numbers = ()
    """Prony series: the relaxation time of each term."""

    @model_validator(mode="after")
    def _complete(self) -> TrueMaterial:
        if self.model not in LAWS:
            raise ValueError(f"model = {self.model!r} should be one of {', '.join(LAWS)}")
        if set(self.parameters) != set(self._keys):
            raise ValueError(
                f"parameters of {self.model} should be {', '.join(self._keys)}, not {', '.join(self.parameters)}"
            )
        if len(self.prony_h) != len(self.prony_tau_s) or min((*self.prony_h, *self.prony_tau_s), default=1.0) <= 0:
            raise ValueError(
                f"prony_h = {list(self.prony_h)} and prony_tau_s = {list(self.prony_tau_s)} should be two lists of "
                "equal length with numbers above 0"
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
        """The Prony series of the material; None for an elastic material."""
        if not self.prony_h:
            return None
        h = np.array(self.prony_h)
        return Prony(h / (1 + h.sum()), np.array(self.prony_tau_s))

    @property
    def values(self) -> tuple[float, ...]:
        """The parameters of the material in the order of its law, moduli in Pa."""
        return tuple(self.parameters[key] for key in self._keys)


class TrueBench(Table):
    """The true properties of a simulated bench that differ from the specimen file and the calibration file."""

    magnetisation_angle_deg: float = Field(default=0.0, ge=-180.0, le=180.0)
    """Angle between the true magnetisation and the direction in the specimen file."""
    cast_bend_mm: float = 0.0
    """Offset of the centre line at the end of the flexible part, for a beam that was cast with a constant curvature.
    The flexible part is the part between the clamp and the magnet.
    """
    taper_mm: float = 0.0
    """Change of the width from the clamp to the end of the flexible part."""
    coil_constant_mT_per_A: float | None = Field(default=None, gt=0)
    """True field at the magnet for each ampere; by default the value in the calibration."""
    background_field_mT: Pair | None = None
    """True field without a current: the components to the right and down in the picture. By default the field in the
    calibration.
    """
    field: CoilShapeTable | None = None
    """True field of the coil as a function of position; by default the field in the calibration."""


class TrueMaterials(Document):
    """The contents of materials.toml: the materials and the properties of a simulated bench."""

    silicone: dict[str, TrueMaterial]
    """One table for each material. The name of the table is the value of specimen.material in the specimen file."""
    bench: TrueBench | None = None
    """The true properties of the virtual bench, where they differ from the specimen file and the calibration."""


def load_materials(path: Path) -> TrueMaterials:
    """Read materials.toml, the materials with which a virtual rig is simulated.

    Raises InputError if the file is not valid.
    """
    return parse(TrueMaterials, read_text(path), path)
