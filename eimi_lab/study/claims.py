"""Compare four claims of the paper by Di Lecce et al. 2022 with the results of the study."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eimi_fitting.laws import LAWS, stable_up_to
from eimi_lab.study.errors_by_route import mean_error_um
from eimi_lab.study.extent import SECTIONS, TRAINED_ON
from eimi_lab.study.hidden_materials import MATERIALS
from eimi_lab.study.observed import TWIST_DEG, TWISTED
from eimi_lab.study.paper_tables import advantages, number, untwisted
from eimi_lab.study.routes import BENDING
from eimi_lab.study.whole_study import Findings

_SIMILAR = 1.25  # limit of the ratio of the largest to the smallest error of the laws
_STEADY = 2.0  # limit of the ratio of the errors in the stronger and in the weaker half of the fields
MEASURE = (
    "EIMI is the method of the paper, the identification of a law from the bending of a magnetic beam. The claims are "
    "judged by mean errors over the types of specimen that were not used for the fits and do not twist. Better: the "
    "worst law fitted to bending has a smaller error than the best tensile fit of all laws and windows. Similar: the "
    f"largest error is at most {_SIMILAR:g} times the smallest. Steady: the error in the stronger half of the fields "
    f"is at most {_STEADY:g} times the error in the weaker half. ∞: the beam has no equilibrium on one of these types."
)


@dataclass(frozen=True)
class Verdict:
    """The verdict on one claim of Di Lecce et al. 2022, for one material and one model of the cross-section."""

    claim: str
    material: str
    section: str
    agrees: bool
    evidence: str


def verdicts(findings: Findings) -> list[Verdict]:
    """Return whether the results agree with each claim of Di Lecce et al. 2022."""
    return [
        verdict
        for section in SECTIONS
        for key in findings.inputs.extent.materials
        for verdict in (
            _better(findings, key, section),
            _similar(findings, key, section),
            _steady(findings, key, section),
            *_type_4(findings, key, section),
        )
    ]


def _better(findings: Findings, key: str, section: str) -> Verdict:
    both = next(a for a in advantages(findings, untwisted(findings)) if (a.material, a.section) == (key, section))
    evidence = (
        f"worst law fitted to bending {number(both.bending_um[1])} µm, best law fitted to tension "
        f"{number(both.tension_um)} µm ({both.tension.law}, {both.tension.window})"
    )
    evidence += (
        f", which is {number(both.ratios[0], 2)} times as much" if both.ratios[0] else _lost(findings, key, section)
    )
    low, high = (number(1e-3 * modulus) for modulus in both.bending_modulus_Pa)
    evidence += (
        f". Initial moduli: bending {low} to {high} kPa, best tensile fit {number(1e-3 * both.tension.modulus_Pa)} "
        f"kPa, true {number(1e-3 * MATERIALS[key].modulus_Pa)} kPa"
    )
    claim = "Laws identified by EIMI have smaller errors than the best conventional fit."
    return Verdict(claim, MATERIALS[key].name, section, both.ratios[0] > 1, evidence)


def _lost(findings: Findings, key: str, section: str) -> str:
    """Return a text on laws with which some simulated beams have no equilibrium; empty without such laws."""
    sentences = []
    for route in (route for route in findings.routes(key, section) if route.source == BENDING):
        kinds = [k for k in untwisted(findings) if np.isinf(_bending_um(findings, key, section, k)[route.law])]
        if kinds:
            stable = stable_up_to(LAWS[route.law], np.array(route.values))
            limit = f"; it is stable up to a stretch of {number(stable)}" if stable else ""
            sentences.append(f". {route.law} has no equilibrium on {', '.join(kinds)}{limit}")
    return "".join(sentences)


def _bending_um(findings: Findings, key: str, section: str, kind: str) -> dict[str, float]:
    """Return the mean error (µm) on one type of specimen, for each law fitted to bending.

    `key` is the material, `section` the model of the cross-section, and `kind` the type of specimen.
    """
    routes = findings.routes(key, section)
    errors = findings.errors[key, section, kind]
    return {r.law: mean_error_um(e) for r, e in zip(routes, errors, strict=True) if r.source == BENDING}


def _similar(findings: Findings, key: str, section: str) -> Verdict:
    by_kind = [_bending_um(findings, key, section, kind) for kind in untwisted(findings)]
    errors = {law: float(np.mean([of_kind[law] for of_kind in by_kind])) for law in by_kind[0]}
    best, worst = min(errors, key=lambda law: errors[law]), max(errors, key=lambda law: errors[law])
    agrees = errors[worst] <= _SIMILAR * errors[best]
    evidence = f"from {number(errors[best])} µm ({best}) to {number(errors[worst])} µm ({worst})"
    if np.isinf(errors[worst]):
        evidence += _lost(findings, key, section)
    elif not agrees:
        evidence += (
            ". Here only the law is wrong, apart from noise and mesh, so that the errors may show how the laws differ"
            if section == "solid"
            else ". A law with more parameters may fit a part of the effect of the wrong section on the shape"
        )
    return Verdict("All laws converge to a similar error.", MATERIALS[key].name, section, agrees, evidence)


def _steady(findings: Findings, key: str, section: str) -> Verdict:
    bending = [i for i, route in enumerate(findings.routes(key, section)) if route.source == BENDING]
    errors_mm = [
        findings.errors[key, section, kind][i]["error_mm"]
        for kind in untwisted(findings)
        for i in bending
        if findings.errors[key, section, kind][i]["error_mm"]
    ]
    by_state = 1e3 * np.mean(errors_mm, axis=0)[1:]  # without the state at zero field, in which the beam is not bent
    half = len(by_state) // 2
    weak, strong = float(by_state[:half].mean()), float(by_state[half:].mean())
    agrees = strong <= _STEADY * weak
    evidence = f"{number(weak)} µm in the weaker half of the fields, {number(strong)} µm in the stronger half"
    if not agrees:
        evidence += (
            ". Here only the law is wrong, apart from noise and mesh. The error of the law may grow with strain"
            if section == "solid"
            else ". The effect of the wrong section may grow with curvature"
        )
    return Verdict("The error stays steady if the field increases.", MATERIALS[key].name, section, agrees, evidence)


def _type_4(findings: Findings, key: str, section: str) -> list[Verdict]:
    if TWISTED not in findings.inputs.extent.types:
        return []
    others = [kind for kind in untwisted(findings) if kind != TWISTED] or [TRAINED_ON]
    by_kind = {kind: _bending_um(findings, key, section, kind) for kind in (*others, TWISTED)}
    laws = [law for law in by_kind[TWISTED] if all(np.isfinite(errors[law]) for errors in by_kind.values())]
    mean = {kind: float(np.mean([errors[law] for law in laws] or [np.inf])) for kind, errors in by_kind.items()}
    evidence = (
        ", ".join(f"{kind} {number(value)} µm" for kind, value in mean.items())
        + f"; {TWISTED} is turned by {TWIST_DEG:g}° at its tip in the strongest field"
    )
    if len(laws) < len(by_kind[TWISTED]):
        evidence += (
            f". These are means over {', '.join(laws)} only, because the other laws have no equilibrium on one of the "
            "types"
        )
    agrees = all(mean[TWISTED] > value for kind, value in mean.items() if kind != TWISTED)
    return [Verdict("The error is larger on type 4, which twists.", MATERIALS[key].name, section, agrees, evidence)]


def in_words(findings: Findings) -> list[str]:
    """Return, for each material, a paragraph that compares laws fitted to bending with laws fitted to tension."""
    compared = {(a.material, a.section): a for a in advantages(findings, untwisted(findings))}
    lines = []
    for key in findings.inputs.extent.materials:
        flat, solid = compared[key, "plane-strain"], compared[key, "solid"]
        lines.append(
            f"{MATERIALS[key].name}: in plane strain the best tensile fit has an error of {number(flat.tension_um)} "
            f"µm, and the laws fitted to bending have errors from {number(flat.bending_um[0])} to "
            f"{number(flat.bending_um[1])} µm; with the solid section the best tensile fit has "
            f"{number(solid.tension_um)} µm, and the laws fitted to bending have {number(solid.bending_um[0])} to "
            f"{number(solid.bending_um[1])} µm. The best tensile fit is the tensile fit with the smallest of these "
            f"errors. The median tensile fit has {number(flat.median_tension_um)} µm in plane strain and "
            f"{number(solid.median_tension_um)} µm with the solid section."
        )
    return lines
