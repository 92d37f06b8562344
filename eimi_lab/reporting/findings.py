"""What a report comes to: a number with its interval and what limits it, and whether that is to be believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.laws import LAWS
from eimi_lab.fits.evidence import WHOLE_FILES
from eimi_lab.fits.fit_summary import all_together_percent, entry_words
from eimi_lab.fits.records import FitRecord, TensileRecord
from eimi_lab.reporting.contents import DatasetContents, ReportContents
from eimi_lab.reporting.rounded import value_and_interval
from eimi_lab.reporting.shown import ShownFit, chosen

_ALIKE = 2.0  # of AICc: laws nearer than that have substantial support (Burnham and Anderson 2002, section 2.6)


@dataclass(frozen=True)
class Verdict:
    """A question that a reader has, the answer in a word or two, and why."""

    question: str
    answer: str
    words: str


@dataclass(frozen=True)
class Finding:
    """The fit that a report stands for among those of the same data, in words.

    subject: what was measured; how: law and data; limit: what limits the interval.
    """

    shown: ShownFit
    subject: str
    value: str
    interval: str
    how: str
    limit: str
    verdicts: tuple[Verdict, ...]


def findings(report: ReportContents) -> list[Finding]:
    """One for each set of datasets that were fitted together; of the tensile tests where none was."""
    groups: dict[tuple[str, ...], list[ShownFit]] = {}
    for shown in report.bending or report.tensile:
        fit = shown.fit
        key = tuple(d.sha256 for d in fit.datasets) if isinstance(fit, FitRecord) else (fit.source.sha256,)
        groups.setdefault(key, []).append(shown)
    return [_finding(chosen(group), report) for group in groups.values()]


def truth_of(contents: DatasetContents) -> tuple[str, dict[str, float], float] | None:
    """Law, parameters and initial shear modulus in Pa of a virtual rig's hidden material; None of a real one."""
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
        return Finding(shown, fit.source.material or "", value, interval, how, "", (_reach(fit),))
    own = [c for c in report.datasets if c.evidence.sha256 in {d.sha256 for d in fit.datasets}]
    asked = (_belief(fit, own), _next(fit), _law(shown), _reach(fit), *(_truth(fit, contents) for contents in own))
    return Finding(
        shown,
        _subject(own) or ", ".join(d.path for d in fit.datasets),
        value,
        interval,
        _how(fit),
        _limit(fit),
        tuple(verdict for verdict in asked if verdict is not None),
    )


def _subject(own: Sequence[DatasetContents]) -> str:
    beams = [contents.dataset.specimen.specimen for contents in own]
    names = ", ".join(dict.fromkeys(beam.name for beam in beams))
    material = ", ".join(dict.fromkeys(beam.material for beam in beams))
    return f"{material} (specimen {names})" if beams else ""


def _how(fit: FitRecord) -> str:
    used = sum(d.states.total - len(d.states.left_out) for d in fit.datasets)
    fields = [abs(state.field_mT) for state in fit.by_state]
    up_to = f", fields up to {max(fields):.3g} mT" if max(fields, default=0.0) > 0 else ""
    several = f" of {len(fit.datasets)} datasets" if len(fit.datasets) > 1 else ""
    curves = f" and {len(fit.tensile)} tensile curve{'s' * (len(fit.tensile) > 1)}" if fit.tensile else ""
    known = f" with {len(fit.priors)} prior{'s' * (len(fit.priors) > 1)} on its parameters" if fit.priors else ""
    return f"{fit.model}{known}, from {used} state{'s' * (used > 1)} of bending{several}{up_to}{curves}"


def _limit(fit: FitRecord) -> str:
    if fit.measure_next.source is None or not fit.budget:
        words = "The scatter of the edges and the mesh limit the interval"
    else:
        first, sources = fit.budget[0], len(fit.budget)
        words = f"The interval is limited most by {entry_words(first, fit)}, "
        words += f"whose standard uncertainty moves the modulus by {first.effect_percent:.2g} %"
        if sources > 1:
            words += f"; those of all {sources} sources together move it by {all_together_percent(fit):.2g} %, "
            words += "and an interval of 95 % is twice that to either side"
    if fit.taken_as_exact:
        whole = [word for word in fit.taken_as_exact if word in WHOLE_FILES]
        what = " and ".join(whole) if whole else "some numbers of specimen or calibration"
        words += f"; {what} {'are' if len(whole) != 1 or whole[0] == 'dimensions' else 'is'} taken as exact, "
        words += "for nobody stated an uncertainty: the true interval is wider"
    return f"{words}."


