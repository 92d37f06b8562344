"""The table [uncertainty] in the files of specimens, calibrations and rigs.

The table contains standard uncertainties of the quantities in the file, by the keys of the quantities. 0 means that a
quantity is exact.
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
"""Key of the uncertainty of the focal length. The focal length itself is in the camera matrix and has no key."""

Table = dict[str, float]


def keys_of(file: File) -> dict[str, str]:
    """Return the permitted keys of the table [uncertainty], each with the name of the quantity in a fit.

    ``file`` is "specimen", "calibration" or "rig".
    """
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
                raise ValueError(f"{key} = {value:g} should be a standard uncertainty: 0 (exact) or a number above 0")
        return table

    return check


OfSpecimen = Annotated[Table, AfterValidator(_validator("specimen"))]
OfCalibration = Annotated[Table, AfterValidator(_validator("calibration", FOCAL_LENGTH))]
OfRig = Annotated[Table, AfterValidator(_validator("rig"))]


def check_sizes(table: Table, values: Mapping[str, tuple[str, float | None]], largest: float = LARGEST_SHARE) -> None:
    """Raise ValueError if the standard uncertainty of a quantity is implausibly large for the value of the quantity.

    Parameters
    ----------
    table
        The table [uncertainty]: standard uncertainties by key.
    values
        For each key to check, the name and the value of the quantity; None if the file does not contain the quantity.
    largest
        Largest permitted relative uncertainty.

    Raises
    ------
    ValueError
        If an uncertainty is larger than ``largest`` times the value, or if the file does not contain the quantity.
    """
    for key, uncertainty in table.items():
        if key not in values:
            continue
        place, value = values[key]
        if value is None:
            raise ValueError(
                f"[uncertainty] {key} = {uncertainty:g}: the file has no {place}; leave this uncertainty out"
            )
        if uncertainty > largest * value:
            raise ValueError(
                f"[uncertainty] {key} = {uncertainty:g} should be at most {largest:g} times {place} = {value:g}"
            )


def missing_keys(everything: str, table: Table | None, keys: Sequence[str]) -> tuple[str, ...]:
    """Return the keys of the quantities whose uncertainty the user did not give.

    Parameters
    ----------
    everything
        A name for all quantities of the file, such as "the specimen file"; returned alone if ``table`` is None.
    table
        The table [uncertainty]; None if the file has no such table.
    keys
        The keys of the quantities in the file.
    """
    if table is None:
        return (everything,)
    return tuple(key for key in keys if key not in table)


def stated_sources(
    file: File, table: Table | None, shared_by: Callable[[str], str], in_units: Mapping[str, float]
) -> tuple[StatedSource, ...]:
    """Convert a table [uncertainty] into the standard uncertainties that a fit takes into account.

    Parameters
    ----------
    file
        The kind of file.
    table
        The table [uncertainty]; None if the file has no such table.
    shared_by
        Function that returns, for a key, the name of the object that causes the error, such as an instrument.
    in_units
        Factor from the unit of the table to the unit of the fit, by key; 1 for an absent key.

    Returns
    -------
    tuple of StatedSource
        The standard uncertainties.
    """
    names = keys_of(file)
    return tuple(
        StatedSource(names[key], value * in_units.get(key, 1.0), shared_by(key))
        for key, value in (table or {}).items()
        if key in names
    )
