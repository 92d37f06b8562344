"""Write and read fits.json, and compare the laws of the fits in this file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag, ValidationError

from eimi_fitting.inference.planning.choice_of_law import Candidate, Choice, choose
from eimi_fitting.suggestion import suggestion
from eimi_lab.config.json_text import parse_json
from eimi_lab.config.toml import is_dataset, read_text
from eimi_lab.fits.law_record import Record
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import write_file
from eimi_lab.showing.tables import installed


def _kind(fit: Any) -> str:
    return str(fit.get("kind", "bending")) if isinstance(fit, dict) else getattr(fit, "kind", "bending")


AnyFit = Annotated[
    Annotated[FitRecord, Tag("bending")]
    | Annotated[TensileRecord, Tag("tensile")]
    | Annotated[RingDownRecord, Tag("ring-down")],
    Discriminator(_kind),
]


class Fits(Record):
    """The content of fits.json: the fits, and the comparison of the fitted laws.

    `fits[0]` is the first fit, and `fits["yeoh"]` the first fit of the Yeoh law. The comparison is empty unless
    different laws were fitted to the same bending data.
    """

    fits: tuple[AnyFit, ...] = Field(min_length=1)
    comparison: tuple[Choice, ...] = ()

    @staticmethod
    def of(fits: Sequence[FitRecord | TensileRecord | RingDownRecord]) -> Fits:
        """Return an object with the given fits and the comparison of their laws."""
        return Fits(fits=tuple(fits), comparison=_comparison(fits))

    def write(self, path: str | Path, force: bool = False) -> Path:
        """Write fits.json and return its path. Raises InputError if the file exists and `force` is false."""
        write_file(Path(path), self.model_dump_json(indent=1) + "\n", force)
        return Path(path)

    def __len__(self) -> int:
        return len(self.fits)

    def __iter__(self) -> Iterator[FitRecord | TensileRecord | RingDownRecord]:  # type: ignore[override]
        return iter(self.fits)

    def __getitem__(self, which: int | str) -> FitRecord | TensileRecord | RingDownRecord:
        """Return the fit with this index, or the first fit of the law with this name.

        Raises InputError if there is no such fit.
        """
        if isinstance(which, int):
            return self.fits[which]
        for fit in self.fits:
            if fit.model == which:
                return fit
        raise InputError(
            f"there is no fit of {which!r}; {suggestion(which, dict.fromkeys(f.model for f in self.fits))}"
        )

    def __repr__(self) -> str:
        return f"<Fits: {'; '.join(fit.summary() for fit in self.fits)}>"

    def _repr_html_(self) -> str:
        return "".join(fit._repr_html_() for fit in self.fits)

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame with a row for each parameter of each fit. Raises ImportError without pandas."""
        tables = {f"{index} {fit.model}": fit.to_pandas() for index, fit in enumerate(self.fits)}
        return installed("pandas").concat(tables, names=["fit"])


def _comparison(fits: Sequence[FitRecord | TensileRecord | RingDownRecord]) -> tuple[Choice, ...]:
    """Compare the fitted laws; the result is empty unless different laws were fitted to the same bending data."""
    bending = [fit for fit in fits if isinstance(fit, FitRecord)]
    data = {
        (
            tuple((d.sha256, d.section, d.states) for d in fit.datasets),
            tuple((c.sha256, c.window_percent, c.weight) for c in fit.tensile),
            fit.identifiability.points,
        )
        for fit in bending
    }
    once = len({fit.model for fit in bending}) == len(fits)
    if len(bending) < 2 or not once or len(data) > 1:
        return ()
    has_noise = all(fit.identifiability.noise_mm and fit.identifiability.noise_points for fit in bending)
    if not has_noise:  # a file of an earlier release
        return choose([_candidate(fit, fit.identifiability.independent_points, fit.mean_error_mm) for fit in bending])
    data_of = [fit.identifiability for fit in bending]
    # For every law, the error of the model is set to the value of the best law, which has the smallest noise_mm.
    model_mm = min(data_of, key=lambda data: data.noise_mm or 0.0).model_mm
    return choose(
        [
            _candidate(fit, data.noise_points or 0.0, math.hypot(data.noise_mm or 0.0, model_mm), data.stated_squares)
            for fit, data in zip(bending, data_of, strict=True)
        ]
    )


def _candidate(fit: FitRecord, points: float, error_mm: float, stated_squares: float = 0.0) -> Candidate:
    return Candidate(
        fit.model,
        len(fit.identifiability.names),
        ((points, error_mm), *((c.weight * c.rows / c.correlation_rows, c.rmse_Pa) for c in fit.tensile)),
        fit.held_out_error_mm,
        stated_squares + fit.prior_squares(),
    )


_EXPECTED = "expected a file that `eimi fit` or `eimi tensile` of this release wrote"


def read_fits_file(path: str | Path) -> Fits:
    """Read fits.json. Raises InputError with the file and the wrong key."""
    path = Path(path)
    if is_dataset(path):
        raise InputError(
            f"{path}: is a dataset, but a fits.json is needed here; `eimi fit` writes a fits.json; in a command with "
            "the option --fit, type the dataset and then the fits.json: DATASET --fit fits.json"
        )
    text = read_text(path)
    try:
        content = parse_json(text)
    except ValueError as error:
        raise InputError(f"{path}: {error}; {_EXPECTED}") from error
    try:
        return Fits.model_validate(content)
    except ValidationError as error:
        raise InputError(
            f"{path}: {first_fault(error)}; {_EXPECTED}; if an older release wrote it, fit again"
        ) from error


def first_fault(error: ValidationError) -> str:
    """Return the first fault that the package pydantic has detected in a file, as `key: reason`."""
    first = error.errors()[0]
    keys = [str(key) for key in first["loc"]]
    if keys[:1] == ["fits"]:
        del keys[2:3]  # the kind of fit
    return ": ".join(words for words in (".".join(key for key in keys if "(" not in key), first["msg"]) if words)
