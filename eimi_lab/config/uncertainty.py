"""The table [uncertainty] in the files of specimens, calibrations and rigs.

The table contains standard uncertainties of the quantities in the file. An uncertainty has the same key as its
quantity. 0 means that the quantity is exact, and an absent key means that the uncertainty is unknown.
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
"""Key of the uncertainty of the focal length. The focal length itself is in the camera matrix and has no key."""

Table = dict[str, float]


def keys_of(file: File) -> dict[str, str]:
    """Return the permitted keys of the table [uncertainty] in one kind of TOML file.

    The value of each key is the name that a fit uses for the uncertain quantity. ``file`` is "specimen", "calibration"
    or "rig".
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
        The quantities to check, by the key of the uncertainty: the key of the quantity in the file, and its value; None
        if the file does not contain the quantity. Quantities for which a relative uncertainty is not meaningful, such
        as angles, are absent.
    largest
        Largest permitted relative uncertainty.

    Raises
    ------
    ValueError
        If an uncertainty is larger than ``largest`` times the value of the quantity, or if the file contains the
        uncertainty of a quantity but not the quantity.
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
    """Return the keys of the quantities whose uncertainty the user did not give, to remind the user of them.

    Parameters
    ----------
    everything
        A name for all quantities of the file together, such as "the specimen file". If ``table`` is None, only this
        name is returned.
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
        Function that returns, for a key, the name of the object that causes the error, such as an instrument or a
        specimen. The error is common to all datasets with the same object.
    in_units
        Factor by key, which converts the unit of the table into the unit that the fit uses. The factor is 1 for a key
        that is absent.

    Returns
    -------
    tuple of StatedSource
        For each key of the table: the name of the quantity, its standard uncertainty, and the object that causes the
        error.
    """
    names = keys_of(file)
    return tuple(
        StatedSource(names[key], value * in_units.get(key, 1.0), shared_by(key))
        for key, value in (table or {}).items()
        if key in names
    )
