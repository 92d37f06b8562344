"""The tables of a study: in the paper's form, and those of the open questions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eimi_fitting.laws import LAWS
from eimi_lab.study.errors_by_route import mean_deviation_um, mean_error_um
from eimi_lab.study.extent import SECTIONS
from eimi_lab.study.hidden_materials import MATERIALS
from eimi_lab.study.routes import BENDING, Route
from eimi_lab.study.whole_study import Findings


@dataclass(frozen=True)
class Table:
    """name: of its CSV file; note: what a reader must know of it."""

    name: str
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def markdown(self) -> str:
        """As a part of a page."""
        lines = [self.head, tuple("---" for _ in self.head), *self.rows]
        table = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
        return f"{table}\n\n{self.note}".strip()


def number(value: float | None, digits: int = 3) -> str:
    """Of so many digits; ∞ is the error of a law that finds no equilibrium."""
    if value is None:
        return "–"
    return (
        f"{value:.{digits}g}"
        if np.isfinite(value) and abs(value) < 1e4
        else ("∞" if np.isinf(value) else f"{value:.0f}")
    )


def every_table(findings: Findings) -> list[Table]:
    """Those of what was found."""
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
    """Table 4 of the paper: what the searches cost."""
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
        "what the data do not fix",
    )
    note = "What the data do not fix may stand at a bound of its search."
    return Table("searches", "Searches on type 1 (table 4)", head, tuple(rows), note)


def _values(route: Route) -> str:
    law = LAWS[route.law]
    named = zip(law.parameter_names, law.units, route.values, strict=True)
    return ", ".join(
        f"{name} {v / 1e3 + 0.0:.4g} kPa" if unit == "Pa" else f"{name} {v:.3g}" for name, unit, v in named
    )


def parameters(findings: Findings, key: str) -> Table:
    """Tables 5 and 6 of the paper: parameters of one material, with mean error and deviation by type and section."""
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
        f"Parameters and errors, {MATERIALS[key].name} (tables 5 and 6)",
        ("section", "fitted to", "law", "parameters", "initial modulus, kPa", *(f"{k}, µm" for k in extent.types)),
        tuple(rows),
        f"Mean error and, in brackets, mean deviation. True initial modulus "
        f"{number(MATERIALS[key].modulus_Pa / 1e3)} kPa. ∞: no equilibrium. Tensile fits are least squares without "
        "constraints, as is usual; one with a negative modulus is no material.",
    )


@dataclass(frozen=True)
class Advantage:
    """Mean errors in µm over unseen types that do not twist.

    By bending, least to largest of the laws; by tension the best, which one that is, and the median.
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
        """The best conventional fit's error over that of the worst and of the best law by bending."""
        return self.tension_um / self.bending_um[1], self.tension_um / self.bending_um[0]


def advantages(findings: Findings, kinds: Sequence[str], source: str = "own") -> list[Advantage]:
    """By material and section, over these types; ``source`` of the tensile curve."""
    found = []
    for key, section in findings.bending:
        routes = findings.routes(key, section)
        errors = [
            float(np.mean([mean_error_um(findings.errors[key, section, kind][i]) for kind in kinds]))
            for i in range(len(routes))
        ]
        bent = [i for i, route in enumerate(routes) if route.source == BENDING]
        pulled = [i for i, route in enumerate(routes) if route.source == source]
        if not pulled:
            continue
        best = min(pulled, key=lambda i: errors[i])
        moduli = [routes[i].modulus_Pa for i in bent]
        found.append(
            Advantage(
                material=key,
                section=section,
                bending_um=(min(errors[i] for i in bent), max(errors[i] for i in bent)),
                bending_modulus_Pa=(min(moduli), max(moduli)),
                tension_um=errors[best],
                median_tension_um=float(np.median([errors[i] for i in pulled])),
                tension=routes[best],
            )
        )
    return found


def untwisted(findings: Findings) -> list[str]:
    """Unseen types that do not twist, or all unseen ones where there is no such type."""
    from eimi_lab.study.observed import TWISTED

    unseen = findings.inputs.extent.unseen
    return [kind for kind in unseen if kind != TWISTED] or list(unseen)


