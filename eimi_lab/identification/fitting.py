"""Fitting laws to datasets: what `eimi fit` does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import get_args

from eimi_fitting.identification import NothingConverged, identify
from eimi_fitting.materials import LAWS
from eimi_fitting.specimen import Section
from eimi_lab.errors import InputError
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.fits import FitRecord, record


def check_models(models: Sequence[str]) -> list[str]:
    """The models asked for, each once. Raises InputError for an unknown one."""
    for model in models:
        if model not in LAWS:
            raise InputError(f"--model {model}: should be one of {', '.join(LAWS)}")
    return list(dict.fromkeys(models))


def check_section(section: str | None) -> Section | None:
    """The section asked for. Raises InputError for an unknown one."""
    for known in get_args(Section):
        if section == known:
            return known
    if section is None:
        return None
    raise InputError(f"--section {section}: should be one of {', '.join(get_args(Section))}")


Report = Callable[[str, int, float, float], None]


def fit_evidence(evidence: Sequence[Evidence], model: str, seed: int = 1, report: Report | None = None) -> FitRecord:
    """Identify one law from all the evidence together.

    ``report(model, generation, best_mm, step_size)`` is called once a generation. Raises InputError when nothing
    could be simulated.
    """

    def progress(generation: int, best_mm: float, step_size: float) -> None:
        if report:
            report(model, generation, best_mm, step_size)

    try:
        fit = identify(model, [e.experiment for e in evidence], seed=seed, progress=progress)
    except NothingConverged as error:
        raise InputError(f"{', '.join(str(e.path) for e in evidence)}: {error}") from error
    return record(fit, evidence)
