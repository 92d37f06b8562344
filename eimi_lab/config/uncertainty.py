"""The table [uncertainty] of specimens, calibrations and rigs: standard uncertainties under the keys of the values.

An uncertainty of 0 means that the value is exact; an absent key means that the uncertainty is unknown.
`eimi_fitting.inference.evidence.sources.SOURCES` defines the keys.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated

from pydantic import AfterValidator

from eimi_fitting.inference.evidence.sources import SOURCES, File, StatedSource

LARGEST_SHARE = 0.1  # a larger relative uncertainty is assumed to be a typing error or a wrong unit

FOCAL_LENGTH = "focal_length_px"
"""Key for the uncertainty of the focal length, whose value is in the camera matrix and has no key of its own."""

Table = dict[str, float]


def keys_of(file: File) -> dict[str, str]:
    """Return the keys of a file's table [uncertainty], each with the name of its source of uncertainty."""
    return {source.key: name for name, source in SOURCES.items() if source.stated_in == file}


def _validator(file: File, *further_keys: str) -> Callable[[Table], Table]:
    keys = [*keys_of(file), *further_keys]

    def check(table: Table) -> Table:
        for key, value in table.items():
            if key not in keys:
                near = difflib.get_close_matches(key, keys, n=1)
                raise ValueError(
                    f"{key} is not a known key; "
                    + (f"did you mean {near[0]}?" if near else f"the known keys are {', '.join(keys)}")
                )
            if not 0 <= value < math.inf:
                raise ValueError(f"{key} = {value:g} should be a standard uncertainty: 0 (exact) or above")
        return table

    return check


OfSpecimen = Annotated[Table, AfterValidator(_validator("specimen"))]
OfCalibration = Annotated[Table, AfterValidator(_validator("calibration", FOCAL_LENGTH))]
OfRig = Annotated[Table, AfterValidator(_validator("rig"))]


def check_sizes(table: Table, values: Mapping[str, tuple[str, float | None]], largest: float = LARGEST_SHARE) -> None:
    """Check the uncertainties of quantities with a natural zero, such as lengths, against their values.

    Parameters
    ----------
    table
        The table [uncertainty].
    values
        For each key: the key of the value in the file, and the value; None if the file has no such value.
    largest
        Largest uncertainty allowed, as a fraction of the value.

    Raises
    ------
    ValueError
        If the file has no value for an uncertainty, or if the uncertainty is too large a fraction of the value.
    """
    for key, uncertainty in table.items():
        if key not in values:
            continue
        place, value = values[key]
        if value is None:
            raise ValueError(f"[uncertainty] {key} = {uncertainty:g}: there is no {place} to which it could belong")
        if uncertainty > largest * value:
            raise ValueError(
                f"[uncertainty] {key} = {uncertainty:g} should be at most {largest:g} of {place} = {value:g}"
            )


def missing_keys(everything: str, table: Table | None, keys: Sequence[str]) -> tuple[str, ...]:
    """Return the keys without a stated uncertainty; without a table, only the name ``everything``."""
    if table is None:
        return (everything,)
    return tuple(key for key in keys if key not in table)


def stated_sources(
    file: File, table: Table | None, shared_by: Callable[[str], str], in_units: Mapping[str, float]
) -> tuple[StatedSource, ...]:
    """Convert a table [uncertainty] into the sources of uncertainty that the inference uses.

    Parameters
    ----------
    file
        The kind of file.
    table
        The table [uncertainty]; None if the file has none.
    shared_by
        Function that names the object (an instrument, a specimen) whose error a key describes. Datasets with the same
        object share the error.
    in_units
        Factors from the unit of a key to the unit of its source; 1 if absent.
    """
    names = keys_of(file)
    return tuple(
        StatedSource(names[key], value * in_units.get(key, 1.0), shared_by(key))
        for key, value in (table or {}).items()
        if key in names
    )
