"""The report's page: one HTML file with everything in it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, select_autoescape

from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.fit_summary import remarks
from eimi_lab.identification.fits import comparison
from eimi_lab.identification.records import FitRecord, Quantity, TensileRecord
from eimi_lab.identification.validation import Validation
from eimi_lab.identification.validation_tables import error_in_words, micrometres
from eimi_lab.outputs import whole_file
from eimi_lab.report import figures, law_panels, stress
from eimi_lab.report.shown import ShownFit, read_shown
from eimi_lab.report.simulation import Simulated, simulate_fits


def write_report(
    output: Path,
    datasets: Sequence[Path],
    fits: Sequence[Path],
    *,
    flagged: bool = False,
    force: bool = False,
) -> None:
    """Write the report on datasets and on the fits of fits.json files, laid over them. Raises InputError."""
    every = read_shown(fits)
    sections, validations = [], []
    for path in datasets:
        evidence, simulated, validated = simulate_fits(path, every, flagged)
        with open_dataset(path) as dataset:
            sections.append(_dataset_section(dataset, evidence, simulated, validated))
        validations.append(validated)
    bending = [shown for shown in every if isinstance(shown.fit, FitRecord)]
    environment = Environment(autoescape=select_autoescape(default=True), trim_blocks=True, lstrip_blocks=True)
    environment.filters["quantity"] = format_quantity
    environment.filters["error"] = error_in_words
    environment.filters["remarks"] = remarks
    environment.filters["micrometres"] = micrometres
    template = environment.from_string((files("eimi_lab.report") / "page.html").read_text(encoding="utf-8"))
    page = template.render(
        sections=sections,
        every=every,
        bending=bending,
        tensile=[shown for shown in every if isinstance(shown.fit, TensileRecord)],
        choices=comparison([shown.fit for shown in bending]),
        stress=_stress_section(every) if every else None,
        matrix=_matrix(every, validations),
        convergence=_embed(figures.convergence(bending)) if bending else None,
    )
    with whole_file(output, force) as temporary:
        temporary.write_text(page, encoding="utf-8")


def format_quantity(quantity: Quantity) -> str:
    """A value with its interval, moduli in kPa: ``46.39 kPa [46.31, 46.48]``."""
    scale, unit = (1e-3, " kPa") if quantity.unit == "Pa" else (1.0, "")
    low, high = (scale * bound + 0.0 for bound in quantity.interval_95)  # no negative zeros
    return f"{scale * quantity.value + 0.0:.4g}{unit} [{low:.4g}, {high:.4g}]"


def _embed(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _matrix(
    every: Sequence[ShownFit], validations: Sequence[Sequence[Validation]]
) -> list[tuple[ShownFit, list[tuple[Validation, bool]]]]:
    """Each fit with its validation on every dataset, and whether that is the dataset's smallest error."""
    least = [min((v.mean_error_mm for v in own if v.mean_error_mm is not None), default=None) for own in validations]
    return [
        (shown, [(own[i], own[i].mean_error_mm == best) for own, best in zip(validations, least, strict=True)])
        for i, shown in enumerate(every)
    ]


def _stress_section(every: Sequence[ShownFit]) -> dict[str, Any]:
    """The stress-strain curves of all fits, over the tensile tests where they are there."""
    curves = stress.stress_curves(every)
    points, missing = stress.tensile_points(every, float(curves[0].strain[-1]))
    reached = stress.bending_strain(every)
    return {
        "picture": _embed(law_panels.stress_curves(curves, points, reached)),
        "reached": reached,
        "band": stress.BAND,
        "missing": missing,
    }


def _dataset_section(
    dataset: Dataset, evidence: Evidence, simulated: Sequence[Simulated], validations: Sequence[Validation]
) -> dict[str, Any]:
    """What the template shows of one dataset."""
    section: dict[str, Any] = {
        "name": dataset.path.name,
        "sha256": evidence.sha256,
        "specimen": dataset.specimen.specimen,
        "magnet": dataset.specimen.magnet,
        "section": " and ".join(dict.fromkeys(v.section for v in validations))
        or evidence.experiment.model.specimen.section,
        "used": len(evidence.states),
        "left_out": evidence.left_out,
        "virtual": dataset.truth() is not None,
        "unseen": bool(validations) and not any(v.seen for v in validations),
    }
    if simulated:
        best = min(simulated, key=lambda s: float(s.error_mm.mean()))
        if dataset.kind == "frames":
            section["picture"] = _embed(figures.frames_with_edges(dataset, evidence, best))
            section["residuals"] = _embed(figures.residuals_along_edge(best))
        else:
            section["picture"] = _embed(figures.points_with_shape(evidence, best))
        section["best"] = best.shown.label
        section["errors"] = _embed(law_panels.errors_by_state(simulated))
        shapes, state = law_panels.shapes_in_largest_state(evidence, simulated)
        section["shapes"], section["largest"] = _embed(shapes), state
    elif dataset.kind == "frames":
        section["picture"] = _embed(figures.frames_with_edges(dataset, evidence, None))
    return section
