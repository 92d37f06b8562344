"""The uncertainty of a bench's current, read from the text of the rig.toml that a dataset stores.

This module is separate from `config.rig`, which imports every driver: a fit of a stored dataset needs no driver.
"""

from __future__ import annotations

from pydantic import ConfigDict

from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.config.toml import Document, parse, parse_table
from eimi_lab.config.uncertainty import OfRig, stated_sources


class _RigUncertainty(Document):
    """The table [uncertainty] of a rig; all other keys are ignored."""

    model_config = ConfigDict(extra="ignore")

    uncertainty: OfRig | None = None


def stated_by_rig(text: str, origin: str, coil_constant_mT_per_A: float) -> tuple[StatedSource, ...]:
    """Return the uncertainty of the current, converted into a field.

    Parameters
    ----------
    text
        The rig.toml as a dataset stores it.
    origin
        Name of the text in error messages.
    coil_constant_mT_per_A
        Field per current.

    Returns
    -------
    tuple of StatedSource
        The stated uncertainties. Datasets of one rig share the error of its supply.

    Raises
    ------
    InputError
        If the table [uncertainty] is not valid.
    """
    rig = parse(_RigUncertainty, text, origin)
    supply = f"supply of {parse_table(text, origin).get('name')}"
    in_units = {"current_A": coil_constant_mT_per_A}
    return stated_sources("rig", rig.uncertainty, lambda _: supply, in_units)
