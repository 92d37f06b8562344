"""Grade how well the data and the checks support a fit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.validation import Validation

_PREDICTED = 1.5  # a prediction succeeds if its error is below this many times that of the fitted states


@dataclass(frozen=True)
class Grade:
    """The grade of a fit.

    The grade says how well the data and the checks support the fit.

    Attributes
    ----------
    name : str
        One of the grades that the function `grade` lists.
    words : str
        Sentences with the reason for the grade.
    """

    name: str
    words: str


def grade(fit: FitRecord, unseen: Iterable[Validation] = ()) -> Grade:
    """Return the grade of a fit: how well the data and the checks support it.

    Parameters
    ----------
    fit : FitRecord
        The fit to grade.
    unseen : iterable of Validation
        Errors of the fit on datasets of specimens to which the law was not fitted.

    Returns
    -------
    Grade
        One of these grades, the weakest first:

        - "not determined": the data do not determine the modulus;
        - "doubted": a check raised a doubt;
        - "noise only": the interval contains only noise and the error of the mesh, because no uncertainty of an input
          is given;
        - "budget stated": the interval contains the uncertainties of the inputs;
        - "predicted unseen states": the law also predicted states (load steps) that were left out of the fit;
        - "predicted an unseen specimen": the law also predicted another specimen.

        For "noise only", "budget stated" and "predicted unseen states", the attribute `words` also names the specimens
        that the law did not predict.
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
    """Return whether a law predicts a specimen to which it was not fitted.

    This is so if the mean error on this specimen is less than 1.5 times the mean error on the fitted states. The lower
    end of the 95 % interval of the mean error is compared, if the interval is known.
    """
    if validation.mean_error_mm is None:
        return False
    least = validation.mean_error_interval_mm[0] if validation.mean_error_interval_mm else validation.mean_error_mm
    return min(least, validation.mean_error_mm) < _PREDICTED * fit.mean_error_mm
