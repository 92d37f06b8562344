"""The tables of a study: those of the paper by Di Lecce et al. 2022, and one for each open question."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eimi_fitting.laws import LAWS
from eimi_lab.showing.significant import significant
from eimi_lab.study.errors_by_route import mean_deviation_um, mean_error_um
from eimi_lab.study.extent import SECTIONS
from eimi_lab.study.hidden_materials import MATERIALS
from eimi_lab.study.observed import TWISTED
from eimi_lab.study.routes import BENDING, Route
from eimi_lab.study.whole_study import Findings


@dataclass(frozen=True)
class Table:
    """A table of a study, with the name of its CSV file and a note."""

    name: str
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def markdown(self) -> str:
        """Return the table and its note in Markdown."""
        lines = [self.head, tuple("---" for _ in self.head), *self.rows]
        table = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
        return f"{table}\n\n{self.note}".strip()


def number(value: float | None, digits: int = 3) -> str:
    """Return a number as text: `digits` significant digits, or a whole number from 10000; None is `–`, infinity `∞`.

    Examples
    --------
    >>> number(12.345), number(1234.5), number(12345.6), number(None), number(float("inf"))
    ('12.3', '1230', '12346', '–', '∞')
    """
    if value is None:
        return "–"
    if np.isinf(value):
        return "∞"
    text = f"{value:.{digits}g}" if abs(value) < 1e4 else f"{value:.0f}"
    return f"{float(text):.0f}" if "e+" in text else text


def all_tables(findings: Findings) -> list[Table]:
    """Return all tables of a study, except the table of the claims."""
    tables = [searches(findings), *(parameters(findings, key) for key in findings.inputs.extent.materials)]
    tables.append(advantage_table(findings))
    if findings.answers:
        answers = findings.answers
        tables += [
            _compressibility(answers["compressibility"]),
            _moment(answers["moment"]),
            _states(answers["states"]),
            _optimisers(answers["optimisers"]),
        ]
    return tables


def searches(findings: Findings) -> Table:
    """Return a table of the fits to bending, with evaluations and errors (table 4 of Di Lecce et al. 2022)."""
    rows = [
        (
            MATERIALS[key].name,
            section,
            fit["law"],
            str(fit["evaluations"]),
            str(fit["generations"]),
            str(fit["unconverged"] + fit["unstable"]),
            number(1e3 * fit["mean_error_mm"]),
            number(1e3 * fit["mean_deviation_mm"]),
            ", ".join(fit["not_fixed"]) or "–",
        )
        for (key, section), fits in findings.bending.items()
        for fit in fits
    ]
    head = (
        *("material", "section", "law", "evaluations", "generations", "discarded", "error, µm", "deviation, µm"),
        "not determined by the data",
    )
    note = (
        "Discarded: candidates for which the beam has no equilibrium or the law is not stable. A parameter that the "
        "data do not determine may be at a bound of its search. The search uses ratios and shares of the parameters, "
        "which have the names in the last column."
    )
    return Table(
        "searches", "Searches for the laws on a specimen of type 1 (table 4 of the paper)", head, tuple(rows), note
    )


def _values(route: Route) -> str:
    law = LAWS[route.law]
    named = zip(law.parameter_names, law.units, route.values, strict=True)
    return ", ".join(
        f"{name} {significant(v / 1e3, 4)} kPa" if unit == "Pa" else f"{name} {significant(v, 3)}"
        for name, unit, v in named
    )


def parameters(findings: Findings, key: str) -> Table:
    """Return a table of the parameters and errors for one material (tables 5 and 6 of Di Lecce et al. 2022)."""
    extent = findings.inputs.extent
    rows: list[tuple[str, ...]] = []
    for section in SECTIONS:
        for index, route in enumerate(findings.routes(key, section)):
            cells = []
            for kind in extent.types:
                stored = findings.errors[key, section, kind][index]
                cells.append(f"{number(mean_error_um(stored))} ({number(mean_deviation_um(stored))})")
            rows.append((section, route.name, route.law, _values(route), number(route.modulus_Pa / 1e3), *cells))
    return Table(
        f"parameters_{key}",
        f"Parameters and errors, {MATERIALS[key].name} (tables 5 and 6 of the paper)",
        ("section", "fitted to", "law", "parameters", "initial modulus, kPa", *(f"{k}, µm" for k in extent.types)),
        tuple(rows),
        f"Mean error and, in brackets, mean deviation. True initial modulus "
        f"{number(MATERIALS[key].modulus_Pa / 1e3)} kPa. ∞: no equilibrium. Tensile fits are unconstrained least "
        "squares, as is usual; a negative modulus is not physical.",
    )


@dataclass(frozen=True)
class Advantage:
    """The mean errors of simulated beam edges, with laws fitted to bending and with laws fitted to tension.

    Attributes
    ----------
    material, section : str
        Key of the material, and "plane-strain" or "solid".
    bending_um : tuple of float
        Smallest and largest error of the laws fitted to bending.
    bending_modulus_Pa : tuple of float
        Smallest and largest initial shear modulus of the laws fitted to bending.
    tension_um, median_tension_um : float
        Smallest and median error of the laws fitted to tension.
    tension : Route
        Law with the smallest error among those fitted to tension.
    """

    material: str
    section: str
    bending_um: tuple[float, float]
    bending_modulus_Pa: tuple[float, float]
    tension_um: float
    median_tension_um: float
    tension: Route

    @property
    def ratios(self) -> tuple[float, float]:
        """Return the smallest error of fits to tension, over the largest and the smallest error of fits to bending."""
        return self.tension_um / self.bending_um[1], self.tension_um / self.bending_um[0]


def advantages(findings: Findings, kinds: Sequence[str], source: str = "own") -> list[Advantage]:
    """Compare laws fitted to bending with laws fitted to tension, for each material and model of the cross-section.

    Parameters
    ----------
    findings : Findings
        Results of the study.
    kinds : sequence of str
        Types of specimen over which the errors are averaged.
    source : {"own", "published"}
        Simulated or published tensile curve.
    """
    compared = []
    for key, section in findings.bending:
        routes = findings.routes(key, section)
        errors = [
            float(np.mean([mean_error_um(findings.errors[key, section, kind][i]) for kind in kinds]))
            for i in range(len(routes))
        ]
        bending = [i for i, route in enumerate(routes) if route.source == BENDING]
        tension = [i for i, route in enumerate(routes) if route.source == source]
        if not tension:
            continue
        best = min(tension, key=lambda i: errors[i])
        moduli = [routes[i].modulus_Pa for i in bending]
        compared.append(
            Advantage(
                material=key,
                section=section,
                bending_um=(min(errors[i] for i in bending), max(errors[i] for i in bending)),
                bending_modulus_Pa=(min(moduli), max(moduli)),
                tension_um=errors[best],
                median_tension_um=float(np.median([errors[i] for i in tension])),
                tension=routes[best],
            )
        )
    return compared


def untwisted(findings: Findings) -> list[str]:
    """Return the types of specimen for validation; type 4, whose beam twists, is omitted if there are others."""
    unseen = findings.inputs.extent.unseen
    return [kind for kind in unseen if kind != TWISTED] or list(unseen)


def advantage_table(findings: Findings) -> Table:
    """Return the table that compares the errors of laws fitted to bending and of laws fitted to tension."""
    kinds = untwisted(findings)
    rows = []
    for source in ("own", "published"):
        for row in advantages(findings, kinds, source):
            truth = MATERIALS[row.material].modulus_Pa
            low, high = (number(100 * (m / truth - 1), 2) for m in row.bending_modulus_Pa)
            rows.append(
                (
                    MATERIALS[row.material].name,
                    row.section,
                    "of this material" if source == "own" else "published, another lot",
                    f"{number(row.bending_um[0])} to {number(row.bending_um[1])}",
                    f"{low} to {high}",
                    f"{row.tension.law}, {row.tension.window}",
                    number(row.tension_um),
                    number(100 * (row.tension.modulus_Pa / truth - 1), 2),
                    " to ".join(number(ratio, 2) for ratio in row.ratios),
                    number(row.median_tension_um),
                )
            )
    return Table(
        "advantage",
        "Advantage over tensile fits: plane strain, as in the paper, and the solid section",
        (
            "material",
            "section",
            "tensile curve",
            "bending, µm",
            "error of the modulus fitted to bending, %",
            "best tensile fit",
            "tension, µm",
            "error of the modulus of this tensile fit, %",
            "error by tension divided by error by bending, for the worst and the best law",
            "median of tension, µm",
        ),
        tuple(rows),
        f"Mean error over {', '.join(kinds)}: for bending, of the best and of the worst law; for tension, of the best "
        "fit of all laws and windows, which is chosen by these errors, and the median of all fits. A pixel of the "
        "virtual rig is 40 µm.",
    )


def _compressibility(rows: Sequence[dict[str, Any]]) -> Table:
    def identified(row: dict[str, Any]) -> str:
        value, low, high = row["bulk_over_shear_found"]
        return f"{number(value)} [{number(low)}, {number(high)}]"

    ordered = sorted(rows, key=lambda row: row["bulk_over_shear"] or np.inf)
    outside = [
        number(row["bulk_over_shear"])
        for row in ordered
        if row["bulk_over_shear"]
        and not row["bulk_over_shear_found"][1] <= row["bulk_over_shear"] <= row["bulk_over_shear_found"][2]
    ]
    missed = f" The interval misses the truth at K/µ = {', '.join(outside)}." if outside else ""
    return Table(
        "compressibility",
        "Compressibility as a parameter",
        (
            "K/µ",
            "solid, fitted as incompressible: error of the modulus, %",
            "error, µm",
            "plane strain, fitted as incompressible: error of the modulus, %",
            "plane strain, K fitted: error of the modulus, %",
            "identified K/µ [95 %]",
        ),
        tuple(
            (
                "infinite" if row["bulk_over_shear"] is None else number(row["bulk_over_shear"]),
                number(row["solid_percent"]),
                number(row["solid_error_um"]),
                number(row["plane_strain_percent"]),
                f"{number(row['freed_percent'])} [{', '.join(number(v) for v in row['freed_interval_percent'])}]",
                identified(row),
            )
            for row in ordered
        ),
        "A Neo-Hookean specimen of type 1 in six states. K is the bulk modulus and µ the shear modulus. Silicones for "
        f"casting have K/µ above 1000; the largest K/µ of the search is near 10000.{missed}",
    )


def _moment(rows: Sequence[dict[str, Any]]) -> Table:
    def moment(row: dict[str, Any]) -> str:
        if row["moment_percent"] is None:
            return "–"
        value, low, high = (number(v) for v in row["moment_percent"])
        return f"{value} [{low}, {high}]"

    return Table(
        "moment",
        "The magnetic moment as an unknown of the fit",
        (
            "magnet",
            "error of the modulus, %",
            "95 % interval",
            "error, µm",
            "identified deviation of the moment, % [95 %]",
            "correlation with the modulus",
        ),
        tuple(
            (
                row["case"],
                number(row["percent"]),
                f"[{', '.join(number(v) for v in row['interval_percent'])}]",
                number(row["error_um"]),
                moment(row),
                number(row["correlation"], 4),
            )
            for row in rows
        ),
        "A Neo-Hookean specimen of type 1 in six states, with the solid section. Only gravity separates the effects "
        "of moment and modulus. Gravity bends the beam back, so that the relative error of the modulus is larger "
        "than the relative error of the moment.",
    )


def _states(rows: Sequence[dict[str, Any]]) -> Table:
    noises = list(rows[0]["foretold_percent"])
    return Table(
        "states",
        "Number of states for a modulus to one per cent",
        (
            "states",
            *(f"predicted half-width, %, noise {words}" for words in noises),
            "half-width of a fit, %, noise 0.1 px",
            "error of the modulus of this fit, %",
        ),
        tuple(
            (
                str(row["states"]),
                *(number(row["foretold_percent"][words], 2) for words in noises),
                number(row["fit_half_percent"], 2),
                number(row["fit_percent"], 2),
            )
            for row in rows
        ),
        f"{_enough(rows)} The table gives half-widths of 95 % intervals: predicted from the sensitivity of the edges "
        "to the modulus, and the half-widths of a fit, which include the errors of mesh and section. The fields are "
        "equally spaced from zero. The modulus varies as the width to the power −3. With a width of 3 mm and a "
        "standard uncertainty of 0.02 mm, the interval is at least ± 3.9 % for any number of states.",
    )


def _enough(rows: Sequence[dict[str, Any]]) -> str:
    """Return a sentence with the number of states that determine the modulus within 1 %."""
    enough = [row["states"] for row in rows if row["fit_half_percent"] <= 1]
    return (
        f"{min(enough)} states are enough for an interval of ± 1 % if all other inputs are exact."
        if enough
        else "None of the numbers of states in the table is enough for an interval of ± 1 %."
    )


def _optimisers(rows: Sequence[dict[str, Any]]) -> Table:
    def median(values: Sequence[float | None]) -> str:
        reached = [v for v in values if v is not None]
        if not reached:
            return "never"
        words = number(float(np.median(reached)), 4)
        return words if len(reached) == len(values) else f"{words} ({len(reached)} of {len(values)} runs)"

    return Table(
        "optimisers",
        "Optimisers: number of evaluations until the modulus is within one per cent",
        (
            "law",
            "optimiser",
            "evaluations to 1 %, median of the runs",
            "fewest, most",
            "all evaluations",
            "smallest error, µm",
        ),
        tuple(
            (
                row["law"],
                row["optimiser"],
                median(row["to_one_percent"]),
                ", ".join(
                    number(f([v for v in row["to_one_percent"] if v is not None] or [np.inf]), 4) for f in (min, max)
                ),
                number(float(np.median(row["evaluations"])), 4),
                f"{number(min(row['least_error_um']))} to {number(max(row['least_error_um']))}",
            )
            for row in rows
        ),
        "The number is the evaluation after which the modulus of the best candidate stays within one per cent of the "
        "modulus of the optimum. Gauss-Newton counts the evaluations for its derivatives. Gauss-Newton has one run, "
        "because it always starts in the middle. The smallest error is the error on the planar mesh of the search, "
        "before the correction for the solid section.",
    )
