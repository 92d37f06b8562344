"""fits.json: identified laws, from bending beams or tensile tests; written and read through the same models."""

from __future__ import annotations

import dataclasses
import json
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Discriminator, Tag, ValidationError, model_validator

from eimi_fitting.identification import Fit
from eimi_fitting.materials import LAWS
from eimi_fitting.model_choice import Candidate, choose
from eimi_fitting.search import Generation
from eimi_lab.errors import InputError
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.fit_tables import fit_html, parameters_frame
from eimi_lab.identification.records import (
    ChoiceRecord,
    CurveRecord,
    DatasetReference,
    Discarded,
    DoubtRecord,
    FreedRecord,
    Identifiability,
    MeshRecord,
    PolishRecord,
    Quantity,
    Record,
    bulk_modulus,
    curves,
    freed,
    identifiability,
    mesh,
)
from eimi_lab.identification.workers import PACKAGES
from eimi_lab.outputs import whole_file


class StateError(Record):
    """Error and deviation of one state; dataset counts from 0 in the order given."""

    dataset: int
    state: int
    current_A: float | None
    field_mT: float
    error_mm: float
    deviation_mm: float


class Stability(Record):
    """Drucker's criterion: met over the stretches reached, and up to which stretch (null: no limit met)."""

    criterion: str
    stable_up_to_stretch: float | None
    checked_up_to_stretch: float


class GenerationRecord(Record):
    """One generation of the search: the best of all so far, the mean of its own valid candidates."""

    run: int
    best_mm: float
    mean_mm: float
    step_size: float
    axis_ratio: float
    discarded: int

    @staticmethod
    def of(generation: Generation) -> GenerationRecord:
        """As the search has it."""
        return GenerationRecord(**dataclasses.asdict(generation))


class RunRecord(Record):
    """One run of CMA-ES, and why it stopped."""

    population: int
    step_size: float
    generations: int
    best_mm: float
    stop: str


class ReplicateRecord(Record):
    """A law fitted to one bootstrap replicate of the data; parameters in the units of the fit."""

    replicate: int
    parameters: dict[str, float]
    initial_shear_modulus_Pa: float
    mean_error_mm: float
    evaluations: int
    stop: str
    wall_s: float


class BootstrapRecord(Record):
    """The fit repeated on replicates of the data: states drawn again, with replacement.

    interval_95: percentiles of the initial shear modulus (Efron and Tibshirani 1993, An Introduction to the Bootstrap,
    section 13.3), null where there are too few replicates to have any.
    """

    drawn: Literal["states"] = "states"
    initial_shear_modulus_interval_95_Pa: tuple[float, float] | None
    replicates: tuple[ReplicateRecord, ...]


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

    def notes(self) -> list[str]:
        """What the fit is worth, in sentences."""
        return []

    def to_pandas(self) -> Any:
        """pandas.DataFrame of parameters and initial shear modulus with intervals. Raises ImportError."""
        return parameters_frame(self)

    def _repr_html_(self) -> str:
        return fit_html(self, self.notes())


class FitRecord(LawRecord):
    """A law identified from datasets of a bending beam.

    held_out_error_mm: mean error of states left out of the fit.
    """

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
    bulk_modulus: Quantity | None
    freed: tuple[FreedRecord, ...]
    tensile: tuple[CurveRecord, ...]
    mesh: MeshRecord
    held_out_error_mm: float
    doubts: tuple[DoubtRecord, ...]
    datasets: tuple[DatasetReference, ...]
    seed: int
    runs: tuple[RunRecord, ...]
    history: tuple[GenerationRecord, ...]
    bootstrap: BootstrapRecord | None = None

    def summary(self) -> str:
        """One line: law, initial shear modulus with its interval, mean error."""
        return (
            f"{self.model}: initial shear modulus {self.modulus_in_words()}, "
            f"mean error {1e3 * self.mean_error_mm:.2f} µm"
        )

    def notes(self) -> list[str]:
        """Error and deviation, and what the data fix."""
        error, deviation = 1e3 * self.mean_error_mm, 1e3 * self.mean_deviation_mm
        return [f"Mean error {error:.3g} µm, mean deviation {deviation:.3g} µm.", self.identifiability.statement]


class TensileSource(Record):
    """The tensile test that was fitted, by its content."""

    path: str
    sha256: str
    material: str | None


class TensileRecord(LawRecord):
    """A law fitted to a window of a tensile test.

    window_percent: largest engineering strain asked for (null: the whole curve); max_stretch: largest one there was;
    correlation: of the parameters' errors, a row each; not_fixed: parameters whose interval holds zero or is the range
    of the search.
    """

    kind: Literal["tensile"] = "tensile"
    window_percent: float | None
    residuals: Literal["absolute", "relative"]
    rmse_Pa: float
    rows: int
    rows_left_out: int
    correlation_rows: float
    correlation: tuple[tuple[float, ...], ...]
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

    def notes(self) -> list[str]:
        """Window and misfit, and what the curve does not fix."""
        loose = f"The curve does not fix {', '.join(self.not_fixed)}." if self.not_fixed else ""
        misfit = f"Window {self.window()}: RMSE {1e-3 * self.rmse_Pa:.3g} kPa over {self.rows} rows."
        return [misfit, loose] if loose else [misfit]


