"""fits.json: identified laws, as the design fixes them; written and read through the same models."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from eimi_fitting.identification import Fit
from eimi_lab.errors import InputError
from eimi_lab.identification.experiments import Evidence
from eimi_lab.outputs import whole_file


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Quantity(_Record):
    """A value with its unit and its 95 % interval."""

    value: float
    unit: str
    interval_95: tuple[float, float]


class StateError(_Record):
    """Error and deviation of one state; dataset counts from 0 in the order given."""

    dataset: int
    state: int
    current_A: float | None
    field_mT: float
    error_mm: float
    deviation_mm: float


class DatasetReference(_Record):
    """Which file was fitted, by its content, and which of its states were left out for their flags."""

    path: str
    sha256: str
    section: str
    states_left_out: tuple[int, ...]


class Identifiability(_Record):
    """What the data fix: one sentence, the coordinates that only the bounds hold, and those that ended on a bound."""

    statement: str
    not_fixed: tuple[str, ...]
    at_bound: tuple[str, ...]
    residual_mm: float
    correlation_points: float


class Stability(_Record):
    """Drucker's criterion: met over the stretches reached, and up to which stretch (null: no limit met)."""

    criterion: str
    stable_up_to_stretch: float | None
    checked_up_to_stretch: float


class Discarded(_Record):
    """Candidates that counted as worst: no convergence, or not stable over the stretches reached."""

    unconverged: int
    unstable: int


class GenerationRecord(_Record):
    """One generation of the search."""

    best_mm: float
    median_mm: float
    step_size: float
    discarded: int


class FitRecord(_Record):
    """One identified law."""

    model: str
    parameters: dict[str, Quantity]
    initial_shear_modulus: Quantity
    mean_error_mm: float
    mean_deviation_mm: float
    by_state: tuple[StateError, ...]
    max_stretch: float
    evaluations: int
    generations: int
    discarded: Discarded
    stop: str
    wall_s: float
    identifiability: Identifiability
    stability: Stability
    datasets: tuple[DatasetReference, ...]
    seed: int
    versions: dict[str, str]
    history: tuple[GenerationRecord, ...]

    def summary(self) -> str:
        """One line: law, initial shear modulus with its interval, mean error."""
        modulus = self.initial_shear_modulus
        low, high = modulus.interval_95
        return (
            f"{self.model}: initial shear modulus {modulus.value:.0f} Pa [{low:.0f}, {high:.0f}], "
            f"mean error {1e3 * self.mean_error_mm:.2f} µm"
        )

    def values(self) -> list[float]:
        """The parameters in the law's order."""
        return [quantity.value for quantity in self.parameters.values()]


class FitsFile(_Record):
    """A whole fits.json."""

    fits: tuple[FitRecord, ...]


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
        versions={
            "python": platform.python_version(),
            **{package: version(package) for package in ("eimi-lab", "numpy", "scipy", "cma")},
        },
        history=tuple(
            GenerationRecord(best_mm=g.best_mm, median_mm=g.median_mm, step_size=g.step_size, discarded=g.discarded)
            for g in fit.history
        ),
    )


def write_fits(path: Path, fits: Sequence[FitRecord], force: bool = False) -> None:
    """Write fits.json. Raises InputError when the file exists and ``force`` is not given."""
    with whole_file(path, force) as temporary:
        temporary.write_text(FitsFile(fits=tuple(fits)).model_dump_json(indent=1) + "\n", encoding="utf-8")


def read_fits(path: str | Path) -> tuple[FitRecord, ...]:
    """Read fits.json. Raises InputError naming the file and the key."""
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
        raise InputError(f"{path}: {where}: {first['msg']}; expected a file that `eimi fit` wrote") from error
