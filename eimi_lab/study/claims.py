"""What the paper says, in our words, beside what came out here.

The four claims are those that its abstract and results make; its printed numbers are not compared.
"""

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

_SIMILAR = 1.25  # largest over smallest error of the laws
_STEADY = 2.0  # error of the stronger half of the fields over that of the weaker half
MEASURE = (
    "By mean errors over unseen types without twist. Better: the worst law by bending against the best tensile fit of "
    f"all laws and windows. Similar: largest at most {_SIMILAR:g} times the smallest. Steady: in the stronger half of "
    f"the fields at most {_STEADY:g} times what it is in the weaker half. ∞: no equilibrium on an unseen type."
)


@dataclass(frozen=True)
class Verdict:
    """One claim for one material and section; evidence: the figures that it is judged by."""

    claim: str
    material: str
    section: str
    agrees: bool
    evidence: str


def verdicts(findings: Findings) -> list[Verdict]:
    """Every claim for every material and section."""
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
    own = next(a for a in advantages(findings, untwisted(findings)) if (a.material, a.section) == (key, section))
    evidence = (
        f"worst law by bending {number(own.bending_um[1])} µm, best by tension {number(own.tension_um)} µm "
        f"({own.tension.law}, {own.tension.window})"
    )
    evidence += f", {number(own.ratios[0], 2)} times as much" if own.ratios[0] else _lost(findings, key, section)
    low, high = (number(1e-3 * modulus) for modulus in own.bending_modulus_Pa)
    evidence += (
        f". Initial moduli: bending {low} to {high} kPa, that tensile fit {number(1e-3 * own.tension.modulus_Pa)} kPa, "
        f"true {number(1e-3 * MATERIALS[key].modulus_Pa)} kPa"
    )
    claim = "Laws by EIMI are better than the best conventional fit."
    return Verdict(claim, MATERIALS[key].name, section, own.ratios[0] > 1, evidence)


def _lost(findings: Findings, key: str, section: str) -> str:
    """Which laws by bending find no equilibrium on an unseen type, and how far each is stable."""
    told = []
    for route in (own for own in findings.routes(key, section) if own.source == BENDING):
        kinds = [k for k in untwisted(findings) if np.isinf(_bending_um(findings, key, section, k)[route.law])]
        if kinds:
            stable = stable_up_to(LAWS[route.law], np.array(route.values))
            limit = f"; it is stable to a stretch of {number(stable)}" if stable else ""
            told.append(f". {route.law} finds no equilibrium on {', '.join(kinds)}{limit}")
    return "".join(told)


def _bending_um(findings: Findings, key: str, section: str, kind: str) -> dict[str, float]:
    routes = findings.routes(key, section)
    errors = findings.errors[key, section, kind]
    return {r.law: mean_error_um(e) for r, e in zip(routes, errors, strict=True) if r.source == BENDING}


def _similar(findings: Findings, key: str, section: str) -> Verdict:
    kinds = untwisted(findings)
    every = [_bending_um(findings, key, section, kind) for kind in kinds]
    errors = {law: float(np.mean([own[law] for own in every])) for law in every[0]}
    best, worst = min(errors, key=lambda law: errors[law]), max(errors, key=lambda law: errors[law])
    agrees = errors[worst] <= _SIMILAR * errors[best]
    evidence = f"{number(errors[best])} µm ({best}) to {number(errors[worst])} µm ({worst})"
    if np.isinf(errors[worst]):
        evidence += _lost(findings, key, section)
    elif not agrees:
        evidence += (
            ". Beside noise and mesh the law alone is wrong here: what is left may be how the laws differ"
            if section == "solid"
            else ". A law with more freedom may follow a part of what the wrong section does to the shape"
        )
    return Verdict("All laws converge to a similar error.", MATERIALS[key].name, section, agrees, evidence)


def _steady(findings: Findings, key: str, section: str) -> Verdict:
    kinds = untwisted(findings)
    bent = [i for i, route in enumerate(findings.routes(key, section)) if route.source == BENDING]
    found = [
        findings.errors[key, section, kind][i]["error_mm"]
        for kind in kinds
        for i in bent
        if findings.errors[key, section, kind][i]["error_mm"]
    ]
    by_state = 1e3 * np.mean(found, axis=0)[1:]  # without the field at zero, where nothing bends
    half = len(by_state) // 2
    weak, strong = float(by_state[:half].mean()), float(by_state[half:].mean())
    agrees = strong <= _STEADY * weak
    evidence = f"weaker half of the fields {number(weak)} µm, stronger half {number(strong)} µm"
    if not agrees:
        evidence += (
            ". Beside noise and mesh the law alone is wrong here, and its error may grow with strain"
            if section == "solid"
            else ". What a wrong section does may grow with curvature"
        )
    return Verdict("The error is steady with the field.", MATERIALS[key].name, section, agrees, evidence)


def _type_4(findings: Findings, key: str, section: str) -> list[Verdict]:
    if TWISTED not in findings.inputs.extent.types:
        return []
    others = [kind for kind in untwisted(findings) if kind != TWISTED] or [TRAINED_ON]
    by_kind = {kind: _bending_um(findings, key, section, kind) for kind in (*others, TWISTED)}
    laws = [law for law in by_kind[TWISTED] if all(np.isfinite(own[law]) for own in by_kind.values())]
    mean = {kind: float(np.mean([own[law] for law in laws] or [np.inf])) for kind, own in by_kind.items()}
    evidence = (
        ", ".join(f"{kind} {number(value)} µm" for kind, value in mean.items())
        + f"; {TWISTED} is turned by {TWIST_DEG:g}° at its tip in the strongest field"
    )
    if len(laws) < len(by_kind[TWISTED]):
        evidence += f". Of {', '.join(laws)}: the others find no equilibrium on one of them"
    agrees = all(mean[TWISTED] > value for kind, value in mean.items() if kind != TWISTED)
    return [Verdict("Type 4, which twists, is worse.", MATERIALS[key].name, section, agrees, evidence)]


def in_words(findings: Findings) -> list[str]:
    """How much of the advantage over tensile fits is left when the section is right, a sentence a material."""
    found = {(a.material, a.section): a for a in advantages(findings, untwisted(findings))}
    lines = []
    for key in findings.inputs.extent.materials:
        flat, solid = found[key, "plane-strain"], found[key, "solid"]
        lines.append(
            f"{MATERIALS[key].name}: taken in plane strain, the best tensile fit is off by "
            f"{number(flat.tension_um)} µm, laws by bending by {number(flat.bending_um[0])} to "
            f"{number(flat.bending_um[1])} µm; as the solid {number(solid.tension_um)} µm against "
            f"{number(solid.bending_um[0])} to {number(solid.bending_um[1])} µm. Which tensile fit is best is known "
            f"with hindsight alone: the median one is off by {number(flat.median_tension_um)} µm in plane strain and "
            f"{number(solid.median_tension_um)} µm as the solid."
        )
    return lines
