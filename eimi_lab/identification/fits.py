"""fits.json: identified laws, from bending beams or tensile tests; written and read through the same models."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Discriminator, Tag, ValidationError, model_validator

from eimi_fitting.identification import Fit
from eimi_fitting.materials import LAWS
from eimi_lab.errors import InputError
from eimi_lab.identification.experiments import Evidence
from eimi_lab.outputs import whole_file


class Record(BaseModel):
    """A part of a result file: not changed after it is made, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Quantity(Record):
    """A value with its unit and its 95 % interval."""

    value: float
    unit: str
    interval_95: tuple[float, float]


class StateError(Record):
    """Error and deviation of one state; dataset counts from 0 in the order given."""

    dataset: int
    state: int
    current_A: float | None
    field_mT: float
    error_mm: float
    deviation_mm: float


class DatasetReference(Record):
    """Which file was fitted, by its content, and which of its states were left out for their flags."""

    path: str
    sha256: str
    section: str
    states_left_out: tuple[int, ...]


class Identifiability(Record):
    """What the data fix: one sentence, the coordinates that only the bounds hold, and those that ended on a bound."""

    statement: str
    not_fixed: tuple[str, ...]
    at_bound: tuple[str, ...]
    residual_mm: float
    correlation_points: float


class Stability(Record):
    """Drucker's criterion: met over the stretches reached, and up to which stretch (null: no limit met)."""

    criterion: str
    stable_up_to_stretch: float | None
    checked_up_to_stretch: float


class Discarded(Record):
    """Candidates that counted as worst: no convergence, or not stable over the stretches reached."""

    unconverged: int
    unstable: int


class PolishRecord(Record):
    """Gauss-Newton after the search, on the finer mesh: the mean error where it began and where it ended."""

    mean_error_before_mm: float
    mean_error_after_mm: float
    steps: int


class GenerationRecord(Record):
    """One generation of the search."""

    best_mm: float
    median_mm: float
    step_size: float
    discarded: int


class LawRecord(Record):
    """What every fit says of its law, whatever it was fitted to."""

    model: str
    parameters: dict[str, Quantity]
    initial_shear_modulus: Quantity
    max_stretch: float
    stability: Stability
    versions: dict[str, str]

    @model_validator(mode="after")
    def _is_a_law(self) -> Self:
        if self.model not in LAWS:
            raise ValueError(f"model {self.model!r} should be one of {', '.join(LAWS)}")
        names = LAWS[self.model].parameter_names
        if tuple(self.parameters) != names:
            raise ValueError(f"parameters of {self.model} should be {', '.join(names)}, in this order")
        return self

    def values(self) -> list[float]:
        """The parameters in the law's order."""
        return [quantity.value for quantity in self.parameters.values()]

    def modulus_in_words(self) -> str:
        """The initial shear modulus with its interval."""
        modulus = self.initial_shear_modulus
        low, high = modulus.interval_95
        return f"{modulus.value:.0f} Pa [{low:.0f}, {high:.0f}]"


class FitRecord(LawRecord):
    """A law identified from datasets of a bending beam."""

    kind: Literal["bending"] = "bending"
    mean_error_mm: float
    mean_deviation_mm: float
    by_state: tuple[StateError, ...]
    evaluations: int
    generations: int
    discarded: Discarded
    polish: PolishRecord
    stop: str
    wall_s: float
    identifiability: Identifiability
    datasets: tuple[DatasetReference, ...]
    seed: int
    history: tuple[GenerationRecord, ...]

    def summary(self) -> str:
        """One line: law, initial shear modulus with its interval, mean error."""
        return (
            f"{self.model}: initial shear modulus {self.modulus_in_words()}, "
            f"mean error {1e3 * self.mean_error_mm:.2f} µm"
        )


class TensileSource(Record):
    """The tensile test that was fitted, by its content."""

    path: str
    sha256: str
    material: str | None


class TensileRecord(LawRecord):
    """A law fitted to a window of a tensile test.

    window_percent: largest engineering strain asked for (null: the whole curve); max_stretch: largest one there was;
    not_fixed: parameters whose interval holds zero or is the range of the search.
    """

    kind: Literal["tensile"] = "tensile"
    window_percent: float | None
    residuals: Literal["absolute", "relative"]
    rmse_Pa: float
    rows: int
    rows_left_out: int
    correlation_rows: float
    not_fixed: tuple[str, ...]
    source: TensileSource

    def window(self) -> str:
        """The window in words: `50 %` or `full`."""
        return "full" if self.window_percent is None else f"{self.window_percent:g} %"

    def summary(self) -> str:
        """One line: law, window, initial shear modulus with its interval, RMSE, stability."""
        limit = self.stability.stable_up_to_stretch
        stable = "" if limit is None else f", stable up to a stretch of {limit:.2f} only"
        if limit == 1.0:
            stable = ", not stable at any stretch"
        return (
            f"{self.model}, window {self.window()}: initial shear modulus {self.modulus_in_words()}, "
            f"RMSE {1e-3 * self.rmse_Pa:.3g} kPa over {self.rows} rows{stable}"
        )


