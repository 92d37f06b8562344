"""Read the uncertainty of the current from the text of rig.toml that a dataset contains."""

from __future__ import annotations

from pydantic import ConfigDict

from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.config.toml import Document, parse, parse_table
from eimi_lab.config.uncertainty import OfRig, stated_sources

# A fit needs no driver: this module must not import `config.rig`, which imports all drivers.


class _RigUncertainty(Document):
    """The table [uncertainty] of a rig file."""

    model_config = ConfigDict(extra="ignore")

    uncertainty: OfRig | None = None


def stated_by_rig(text: str, origin: str, coil_constant_mT_per_A: float) -> tuple[StatedSource, ...]:
    """Return the uncertainty of the field that follows from the uncertainty of the current in a rig file.

    Parameters
    ----------
    text
        Text of rig.toml.
    origin
        Name of the text in error messages.
    coil_constant_mT_per_A
        Field at the magnet divided by the current, mT/A.

    Returns
    -------
    tuple of StatedSource
        The standard uncertainty of the field (mT); empty if the file has no table [uncertainty].

    Raises
    ------
    InputError
        If the table [uncertainty] is not valid.
    """
    rig = parse(_RigUncertainty, text, origin)
    supply = f"supply of {parse_table(text, origin).get('name')}"
    in_units = {"current_A": coil_constant_mT_per_A}
    return stated_sources("rig", rig.uncertainty, lambda _: supply, in_units)
