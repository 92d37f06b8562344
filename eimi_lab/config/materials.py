"""materials.toml of a virtual rig: what its specimens are really made of."""

from __future__ import annotations

from pathlib import Path

from pydantic import model_validator

from eimi_fitting.laws import LAWS
from eimi_lab.config.toml import Document, Table, parse, read_text


class TrueMaterial(Table):
    """What a virtual specimen is made of: a model's parameters, with `_Pa` on those in pascal."""

    model: str
    """neo-hookean, mooney-rivlin, yeoh or ogden."""
    parameters: dict[str, float]
    """The law's, with _Pa on those in pascal."""

    @model_validator(mode="after")
    def _complete(self) -> TrueMaterial:
        if self.model not in LAWS:
            raise ValueError(f"model = {self.model!r} should be one of {', '.join(LAWS)}")
        if set(self.parameters) != set(self._keys):
            raise ValueError(
                f"parameters of {self.model} are {', '.join(self._keys)}; got {', '.join(self.parameters)}"
            )
        return self

    @property
    def _keys(self) -> tuple[str, ...]:
        law = LAWS[self.model]
        return tuple(
            f"{name}_Pa" if unit == "Pa" else name for name, unit in zip(law.parameter_names, law.units, strict=True)
        )

    @property
    def values(self) -> tuple[float, ...]:
        """The parameters in the law's order, moduli in Pa."""
        return tuple(self.parameters[key] for key in self._keys)


class TrueMaterials(Document):
    """A whole materials.toml, by the name that a specimen gives its material."""

    silicone: dict[str, TrueMaterial]
    """One table for each material, under the name that a specimen gives it."""


def load_materials(path: Path) -> TrueMaterials:
    """Read a materials file. Raises InputError."""
    return parse(TrueMaterials, read_text(path), path)