def _belief(fit: FitRecord, own: Sequence[DatasetContents]) -> Verdict:
    error = f"{1e3 * fit.mean_error_mm:.2g} µm"
    calibration = own[0].dataset.calibration if own else None
    if calibration is not None:
        error += f" ({fit.mean_error_mm * calibration.pixels_per_mm:.2g} pixel)"
    words = f"The simulated beam is {error} off in the mean"
    if fit.held_out_error_mm is not None:
        words += f", {1e3 * fit.held_out_error_mm:.2g} µm in states left out of the fit"
    words += "."
    doubts = fit.doubts_in_words()
    if "initial_shear_modulus" in fit.held_by_bounds():
        return Verdict("Can it be believed?", "no", f"The data leave the modulus open. {words}")
    if doubts:
        more = "; ".join(doubts)
        return Verdict("Can it be believed?", "with doubts", f"{words} Doubts: {more}.")
    return Verdict("Can it be believed?", "yes", f"{words} No check raised a doubt.")


def _next(fit: FitRecord) -> Verdict | None:
    """What to do to know the number better; None where only noise is known."""
    if not fit.budget:
        return None
    now, then = (
        (low, high, 50 * (high - low) / fit.initial_shear_modulus.value)
        for low, high in (
            fit.initial_shear_modulus.interval_95,
            fit.measure_next.initial_shear_modulus_interval_95_Pa,
        )
    )
    answer, begin = fit.measure_next.words, "With half of its uncertainty"
    if fit.measure_next.source is None:
        answer, begin = "more states", "With four times as many"
    return Verdict(
        "What to measure better next?",
        answer,
        f"{begin} the interval would be {1e-3 * then[0]:.4g} to {1e-3 * then[1]:.4g} kPa: ±{then[2]:.2g} % in place "
        f"of ±{now[2]:.2g} %.",
    )


def _law(shown: ShownFit) -> Verdict:
    choices = shown.comparison
    if not choices:
        return Verdict("Which law?", "not compared", f"{shown.fit.model} alone was fitted to these data.")
    known = sorted((c for c in choices if c.aicc is not None), key=lambda c: c.aicc or 0.0)
    if not known:
        return Verdict("Which law?", "too few data", "These data cannot tell the laws apart.")
    near = [c for c in known[1:] if c.aicc is not None and c.aicc < _ALIKE]
    words = f"The smallest AICc{_weight(known[0])}"
    if near:
        words += "; " + ", ".join(f"{c.model} is {c.aicc:.1f} above it" for c in near)
        return Verdict(
            "Which law?", f"{known[0].model}, or {' or '.join(c.model for c in near)}", f"{words}: no clear choice."
        )
    far = f"; the next, {known[1].model}, is {known[1].aicc:.1f} above it" if len(known) > 1 else ""
    return Verdict("Which law?", known[0].model, f"{words}{far}.")


def _weight(choice: Choice) -> str:
    return "" if choice.weight is None else f" (Akaike weight {choice.weight:.2f})"


def _reach(fit: FitRecord | TensileRecord) -> Verdict:
    limit = fit.stability.stable_up_to_stretch
    beyond = f"beyond {100 * (fit.max_stretch - 1):.1f} % strain"
    words = f"The data reach a stretch of {fit.max_stretch:.3f}; every stress {beyond} is extrapolated."
    held = [name for name in fit.held_by_bounds() if name != "initial_shear_modulus"]
    if held:
        words += f" Not measured: {', '.join(held)}."
    if limit is not None:
        words += (
            " The law is stable nowhere." if limit <= 1 else f" The law is not stable beyond a stretch of {limit:.3g}."
        )
    return Verdict("What is extrapolated?", beyond, words)


def _truth(fit: FitRecord, contents: DatasetContents) -> Verdict | None:
    truth = truth_of(contents)
    if truth is None:
        return None
    model, parameters, modulus = truth
    low, high = fit.initial_shear_modulus.interval_95
    difference = 100 * (fit.initial_shear_modulus.value / modulus - 1)
    inside = "inside" if low <= modulus <= high else "outside"
    values = ", ".join(
        f"{name.removesuffix('_Pa')} = {value:g}{' Pa' * name.endswith('_Pa')}" for name, value in parameters.items()
    )
    return Verdict(
        "And the truth?",
        f"{difference:+.2f} %".replace("-", "−"),
        f"{contents.name} is of the virtual rig. Its hidden material: {model}, {values}, initial shear modulus "
        f"{1e-3 * modulus:.4g} kPa, {inside} the interval. No fit saw it.",
    )
