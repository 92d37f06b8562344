"""The report's page: one HTML file with everything in it, and its figures and tables as files of their own."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import replace
from datetime import datetime
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, select_autoescape
from markupsafe import Markup

from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.prediction import predict_on_each
from eimi_lab.process.outputs import whole_folder, write_file, write_whole
from eimi_lab.process.progress import silent
from eimi_lab.reporting.contents import DatasetContents, ReportContents, short_names
from eimi_lab.reporting.drawn_panels import AnyPanel, DrawnPanels, Values
from eimi_lab.reporting.elements import Elements
from eimi_lab.reporting.sections import evidence_for_fits
from eimi_lab.reporting.shown import leading, read_shown

Progress = Callable[[str, int], AbstractContextManager[Callable[[str], None]]]


def write_report(
    output: Path,
    datasets: Sequence[Path],
    fits: Sequence[Path],
    *,
    flagged: bool = False,
    force: bool = False,
    assets: Path | None = None,
    command: str = "",
    executor: Callable[[], AbstractContextManager[Executor]] | None = None,
    progress: Progress = lambda title, total: nullcontext(silent),
) -> None:
    """Write the report on datasets and on the fits of fits.json files, laid over them. Raises InputError.

    assets: a folder for each figure as SVG and PDF, each table as CSV and LaTeX. command: the line that asked for it.
    executor: whose workers share the simulations.
    """
    every, written = read_shown(fits), datetime.now().astimezone()
    with ExitStack() as stack:
        folder = stack.enter_context(whole_folder(assets, force)) if assets is not None else None
        told = stack.enter_context(progress("report", len(datasets) * (2 + 2 * len(every)) + 1))
        names, shown, drawn = short_names(datasets), dict[int, DatasetContents](), DrawnPanels()

        def contents() -> ReportContents:
            return ReportContents(every, tuple(shown[place] for place in sorted(shown)), written, command)

        def of_fits() -> None:
            drawn.fits(contents())

        evidence, fits_on = [], []
        for path in datasets:
            own, fits_on_it = evidence_for_fits(path, every, flagged)
            evidence.append(own)
            fits_on.append(fits_on_it)
            told(f"{path.name} read")
        for place, predictions in predict_on_each(fits_on, told, executor, of_fits):
            if place in shown:
                shown[place] = replace(shown[place], predictions=predictions)  # with their intervals
                continue
            dataset = stack.enter_context(open_dataset(datasets[place]))
            own = evidence[place]
            shown[place] = DatasetContents(dataset, own, predictions, names[place], leading(every, own.sha256))
            drawn.dataset(shown[place])
            told(f"{names[place]}, its figures")
            of_fits()
            if len(shown) == len(datasets):
                drawn.datasets(contents())
        page, elements = render(contents(), drawn)
        told("the page")
        if folder is not None:
            for name, content in elements.files().items():
                write_whole(folder / name, content)
    write_file(output, page, force)


def render(report: ReportContents, drawn: DrawnPanels) -> tuple[str, Elements]:
    """The page as HTML, with every panel that has something to show, and its figures and tables."""
    elements = Elements()
    environment = _environment(elements)
    drawn.report(report)
    template = environment.from_string((files("eimi_lab.reporting") / "page.html").read_text(encoding="utf-8"))
    page = template.render(
        title=_title(report),
        report=report,
        before=_filled(environment, drawn.of_report(after_datasets=False)),
        sections=[
            {"name": shown.name, "slug": f"dataset-{number}", "panels": _filled(environment, drawn.of_dataset(shown))}
            for number, shown in enumerate(report.datasets, 1)
        ],
        after=_filled(environment, drawn.of_report(after_datasets=True)),
    )
    return page, elements


def _environment(elements: Elements) -> Environment:
    environment = Environment(autoescape=select_autoescape(default=True), trim_blocks=True, lstrip_blocks=True)
    environment.filters["figure"] = elements.figure
    environment.filters["table"] = elements.table
    return environment


def _title(report: ReportContents) -> str:
    names = ", ".join(shown.name for shown in report.datasets)
    beams = [shown.dataset.specimen.specimen for shown in report.datasets]
    materials = ", ".join(dict.fromkeys(beam.material for beam in beams))
    if not report.every:
        return f"Measured: {materials} ({names})"
    return f"Material identified: {materials}" if materials else "Material identified"


def _filled(environment: Environment, drawn: Iterable[tuple[AnyPanel, Values]]) -> list[dict[str, str]]:
    """Title, anchor and body of each panel that has something to show."""
    filled = []
    for panel, values in drawn:
        if values is not None:
            title, body = (
                Markup(environment.from_string(text).render(values)) for text in (panel.title, panel.template)
            )
            slug = re.sub(r"\W+", "-", panel.title.lower()).strip("-")
            filled.append({"title": title, "body": body, "slug": slug})
    return filled
