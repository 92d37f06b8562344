"""The results of a report in words: the modulus, its interval, the main sources of uncertainty, and the reliability."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from eimi_fitting.laws import LAWS
from eimi_lab.fits.evidence import WHOLE_FILES
from eimi_lab.fits.fit_summary import all_together_percent, entry_words
from eimi_lab.fits.grades import grade
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.validation import Validation
from eimi_lab.reporting.contents import DatasetContents, ReportContents
from eimi_lab.reporting.residual_noise import residual_noise
from eimi_lab.reporting.shown import ShownFit, chosen
from eimi_lab.showing.rounded import value_and_interval

_NOISE = "Do the residuals look like noise?"
_NEXT = "What to measure better next?"
_ALIKE = 2.0  # laws within this difference of AICc have substantial support (Burnham and Anderson 2002, section 2.6)


@dataclass(frozen=True)
class Verdict:
    """A question about a result, a short answer, and sentences that explain the answer (`words`)."""

    question: str
    answer: str
    words: str


@dataclass(frozen=True)
class Finding:
    """The result of a fit in words.

    Attributes
    ----------
    shown : ShownFit
        The best fit to the data.
    subject : str
        The material and the specimen.
    value, interval : str
        The initial shear modulus and its 95 % interval.
    doubt : str
        The reasons to distrust the fit; empty if there are none.
    how : str
        The law, and the data to which it was fitted.
    limit : str
        The largest contributions to the interval.
    verdicts : tuple of Verdict
        Questions about the result, with answers.
    """

    shown: ShownFit
    subject: str
    value: str
    interval: str
    doubt: str
    how: str
    limit: str
    verdicts: tuple[Verdict, ...]


def findings(report: ReportContents) -> list[Finding]:
    """Return the results of the best fits in words, one for each group of datasets that were fitted together.

    If no fit has a bent beam, return one result for each tensile test.
    """
    groups: dict[tuple[str, ...], list[ShownFit]] = {}
    for shown in report.bending or report.tensile:
        fit = shown.fit
        key = tuple(d.sha256 for d in fit.datasets) if isinstance(fit, FitRecord) else (fit.source.sha256,)
        groups.setdefault(key, []).append(shown)
    return [_finding(chosen(group), report) for group in groups.values()]


def truth_of(contents: DatasetContents) -> tuple[str, dict[str, float], float] | None:
    """Return the true material of a simulated dataset; None for a measured dataset.

    Parameters
    ----------
    contents : DatasetContents
        The dataset.

    Returns
    -------
    law : str
        The name of the law.
    parameters : dict of float
        The parameters of the law, by name.
    modulus_Pa : float
        The initial shear modulus in Pa.
    """
    truth = contents.dataset.truth()
    if not truth or truth.get("model") not in LAWS or not isinstance(truth.get("parameters"), dict):
        return None
    law, parameters = LAWS[truth["model"]], truth["parameters"]
    if len(parameters) != len(law.parameter_names):
        return None
    return law.name, parameters, float(law.initial_shear_modulus(np.array(list(parameters.values()), dtype=float)))


def _finding(shown: ShownFit, report: ReportContents) -> Finding:
    fit = shown.fit
    value, interval = value_and_interval(fit.initial_shear_modulus)
    if isinstance(fit, TensileRecord):
        where = f"a tensile test, window {fit.window()}"
        how = f"{fit.model}, from {where}"
        return Finding(shown, fit.source.material or "", value, interval, "", how, "", (_reach(fit),))
    fitted_to = [c for c in report.datasets if c.evidence.sha256 in {d.sha256 for d in fit.datasets}]
    noise, truths = _noise(shown, fitted_to), _truths(fit, fitted_to)
    verdicts = (_belief(fit, fitted_to, report), _next(fit), noise, _law(shown), _reach(fit), *truths)
    return Finding(
        shown,
        _subject(fitted_to) or ", ".join(d.path for d in fit.datasets),
        value,
        interval,
        fit.doubts_in_short(),
        _how(fit),
        _limit(fit, scatter_of(fitted_to)),
        tuple(verdict for verdict in verdicts if verdict is not None),
    )


def _subject(fitted_to: Sequence[DatasetContents]) -> str:
    beams = [contents.dataset.specimen.specimen for contents in fitted_to]
    names = ", ".join(dict.fromkeys(beam.name for beam in beams))
    material = ", ".join(dict.fromkeys(beam.material for beam in beams))
    return f"{material} (specimen {names})" if beams else ""


def _how(fit: FitRecord) -> str:
    used = sum(d.states.total - len(d.states.left_out) for d in fit.datasets)
    fields = [abs(state.field_mT) for state in fit.by_state]
    up_to = f", fields up to {max(fields):.3g} mT" if max(fields, default=0.0) > 0 else ""
    several = f" of {len(fit.datasets)} datasets" if len(fit.datasets) > 1 else ""
    curves = f" and {len(fit.tensile)} tensile curve{'s' * (len(fit.tensile) > 1)}" if fit.tensile else ""
    with_priors = f" with {len(fit.priors)} prior{'s' * (len(fit.priors) > 1)} on its parameters" if fit.priors else ""
    return f"{fit.model}{with_priors}, from {used} state{'s' * (used > 1)} of bending{several}{up_to}{curves}"


def scatter_of(datasets: Sequence[DatasetContents]) -> str:
    """Return a name for the noise of the measurement, such as `scatter of the edges`."""
    what = {"frames": "edges", "points": "tracked points"}
    kinds = [words for kind, words in what.items() if any(c.dataset.kind == kind for c in datasets)]
    return f"scatter of the {' and '.join(kinds) or 'measurements'}"


def _limit(fit: FitRecord, scatter: str) -> str:
    if fit.measure_next.source is None or not fit.budget:
        words = f"The {scatter} and the error of the mesh limit the interval."
    else:
        first, sources = fit.budget[0], len(fit.budget)
        words = f"The interval is limited most by {entry_words(first, fit)}, "
        words += f"whose standard uncertainty changes the modulus by {first.effect_percent:.2g} %."
        if sources > 1:
            words += f" The {sources} sources together change the modulus by {all_together_percent(fit):.2g} %. "
            words += "The 95 % interval extends about twice as far to each side."
    if fit.taken_as_exact:
        whole = [word for word in fit.taken_as_exact if word in WHOLE_FILES]
        inputs = f"The {' and the '.join(whole)}" if whole else "Some numbers of specimen or calibration"
        words += f" {inputs} {'are' if len(whole) != 1 or whole[0] == 'dimensions' else 'is'} taken as exact, "
        words += "because no uncertainty is given. The true interval is wider."
    for entry in fit.if_uncertain:
        unit = "degrees" if entry.unit == "deg" else entry.unit
        words += f" An error of {entry.standard_uncertainty:g} {unit} in the {entry.words} would change the modulus by "
        words += f"{entry.effect_percent:.2g} %."
    return words


def _belief(fit: FitRecord, fitted_to: Sequence[DatasetContents], report: ReportContents) -> Verdict:
    error = f"{1e3 * fit.mean_error_mm:.2g} µm"
    calibration = fitted_to[0].dataset.calibration if fitted_to else None
    if calibration is not None:
        error += f" ({fit.mean_error_mm * calibration.pixels_per_mm:.2g} pixel)"
    words = (
        f"The error is {error}: the root mean square of the distances between simulated and measured beam in each "
        "state, averaged over the states."
    )
    if fit.held_out_error_mm is not None:
        words += f" In states that were left out of the fit the error is {1e3 * fit.held_out_error_mm:.2g} µm."
    support = grade(fit, _on_unseen_specimens(fit, fitted_to, report))
    return Verdict("Can the modulus be believed?", support.name, f"{words} {support.words}")


def _on_unseen_specimens(
    fit: FitRecord, fitted_to: Sequence[DatasetContents], report: ReportContents
) -> Iterator[Validation]:
    """Yield the errors of a fit on each dataset of the report whose specimen was not used for the fit.

    `fitted_to` contains the datasets of the fit.
    """
    fitted_specimens = {contents.dataset.specimen.specimen.name for contents in fitted_to}
    for contents in report.datasets:
        if contents.dataset.specimen.specimen.name not in fitted_specimens:
            yield from (v for shown, v in zip(report.fits, contents.validations, strict=True) if shown.fit is fit)


def _next(fit: FitRecord) -> Verdict:
    """Return what to measure better next, and the 95 % interval that would result."""
    if not fit.budget and fit.taken_as_exact:
        return Verdict(
            _NEXT,
            "not known",
            "No uncertainty of an input is given. With the uncertainties under [uncertainty] in the files of specimen, "
            "calibration and rig, a fit names the input to measure better.",
        )
    now, later = (
        (low, high, 50 * (high - low) / fit.initial_shear_modulus.value)
        for low, high in (
            fit.initial_shear_modulus.interval_95,
            fit.measure_next.initial_shear_modulus_interval_95_Pa,
        )
    )
    answer, begin = fit.measure_next.words, "With half of this uncertainty"
    if fit.measure_next.source is None:
        answer, begin = "more states", "With four times as many states"
    return Verdict(
        _NEXT,
        answer,
        f"{begin} the interval would be {1e-3 * later[0]:.4g} to {1e-3 * later[1]:.4g} kPa: ±{later[2]:.2g} % instead "
        f"of ±{now[2]:.2g} %.",
    )


def _noise(shown: ShownFit, fitted_to: Sequence[DatasetContents]) -> Verdict | None:
    """Return whether the residuals of a fit look like noise in all datasets; None without edges."""
    simulated = ((contents.name, contents.simulated_by(shown)) for contents in fitted_to)
    tested = [(name, noise) for name, one in simulated if one and (noise := residual_noise(one))]
    if not tested:
        return None
    if len(tested) == 1:
        return Verdict(_NOISE, tested[0][1].answer, tested[0][1].words)
    answers = [noise.answer for _, noise in tested]
    answer = answers[0] if len(set(answers)) == 1 else f"{answers.count('yes')} of {len(answers)} datasets"
    parts = "; ".join(f"{name}: {noise.answer}{noise.parts and ', '}{noise.parts}" for name, noise in tested)
    words = f"{parts} (root mean squares). "
    if "no" in answers:
        words += "A systematic part is an error of beam model, optics or inputs, which noise does not explain. "
    return Verdict(_NOISE, answer, f"{words}The tests of each dataset are in the appendix.")


def _law(shown: ShownFit) -> Verdict:
    choices = shown.comparison
    if not choices:
        return Verdict("Which law?", "not compared", f"Only {shown.fit.model} was fitted to these data.")
    ranked = sorted((c for c in choices if c.aicc is not None), key=lambda c: c.aicc or 0.0)
    points = f"{choices[0].independent_points:.1f} independent points"
    if not ranked:
        return Verdict(
            "Which law?", "too few data", f"The data count as {points}. These are too few to compare the laws."
        )
    best, *others = ranked
    near = [c for c in others if c.aicc is not None and c.aicc < _ALIKE]
    weight = "" if best.weight is None else f" (Akaike weight {best.weight:.2f})"
    words = f"{best.model} has the smallest AICc{weight}"
    if near:
        words += "; " + ", ".join(f"the AICc of {c.model} is larger by {c.aicc:.1f}" for c in near)
        answer = f"{best.model}, or {' or '.join(c.model for c in near)}"
        return Verdict("Which law?", answer, f"{words}. The data ({points}) do not decide between these laws.")
    margin = f"; the AICc of the next law, {others[0].model}, is larger by {others[0].aicc:.1f}" if others else ""
    return Verdict("Which law?", best.model, f"{words}{margin}. The data count as {points}.")


def _reach(fit: FitRecord | TensileRecord) -> Verdict:
    limit = fit.stability.stable_up_to_stretch
    reached = fit.stretch_reached
    beyond = f"beyond {100 * (reached - 1):.1f} % strain"
    words = f"The data reach a stretch of {reached:.3f}; any stress {beyond} is extrapolated."
    held = [name for name in fit.held_by_bounds() if name != "initial_shear_modulus"]
    if held:
        words += f" The data do not determine {', '.join(held)}."
    if limit is not None:
        where = "at any stretch" if limit <= 1 else f"beyond a stretch of {limit:.3g}"
        words += f" The law is not stable {where}."
    return Verdict("What is extrapolated?", beyond, words)


def _truths(fit: FitRecord, fitted_to: Sequence[DatasetContents]) -> Iterator[Verdict]:
    """Yield comparisons of the fitted modulus with the true modulus, for simulated datasets."""
    truths = [(contents.name, truth) for contents in fitted_to if (truth := truth_of(contents))]
    for place, (_, truth) in enumerate(truths):
        if truth not in [other for _, other in truths[:place]]:
            yield _truth(fit, [name for name, other in truths if other == truth], truth)


def _truth(fit: FitRecord, names: Sequence[str], truth: tuple[str, dict[str, float], float]) -> Verdict:
    model, parameters, modulus = truth
    low, high = fit.initial_shear_modulus.interval_95
    difference = 100 * (fit.initial_shear_modulus.value / modulus - 1)
    inside = "inside" if low <= modulus <= high else "outside"
    values = ", ".join(
        f"{name.removesuffix('_Pa')} = {value:g}{' Pa' * name.endswith('_Pa')}" for name, value in parameters.items()
    )
    return Verdict(
        "How far is the modulus from the true value?",
        f"{difference:+.2f} %".replace("-", "−"),
        f"{', '.join(names)} {'were' if len(names) > 1 else 'was'} made on the virtual rig. Hidden material: {model}, "
        f"{values}, initial shear modulus {1e-3 * modulus:.4g} kPa, {inside} the interval. The fits did not use these "
        "values.",
    )
