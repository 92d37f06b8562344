"""Write the results of a study as one page, `study.md`, with figures as PNG files and tables as CSV files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eimi_lab.process.outputs import write_file
from eimi_lab.showing.tables import csv_text
from eimi_lab.study.claims import MEASURE, Verdict, in_words, verdicts
from eimi_lab.study.figures import all_figures
from eimi_lab.study.hidden_materials import MATERIALS
from eimi_lab.study.observed import NOISE_MM, TWIST_DEG, TWISTED
from eimi_lab.study.paper_tables import Table, all_tables
from eimi_lab.study.whole_study import Findings

_TITLES = {
    "stress_strain.png": (
        "Stress against strain (figure 1 of the paper): laws fitted to bending with the solid section, and Yeoh laws "
        "fitted to tension up to several strains; grey: strains that occur in the specimen of type 1"
    ),
    "errors.png": (
        "Errors by type of specimen (figure 7 of the paper): box plots over the states; a law without equilibrium "
        "has no box"
    ),
    "overlays.png": (
        "The state in the strongest field for each type of specimen (figure 8 of the paper), and the tip of one "
        "edge, 1 mm across"
    ),
    "error_by_field.png": (
        "Error against field (figure 9 of the paper): mean over the types of specimen that were not used for the "
        "fits and do not twist"
    ),
}


def claims_table(judged: Sequence[Verdict]) -> Table:
    """Return a table with the verdict on each claim of the paper (Di Lecce et al. 2022)."""
    rows = tuple((v.claim, v.material, v.section, "yes" if v.agrees else "**no**", v.evidence) for v in judged)
    head = ("claim of the paper", "material", "section", "confirmed", "evidence")
    return Table("claims", "The paper's claims", head, rows, MEASURE)


def write_pages(output: Path, findings: Findings) -> list[str]:
    """Write all files of a study into a folder, and return the lines to print."""
    claims, tables = claims_table(verdicts(findings)), all_tables(findings)
    figures = all_figures(findings)
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
    laws = "\n".join(f"- {m.name}: {m.law.formula}, mu = {1e-3 * m.modulus_Pa:g} kPa, {m.numbers}" for m in hidden)
    parts = [
        "# The evaluation of Di Lecce et al. 2022 on hidden materials",
        (
            f"The laws are fitted to specimens of type 1 and validated on {', '.join(extent.unseen)}. The specimens "
            "are simulated as solids of a hidden material: the simulation knows its law, but the fits do not. The "
            "measured edges are the outlines of the simulated specimens with normal noise of "
            f"{1e3 * NOISE_MM:g} µm, which is the error of the edge finder on clean pictures. No frames are rendered. "
            f"A specimen of {TWISTED} is twisted about its axis, by up to {TWIST_DEG:g}° at its tip. Geometry, hidden "
            "materials and noise are chosen by this project, so that the numbers of the paper are not compared. The "
            "hidden materials follow none of the fitted laws. Their tensile curves have no noise. Their strain "
            "energies W are functions of the invariants I1 and I2:"
        ),
        laws,
        "## The advantage over tensile fits in plane strain and with the solid section",
        *answers,
        f"## {claims.title}",
        claims.markdown(),
        *(f"## {_TITLES[name]}\n\n![{_TITLES[name]}]({name})" for name in figures),
        *(f"## {table.title}\n\n{table.markdown()}" for table in tables),
    ]
    return "\n\n".join(parts) + "\n"