def _kind(fit: Any) -> str:
    return str(fit.get("kind", "bending")) if isinstance(fit, dict) else getattr(fit, "kind", "bending")


AnyFit = Annotated[
    Annotated[FitRecord, Tag("bending")] | Annotated[TensileRecord, Tag("tensile")], Discriminator(_kind)
]


class FitsFile(Record):
    """A whole fits.json."""

    fits: tuple[AnyFit, ...]


def package_versions() -> dict[str, str]:
    """Python and the packages that a number depends on."""
    packages = {package: version(package) for package in ("eimi-lab", "numpy", "scipy", "cma")}
    return {"python": platform.python_version(), **packages}


def record(fit: Fit, evidence: Sequence[Evidence]) -> FitRecord:
    """What is written down of one fit."""
    law, worth = fit.law, fit.uncertainty
    states = [(d, state) for d, e in enumerate(evidence) for state in e.states]
    return FitRecord(
        model=law.name,
        parameters={
            name: Quantity(value=float(value), unit=unit, interval_95=(float(low), float(high)))
            for name, unit, value, (low, high) in zip(
                law.parameter_names, law.units, fit.parameters, worth.intervals, strict=True
            )
        },
        initial_shear_modulus=Quantity(
            value=fit.initial_shear_modulus_Pa,
            unit="Pa",
            interval_95=(float(worth.initial_shear_modulus_Pa[0]), float(worth.initial_shear_modulus_Pa[1])),
        ),
        mean_error_mm=float(np.mean(fit.error_mm)),
        mean_deviation_mm=float(np.mean(fit.deviation_mm)),
        by_state=tuple(
            StateError(
                dataset=d,
                state=state.index,
                current_A=state.current_A,
                field_mT=state.field_mT,
                error_mm=float(error),
                deviation_mm=float(deviation),
            )
            for (d, state), error, deviation in zip(states, fit.error_mm, fit.deviation_mm, strict=True)
        ),
        max_stretch=fit.max_stretch,
        evaluations=fit.evaluations,
        generations=len(fit.history),
        discarded=Discarded(unconverged=fit.unconverged, unstable=fit.unstable),
        polish=PolishRecord(
            mean_error_before_mm=fit.polish.before_mm,
            mean_error_after_mm=fit.polish.after_mm,
            steps=fit.polish.steps,
        ),
        stop=fit.stop,
        wall_s=fit.wall_s,
        identifiability=Identifiability(
            statement=worth.statement,
            not_fixed=worth.not_fixed,
            at_bound=fit.at_bound,
            residual_mm=worth.noise_mm,
            correlation_points=worth.correlation_points,
        ),
        stability=Stability(
            criterion="Drucker",
            stable_up_to_stretch=fit.stable_to,
            checked_up_to_stretch=fit.stability_checked_to,
        ),
        datasets=tuple(
            DatasetReference(
                path=str(e.path),
                sha256=e.sha256,
                section=e.experiment.model.specimen.section,
                states_left_out=tuple(s.index for s in e.left_out),
            )
            for e in evidence
        ),
        seed=fit.seed,
        versions=package_versions(),
        history=tuple(
            GenerationRecord(best_mm=g.best_mm, median_mm=g.median_mm, step_size=g.step_size, discarded=g.discarded)
            for g in fit.history
        ),
    )


def write_fits(path: Path, fits: Sequence[FitRecord | TensileRecord], force: bool = False) -> None:
    """Write fits.json. Raises InputError when the file exists and ``force`` is not given."""
    with whole_file(path, force) as temporary:
        temporary.write_text(FitsFile(fits=tuple(fits)).model_dump_json(indent=1) + "\n", encoding="utf-8")


def read_fits(path: str | Path) -> tuple[FitRecord, ...]:
    """Read fits.json of datasets. Raises InputError naming the file and the key, or when it holds a tensile fit."""
    fits = []
    for index, fit in enumerate(read_any_fits(path)):
        if isinstance(fit, TensileRecord):
            raise InputError(f"{path}: fits.{index} is a tensile fit; expected a file that `eimi fit` wrote")
        fits.append(fit)
    return tuple(fits)


def read_any_fits(path: str | Path) -> tuple[FitRecord | TensileRecord, ...]:
    """Read fits.json, tensile fits included. Raises InputError naming the file and the key."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as fits.json ({error})") from error
    try:
        return FitsFile.model_validate(json.loads(text)).fits
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: line {error.lineno}: is not JSON ({error.msg})") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(
            f"{path}: {where}: {first['msg']}; expected a file that `eimi fit` or `eimi tensile` wrote"
        ) from error