def advantage_table(findings: Findings) -> Table:
    """How much of the advantage over tensile fits is left when the section is right."""
    kinds = untwisted(findings)
    rows = []
    for source in ("own", "published"):
        for own in advantages(findings, kinds, source):
            truth = MATERIALS[own.material].modulus_Pa
            low, high = (number(100 * (m / truth - 1), 2) for m in own.bending_modulus_Pa)
            rows.append(
                (
                    MATERIALS[own.material].name,
                    own.section,
                    "its own" if source == "own" else "published, another lot",
                    f"{number(own.bending_um[0])} to {number(own.bending_um[1])}",
                    f"{low} to {high}",
                    f"{own.tension.law}, {own.tension.window}",
                    number(own.tension_um),
                    number(100 * (own.tension.modulus_Pa / truth - 1), 2),
                    " to ".join(number(ratio, 2) for ratio in own.ratios),
                    number(own.median_tension_um),
                )
            )
    return Table(
        "advantage",
        "Plane strain as published, and the solid",
        (
            "material",
            "section",
            "tensile curve",
            "bending, µm",
            "its modulus off, %",
            "best by tension",
            "tension, µm",
            "its modulus off, %",
            "tension over bending, worst and best law",
            "median of tension, µm",
        ),
        tuple(rows),
        f"Mean error over {', '.join(kinds)}; for bending the best and the worst of the laws, for tension the best of "
        "all laws and windows, chosen with hindsight, and the median. A pixel of the virtual rig is 40 µm.",
    )


def _compressibility(rows: Sequence[dict[str, Any]]) -> Table:
    def found(row: dict[str, Any]) -> str:
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
            "solid, taken as incompressible: modulus off, %",
            "error, µm",
            "plane strain, incompressible: modulus off, %",
            "plane strain, K freed: modulus off, %",
            "K/µ found [95 %]",
        ),
        tuple(
            (
                "infinite" if row["bulk_over_shear"] is None else number(row["bulk_over_shear"]),
                number(row["solid_percent"]),
                number(row["solid_error_um"]),
                number(row["plane_strain_percent"]),
                f"{number(row['freed_percent'])} [{', '.join(number(v) for v in row['freed_interval_percent'])}]",
                found(row),
            )
            for row in ordered
        ),
        f"Neo-Hookean type 1 in six states. Casting silicones have K/µ above 1000; the search ends near 10000.{missed}",
    )


def _moment(rows: Sequence[dict[str, Any]]) -> Table:
    def moment(row: dict[str, Any]) -> str:
        if row["moment_percent"] is None:
            return "–"
        value, low, high = (number(v) for v in row["moment_percent"])
        return f"{value} [{low}, {high}]"

    return Table(
        "moment",
        "The moment as an unknown",
        ("magnet", "modulus off, %", "95 %", "error, µm", "moment found off, % [95 %]", "correlation with the modulus"),
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
        "Neo-Hookean type 1 in six states, as the solid. Only gravity tells moment and modulus apart; it bends the "
        "beam back, so that the modulus is off by more than the moment.",
    )


def _states(rows: Sequence[dict[str, Any]]) -> Table:
    noises = list(rows[0]["foretold_percent"])
    return Table(
        "states",
        "How many states fix the modulus to one per cent",
        ("states", *(f"± %, noise {words}" for words in noises), "± % of a fit, 0.1 px", "that fit off, %"),
        tuple(
            (
                str(row["states"]),
                *(number(row["foretold_percent"][words], 2) for words in noises),
                number(row["fit_half_percent"], 2),
                number(row["fit_percent"], 2),
            )
            for row in rows
        ),
        f"{_enough(rows)} Half-widths of 95 % intervals: foretold from the sensitivity of the edges to the modulus, "
        "and of a fit, which adds what its mesh and section leave. Fields are equally spaced from zero. The modulus "
        "goes with width to the power −3: a width of 3 mm that is known to 0.02 mm leaves ± 3.9 % with any number of "
        "states.",
    )


def _enough(rows: Sequence[dict[str, Any]]) -> str:
    """The answer, by the fits."""
    enough = [row["states"] for row in rows if row["fit_half_percent"] <= 1]
    return f"{min(enough)} states do, with all else exact." if enough else "None of these is enough."


def _optimisers(rows: Sequence[dict[str, Any]]) -> Table:
    def median(values: Sequence[float | None]) -> str:
        reached = [v for v in values if v is not None]
        if not reached:
            return "never"
        words = number(float(np.median(reached)), 4)
        return words if len(reached) == len(values) else f"{words} ({len(reached)} of {len(values)} runs)"

    return Table(
        "optimisers",
        "Optimisers: evaluations to a modulus within one per cent",
        ("law", "optimiser", "to 1 %, median of runs", "least, most", "all evaluations", "least error, µm"),
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
        "From the evaluation counted on, the best candidate stays within one per cent of the optimum's modulus. "
        "Gauss-Newton counts the differences for its derivatives, and has one run: it always begins in the middle. "
        "The least error is that of the search's planar model, which the solid's correction takes away later.",
    )
