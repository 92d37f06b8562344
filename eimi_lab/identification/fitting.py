"""Fitting laws to datasets: what `eimi fit` does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

from eimi_fitting.credibility import NotExplained
from eimi_fitting.identification import NothingConverged, identify
from eimi_fitting.materials import LAWS
from eimi_fitting.specimen import Section
from eimi_fitting.tensile import CannotFit
from eimi_lab.errors import InputError
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.fits import record
from eimi_lab.identification.records import FitRecord


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


REFUSALS = (NothingConverged, NotExplained, CannotFit)  # by `identify`, for what the evidence is


def refused(error: Exception, evidence: Sequence[Evidence]) -> InputError:
    """What a person is told of one of the REFUSALS."""
    if isinstance(error, NotExplained):
        own = evidence[error.experiment]
        return InputError(f"{own.path}: state {own.states[error.state].index}: {error}")
    return InputError(f"{', '.join(str(e.path) for e in evidence)}: {error}")


def fit_evidence(evidence: Sequence[Evidence], model: str, seed: int = 1, **options: Any) -> FitRecord:
    """Identify one law from all the evidence together; options are those of `identify`.

    Raises InputError when nothing could be simulated or explained.
    """
    try:
        fit = identify(model, [e.experiment for e in evidence], seed=seed, **options)
    except REFUSALS as error:
        raise refused(error, evidence) from error
    return record(fit, evidence)
