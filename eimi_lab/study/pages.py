"""A study on one page, study.md, with its tables as CSV files and its figures beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eimi_lab.process.outputs import write_file
from eimi_lab.showing.tables import csv_text
from eimi_lab.study.claims import MEASURE, Verdict, in_words, verdicts
from eimi_lab.study.figures import every_figure
from eimi_lab.study.hidden_materials import MATERIALS
from eimi_lab.study.observed import NOISE_MM, TWIST_DEG, TWISTED
from eimi_lab.study.paper_tables import Table, every_table
from eimi_lab.study.whole_study import Findings

_TITLES = {
    "stress_strain.png": "Stress against strain (figure 1): laws by bending as the solid, Yeoh by windows of tension; "
    "grey: what type 1 reaches",
    "errors.png": "Errors by type (figure 7): boxes over the states; a law without equilibrium has none",
    "overlays.png": "The strongest state of every type (figure 8), and the tip of one edge, 1 mm across",
    "error_by_field.png": "Error against field (figure 9): mean over the unseen types that do not twist",
}


def claims_table(found: Sequence[Verdict]) -> Table:
    """The verdicts as a table."""
    rows = tuple((v.claim, v.material, v.section, "yes" if v.agrees else "**no**", v.evidence) for v in found)
    head = ("the paper says", "material", "section", "so here", "figures")
    return Table("claims", "The paper's claims", head, rows, MEASURE)


def write_pages(output: Path, findings: Findings) -> list[str]:
    """Write all files of a study over those of its last run; the lines that a person is told."""
    claims, tables = claims_table(verdicts(findings)), every_table(findings)
    figures = every_figure(findings)
    for table in (claims, *tables):
        write_file(output / f"{table.name}.csv", csv_text([table.head, *table.rows]), force=True)
    for name, picture in figures.items():
        write_file(output / name, picture, force=True)
    answers = in_words(findings)
    write_file(output / "study.md", _page(findings, claims, tables, figures, answers), force=True)
    agreeing = [
        f"{'yes' if v.agrees else 'no '}  {v.section}, {v.material}: {v.claim} {v.evidence}" for v in verdicts(findings)
    ]
    return [*agreeing, *answers, f"{output / 'study.md'}"]


def _page(
    findings: Findings, claims: Table, tables: Sequence[Table], figures: dict[str, bytes], answers: Sequence[str]
) -> str:
    extent = findings.inputs.extent
    hidden = [MATERIALS[key] for key in extent.materials]
    laws = "\n".join(
        f"- {own.name}: {own.law.formula}, mu = {1e-3 * own.modulus_Pa:g} kPa, {own.numbers}" for own in hidden
    )
    parts = [
        "# The evaluation of Di Lecce et al. 2022 on hidden materials",
        f"Type 1 trains, {', '.join(extent.unseen)} validate. Truth is the solid; its outline is taken as edges "
        f"directly, with normal noise of {1e3 * NOISE_MM:g} µm, which is what the edge finder leaves on clean "
        f"pictures: no frames are rendered. {TWISTED.capitalize()} is turned by up to {TWIST_DEG:g}° about its axis. "
        "Geometry, hidden materials and noise are this project's own choice; the paper's printed numbers are not "
        "compared. Hidden materials are none of the laws that are fitted, and follow their tensile curves exactly:",
        laws,
        "## How much of the advantage over tensile fits is left when the section is right",
        *answers,
        f"## {claims.title}",
        claims.markdown(),
        *(f"## {_TITLES[name]}\n\n![{_TITLES[name]}]({name})" for name in figures),
        *(f"## {table.title}\n\n{table.markdown()}" for table in tables),
    ]
    return "\n\n".join(parts) + "\n"
