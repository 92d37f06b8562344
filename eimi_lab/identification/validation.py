"""validation.json: what a fit's error is on datasets, those that it has not seen above all.

A law that finds no equilibrium in one of the states is a result, not an accident: its errors are then null and its
status says so. A law that is not Drucker-stable over the stretches it reaches is simulated all the same, and flagged.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from eimi_fitting.experiment import compare
from eimi_fitting.materials import LAWS
from eimi_lab.errors import InputError
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.fits import FitRecord, Quantity, Record, StateError, TensileRecord
from eimi_lab.outputs import whole_file

_SAME_STRETCH = 1e-3  # two simulations of one beam may differ by this much


class FitReference(Record):
    """Which fit of which file; window_percent of a tensile fit (null: the whole curve)."""

    path: str
    index: int
    kind: Literal["bending", "tensile"]
    window_percent: float | None


class Validation(Record):
    """One fit on one dataset.

    seen: the fit was made from this dataset; stable: Drucker-stable over the stretches reached here (null where no
    equilibrium was found); within_fitted_stretch: the fit's data reached the largest stretch of this dataset.
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
    mean_deviation_mm: float | None
    max_stretch: float | None
    stable: bool | None
    within_fitted_stretch: bool | None
    by_state: tuple[StateError, ...]


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
    compared = compare(LAWS[fit.model], np.array([fit.values()]), [evidence.experiment])
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
            kind=fit.kind,
            window_percent=fit.window_percent if isinstance(fit, TensileRecord) else None,
        ),
        initial_shear_modulus=fit.initial_shear_modulus,
        seen=seen is not None,
        status="ok" if ok else "no equilibrium",
        mean_error_mm=float(compared.error_mm[0].mean()) if ok else None,
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


def write_validation(path: Path, validations: Sequence[Validation], force: bool = False) -> None:
    """Write validation.json. Raises InputError when the file exists and ``force`` is not given."""
    with whole_file(path, force) as temporary:
        text = ValidationFile(validations=tuple(validations)).model_dump_json(indent=1)
        temporary.write_text(text + "\n", encoding="utf-8")


_HEAD = ("fit", "", "law", "shear modulus, kPa [95 %]", "error, µm", "± µm", "stretch", "notes")


def table(validations: Sequence[Validation]) -> list[str]:
    """Lines to print: for each dataset every fit, the smallest mean error first, those without a result last."""
    rows = [(v, _cells(v)) for v in validations]
    widths = [max(len(cells[i]) for cells in (_HEAD, *(c for _, c in rows))) for i in range(len(_HEAD))]
    lines = []
    for dataset in dict.fromkeys(v.dataset for v in validations):
        own = [(v, cells) for v, cells in rows if v.dataset == dataset]
        own.sort(key=lambda row: np.inf if row[0].mean_error_mm is None else row[0].mean_error_mm)
        lines.append(f"{dataset} ({own[0][0].section}, {max(len(v.by_state) for v, _ in own)} states)")
        for cells in (_HEAD, *(c for _, c in own)):
            aligned = [
                c.rjust(w) if 4 <= i <= 6 else c.ljust(w) for i, (c, w) in enumerate(zip(cells, widths, strict=True))
            ]
            lines.append(f"  {'  '.join(aligned)}".rstrip())
    return lines


def _cells(v: Validation) -> tuple[str, ...]:
    kind: str = v.fit.kind
    if kind == "tensile":
        kind += " full" if v.fit.window_percent is None else f" {v.fit.window_percent:g} %"
    modulus = v.initial_shear_modulus
    low, high = modulus.interval_95
    moduli = f"{1e-3 * modulus.value:.2f} [{1e-3 * low:.2f}, {1e-3 * high:.2f}]"
    start = (f"{v.fit.path}:{v.fit.index}", kind, v.model, moduli)
    if v.mean_error_mm is None or v.mean_deviation_mm is None or v.max_stretch is None:
        return (*start, "-", "-", "-", v.status)
    notes = ["seen" if v.seen else "unseen"]
    if not v.stable:
        notes.append("not stable over these stretches")
    if not v.within_fitted_stretch:
        notes.append("stretched beyond its data")
    figures = f"{1e3 * v.mean_error_mm:.2f}", f"{1e3 * v.mean_deviation_mm:.2f}", f"{v.max_stretch:.3f}"
    return (*start, *figures, ", ".join(notes))
