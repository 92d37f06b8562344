"""Check the options and the datasets of a fit, and explain to the user why a fit is refused."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from eimi_fitting.beam.specimen import Section
from eimi_fitting.inference.doubts.checks import NotDetermined, NotExplained
from eimi_fitting.inference.searching.modulus_range import NothingActs, NothingConverged
from eimi_fitting.inference.searching.named_causes import NamedCause
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import CannotFit
from eimi_fitting.suggestion import suggestion
from eimi_lab.fits.before_search import check_states, in_words
from eimi_lab.fits.evidence import Evidence
from eimi_lab.process.errors import InputError


def check_models(models: Sequence[str]) -> list[str]:
    """Return the names of laws without repetitions. Raises InputError for an unknown law."""
    for model in models:
        if model not in LAWS:
            raise InputError(f"--model {model}: there is no law {model!r}; {suggestion(model, LAWS)}")
    return list(dict.fromkeys(models))


def check_section(section: str | None) -> Section | None:
    """Return the model of the cross-section with this name; None without a name. Raises InputError if unknown."""
    for name in get_args(Section):
        if section == name:
            return name
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
)
"""The errors by which `identify` refuses the evidence."""


def refused(error: Exception, evidence: Sequence[Evidence]) -> InputError:
    """Return the message for the user why the data cannot be fitted, with the path of the dataset.

    `error` is the exception that the fit raised.
    """
    if isinstance(error, NotExplained):
        dataset = evidence[error.experiment]
        return InputError(f"{dataset.path}: state {dataset.states[error.state].index}: {error}")
    if isinstance(error, NamedCause):
        dataset = evidence[error.experiment]
        return InputError(in_words(error, dataset.path, dataset.experiment))
    return InputError(f"{', '.join(str(e.path) for e in evidence)}: {error}")


def check_evidence(evidence: Sequence[Evidence]) -> None:
    """Check all datasets before a search. Raises InputError if no material could explain a dataset."""
    for dataset in evidence:
        check_states(dataset.path, dataset.experiment, dataset.states)
