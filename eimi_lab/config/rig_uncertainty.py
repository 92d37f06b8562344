"""How uncertain a bench's current is, by the text of the rig.toml that a dataset keeps.

Apart from `config.rig`, which knows every driver: a fit of a stored dataset wants none of them.
"""

from __future__ import annotations

from pydantic import ConfigDict

from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.config.toml import Document, parse, parse_table
from eimi_lab.config.uncertainty import OfRig, stated_of


class _Stated(Document):
    """What of a rig says how well its numbers are known, whatever else it holds."""

    model_config = ConfigDict(extra="ignore")

    uncertainty: OfRig | None = None


def stated_by_rig(text: str, origin: str, coil_constant_mT_per_A: float) -> tuple[StatedSource, ...]:
    """How uncertain the current is, as a field, by the text of a rig that a dataset keeps. Raises InputError."""
    found = parse(_Stated, text, origin)
    in_units = {"current_A": coil_constant_mT_per_A}
    return stated_of("rig", found.uncertainty, lambda _: f"supply of {parse_table(text, origin).get('name')}", in_units)