def _kind(fit: Any) -> str:
    return str(fit.get("kind", "bending")) if isinstance(fit, dict) else getattr(fit, "kind", "bending")


AnyFit = Annotated[
    Annotated[FitRecord, Tag("bending")] | Annotated[TensileRecord, Tag("tensile")], Discriminator(_kind)
]


class FitsFile(Record):
    """A whole fits.json; comparison: of its laws, where all were fitted to the same data."""

    fits: tuple[AnyFit, ...]
    comparison: tuple[ChoiceRecord, ...] = ()


def comparison(fits: Sequence[FitRecord | TensileRecord]) -> tuple[ChoiceRecord, ...]:
    """The laws compared; nothing where there is one alone, one twice, or where they have not the same data."""
    bending = [fit for fit in fits if isinstance(fit, FitRecord)]
    data = {
        (
            tuple((d.sha256, d.section, d.states_left_out) for d in fit.datasets),
            tuple((c.sha256, c.window_percent, c.weight) for c in fit.tensile),
            fit.identifiability.points,
        )
        for fit in bending
    }
    once = len({fit.model for fit in bending}) == len(fits)
    if len(bending) < 2 or not once or len(data) > 1:
        return ()
    chosen = choose(
        [
            Candidate(
                fit.model,
                len(fit.identifiability.names),
                (
                    (fit.identifiability.independent_points, fit.mean_error_mm),
                    *((c.weight * c.rows / c.correlation_rows, c.rmse_Pa) for c in fit.tensile),
                ),
            )
            for fit in bending
        ]
    )
    return tuple(
        ChoiceRecord(
            model=choice.model,
            unknowns=choice.unknowns,
            independent_points=choice.independent_points,
            aicc=choice.aicc if np.isfinite(choice.aicc) else None,
            bic=choice.bic,
            weight=choice.weight,
            held_out_error_mm=fit.held_out_error_mm,
        )
        for choice, fit in zip(chosen, bending, strict=True)
    )


def package_versions() -> dict[str, str]:
    """Python and the packages that a number depends on."""
    packages = {package: version(package) for package in PACKAGES}
    return {"python": platform.python_version(), **packages}


FEWEST_FOR_INTERVAL = 40  # replicates: one beyond each end of a 95 % interval


def replicate_record(fit: Fit, replicate: int) -> ReplicateRecord:
    """What is written down of a fit to one replicate of the data."""
    return ReplicateRecord(
        replicate=replicate,
        parameters=dict(zip(fit.law.parameter_names, fit.parameters.tolist(), strict=True)),
        initial_shear_modulus_Pa=fit.initial_shear_modulus_Pa,
        mean_error_mm=float(np.mean(fit.error_mm)),
        evaluations=fit.evaluations,
        stop=fit.stop,
        wall_s=fit.wall_s,
    )


def bootstrap_record(replicates: Sequence[ReplicateRecord]) -> BootstrapRecord:
    """All replicates of one fit, and what they say together."""
    moduli = [replicate.initial_shear_modulus_Pa for replicate in replicates]
    enough = len(moduli) >= FEWEST_FOR_INTERVAL
    low, high = np.quantile(moduli, [0.025, 0.975]) if enough else (0.0, 0.0)
    return BootstrapRecord(
        initial_shear_modulus_interval_95_Pa=(float(low), float(high)) if enough else None,
        replicates=tuple(replicates),
    )


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
        identifiability=identifiability(fit),
        bulk_modulus=bulk_modulus(fit),
        freed=freed(fit),
        tensile=curves(fit),
        mesh=mesh(fit),
        held_out_error_mm=worth.held_out_error_mm,
        doubts=tuple(
            DoubtRecord(dataset=d, state=None if k is None else evidence[d].states[k].index, words=words)
            for d, k, words in fit.doubts
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
        runs=tuple(RunRecord(**dataclasses.asdict(run)) for run in fit.runs),
        history=tuple(GenerationRecord.of(generation) for generation in fit.history),
    )


def write_fits(path: Path, fits: Sequence[FitRecord | TensileRecord], force: bool = False) -> None:
    """Write fits.json. Raises InputError when the file exists and ``force`` is not given."""
    with whole_file(path, force) as temporary:
        temporary.write_text(
            FitsFile(fits=tuple(fits), comparison=comparison(fits)).model_dump_json(indent=1) + "\n", encoding="utf-8"
        )


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
