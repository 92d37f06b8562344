"""Grade how well the data and the checks support a fit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.validation import Validation

_PREDICTED = 1.5  # a prediction succeeds if its error is below this factor times the error of the fitted states


@dataclass(frozen=True)
class Grade:
    """The grade of a fit: how well the data and the checks support it.

    Attributes
    ----------
    name : str
        Name of the grade.
    words : str
        Sentences with the reason.
    """

    name: str
    words: str


def grade(fit: FitRecord, unseen: Iterable[Validation] = ()) -> Grade:
    """Return the grade of a fit: how well the data and the checks support it.

    Parameters
    ----------
    fit : FitRecord
        Fit to grade.
    unseen : iterable of Validation
        Errors of the fit on other specimens.

    Returns
    -------
    Grade
        One of these grades, the weakest first:

        - "not determined": the data do not determine the modulus;
        - "doubted": a check raised a doubt;
        - "noise only": the interval contains only noise and the error of the mesh;
        - "budget stated": the interval also contains the uncertainties of the inputs;
        - "predicted unseen states": the law predicted states (load steps) that were left out of the fit;
        - "predicted an unseen specimen": the law predicted another specimen.
    """
    if "initial_shear_modulus" in fit.held_by_bounds():
        return Grade("not determined", "The data do not determine the modulus.")
    doubts = fit.doubts_in_words()
    if doubts:
        return Grade("doubted", f"Doubts: {'; '.join(doubts)}.")
    on_unseen = [validation for validation in unseen if not validation.seen]
    missed = [validation.dataset for validation in on_unseen if not _is_predicted(fit, validation)]
    no_doubt = "No check raised a doubt."
    if missed:
        no_doubt += f" The law did not predict the specimen of {', '.join(missed)}."
    elif on_unseen:
        return Grade(
            "predicted an unseen specimen",
            f"{no_doubt} The law predicted the specimen of {', '.join(v.dataset for v in on_unseen)}, to which it was "
            "not fitted.",
        )
    held_out = fit.held_out_error_mm
    if not fit.budget:
        words = "The interval contains noise and mesh error only: no uncertainty of the inputs is given."
        return Grade("noise only", f"{no_doubt} {words}")
    if held_out is not None and held_out < _PREDICTED * fit.mean_error_mm:
        words = (
            "The interval contains the uncertainties that the files give. The law predicted states that were left "
            "out of the fit."
        )
        untested = "" if missed else " It has not been tested on another specimen."
        return Grade("predicted unseen states", f"{no_doubt} {words}{untested}")
    words = (
        "The interval contains the uncertainties that the files give. The law has not predicted states outside the fit."
    )
    return Grade("budget stated", f"{no_doubt} {words}")


def _is_predicted(fit: FitRecord, validation: Validation) -> bool:
    """Return whether the error on another specimen is less than 1.5 times the error on the fitted states."""
    if validation.mean_error_mm is None:
        return False
    least = validation.mean_error_interval_mm[0] if validation.mean_error_interval_mm else validation.mean_error_mm
    return min(least, validation.mean_error_mm) < _PREDICTED * fit.mean_error_mm
