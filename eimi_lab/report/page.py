"""The report's page: one HTML file with everything in it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from contextlib import ExitStack
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, select_autoescape

from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.identification.experiments import Evidence, load_evidence
from eimi_lab.identification.fits import FitRecord, Quantity
from eimi_lab.outputs import whole_file
from eimi_lab.report import figures
from eimi_lab.report.simulation import simulate_fit


def write_report(
    output: Path,
    datasets: Sequence[Path],
    fits: Sequence[FitRecord],
    *,
    flagged: bool = False,
    force: bool = False,
) -> None:
    """Write the report on datasets and the fits to lay over them. Raises InputError."""
    with ExitStack() as stack:
        sections = []
        for path in datasets:
            evidence = load_evidence(path, flagged=flagged, section=_section(fits))
            sections.append(_dataset_section(stack.enter_context(open_dataset(path)), evidence, fits))
    environment = Environment(autoescape=select_autoescape(default=True), trim_blocks=True, lstrip_blocks=True)
    environment.filters["quantity"] = format_quantity
    template = environment.from_string((files("eimi_lab.report") / "page.html").read_text(encoding="utf-8"))
    page = template.render(
        sections=sections,
        fits=fits,
        convergence=_embed(figures.convergence(fits)) if fits else None,
    )
    with whole_file(output, force) as temporary:
        temporary.write_text(page, encoding="utf-8")


def format_quantity(quantity: Quantity) -> str:
    """A value with its interval, moduli in kPa: ``46.39 kPa [46.31, 46.48]``."""
    scale, unit = (1e-3, " kPa") if quantity.unit == "Pa" else (1.0, "")
    low, high = (scale * bound for bound in quantity.interval_95)
    return f"{scale * quantity.value:.4g}{unit} [{low:.4g}, {high:.4g}]"


def _section(fits: Sequence[FitRecord]) -> Any:
    """The section assumption that the fits were made with, so that the simulation repeats theirs."""
    sections = {reference.section for fit in fits for reference in fit.datasets}
    return sections.pop() if len(sections) == 1 else None


def _embed(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _dataset_section(dataset: Dataset, evidence: Evidence, fits: Sequence[FitRecord]) -> dict[str, Any]:
    """What the template shows of one dataset."""
    simulated = [simulate_fit(fit, evidence) for fit in fits]
    section: dict[str, Any] = {
        "name": dataset.path.name,
        "sha256": evidence.sha256,
        "specimen": dataset.specimen.specimen,
        "magnet": dataset.specimen.magnet,
        "section": evidence.experiment.model.specimen.section,
        "used": len(evidence.states),
        "left_out": evidence.left_out,
        "virtual": dataset.truth() is not None,
        "unseen": [s.fit.model for s in simulated if not s.fitted],
    }
    if simulated:
        best = min(simulated, key=lambda s: float(s.error_mm.mean()))
        if dataset.kind == "frames":
            section["picture"] = _embed(figures.frames_with_edges(dataset, evidence, best))
            section["residuals"] = _embed(figures.residuals_along_edge(best))
        else:
            section["picture"] = _embed(figures.points_with_shape(evidence, best))
        section["best"] = best.fit.model
        section["errors"] = _embed(figures.error_by_state(evidence, simulated))
    elif dataset.kind == "frames":
        section["picture"] = _embed(figures.frames_with_edges(dataset, evidence, None))
    return section
