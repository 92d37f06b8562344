"""validation.json: what a fit's error is on datasets, those that it has not seen above all.

A law that finds no equilibrium in one of the states is a result, not an accident: its errors are then null and its
status says so. A law that is not Drucker-stable over the stretches it reaches is simulated all the same, and flagged.

On a dataset that it has seen, a fit keeps the nuisances that it freed (magnetic moment, roll and so on); on any other
they are as stated.

The interval of the mean error is its range while the initial shear modulus goes through its 95 % interval with the
law's other ratios held: all moduli are scaled together, exponents stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.experiment import Comparison, Experiment, compare
from eimi_fitting.materials import LAWS
from eimi_fitting.mesh_error import mesh_corrected
from eimi_lab.errors import InputError
from eimi_lab.identification.assumptions import assumptions_of
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.records import FitRecord, Quantity, Record, StateError, TensileRecord
from eimi_lab.outputs import whole_file
from eimi_lab.tables import data_frame, html_table

Array = NDArray[np.float64]

_SAME_STRETCH = 1e-3  # two simulations of one beam may differ by this much
_MODULI = 5  # across the interval of the initial shear modulus


class FitReference(Record):
    """Which fit of which file; window_percent of a tensile fit (null: the whole curve)."""

    path: str
    index: int
    kind: Literal["bending", "bending and tensile", "tensile"]
    window_percent: float | None

    def kind_in_words(self) -> str:
        """`bending`, `bending and tensile`, `tensile 50 %` or `tensile full`."""
        if self.kind != "tensile":
            return self.kind
        return "tensile full" if self.window_percent is None else f"tensile {self.window_percent:g} %"


class Validation(Record):
    """One fit on one dataset.

    seen: the fit was made from this dataset; stable: Drucker-stable over the stretches reached here (null where no
    equilibrium was found); within_fitted_stretch: the fit's data reached the largest stretch of this dataset;
    mean_error_interval_mm: see above, its upper end null where a modulus of the interval finds no equilibrium.
    """

    dataset: str
    sha256: str
    section: str
    model: str
    fit: FitReference
    initial_shear_modulus: Quantity
    seen: bool
    status: Literal["ok", "no equilibrium"]
    mean_error_mm: float | None
    mean_error_interval_mm: tuple[float, float | None] | None
    mean_deviation_mm: float | None
    max_stretch: float | None
    stable: bool | None
    within_fitted_stretch: bool | None
    by_state: tuple[StateError, ...]

    def to_pandas(self) -> Any:
        """pandas.DataFrame with a row a state. Raises ImportError."""
        return data_frame([state.model_dump(exclude={"dataset"}) for state in self.by_state], "state")

    def _repr_html_(self) -> str:
        rows = [
            (str(s.state), f"{s.field_mT:.3f}", f"{1e3 * s.error_mm:.3g}", f"{1e3 * s.deviation_mm:.3g}")
            for s in self.by_state
        ]
        mean = "" if self.mean_error_mm is None else f", mean error {1e3 * self.mean_error_mm:.3g} µm"
        seen = "seen" if self.seen else "not seen"
        caption = (
            f"{self.model}, {self.fit.kind_in_words()}, on {self.dataset} ({seen} by the fit): {self.status}{mean}"
        )
        return html_table(caption, ("state", "field, mT", "error, µm", "deviation, µm"), rows)


class ValidationFile(Record):
    """A whole validation.json."""

    validations: tuple[Validation, ...]


def validate(evidence: Evidence, fit: FitRecord | TensileRecord, path: Path, index: int) -> Validation:
    """Simulate the fit ``index`` of the file ``path`` on a dataset and measure its error.

    Raises InputError when the fit was made from this very dataset under another section assumption.
    """
    section = evidence.experiment.model.specimen.section
    used = {reference.sha256: reference for reference in fit.datasets} if isinstance(fit, FitRecord) else {}
    seen = used.get(evidence.sha256)
    if seen is not None and seen.section != section:
        raise InputError(
            f"{path}: fits.{index} took {evidence.path} as {seen.section}, not {section}; give --section {seen.section}"
        )
    candidates = _across_interval(fit)

    def simulated(parameters: Array, experiments: Sequence[Experiment]) -> Comparison:
        beside = assumptions_of(fit, evidence, len(parameters))
        settings = [beside.setting] if beside.setting else None
        return compare(
            LAWS[fit.model], parameters, experiments, bulk_modulus_Pa=beside.bulk_modulus_Pa, settings=settings
        )

    experiments = (evidence.experiment,)
    corrected = mesh_corrected(experiments, lambda seen: simulated(candidates[:1], seen))
    compared = simulated(candidates, corrected or experiments)
    ok = not compared.unconverged[0]
    errors = zip(evidence.states, compared.error_mm[0], compared.deviation_mm[0], strict=True)
    return Validation(
        dataset=str(evidence.path),
        sha256=evidence.sha256,
        section=section,
        model=fit.model,
        fit=FitReference(
            path=str(path),
            index=index,
            kind=fit.fitted_to() if isinstance(fit, FitRecord) else fit.kind,
            window_percent=fit.window_percent if isinstance(fit, TensileRecord) else None,
        ),
        initial_shear_modulus=fit.initial_shear_modulus,
        seen=seen is not None,
        status="ok" if ok else "no equilibrium",
        mean_error_mm=float(compared.error_mm[0].mean()) if ok else None,
        mean_error_interval_mm=_error_interval(compared) if ok else None,
        mean_deviation_mm=float(compared.deviation_mm[0].mean()) if ok else None,
        max_stretch=float(compared.max_stretch[0]) if ok else None,
        stable=not compared.unstable[0] if ok else None,
        within_fitted_stretch=bool(compared.max_stretch[0] <= fit.max_stretch + _SAME_STRETCH) if ok else None,
        by_state=tuple(
            StateError(
                dataset=0,
                state=state.index,
                current_A=state.current_A,
                field_mT=state.field_mT,
                error_mm=float(error),
                deviation_mm=float(deviation),
            )
            for state, error, deviation in (errors if ok else ())
        ),
    )


def _across_interval(fit: FitRecord | TensileRecord) -> Array:
    """(1 + 5, n): the fit's parameters, and those of moduli across the interval of its initial shear modulus."""
    modulus = fit.initial_shear_modulus
    factors = np.append(1.0, np.linspace(*modulus.interval_95, _MODULI) / modulus.value)
    scaled = np.array([unit == "Pa" for unit in LAWS[fit.model].units])
    return np.where(scaled, factors[:, None], 1.0) * np.array(fit.values())


def _error_interval(compared: Comparison) -> tuple[float, float | None]:
    """The range of the mean error over the candidates; no upper end where one of them has no equilibrium."""
    found = compared.error_mm[~compared.unconverged].mean(axis=1)
    return float(found.min()), None if compared.unconverged.any() else float(found.max())


def write_validation(path: Path, validations: Sequence[Validation], force: bool = False) -> None:
    """Write validation.json. Raises InputError when the file exists and ``force`` is not given."""
    with whole_file(path, force) as temporary:
        text = ValidationFile(validations=tuple(validations)).model_dump_json(indent=1)
        temporary.write_text(text + "\n", encoding="utf-8")
