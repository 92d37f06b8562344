"""[uncertainty] of specimen, calibration and rig: standard uncertainties under the keys of the values.

0 says that a number is exact; a key that is absent, that nobody knows how good it is. The keys are those of
`eimi_fitting.inference.evidence.sources.SOURCES`.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated

from pydantic import AfterValidator

from eimi_fitting.inference.evidence.sources import SOURCES, File, StatedSource

LARGEST_SHARE = 0.1  # of a value that has no zero of its own: more is a slip in a digit or a unit

FOCAL_LENGTH = "focal_length_px"
"""What a calibration states beside its own keys: the focal length is in its camera matrix."""

Table = dict[str, float]


def keys_of(file: File) -> dict[str, str]:
    """The keys under which a file states uncertainties, and the source that each is of."""
    return {source.key: name for name, source in SOURCES.items() if source.stated_in == file}


def _checked(file: File, *others: str) -> Callable[[Table], Table]:
    known = [*keys_of(file), *others]

    def check(table: Table) -> Table:
        for key, value in table.items():
            if key not in known:
                near = difflib.get_close_matches(key, known, n=1)
                raise ValueError(
                    f"{key} is not a known key; "
                    + (f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}")
                )
            if not 0 <= value < math.inf:
                raise ValueError(f"{key} = {value:g} should be a standard uncertainty: 0 (exact) or above")
        return table

    return check


OfSpecimen = Annotated[Table, AfterValidator(_checked("specimen"))]
OfCalibration = Annotated[Table, AfterValidator(_checked("calibration", FOCAL_LENGTH))]
OfRig = Annotated[Table, AfterValidator(_checked("rig"))]


def check_sizes(table: Table, values: Mapping[str, tuple[str, float | None]], largest: float = LARGEST_SHARE) -> None:
    """Raises ValueError for an uncertainty of a value that is not there, or is too large a share of it.

    values: by the same keys, of those that have no zero of their own: where each stands in the file, and what it is.
    """
    for key, uncertainty in table.items():
        if key not in values:
            continue
        place, value = values[key]
        if value is None:
            raise ValueError(f"[uncertainty] {key} = {uncertainty:g}: there is no {place} that it could be of")
        if uncertainty > largest * value:
            raise ValueError(
                f"[uncertainty] {key} = {uncertainty:g} should be at most {largest:g} of {place} = {value:g}"
            )


def missing_keys(everything: str, table: Table | None, keys: Sequence[str]) -> tuple[str, ...]:
    """Of the keys that count, those of which nobody says how good they are; one word for all without a table."""
    if table is None:
        return (everything,)
    return tuple(key for key in keys if key not in table)


def stated_of(
    file: File, table: Table | None, of: Callable[[str], str], in_units: Mapping[str, float]
) -> tuple[StatedSource, ...]:
    """What a file states, as the inference takes it.

    of: what a key is a number of: see `StatedSource`;
    in_units: factors from a key's unit to its source's, 1 unless given.
    """
    names = keys_of(file)
    return tuple(
        StatedSource(names[key], value * in_units.get(key, 1.0), of(key))
        for key, value in (table or {}).items()
        if key in names
    )
