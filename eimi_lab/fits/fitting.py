"""Fitting laws to datasets: what `eimi fit` does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

from eimi_fitting.beam.specimen import Section
from eimi_fitting.inference.doubts.checks import NotDetermined, NotExplained
from eimi_fitting.inference.identification import identify
from eimi_fitting.inference.searching.modulus_range import NothingActs, NothingConverged
from eimi_fitting.inference.searching.named_causes import NamedCause
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import CannotFit
from eimi_fitting.suggestion import suggestion
from eimi_lab.fits.before_search import check_states, in_words
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError


def check_models(models: Sequence[str]) -> list[str]:
    """The models asked for, each once. Raises InputError for an unknown one."""
    for model in models:
        if model not in LAWS:
            raise InputError(f"--model {model}: there is no law {model!r}; {suggestion(model, LAWS)}")
    return list(dict.fromkeys(models))


def check_section(section: str | None) -> Section | None:
    """The section asked for. Raises InputError for an unknown one."""
    for known in get_args(Section):
        if section == known:
            return known
    if section is None:
        return None
    raise InputError(f"--section {section}: there is no such section; {suggestion(section, get_args(Section))}")


REFUSALS = (
    NothingActs,
    NamedCause,
    NothingConverged,
    NotExplained,
    NotDetermined,
    CannotFit,
)  # by `identify`, for what the evidence is


def refused(error: Exception, evidence: Sequence[Evidence]) -> InputError:
    """What a person is told of one of the REFUSALS."""
    if isinstance(error, NotExplained):
        own = evidence[error.experiment]
        return InputError(f"{own.path}: state {own.states[error.state].index}: {error}")
    if isinstance(error, NamedCause):
        own = evidence[error.experiment]
        return InputError(in_words(error, own.path, own.experiment))
    return InputError(f"{', '.join(str(e.path) for e in evidence)}: {error}")


def check_evidence(evidence: Sequence[Evidence]) -> None:
    """Raises InputError for states that no material could explain, before anything is searched."""
    for own in evidence:
        check_states(own.path, own.experiment, own.states)


def fit_evidence(evidence: Sequence[Evidence], model: str, seed: int = 1, **options: Any) -> FitRecord:
    """Identify one law from all the evidence together; options are those of `identify`.

    Raises InputError when nothing could be simulated or explained.
    """
    check_evidence(evidence)
    try:
        fit = identify(model, [e.experiment for e in evidence], seed=seed, **options)
    except REFUSALS as error:
        raise refused(error, evidence) from error
    return FitRecord.of(fit, evidence)
