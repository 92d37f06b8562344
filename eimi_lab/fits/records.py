"""The data classes of the fits in a result file."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import field, fields, replace
from importlib.metadata import version
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, SerializerFunctionWrapHandler, SkipValidation, model_serializer, model_validator
from pydantic.dataclasses import dataclass

from eimi_fitting.inference.doubts.checks import Doubt
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.evidence.tensile_curves import TensileEvidence
from eimi_fitting.inference.identification.fit import Fit, IdentifiedLaw
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import strain_reached
from eimi_fitting.time.result import LawOfTime
from eimi_lab.fits.bootstrap_record import BootstrapRecord
from eimi_lab.fits.evidence import WHOLE_FILES, Evidence
from eimi_lab.fits.law_record import STRICT, LawRecord, Record, Stability
from eimi_lab.fits.measured_record import MeasuredField, MeasuredTemperature
from eimi_lab.fits.residuals import Residuals
from eimi_lab.fits.states_used import StatesUsed
from eimi_lab.fits.tensile_files import FileCurve
from eimi_lab.process.errors import InputError
from eimi_lab.process.workers import PACKAGES
from eimi_lab.showing.tables import installed

Array = NDArray[np.float64]


class StateError(Record):
    """The error of a fit in one state (load step): distances of measured from simulated points.

    Attributes
    ----------
    dataset : int
        Index of the dataset in the fit.
    state : int
        Index of the state in the dataset.
    current_A : float or None
        Current that was set.
    field_mT : float
        Field at the specimen.
    error_mm : float
        Root mean square distance.
    deviation_mm : float
        Standard deviation of the distances.
    """

    dataset: int
    state: int
    current_A: float | None
    field_mT: float
    error_mm: float
    deviation_mm: float

    @staticmethod
    def of(evidence: Evidence, error_mm: Array, deviation_mm: Array, dataset: int = 0) -> tuple[StateError, ...]:
        """Return the error of a fit in each used state of a dataset.

        `error_mm` and `deviation_mm` hold the root mean square and the standard deviation of the distances in each
        state.
        """
        return tuple(
            StateError(
                dataset=dataset,
                state=state.index,
                current_A=state.current_A,
                field_mT=state.field_mT,
                error_mm=float(error),
                deviation_mm=float(deviation),
            )
            for state, error, deviation in zip(evidence.states, error_mm, deviation_mm, strict=True)
        )


class CurveRecord(Record):
    """A tensile curve that was fitted together with datasets of a bending beam (a joint fit).

    Attributes
    ----------
    path : str or None
        File; null for a curve that was passed as numbers.
    sha256 : str
        Hash of the file or of the numbers.
    window_percent : float or None
        Largest strain in per cent; null for the whole curve.
    weight : float
        Factor by which the weight of the curve was multiplied.
    rows : int
        Number of used rows.
    correlation_rows : float
        Number of neighbouring rows whose residuals are correlated.
    largest_strain : float
        Used strain with the largest principal stretch; negative for a compression test.
    rmse_alone_Pa, rmse_Pa : float
        Root mean square error of the stress: fit to this curve alone, and joint fit.
    """

    path: str | None
    sha256: str
    window_percent: float | None
    weight: float
    rows: int
    correlation_rows: float
    largest_strain: float
    rmse_alone_Pa: float
    rmse_Pa: float

    @property
    def max_stretch(self) -> float:
        """Return the largest principal stretch of the used rows; in compression, that across the specimen."""
        return float(max(1 + self.largest_strain, (1 + self.largest_strain) ** -0.5))

    @property
    def name(self) -> str:
        """Return the path of the file of a tensile curve; for a curve without a file, a name made from its hash."""
        return self.path or f"tensile curve {self.sha256[:8]} (from no file)"

    @staticmethod
    def of(evidence: TensileEvidence, rmse_Pa: float) -> CurveRecord:
        """Return the record of a tensile curve; `rmse_Pa` is the root mean square error of the stress."""
        curve = evidence.curve
        file = curve if isinstance(curve, FileCurve) else None
        numbers = np.stack([curve.strain, curve.stress_Pa]).astype("<f8").tobytes()
        return CurveRecord(
            path=file.path if file else None,
            sha256=file.sha256 if file else hashlib.sha256(numbers).hexdigest(),
            window_percent=file.window_percent if file else None,
            weight=curve.weight,
            rows=len(curve.strain),
            correlation_rows=evidence.correlation_rows,
            largest_strain=strain_reached(curve.strain),
            rmse_alone_Pa=evidence.noise_Pa,
            rmse_Pa=rmse_Pa,
        )


class DatasetReference(Record):
    """A dataset of a fit: path, hash, model of the cross-section, used states, and uncertainties of the inputs.

    Attributes
    ----------
    measured_field : MeasuredField or None
        Measured field.
    temperature : MeasuredTemperature or None
        Measured temperature of the specimen.
    """

    path: str
    sha256: str
    section: str
    states: StatesUsed
    stated: tuple[StatedSource, ...] = ()
    measured_field: MeasuredField | None = None
    temperature: MeasuredTemperature | None = None

    @staticmethod
    def of(evidence: Evidence) -> DatasetReference:
        """Return the entry for a dataset in a result file."""
        return DatasetReference(
            path=str(evidence.path),
            sha256=evidence.sha256,
            section=evidence.experiment.model.specimen.section,
            states=evidence.used,
            stated=evidence.experiment.stated,
            measured_field=MeasuredField.of(evidence),
            temperature=MeasuredTemperature.of(evidence),
        )

    @model_serializer(mode="wrap")
    def _without_what_was_not_measured(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = serialize(self)
        return {key: value for key, value in written.items() if value is not None}

    def in_words(self) -> str:
        """Return the path, the number of used states, and the defects of the states."""
        return f"{self.path}: {self.states.in_words()}"


@dataclass(config=STRICT, frozen=True, kw_only=True, repr=False)
class FitRecord(IdentifiedLaw, LawRecord):
    """A law identified from datasets of a bending beam, with files, currents and versions.

    Attributes
    ----------
    by_state : tuple of StateError
        Error in each used state (load step).
    tensile : tuple of CurveRecord
        Tensile curves that were also fitted.
    taken_as_exact : tuple of str
        Inputs without a given uncertainty.
    datasets : tuple of DatasetReference
        Datasets of the fit.
    bootstrap : BootstrapRecord or None
        Fits to random samples of the states.
    distances : tuple of Residuals
        Distances of measured from simulated points in each dataset; not written to a file.
    """

    kind: Literal["bending"] = "bending"
    by_state: tuple[StateError, ...]
    tensile: tuple[CurveRecord, ...]
    taken_as_exact: tuple[str, ...]
    datasets: tuple[DatasetReference, ...]
    bootstrap: BootstrapRecord | None = None
    time: LawOfTime | None = None
    distances: Annotated[SkipValidation[tuple[Residuals, ...]], Field(exclude=True)] = field(default=(), compare=False)

    __repr__ = LawRecord.__repr__

    @property
    def stretch_reached(self) -> float:
        """Return the largest stretch in the data, with the tensile curves that were fitted with the states."""
        return max([self.max_stretch, *(curve.max_stretch for curve in self.tensile)])

    def residuals(self, dataset: int = 0) -> Residuals:
        """Return the distances of measured points from the simulated beam for one dataset.

        Parameters
        ----------
        dataset : int
            Index of the dataset in the fit, from 0.

        Raises
        ------
        InputError
            If the fit was read from a file, because files do not contain the distances.
        """
        if not self.distances:
            raise InputError(
                f"{self.model}: this fit was read from fits.json, which contains no residuals; call "
                "eimi.validate(DATASET, fit).residuals(), which simulates the fit again"
            )
        return self.distances[dataset]

    def to_xarray(self) -> Any:
        """Return an xarray.Dataset of parameters, intervals and errors. Raises ImportError without xarray."""
        quantities = self._quantities()
        unknowns = list(self.draws.names) if self.draws else []
        draws, ends = np.array(self.draws.values if self.draws else ()), [q.interval_95 for q in quantities.values()]
        by_state = {
            name: ("state", np.array([getattr(state, key) for state in self.by_state]), {"units": unit})
            for name, key, unit in (("error", "error_mm", "mm"), ("deviation", "deviation_mm", "mm"))
        }
        variables = {
            "value": ("parameter", np.array([q.value for q in quantities.values()])),
            "interval_95": (("parameter", "end"), np.array(ends)),
            "draw": (("sample", "unknown"), draws.reshape(len(draws), len(unknowns))),
            **by_state,
        }
        coordinates = {
            "parameter": list(quantities),
            "unit": ("parameter", [q.unit for q in quantities.values()]),
            "end": ["low", "high"],
            "unknown": unknowns,
            "field": ("state", np.array([state.field_mT for state in self.by_state]), {"units": "mT"}),
            "dataset": ("state", [state.dataset for state in self.by_state]),
            "number": ("state", [state.state for state in self.by_state]),
        }
        return installed("xarray").Dataset(variables, coordinates, {"law": self.model})

    @staticmethod
    def of(fit: Fit, evidence: Sequence[Evidence]) -> FitRecord:
        """Return the record of a fit to the datasets `evidence`."""
        ends = np.cumsum([len(e.states) for e in evidence])[:-1]
        errors, deviations = np.split(fit.error_mm, ends), np.split(fit.deviation_mm, ends)
        identified = {of_both.name: getattr(fit, of_both.name) for of_both in fields(IdentifiedLaw)}
        doubts = (
            *(Doubt(words, index, kind="perspective") for index, e in enumerate(evidence) for words in e.doubts),
            *(_with_dataset_index(doubt, evidence) for doubt in fit.doubts),
        )
        return FitRecord(
            **{**identified, "doubts": doubts},
            model=fit.law.name,
            by_state=tuple(
                state for d, e in enumerate(evidence) for state in StateError.of(e, errors[d], deviations[d], d)
            ),
            tensile=tuple(
                CurveRecord.of(curve, rmse) for curve, rmse in zip(fit.curves, fit.curve_rmse_Pa, strict=True)
            ),
            stability=Stability(
                criterion="Drucker",
                stable_up_to_stretch=fit.stable_to,
                checked_up_to_stretch=fit.stability_checked_to,
            ),
            datasets=tuple(DatasetReference.of(e) for e in evidence),
            taken_as_exact=tuple(dict.fromkeys(word for e in evidence for word in e.taken_as_exact)),
            versions=package_versions(),
            distances=tuple(Residuals.of(e, r) for e, r in zip(evidence, fit.residuals_mm, strict=True)),
        )

    @model_serializer(mode="wrap")
    def _in_the_order_of_the_file(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return a fit as a dictionary whose keys are in the fixed order of a result file."""
        written: dict[str, Any] = serialize(self)
        for key in _IF_ANY:
            if not written[key]:
                del written[key]
        return {key: written[key] for key in sorted(written, key=_ORDER.index)}

    @model_validator(mode="after")
    def _is_stiff(self) -> Self:
        """Raise ValueError unless the initial shear modulus is positive."""
        if not self.initial_shear_modulus.value > 0:
            raise ValueError(f"initial shear modulus {self.initial_shear_modulus.value:g} Pa should be above 0")
        return self

    def prior_squares(self) -> float:
        """Return the sum of ((value - mean) / standard deviation)² over the priors on parameters of the law."""
        values, law = np.array([self.values()]), LAWS[self.model]
        return sum(float(prior.standardised(law, values)[0]) ** 2 for prior in self.priors)

    def priors_in_words(self) -> list[str]:
        """Return a sentence for each prior on a parameter, with the fitted value."""
        law, quantities = LAWS[self.model], self._quantities()
        return [
            f"Prior on {prior.parameter}: {prior.in_words(law)} (mean ± standard deviation). The fitted value "
            f"is {quantities[prior.parameter].value:.5g}."
            for prior in self.priors
        ]

    def doubts_in_words(self) -> list[str]:
        """Return each reason to distrust a fit as text."""
        return [f"{self._about(doubt)}{doubt.words}" for doubt in self.doubts]

    def doubts_in_short(self) -> str:
        """Return the reasons to distrust a fit in a few words; empty without such reasons."""
        short = "; ".join(doubt.short for doubt in self.doubts if doubt.short)
        return f" (doubted{': ' if short else ''}{short})" if self.doubts else ""

    def _about(self, doubt: Doubt) -> str:
        if doubt.curve is not None:
            return f"{self.tensile[doubt.curve].name}: "
        if doubt.dataset is None:
            return ""
        return self.datasets[doubt.dataset].path + ("" if doubt.state is None else f", state {doubt.state}") + ": "

    def held_by_bounds(self) -> tuple[str, ...]:
        """Return the names of the parameters (and `initial_shear_modulus`) that the data do not determine."""
        data = self.identifiability
        open_modulus = data.names[0] in data.not_fixed
        return (*data.held_by_bounds, "initial_shear_modulus") if open_modulus else data.held_by_bounds

    def fitted_to(self) -> Literal["bending", "bending and tensile"]:
        """Return the kind of data of a fit: `bending`, or `bending and tensile` for a joint fit."""
        return "bending and tensile" if self.tensile else "bending"

    def summary(self, modulus: str = "") -> str:
        """Return one line about a fit: law, modulus with interval, warnings and mean error.

        `modulus` is the text to print for the modulus and its interval.
        """
        whole = [word for word in self.taken_as_exact if word in WHOLE_FILES]
        exact = f"; {' and '.join(whole)} taken as exact" if whole else ""
        return (
            f"{self.model}: initial shear modulus {modulus or self.modulus_in_words()}{self.doubts_in_short()}, "
            f"mean error {1e3 * self.mean_error_mm:.2f} µm{exact}{self._not_stated()}"
        )

    def _not_stated(self) -> str:
        """Return a text on the inputs without a given uncertainty."""
        return "".join(
            (
                f"; {entry.words} taken as exact: an error of {entry.standard_uncertainty:g} "
                f"{'degrees' if entry.unit == 'deg' else entry.unit} would change the modulus by "
                f"{entry.effect_percent:.2g} %"
            )
            for entry in self.if_uncertain
        )

    def notes(self) -> list[str]:
        """Return sentences on the used states, the mean error, and the quantities that the data determine."""
        error, deviation = 1e3 * self.mean_error_mm, 1e3 * self.mean_deviation_mm
        return [
            *(f"{dataset.in_words()}." for dataset in self.datasets),
            f"Mean error {error:.3g} µm, mean deviation {deviation:.3g} µm.",
            self.identifiability.statement,
            *self.priors_in_words(),
        ]


_ORDER = (
    *("model", "parameters", "initial_shear_modulus", "max_stretch", "stability", "doubts", "draws", "versions"),
    *("kind", "mean_error_mm", "mean_deviation_mm", "by_state", "evaluations", "generations", "discarded", "polish"),
    *("stop", "wall_s", "identifiability", "bulk_modulus", "freed", "priors", "tensile", "mesh", "section_change"),
    *("held_out_error_mm", "taken_as_exact", "budget", "measure_next", "if_uncertain", "datasets", "seed", "runs"),
    *("history", "bootstrap", "causes", "time"),
)
_IF_ANY = (
    "priors",
    "if_uncertain",
    "causes",
    "time",
)  # later releases added these keys; a file contains such a key only if its value is not empty


def _with_dataset_index(doubt: Doubt, evidence: Sequence[Evidence]) -> Doubt:
    # A fit counts only the used states, but a record counts all states of the dataset.
    if doubt.dataset is None or doubt.state is None:
        return doubt
    return replace(doubt, state=evidence[doubt.dataset].states[doubt.state].index)


def package_versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that affect the numbers of a fit."""
    packages = {package: version(package) for package in PACKAGES}
    return {"python": platform.python_version(), **packages}
