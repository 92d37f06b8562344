"""What stands in a result file: the models that write and read it, with what each part means."""

from __future__ import annotations

import dataclasses
import platform
from importlib.metadata import version
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from eimi_fitting.materials import LAWS
from eimi_fitting.search import Generation
from eimi_lab.identification.fit_tables import fit_html, parameters_frame
from eimi_lab.identification.workers import PACKAGES


class Record(BaseModel):
    """A part of a result file: not changed after it is made, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Quantity(Record):
    """A value with its unit and its 95 % interval."""

    value: float = Field(allow_inf_nan=False)
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


class DirectionRecord(Record):
    """A combination of unknowns, and the share of what was unknown of it that the data leave."""

    words: str
    remaining: float


class Identifiability(Record):
    """What the data fix, in words and in numbers.

    not_fixed: coordinates that only the bounds hold; at_bound: those that ended on a bound; names and correlation: all
    unknowns and how their errors hang together, a row each; directions: best known first; profiled: coordinates whose
    interval is that of the profile likelihood; points count as independent_points.
    """

    statement: str
    not_fixed: tuple[str, ...]
    at_bound: tuple[str, ...]
    residual_mm: float
    correlation_points: float
    points: int
    independent_points: float
    names: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    directions: tuple[DirectionRecord, ...]
    profiled: tuple[str, ...]


class FreedRecord(Record):
    """A nuisance that was freed: by how much it is off what was stated, beside the prior's standard deviation.

    dataset counts from 0 in the order given; null where it is common to all.
    """

    name: str
    dataset: int | None
    deviation: Quantity
    prior_standard_deviation: float


class MeshRecord(Record):
    """What a mesh twice as fine changed in the parameters, and the half-width left in the interval for the rest.

    Both in per cent of the initial shear modulus; null where the finer mesh found no solution.
    """

    change_percent: float | None
    left_percent: float | None


class CurveRecord(Record):
    """A tensile curve in the fit: its weight, and the root mean square residual of the law alone with it and here."""

    path: str
    sha256: str
    window_percent: float | None
    weight: float
    rows: int
    correlation_rows: float
    rmse_alone_Pa: float
    rmse_Pa: float


class ChoiceRecord(Record):
    """One law among those of the file: AICc and BIC above the best one's, Akaike weight, error on states left out.

    aicc is null where the data are too few for the law.
    """

    model: str
    unknowns: int
    independent_points: float
    aicc: float | None
    bic: float
    weight: float
    held_out_error_mm: float


class DatasetReference(Record):
    """Which file was fitted, by its content, and which of its states were left out for their flags."""

    path: str
    sha256: str
    section: str
    states_left_out: tuple[int, ...]


class Discarded(Record):
    """Candidates that counted as worst: no convergence, or not stable over the stretches reached."""

    unconverged: int
    unstable: int


class PolishRecord(Record):
    """Gauss-Newton after the search, on the finer mesh: the mean error where it began and where it ended.

    Before what a still finer mesh changes was taken into account; with tensile curves or freed nuisances in the fit it
    is the objective, which holds them too.
    """

    mean_error_before_mm: float
    mean_error_after_mm: float
    steps: int


class DoubtRecord(Record):
    """Something a reader should know: about one state of a dataset, or about all of it (null)."""

    dataset: int
    state: int | None
    words: str


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

    @model_validator(mode="after")
    def _is_stiff(self) -> Self:
        """A law fitted to large tensile strains alone need not be; no beam hangs still in a field without it."""
        if not self.initial_shear_modulus.value > 0:
            raise ValueError(f"initial shear modulus {self.initial_shear_modulus.value:g} Pa should be above 0")
        return self

    def fitted_to(self) -> Literal["bending", "bending and tensile"]:
        """Whether tensile curves had a say."""
        return "bending and tensile" if self.tensile else "bending"

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
    correlation: of the parameters' errors, a row each, null in files of earlier releases; not_fixed: parameters whose
    interval holds zero or is the range
    of the search.
    """

    kind: Literal["tensile"] = "tensile"
    window_percent: float | None
    residuals: Literal["absolute", "relative"]
    rmse_Pa: float
    rows: int
    rows_left_out: int
    correlation_rows: float
    correlation: tuple[tuple[float, ...], ...] | None = None
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


def package_versions() -> dict[str, str]:
    """Python and the packages that a number depends on."""
    packages = {package: version(package) for package in PACKAGES}
    return {"python": platform.python_version(), **packages}
