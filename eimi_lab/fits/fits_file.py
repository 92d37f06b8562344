"""fits.json: its laws compared, written and read."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag, ValidationError

from eimi_fitting.inference.planning.choice_of_law import Candidate, Choice, choose
from eimi_fitting.suggestion import suggestion
from eimi_lab.config.toml import read_text
from eimi_lab.fits.law_record import Record
from eimi_lab.fits.records import FitRecord, TensileRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import write_file
from eimi_lab.showing.tables import installed


def _kind(fit: Any) -> str:
    return str(fit.get("kind", "bending")) if isinstance(fit, dict) else getattr(fit, "kind", "bending")


AnyFit = Annotated[
    Annotated[FitRecord, Tag("bending")] | Annotated[TensileRecord, Tag("tensile")], Discriminator(_kind)
]


class Fits(Record):
    """All that a fits.json holds: its fits in order, and the comparison of their laws.

    ``fits[0]`` is the first fit, ``fits["yeoh"]`` the first of that law. comparison: empty unless all laws were fitted
    to the same data.
    """

    fits: tuple[AnyFit, ...] = Field(min_length=1)
    comparison: tuple[Choice, ...] = ()

    @staticmethod
    def of(fits: Sequence[FitRecord | TensileRecord]) -> Fits:
        """Compare the laws of these fits."""
        return Fits(fits=tuple(fits), comparison=_comparison(fits))

    def write(self, path: str | Path, force: bool = False) -> Path:
        """Write fits.json and return its path. Raises InputError when the file exists without ``force``."""
        write_file(Path(path), self.model_dump_json(indent=1) + "\n", force)
        return Path(path)

    def __len__(self) -> int:
        return len(self.fits)

    def __iter__(self) -> Iterator[FitRecord | TensileRecord]:  # type: ignore[override]
        return iter(self.fits)

    def __getitem__(self, which: int | str) -> FitRecord | TensileRecord:
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
        """pandas.DataFrame of all fits, a row for each parameter; see `FitRecord.to_pandas`. Raises ImportError."""
        tables = {f"{index} {fit.model}": fit.to_pandas() for index, fit in enumerate(self.fits)}
        return installed("pandas").concat(tables, names=["fit"])


def _comparison(fits: Sequence[FitRecord | TensileRecord]) -> tuple[Choice, ...]:
    """The laws compared; nothing where there is one alone, one twice, or where they have not the same data."""
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
    noise_known = all(fit.identifiability.noise_mm and fit.identifiability.noise_points for fit in bending)
    if not noise_known:  # of earlier releases
        return choose([_candidate(fit, fit.identifiability.independent_points, fit.mean_error_mm) for fit in bending])
    every = [fit.identifiability for fit in bending]
    # Of the law that fits best, for all laws alike.
    model_mm = min(every, key=lambda told: told.noise_mm or 0.0).model_mm
    return choose(
        [
            _candidate(fit, told.noise_points or 0.0, math.hypot(told.noise_mm or 0.0, model_mm), told.stated_squares)
            for fit, told in zip(bending, every, strict=True)
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


def write_fits(path: Path, fits: Sequence[FitRecord | TensileRecord], force: bool = False) -> Fits:
    """Write fits.json and return what it holds. Raises InputError when the file exists without ``force``."""
    content = Fits.of(fits)
    content.write(path, force)
    return content


_EXPECTED = "expected a file that `eimi fit` or `eimi tensile` of this release wrote"


def read_any_fits(path: str | Path) -> tuple[FitRecord | TensileRecord, ...]:
    """The fits of a fits.json, tensile ones included. Raises InputError as `read_fits_file` does."""
    return read_fits_file(path).fits


def read_fits_file(path: str | Path) -> Fits:
    """Read fits.json. Raises InputError naming the file and the key."""
    path = Path(path)
    text = read_text(path)
    try:
        return Fits.model_validate(json.loads(text))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: line {error.lineno}: is not JSON ({error.msg}); {_EXPECTED}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {first_fault(error)}; {_EXPECTED}: if it is of an earlier one, fit again") from error


def first_fault(error: ValidationError) -> str:
    """The first key that cannot be used, and why; without the choices that pydantic tried on the way to it."""
    first = error.errors()[0]
    keys = [str(key) for key in first["loc"]]
    if keys[:1] == ["fits"]:
        del keys[2:3]  # the kind of fit
    return ": ".join(words for words in (".".join(key for key in keys if "(" not in key), first["msg"]) if words)
